"""Indicators of planetary stages: averages of each planet and of the sun, and the carrier's sidebands.

They are heard by a sensor on a ring at rest, which each planet passes once a turn of the carrier. Where no sensor hears
that, the averages are withheld, and the sentence says so.
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
from hums.channels import AnalysedChannel, Values, over_angle
from hums.gears import Gear, Part, gear_indicators, refusing
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
_WINDOW_TEETH = 5.0  # at least, of the window about a pass


_Meshes = dict[str, tuple[str, int, tuple[str, int]]]  # planet -> mesh, its teeth, and its mate with teeth


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A planetary stage with its ring at rest: bodies and meshes by name, its teeth, and what the drawing has wrong."""

    carrier: str
    sun: str
    planets: tuple[str, ...]
    ring_mesh: str
    sun_mesh: str
    teeth: PlanetaryTeeth
    misfit: str = ""


def stages(machine: Machine) -> list[Stage]:
    """Return the simple planetary stages of a gearbox: one sun, several alike planets, a ring at rest.

    Stepped planets, those that mesh with each other and those of bevel stages have no such averages, and are left out;
    so is a stage drawn with one planet, which does not say how many there are.
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
            planet = next((gear for gear in contact.gears if _holder(machine, gear[0]) == carrier), None)
            mate = next((gear for gear in contact.gears if gear is not planet), None)
            if planet is None or mate is None:
                continue
            (rings if kinematics.bodies[mate[0]] == frame else suns)[planet[0]] = (contact.mesh, planet[1], mate)
        stage = _stage(machine, carrier, rings, suns)
        if stage is not None:
            found.append(stage)
    return found


def _stage(machine: Machine, carrier: str, rings: _Meshes, suns: _Meshes) -> Stage | None:
    if not rings or rings.keys() != suns.keys() or {len({*side.values()}) for side in (rings, suns)} != {1}:
        return None
    (ring_mesh, planet_teeth, ring), (sun_mesh, planet_again, sun) = (
        next(iter(side.values())) for side in (rings, suns)
    )
    planets = tuple(rings)
    if (
        planet_again != planet_teeth
        or len(planets) < _FEWEST
        or _holder(machine, sun[0]) == carrier
        or not _parallel(machine, carrier, planets[0])
    ):
        return None
    ring_teeth, sun_teeth = abs(ring[1]), abs(sun[1])
    gearbox = machine.kinematics.gearbox
    axis = next((axis for axis in gearbox.axes if axis.copies == len(planets) and _on(axis.links, planets[0])), None)
    spacing = planet_angles(len(planets), axis.spacing_deg if axis else None)
    fits = ring_teeth + sun_teeth  # planets can stand only where the teeth of both let them
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
    """Whether a planet turns about an axis parallel to its carrier's."""
    kinematics = machine.kinematics
    directions = kinematics.mechanism.directions
    one, other = (directions[kinematics.joints[kinematics.bodies[link]].axis] for link in (carrier, planet))
    return abs(float(np.dot(one, other))) > 1 - 1e-9  # of unit vectors


def _on(links: tuple[str, ...], planet: str) -> bool:
    return planet in links or planet.rpartition(" ")[0] in links


def _holder(machine: Machine, link: str) -> str:
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
    """Compute the indicators of all planetary stages in one channel."""
    for stage in stages(machine):
        yield _carrier(channel, machine, stage)
        yield from _averages(record, channel, values, machine, stage, settings, baseline)


def _carrier(channel: AnalysedChannel, machine: Machine, stage: Stage) -> IndicatorValue:
    part = Part(channel=channel.name, units=channel.units, component=stage.carrier, kind="planetary")
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
    return part.row("carrier_sideband_ratio", takes, ratio)


def _averages(
    record: xr.Dataset,
    channel: AnalysedChannel,
    values: Values,
    machine: Machine,
    stage: Stage,
    settings: AnalysisSettings,
    baseline: Baseline,
) -> Iterator[IndicatorValue]:
    """Compute the indicators of each planet and of the sun, pass by pass, if the sensor hears the planets pass."""
    teeth = stage.teeth
    ratio = float(machine.order_of(stage.carrier))
    reach = PASSBAND / 2 * channel.rate_hz / (machine.top_speed_hz * ratio)
    window = PassWindow.hann(max(_WINDOW_TEETH, 2.0 * math.gcd(teeth.ring, teeth.planet)))
    named = [f"{stage.ring_mesh}/{planet}" for planet in stage.planets]
    parts = [
        Part(channel=channel.name, units=channel.units, component=name, kind="gear")
        for name in (*named, f"{stage.sun_mesh}/{stage.sun}")
    ]
    try:
        if stage.misfit:
            raise ValueError(stage.misfit)  # noqa: TRY301
        last = min((settings.harmonics + 0.5) * teeth.ring, reach)
        signal = over_angle(values, record, channel.name, machine.phase.scaled(ratio), last, multiple_of=teeth.ring)
        first = pass_angle(_about_mesh(signal, teeth.ring), teeth=teeth).first_pass_rev
    except ValueError as error:
        for part in parts:
            yield part.row("fm4", "average over the passes of the planets", refusing(str(error)))
        return
    makers = [
        partial(planet_average, signal, teeth=teeth, planet=k, first_pass_rev=first, window=window)
        for k in range(teeth.planets)
    ]
    for part, make, count in zip(
        parts,
        (*makers, partial(sun_average, signal, teeth=teeth, first_pass_rev=first, window=window)),
        (*[teeth.planet] * teeth.planets, teeth.sun),
        strict=True,
    ):
        try:
            average = make()
        except ValueError as error:
            yield part.row("fm4", "average over the passes of the planets", refusing(str(error)))
            continue
        gear = Gear(component=part.component, teeth=count, on_shaft=(count,), harmonics=settings.harmonics)
        yield from gear_indicators(part, average, gear, baseline)


def _about_mesh(signal: AngularSignal, ring: int) -> AngularSignal:
    """Return the band of half a mesh on either side of the first mesh harmonic, where the planets' passing shows."""
    lines = np.asarray(fft.rfft(signal.values - signal.values.mean()))
    order = np.arange(lines.size) * (signal.samples_per_rev / signal.values.size)
    lines[(order < 0.5 * ring) | (order > 1.5 * ring)] = 0
    return replace(signal, values=np.asarray(fft.irfft(lines, signal.values.size), dtype=np.float64))
