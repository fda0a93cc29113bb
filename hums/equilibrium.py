"""Solve the equilibrium of a mechanism: is it balanced, who shares, which gears drive.

Which gear of a mesh drives decides where its loss is felt, and follows from the loads: it is iterated until both
agree.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import NoReturn

from hums._equations import add, determined, join, solve
from hums._forms import Form, reduced
from hums.declared import count, quoted
from hums.loads import TorqueError
from hums.statics import Drivers, Solution, Statics, balances, tooth_load_name

_ZERO = Fraction(0)
_ONE = Fraction(1)


def solve_equilibrium(statics: Statics) -> Solution:
    """Solve for the loads until the gears that drive are those that were taken to drive.

    Raises
    ------
    TorqueError
        Torques that do not balance or cannot be told apart, copies that cannot share equally, losses that depend
        on an indeterminate load, losses so high that the mechanism locks itself.
    """
    _check_balance(statics)
    sharing = _sharing(statics)
    drivers = statics.undriven
    tried: list[Drivers] = []
    while drivers not in tried:
        tried.append(drivers)
        solved, left_over = solve([*statics.equations(drivers), *sharing])
        solution = Solution(statics, drivers, determined(solved))
        settled = all(link in solution.values for link, torque in statics.torques.items() if torque is None)
        if drivers != statics.undriven and not (settled and all(map(statics.is_zero, left_over))):
            raise TorqueError(
                f"{statics.name}: with the losses of its meshes the torques do not balance. Let as many links take "
                "the balance (None) as there are degrees of freedom, or raise mesh_efficiency."
            )
        drivers = solution.losing()
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
    """Hold that each degree of freedom is balanced without losses, and that None says no more than that.

    Only meshes bind here: what holds a link at rest otherwise does it by a torque, which has to be named.
    """
    kinematics = statics.kinematics
    meshes: dict[str, Form] = {}
    for number in range(len(statics.contacts)):
        join(statics.row(number), meshes, last=list(kinematics.joints))
    free = [body for body in kinematics.joints if body not in meshes]
    moved = {link: reduced(kinematics.spin(link), meshes) for link in statics.torques}
    solved: dict[str, Form] = {}
    for body in free:
        form, scale = Form(), _ZERO
        for link, torque in statics.torques.items():
            factor = moved[link].get(body, _ZERO)
            add(form, statics.term(link, factor))
            scale = max(scale, abs((torque or _ZERO) * factor))
        if not balances(join(form, solved), scale):
            moving = [name for name in kinematics.joints if body in reduced({name: _ONE}, meshes)]
            _raise_unbalanced(statics, moving, body, len(free))
    settled = determined(solved)
    open_links = [link for link, torque in statics.torques.items() if torque is None and link not in settled]
    if open_links:
        raise TorqueError(
            f"{statics.name}: the torques of {quoted(open_links)} cannot be told apart; its meshes leave "
            f"{count(len(free), 'degree')} of freedom, and each settles one torque. Give the torque of "
            f'"{open_links[-1]}" as a number, or leave it out where nothing loads it.'
        )


def _raise_unbalanced(statics: Statics, moving: Sequence[str], free: str, dof: int) -> NoReturn:
    """Say what unbalances the bodies that move with the free one, and which link could take it."""
    kinematics = statics.kinematics
    given = {link: torque for link, torque in statics.torques.items() if torque}
    numbers = ", ".join(f'"{link}" = {float(torque):g}' for link, torque in given.items())
    start = f"{statics.name}: the torques {numbers} N m do not balance"
    culprits = [link for link in given if kinematics.bodies[link] in moving]
    if len(culprits) > 1:
        raise TorqueError(f'{start}; let one of them follow from the others, as in torques={{"{culprits[-1]}": None}}.')
    named = {kinematics.bodies[link] for link, torque in statics.torques.items() if torque != 0}
    frame = kinematics.mechanism.frame
    able = [body for body in moving if kinematics.joints[body].carried_by == frame and body not in named]
    if not able:
        raise TorqueError(
            f"{start}: that on {quoted(culprits)} has no path to another link. Declare the mesh that carries it, or "
            "leave it out."
        )
    raise TorqueError(
        f"{start}, and nothing takes what is left. The meshes leave {count(dof, 'degree')} of freedom, and each needs "
        f'a link that takes the balance, as in torques={{"{free if free in able else able[-1]}": None}}.'
    )


def _sharing(statics: Statics) -> list[Form]:
    """Return equations by which copies of a mesh share equally, where equilibrium alone leaves their loads open."""
    equations = statics.equations(statics.undriven)
    settled = determined(solve(equations)[0])
    first: dict[str, int] = {}
    shared: list[Form] = []
    for number, contact in enumerate(statics.contacts):
        if tooth_load_name(number) in settled:
            continue
        one = first.setdefault(contact.mesh, number)
        if one != number:
            shared.append({tooth_load_name(number): _ONE, tooth_load_name(one): -_ONE})
    left_over = solve([*equations, *shared])[1][len(equations) :]
    if not all(map(statics.is_zero, left_over)):
        gearbox = statics.kinematics.gearbox
        copies = {name for link in gearbox.copied for name in gearbox.instances(link)}
        raise TorqueError(
            f"{statics.name}: the torques on {quoted(link for link in statics.torques if link in copies)} load copies "
            "of one axis differently, so they cannot share equally. Put the same torque on each copy, or declare the "
            "copies as axes of their own."
        )
    return shared
