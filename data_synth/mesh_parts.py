"""Meshes of a declared gearbox: flank in contact, line of action and phase; see `assembly`."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from data_synth.elements import GearMesh, GeneralMesh, Place, as_vector, line_of_action_direction
from data_synth.layout import Contact, planet_phase_lag
from data_synth.mechanics import Array, Vector
from data_synth.mesh import Constant, Shifted, Stiffness
from data_synth.parts import MeshProperties, Parts
from data_synth.transmission_error import SumOfErrors, TransmissionError

_TOLERANCE = 0.01  # of the centre distance: a drawing rounds, and a profile shift may be left out


def mesh_elements(parts: Parts) -> Iterator[GearMesh | GeneralMesh]:
    """Yield the mesh of every contact, with the flank on which its driving gear drives.

    In torsion the deflection is ``r_b / |Z| (Z_i (theta_i - theta_c) + Z_j (theta_j - theta_c))``, the constraint of
    the kinematics in metres along the line of action; else that of a line of action in space.
    """
    reference_speed, driving = parts.reference_speed(), drivers(parts)
    for contact in parts.contacts:
        given = parts.mesh(contact)
        speed = parts.relative_speed(contact.links[0], contact.carrier)
        driving_speed = speed if driving[contact.name] == 0 else -speed
        stiffness, error = _with_planet_phase(parts, contact, given)
        cycles = float(abs(contact.teeth[0] * speed) / reference_speed)
        if parts.torsion:
            yield GeneralMesh(
                name=contact.name,
                motions=_torsion_row(parts, contact, -1 if contact.teeth[0] * driving_speed < 0 else 1),
                stiffness=stiffness,
                error=error,
                backlash_m=given.backlash_m,
                damping=given.damping,
                cycles_per_rev=cycles,
            )
            continue
        direction, point = _line_of_action(parts, contact, driving_speed)
        yield GearMesh(
            name=contact.name,
            gears=(_body_of(parts, contact, 0), _body_of(parts, contact, 1)),
            direction=direction,
            point_m=point,
            stiffness=stiffness,
            error=error,
            backlash_m=given.backlash_m,
            damping=given.damping,
            cycles_per_rev=cycles,
        )


def drivers(parts: Parts) -> dict[str, int]:
    """Return the number of the driving gear of each contact, relative to its carrier: the first in the flow of power.

    Power enters at the reference, or at the frame where the reference is a carrier without gears (a ring at rest then
    drives, relative to the carrier), and passes from body to body; `MeshProperties.driver` overrides it.
    """
    found: dict[str, int] = {}
    body = parts.kinematics.bodies
    bodies = {contact.name: tuple(body[link] for link in contact.links) for contact in parts.contacts}
    geared = {body for pair in bodies.values() for body in pair}
    start = body[parts.kinematics.gearbox.reference or parts.frame]
    reached = [start, parts.frame] if start not in geared else [start]
    waiting = list(parts.contacts)
    while waiting:
        next_to = [contact for contact in waiting if set(bodies[contact.name]) & set(reached)]
        if not next_to:
            carriers = [each.carrier for each in parts.contacts if each.name in found and each.carrier != parts.frame]
            rest = [body for body in [*carriers, parts.frame, bodies[waiting[0].name][0]] if body not in reached]
            reached.append(rest[0])
            continue
        contact = min(next_to, key=lambda item: min(_rank(reached, body) for body in bodies[item.name]))
        waiting.remove(contact)
        one, two = bodies[contact.name]
        found[contact.name] = 0 if _rank(reached, one) <= _rank(reached, two) else 1
        reached += [body for body in (one, two) if body not in reached and body != parts.frame]
    for contact in parts.contacts:
        named = parts.mesh(contact).driver
        if named is not None:
            instances = parts.kinematics.gearbox.instances(named)
            if not set(instances) & set(contact.links):
                raise ValueError(f'mesh "{contact.mesh}": driver = "{named}" is none of its gears.')
            found[contact.name] = 0 if contact.links[0] in instances else 1
    return found


def _rank(reached: list[str], body: str) -> int:
    return reached.index(body) if body in reached else len(reached)


def _with_planet_phase(
    parts: Parts, contact: Contact, given: MeshProperties
) -> tuple[Stiffness, TransmissionError | None]:
    """Return stiffness and transmission error, delayed by the phase of the contact's planet."""
    stiffness = given.stiffness or Constant(mean=contact.equivalent_pair.mean_stiffness())
    lag = planet_phase_lag(parts.kinematics, contact, speeds=parts.speeds)
    by = float(-lag % stiffness.period)
    if by:
        stiffness = Shifted(of=stiffness, by_cycles=by)
    if given.error is None or not lag:
        return stiffness, given.error
    return stiffness, SumOfErrors(parts=(given.error,), by_cycles=(float(-lag % given.error.period),))


def _body_of(parts: Parts, contact: Contact, gear: int) -> str | None:
    """Return the body of a gear, or its piece that rotates with the contact's carrier; None for the frame."""
    body = parts.body(contact.links[gear])
    return None if body == parts.frame else parts.piece(body, contact.carrier)


def _torsion_row(parts: Parts, contact: Contact, sense: int) -> dict[Place, float]:
    """Return the deflection per rotation about each declared axis; a bevel planet's is relative to its carrier."""
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
    """Return direction of the line of action and pitch point, for the external gear first."""
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
    """Return unit vectors along the line of contact of the pitch surfaces, and across it out of the first gear."""
    one, two = (parts.axis_point(parts.body(link), contact.carrier) for link in contact.links)
    axis = np.array(parts.axis(contact.links[0]))
    if contact.cone is not None:
        _check_apex(parts, contact, two - one)
        return parts.space @ np.array(contact.cone.element), parts.space @ contact.cone.away
    if not contact.parallel:
        raise ValueError(
            f'mesh "{contact.mesh}": the line of action is known for parallel and intersecting axes only; use a '
            'kinematic scene, or motions = "torsion".'
        )
    across = two - one - ((two - one) @ axis) * axis
    distance_m, nominal_m = float(np.linalg.norm(across)), contact.pair.centre_distance_m
    if abs(distance_m - nominal_m) > _TOLERANCE * nominal_m:
        raise ValueError(
            f'mesh "{contact.mesh}": its axes stand {1e3 * distance_m:.5g} mm apart, but its teeth need '
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
            f'mesh "{contact.mesh}": its axes pass each other {1e3 * distance_m:.5g} mm apart, but those of bevel '
            "gears meet; correct through."
        )
