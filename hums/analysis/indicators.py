"""Condition indicators of a channel: of the raw signal, shafts, gears, planetary stages and bearings.

Indicators of shafts and gears on fixed axes are computed from the synchronous average of their shaft, whose order is
exact; residual and difference signals exclude the meshes of every gear on that shaft. Those of bearings are computed
from the envelope spectrum, those of planetary stages in `hums.analysis.indicators`. For a faulty sensor, only the raw
RMS is given.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cache, partial
from typing import Any

import numpy as np
from scipy import fft

from hums.analysis.evidence import PartEvidence
from hums.analysis.reference_angle import Machine
from hums.analysis.result import Analysis, IndicatorValue, check_analysis, group
from hums.analysis.segments import Segment, resample_in_angle
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.gearbox.planetary_stages import PlanetaryStage, planetary_stages
from signals.angle.averaging import SynchronousAverage, synchronous_average
from signals.angle.planets import PassWindow, pass_angle, planet_average, sun_average
from signals.angle.residual import (
    MeshBand,
    ResidualSignal,
    difference_signal,
    mesh_band,
    regular_signal,
    residual_signal,
)
from signals.indicators import INDICATORS, DefectEnergy, VarianceHistory
from signals.resampling.resampling import PASSBAND, AngularSignal
from signals.spectra.integration import ISO_20816_HZ, ISO_20816_SLOW_HZ, velocity
from signals.spectra.spectra import AmplitudeSpectrum

# ---- Variances of earlier records of a machine, to which NA4 and NB4 refer -------------------------------------------


HISTORIES = "histories_json"
Key = tuple[str, str, str]  # channel, component, indicator


@dataclass
class Baseline:
    """Histories of variance by channel, component and indicator, updated while a record is analysed."""

    histories: dict[Key, VarianceHistory]
    limit_std: float | None
    freeze: bool

    def update(self, key: Key, signal: ResidualSignal | MeshBand) -> VarianceHistory:
        """Add this record to a history and return it."""
        history = self.histories.get(key, VarianceHistory(limit_std=self.limit_std))
        if self.freeze and history.records:
            history = history.freeze()
        history = history.update(signal)
        self.histories[key] = history
        return history

    def copy(self) -> "Baseline":
        """Return a copy of the histories, which a segment may update."""
        return replace(self, histories=dict(self.histories))

    def take(self, key: Key, other: "Baseline") -> None:
        """Replace one history by that of another copy."""
        if key in other.histories:
            self.histories[key] = other.histories[key]

    def to_json(self) -> str:
        """Return the histories as JSON, for the attributes of `/indicators`."""
        rows = [
            {"channel": channel, "component": component, "indicator": indicator}
            | {field.name: getattr(history, field.name) for field in fields(history)}
            for (channel, component, indicator), history in sorted(self.histories.items())
        ]
        return json.dumps(rows)


def read_baseline(
    previous: Analysis | None,
    settings: AnalysisSettings,
    *,
    units: Mapping[str, str],
    of: Mapping[str, str],
    recorded_at: str = "",
) -> Baseline:
    """Return the histories in the analysis of the previous record, or empty ones.

    Parameters
    ----------
    previous : xarray.DataTree, optional
        Analysis of the previous record; it holds the variances of all earlier records.
    settings : AnalysisSettings
        Settings of the analysis, of which the limit and the freezing of the baseline are used.
    units : mapping of str to str
        Units of the channels of the record to analyse, in which the histories must be.
    of : mapping of str to str
        Name of its ``gearbox`` and ``machine``, which the histories must be of, empty where unknown.
    recorded_at : str
        Time of the record, which must not be that of the histories; empty where unknown.

    Raises
    ------
    AnalysisError
        If `previous` is not an analysis, of another gearbox or machine, in other units or of the record itself, or
        there is no baseline to freeze.
    """
    limit = settings.baseline_limit_std
    if previous is None:
        if settings.freeze_baseline:
            raise AnalysisError(
                "freeze_baseline is set, but there is no baseline to freeze; pass baseline=, the analysis of the last "
                "record of the sound machine (on the command line --baseline analysis.h5)."
            )
        return Baseline(histories={}, limit_std=limit, freeze=False)
    check_analysis(previous)
    for name, now in of.items():
        if (was := str(previous.attrs[name])) and now and was != now:
            raise AnalysisError(f'baseline: it is of {name} "{was}", the record of "{now}"; give one of this machine.')
    if recorded_at and previous.attrs["recorded_at"] == recorded_at:
        raise AnalysisError(f"baseline: it is of the record itself, of {recorded_at}; give that of an earlier record.")
    channels = json.loads(previous.attrs["channels_json"])
    for channel in channels:
        now = units.get(channel["name"], channel["units"])
        if now != channel["units"]:
            raise AnalysisError(
                f'baseline: channel "{channel["name"]}" was in {channel["units"]} and is in {now} now; variances of '
                "other units are no baseline."
            )
    histories = {}
    for row in json.loads(group(previous, "indicators").attrs[HISTORIES]):
        key = (row.pop("channel"), row.pop("component"), row.pop("indicator"))
        history = VarianceHistory(**row)
        histories[key] = history if limit is None else replace(history, limit_std=limit)
    return Baseline(histories=histories, limit_std=limit, freeze=settings.freeze_baseline)


# ---- Condition indicators of a gear, from its synchronous average, residual and difference signal, and mesh band -----


SHAFT_ORDERS = (1, 2)  # removed from the residual signal together with the mesh
GAUSSIAN_KURTOSIS = 3.0
_OVER_NOISE = 4.0  # standard deviations of the kurtosis of noise, up to which it is not significant


@dataclass(frozen=True, kw_only=True)
class MonitoredComponent:
    """A component in one channel, for which indicators are computed."""

    channel: str
    units: str
    component: str
    kind: str

    def evaluate(
        self,
        name: str,
        takes: str,
        compute: Callable[[], Any],
        *,
        unit: str = "",
        source: str = "",
        noise_limit: float = math.nan,
    ) -> IndicatorValue:
        """Return the value of an indicator, or the message of the ValueError that withholds it."""
        known = INDICATORS.get(name)
        unit = unit or (known.unit if known else "1")
        value, withheld = math.nan, ""
        try:
            value = float(compute())
        except ValueError as error:
            withheld = str(error)
        if not withheld and not math.isfinite(value):
            value, withheld = math.nan, "it is not finite: its denominator is zero."
        return IndicatorValue(
            channel=self.channel,
            component=self.component,
            kind=self.kind,
            indicator=name,
            value=value,
            unit=self.units if unit == "signal" else unit,
            noise_limit=math.nan if withheld else noise_limit,
            takes=takes,
            source=source or (known.source if known else ""),
            withheld=withheld,
        )


def unavailable(reason: str) -> Callable[[], float]:
    """Return a function that raises ValueError with the given reason."""

    def refuse() -> float:
        raise ValueError(reason)

    return refuse


@dataclass(frozen=True, kw_only=True)
class Gear:
    """A gear on an averaged shaft: its teeth, those of all gears on the shaft, and the mesh harmonics used."""

    component: str
    teeth: int
    on_shaft: tuple[int, ...]
    harmonics: int

    @property
    def sidebands(self) -> int:
        """Number of sidebands of the first mesh harmonic, up to half-way to the nearest other mesh harmonic."""
        others = {harmonic * teeth for teeth in self.on_shaft for harmonic in range(1, 2 * self.teeth // teeth + 1)}
        nearest = min(abs(other - self.teeth) for other in others | {2 * self.teeth} if other != self.teeth)
        return max(1, (nearest - 1) // 2)

    def last_order(self, average: SynchronousAverage) -> int:
        """Return the highest order used: half a mesh order above the last harmonic, within the average's passband."""
        passed = min(average.passband_orders, (average.samples_per_rev - 1) // 2)
        return int(min((self.harmonics + 0.5) * self.teeth, passed))


def gear_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, baseline: Baseline
) -> list[IndicatorValue]:
    """Return all indicators of a gear, computed from the synchronous average of its shaft or of the gear itself."""
    of = f"of {average.revolutions} revolution{'s' if average.revolutions > 1 else ''}"
    return [
        *_average_indicators(monitored, average, gear, f"average {of}"),
        *_residual_indicators(monitored, average, gear, of, baseline),
        *_mesh_band_indicators(monitored, average, gear, of, baseline),
    ]


def _average_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, takes: str
) -> Iterator[IndicatorValue]:
    passed = max(1, min(gear.harmonics, int(average.passband_orders // gear.teeth)))
    yield monitored.evaluate("fm0", takes, partial(INDICATORS["fm0"], average, teeth=gear.teeth, harmonics=passed))
    for name in ("sideband_index", "sideband_level_factor"):
        yield monitored.evaluate(name, takes, partial(INDICATORS[name], average, teeth=gear.teeth))


def _residual_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, of: str, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of the residual and difference signals, without the meshes of all gears on the shaft.

    Up to order n these have 2 n independent values per revolution; the kurtosis of that many Gaussian values is 3 with
    a standard deviation of sqrt(24 / 2n). The noise limit is four of these above 3.
    """
    last = gear.last_order(average)
    cut: dict[str, Any] = {"teeth": gear.on_shaft, "harmonics": gear.harmonics, "shaft_orders": SHAFT_ORDERS}
    limit = GAUSSIAN_KURTOSIS + _OVER_NOISE * math.sqrt(24 / (2 * last)) if last else math.nan
    difference = cache(partial(difference_signal, average, max_order=last, **cut))
    for name in ("fm4", "m6a", "m8a"):
        yield monitored.evaluate(
            name,
            f"difference signal {of}, up to order {last}",
            lambda indicator=INDICATORS[name]: indicator(difference()),  # type: ignore[misc]
            noise_limit=limit if name == "fm4" else math.nan,
        )
    residual = cache(partial(residual_signal, average, max_order=last, **cut))
    takes = f"residual signal {of}, up to order {last}"
    yield monitored.evaluate("energy_operator", takes, lambda: INDICATORS["energy_operator"](residual()))
    yield _history_indicator(monitored, "na4", takes, residual, baseline)

    def energy_ratio() -> Any:  # noqa: ANN401
        left = difference_signal(average, **cut)
        return INDICATORS["energy_ratio"](left, regular_signal(average, left=left))

    yield monitored.evaluate("energy_ratio", f"difference and regular signal {of}", energy_ratio)


def _mesh_band_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, of: str, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of the modulation of the first mesh harmonic, the same one in every record."""
    sidebands = gear.sidebands
    takes = f"mesh order {gear.teeth} with {sidebands} sidebands {of}"
    band = cache(partial(mesh_band, average, mesh_order=gear.teeth, sidebands=sidebands))
    for name, indicator in INDICATORS.items():
        if indicator.takes == INDICATORS["nb4"].takes and not indicator.needs:
            yield monitored.evaluate(name, takes, lambda indicator=indicator: indicator(band()))  # type: ignore[misc]
    yield _history_indicator(monitored, "nb4", takes, band, baseline)


def _history_indicator(
    monitored: MonitoredComponent, name: str, takes: str, make: Callable[[], Any], baseline: Baseline
) -> IndicatorValue:
    """Return NA4 or NB4 with this record in its history of variances."""
    try:
        signal = make()
        history = baseline.update((monitored.channel, monitored.component, name), signal)
    except ValueError as error:
        return monitored.evaluate(name, takes, unavailable(str(error)))
    held = "frozen history" if history.frozen else "history"
    count = f"{history.records} record{'s' if history.records > 1 else ''}"
    return monitored.evaluate(name, f"{takes}; {held} of {count}", partial(INDICATORS[name], signal, history=history))


# ---- Indicators of planetary stages: from averages of each planet and of the sun, and from the carrier's sidebands ---
# They require a sensor on a fixed ring, which each planet passes once per revolution of the carrier. Where the signal
# has no such modulation, the indicators are withheld with the reason.


_WINDOW_TEETH = 5.0  # least width of the window around a planet pass


def planetary_indicators(segment: Segment, settings: AnalysisSettings, baseline: Baseline) -> Iterator[IndicatorValue]:
    """Yield the indicators of all planetary stages in one segment."""
    machine = segment.machine
    for stage in planetary_stages(machine.kinematics):
        of_carrier = MonitoredComponent(
            channel=segment.name, units=segment.units, component=stage.carrier, kind="planetary"
        )
        make = partial(synchronous_average, segment.signal, ratio=machine.order_of(stage.carrier))
        yield carrier_sideband_ratio(of_carrier, stage, make)
        yield from _planet_indicators(segment, stage, settings, baseline)


def carrier_sideband_ratio(
    monitored: MonitoredComponent, stage: PlanetaryStage, average: Callable[[], SynchronousAverage]
) -> IndicatorValue:
    """Return the ratio of the sidebands that evenly spaced planets cancel to the others."""
    teeth = stage.teeth

    def ratio() -> float:
        if stage.misfit:
            raise ValueError(stage.misfit)
        if any(place != Fraction(k, teeth.planets) for k, place in enumerate(teeth.positions_rev)):
            raise ValueError("unevenly spaced planets cancel no sideband, even in a healthy stage.")
        found = INDICATORS["carrier_sideband_ratio"](
            average(), ring_teeth=teeth.ring, planets=teeth.planets, harmonic=1, sidebands=teeth.planets
        )
        return float(found)

    takes = f"average over the carrier, mesh order {teeth.ring} with {teeth.planets} sidebands"
    return monitored.evaluate("carrier_sideband_ratio", takes, ratio)


def _planet_indicators(
    segment: Segment, stage: PlanetaryStage, settings: AnalysisSettings, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of each planet and of the sun, from averages windowed at the planet passes."""
    teeth, machine, when = stage.teeth, segment.machine, segment.when
    ratio = float(machine.order_of(stage.carrier))
    highest = PASSBAND / 2 * when.rate_hz / (machine.top_speed_hz * ratio)
    window = PassWindow.hann(max(_WINDOW_TEETH, 2.0 * math.gcd(teeth.ring, teeth.planet)))
    named = [f"{stage.ring_mesh}/{planet}" for planet in stage.planets]
    monitored_gears = [
        MonitoredComponent(channel=segment.name, units=segment.units, component=name, kind="gear")
        for name in (*named, f"{stage.sun_mesh}/{stage.sun}")
    ]
    try:
        if stage.misfit:
            raise ValueError(stage.misfit)  # noqa: TRY301
        last = min((settings.harmonics + 0.5) * teeth.ring, highest)
        phase = machine.phase.scaled(ratio)
        (signal,) = resample_in_angle([segment.values], when, segment.name, phase, last, multiple_of=teeth.ring)
        first = pass_angle(_mesh_band_signal(signal, teeth.ring), teeth=teeth).first_pass_rev
    except ValueError as error:
        for monitored in monitored_gears:
            yield monitored.evaluate("fm4", "average over the passes of the planets", unavailable(str(error)))
        return
    makers = [
        partial(planet_average, signal, teeth=teeth, planet=k, first_pass_rev=first, window=window)
        for k in range(teeth.planets)
    ]
    for monitored, make, count in zip(
        monitored_gears,
        (*makers, partial(sun_average, signal, teeth=teeth, first_pass_rev=first, window=window)),
        (*[teeth.planet] * teeth.planets, teeth.sun),
        strict=True,
    ):
        try:
            average = make()
        except ValueError as error:
            yield monitored.evaluate("fm4", "average over the passes of the planets", unavailable(str(error)))
            continue
        gear = Gear(component=monitored.component, teeth=count, on_shaft=(count,), harmonics=settings.harmonics)
        yield from gear_indicators(monitored, average, gear, baseline)


def _mesh_band_signal(signal: AngularSignal, ring: int) -> AngularSignal:
    """Return the signal band-passed around the first mesh harmonic, which the planet passes modulate."""
    lines = np.asarray(fft.rfft(signal.values - signal.values.mean()))
    order = np.arange(lines.size) * (signal.samples_per_rev / signal.values.size)
    lines[(order < 0.5 * ring) | (order > 1.5 * ring)] = 0
    return replace(signal, values=np.asarray(fft.irfft(lines, signal.values.size), dtype=np.float64))


# ---- Indicators ------------------------------------------------------------------------------------------------------


_SLOW_HZ = 10.0  # 600 rpm, below which ISO 20816 begins at 2 Hz
_BACKGROUND_WIDTH = 1.0  # orders on either side of a bearing line, for its background
_LEAST_KEPT = 0.75  # share of the revolutions that an average must keep when it is shortened to cancel other shafts
_INTEGRABLE = ("g", "m s-2", "mm s-2", "m s-1", "mm s-1")


def raw_indicators(segment: Segment) -> Iterator[IndicatorValue]:
    """Yield the indicators of the samples themselves and the velocity RMS; the RMS only if the sensor is faulty."""
    values, units, machine = segment.values, segment.units, segment.machine
    monitored = MonitoredComponent(channel=segment.name, units=units, component="record", kind="channel")
    for name in ("rms",) if segment.faulty else ("rms", "peak", "crest_factor", "kurtosis"):
        yield monitored.evaluate(name, "raw signal", partial(INDICATORS[name], values))
    if segment.faulty or units not in _INTEGRABLE or segment.parts_per_turn > 1:
        return
    band = ISO_20816_HZ if machine.mean_speed_hz >= _SLOW_HZ else ISO_20816_SLOW_HZ
    yield monitored.evaluate(
        "velocity_rms",
        f"velocity from {band[0]:g} to {band[1]:g} Hz",
        lambda: (
            velocity(
                values,
                rate_hz=segment.when.rate_hz,
                units=units,
                band_hz=band,
                transform=segment.transform,
                reduced=True,
            ).rms
        ),
        unit="mm s-1",
        source="ISO 20816-1",
    )


def averaged_indicators(segment: Segment, settings: AnalysisSettings, baseline: Baseline) -> list[IndicatorValue]:
    """Return the indicators computed from synchronous averages: of shafts, gears and planetary stages."""
    rows = [*_fixed_axis_indicators(segment, settings, baseline)]
    return [*rows, *planetary_indicators(segment, settings, baseline)]


def not_averaged(name: str, units: str, made: Sequence[IndicatorValue]) -> list[IndicatorValue]:
    """Return the other indicators of snapshots, withheld: revolutions of several snapshots cannot be averaged."""
    whole = MonitoredComponent(channel=name, units=units, component="record", kind="channel")
    why = "the angle from one snapshot to the next is not known, so that revolutions of several cannot be averaged."
    known = {row.indicator for row in made}
    return [
        whole.evaluate(name, "pooled snapshots", unavailable(why))
        for name, indicator in INDICATORS.items()
        if name not in known and indicator.part != "bearing"
    ]


def _fixed_axis_indicators(
    segment: Segment, settings: AnalysisSettings, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of all shafts on axes fixed in the frame, and of their gears."""
    for body, gears in gears_on_shafts(segment.machine).items():
        monitored = MonitoredComponent(channel=segment.name, units=segment.units, component=body, kind="shaft")
        try:
            average = shaft_average(segment, body)
        except ValueError as error:
            for name in ("so1", "so2", "so3"):
                yield monitored.evaluate(name, "average", unavailable(str(error)))
            continue
        takes = f"average of {average.revolutions} revolution{'s' if average.revolutions > 1 else ''}"
        for name in ("so1", "so2", "so3"):
            yield monitored.evaluate(name, takes, partial(INDICATORS[name], average))
        for component, teeth in gears.items():
            gear = Gear(component=component, teeth=teeth, on_shaft=tuple(gears.values()), harmonics=settings.harmonics)
            of_gear = MonitoredComponent(channel=segment.name, units=segment.units, component=component, kind="gear")
            yield from gear_indicators(of_gear, average, gear, baseline)


def shaft_average(segment: Segment, body: str) -> SynchronousAverage:
    """Return the synchronous average of a shaft, over a number of revolutions that cancels the shafts in mesh with it.

    An average over a multiple of b revolutions has nulls at all orders of a mate that turns a/b times as fast. Mates
    for which that would discard too many revolutions are not cancelled. It is computed once per segment.
    """
    if body in segment.averages:
        return segment.averages[body]
    machine = segment.machine
    ratio, kinematics = machine.order_of(body), machine.kinematics
    average = synchronous_average(segment.signal, ratio=ratio)
    mates = {
        (machine.order_of(link) / ratio).denominator
        for contact in kinematics.contacts
        if contact.carrier == kinematics.bodies[kinematics.gearbox.frame]
        and any(kinematics.bodies[link] == body for link, _ in contact.gears)
        for link, _ in contact.gears
    }
    every = 1
    for null in sorted(mates):
        both = math.lcm(every, null)
        if average.revolutions // both * both >= _LEAST_KEPT * average.revolutions:
            every = both
    count = average.revolutions // every * every
    if every > 1:
        average = synchronous_average(segment.signal, ratio=ratio, revolutions=count)
    segment.averages[body] = average
    return average


def gears_on_shafts(machine: Machine) -> dict[str, dict[str, int]]:
    """Return the teeth of each gear by its component name, by shaft, for shafts and meshes on fixed axes."""
    kinematics = machine.kinematics
    frame = kinematics.bodies[kinematics.gearbox.frame]
    found: dict[str, dict[str, int]] = {
        body: {} for body, joint in kinematics.joints.items() if joint.carried_by == frame and machine.order_of(body)
    }
    for contact in kinematics.contacts:
        for link, teeth in contact.gears if contact.carrier == frame else ():
            if kinematics.bodies[link] in found:
                found[kinematics.bodies[link]][f"{contact.mesh}/{link}"] = abs(teeth)
    return found


def bearing_indicators(
    name: str,
    units: str,
    evidence: Sequence[PartEvidence],
    band_hz: tuple[float, float],
    spectrum: AmplitudeSpectrum,
    machine: Machine,
    settings: AnalysisSettings,
) -> Iterator[IndicatorValue]:
    """Yield the modulation by each bearing defect over all bands, and the energy of its lines in the band shown.

    Energy is also given relative to the background. Verdicts are based on the modulation, which is given even if no
    line is significant.
    """
    for part in evidence:
        of_part = MonitoredComponent(channel=name, units=units, component=part.component, kind=part.kind)
        yield of_part.evaluate("modulation", "envelopes of all bands", partial(float, part.modulation))
    unit = f"({units})2" if " " in units else f"{units}2"
    for line in (row for row in machine.defect_orders if row.kind in BEARING_KINDS):
        monitored = MonitoredComponent(channel=name, units=units, component=line.component, kind=line.kind)
        slip = max(settings.slip, line.tolerance)
        count = max(1, min(settings.harmonics, int(spectrum.axis[-1] / (line.order * (1 + slip)))))
        energy: Callable[[], DefectEnergy] = cache(
            partial(
                INDICATORS["defect_energy"],
                spectrum,
                order=line.order,
                harmonics=count,
                tolerance=slip,
                background_width=_BACKGROUND_WIDTH + count * line.order * slip,
            )
        )
        takes = f"{count} line{'s' if count > 1 else ''} of the envelope, {band_hz[0]:.6g} to {band_hz[1]:.6g} Hz"
        yield monitored.evaluate(
            "defect_energy",
            takes,
            lambda energy=energy: energy().energy,  # type: ignore[misc]
            unit=unit,
        )
        yield monitored.evaluate(
            "defect_energy_ratio",
            f"{takes}, over its background",
            lambda energy=energy: energy().ratio,  # type: ignore[misc]
            source=INDICATORS["defect_energy"].source,
        )
