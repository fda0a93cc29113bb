"""Analysis of a record that is an average in angle already: its indicators, and by name what it does not allow.

An average over one component keeps what repeats with its revolution: mesh harmonics, their sidebands, local damage of
its gears. Bearings, other shafts, time and speed are gone, and one average has no spread from which a probability could
be taken: nothing is diagnosed, and every part says why.
"""

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from scipy import fft

from hums.analysis.channel import Values, excluded_channels, selected_channels, varying_values
from hums.analysis.findings import NOT_JUDGED, Finding
from hums.analysis.indicators import (
    HISTORIES,
    SHAFT_ORDERS,
    Baseline,
    Gear,
    MonitoredComponent,
    carrier_sideband_ratio,
    gear_indicators,
    read_baseline,
    unavailable,
)
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.reference_angle import AngleSource, Machine, solved
from hums.analysis.result import (
    Analysis,
    IndicatorValue,
    SensorCondition,
    check_analysis,
    root_attributes,
    rows_dataset,
    spectrum_dataset,
    tree_of,
)
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.gearbox.components import closest
from hums.gearbox.model import Gearbox
from hums.gearbox.orders import BEARING_KINDS
from hums.gearbox.planetary_stages import planetary_stages
from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import residual_signal
from signals.indicators import INDICATORS, kurtosis, rms
from signals.shaft.phase import constant_speed
from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum

__all__ = ["analyse_average", "envelope_depths"]

_RAW = ("rms", "peak", "crest_factor", "kurtosis")
_STANDARDISED = 1e-2  # how near one the deviation of a signal without unit is, of which it is taken for the unit
_NO_TIME = "an average in angle has no time, and its speed is not known"
_NOT_SYNCHRONOUS = "a bearing's lines are no multiples of a revolution, so that averaging removed them"


def analyse_average(
    record: xr.Dataset, gearbox: Gearbox, settings: AnalysisSettings, previous: Analysis | None
) -> Analysis:
    """Return the analysis of an average in angle: spectra over whole orders, and the indicators that it allows.

    Parameters
    ----------
    record : xarray.Dataset
        Declared with `hums.AngularAverage`.
    gearbox : Gearbox
        With a link named as the average's component.
    settings : AnalysisSettings
        Channels, harmonics and the freezing of the baseline are used.
    previous : xarray.DataTree, optional
        Analysis of the previous average of this machine, for NA4 and NB4.

    Raises
    ------
    AnalysisError
        If the gearbox has no such link, or every channel is constant or has gaps.
    """
    machine, component = _machine(gearbox, record.attrs["average_of"]), record.attrs["average_of"]
    chosen = selected_channels(record, settings)
    gapped, constant = excluded_channels(record, chosen)
    names = [name for name in chosen if name not in gapped and name not in constant]
    units = {name: str(record[name].attrs["units"]) for name in names}
    baseline = read_baseline(previous, settings, units=units)
    indicators: list[IndicatorValue] = []
    spectra: list[tuple[str, str, AmplitudeSpectrum]] = []
    for name in names:
        values = varying_values(record, name)
        average = _average(values, record)
        monitored = MonitoredComponent(channel=name, units=units[name], component=component, kind="shaft")
        indicators += _indicators(monitored, values, average, machine, settings, baseline)
        spectra.append((name, units[name], _spectrum(values, record, machine, component)))
    per_rev = int(record.attrs["samples_per_rev"])
    described = [
        {"name": name, "units": units[name], "revolutions": record[name].size // per_rev, "samples_per_rev": per_rev}
        for name in names
    ]
    excluded = [f'Channel "{name}" is dead and left out: it has the same value throughout.' for name in constant]
    excluded += [f'Channel "{name}" is left out: it has {gaps}.' for name, gaps in gapped.items()]
    tree = tree_of(
        {
            "/": xr.Dataset(
                attrs=root_attributes(
                    record,
                    gearbox,
                    machine.reference,
                    settings,
                    channels=described,
                    notes=[_note(record), *excluded],
                )
            ),
            "/speed": _no_speed(machine),
            "/health": rows_dataset(_conditions([*names, *constant], gapped), SensorCondition, dim="item"),
            f"/{ORDER_SPECTRUM}": spectrum_dataset(spectra, []),
            f"/{ENVELOPE}": spectrum_dataset([], []),
            "/tracks": xr.Dataset(),
            "/indicators": rows_dataset(indicators, IndicatorValue, dim="row").assign_attrs(
                {HISTORIES: baseline.to_json()}
            ),
            "/findings": rows_dataset([], Finding, dim="finding"),
            "/verdicts": rows_dataset(list(_verdicts(machine, component, names, units)), Finding, dim="part"),
        }
    )
    check_analysis(tree)
    return tree


def envelope_depths(values: Values, *, harmonics: int) -> list[float]:
    """Return the amplitudes of the first orders of the envelope of one revolution, over the mean of the envelope.

    The envelope is the magnitude of the analytic signal. Where a revolution is modulated by ``1 + m cos(k angle)``,
    order k has the depth m.

    Parameters
    ----------
    values : (n,) array
        One revolution, any unit, its mean removed by the caller.
    harmonics : int
        Number of orders.

    Raises
    ------
    ValueError
        If the values are zero throughout, or too few.

    Examples
    --------
    >>> import numpy as np
    >>> from hums.analysis.averages import envelope_depths
    >>> angle = 2 * np.pi * np.arange(256) / 256
    >>> values = (1 + 0.3 * np.cos(2 * angle)) * np.cos(40 * angle)
    >>> [round(depth, 6) + 0 for depth in envelope_depths(values, harmonics=3)]
    [0.0, 0.3, 0.0]
    """
    size = values.size
    lines = fft.fft(values)
    lines[1 : (size + 1) // 2] *= 2
    lines[size // 2 + 1 :] = 0
    envelope = np.abs(fft.ifft(lines))
    level = float(envelope.mean())
    if level == 0 or harmonics >= size // 2:
        raise ValueError("the envelope is zero throughout, or has fewer samples than orders.")
    depths = 2 * np.abs(fft.rfft(envelope))[1 : harmonics + 1] / size / level
    return [float(depth) for depth in depths]


# ---- the component ---------------------------------------------------------------------------------------------------


def _machine(gearbox: Gearbox, component: str) -> Machine:
    """Return the kinematics of the gearbox, with the reference at one revolution a second: no speed is known."""
    mechanism = solved(gearbox)
    kinematics = mechanism.kinematics
    if component not in kinematics.links:
        raise AnalysisError(
            f'the record is an average over "{component}", which gearbox "{gearbox.name}" does not have as a link'
            f"{closest(component, list(kinematics.links))}"
        )
    phase = constant_speed(1.0, start_s=0.0, stop_s=1.0)
    return Machine(
        kinematics=kinematics,
        reference=mechanism.reference,
        defect_orders=mechanism.defect_orders,
        bearings=mechanism.bearings,
        phase=phase,
        source=AngleSource(shaft=mechanism.reference, phase=phase),
        ratio=1.0,
    )


def _gears_on(machine: Machine, component: str) -> dict[str, int]:
    """Return the teeth of each gear on a link, by its component name; of a planet in the mesh with the ring alone.

    Both meshes of a planet have the same teeth, and the same average.
    """
    bodies = machine.kinematics.bodies
    for stage in planetary_stages(machine.kinematics):
        if component in stage.planets:
            return {f"{stage.ring_mesh}/{component}": stage.teeth.planet}
    return {
        f"{contact.mesh}/{link}": abs(teeth)
        for contact in machine.kinematics.contacts
        for link, teeth in contact.gears
        if bodies[link] == bodies[component]
    }


def _average(values: Values, record: xr.Dataset) -> SynchronousAverage:
    """Return one revolution, the mean of those that the record holds."""
    per_rev = int(record.attrs["samples_per_rev"])
    turns = np.asarray(values, dtype=np.float64).reshape(-1, per_rev)
    spread = turns.std(axis=0, ddof=1) / math.sqrt(len(turns)) if len(turns) > 1 else np.full(per_rev, np.nan)
    return SynchronousAverage(
        values=turns.mean(axis=0),
        standard_error=spread,
        revolutions=len(turns) * int(record.attrs.get("averaged_over", 1)),
        ratio=Fraction(1),
        passband_orders=float((per_rev - 1) // 2),
    )


def _spectrum(values: Values, record: xr.Dataset, machine: Machine, component: str) -> AmplitudeSpectrum:
    """Return the spectrum over the orders of the reference; the average repeats, so that no window is needed."""
    per_rev, kinematics = int(record.attrs["samples_per_rev"]), machine.kinematics
    body = kinematics.bodies[component]
    joint = kinematics.joints.get(body)
    seen_from = kinematics.gearbox.frame if joint is None else joint.carried_by
    ratio = abs(float(kinematics.relative_speed(component, seen_from=seen_from))) if joint is not None else 1.0
    return amplitude_spectrum(values, rate=per_rev * (ratio or 1.0), window="boxcar", padding=1)


# ---- indicators ------------------------------------------------------------------------------------------------------


def _indicators(
    monitored: MonitoredComponent,
    values: Values,
    average: SynchronousAverage,
    machine: Machine,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> list[IndicatorValue]:
    """Return the indicators of one channel, and a row with the reason for each that cannot be made."""
    component, gears = monitored.component, _gears_on(machine, monitored.component)
    rows = [*_raw(monitored, values), *_of_shaft(monitored, average)]
    for name, teeth in gears.items():
        gear = Gear(component=name, teeth=teeth, on_shaft=tuple(gears.values()), harmonics=settings.harmonics)
        of_gear = MonitoredComponent(channel=monitored.channel, units=monitored.units, component=name, kind="gear")
        rows += gear_indicators(of_gear, average, gear, baseline)
    rows += _of_residual(monitored, average, tuple(gears.values()), settings)
    stage = next((stage for stage in planetary_stages(machine.kinematics) if stage.carrier == component), None)
    if stage is not None:
        rows.append(carrier_sideband_ratio(monitored, stage, lambda: average))
    made = {row.indicator for row in rows}
    for name, indicator in INDICATORS.items():
        if name not in made:
            rows.append(monitored.evaluate(name, "average in angle", unavailable(_why_not(indicator.part, component))))
    for name, why in (("velocity_rms", _NO_TIME), ("defect_energy_ratio", _NOT_SYNCHRONOUS)):
        rows.append(monitored.evaluate(name, "average in angle", unavailable(f"{why}.")))
    return rows


def _raw(monitored: MonitoredComponent, values: Values) -> Iterator[IndicatorValue]:
    """Yield the indicators of the samples; levels of a signal that was scaled by its own deviation are withheld."""
    whole = MonitoredComponent(channel=monitored.channel, units=monitored.units, component="record", kind="channel")
    takes = f"average over {monitored.component}"
    scaled = monitored.units == "1" and abs(float(np.std(values)) - 1) < _STANDARDISED
    for name in _RAW:
        if scaled and INDICATORS[name].unit == "signal":
            why = "the average was scaled to a deviation of one, so that its level has no meaning."
            yield whole.evaluate(name, takes, unavailable(why))
        else:
            yield whole.evaluate(name, takes, partial(INDICATORS[name], values))


def _of_shaft(monitored: MonitoredComponent, average: SynchronousAverage) -> Iterator[IndicatorValue]:
    for name in ("so1", "so2", "so3"):
        yield monitored.evaluate(name, f"average over {monitored.component}", partial(INDICATORS[name], average))


def _of_residual(
    monitored: MonitoredComponent, average: SynchronousAverage, teeth: tuple[int, ...], settings: AnalysisSettings
) -> Iterator[IndicatorValue]:
    """Yield level and kurtosis of what is left between the mesh harmonics, and the lines of its envelope.

    A link without gears has its whole average for a residual signal.
    """
    takes = f"residual signal of the average over {monitored.component}"

    def residual() -> Values:
        if not teeth:
            return np.asarray(average.values - average.values.mean())
        cut: dict[str, Any] = {
            "teeth": teeth,
            "harmonics": _all_harmonics(average, teeth),
            "shaft_orders": SHAFT_ORDERS,
        }
        return residual_signal(average, **cut).values

    yield monitored.evaluate("residual_rms", takes, lambda: rms(residual()), unit="signal")
    yield monitored.evaluate("residual_kurtosis", takes, lambda: kurtosis(residual()))
    for order in range(1, settings.harmonics + 1):
        yield monitored.evaluate(
            f"envelope_line_{order}",
            f"order {order} of the envelope of the {takes}, over the mean of the envelope",
            lambda order=order: envelope_depths(residual(), harmonics=order)[-1],  # type: ignore[misc]
        )


def _all_harmonics(average: SynchronousAverage, teeth: Sequence[int]) -> int:
    """Return the number of mesh harmonics within the average, of the gear with the fewest teeth."""
    return max(1, average.samples_per_rev // 2 // min(teeth))


def _why_not(part: str, component: str) -> str:
    return {
        "bearing": f"{_NOT_SYNCHRONOUS}.",
        "planetary": f"it needs the average over a carrier; this is one over {component}.",
        "gear": f"{component} carries no gear; give the average over a link that does.",
    }.get(part, f"{_NO_TIME}.")


# ---- the other groups ------------------------------------------------------------------------------------------------


def _note(record: xr.Dataset) -> str:
    attrs = record.attrs
    over = f"over {attrs['averaged_over']} revolutions" if "averaged_over" in attrs else "over an unknown number"
    return (
        f"The record is an average in angle of {attrs['average_of']}, {over}: what does not repeat with it is gone, "
        "and nothing is judged. Its indicators are to be followed from record to record (hums fleet)."
    )


def _no_speed(machine: Machine) -> xr.Dataset:
    empty = np.zeros(0)
    attrs = {"shaft": machine.reference, "measured_on": "", "tachometer": "", "nominal": 0}
    return xr.Dataset(
        {"speed_hz": ("revolution", empty, {"units": "rev s-1"})},
        coords={"time_s": ("revolution", empty, {"units": "s"})},
        attrs=attrs,
    )


def _conditions(names: Sequence[str], gapped: dict[str, str]) -> list[SensorCondition]:
    rows = [
        SensorCondition(name=name, sensor="vibration", status="sick", reasons=f"It drops out: it has {gaps}.")
        for name, gaps in gapped.items()
    ]
    return rows + [
        SensorCondition(name=name, sensor="vibration", status="ok", not_judged="the sensor, from an average")
        for name in names
    ]


def _verdicts(machine: Machine, component: str, names: Sequence[str], units: dict[str, str]) -> Iterator[Finding]:
    """Yield for every part why an average does not judge it."""
    bodies = machine.kinematics.bodies
    own = {component, component.rpartition(" ")[0], *(link for link in bodies if bodies[link] == bodies[component])}
    for row in machine.defect_orders:
        if row.kind not in {*BEARING_KINDS, "tooth"} or not names:
            continue
        why = _NOT_SYNCHRONOUS
        if row.kind == "tooth":
            why = "one average has no spread from turn to turn by which teeth could be judged"
            if row.component.rpartition("/")[2] not in own:
                why = f"the record is an average over {component}, in which this gear does not repeat"
        yield Finding(
            component=row.component,
            kind=row.kind,
            channel=names[0],
            verdict=NOT_JUDGED,
            evidence=f"not judged: {why}.",
            false_alarm_probability=math.nan,
            snr=0.0,
            order_found=float(row.order),
            amplitude=0.0,
            units=units[names[0]],
            doubts=why,
            next_step="Give the record from which the average was made.",
        )
