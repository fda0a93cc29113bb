"""The meshes of a declared gearbox: which flanks touch, where, and in what step; see `assembly`."""

import math
from collections.abc import Iterator

from data_synth.elements import GearMesh, LinkedMesh, Place, line_of_action
from data_synth.layout import Contact, planet_turn
from data_synth.mesh import Constant, Shifted, Stiffness
from data_synth.parts import MeshProperties, Parts
from data_synth.transmission_error import SumOfErrors, TransmissionError

_APART = 0.01  # of the centre distance: a drawing rounds, and a profile shift may be left out


def mesh_elements(parts: Parts) -> Iterator[GearMesh | LinkedMesh]:
    """Yield every contact, its pressed flank that of the gear that drives.

    In torsion the deflection is ``r_b / |Z| (Z_i (theta_i - theta_c) + Z_j (theta_j - theta_c))``, the constraint of
    the kinematics in metres along the line of action; else that of a line of action in space.
    """
    unit, driving = parts.unit(), drivers(parts)
    for contact in parts.contacts:
        given = parts.meshes.get(contact.mesh, MeshProperties())
        rolls = parts.turns(contact.links[0], contact.carrier)
        pushes = rolls if driving[contact.name] == 0 else -rolls
        stiffness, error = _in_step(parts, contact, given)
        cycles = float(abs(contact.teeth[0] * rolls) / unit)
        if parts.torsion:
            yield LinkedMesh(
                name=contact.name,
                motions=_torsion_row(parts, contact, -1 if contact.teeth[0] * pushes < 0 else 1),
                stiffness=stiffness,
                error=error,
                backlash_m=given.backlash_m,
                damping=given.damping,
                cycles_per_rev=cycles,
            )
            continue
        flank = -1 if pushes * parts.upright(contact.links[0]) < 0 else 1
        direction, point = _line(parts, contact, flank)
        yield GearMesh(
            name=contact.name,
            gears=(_moving(parts, contact.links[0]), _moving(parts, contact.links[1])),
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
            carriers = [contact.carrier for contact in parts.contacts if contact.name in found]
            rest = [body for body in [*carriers, parts.frame, bodies[waiting[0].name][0]] if body not in reached]
            reached.append(rest[0])
            continue
        contact = min(touched, key=lambda item: min(_rank(reached, body) for body in bodies[item.name]))
        waiting.remove(contact)
        one, two = bodies[contact.name]
        found[contact.name] = 0 if _rank(reached, one) <= _rank(reached, two) else 1
        reached += [body for body in (one, two) if body not in reached and body != parts.frame]
    for contact in parts.contacts:
        named = parts.meshes.get(contact.mesh, MeshProperties()).driver
        if named is not None:
            instances = parts.kinematics.gearbox.instances(named)
            if not set(instances) & set(contact.links):
                raise ValueError(f'mesh "{contact.mesh}": driver = "{named}" is none of its gears.')
            found[contact.name] = 0 if contact.links[0] in instances else 1
    return found


def _rank(reached: list[str], body: str) -> int:
    return reached.index(body) if body in reached else len(reached)


def _in_step(parts: Parts, contact: Contact, given: MeshProperties) -> tuple[Stiffness, TransmissionError | None]:
    """Return stiffness and error as late as the planet of a contact stands behind the first one.

    The teeth of the central gear pass a planet at the angle psi by ``Z psi / 2 pi`` cycles later than the first, if
    they pass in the sense of psi as the carrier sees them, else earlier.
    """
    stiffness = given.stiffness or Constant(mean=contact.pair.mean_stiffness())
    joints, bodies = parts.kinematics.joints, [parts.kinematics.bodies[link] for link in contact.links]
    carried = [body in joints and joints[body].carried_by == contact.carrier != parts.frame for body in bodies]
    if carried not in ([True, False], [False, True]):
        return stiffness, given.error
    planet = carried.index(True)
    turn = planet_turn(parts.kinematics.gearbox, joints[bodies[planet]].axis)
    central = contact.links[1 - planet]
    passes = parts.turns(central, contact.carrier) * round(parts.upright(central) * parts.upright(contact.carrier))
    late = abs(contact.teeth[1 - planet]) * turn * (-1 if passes < 0 else 1)
    by = float(-late % stiffness.period)
    if by:
        stiffness = Shifted(of=stiffness, by_cycles=by)
    if given.error is None:
        return stiffness, None
    return stiffness, SumOfErrors(parts=(given.error,), by_cycles=(float(-late % given.error.period),))


def _moving(parts: Parts, link: str) -> str | None:
    """Return the body of a link; None for the frame."""
    body = parts.body(link)
    return None if body == parts.frame else body


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


def _line(parts: Parts, contact: Contact, flank: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return direction and point of contact, the gear with teeth outside first."""
    one, two = (_centre(parts, link, contact.carrier) for link in contact.links)
    apart, needed = math.dist(one, two), contact.pair.centre_distance_m
    if abs(apart - needed) > _APART * needed:
        raise ValueError(
            f'mesh "{contact.mesh}": its axes stand {1e3 * apart:.5g} mm apart, but its teeth need '
            f"{1e3 * needed:.5g} mm; "
            "correct module_mm, profile_shift or through."
        )
    internal = contact.pair.teeth[1] < 0
    towards = math.atan2(two[1] - one[1], two[0] - one[0]) + (math.pi if internal else 0.0)
    mesh = next(mesh for mesh in parts.kinematics.gearbox.meshes if mesh.name == contact.mesh)
    helix = contact.pair.base_helix_rad if "z" in parts.motions else 0.0
    return line_of_action(
        centre_m=(one[0], one[1], parts.height(contact)),
        pitch_radius_m=contact.pair.working_radii_m[0],
        towards_rad=towards,
        pressure_angle_rad=contact.pair.working_angle_rad,
        flank=flank,
        base_helix_rad=helix,
        hand=mesh.hand,
    )


def _centre(parts: Parts, link: str, carrier: str) -> tuple[float, float]:
    """Return where the axis of a gear stands; one of the frame stands on the axis of the contact's carrier."""
    body = parts.kinematics.bodies[link]
    known = parts.places.get(body if body != parts.frame else carrier)
    if known is None:
        raise ValueError(
            f'nothing says where the axis of "{link}" stands; give through = [x, y, z] for its axis in the gearbox.'
        )
    return known
