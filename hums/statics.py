"""The equations of static equilibrium by virtual work, and what a solution of them says about each contact.

The speeds of a mechanism obey ``A r = 0``, one row of `A` for each mesh and one rate `r` for each turning pair.
The same rows carry the loads: a mesh whose tooth load is ``L`` (N m a tooth) puts the torque ``Z_i L`` on gear i
about its own axis and the opposite on its carrier. With external torques ``T`` on links that turn at ``B r``,
equilibrium is ``B' T + A' L = 0``. The coefficients are whole numbers, so the equations are solved in rational
arithmetic: whether a load is determinate is decided exactly.

A mesh loses power by its motion relative to its carrier: the gear that drives there gives ``Z_i L``, the driven
one receives ``efficiency Z_j L``.

References
----------
A. Nelson and R. J. Cipra, Simplified kinematic analysis of bevel epicyclic gear trains with application to
power-flow and efficiency analyses, Journal of Mechanical Design 127 (2005), 278-286.
H. W. Mueller, Epicyclic Drive Trains, Wayne State University Press (1982): efficiency by the power relative to
the carrier.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from hums._equations import CONSTANT, add
from hums._forms import Form, evaluate
from hums.gearbox import Mesh, Vector
from hums.kinematics import Kinematics
from hums.loads import TorqueError
from hums.mechanism import Contact

Drivers = tuple[int | None, ...]  # of each contact the gear that drives, 0 or 1; None: nothing is lost there
_ZERO = Fraction(0)
_ONE = Fraction(1)
_ROUNDING = Fraction(1, 10**9)  # torques given as decimals balance to this part of the largest


@dataclass(frozen=True)
class Statics:
    """A mechanism, its external torques in N m, its rates in turns a second, the efficiency of each contact.

    Contacts of two gears are numbered in the order of `contacts`.
    """

    kinematics: Kinematics
    torques: Mapping[str, Fraction | None]
    rates: Mapping[str, Fraction]
    efficiencies: tuple[Fraction, ...]

    @property
    def name(self) -> str:
        """The gearbox, as an error names it."""
        return f'gearbox "{self.kinematics.gearbox.name}"'

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts of two gears; a mate that is unknown carries no load."""
        return gear_pairs(self.kinematics)

    @cached_property
    def turns(self) -> tuple[Fraction, ...]:
        """Speed of each contact's first gear relative to the carrier."""
        return tuple(self.speed(contact.gears[0][0], contact.carrier) for contact in self.contacts)

    @property
    def undriven(self) -> Drivers:
        """Drivers where no contact loses power."""
        return (None,) * len(self.contacts)

    def mesh(self, number: int) -> Mesh:
        """Return the declared mesh of a contact."""
        name = self.contacts[number].mesh
        return next(mesh for mesh in self.kinematics.gearbox.meshes if mesh.name == name)

    def axes(self, number: int) -> tuple[str, str]:
        """Return the axes in the carrier about which the two gears of a contact turn."""
        mechanism, contact = self.kinematics.mechanism, self.contacts[number]
        one, two = (
            mechanism.shared_axis(mechanism.bodies[link], contact.carrier) or ""  # a contact always has them
            for link, _ in contact.gears
        )
        return one, two

    def directions(self, number: int) -> tuple[Vector, Vector]:
        """Return the directions of `axes`."""
        one, two = (self.kinematics.mechanism.directions[axis] for axis in self.axes(number))
        return one, two

    def speed(self, link: str, seen_from: str | None = None) -> Fraction:
        """Return the speed of a link about its own axis, in turns a second."""
        return evaluate(self.kinematics.spin(link, seen_from=seen_from), self.rates)

    def passed_on(self, number: int, driver: int | None) -> tuple[Fraction, Fraction]:
        """Return the part of the tooth load that reaches each of the two gears of a contact."""
        driven = _ONE if driver is None else self.efficiencies[number]
        return (driven, _ONE) if driver == 1 else (_ONE, driven)

    def row(self, number: int, driver: int | None = None) -> Form:
        """Return the torque on each turning pair by one unit of tooth load."""
        contact, row = self.contacts[number], Form()
        for (link, teeth), part in zip(contact.gears, self.passed_on(number, driver), strict=True):
            spin = self.kinematics.spin(link, seen_from=contact.carrier)
            add(row, {body: teeth * part * factor for body, factor in spin.items()})
        return row

    def equations(self, drivers: Drivers) -> list[Form]:
        """Return the equilibrium of every turning pair, in the unknown torques and tooth loads."""
        forms: dict[str, Form] = {body: {} for body in self.kinematics.joints}
        for link in self.torques:
            for body, factor in self.kinematics.spin(link).items():
                add(forms[body], self.term(link, factor))
        for number, driver in enumerate(drivers):
            for body, factor in self.row(number, driver).items():
                add(forms[body], {tooth_load_name(number): factor})
        return list(forms.values())

    def term(self, link: str, factor: Fraction) -> Form:
        """Return a multiple of an external torque: an unknown where the link takes the balance, else a constant."""
        torque = self.torques[link]
        return {link: factor} if torque is None else {CONSTANT: torque * factor}

    def is_zero(self, left_over: Fraction) -> bool:
        """Whether what is left of an equation is the rounding of the given torques."""
        largest = max((abs(torque) for torque in self.torques.values() if torque is not None), default=_ZERO)
        return balances(left_over, largest)


@dataclass(frozen=True)
class Solution:
    """What equilibrium settles: unknown torques and tooth loads, with the gears that drive."""

    statics: Statics
    drivers: Drivers
    values: Mapping[str, Fraction]

    def load(self, number: int) -> Fraction | None:
        """Return the tooth load of a contact in N m a tooth, at the driving gear; None where it is indeterminate."""
        return self.values.get(tooth_load_name(number))

    def flow(self, number: int) -> Fraction | None:
        """Return the power from the first to the second gear of a contact, relative to its carrier, at the driver.

        In N m times turns a second.
        """
        load, (_, teeth) = self.load(number), self.statics.contacts[number].gears[0]
        return None if load is None else -load * teeth * self.statics.turns[number]

    def driving(self, number: int) -> int | None:
        """Return the gear of a contact that drives, 0 or 1; None where no power flows or its load is open."""
        flow = self.flow(number)
        return int(flow < 0) if flow else None

    def parts(self, number: int) -> tuple[Fraction, Fraction]:
        """Return the part of the tooth load that reaches each of the two gears of a contact."""
        return self.statics.passed_on(number, self.drivers[number])

    def row(self, number: int) -> Form:
        """Return the torque on each turning pair by one unit of tooth load."""
        return self.statics.row(number, self.drivers[number])

    def losing(self) -> Drivers:
        """Return of each contact that loses power the gear that drives it."""
        statics = self.statics
        found: list[int | None] = []
        for number, contact in enumerate(statics.contacts):
            loses = statics.efficiencies[number] < 1 and statics.turns[number] != 0
            if loses and self.load(number) is None:
                raise TorqueError(
                    f'mesh "{contact.mesh}": its load is indeterminate, and so is its loss; declare meshes that share '
                    f'a load as copies of one axis, or let it lose nothing, mesh_efficiency={{"{contact.mesh}": 1.0}}.'
                )
            found.append(self.driving(number) if loses else None)
        return tuple(found)


def gear_pairs(kinematics: Kinematics) -> tuple[Contact, ...]:
    """Return the contacts of two gears, those that can carry a load."""
    return tuple(contact for contact in kinematics.contacts if len(contact.gears) == 2)  # noqa: PLR2004


def balances(left_over: Fraction, largest: Fraction) -> bool:
    """Whether torques that should add up to nothing do, to the rounding of the largest of them."""
    return abs(left_over) <= _ROUNDING * largest


def tooth_load_name(number: int) -> str:
    """Return the name of a contact's unknown tooth load; no link is called so."""
    return f"\0{number}"
