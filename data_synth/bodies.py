"""Bodies and supports of a declared gearbox, with defaults for undeclared values; see `assembly`."""

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np

from data_synth.elements import Support, as_vector
from data_synth.layout import Contact
from data_synth.mechanics import Body, Vector
from data_synth.parts import Inertia, Parts, SupportStiffness
from hums.gearbox import Bearing

_STEEL_KG_M3 = 7850.0
_RIM_MODULES = 4.0
_MM = 1e-3
_PARALLEL = 1e-9


def bodies(parts: Parts) -> Iterator[Body]:
    """Yield every moving body with its given inertia, or that of steel discs, the pieces of a body in a row."""
    reference_speed = parts.reference_speed()
    for name in [*parts.kinematics.joints, *parts.elastic_links]:
        given = parts.inertias.get(name, Inertia())
        whole = _discs(parts, name)
        polar = whole[1] if given.inertia_kgm2 is None else given.inertia_kgm2
        if parts.torsion:
            polar += _carried(parts, name)
        if not polar > 0:
            raise ValueError(
                f'"{name}" has no gear and carries none, so no inertia follows from its teeth; give '
                f'inertias={{"{name}": Inertia(...)}}.'
            )
        frames = parts.frames(name)
        for frame in frames:
            share = _share(parts, name, frame)
            mass, tilt = whole[0] * share, whole[2] * share
            yield Body(
                name=parts.piece(name, frame),
                mass_kg=mass if given.mass_kg is None else given.mass_kg * share,
                inertia_kgm2=polar * share if len(frames) > 1 and frame != frames[0] else polar,
                tilt_inertia_kgm2=tilt if given.tilt_inertia_kgm2 is None else given.tilt_inertia_kgm2 * share,
                motions=parts.motions,
                centre_m=parts.centre(name, frame if len(frames) > 1 else None),
                axis=parts.axis(name),
                speed_ratio=0.0 if parts.torsion else _speed_ratio(parts, name, reference_speed),
                frame_ratio=parts.frame_ratio(frame),
                rotates_with=name if frame != frames[0] else None,
            )


def _speed_ratio(parts: Parts, name: str, reference_speed: Fraction) -> float:
    """Return the speed of a body about its axis relative to the frame, or for a tilted planet axis to the carrier."""
    joints = parts.kinematics.joints
    holder = joints[name].carried_by if name in joints else parts.frame
    if holder == parts.frame or abs(abs(float(np.dot(parts.axis(name), parts.axis(holder)))) - 1) < _PARALLEL:
        return float(parts.relative_speed(name, parts.frame) / reference_speed)
    return float(parts.relative_speed(name, holder) / reference_speed)


def _share(parts: Parts, body: str, frame: str) -> float:
    """Return the fraction of a body's mass in its piece in a frame: that of the discs there."""
    frames = parts.frames(body)
    if len(frames) == 1:
        return 1.0
    masses = [_discs(parts, body, each)[0] for each in frames]
    return masses[frames.index(frame)] / sum(masses) if all(masses) else 1 / len(frames)


def _discs(parts: Parts, body: str, frame: str | None = None) -> tuple[float, float, float]:
    """Return mass, polar and transverse moment of a body, or its piece: its gears, each once, and a carrier's disc."""
    discs: dict[tuple[float, float], tuple[float, float, float]] = {}
    for contact, number in parts.gears(body, frame):
        radius, width = contact.pair.reference_radii_m[number], contact.pair.face_width_m
        internal = number == 1 and contact.pair.teeth[1] < 0
        outer = radius + _RIM_MODULES * contact.pair.module_m if internal else radius
        discs[radius, width] = _disc(outer, radius if internal else 0.0, width)
    if frame in (None, body):
        for contact in parts.contacts:
            planet = _planet_of(parts, contact, body)
            if planet is not None:
                discs[0.0, 0.0] = _disc(_planet_radius(parts, contact, planet), 0.0, contact.pair.face_width_m)
    mass, polar, tilt = np.array([*discs.values(), (0.0, 0.0, 0.0)]).sum(axis=0).tolist()
    return mass, polar, tilt


def _disc(outer: float, inner: float, width: float) -> tuple[float, float, float]:
    mass = _STEEL_KG_M3 * math.pi * (outer**2 - inner**2) * width
    polar = mass * (outer**2 + inner**2) / 2
    return mass, polar, polar / 2 + mass * width**2 / 12


def _planet_of(parts: Parts, contact: Contact, carrier: str) -> str | None:
    """Return the body of a contact that is a planet of a carrier; None if neither is."""
    joints = parts.kinematics.joints
    held = [body for body in map(parts.body, contact.links) if body in joints and joints[body].carried_by == carrier]
    return held[0] if held and carrier != parts.frame else None


def _planet_radius(parts: Parts, contact: Contact, planet: str) -> float:
    """Return the distance of a planet's centre from its carrier's axis; for a bevel planet the radius of its mate."""
    mate = 1 - [parts.body(link) for link in contact.links].index(planet)
    return contact.pair.centre_distance_m if contact.parallel else contact.pair.reference_radii_m[mate]


def _carried(parts: Parts, carrier: str) -> float:
    """Return the inertia of planets about their carrier's axis, which torsion adds to the carrier."""
    planets: dict[str, float] = {}
    for contact in parts.contacts:
        planet = _planet_of(parts, contact, carrier)
        if planet is not None and contact.carrier == carrier and planet not in planets:
            mass, _, tilt = _discs(parts, planet)
            given = parts.inertias.get(planet, Inertia())
            mass = mass if given.mass_kg is None else given.mass_kg
            # the axis of a bevel planet is across the carrier's, so all of it rotates with the carrier
            radius = _planet_radius(parts, contact, planet)
            planets[planet] = mass * radius**2 + (0.0 if contact.parallel else tilt)
    return sum(planets.values())


# ---- supports ----------------------------------------------------------------------------------------------


def supports_of(parts: Parts) -> Iterator[Support]:
    """Yield the supports between each body and its carrier: its bearings, or one support in its centre.

    Further pieces of a body have a support of their own.
    """
    joints = parts.kinematics.joints
    for body in [*joints, *parts.elastic_links]:
        holder = joints[body].carried_by if body in joints else parts.frame
        first, *others = parts.frames(body)
        own = parts.piece(body, holder) if holder != parts.frame else body
        between = (own, None if holder == parts.frame else parts.piece(holder, holder))
        if parts.torsion:  # torsion has no other degree of freedom
            hold = parts.supports.get(body, SupportStiffness())
            yield Support(between=between, torsion=hold.torsion, damping_s=hold.damping_s)
            continue
        bearings = [] if body in parts.supports else list(_bearings_of(parts, body, holder))
        centre = parts.centre(body, first if others else None)
        if not bearings:
            yield _support(between, centre, parts.supports.get(body, SupportStiffness()), axial=True, tilt=True)
        apart = len({place for _, place, _ in bearings}) > 1
        for name, place, axial in bearings:
            yield _support(between, place, parts.supports.get(name, SupportStiffness()), axial=axial, tilt=not apart)
        for frame in others:
            piece = parts.piece(body, frame)
            hold = replace(parts.supports.get(body, SupportStiffness()), torsion=0.0)
            yield _support((piece, None), parts.centre(body, frame), hold, axial=True, tilt=True)


def _support(
    between: tuple[str, str | None], point: Vector, hold: SupportStiffness, *, axial: bool, tilt: bool
) -> Support:
    return Support(
        between=between,
        point_m=point,
        x=hold.radial,
        y=hold.radial,
        z=hold.axial if axial else 0.0,
        tilt_x=hold.tilt if tilt else 0.0,
        tilt_y=hold.tilt if tilt else 0.0,
        torsion=hold.torsion,
        damping_s=hold.damping_s,
    )


def _bearings_of(parts: Parts, body: str, holder: str) -> Iterator[tuple[str, Vector, bool]]:
    """Yield name, position and axial fixity of the bearings between a body and its carrier."""
    gearbox = parts.kinematics.gearbox

    def rings(bearing: Bearing) -> set[str]:
        links = (bearing.inner_ring, bearing.outer_ring)
        return {parts.kinematics.bodies[link] for ring in links for link in gearbox.instances(ring)}

    mine = [bearing for bearing in gearbox.bearings if {body, holder} <= rings(bearing)]
    any_axial = any(bearing.takes_axial for bearing in mine)
    for bearing in mine:
        for number, name in enumerate(bearing.names):
            place = parts.centre(body)
            if bearing.position_mm:
                along = _MM * bearing.position_mm[number] * np.array(parts.axis(body))
                place = as_vector(parts.axis_point(body, body) + along)
            yield name, place, name in bearing.takes_axial or not any_axial
