"""Planetary stages with a fixed ring, with the data that averages over single planets need."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from hums.gearbox.components import planet_angles
from hums.gearbox.kinematics import Kinematics
from signals.angle.planets import PlanetaryTeeth

_Meshes = dict[str, tuple[str, int, tuple[str, int]]]  # planet -> mesh, its teeth, and its mate with teeth


@dataclass(frozen=True, kw_only=True)
class PlanetaryStage:
    """A planetary stage with a fixed ring.

    Attributes
    ----------
    carrier, sun : str
        Links of the carrier and the sun.
    planets : tuple of str
        Links of the planets, in the order of their positions.
    ring_mesh, sun_mesh : str
        Meshes of the planets with ring and sun.
    teeth : PlanetaryTeeth
        Numbers of teeth, and positions of the planets.
    misfit : str
        Why the planets cannot be assembled at the declared positions; empty if they can.
    """

    carrier: str
    sun: str
    planets: tuple[str, ...]
    ring_mesh: str
    sun_mesh: str
    teeth: PlanetaryTeeth
    misfit: str = ""


def planetary_stages(kinematics: Kinematics) -> list[PlanetaryStage]:
    """Return the simple planetary stages of a gearbox: one sun, several identical planets, a fixed ring.

    Stages with stepped, meshing or bevel planets allow no averages over one planet and are omitted; so is a stage
    declared with one planet, since the number of planets is then unknown.

    Parameters
    ----------
    kinematics : Kinematics
        Result of `hums.solve_kinematics`.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.planetary_stages import planetary_stages
    >>> (stage,) = planetary_stages(hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99")))
    >>> stage.teeth.sun, stage.teeth.planet, stage.teeth.ring, stage.teeth.planets
    (27, 36, 99, 3)
    """
    frame = kinematics.bodies[kinematics.gearbox.frame]
    found = []
    for carrier, joint in kinematics.joints.items():
        if joint.carried_by != frame or not kinematics.relative_speed(carrier, seen_from=kinematics.gearbox.frame):
            continue
        rings: _Meshes = {}
        suns: _Meshes = {}
        for contact in kinematics.contacts:
            if contact.carrier != carrier or len(contact.gears) != 2:  # noqa: PLR2004
                continue
            planet = next((gear for gear in contact.gears if _carrier_of(kinematics, gear[0]) == carrier), None)
            mate = next((gear for gear in contact.gears if gear is not planet), None)
            if planet is None or mate is None:
                continue
            (rings if kinematics.bodies[mate[0]] == frame else suns)[planet[0]] = (contact.mesh, planet[1], mate)
        stage = _stage(kinematics, carrier, rings, suns)
        if stage is not None:
            found.append(stage)
    return found


def _stage(kinematics: Kinematics, carrier: str, rings: _Meshes, suns: _Meshes) -> PlanetaryStage | None:
    """Return the stage of a carrier from its ring and sun meshes; None unless it is a simple planetary stage."""
    if not rings or rings.keys() != suns.keys() or {len({*side.values()}) for side in (rings, suns)} != {1}:
        return None
    (ring_mesh, planet_teeth, ring), (sun_mesh, planet_again, sun) = (
        next(iter(side.values())) for side in (rings, suns)
    )
    planets = tuple(rings)
    if (
        planet_again != planet_teeth
        or len(planets) == 1
        or _carrier_of(kinematics, sun[0]) == carrier
        or not _parallel(kinematics, carrier, planets[0])
    ):
        return None
    ring_teeth, sun_teeth = abs(ring[1]), abs(sun[1])
    gearbox = kinematics.gearbox
    names = {planets[0], planets[0].rpartition(" ")[0]}  # of the first copy, and of all copies
    axis = next((axis for axis in gearbox.axes if axis.copies == len(planets) and names & set(axis.links)), None)
    spacing = planet_angles(len(planets), axis.spacing_deg if axis else None)
    fits = ring_teeth + sun_teeth  # assembly condition: positions are multiples of 1 / (ring + sun teeth)
    places = tuple(Fraction(round(angle / 360 * fits), fits) for angle in spacing)
    off = max(abs(angle - 360 * float(place)) for angle, place in zip(spacing, places, strict=True))
    unfit = (
        f"planets do not fit at the declared positions, which must be multiples of 1/{fits} of a revolution: one is "
        f"{off:.2g} degrees off. Give the true positions with spacing_deg."
    )
    try:
        teeth = PlanetaryTeeth(
            ring=ring_teeth, planet=abs(planet_teeth), sun=sun_teeth, planets=len(planets), positions_rev=places
        )
    except ValueError:
        return None
    fits_deg = 0.1  # our choice: drawings round positions to tenths of a degree
    return PlanetaryStage(
        carrier=carrier,
        sun=sun[0],
        planets=planets,
        ring_mesh=ring_mesh,
        sun_mesh=sun_mesh,
        teeth=teeth,
        misfit=unfit if off > fits_deg else "",
    )


def _parallel(kinematics: Kinematics, carrier: str, planet: str) -> bool:
    directions = kinematics.mechanism.directions
    one, other = (directions[kinematics.joints[kinematics.bodies[link]].axis] for link in (carrier, planet))
    return abs(float(np.dot(one, other))) > 1 - 1e-9  # of unit vectors


def _carrier_of(kinematics: Kinematics, link: str) -> str:
    joint = kinematics.joints.get(kinematics.bodies[link])
    return "" if joint is None else joint.carried_by
