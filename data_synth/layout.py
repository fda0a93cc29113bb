"""Where the axes and teeth of a declared gearbox stand: the geometry of its contacts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from data_synth.gear_geometry import GearPair
from data_synth.mechanics import Array
from hums.gearbox import Gearbox, Mesh
from hums.kinematics import Kinematics

_PARALLEL = 1e-9
_MM = 1e-3
_FINE = 10_000  # parts of a degree


@dataclass(frozen=True, kw_only=True)
class Contact:
    """One contact of the expanded gearbox, the gear with teeth outside first.

    Attributes
    ----------
    mesh : str
        Name of the mesh; that of the contact adds the number of the planet.
    name : str
    links, teeth : pairs
        Teeth signed as declared.
    carrier : str
        Body in which the contact rests.
    pair : GearPair
    parallel : bool
        Whether the axes are.
    swapped : bool
        Whether the gears stand here in the other order than declared.
    """

    mesh: str
    name: str
    links: tuple[str, str]
    teeth: tuple[int, int]
    carrier: str
    pair: GearPair
    parallel: bool
    swapped: bool


def contacts_of(kinematics: Kinematics, geometries: Mapping[str, GearPair]) -> tuple[Contact, ...]:
    """Return every contact with its geometry, from `geometries` by the name of the mesh or as declared.

    Raises
    ------
    ValueError
        A mesh of one gear, or one whose module, face width or pressure angle is not declared.
    """
    declared = {mesh.name: mesh for mesh in kinematics.gearbox.meshes}
    number: dict[str, int] = {}
    copies = {name: sum(other.mesh == name for other in kinematics.contacts) for name in declared}
    found = []
    for contact in kinematics.contacts:
        if len(contact.gears) != 2:  # noqa: PLR2004
            raise ValueError(f'mesh "{contact.mesh}" has one gear; a mesh with a stiffness needs both of them.')
        number[contact.mesh] = number.get(contact.mesh, 0) + 1
        (one, ones), (two, twos) = contact.gears
        along = float(np.dot(*(direction_of(kinematics, link) for link in (one, two))))
        parallel = abs(abs(along) - 1) < _PARALLEL
        internal = parallel and ones * twos * along < 0
        swapped = internal and abs(ones) > abs(twos)
        links, teeth = ((two, one), (twos, ones)) if swapped else ((one, two), (ones, twos))
        signed = (abs(teeth[0]), -abs(teeth[1]) if internal else abs(teeth[1]))
        found.append(
            Contact(
                mesh=contact.mesh,
                name=f"{contact.mesh} {number[contact.mesh]}" if copies[contact.mesh] > 1 else contact.mesh,
                links=links,
                teeth=teeth,
                carrier=contact.carrier,
                pair=geometries.get(contact.mesh) or _pair(declared[contact.mesh], signed, swapped=swapped),
                parallel=parallel,
                swapped=swapped,
            )
        )
    return tuple(found)


def _pair(mesh: Mesh, teeth: tuple[int, int], *, swapped: bool) -> GearPair:
    missing = [key for key in ("module_mm", "face_width_mm", "pressure_angle_deg") if getattr(mesh, key) is None]
    if missing:
        raise ValueError(
            f'mesh "{mesh.name}" declares no {" and no ".join(missing)}, without which it has neither radii nor '
            "stiffness; declare it in the gearbox, or give MeshProperties(geometry=GearPair(...))."
        )
    shift = mesh.profile_shift or (0.0, 0.0)
    return GearPair(
        teeth=teeth,
        module_m=_MM * (mesh.module_mm or 0.0),
        face_width_m=_MM * (mesh.face_width_mm or 0.0),
        pressure_angle_rad=math.radians(mesh.pressure_angle_deg or 0.0),
        helix_angle_rad=math.radians(abs(mesh.helix_angle_deg or 0.0)),
        profile_shift=(shift[1], shift[0]) if swapped else (shift[0], shift[1]),
    )


def direction_of(kinematics: Kinematics, link: str) -> Array:
    """Return the direction of the axis a link turns about, (3,); for a gear of the frame that of its mate's carrier."""
    directions, bodies = kinematics.mechanism.directions, kinematics.bodies
    joint = kinematics.joints.get(bodies[link])
    if joint is not None:
        return np.array(directions[joint.axis])
    for contact in kinematics.contacts:
        shared = kinematics.mechanism.shared_axis(bodies[link], contact.carrier)
        if shared is not None and link in (gear for gear, _ in contact.gears):
            return np.array(directions[shared])
    return np.array(next(iter(directions.values())))


def across(direction: Array) -> tuple[Array, Array]:
    """Return x and y of a frame whose z is `direction`: the next two directions of space where it is one of them."""
    away = np.roll(np.eye(3)[int(np.argmax(np.abs(direction)))], 1)
    first = away - (away @ direction) * direction
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def stations(kinematics: Kinematics, contacts: tuple[Contact, ...]) -> dict[str, tuple[float, float]]:
    """Return where each body's axis passes through the plane across all axes, m; the frame's in the origin.

    A declared ``through`` says so. Else planets stand round their carrier as declared, at the centre distance of their
    mesh, and each other gear beside one that is known, along x.
    """
    frame = kinematics.mechanism.frame
    one, two = across(direction_of(kinematics, next(iter(kinematics.joints))))
    through = {
        name: np.array(axis.through) * _MM
        for axis in kinematics.gearbox.axes
        if axis.through is not None and axis.copies is None
        for name in axis.instances()
    }
    known = {
        body: (float(one @ through[joint.axis]), float(two @ through[joint.axis]))
        for body, joint in kinematics.joints.items()
        if joint.axis in through
    }
    first = next(iter(kinematics.joints))
    known.setdefault(first, (0.0, 0.0))
    coaxial = {
        (body, other)
        for members in kinematics.mechanism.levels.values()
        for body in members
        for other in members
        if frame not in (body, other) and kinematics.joints[body].axis == kinematics.joints[other].axis
    }
    for _ in range(len(kinematics.joints)):
        for body, other in coaxial:
            if body in known:
                known.setdefault(other, known[body])
        for contact in contacts:
            _place(kinematics, contact, known)
    return known


def _place(kinematics: Kinematics, contact: Contact, known: dict[str, tuple[float, float]]) -> None:
    """Put the gear of a contact that has no place yet beside the other one."""
    bodies = [kinematics.bodies[link] for link in contact.links]
    centres = [known.get(_axis_body(kinematics, body, contact.carrier)) for body in bodies]
    if None not in centres or centres == [None, None]:
        return
    here, there = (0, 1) if centres[0] is None else (1, 0)
    angle, start = _angle(kinematics, bodies[here]), centres[there] or (0.0, 0.0)
    distance = contact.pair.centre_distance_m
    known[bodies[here]] = (start[0] + distance * math.cos(angle), start[1] + distance * math.sin(angle))


def _axis_body(kinematics: Kinematics, body: str, carrier: str) -> str:
    """Return the body whose place a gear on the frame has: another one on the axis of the contact's carrier."""
    if body != kinematics.mechanism.frame:
        return body
    shared = kinematics.mechanism.shared_axis(body, carrier)
    return carrier if shared is not None and carrier != body else body


def _angle(kinematics: Kinematics, body: str) -> float:
    """Return the angle at which a planet stands, 0 for what is none."""
    return planet_angle(kinematics.gearbox, kinematics.joints[body].axis)


def planet_angle(gearbox: Gearbox, axis_name: str) -> float:
    """Return `planet_turn` in rad."""
    return 2 * math.pi * float(planet_turn(gearbox, axis_name))


def planet_turn(gearbox: Gearbox, axis_name: str) -> Fraction:
    """Return where one of several alike axes stands round its carrier, in turns from the first; 0 for a single one."""
    for axis in gearbox.axes:
        if axis.copies and axis_name in axis.instances():
            number = axis.instances().index(axis_name)
            given = axis.spacing_deg
            if given is None:
                return Fraction(number, axis.copies)
            # as the gearbox reads them: angles begin with 0, gaps do not
            degrees = given[number] if given[0] == 0 else sum(given[:number])
            return Fraction(degrees).limit_denominator(_FINE) / 360
    return Fraction(0)
