"""Analysis of a record that is already an average in angle: its indicators, and the reasons for withheld ones.

An average over one component retains what repeats with its revolution: mesh harmonics, their sidebands, local damage of
its gears. Bearings, other shafts, time and speed are lost, and a single average has no scatter from which a probability
could be derived: nothing is diagnosed, and the reason is given for every component.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from scipy import fft

from hums.analysis.channel import AnalysedChannel
from hums.analysis.expected_lines import ORDER_SPECTRUM
from hums.analysis.indicators import (
    SHAFT_ORDERS,
    Baseline,
    Gear,
    MonitoredComponent,
    carrier_sideband_ratio,
    gear_indicators,
    unavailable,
)
from hums.analysis.reference_angle import AngleSource, Machine, solved
from hums.analysis.result import IndicatorValue, SensorCondition, Unmeasured
from hums.analysis.segments import ChannelSegments, Scan, Segment, SegmentedRecord, Values, scanned, selected_channels
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.gearbox.components import closest
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.gearbox.model import Gearbox
from hums.gearbox.planetary_stages import planetary_stages
from hums.records.channels import channel_values
from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import residual_signal
from signals.indicators import INDICATORS, kurtosis, rms
from signals.shaft.phase import constant_speed
from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum

_RAW = ("rms", "peak", "crest_factor", "kurtosis")
_STANDARDISED = 1e-2  # largest difference from one of the standard deviation of a normalised signal
_NO_TIME = "a synchronous average has no time axis, and its speed is unknown"
_NOT_SYNCHRONOUS = "bearing lines are not whole orders, so that averaging removed them"


def average_channel(channel: ChannelSegments, settings: AnalysisSettings, baseline: Baseline) -> AnalysedChannel:
    """Return the analysis of a channel of an average in angle: spectrum over whole orders, and indicators."""
    (segment,) = channel.segments
    component = segment.record.attrs["average_of"]
    monitored = MonitoredComponent(channel=segment.name, units=segment.units, component=component, kind="shaft")
    average = _average(segment)
    return AnalysedChannel(
        name=segment.name,
        units=segment.units,
        rate_hz=math.nan,
        segments=(segment,),
        duration_s=math.nan,
        analysed_s=math.nan,
        revolutions=int(segment.turns),
        left_out="",
        failed=(),
        spectra={ORDER_SPECTRUM: _spectrum(segment, component)},
        blocks=1,
        noise_left=1.0,
        lines=(),
        out_of_range=(),
        crest_factor=math.nan,
        condition=SensorCondition(
            name=segment.name, sensor="vibration", status="ok", not_judged="the sensor, from an average"
        ),
        band=None,
        indicators=tuple(_indicators(monitored, segment.values, average, segment.machine, settings, baseline)),
    )


def envelope_depths(values: Values, *, harmonics: int) -> list[float]:
    """Return the amplitudes of the first orders of the envelope of one revolution, over the mean of the envelope.

    The envelope is the magnitude of the analytic signal. A modulation by ``1 + m cos(k angle)`` has the depth m at
    order k.

    Parameters
    ----------
    values : (n,) array
        One revolution, in any unit, without its mean.
    harmonics : int
        Number of orders.

    Raises
    ------
    ValueError
        If all values are zero, or there are too few.

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


def average_segments(record: xr.Dataset, gearbox: Gearbox, settings: AnalysisSettings) -> SegmentedRecord:
    """Return an average in angle as one segment of each channel, the reference at one revolution per second.

    Raises
    ------
    AnalysisError
        If the gearbox has no such link, or every channel is constant or has gaps.
    """
    mechanism, component = solved(gearbox), record.attrs["average_of"]
    kinematics = mechanism.kinematics
    if component not in kinematics.links:
        raise AnalysisError(
            f'the record is an average over "{component}", which gearbox "{gearbox.name}" does not have as a link'
            f"{closest(component, list(kinematics.links))}"
        )
    phase = constant_speed(1.0, start_s=0.0, stop_s=1.0)
    machine = Machine(
        kinematics=kinematics,
        reference=mechanism.reference,
        defect_orders=mechanism.defect_orders,
        bearings=mechanism.bearings,
        phase=phase,
        source=AngleSource(shaft=mechanism.reference, phase=phase),
        ratio=1.0,
    )
    names = selected_channels(record, settings)
    channels = {name: scanned([record], name, [Scan.of(channel_values(record, name))]) for name in names}
    for name, one in channels.items():
        if not one.why:
            turns = record[name].size / int(record.attrs["samples_per_rev"])
            segment = Segment(record=record, name=name, machine=machine, part=0, turns=turns)
            channels[name] = replace(one, segments=(segment,))
    if all(one.why for one in channels.values()):
        raise AnalysisError(next(iter(channels.values())).why)
    return SegmentedRecord(machine=machine, machines={}, starts_s={}, channels=channels, left_out=[_note(record)])


def _gears_on(machine: Machine, component: str) -> dict[str, int]:
    """Return the teeth of each gear on a link, by component name; for a planet, in the mesh with the ring only.

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


def _average(segment: Segment) -> SynchronousAverage:
    """Return one revolution, the mean of those in the record."""
    record = segment.record
    per_rev = int(record.attrs["samples_per_rev"])
    turns = np.asarray(segment.values, dtype=np.float64).reshape(-1, per_rev)
    spread = turns.std(axis=0, ddof=1) / math.sqrt(len(turns)) if len(turns) > 1 else np.full(per_rev, np.nan)
    return SynchronousAverage(
        values=turns.mean(axis=0),
        standard_error=spread,
        revolutions=len(turns) * int(record.attrs.get("averaged_over", 1)),
        ratio=Fraction(1),
        passband_orders=float((per_rev - 1) // 2),
    )


def _spectrum(segment: Segment, component: str) -> AmplitudeSpectrum:
    """Return the spectrum over the orders of the reference; an average is periodic and needs no window."""
    per_rev, kinematics = int(segment.record.attrs["samples_per_rev"]), segment.machine.kinematics
    body = kinematics.bodies[component]
    joint = kinematics.joints.get(body)
    seen_from = kinematics.gearbox.frame if joint is None else joint.carried_by
    ratio = abs(float(kinematics.relative_speed(component, seen_from=seen_from))) if joint is not None else 1.0
    return amplitude_spectrum(segment.values, rate=per_rev * (ratio or 1.0), window="boxcar", padding=1)


# ---- indicators ------------------------------------------------------------------------------------------------------


def _indicators(
    monitored: MonitoredComponent,
    values: Values,
    average: SynchronousAverage,
    machine: Machine,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> list[IndicatorValue]:
    """Return the indicators of one channel, and a row with the reason for each that is withheld."""
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
    """Yield the indicators of the samples; levels of a signal normalised by its standard deviation are withheld."""
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
    """Yield level and kurtosis of the residual between the mesh harmonics, and the lines of its envelope.

    For a link without gears the residual signal is the whole average.
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
        f"The record is an average in angle of {attrs['average_of']}, {over}: what does not repeat with it has been "
        "averaged out, and nothing is judged. Follow its indicators from record to record (hums fleet)."
    )


def no_speed(machine: Machine) -> xr.Dataset:
    """Return the group `/speed` of a record without time."""
    empty = np.zeros(0)
    attrs = {"shaft": machine.reference, "measured_on": "", "tachometer": "", "nominal": 0}
    return xr.Dataset(
        {"speed_hz": ("revolution", empty, {"units": "rev s-1"})},
        coords={"time_s": ("revolution", empty, {"units": "s"})},
        attrs=attrs,
    )


def parts_of_average(machine: Machine, component: str) -> list[Unmeasured]:
    """Return for every component the reason why an average does not assess it."""
    bodies = machine.kinematics.bodies
    own = {component, component.rpartition(" ")[0], *(link for link in bodies if bodies[link] == bodies[component])}
    found = []
    for row in machine.defect_orders:
        if row.kind not in {*BEARING_KINDS, "tooth"}:
            continue
        why = _NOT_SYNCHRONOUS
        if row.kind == "tooth":
            why = "teeth are judged by the scatter between revolutions, which a single average lacks"
            if row.component.rpartition("/")[2] not in own:
                why = f"the record is an average over {component}, in which this gear does not repeat"
        change = "judged in the record from which the average was made"
        found.append(Unmeasured(component=row.component, kind=row.kind, why=why, least_change=change))
    return found
