"""Solve the static equilibrium of a mechanism: balance, load sharing, driving gears.

The loss of a mesh reduces the load of its driven gear. Which gear drives follows from the loads: the solution is
iterated until both agree.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import NoReturn

from hums._equations import add, determined, eliminate, solve
from hums._forms import Form, reduced
from hums.declared import count, quoted
from hums.loads import TorqueError
from hums.statics import Drivers, Solution, Statics, is_balanced, tooth_load_symbol

_ZERO = Fraction(0)
_ONE = Fraction(1)


def solve_equilibrium(statics: Statics) -> Solution:
    """Solve for torques and tooth loads, iterating until the driving gears are those that were assumed.

    Raises
    ------
    TorqueError
        Torques that do not balance or are indeterminate, copies that cannot share equally, losses that depend on an
        indeterminate load, losses so high that the mechanism is self-locking.
    """
    _check_balance(statics)
    sharing = _equal_sharing(statics)
    drivers = statics.lossless
    tried: list[Drivers] = []
    while drivers not in tried:
        tried.append(drivers)
        solved, residuals = solve([*statics.equations(drivers), *sharing])
        solution = Solution(statics, drivers, determined(solved))
        complete = all(link in solution.values for link, torque in statics.torques.items() if torque is None)
        if drivers != statics.lossless and not (complete and all(map(statics.is_zero, residuals))):
            raise TorqueError(
                f"{statics.name}: with the losses of its meshes the torques do not balance. Let as many links take "
                "the balance (None) as there are degrees of freedom, or raise mesh_efficiency."
            )
        drivers = solution.driving_gears()
        if drivers == solution.drivers:
            return solution
    undecided = [
        contact.mesh for contact, now, before in zip(statics.contacts, drivers, tried[-1], strict=True) if now != before
    ]
    raise TorqueError(
        f"{statics.name} locks itself: whichever gear is taken to drive, the losses of the meshes {quoted(undecided)} "
        "turn the flow of power round. Raise mesh_efficiency, or let power flow the other way."
    )


def _check_balance(statics: Statics) -> None:
    """Check that each degree of freedom is balanced without losses, and that the unknown torques are determinate.

    Degrees of freedom are those of the meshes alone: whatever else holds a link at rest does so by a torque, which has
    to be named.
    """
    kinematics = statics.kinematics
    meshes: dict[str, Form] = {}
    for number in range(len(statics.contacts)):
        eliminate(statics.generalized_torque(number), meshes, last=list(kinematics.joints))
    free = [body for body in kinematics.joints if body not in meshes]
    speeds = {link: reduced(kinematics.spin(link), meshes) for link in statics.torques}
    solved: dict[str, Form] = {}
    for body in free:
        form, scale = Form(), _ZERO
        for link, torque in statics.torques.items():
            factor = speeds[link].get(body, _ZERO)
            add(form, statics.external_term(link, factor))
            scale = max(scale, abs((torque or _ZERO) * factor))
        if not is_balanced(eliminate(form, solved), scale):
            moving = [name for name in kinematics.joints if body in reduced({name: _ONE}, meshes)]
            _raise_unbalanced(statics, moving, body, len(free))
    known = determined(solved)
    unknown = [link for link, torque in statics.torques.items() if torque is None and link not in known]
    if unknown:
        raise TorqueError(
            f"{statics.name}: the torques of {quoted(unknown)} are indeterminate; its meshes leave "
            f"{count(len(free), 'degree')} of freedom, and each determines one torque. Give the torque of "
            f'"{unknown[-1]}" as a number, or leave it out where nothing loads it.'
        )


def _raise_unbalanced(statics: Statics, moving: Sequence[str], free: str, dof: int) -> NoReturn:
    """Raise the error for bodies that move together and are unbalanced; name a link that could take the balance."""
    kinematics = statics.kinematics
    given = {link: torque for link, torque in statics.torques.items() if torque}
    numbers = ", ".join(f'"{link}" = {float(torque):g}' for link, torque in given.items())
    start = f"{statics.name}: the torques {numbers} N m do not balance"
    loaded = [link for link in given if kinematics.bodies[link] in moving]
    if len(loaded) > 1:
        raise TorqueError(f'{start}; let one of them follow from the others, as in torques={{"{loaded[-1]}": None}}.')
    named = {kinematics.bodies[link] for link, torque in statics.torques.items() if torque != 0}
    frame = kinematics.mechanism.frame
    able = [body for body in moving if kinematics.joints[body].carried_by == frame and body not in named]
    if not able:
        raise TorqueError(
            f"{start}: that on {quoted(loaded)} has no path to another link. Declare the mesh that carries it, or "
            "leave it out."
        )
    raise TorqueError(
        f"{start}, and nothing takes what is left. The meshes leave {count(dof, 'degree')} of freedom, and each needs "
        f'a link that takes the balance, as in torques={{"{free if free in able else able[-1]}": None}}.'
    )


def _equal_sharing(statics: Statics) -> list[Form]:
    """Return the equations of equal loads on the copies of a mesh, where equilibrium leaves them indeterminate."""
    equations = statics.equations(statics.lossless)
    known = determined(solve(equations)[0])
    first: dict[str, int] = {}
    shared: list[Form] = []
    for number, contact in enumerate(statics.contacts):
        if tooth_load_symbol(number) in known:
            continue
        other = first.setdefault(contact.mesh, number)
        if other != number:
            shared.append({tooth_load_symbol(number): _ONE, tooth_load_symbol(other): -_ONE})
    residuals = solve([*equations, *shared])[1][len(equations) :]
    if not all(map(statics.is_zero, residuals)):
        gearbox = statics.kinematics.gearbox
        copies = {name for link in gearbox.copied for name in gearbox.instances(link)}
        raise TorqueError(
            f"{statics.name}: the torques on {quoted(link for link in statics.torques if link in copies)} load copies "
            "of one axis differently, so they cannot share equally. Put the same torque on each copy, or declare the "
            "copies as axes of their own."
        )
    return shared
