"""The meshes of a declared gearbox: which flanks touch, where, and in what step; see `assembly`."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from data_synth.elements import GearMesh, GeneralMesh, Place, as_vector, pressing
from data_synth.layout import Contact, planet_lag
from data_synth.mechanics import Array, Vector
from data_synth.mesh import Constant, Shifted, Stiffness
from data_synth.parts import MeshProperties, Parts
from data_synth.transmission_error import SumOfErrors, TransmissionError

_APART = 0.01  # of the centre distance: a drawing rounds, and a profile shift may be left out


def mesh_elements(parts: Parts) -> Iterator[GearMesh | GeneralMesh]:
    """Yield every contact, its pressed flank that of the gear that drives.

    In torsion the deflection is ``r_b / |Z| (Z_i (theta_i - theta_c) + Z_j (theta_j - theta_c))``, the constraint of
    the kinematics in metres along the line of action; else that of a line of action in space.
    """
    unit, driving = parts.unit(), drivers(parts)
    for contact in parts.contacts:
        given = parts.mesh(contact)
        rolls = parts.turns(contact.links[0], contact.carrier)
        pushes = rolls if driving[contact.name] == 0 else -rolls
        stiffness, error = _in_step(parts, contact, given)
        cycles = float(abs(contact.teeth[0] * rolls) / unit)
        if parts.torsion:
            yield GeneralMesh(
                name=contact.name,
                motions=_torsion_row(parts, contact, -1 if contact.teeth[0] * pushes < 0 else 1),
                stiffness=stiffness,
                error=error,
                backlash_m=given.backlash_m,
                damping=given.damping,
                cycles_per_rev=cycles,
            )
            continue
        direction, point = _line(parts, contact, pushes)
        yield GearMesh(
            name=contact.name,
            gears=(_moving(parts, contact, 0), _moving(parts, contact, 1)),
            direction=direction,
            point_m=point,
            stiffness=stiffness,
            error=error,
            backlash_m=given.backlash_m,
            damping=given.damping,
            cycles_per_rev=cycles,
        )


def drivers(parts: Parts) -> dict[str, int]:
    """Return which gear of each contact drives as its carrier sees it: the one that power reaches first.

    Power enters at the reference, or at the frame where the reference is a carrier without gears (a ring at rest then
    drives, as the carrier sees it), and passes from body to body; `MeshProperties.driver` overrides it.
    """
    found: dict[str, int] = {}
    body = parts.kinematics.bodies
    bodies = {contact.name: tuple(body[link] for link in contact.links) for contact in parts.contacts}
    geared = {body for pair in bodies.values() for body in pair}
    start = body[parts.kinematics.gearbox.reference or parts.frame]
    reached = [start, parts.frame] if start not in geared else [start]
    waiting = list(parts.contacts)
    while waiting:
        touched = [contact for contact in waiting if set(bodies[contact.name]) & set(reached)]
        if not touched:
            carriers = [each.carrier for each in parts.contacts if each.name in found and each.carrier != parts.frame]
            rest = [body for body in [*carriers, parts.frame, bodies[waiting[0].name][0]] if body not in reached]
            reached.append(rest[0])
            continue
        contact = min(touched, key=lambda item: min(_rank(reached, body) for body in bodies[item.name]))
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


def _in_step(parts: Parts, contact: Contact, given: MeshProperties) -> tuple[Stiffness, TransmissionError | None]:
    """Return stiffness and error as late as the planet of a contact stands behind the first one."""
    stiffness = given.stiffness or Constant(mean=contact.rolling.mean_stiffness())
    late = planet_lag(parts.kinematics, contact, speeds=parts.speeds)
    by = float(-late % stiffness.period)
    if by:
        stiffness = Shifted(of=stiffness, by_cycles=by)
    if given.error is None or not late:
        return stiffness, given.error
    return stiffness, SumOfErrors(parts=(given.error,), by_cycles=(float(-late % given.error.period),))


def _moving(parts: Parts, contact: Contact, gear: int) -> str | None:
    """Return the body of a gear, or its piece that turns with the contact's carrier; None for the frame."""
    body = parts.body(contact.links[gear])
    return None if body == parts.frame else parts.piece(body, contact.carrier)


def _torsion_row(parts: Parts, contact: Contact, sense: int) -> dict[Place, float]:
    """Return the deflection in rotations about the declared axes; a bevel planet's counts from its carrier."""
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
            along = 1 if parts.upright(link) * parts.upright(contact.carrier) >= 0 else -1
            place = (contact.carrier, "rotation")
            row[place] = row.get(place, 0.0) - along * metres * teeth
    return row


def _line(parts: Parts, contact: Contact, pushes: Fraction) -> tuple[Vector, Vector]:
    """Return direction and point of contact, the gear with teeth outside first."""
    along, away = _lie(parts, contact)
    mesh = next(mesh for mesh in parts.kinematics.gearbox.meshes if mesh.name == contact.mesh)
    turning = float(pushes) * (along @ np.array(parts.axis(contact.links[0])))
    direction = pressing(
        along=along,
        away=away,
        pressure_angle_rad=contact.pair.working_angle_rad,
        flank=-1 if turning < 0 else 1,
        base_helix_rad=contact.pair.base_helix_rad if "z" in parts.motions else 0.0,
        hand=mesh.hand,
    )
    if contact.cone is not None:
        return as_vector(direction), as_vector(parts.touches(contact))
    return as_vector(direction), as_vector(parts.foot(contact, 0) + contact.pair.working_radii_m[0] * away)


def _lie(parts: Parts, contact: Contact) -> tuple[Array, Array]:
    """Return unit vectors along the line where pitch surfaces touch, and across it out of the first gear."""
    one, two = (parts.station(parts.body(link), contact.carrier) for link in contact.links)
    axis = np.array(parts.axis(contact.links[0]))
    if contact.cone is not None:
        _check_apex(parts, contact, two - one)
        return parts.space @ np.array(contact.cone.element), parts.space @ contact.cone.away
    if not contact.parallel:
        raise ValueError(
            f'mesh "{contact.mesh}": where gears touch is known of axes that are parallel or meet; a kinematic '
            'scene does without, and so does motions = "torsion".'
        )
    across = two - one - ((two - one) @ axis) * axis
    apart, needed = float(np.linalg.norm(across)), contact.pair.centre_distance_m
    if abs(apart - needed) > _APART * needed:
        raise ValueError(
            f'mesh "{contact.mesh}": its axes stand {1e3 * apart:.5g} mm apart, but its teeth need '
            f"{1e3 * needed:.5g} mm; "
            "correct module_mm, profile_shift or through."
        )
    return axis, across / apart * (-1 if contact.pair.teeth[1] < 0 else 1)


def _check_apex(parts: Parts, contact: Contact, between: Array) -> None:
    """Refuse bevel gears whose axes pass each other."""
    assert contact.cone is not None  # noqa: S101 - of bevel gears
    normal = np.cross(parts.axis(contact.links[0]), parts.axis(contact.links[1]))
    apart = abs(float(between @ normal)) / float(np.linalg.norm(normal))
    if apart > _APART * contact.cone.distance_m(contact.pair):
        raise ValueError(
            f'mesh "{contact.mesh}": its axes pass each other {1e3 * apart:.5g} mm apart, but those of bevel gears '
            "meet; correct through."
        )
