"""Inputs of the assembly of a gearbox, and the positions of its axes and gears; see `assembly`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from data_synth.dynamics.elements import BearingShaft, GearMesh, GeneralMesh, Place, as_vector, line_of_action_direction
from data_synth.dynamics.placement import (
    Contact,
    axial_position_m,
    direction_of,
    planet_phase_lag,
    transverse_axes,
    z_direction,
)
from data_synth.dynamics.system import Array, Vector
from data_synth.gears.friction import SlidingFriction
from data_synth.gears.mesh_stiffness import Constant, Shifted, Stiffness
from data_synth.gears.transmission_error import SumOfErrors, TransmissionError
from hums.gearbox.kinematics import Kinematics

_UPRIGHT = 1 - 1e-12


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Mass and moments of inertia of a link with everything on it; None: the default of `assemble`.

    Attributes
    ----------
    mass_kg : float or None
        Mass in kg.
    inertia_kgm2 : float or None
        Moment of inertia about the axis in kg m2.
    tilt_inertia_kgm2 : float or None
        Moment of inertia about a diameter in kg m2.

    Examples
    --------
    Give the inertia of a shaft with its gear to replace that of a steel disc:

    >>> import hums
    >>> from data_synth.dynamics import Inertia, assemble
    >>> inertias = {"pinion": Inertia(inertia_kgm2=0.02), "gear": Inertia(inertia_kgm2=0.15)}
    >>> assemble(hums.load_gearbox("wijianto-pair"), motions="torsion", inertias=inertias).system.mass.tolist()
    [[0.02, 0.0], [0.0, 0.15]]
    """

    mass_kg: float | None = None
    inertia_kgm2: float | None = None
    tilt_inertia_kgm2: float | None = None


@dataclass(frozen=True, kw_only=True)
class SupportStiffness:
    """Stiffness of a bearing, or of a link's support, relative to the link that carries its axis.

    Attributes
    ----------
    radial, axial : float
        N/m.
    tilt, torsion : float
        N m/rad, about transverse axes and about the axis.
    damping_s : float
        Damping over stiffness in s, the same for all directions.
    shaft : BearingShaft or None
        For a link: an elastic shaft on two bearings, each of stiffness `radial`; rigid if left out.

    Examples
    --------
    >>> import hums
    >>> from data_synth.dynamics import SupportStiffness, assemble
    >>> supports = {"pinion": SupportStiffness(radial=3e8)}
    >>> system = assemble(hums.load_gearbox("wijianto-pair"), motions="plane", supports=supports).system
    >>> system.stiffness.diagonal().tolist()  # of the pinion's x, y and rotation, then the gear's
    [300000000.0, 300000000.0, 0.0, 100000000.0, 100000000.0, 0.0]
    """

    radial: float = 1e8
    axial: float = 1e8
    tilt: float = 1e5
    torsion: float = 0.0
    damping_s: float = 0.0
    shaft: BearingShaft | None = None


@dataclass(frozen=True, kw_only=True)
class MeshProperties:
    """Stiffness, transmission error, backlash and friction of a mesh, the same for all planets.

    Attributes
    ----------
    stiffness : Stiffness or None
        Mesh stiffness as a function of mesh phase; the constant mean stiffness of ISO 6336-1 if left out.
    error : TransmissionError or None
        Transmission error as a function of mesh phase.
    backlash_m : float
        Half the backlash in m.
    damping : float
        N s/m along the line of action.
    friction_coefficient : float
        Coefficient of sliding friction between the flanks, for external gears on parallel axes.
    friction_cycles : float
        Mesh cycles since the last pair entered, at phase zero; for friction only.

    Examples
    --------
    >>> import hums
    >>> from data_synth.dynamics import MeshProperties, Rectangular, assemble
    >>> teeth = MeshProperties(stiffness=Rectangular(low=1e8, high=2e8, duty=0.5), backlash_m=50e-6)
    >>> system = assemble(hums.load_gearbox("wijianto-pair"), motions="torsion", meshes={"pinion-gear": teeth}).system
    >>> system.meshes[0].stiffness.mean, system.meshes[0].cycles_per_rev  # 36 teeth on the pinion
    (150000000.0, 36.0)
    """

    stiffness: Stiffness | None = None
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    damping: float = 0.0
    friction_coefficient: float = 0.0
    friction_cycles: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The inputs of `assemble`, and the positions of axes and gears.

    `elastic_links` are links of the frame that are bodies of their own; `axis_points` holds a point (3,) in m on the
    axis of each body (empty for torsion). Everything else is as given to `assemble`.
    """

    kinematics: Kinematics
    contacts: tuple[Contact, ...]
    motions: tuple[str, ...]
    inertias: Mapping[str, Inertia]
    supports: Mapping[str, SupportStiffness]
    meshes: Mapping[str, MeshProperties]
    elastic_links: tuple[str, ...]
    axis_points: Mapping[str, Array]
    speeds: Mapping[str, float] | None

    @property
    def frame(self) -> str:
        """The body at rest."""
        return self.kinematics.mechanism.frame

    @property
    def torsion(self) -> bool:
        """Whether rotation is the only motion of every body."""
        return self.motions == ("rotation",)

    def body(self, link: str) -> str:
        """Return the name of the body a link belongs to."""
        return link if link in self.elastic_links else self.kinematics.bodies[link]

    def mesh(self, contact: Contact) -> MeshProperties:
        """Return the properties given for a contact, or for its mesh, or the defaults."""
        return self.meshes.get(contact.name) or self.meshes.get(contact.mesh) or MeshProperties()

    def relative_speed(self, link: str, seen_from: str) -> Fraction:
        """Return the speed of a link about its axis relative to another link, in the unit of `speeds`."""
        return self.kinematics.relative_speed(link, seen_from=seen_from, speeds=self.speeds)

    def reference_speed(self) -> Fraction:
        """Return the magnitude of the speed of the reference, in the unit of `speeds`."""
        reference = self.kinematics.gearbox.reference
        if reference is None:
            raise ValueError(
                f'gearbox "{self.kinematics.gearbox.name}" declares no reference, so mesh cycles cannot be counted; '
                'add reference = "LINK".'
            )
        speed = abs(self.relative_speed(reference, self.frame))
        if not speed:
            raise ValueError(f'the reference "{reference}" is at rest at the given speeds; give others.')
        return speed

    # ---- positions ---------------------------------------------------------------------------------------

    @cached_property
    def space(self) -> Array:
        """Rows x, y and z of the assembly in the coordinates of the gearbox, (3, 3)."""
        z = z_direction(self.kinematics)
        return np.stack([*transverse_axes(z), z])

    def axis(self, link: str) -> Vector:
        """Return the direction of the axis a link is declared on, in x, y and z."""
        direction = self.space @ direction_of(self.kinematics, link)
        return (0.0, 0.0, math.copysign(1.0, direction[2])) if abs(direction[2]) > _UPRIGHT else as_vector(direction)

    def cosine_to_z(self, link: str) -> float:
        """Return the cosine between the axis a link is declared on and z."""
        return self.axis(link)[2]

    def axis_point(self, body: str, carrier: str) -> Array:
        """Return a point (3,) in m on a body's axis; for a gear on the frame, on the axis of its mesh's carrier."""
        point = self.axis_points.get(body if body != self.frame and body not in self.elastic_links else carrier)
        if point is None:
            raise ValueError(
                f'the position of the axis of "{body}" is unknown; add through = [x, y, z] to it in the gearbox.'
            )
        return np.asarray(self.space @ point)

    def gear_centre(self, contact: Contact, gear: int) -> Array:
        """Return the point (3,) in m on the axis of gear 0 or 1 nearest to the pitch point of a contact."""
        link = contact.links[gear]
        axis, start = np.array(self.axis(link)), self.axis_point(self.body(link), contact.carrier)
        return np.asarray(start + ((self.pitch_point(contact) - start) @ axis) * axis)

    def pitch_point(self, contact: Contact) -> Array:
        """Return a point (3,) in m at the axial position of a contact, on its first axis or a bevel's pitch line."""
        link = contact.links[1 if contact.swapped else 0]
        start = self.axis_point(self.body(link), contact.carrier)
        start = start + axial_position_m(self.kinematics, contact) * np.array(self.axis(link))
        if contact.cone is None:
            return np.asarray(start)
        return np.asarray(start + contact.cone.distance_m(contact.pair) * (self.space @ np.array(contact.cone.element)))

    def centre(self, body: str, frame: str | None = None) -> Vector:
        """Return the centre of a body, or of its piece in a frame: the mean of the centres of its gears."""
        if self.torsion:
            return 0.0, 0.0, 0.0
        centres = [self.gear_centre(contact, gear) for contact, gear in self.gears(body, frame)]
        return as_vector(np.mean(centres, axis=0) if centres else self.axis_point(body, body))

    def gears(self, body: str, frame: str | None = None) -> Iterator[tuple[Contact, int]]:
        """Yield the contacts of a body, of all frames or one, with the number of its gear."""
        for contact in self.contacts:
            for number, link in enumerate(contact.links):
                if self.body(link) == body and frame in (None, contact.carrier):
                    yield contact, number

    # ---- rotating coordinates ----------------------------------------------------------------------------

    def frames(self, body: str) -> tuple[str, ...]:
        """Return the links with which a body's coordinates rotate, the frame first; it has one piece for each.

        These are the carriers of its meshes, its own carrier, and itself if it carries planets.
        """
        if self.torsion:
            return (self.frame,)
        joints = self.kinematics.joints
        found = [contact.carrier for contact, _ in self.gears(body)]
        if body in joints and joints[body].carried_by != self.frame:
            found.append(joints[body].carried_by)
        if any(joint.carried_by == body for joint in joints.values()):
            found.append(body)
        found.sort(key=lambda name: name != self.frame)
        return tuple(dict.fromkeys(found)) or (self.frame,)

    def piece(self, body: str, frame: str) -> str:
        """Return the name of the piece of a body whose coordinates rotate with a carrier."""
        frames = self.frames(body)
        return body if frame == frames[0] or frame not in frames else f"{body} ({frame})"

    def frame_ratio(self, frame: str) -> float:
        """Return the speed of a carrier about z relative to that of the reference."""
        if frame == self.frame:
            return 0.0
        return float(self.relative_speed(frame, self.frame) / self.reference_speed()) * self.cosine_to_z(frame)


# ---- Meshes of a declared gearbox: flank in contact, line of action and phase; see `assembly` ------------------------


_TOLERANCE = 0.01  # of the centre distance: drawings round, and a profile shift may be left out


def mesh_elements(parts: Parts) -> Iterator[GearMesh | GeneralMesh]:
    """Yield the mesh of every contact on the flanks that transmit the power.

    In torsion the deflection is ``r_b / |Z| (Z_i (theta_i - theta_c) + Z_j (theta_j - theta_c))``, the kinematic
    constraint in metres along the line of action; otherwise it is that along a line of action in space.
    """
    reference_speed, driving = parts.reference_speed(), power_flow(parts.kinematics, parts.contacts)
    for contact in parts.contacts:
        given = parts.mesh(contact)
        speed = parts.relative_speed(contact.links[0], contact.carrier)
        driving_speed = speed if driving[contact.name] == 0 else -speed
        lag = planet_phase_lag(parts.kinematics, contact, speeds=parts.speeds)
        stiffness = given.stiffness or Constant(mean=contact.equivalent_pair.mean_stiffness())
        stiffness, error = delayed(stiffness, given.error, lag)
        friction = _friction(contact, given, driver=driving[contact.name], lag=float(lag))
        common: dict[str, Any] = {
            "name": contact.name,
            "stiffness": stiffness,
            "error": error,
            "backlash_m": given.backlash_m,
            "damping": given.damping,
            "cycles_per_rev": float(abs(contact.teeth[0] * speed) / reference_speed),
        }
        if parts.torsion:
            if friction is not None:
                raise ValueError(
                    f'mesh "{contact.mesh}": friction acts across the line of action, which motions = "torsion" lacks; '
                    'use "plane" or "space", or leave friction_coefficient out.'
                )
            sense = -1 if contact.teeth[0] * driving_speed < 0 else 1
            yield GeneralMesh(motions=_torsion_row(parts, contact, sense), **common)
            continue
        direction, point = _line_of_action(parts, contact, driving_speed)
        gears = _body_of(parts, contact, 0), _body_of(parts, contact, 1)
        if friction is not None and driving[contact.name] == 1:  # the driver first
            gears, direction = gears[::-1], (-direction[0], -direction[1], -direction[2])
        yield GearMesh(gears=gears, direction=direction, point_m=point, friction=friction, **common)


def _friction(contact: Contact, given: MeshProperties, *, driver: int, lag: float) -> SlidingFriction | None:
    """Return the sliding friction of a contact with its driver first, or None."""
    if not given.friction_coefficient:
        return None
    pair = contact.equivalent_pair
    if not contact.parallel or pair.teeth[1] < 0:
        raise ValueError(
            f'mesh "{contact.mesh}": friction_coefficient = {given.friction_coefficient:g}, but friction is modelled '
            "for external gears on parallel axes only; leave it out."
        )
    if driver == 1:
        pair = replace(pair, teeth=pair.teeth[::-1], profile_shift=pair.profile_shift[::-1])
    return SlidingFriction(
        gears=pair, coefficient=given.friction_coefficient, by_cycles=(given.friction_cycles - lag) % 1.0
    )


def power_flow(kinematics: Kinematics, contacts: Sequence[Contact]) -> dict[str, int]:
    """Return the number of the driving gear of each contact relative to its carrier: the first in the power flow.

    Power enters at the reference, or at the frame if the reference is a carrier without gears (a stationary ring then
    drives relative to the carrier), and passes from body to body.
    """
    found: dict[str, int] = {}
    body, frame = kinematics.bodies, kinematics.mechanism.frame
    bodies = {contact.name: tuple(body[link] for link in contact.links) for contact in contacts}
    geared = {body for pair in bodies.values() for body in pair}
    start = body[kinematics.gearbox.reference or frame]
    reached = [start, frame] if start not in geared else [start]
    waiting = list(contacts)
    while waiting:
        next_to = [contact for contact in waiting if set(bodies[contact.name]) & set(reached)]
        if not next_to:
            carriers = [each.carrier for each in contacts if each.name in found and each.carrier != frame]
            rest = [body for body in [*carriers, frame, bodies[waiting[0].name][0]] if body not in reached]
            reached.append(rest[0])
            continue
        contact = min(next_to, key=lambda item: min(_rank(reached, body) for body in bodies[item.name]))
        waiting.remove(contact)
        one, two = bodies[contact.name]
        found[contact.name] = 0 if _rank(reached, one) <= _rank(reached, two) else 1
        reached += [body for body in (one, two) if body not in reached and body != frame]
    return found


def _rank(reached: list[str], body: str) -> int:
    return reached.index(body) if body in reached else len(reached)


def delayed(
    stiffness: Stiffness, error: TransmissionError | None, lag: Fraction
) -> tuple[Stiffness, TransmissionError | None]:
    """Return stiffness and transmission error of a mesh, delayed by a lag in mesh cycles."""
    by = float(-lag % stiffness.period)
    if by:
        stiffness = Shifted(of=stiffness, by_cycles=by)
    if error is not None and lag:
        error = SumOfErrors(parts=(error,), by_cycles=float(-lag % error.period))
    return stiffness, error


def _body_of(parts: Parts, contact: Contact, gear: int) -> str | None:
    """Return the body of a gear, or its piece that rotates with the contact's carrier; None for the frame."""
    body = parts.body(contact.links[gear])
    return None if body == parts.frame else parts.piece(body, contact.carrier)


def _torsion_row(parts: Parts, contact: Contact, sense: int) -> dict[Place, float]:
    """Return the deflection per rotation about each declared axis, for a bevel planet relative to its carrier."""
    metres = sense * contact.pair.base_radii_m[0] / abs(contact.teeth[0])
    joints = parts.kinematics.joints
    row: dict[Place, float] = {}
    for link, teeth in zip(contact.links, contact.teeth, strict=True):
        body = parts.body(link)
        if body != parts.frame:
            row[body, "rotation"] = row.get((body, "rotation"), 0.0) + metres * teeth
        held = joints[body].carried_by if body in joints else parts.frame
        across = not contact.parallel and held == contact.carrier
        if contact.carrier != parts.frame and not across:
            along = 1 if parts.cosine_to_z(link) * parts.cosine_to_z(contact.carrier) >= 0 else -1
            place = (contact.carrier, "rotation")
            row[place] = row.get(place, 0.0) - along * metres * teeth
    return row


def _line_of_action(parts: Parts, contact: Contact, driving_speed: Fraction) -> tuple[Vector, Vector]:
    """Return direction of the line of action and pitch point, with the external gear first."""
    along, away = _pitch_line(parts, contact)
    mesh = next(mesh for mesh in parts.kinematics.gearbox.meshes if mesh.name == contact.mesh)
    speed = float(driving_speed) * (along @ np.array(parts.axis(contact.links[0])))
    direction = line_of_action_direction(
        along=along,
        away=away,
        pressure_angle_rad=contact.pair.working_angle_rad,
        flank=-1 if speed < 0 else 1,
        base_helix_rad=contact.pair.base_helix_rad if "z" in parts.motions else 0.0,
        hand=mesh.hand,
    )
    if contact.cone is not None:
        return as_vector(direction), as_vector(parts.pitch_point(contact))
    return as_vector(direction), as_vector(parts.gear_centre(contact, 0) + contact.pair.working_radii_m[0] * away)


def _pitch_line(parts: Parts, contact: Contact) -> tuple[Array, Array]:
    """Return unit vectors along the line of contact of the pitch surfaces and across it, out of the first gear."""
    one, two = (parts.axis_point(parts.body(link), contact.carrier) for link in contact.links)
    axis = np.array(parts.axis(contact.links[0]))
    if contact.cone is not None:
        _check_apex(parts, contact, two - one)
        return parts.space @ np.array(contact.cone.element), parts.space @ contact.cone.away
    if not contact.parallel:
        raise ValueError(
            f'mesh "{contact.mesh}": the line of action is modelled for parallel and intersecting axes only; use a '
            'kinematic scene, or motions = "torsion".'
        )
    across = two - one - ((two - one) @ axis) * axis
    distance_m, nominal_m = float(np.linalg.norm(across)), contact.pair.centre_distance_m
    if abs(distance_m - nominal_m) > _TOLERANCE * nominal_m:
        raise ValueError(
            f'mesh "{contact.mesh}": its axes are {1e3 * distance_m:.5g} mm apart, but its teeth need '
            f"{1e3 * nominal_m:.5g} mm; correct module_mm, profile_shift or through."
        )
    return axis, across / distance_m * (-1 if contact.pair.teeth[1] < 0 else 1)


def _check_apex(parts: Parts, contact: Contact, between: Array) -> None:
    """Raise ValueError for bevel gears whose axes do not intersect."""
    assert contact.cone is not None  # noqa: S101 - of bevel gears
    normal = np.cross(parts.axis(contact.links[0]), parts.axis(contact.links[1]))
    distance_m = abs(float(between @ normal)) / float(np.linalg.norm(normal))
    if distance_m > _TOLERANCE * contact.cone.distance_m(contact.pair):
        raise ValueError(
            f'mesh "{contact.mesh}": its axes pass each other at {1e3 * distance_m:.5g} mm, but those of bevel gears '
            "must intersect; correct through."
        )
