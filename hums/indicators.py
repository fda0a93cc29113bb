"""The condition indicators of a record: each part's, from the signals they were defined on.

Shafts and gears about fixed axes are read in the synchronous average of their shaft, whose ratio the teeth make exact;
residual and difference signal leave out the meshes of every gear on that shaft. Bearings are read in the envelope,
planetary stages in averages of their own (`hums.planetary`). Of a sick sensor all but the raw RMS are withheld.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import xarray as xr

from hums.baseline import Baseline
from hums.channels import AnalysedChannel, Values
from hums.findings import Locality
from hums.gears import GAUSSIAN_KURTOSIS, Gear, Part, gear_indicators, refusing, smooth_kurtosis
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
_SURROUNDINGS = 1.0  # orders beside a bearing's line
_SPARED = 0.75  # of the revolutions there are, that an average keeps to null other shafts
_INTEGRABLE = ("g", "m s-2", "mm s-2", "m s-1", "mm s-1")


def channel_indicators(
    record: xr.Dataset,
    channel: AnalysedChannel,
    values: Values,
    machine: Machine,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> list[IndicatorValue]:
    """Compute every indicator of one channel from its `values`; of a sick one the raw RMS alone."""
    rows = [*_raw(values, channel, machine)]
    if channel.sick:
        return rows
    rows += _fixed_axes(channel, machine, settings, baseline)
    rows += planetary_indicators(record, channel, values, machine, settings, baseline)
    rows += _bearings(channel, machine, settings)
    return rows


def localities(rows: Sequence[IndicatorValue], channel_of: Mapping[str, str], *, harmonics: int) -> dict[str, Locality]:
    """Return how local the disturbance of each gear in `channel_of` is: its FM4 in that channel.

    Noise on top of a mesh of so many harmonics that is modulated smoothly stays below the limit.
    """
    smooth = smooth_kurtosis(harmonics)
    return {
        row.component: Locality(kurtosis=row.value, limit=row.noise_limit + max(0.0, smooth - GAUSSIAN_KURTOSIS))
        for row in rows
        if row.indicator == "fm4" and not row.withheld and channel_of.get(row.component) == row.channel
    }


def _raw(values: Values, channel: AnalysedChannel, machine: Machine) -> Iterator[IndicatorValue]:
    part = Part(channel=channel.name, units=channel.units, component="record", kind="channel")
    for name in ("rms",) if channel.sick else ("rms", "peak", "crest_factor", "kurtosis"):
        yield part.row(name, "raw signal", partial(INDICATORS[name], values))
    if channel.sick or channel.units not in _INTEGRABLE:
        return
    band = ISO_20816_HZ if machine.mean_speed_hz >= _SLOW_HZ else ISO_20816_SLOW_HZ
    yield part.row(
        "velocity_rms",
        f"velocity from {band[0]:g} to {band[1]:g} Hz",
        lambda: velocity(values, rate_hz=channel.rate_hz, units=channel.units, band_hz=band).rms,
        unit="mm s-1",
        source="ISO 20816-1",
    )


def _fixed_axes(
    channel: AnalysedChannel, machine: Machine, settings: AnalysisSettings, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Compute those of all shafts that turn about an axis of the frame, and of their gears."""
    for body, gears in _gears_on_shafts(machine).items():
        part = Part(channel=channel.name, units=channel.units, component=body, kind="shaft")
        try:
            average = _average(channel, machine, body)
        except ValueError as error:
            for name in ("so1", "so2", "so3"):
                yield part.row(name, "average", refusing(str(error)))
            continue
        takes = f"average of {average.revolutions} revolution{'s' if average.revolutions > 1 else ''}"
        for name in ("so1", "so2", "so3"):
            yield part.row(name, takes, partial(INDICATORS[name], average))
        for component, teeth in gears.items():
            gear = Gear(component=component, teeth=teeth, on_shaft=tuple(gears.values()), harmonics=settings.harmonics)
            of_gear = Part(channel=channel.name, units=channel.units, component=component, kind="gear")
            yield from gear_indicators(of_gear, average, gear, baseline)


def _average(channel: AnalysedChannel, machine: Machine, body: str) -> SynchronousAverage:
    """Average over a shaft, if it costs little over so many revolutions that shafts in mesh with it cancel.

    A mate that turns a/b times as fast has all its orders in the nulls of an average over a multiple of b revolutions.
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
        if average.revolutions // both * both >= _SPARED * average.revolutions:
            every = both
    count = average.revolutions // every * every
    return average if every == 1 else synchronous_average(channel.signal, ratio=ratio, revolutions=count)


def _gears_on_shafts(machine: Machine) -> dict[str, dict[str, int]]:
    """Teeth by component, by the body they sit on, for all that turn about an axis of the frame and mesh there."""
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


def _bearings(channel: AnalysedChannel, machine: Machine, settings: AnalysisSettings) -> Iterator[IndicatorValue]:
    """Energy at the lines of every defect of every bearing, and its ratio to the background."""
    if channel.band is None:
        return
    spectrum, slip = channel.spectra[ENVELOPE], settings.slip
    unit = f"({channel.units})2" if " " in channel.units else f"{channel.units}2"
    for line in (row for row in machine.rows if row.kind in BEARING_KINDS):
        part = Part(channel=channel.name, units=channel.units, component=line.component, kind=line.kind)
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
        yield part.row("defect_energy", takes, _Attribute(energy, "energy"), unit=unit)
        source = INDICATORS["defect_energy"].source
        yield part.row(
            "defect_energy_ratio", f"{takes}, over its background", _Attribute(energy, "ratio"), source=source
        )


class _Attribute:
    """A computation, and what of its result is wanted."""

    def __init__(self, compute: "partial[DefectEnergy]", name: str) -> None:
        self.compute, self.name = compute, name

    def __call__(self) -> float:
        return float(getattr(self.compute(), self.name))
