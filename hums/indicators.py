"""Condition indicators of a channel: of the raw signal, shafts, gears, planetary stages and bearings.

Indicators of shafts and gears on fixed axes are computed from the synchronous average of their shaft, whose order is
exact; residual and difference signal exclude the meshes of every gear on that shaft. Those of bearings are computed
from the envelope spectrum, those of planetary stages in `hums.planetary`. A faulty sensor has the raw RMS only.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import xarray as xr

from hums.baseline import Baseline
from hums.channels import AnalysedChannel, Values
from hums.findings import Fm4
from hums.gears import (
    GAUSSIAN_KURTOSIS,
    Gear,
    MonitoredComponent,
    gear_indicators,
    modulated_mesh_kurtosis,
    unavailable,
)
from hums.layout import IndicatorValue
from hums.machine import Machine
from hums.orders import BEARING_KINDS
from hums.planetary import planetary_indicators
from hums.search import ENVELOPE
from hums.settings import AnalysisSettings
from signals.averaging import SynchronousAverage, synchronous_average
from signals.indicators import INDICATORS, DefectEnergy
from signals.integration import ISO_20816_HZ, ISO_20816_SLOW_HZ, velocity

_SLOW_HZ = 10.0  # 600 rpm, below which ISO 20816 begins at 2 Hz
_SURROUNDINGS = 1.0  # orders on either side of a bearing line, for its background
_LEAST_KEPT = 0.75  # share of the revolutions that an average must keep when it is shortened to cancel other shafts
_INTEGRABLE = ("g", "m s-2", "mm s-2", "m s-1", "mm s-1")


def channel_indicators(
    record: xr.Dataset,
    channel: AnalysedChannel,
    values: Values,
    machine: Machine,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> list[IndicatorValue]:
    """Return all indicators of one channel with samples `values`; the raw RMS only if its sensor is faulty."""
    rows = [*_raw_signal_indicators(values, channel, machine)]
    if channel.faulty:
        return rows
    rows += _fixed_axis_indicators(channel, machine, settings, baseline)
    rows += planetary_indicators(record, channel, values, machine, settings, baseline)
    rows += _bearing_indicators(channel, machine, settings)
    return rows


def fm4_by_gear(rows: Sequence[IndicatorValue], channel_of: Mapping[str, str], *, harmonics: int) -> dict[str, Fm4]:
    """Return FM4 of each gear in `channel_of`, in that channel, with its limit.

    The limit allows for noise and a smoothly modulated mesh of that number of harmonics.
    """
    smooth = modulated_mesh_kurtosis(harmonics)
    return {
        row.component: Fm4(kurtosis=row.value, limit=row.noise_limit + max(0.0, smooth - GAUSSIAN_KURTOSIS))
        for row in rows
        if row.indicator == "fm4" and not row.withheld and channel_of.get(row.component) == row.channel
    }


def _raw_signal_indicators(values: Values, channel: AnalysedChannel, machine: Machine) -> Iterator[IndicatorValue]:
    """Yield the indicators of the samples themselves and the velocity RMS."""
    monitored = MonitoredComponent(channel=channel.name, units=channel.units, component="record", kind="channel")
    for name in ("rms",) if channel.faulty else ("rms", "peak", "crest_factor", "kurtosis"):
        yield monitored.evaluate(name, "raw signal", partial(INDICATORS[name], values))
    if channel.faulty or channel.units not in _INTEGRABLE:
        return
    band = ISO_20816_HZ if machine.mean_speed_hz >= _SLOW_HZ else ISO_20816_SLOW_HZ
    yield monitored.evaluate(
        "velocity_rms",
        f"velocity from {band[0]:g} to {band[1]:g} Hz",
        lambda: velocity(values, rate_hz=channel.rate_hz, units=channel.units, band_hz=band).rms,
        unit="mm s-1",
        source="ISO 20816-1",
    )


def _fixed_axis_indicators(
    channel: AnalysedChannel, machine: Machine, settings: AnalysisSettings, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of all shafts on axes fixed in the frame, and of their gears."""
    for body, gears in _gears_on_shafts(machine).items():
        monitored = MonitoredComponent(channel=channel.name, units=channel.units, component=body, kind="shaft")
        try:
            average = _average(channel, machine, body)
        except ValueError as error:
            for name in ("so1", "so2", "so3"):
                yield monitored.evaluate(name, "average", unavailable(str(error)))
            continue
        takes = f"average of {average.revolutions} revolution{'s' if average.revolutions > 1 else ''}"
        for name in ("so1", "so2", "so3"):
            yield monitored.evaluate(name, takes, partial(INDICATORS[name], average))
        for component, teeth in gears.items():
            gear = Gear(component=component, teeth=teeth, on_shaft=tuple(gears.values()), harmonics=settings.harmonics)
            of_gear = MonitoredComponent(channel=channel.name, units=channel.units, component=component, kind="gear")
            yield from gear_indicators(of_gear, average, gear, baseline)


def _average(channel: AnalysedChannel, machine: Machine, body: str) -> SynchronousAverage:
    """Return the synchronous average of a shaft, over a number of revolutions that cancels the shafts in mesh with it.

    An average over a multiple of b revolutions has nulls at all orders of a mate that turns a/b times as fast. Mates
    for which that would discard too many revolutions are not cancelled.
    """
    ratio, kinematics = machine.order_of(body), machine.kinematics
    average = synchronous_average(channel.signal, ratio=ratio)
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
    return average if every == 1 else synchronous_average(channel.signal, ratio=ratio, revolutions=count)


def _gears_on_shafts(machine: Machine) -> dict[str, dict[str, int]]:
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


def _bearing_indicators(
    channel: AnalysedChannel, machine: Machine, settings: AnalysisSettings
) -> Iterator[IndicatorValue]:
    """Yield the envelope energy at the lines of each bearing defect, and its ratio to the background."""
    if channel.band is None:
        return
    spectrum, slip = channel.spectra[ENVELOPE], settings.slip
    unit = f"({channel.units})2" if " " in channel.units else f"{channel.units}2"
    for line in (row for row in machine.defect_orders if row.kind in BEARING_KINDS):
        monitored = MonitoredComponent(
            channel=channel.name, units=channel.units, component=line.component, kind=line.kind
        )
        count = max(1, min(settings.harmonics, int(spectrum.axis[-1] / (line.order * (1 + slip)))))
        energy: partial[DefectEnergy] = partial(
            INDICATORS["defect_energy"],
            spectrum,
            order=line.order,
            harmonics=count,
            tolerance=slip,
            surroundings=_SURROUNDINGS + count * line.order * slip,
        )
        takes = (
            f"{count} line{'s' if count > 1 else ''} of the envelope, "
            f"{channel.band.low_hz:.6g} to {channel.band.high_hz:.6g} Hz"
        )
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
