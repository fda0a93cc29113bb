"""Geometry of a declared gearbox: positions of its axes and its contacts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from data_synth.dynamics.elements import as_vector
from data_synth.dynamics.system import Array, Vector
from data_synth.gears.geometry import GearPair
from hums.gearbox.components import Mesh, planet_angles
from hums.gearbox.kinematics import Kinematics
from hums.gearbox.layout.shapes import corner, rotated
from hums.gearbox.model import Gearbox

# ---- Pitch cones of bevel gears: their line of contact and their virtual spur gears ----------------------------------


_MAX_TEETH = 2000  # of a virtual gear: that of a crown wheel would be a rack


@dataclass(frozen=True, kw_only=True)
class Cone:
    """The pitch cones of a bevel pair, which roll on each other along one line.

    Attributes
    ----------
    element : vector of 3
        Direction in space from the apex along the line of contact of the cones.
    axes : pair of vectors
        Directions of the gears' axes.
    internal : bool
        Whether one of them is an internal gear.
    """

    element: Vector
    axes: tuple[Vector, Vector]
    internal: bool

    @property
    def cosines(self) -> tuple[float, float]:
        """Cosines of the pitch angles, between each axis and the element."""
        one, two = (float(np.dot(self.element, axis)) for axis in self.axes)
        return one, two

    @property
    def sines(self) -> tuple[float, float]:
        """Sines of the pitch angles: pitch radii over the distance from the apex."""
        one, two = (math.sqrt(1 - cosine**2) for cosine in self.cosines)
        return one, two

    @property
    def away(self) -> Array:
        """Unit vector (3,) across the element, from the first gear, an external one, into the second."""
        cosine, sine = self.cosines[0], self.sines[0]
        outwards = (cosine * np.array(self.element) - np.array(self.axes[0])) / sine
        return np.asarray(outwards if cosine >= 0 else -outwards)

    def distance_m(self, middle: GearPair) -> float:
        """Return the mean cone distance in m, from the apex to mid-face."""
        return middle.reference_radii_m[0] / self.sines[0]

    def middle(self, outer: GearPair, mesh: str) -> GearPair:
        """Return the section at mid-face of a pair whose module is that at the outer end."""
        cone_distance_m = self.distance_m(outer)
        if not outer.face_width_m < cone_distance_m:
            raise ValueError(
                f'mesh "{mesh}": its face width, {1e3 * outer.face_width_m:.7g} mm, must be below its cone distance, '
                f"{1e3 * cone_distance_m:.7g} mm; correct face_width_mm or module_mm."
            )
        return replace(outer, module_m=outer.module_m * (1 - outer.face_width_m / 2 / cone_distance_m))

    def virtual_spur_gears(self, middle: GearPair) -> GearPair:
        """Return the virtual spur gears, of ``z / cos(delta)`` teeth rounded to integers (Tredgold; ISO 10300-1)."""
        one, two = (
            min(_MAX_TEETH, round(abs(teeth) / max(abs(cosine), 1 / _MAX_TEETH)))
            for teeth, cosine in zip(middle.teeth, self.cosines, strict=True)
        )
        return replace(middle, teeth=(one, -two if self.internal else two))


def cone_of(axes: tuple[Array, Array], teeth: tuple[int, int]) -> Cone:
    """Return the pitch cones of two gears on axes of given directions, with signs as in ``Z_i w_i + Z_j w_j = 0``.

    Relative rotation is about the element, which is therefore along ``Z_j a_i + Z_i a_j``; a gear with a negative
    number of teeth is on the negative side of the apex, or internal.
    """
    along = math.copysign(1.0, teeth[0] * teeth[1]) * (teeth[1] * axes[0] + teeth[0] * axes[1])
    element = along / np.linalg.norm(along)
    cosines = [float(element @ axis) for axis in axes]
    # both cones on one side of the element: one is inside the other
    inside = math.copysign(1.0, cosines[0] * cosines[1]) * (float(axes[0] @ axes[1]) - cosines[0] * cosines[1]) > 0
    return Cone(element=as_vector(element), axes=(as_vector(axes[0]), as_vector(axes[1])), internal=inside)


# ---- Placement -------------------------------------------------------------------------------------------------------


_PARALLEL = 1e-9
_MM = 1e-3
_FINE = 10_000  # largest denominator of an angle in degrees


@dataclass(frozen=True, kw_only=True)
class Contact:
    """One contact of the expanded gearbox, with the external gear first.

    Attributes
    ----------
    mesh, name : str
        Names of the mesh and of the contact; the latter includes the number of the planet.
    links, teeth : pairs
        The two gears; teeth signed as declared.
    carrier : str
        Body relative to which the contact is at rest.
    pair : GearPair
        Geometry; for bevel gears the section at mid-face.
    parallel : bool
        Whether the axes are parallel.
    swapped : bool
        Whether the gears are in reverse order of declaration.
    cone : Cone or None
        Pitch cones of bevel gears.
    """

    mesh: str
    name: str
    links: tuple[str, str]
    teeth: tuple[int, int]
    carrier: str
    pair: GearPair
    parallel: bool
    swapped: bool
    cone: Cone | None = None

    @property
    def equivalent_pair(self) -> GearPair:
        """The equivalent spur or helical pair; for a bevel pair its virtual spur gears."""
        return self.pair if self.cone is None else self.cone.virtual_spur_gears(self.pair)


def contacts_of(kinematics: Kinematics) -> tuple[Contact, ...]:
    """Return every contact with its geometry, as declared.

    Raises
    ------
    ValueError
        If a mesh has one gear only, or lacks module, face width or pressure angle.
    """
    declared = {mesh.name: mesh for mesh in kinematics.gearbox.meshes}
    number: dict[str, int] = {}
    copies = {name: sum(other.mesh == name for other in kinematics.contacts) for name in declared}
    found = []
    for contact in kinematics.contacts:
        if len(contact.gears) != 2:  # noqa: PLR2004
            raise ValueError(f'mesh "{contact.mesh}" has one gear only; declare the teeth of both.')
        number[contact.mesh] = number.get(contact.mesh, 0) + 1
        (one, ones), (two, twos) = contact.gears
        axes = direction_of(kinematics, one), direction_of(kinematics, two)
        along, parallel = float(axes[0] @ axes[1]), are_parallel(*axes)
        cone = None if parallel or declared[contact.mesh].kind else cone_of(axes, (ones, twos))
        internal = ones * twos * along < 0 if cone is None else cone.internal
        swapped = internal and abs(ones) > abs(twos)
        links, teeth = ((two, one), (twos, ones)) if swapped else ((one, two), (ones, twos))
        signed = (abs(teeth[0]), -abs(teeth[1]) if internal else abs(teeth[1]))
        if cone is not None and swapped:
            cone = replace(cone, axes=(cone.axes[1], cone.axes[0]))
        found.append(
            Contact(
                mesh=contact.mesh,
                name=f"{contact.mesh} {number[contact.mesh]}" if copies[contact.mesh] > 1 else contact.mesh,
                links=links,
                teeth=teeth,
                carrier=contact.carrier,
                pair=_pair(declared[contact.mesh], signed, cone, swapped=swapped),
                parallel=parallel,
                swapped=swapped,
                cone=cone,
            )
        )
    return tuple(found)


def _pair(mesh: Mesh, teeth: tuple[int, int], cone: Cone | None, *, swapped: bool) -> GearPair:
    """Return the geometry of a declared mesh in SI units; raise ValueError if a dimension is missing."""
    missing = [key for key in ("module_mm", "face_width_mm", "pressure_angle_deg") if getattr(mesh, key) is None]
    if missing:
        raise ValueError(
            f'mesh "{mesh.name}" declares no {" and no ".join(missing)}, needed for its radii and stiffness; declare '
            "it in the gearbox."
        )
    shift = mesh.profile_shift or (0.0, 0.0)
    pair = GearPair(
        teeth=teeth,
        module_m=_MM * (mesh.module_mm or 0.0),
        face_width_m=_MM * (mesh.face_width_mm or 0.0),
        pressure_angle_rad=math.radians(mesh.pressure_angle_deg or 0.0),
        helix_angle_rad=math.radians(abs(mesh.helix_angle_deg or 0.0)),
        profile_shift=(shift[1], shift[0]) if swapped else (shift[0], shift[1]),
    )
    return pair if cone is None else cone.middle(pair, mesh.name)


def direction_of(kinematics: Kinematics, link: str) -> Array:
    """Return the direction (3,) of a link's axis of rotation; for a gear on the frame, that of its mate's carrier.

    Copies of an axis that is not parallel to that of their carrier are spaced around it as declared.
    """
    directions, bodies = kinematics.mechanism.directions, kinematics.bodies
    joint = kinematics.joints.get(bodies[link])
    if joint is not None:
        drawn = np.array(directions[joint.axis])
        holder = kinematics.joints.get(joint.carried_by)
        if holder is None:
            return drawn
        return rotated(drawn, np.array(directions[holder.axis]), planet_angle(kinematics.gearbox, joint.axis))
    for contact in kinematics.contacts:
        shared = kinematics.mechanism.shared_axis(bodies[link], contact.carrier)
        if shared is not None and link in (gear for gear, _ in contact.gears):
            return np.array(directions[shared])
    return np.array(next(iter(directions.values())))


def transverse_axes(direction: Array) -> tuple[Array, Array]:
    """Return the x and y axes (3,) for a z axis; a cyclic permutation of x, y, z if `direction` is one of them."""
    away = np.roll(np.eye(3)[int(np.argmax(np.abs(direction)))], 1)
    first = away - (away @ direction) * direction
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def z_direction(kinematics: Kinematics) -> Array:
    """Return the z direction (3,) of the assembly: the first axis, or that of a carrier not parallel to it."""
    joints, frame = kinematics.joints, kinematics.mechanism.frame
    first = direction_of(kinematics, next(iter(joints)))
    for carrier in dict.fromkeys(joint.carried_by for joint in joints.values() if joint.carried_by != frame):
        axis = direction_of(kinematics, carrier)
        if not are_parallel(axis, first):
            return axis
    return first


def axis_points(kinematics: Kinematics, contacts: tuple[Contact, ...]) -> dict[str, Array]:
    """Return a point (3,) in m on each body's axis; the first body's is the origin unless declared.

    Points are as declared by ``through``. Otherwise planets are spaced around their carrier as declared, at the centre
    distance of their mesh; any other gear is placed beside one already placed, along x; axes of bevel gears intersect.
    """
    joints, frame = kinematics.joints, kinematics.mechanism.frame
    through = {
        name: np.array(axis.through) * _MM
        for axis in kinematics.gearbox.axes
        if axis.through is not None and axis.copies is None
        for name in axis.instances()
    }
    known = {body: through[joint.axis] for body, joint in joints.items() if joint.axis in through}
    known.setdefault(next(iter(joints)), np.zeros(3))
    coaxial = {
        (body, other)
        for members in kinematics.mechanism.levels.values()
        for body in members
        for other in members
        if frame not in (body, other) and joints[body].axis == joints[other].axis
    }
    for _ in range(len(joints)):
        for body, other in coaxial:
            if body in known:
                known.setdefault(other, known[body])
        for body in [each for each in joints if each not in known]:
            _place(kinematics, body, contacts, known)
    return known


def _place(kinematics: Kinematics, body: str, contacts: tuple[Contact, ...], known: dict[str, Array]) -> None:
    """Place a body at the centre distances from its mates already placed, or at the apex."""
    mates = [
        (contact, gear, known[mate])
        for contact in contacts
        for gear in (0, 1)
        if kinematics.bodies[contact.links[1 - gear]] == body
        and (mate := _axis_body(kinematics, kinematics.bodies[contact.links[gear]], contact.carrier)) in known
    ]
    for contact, gear, start in mates[:1]:
        axis = direction_of(kinematics, contact.links[gear])
        if not contact.parallel:
            known[body] = start + axial_position_m(kinematics, contact) * axis
            return
        for other, _, second in mates:
            distances = contact.pair.centre_distance_m, other.pair.centre_distance_m
            if other.parallel and (found := corner(start, second, axis, distances=distances)) is not None:
                known[body] = found
                return
        z = z_direction(kinematics)
        x, y = transverse_axes(z if are_parallel(axis, z) else axis)
        angle = planet_angle(kinematics.gearbox, kinematics.joints[body].axis)
        known[body] = start + contact.pair.centre_distance_m * (math.cos(angle) * x + math.sin(angle) * y)


def axial_position_m(kinematics: Kinematics, contact: Contact) -> float:
    """Return the position in m of a mesh along the axis of its first gear: its mid-face, or its apex."""
    mesh = next(mesh for mesh in kinematics.gearbox.meshes if mesh.name == contact.mesh)
    return _MM * (mesh.position_mm or 0.0)


def _axis_body(kinematics: Kinematics, body: str, carrier: str) -> str:
    """Return the contact's carrier for a gear on the frame that is coaxial with it; otherwise the body itself."""
    on_frame = body == kinematics.mechanism.frame != carrier
    coaxial = on_frame and kinematics.mechanism.shared_axis(body, carrier) is not None
    return carrier if coaxial else body


def are_parallel(one: Array, two: Array) -> bool:
    """Return whether two unit vectors (3,) are parallel or antiparallel."""
    return abs(abs(float(one @ two)) - 1) < _PARALLEL


def crossed_bodies(kinematics: Kinematics) -> tuple[str, str] | None:
    """Return the first body and another whose axis is not parallel to its own; None if all axes are parallel."""
    first, *others = kinematics.joints
    one = direction_of(kinematics, first)
    return next(((first, body) for body in others if not are_parallel(direction_of(kinematics, body), one)), None)


def planet_of(kinematics: Kinematics, contact: Contact) -> int | None:
    """Return which gear of a contact, 0 or 1, is a planet of its carrier; None if neither or both are."""
    carried = [_is_carried(kinematics, link, contact.carrier) for link in contact.links]
    return carried.index(True) if sum(carried) == 1 else None


def planet_phase_lag(
    kinematics: Kinematics, contact: Contact, *, speeds: Mapping[str, float] | None = None
) -> Fraction:
    """Return the phase lag of a contact behind that of the first planet, in mesh cycles.

    The central gear of Z teeth meshes with a planet at the angle psi ``Z psi / 2 pi`` cycles later than with the first
    planet if it rotates in the direction of psi relative to the carrier, and earlier otherwise. Two planets in mesh
    with each other have the lag of the mesh of one of them, with the same teeth, with a central gear; without such a
    mesh the lag is zero.
    """
    gears = _planet_and_central(kinematics, contact)
    if gears is None:
        return Fraction(0)
    planet, (central, teeth) = gears
    turn = planet_position(kinematics.gearbox, kinematics.joints[kinematics.bodies[planet]].axis)
    passes = kinematics.relative_speed(central, seen_from=contact.carrier, speeds=speeds)
    sense = passes * round(float(direction_of(kinematics, central) @ z_direction(kinematics)))
    return abs(teeth) * turn * (-1 if sense < 0 else 1)


def opposite_mesh_lead(first: Contact, second: Contact, planet: str, *, driven_by_first: bool) -> float:
    """Return the lead in mesh cycles of the second contact of a planet over the first, on its opposite side.

    Phase is zero where pairs enter. The gear that drives the planet touches the rear flanks of its teeth; the other
    touches the front flanks, one tooth thickness ahead. The pitch points are half the planet's circumference, Z / 2
    pitches, apart (Parker and Lin 2004, J. Mech. Des. 126, 525: the relative phase of sun and ring meshes).

    Parameters
    ----------
    first, second : Contact
        Contacts of the same teeth of the planet with gears coaxial with its carrier.
    planet : str
        Name of the planet's link.
    driven_by_first : bool
        Whether the first contact drives the planet.
    """
    gears = [contact.links.index(planet) for contact in (first, second)]
    pairs = [contact.equivalent_pair for contact in (first, second)]
    thickness = sum(pair.thickness_pitches(gear) for pair, gear in zip(pairs, gears, strict=True)) / 2
    later = abs(first.teeth[gears[0]]) / 2 - thickness
    return pairs[1].pitch_point_cycles - pairs[0].pitch_point_cycles - (later if driven_by_first else -later)


def _planet_and_central(kinematics: Kinematics, contact: Contact) -> tuple[str, tuple[str, int]] | None:
    """Return the planet of a contact and the central gear with its number of teeth; None if there are not both."""
    here = dict(zip(contact.links, contact.teeth, strict=True))
    number = planet_of(kinematics, contact)
    if number is not None:
        central = contact.links[1 - number]
        return contact.links[number], (central, here[central])
    for other in kinematics.contacts:
        gears = dict(other.gears)
        shared = [link for link, teeth in gears.items() if here.get(link) == teeth]
        centrals = [link for link in gears if not _is_carried(kinematics, link, contact.carrier)]
        if other.carrier == contact.carrier and len(shared) == len(centrals) == 1 and shared != centrals:
            return shared[0], (centrals[0], gears[centrals[0]])
    return None


def _is_carried(kinematics: Kinematics, link: str, carrier: str) -> bool:
    """Return whether a link is a planet of a carrier, which is not the frame."""
    joints, body = kinematics.joints, kinematics.bodies[link]
    return body in joints and joints[body].carried_by == carrier != kinematics.mechanism.frame


def planet_angle(gearbox: Gearbox, axis_name: str) -> float:
    """Return `planet_position` in rad."""
    return 2 * math.pi * float(planet_position(gearbox, axis_name))


def planet_position(gearbox: Gearbox, axis_name: str) -> Fraction:
    """Return the angle of a planet axis around its carrier, in rev from the first copy; 0 for a single one."""
    for axis in gearbox.axes:
        if axis.copies and axis_name in axis.instances():
            angles_deg = planet_angles(axis.copies, axis.spacing_deg)
            return Fraction(angles_deg[axis.instances().index(axis_name)]).limit_denominator(_FINE) / 360
    return Fraction(0)
