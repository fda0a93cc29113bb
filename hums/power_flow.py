"""What flows where: the load of each contact, and the branches of power between the links.

References
----------
H. W. Mueller, Epicyclic Drive Trains, Wayne State University Press (1982): power relative to the carrier,
circulating power.
"""

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction

from hums.gearbox import Vector
from hums.loads import Branch, ToothLoad
from hums.statics import Solution, Statics
from hums.tooth_forces import tooth_forces

_ZERO = Fraction(0)


def tooth_load(solution: Solution, number: int) -> ToothLoad:
    """Describe the load of one contact."""
    statics, contact = solution.statics, solution.statics.contacts[number]
    load, flow, driver = solution.load(number), solution.flow(number), solution.driving(number)
    (link_one, teeth_one), (link_two, teeth_two) = contact.gears
    part_one, part_two = solution.parts(number)
    torques_nm = _float(_times(load, teeth_one * part_one)), _float(_times(load, teeth_two * part_two))
    loses = solution.drivers[number] is not None
    return ToothLoad(
        mesh=contact.mesh,
        gears=(link_one, link_two),
        carrier=contact.carrier,
        determinate=load is not None,
        torques_nm=torques_nm,
        carrier_torque_nm=reaction(zip(torques_nm, statics.directions(number), strict=True)),
        gearing_power_w=watts(flow),
        absolute_power_w=_absolute_power(solution, number),
        driver=None if driver is None else contact.gears[driver][0],
        loss_w=abs(watts(_times(flow, 1 - statics.efficiencies[number]))) if loses else 0.0,
        forces=tooth_forces(solution, number),
    )


def branches(solution: Solution) -> Iterator[Branch]:
    """Sum what the meshes put on each body that turns about an axis at rest."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for body, joint in kinematics.joints.items():
        if joint.carried_by != kinematics.mechanism.frame:
            continue
        for numbers in _places(statics, body):
            torque = _torque(solution, body, numbers)
            yield Branch(
                link=body,
                through=tuple(dict.fromkeys(statics.contacts[number].mesh for number in numbers)),
                torque_nm=_float(torque),
                power_w=watts(_times(torque, statics.rates[body])),
            )


def reaction(torques: Iterable[tuple[float, Vector]]) -> Vector:
    """Return minus the sum of torques about their directions."""
    x, y, z = 0.0, 0.0, 0.0
    for torque, direction in torques:
        x, y, z = x - torque * direction[0], y - torque * direction[1], z - torque * direction[2]
    return (x, y, z)


def watts(power: Fraction | None) -> float:
    """Turn N m times turns a second into W, and what is not known into NaN."""
    return 2 * math.pi * _float(power)


def _absolute_power(solution: Solution, number: int) -> float | None:
    """Power from the first to the second gear as the frame sees it, at a gear that turns about the carrier's axis."""
    statics, contact = solution.statics, solution.statics.contacts[number]
    joints, frame = statics.kinematics.joints, statics.kinematics.mechanism.frame
    if contact.carrier == frame:
        return watts(solution.flow(number))
    holder = joints[contact.carrier]
    if holder.carried_by != frame:
        return None
    for sign, (link, teeth), part in zip((-1, 1), contact.gears, solution.parts(number), strict=True):
        body = statics.kinematics.bodies[link]
        if body == frame or joints[body].axis == holder.axis:
            return watts(_times(solution.load(number), sign * teeth * part * statics.speed(link)))
    return None


def _torque(solution: Solution, body: str, numbers: Iterable[int]) -> Fraction | None:
    """Return the torque of some contacts on a body; None where one of their loads is indeterminate."""
    torque = _ZERO
    for number in numbers:
        factor = solution.row(number).get(body, _ZERO)  # zero of a mesh between planets on their carrier
        load = solution.load(number) if factor else _ZERO
        if load is None:
            return None
        torque += load * factor
    return torque


def _places(statics: Statics, body: str) -> list[list[int]]:
    """Contacts that act on a body, grouped: by mesh where it is a gear, by set of planets where it is a carrier."""
    bodies, joints = statics.kinematics.bodies, statics.kinematics.joints
    groups: list[tuple[set[str], list[int]]] = []
    for number, contact in enumerate(statics.contacts):
        gears = {bodies[link] for link, _ in contact.gears}
        if body not in (*gears, contact.carrier):
            continue
        marks, numbers = {f"mesh {contact.mesh}"}, [number]
        if body not in gears:
            marks |= {f"planet {gear}" for gear in gears if gear in joints and joints[gear].carried_by == body}
        for group in [group for group in groups if group[0] & marks]:
            groups.remove(group)
            marks, numbers = marks | group[0], group[1] + numbers
        groups.append((marks, numbers))
    return [numbers for _, numbers in groups]


def _times(a: Fraction | None, b: Fraction) -> Fraction | None:
    return None if a is None else a * b


def _float(value: Fraction | None) -> float:
    return math.nan if value is None else float(value)
