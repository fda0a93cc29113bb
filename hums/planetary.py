"""Indicators of planetary stages: from averages of each planet and of the sun, and from the carrier's sidebands.

They require a sensor on a fixed ring, which each planet passes once per revolution of the carrier. Where the signal has
no such modulation, the indicators are withheld with the reason.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np
import xarray as xr
from scipy import fft

from hums._planets import planet_angles
from hums.baseline import Baseline
from hums.channels import AnalysedChannel, Values, resample_in_angle
from hums.gears import Gear, MonitoredComponent, gear_indicators, unavailable
from hums.layout import IndicatorValue
from hums.machine import Machine
from hums.settings import AnalysisSettings
from signals.averaging import synchronous_average
from signals.indicators import INDICATORS
from signals.planet_averaging import planet_average, sun_average
from signals.planet_passes import PassWindow, PlanetaryTeeth, pass_angle
from signals.resampling import PASSBAND, AngularSignal

_FEWEST = 2
_FITS_DEG = 0.1
_WINDOW_TEETH = 5.0  # least width of the window around a planet pass


_Meshes = dict[str, tuple[str, int, tuple[str, int]]]  # planet -> mesh, its teeth, and its mate with teeth


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A planetary stage with a fixed ring: links, meshes, teeth, and the error of the planet positions if any."""

    carrier: str
    sun: str
    planets: tuple[str, ...]
    ring_mesh: str
    sun_mesh: str
    teeth: PlanetaryTeeth
    misfit: str = ""


def stages(machine: Machine) -> list[Stage]:
    """Return the simple planetary stages of a gearbox: one sun, several equal planets, a fixed ring.

    Stages with stepped, meshing or bevel planets have no such averages and are left out; so is a stage declared with
    one planet, since the number of planets is then unknown.
    """
    kinematics = machine.kinematics
    frame = kinematics.bodies[kinematics.gearbox.frame]
    found = []
    for carrier, joint in kinematics.joints.items():
        if joint.carried_by != frame or not machine.order_of(carrier):
            continue
        rings: _Meshes = {}
        suns: _Meshes = {}
        for contact in kinematics.contacts:
            if contact.carrier != carrier or len(contact.gears) != 2:  # noqa: PLR2004
                continue
            planet = next((gear for gear in contact.gears if _carrier_of(machine, gear[0]) == carrier), None)
            mate = next((gear for gear in contact.gears if gear is not planet), None)
            if planet is None or mate is None:
                continue
            (rings if kinematics.bodies[mate[0]] == frame else suns)[planet[0]] = (contact.mesh, planet[1], mate)
        stage = _stage(machine, carrier, rings, suns)
        if stage is not None:
            found.append(stage)
    return found


def _stage(machine: Machine, carrier: str, rings: _Meshes, suns: _Meshes) -> Stage | None:
    """Return the stage of a carrier from its ring and sun meshes, None unless it is a simple planetary one."""
    if not rings or rings.keys() != suns.keys() or {len({*side.values()}) for side in (rings, suns)} != {1}:
        return None
    (ring_mesh, planet_teeth, ring), (sun_mesh, planet_again, sun) = (
        next(iter(side.values())) for side in (rings, suns)
    )
    planets = tuple(rings)
    if (
        planet_again != planet_teeth
        or len(planets) < _FEWEST
        or _carrier_of(machine, sun[0]) == carrier
        or not _parallel(machine, carrier, planets[0])
    ):
        return None
    ring_teeth, sun_teeth = abs(ring[1]), abs(sun[1])
    gearbox = machine.kinematics.gearbox
    names = {planets[0], planets[0].rpartition(" ")[0]}  # of the first copy, and of all copies
    axis = next((axis for axis in gearbox.axes if axis.copies == len(planets) and names & set(axis.links)), None)
    spacing = planet_angles(len(planets), axis.spacing_deg if axis else None)
    fits = ring_teeth + sun_teeth  # assembly condition: positions are multiples of 1 / (ring + sun teeth)
    places = tuple(Fraction(round(angle / 360 * fits), fits) for angle in spacing)
    off = max(abs(angle - 360 * float(place)) for angle, place in zip(spacing, places, strict=True))
    unfit = (
        f"planets do not fit where they are drawn: their places must be multiples of 1/{fits} of a turn, and one is "
        f"{off:.2g} degrees off. Give the true ones with spacing_deg."
    )
    try:
        teeth = PlanetaryTeeth(
            ring=ring_teeth, planet=abs(planet_teeth), sun=sun_teeth, planets=len(planets), positions_rev=places
        )
    except ValueError:
        return None
    return Stage(
        carrier=carrier,
        sun=sun[0],
        planets=planets,
        ring_mesh=ring_mesh,
        sun_mesh=sun_mesh,
        teeth=teeth,
        misfit=unfit if off > _FITS_DEG else "",
    )


def _parallel(machine: Machine, carrier: str, planet: str) -> bool:
    """Whether the axis of a planet is parallel to that of its carrier."""
    kinematics = machine.kinematics
    directions = kinematics.mechanism.directions
    one, other = (directions[kinematics.joints[kinematics.bodies[link]].axis] for link in (carrier, planet))
    return abs(float(np.dot(one, other))) > 1 - 1e-9  # of unit vectors


def _carrier_of(machine: Machine, link: str) -> str:
    kinematics = machine.kinematics
    joint = kinematics.joints.get(kinematics.bodies[link])
    return "" if joint is None else joint.carried_by


def planetary_indicators(
    record: xr.Dataset,
    channel: AnalysedChannel,
    values: Values,
    machine: Machine,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> Iterator[IndicatorValue]:
    """Yield the indicators of all planetary stages in one channel."""
    for stage in stages(machine):
        yield _carrier_sidebands(channel, machine, stage)
        yield from _planet_indicators(record, channel, values, machine, stage, settings, baseline)


def _carrier_sidebands(channel: AnalysedChannel, machine: Machine, stage: Stage) -> IndicatorValue:
    """Return the ratio of the sidebands that evenly spaced planets cancel to those they do not."""
    monitored = MonitoredComponent(channel=channel.name, units=channel.units, component=stage.carrier, kind="planetary")
    teeth = stage.teeth

    def ratio() -> float:
        if stage.misfit:
            raise ValueError(stage.misfit)
        if any(place != Fraction(k, teeth.planets) for k, place in enumerate(teeth.positions_rev)):
            raise ValueError("planets that are not evenly spaced leave every sideband, also in health.")
        average = synchronous_average(channel.signal, ratio=machine.order_of(stage.carrier))
        found = INDICATORS["carrier_sideband_ratio"](
            average, ring_teeth=teeth.ring, planets=teeth.planets, harmonic=1, sidebands=teeth.planets
        )
        return float(found)

    takes = f"average over the carrier, mesh order {teeth.ring} with {teeth.planets} sidebands"
    return monitored.evaluate("carrier_sideband_ratio", takes, ratio)


def _planet_indicators(
    record: xr.Dataset,
    channel: AnalysedChannel,
    values: Values,
    machine: Machine,
    stage: Stage,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> Iterator[IndicatorValue]:
    """Yield the indicators of each planet and of the sun, from averages windowed at the planet passes."""
    teeth = stage.teeth
    ratio = float(machine.order_of(stage.carrier))
    highest = PASSBAND / 2 * channel.rate_hz / (machine.top_speed_hz * ratio)
    window = PassWindow.hann(max(_WINDOW_TEETH, 2.0 * math.gcd(teeth.ring, teeth.planet)))
    named = [f"{stage.ring_mesh}/{planet}" for planet in stage.planets]
    monitored_gears = [
        MonitoredComponent(channel=channel.name, units=channel.units, component=name, kind="gear")
        for name in (*named, f"{stage.sun_mesh}/{stage.sun}")
    ]
    try:
        if stage.misfit:
            raise ValueError(stage.misfit)  # noqa: TRY301
        last = min((settings.harmonics + 0.5) * teeth.ring, highest)
        signal = resample_in_angle(
            values, record, channel.name, machine.phase.scaled(ratio), last, multiple_of=teeth.ring
        )
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
