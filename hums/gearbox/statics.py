"""Equations of static equilibrium by virtual work, and their solution.

The speeds of a mechanism obey ``A r = 0``, with one row of `A` per mesh and one rate `r` per turning pair. The same
rows give the loads: a mesh with tooth load ``L`` (N m per tooth) applies the torque ``Z_i L`` to gear i about its own
axis and the opposite to its carrier. With external torques ``T`` on links that rotate at ``B r``, equilibrium is
``B' T + A' L = 0``. The coefficients are integers, so the equations are solved in rational arithmetic, which decides
exactly whether a load is determinate.

A mesh loses power by its motion relative to its carrier: the driving gear delivers ``Z_i L``, the driven gear receives
``efficiency Z_j L``.

References
----------
A. Nelson and R. J. Cipra, Simplified kinematic analysis of bevel epicyclic gear trains with application to
power-flow and efficiency analyses, Journal of Mechanical Design 127 (2005), 278-286.
H. W. Mueller, Epicyclic Drive Trains, Wayne State University Press (1982): efficiency by the power relative to
the carrier.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NoReturn

from hums.gearbox.components import Mesh, Vector, count, quoted
from hums.gearbox.kinematics import Kinematics
from hums.gearbox.mechanism import Contact
from hums.gearbox.rational import CONSTANT, ONE, ZERO, Form, add, determined, eliminate, evaluate, reduced, solve
from signals._validation import SentenceError


class TorqueError(SentenceError):
    """Torques that do not balance, or that equilibrium cannot determine.

    Examples
    --------
    >>> import hums
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
    >>> try:
    ...     hums.solve_torques(kinematics, {"input": 10.0, "output": 10.0})
    ... except hums.TorqueError as error:
    ...     print(str(error)[:82])
    gearbox "two-stage": the torques "input" = 10, "output" = 10 N m do not balance; l
    """


Drivers = tuple[int | None, ...]  # driving gear of each contact, 0 or 1; None: the contact loses no power


@dataclass(frozen=True)
class Statics:
    """The statics problem of a mechanism. Contacts are numbered in the order of `contacts`.

    Attributes
    ----------
    kinematics : Kinematics
        Kinematics of the gearbox.
    torques : mapping of str to Fraction or None
        External torque of each loaded link in N m; None: unknown.
    rates : mapping of str to Fraction
        Joint rates in rev/s.
    efficiencies : tuple of Fraction
        Efficiency of each contact.
    """

    kinematics: Kinematics
    torques: Mapping[str, Fraction | None]
    rates: Mapping[str, Fraction]
    efficiencies: tuple[Fraction, ...]

    @property
    def name(self) -> str:
        """Name of the gearbox in error messages."""
        return f'gearbox "{self.kinematics.gearbox.name}"'

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts of two gears; those whose mate is unknown transmit no load."""
        return gear_pairs(self.kinematics)

    @cached_property
    def relative_speeds(self) -> tuple[Fraction, ...]:
        """Speed of each contact's first gear relative to the carrier, in rev/s."""
        return tuple(self.speed(contact.gears[0][0], contact.carrier) for contact in self.contacts)

    @property
    def lossless(self) -> Drivers:
        """The drivers if no contact loses power."""
        return (None,) * len(self.contacts)

    def mesh(self, number: int) -> Mesh:
        """Return the declared mesh of a contact."""
        name = self.contacts[number].mesh
        return next(mesh for mesh in self.kinematics.gearbox.meshes if mesh.name == name)

    def axes(self, number: int) -> tuple[str, str]:
        """Return the axes of the two gears of a contact, fixed in its carrier."""
        mechanism, contact = self.kinematics.mechanism, self.contacts[number]
        one, two = (
            mechanism.shared_axis(mechanism.bodies[link], contact.carrier) or ""  # never None in a contact
            for link, _ in contact.gears
        )
        return one, two

    def directions(self, number: int) -> tuple[Vector, Vector]:
        """Return the directions of `axes`."""
        one, two = (self.kinematics.mechanism.directions[axis] for axis in self.axes(number))
        return one, two

    def speed(self, link: str, seen_from: str | None = None) -> Fraction:
        """Return the speed of a link about its own axis in rev/s."""
        return evaluate(self.kinematics.spin(link, seen_from=seen_from), self.rates)

    def load_factors(self, number: int, driver: int | None) -> tuple[Fraction, Fraction]:
        """Return the factors of the tooth load on the two gears: 1 on the driver, the efficiency on the driven."""
        driven = ONE if driver is None else self.efficiencies[number]
        return (driven, ONE) if driver == 1 else (ONE, driven)

    def generalized_torque(self, number: int, driver: int | None = None) -> Form:
        """Return the torque of a unit tooth load on each turning pair: a row of A, with losses."""
        contact, row = self.contacts[number], Form()
        for (link, teeth), load_factor in zip(contact.gears, self.load_factors(number, driver), strict=True):
            spin = self.kinematics.spin(link, seen_from=contact.carrier)
            add(row, {body: teeth * load_factor * factor for body, factor in spin.items()})
        return row

    def equations(self, drivers: Drivers) -> list[Form]:
        """Return the equations ``B' T + A' L = 0``, one for each turning pair, in unknown torques and tooth loads."""
        forms: dict[str, Form] = {body: {} for body in self.kinematics.joints}
        for link in self.torques:
            for body, factor in self.kinematics.spin(link).items():
                add(forms[body], self.external_term(link, factor))
        for number, driver in enumerate(drivers):
            for body, factor in self.generalized_torque(number, driver).items():
                add(forms[body], {tooth_load_symbol(number): factor})
        return list(forms.values())

    def external_term(self, link: str, factor: Fraction) -> Form:
        """Return a multiple of an external torque as a form: an unknown if it is None, else a constant."""
        torque = self.torques[link]
        return {link: factor} if torque is None else {CONSTANT: torque * factor}

    def is_zero(self, residual: Fraction) -> bool:
        """Return whether the residual of an equation is within the rounding of the given torques."""
        largest = max((abs(torque) for torque in self.torques.values() if torque is not None), default=ZERO)
        return is_balanced(residual, largest)


@dataclass(frozen=True)
class Solution:
    """Solution of a statics problem: the determinate unknown torques and tooth loads, and the driving gears."""

    statics: Statics
    drivers: Drivers
    values: Mapping[str, Fraction]

    def load(self, number: int) -> Fraction | None:
        """Return the tooth load of a contact in N m per tooth, at the driving gear; None if indeterminate."""
        return self.values.get(tooth_load_symbol(number))

    def flow(self, number: int) -> Fraction | None:
        """Return the power from the first to the second gear of a contact, relative to its carrier, at the driver.

        In N m rev/s; `watts` converts it.
        """
        load, (_, teeth) = self.load(number), self.statics.contacts[number].gears[0]
        return None if load is None else -load * teeth * self.statics.relative_speeds[number]

    def driving(self, number: int) -> int | None:
        """Return the driving gear of a contact, 0 or 1; None without power or with an indeterminate load."""
        flow = self.flow(number)
        return int(flow < 0) if flow else None

    def load_factors(self, number: int) -> tuple[Fraction, Fraction]:
        """Return the factors of the tooth load on the two gears of a contact."""
        return self.statics.load_factors(number, self.drivers[number])

    def generalized_torque(self, number: int) -> Form:
        """Return the torque of a unit tooth load on each turning pair."""
        return self.statics.generalized_torque(number, self.drivers[number])

    def driving_gears(self) -> Drivers:
        """Return the driving gear of each contact that loses power, None for the others."""
        statics = self.statics
        found: list[int | None] = []
        for number, contact in enumerate(statics.contacts):
            loses = statics.efficiencies[number] < 1 and statics.relative_speeds[number] != 0
            if loses and self.load(number) is None:
                raise TorqueError(
                    f'mesh "{contact.mesh}": its load is indeterminate, and so is its loss; declare meshes that share '
                    f'a load as copies of one axis, or make it lossless, mesh_efficiency={{"{contact.mesh}": 1.0}}.'
                )
            found.append(self.driving(number) if loses else None)
        return tuple(found)


def gear_pairs(kinematics: Kinematics) -> tuple[Contact, ...]:
    """Return the contacts of two gears, which can transmit a load."""
    return tuple(contact for contact in kinematics.contacts if len(contact.gears) == 2)  # noqa: PLR2004


def is_balanced(total: Fraction, largest: Fraction) -> bool:
    """Return whether a sum of torques is zero to the rounding of the largest of them."""
    tolerance = Fraction(1, 10**9)  # of the largest torque, for the rounding of decimals
    return abs(total) <= tolerance * largest


def tooth_load_symbol(number: int) -> str:
    """Return the name of a contact's tooth load among the unknowns, which no link has."""
    return f"\0{number}"


# ---- Solve the static equilibrium of a mechanism: balance, load sharing, driving gears -------------------------------
# The loss of a mesh reduces the load of its driven gear, and the loads determine which gear drives: the solution is
# iterated until both agree.


def solve_equilibrium(statics: Statics) -> Solution:
    """Solve for torques and tooth loads, iterating until the driving gears are those assumed.

    Raises
    ------
    TorqueError
        If torques do not balance or are indeterminate, copies cannot share equally, losses depend on an indeterminate
        load, or losses make the mechanism self-locking.
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
                f"{statics.name}: with the losses of its meshes the torques do not balance. Leave the torques of as "
                "many links unknown (None) as there are degrees of freedom, or raise mesh_efficiency."
            )
        drivers = solution.driving_gears()
        if drivers == solution.drivers:
            return solution
    undecided = [
        contact.mesh for contact, now, before in zip(statics.contacts, drivers, tried[-1], strict=True) if now != before
    ]
    raise TorqueError(
        f"{statics.name} is self-locking: whichever gear is assumed to drive, the losses of the meshes "
        f"{quoted(undecided)} reverse the power flow. Raise mesh_efficiency, or reverse the direction of power."
    )


def _check_balance(statics: Statics) -> None:
    """Check that each degree of freedom is balanced without losses, and that the unknown torques are determinate.

    Degrees of freedom are those left by the meshes alone: any other constraint on a link acts by a torque, which must
    be named.
    """
    kinematics = statics.kinematics
    meshes: dict[str, Form] = {}
    for number in range(len(statics.contacts)):
        eliminate(statics.generalized_torque(number), meshes, last=list(kinematics.joints))
    free = [body for body in kinematics.joints if body not in meshes]
    speeds = {link: reduced(kinematics.spin(link), meshes) for link in statics.torques}
    solved: dict[str, Form] = {}
    for body in free:
        form, scale = Form(), ZERO
        for link, torque in statics.torques.items():
            factor = speeds[link].get(body, ZERO)
            add(form, statics.external_term(link, factor))
            scale = max(scale, abs((torque or ZERO) * factor))
        if not is_balanced(eliminate(form, solved), scale):
            moving = [name for name in kinematics.joints if body in reduced({name: ONE}, meshes)]
            _raise_unbalanced(statics, moving, body, len(free))
    known = determined(solved)
    unknown = [link for link, torque in statics.torques.items() if torque is None and link not in known]
    if unknown:
        raise TorqueError(
            f"{statics.name}: the torques of {quoted(unknown)} are indeterminate; its meshes leave "
            f"{count(len(free), 'degree')} of freedom, and each determines one torque. Give the torque of "
            f'"{unknown[-1]}" as a number, or omit it if nothing loads the link.'
        )


def _raise_unbalanced(statics: Statics, moving: Sequence[str], free: str, dof: int) -> NoReturn:
    """Raise the error for bodies that move together and are unbalanced, naming a link that could balance them."""
    kinematics = statics.kinematics
    given = {link: torque for link, torque in statics.torques.items() if torque}
    numbers = ", ".join(f'"{link}" = {float(torque):g}' for link, torque in given.items())
    start = f"{statics.name}: the torques {numbers} N m do not balance"
    loaded = [link for link in given if kinematics.bodies[link] in moving]
    if len(loaded) > 1:
        raise TorqueError(f'{start}; leave one of them unknown, as in torques={{"{loaded[-1]}": None}}.')
    named = {kinematics.bodies[link] for link, torque in statics.torques.items() if torque != 0}
    frame = kinematics.mechanism.frame
    able = [body for body in moving if kinematics.joints[body].carried_by == frame and body not in named]
    if not able:
        raise TorqueError(
            f"{start}: the torque on {quoted(loaded)} has no path to another link. Declare the mesh that carries it, "
            "or omit the torque."
        )
    raise TorqueError(
        f"{start}, and no other torque balances them. The meshes leave {count(dof, 'degree')} of freedom, and each "
        f'needs a link of unknown torque, as in torques={{"{free if free in able else able[-1]}": None}}.'
    )


def _equal_sharing(statics: Statics) -> list[Form]:
    """Return the equations of equal loads on the copies of a mesh, if equilibrium leaves them indeterminate."""
    equations = statics.equations(statics.lossless)
    known = determined(solve(equations)[0])
    first: dict[str, int] = {}
    shared: list[Form] = []
    for number, contact in enumerate(statics.contacts):
        if tooth_load_symbol(number) in known:
            continue
        other = first.setdefault(contact.mesh, number)
        if other != number:
            shared.append({tooth_load_symbol(number): ONE, tooth_load_symbol(other): -ONE})
    residuals = solve([*equations, *shared])[1][len(equations) :]
    if not all(map(statics.is_zero, residuals)):
        copies = statics.kinematics.gearbox.copy_links
        raise TorqueError(
            f"{statics.name}: the torques on {quoted(link for link in statics.torques if link in copies)} load copies "
            "of one axis differently, so they cannot share equally. Give the same torque for each copy, or declare the "
            "copies as separate axes."
        )
    return shared
