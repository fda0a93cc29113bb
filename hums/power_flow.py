"""Power flow: the load of each contact, and the branches of power between the links.

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
    """Return the load of one contact."""
    statics, contact = solution.statics, solution.statics.contacts[number]
    load, flow, driver = solution.load(number), solution.flow(number), solution.driving(number)
    (link_one, teeth_one), (link_two, teeth_two) = contact.gears
    factor_one, factor_two = solution.load_factors(number)
    torques_nm = _float(_times(load, teeth_one * factor_one)), _float(_times(load, teeth_two * factor_two))
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
    """Yield the torques of the meshes on each body whose axis is fixed in the frame, summed by branch."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for body, joint in kinematics.joints.items():
        if joint.carried_by != kinematics.mechanism.frame:
            continue
        for numbers in _contact_groups(statics, body):
            torque = _torque(solution, body, numbers)
            yield Branch(
                link=body,
                through=tuple(dict.fromkeys(statics.contacts[number].mesh for number in numbers)),
                torque_nm=_float(torque),
                power_w=watts(_times(torque, statics.rates[body])),
            )


def reaction(torques: Iterable[tuple[float, Vector]]) -> Vector:
    """Return minus the sum of torques, each about its direction, (3,)."""
    x, y, z = 0.0, 0.0, 0.0
    for torque, direction in torques:
        x, y, z = x - torque * direction[0], y - torque * direction[1], z - torque * direction[2]
    return (x, y, z)


def watts(power: Fraction | None) -> float:
    """Convert N m times turns a second to W, None to NaN."""
    return 2 * math.pi * _float(power)


def _absolute_power(solution: Solution, number: int) -> float | None:
    """Return the absolute power from the first to the second gear, at a gear that turns about the carrier's axis."""
    statics, contact = solution.statics, solution.statics.contacts[number]
    joints, frame = statics.kinematics.joints, statics.kinematics.mechanism.frame
    if contact.carrier == frame:
        return watts(solution.flow(number))
    carrier = joints[contact.carrier]
    if carrier.carried_by != frame:
        return None
    for sign, (link, teeth), factor in zip((-1, 1), contact.gears, solution.load_factors(number), strict=True):
        body = statics.kinematics.bodies[link]
        if body == frame or joints[body].axis == carrier.axis:
            return watts(_times(solution.load(number), sign * teeth * factor * statics.speed(link)))
    return None


def _torque(solution: Solution, body: str, numbers: Iterable[int]) -> Fraction | None:
    """Return the torque of some contacts on a body; None where one of their loads is indeterminate."""
    torque = _ZERO
    for number in numbers:
        factor = solution.generalized_torque(number).get(body, _ZERO)  # zero for the carrier of a mesh between planets
        load = solution.load(number) if factor else _ZERO
        if load is None:
            return None
        torque += load * factor
    return torque


def _contact_groups(statics: Statics, body: str) -> list[list[int]]:
    """Return the contacts that act on a body, grouped by mesh where it is a gear, by planet set where a carrier."""
    bodies, joints = statics.kinematics.bodies, statics.kinematics.joints
    groups: list[tuple[set[str], list[int]]] = []
    for number, contact in enumerate(statics.contacts):
        gears = {bodies[link] for link, _ in contact.gears}
        if body not in (*gears, contact.carrier):
            continue
        keys, numbers = {f"mesh {contact.mesh}"}, [number]
        if body not in gears:
            keys |= {f"planet {gear}" for gear in gears if gear in joints and joints[gear].carried_by == body}
        for group in [group for group in groups if group[0] & keys]:
            groups.remove(group)
            keys, numbers = keys | group[0], group[1] + numbers
        groups.append((keys, numbers))
    return [numbers for _, numbers in groups]


def _times(a: Fraction | None, b: Fraction) -> Fraction | None:
    return None if a is None else a * b


def _float(value: Fraction | None) -> float:
    return math.nan if value is None else float(value)
