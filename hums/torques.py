"""Static torques, tooth loads, forces and power of a mechanism, by virtual work.

The speeds of a mechanism obey ``A r = 0``, one row of `A` for each mesh and one rate `r` for each turning pair.
The same rows carry the loads: a mesh whose tooth load is ``L`` (N m a tooth) puts the torque ``Z_i L`` on gear i
about its own axis and the opposite on its carrier. With external torques ``T`` on links that turn at ``B r``,
equilibrium is ``B' T + A' L = 0``. The coefficients are whole numbers, so the equations are solved in rational
arithmetic: whether a load is determinate is decided exactly, and power balances to the rounding of the result.

A mesh loses power by its motion relative to its carrier: the gear that drives there gives ``Z_i L``, the driven
one receives ``efficiency Z_j L``. Which gear drives follows from the loads and is iterated until both agree.

References
----------
A. Nelson and R. J. Cipra, Simplified kinematic analysis of bevel epicyclic gear trains with application to
power-flow and efficiency analyses, Journal of Mechanical Design 127 (2005), 278-286.
H. W. Mueller, Epicyclic Drive Trains, Wayne State University Press (1982): efficiency by the power relative to
the carrier, circulating power.
ISO 21771 (2007): working pressure angle. Decker, Maschinenelemente, and any other text on gears: the three
components of a tooth force and the statics of a shaft in two bearings.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Real
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from hums._forms import Form, add_pivot, reduced
from hums.declared import closest, count
from hums.gearbox import Axis, Bearing, GearboxError, Mesh, Vector
from hums.kinematics import Kinematics
from hums.mechanism import Contact

__all__ = [
    "BearingLoad",
    "Branch",
    "ExternalTorque",
    "ToothForces",
    "ToothLoad",
    "TorqueError",
    "Torques",
    "solve_torques",
]

Drivers = tuple[int | None, ...]  # of each contact the gear that drives, 0 or 1; None: nothing is lost there
_CONSTANT = ""  # the name of a form's constant term; no link has an empty name
_ZERO = Fraction(0)
_ONE = Fraction(1)
_ROUNDING = Fraction(1, 10**9)  # torques given as decimals balance to this part of the largest
_PARALLEL = 1e-12
_APART = 1e-3  # of the centre distance: rounded positions and profile shifts differ by less
_NO_THRUST = 1e-12  # of the axial forces of a shaft: helices whose thrusts cancel leave their rounding
_UNKNOWN: Vector = (math.nan, math.nan, math.nan)


class TorqueError(ValueError):
    """Torques that do not balance, that nothing can take, or that cannot be told apart."""


class _OpenError(Exception):
    """Why a bearing load is not settled, in words; it ends as a `BearingLoad.status`."""


@dataclass(frozen=True, kw_only=True)
class ExternalTorque:
    """What the outside puts on a link.

    Attributes
    ----------
    torque_nm : float, N m, about the link's own declared axis
    power_w : float, W, positive into the gearbox
    """

    link: str
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class ToothForces:
    """The force between the teeth of one contact, in N, as magnitudes at the pitch point.

    The tangential force turns the driven gear, the radial one pushes the gears apart (a ring outwards), the axial
    one acts along the axes.
    """

    tangential_n: float
    radial_n: float
    axial_n: float


@dataclass(frozen=True, kw_only=True)
class ToothLoad:
    """One contact of a mesh, a planet's copies each counted. NaN where `determinate` is False.

    Attributes
    ----------
    gears : pair of link names, in the order of declaration
    torques_nm : pair of float, N m
        On each gear about its own axis; that of the driven gear is less the loss.
    carrier_torque_nm : (3,) N m
        On the carrier, which takes the reaction of both gears. A copy counts where the first one stands.
    gearing_power_w : float, W
        Power that flows from the first gear to the second as the carrier sees it, which is what a mesh loses a
        part of; measured at the gear that drives.
    absolute_power_w : float or None, W
        The same flow as the frame sees it, measured at the gear that turns about the carrier's axis. None where
        there is no such gear (between planets), or the carrier is carried itself: positions would decide.
    driver : str or None
        The gear that drives as the carrier sees it; None where no power flows.
    loss_w : float, W
    forces : ToothForces or None
        None where the mesh declares no module or no pressure angle, or its axes are not parallel.
    """

    mesh: str
    gears: tuple[str, str]
    carrier: str
    determinate: bool
    torques_nm: tuple[float, float]
    carrier_torque_nm: Vector
    gearing_power_w: float
    absolute_power_w: float | None
    driver: str | None
    loss_w: float
    forces: ToothForces | None


@dataclass(frozen=True, kw_only=True)
class Branch:
    """One place where the meshes act on a link that turns about an axis at rest.

    A gear has a branch for each of its meshes, a carrier one for each set of planets it holds, all copies together.
    The branches of a link and its external torque add up to nothing.

    Attributes
    ----------
    through : names of the meshes that act there
    torque_nm : float, N m, on the link
    power_w : float, W, positive into the link
    """

    link: str
    through: tuple[str, ...]
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class BearingLoad:
    """The reaction of the frame on a shaft at one bearing. NaN where it is not settled.

    Attributes
    ----------
    radial_n : (3,) N, in the declared coordinates, across the shaft
    axial_n : float, N, positive along the direction of the shaft's axis
    status : str
        ``"solved"``, or what stands in the way, in words. Where only the share in the axial force is open, the
        radial reaction stands.
    """

    bearing: str
    radial_n: Vector
    axial_n: float
    status: str


@dataclass(frozen=True, kw_only=True)
class Torques:
    """Static equilibrium of a gearbox under load, and the flow of power through it.

    Attributes
    ----------
    external : torques on the links that were named, given ones and those that take the balance
    frame_torque_nm : (3,) N m
        What holds the frame: the reaction to all external torques, in the declared coordinates.
    tooth_loads : one for each contact of two gears
    branches : what the meshes put on each link that turns about an axis at rest
    bearing_loads : one for each declared bearing, in the order of declaration
    input_power_w, output_power_w : float, W
        What flows in by all links together, and what flows out.
    efficiency : float or None
        Output over input; None where no power flows in, 0 where every link has to drive (a box that locks itself).
    circulating_ratio : float or None
        Power of the largest branch over the input: 1 where one stream runs through, below 1 where it divides,
        above 1 where power circulates. None without input or where a load is indeterminate.
    gearing_ratio : float or None
        Largest power of a mesh relative to its carrier, its copies together, over the input; None likewise.
    indeterminate : names of the meshes whose loads statics does not settle
    """

    external: tuple[ExternalTorque, ...]
    frame_torque_nm: Vector
    tooth_loads: tuple[ToothLoad, ...]
    branches: tuple[Branch, ...]
    bearing_loads: tuple[BearingLoad, ...]
    input_power_w: float
    output_power_w: float
    efficiency: float | None
    circulating_ratio: float | None
    gearing_ratio: float | None
    indeterminate: tuple[str, ...]

    @property
    def torques_nm(self) -> dict[str, float]:
        """External torque in N m by link."""
        return {load.link: load.torque_nm for load in self.external}

    @property
    def losses_w(self) -> dict[str, float]:
        """Power lost in W by mesh, its copies together."""
        losses: dict[str, float] = {}
        for load in self.tooth_loads:
            losses[load.mesh] = losses.get(load.mesh, 0.0) + load.loss_w
        return losses

    def at(self, mesh: str) -> tuple[ToothLoad, ...]:
        """Return the contacts of one mesh, a planet's copies each counted."""
        found = tuple(load for load in self.tooth_loads if load.mesh == mesh)
        if not found:
            names = list(dict.fromkeys(load.mesh for load in self.tooth_loads))
            raise TorqueError(f'no mesh "{mesh}" of two gears{closest(mesh, names)}')
        return found


def solve_torques(
    kinematics: Kinematics,
    torques: Mapping[str, float | Fraction | None],
    *,
    speeds: Mapping[str, float | Fraction] | None = None,
    mesh_efficiency: float | Mapping[str, float] = 1.0,
) -> Torques:
    """Solve the static equilibrium of a mechanism for its tooth loads and the torques that balance it.

    Planets of one ``copies`` group share equally where statics leaves it open. Loads that distinct meshes can
    share in any proportion are reported as indeterminate. A mesh whose mate is unknown carries no load: put the
    mate's torque on its gear. Tooth forces need ``module_mm`` (of the normal section) and ``pressure_angle_deg`` of
    a mesh; without ``helix_angle_deg`` its teeth are straight.

    Bearing loads follow by statics for a shaft on an axis at rest that runs in exactly two bearings to the frame.
    Needed are ``through`` (mm) of its axis and those of its mates, ``position_mm`` of its bearings and meshes, what
    tooth forces need, and for helical teeth ``hand`` and the bearing in ``takes_axial``. External torques count as
    pure couples; weights, and the axial force that a slanted contact makes out of a radial load, are left out.
    Shafts that planets load or that carry other shafts are not covered. What keeps a bearing load from being
    settled is said in its ``status``.

    Parameters
    ----------
    kinematics : Kinematics
        From `solve_kinematics`.
    torques : mapping of link name to torque, N m
        External torques along the links' declared axes, positive in the sense of positive speed; None: the link
        takes the balance. As many links as there are degrees of freedom can. The other links carry no external
        torque, but the frame holds whatever is left.
    speeds : mapping of link name to speed, turns a second
        As many as there are degrees of freedom. None: one turn a second of the gearbox's reference.
    mesh_efficiency : float, or mapping of mesh name to float
        Part of the power relative to the carrier that a mesh passes on, above 0 and at most 1; a mesh that the
        mapping does not name loses nothing.

    Returns
    -------
    Torques

    Raises
    ------
    TorqueError
        Torques that contradict each other, that nothing takes, or more links to take the balance than statics
        can tell apart; losses so high that the mechanism locks itself.
    GearboxError
        Speeds that do not settle every degree of freedom, as in `Kinematics.rates`.
    """
    statics = _Statics(
        kinematics,
        {link: _checked(kinematics, link, torque) for link, torque in torques.items()},
        kinematics.rates(speeds),
        _efficiencies(kinematics, mesh_efficiency),
    )
    _check_balance(statics)
    return _result(_equilibrium(statics, _sharing(statics)))


@dataclass(frozen=True)
class _Statics:
    """A mechanism, its external torques in N m, its rates in turns a second, the efficiency of each contact."""

    kinematics: Kinematics
    torques: Mapping[str, Fraction | None]
    rates: Mapping[str, Fraction]
    efficiencies: tuple[Fraction, ...]

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        return _pairs(self.kinematics)

    @cached_property
    def turns(self) -> tuple[Fraction, ...]:
        """Speed of each contact's first gear relative to the carrier."""
        return tuple(self.speed(contact.gears[0][0], contact.carrier) for contact in self.contacts)

    @property
    def undriven(self) -> Drivers:
        return (None,) * len(self.contacts)

    @property
    def name(self) -> str:
        return f'gearbox "{self.kinematics.gearbox.name}"'

    def speed(self, link: str, seen_from: str | None = None) -> Fraction:
        form = self.kinematics.spin(link, seen_from=seen_from)
        return sum((factor * self.rates[body] for body, factor in form.items()), _ZERO)

    def passed_on(self, number: int, driver: int | None) -> tuple[Fraction, Fraction]:
        """Part of the tooth load that reaches each of the two gears of a contact."""
        driven = _ONE if driver is None else self.efficiencies[number]
        return (driven, _ONE) if driver == 1 else (_ONE, driven)

    def row(self, number: int, driver: int | None = None) -> Form:
        """Torque on each turning pair by one unit of tooth load."""
        contact, row = self.contacts[number], Form()
        for (link, teeth), part in zip(contact.gears, self.passed_on(number, driver), strict=True):
            spin = self.kinematics.spin(link, seen_from=contact.carrier)
            _add(row, {body: teeth * part * factor for body, factor in spin.items()})
        return row

    def equations(self, drivers: Drivers) -> list[Form]:
        """Equilibrium of every turning pair, in the unknown torques and tooth loads."""
        forms: dict[str, Form] = {body: {} for body in self.kinematics.joints}
        for link, torque in self.torques.items():
            for body, factor in self.kinematics.spin(link).items():
                _add(forms[body], _term(link, torque, factor))
        for number, driver in enumerate(drivers):
            for body, factor in self.row(number, driver).items():
                _add(forms[body], {_load(number): factor})
        return list(forms.values())

    def is_zero(self, left_over: Fraction) -> bool:
        largest = max((abs(torque) for torque in self.torques.values() if torque is not None), default=_ZERO)
        return abs(left_over) <= _ROUNDING * largest


@dataclass(frozen=True)
class _Solution:
    """What equilibrium settles: unknown torques and tooth loads, with the gears that drive."""

    statics: _Statics
    drivers: Drivers
    values: Mapping[str, Fraction]

    def load(self, number: int) -> Fraction | None:
        """Tooth load of a contact in N m a tooth, at the gear that drives; None where it is indeterminate."""
        return self.values.get(_load(number))

    def flow(self, number: int) -> Fraction | None:
        """Power from the first to the second gear of a contact, relative to its carrier and at the driver."""
        (_, teeth), _ = self.statics.contacts[number].gears
        return _times(self.load(number), -teeth * self.statics.turns[number])

    def driving(self, number: int) -> int | None:
        flow = self.flow(number)
        return int(flow < 0) if flow else None

    def parts(self, number: int) -> tuple[Fraction, Fraction]:
        return self.statics.passed_on(number, self.drivers[number])

    def losing(self) -> Drivers:
        """Of each contact that loses power, the gear that drives it."""
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


def _check_balance(statics: _Statics) -> None:
    """Hold that each degree of freedom is balanced without losses, and that None says no more than that.

    Only meshes bind here: what holds a link at rest otherwise does it by a torque, which has to be named.
    """
    kinematics = statics.kinematics
    meshes: dict[str, Form] = {}
    for number in range(len(statics.contacts)):
        _join(statics.row(number), meshes, last=list(kinematics.joints))
    free = [body for body in kinematics.joints if body not in meshes]
    moved = {link: reduced(kinematics.spin(link), meshes) for link in statics.torques}
    solved: dict[str, Form] = {}
    for body in free:
        form, scale = Form(), _ZERO
        for link, torque in statics.torques.items():
            factor = moved[link].get(body, _ZERO)
            _add(form, _term(link, torque, factor))
            scale = max(scale, abs((torque or _ZERO) * factor))
        if abs(_join(form, solved)) > _ROUNDING * scale:
            moving = [name for name in kinematics.joints if body in reduced({name: _ONE}, meshes)]
            _raise_unbalanced(statics, moving, body, len(free))
    settled = _determined(solved)
    open_links = [link for link, torque in statics.torques.items() if torque is None and link not in settled]
    if open_links:
        raise TorqueError(
            f"{statics.name}: the torques of {_listed(open_links)} cannot be told apart; its meshes leave "
            f"{count(len(free), 'degree')} of freedom, and each settles one torque. Give the torque of "
            f'"{open_links[-1]}" as a number, or leave it out where nothing loads it.'
        )


def _raise_unbalanced(statics: _Statics, moving: Sequence[str], free: str, dof: int) -> NoReturn:
    """Say what unbalances the bodies that move with the free one, and which link could take it."""
    kinematics = statics.kinematics
    given = {link: torque for link, torque in statics.torques.items() if torque}
    start = f"{statics.name}: the torques {_numbers(given)} N m do not balance"
    culprits = [link for link in given if kinematics.bodies[link] in moving]
    if len(culprits) > 1:
        raise TorqueError(f'{start}; let one of them follow from the others, as in torques={{"{culprits[-1]}": None}}.')
    named = {kinematics.bodies[link] for link, torque in statics.torques.items() if torque != 0}
    frame = kinematics.mechanism.frame
    able = [body for body in moving if kinematics.joints[body].carried_by == frame and body not in named]
    if not able:
        raise TorqueError(
            f"{start}: that on {_listed(culprits)} has no path to another link. Declare the mesh that carries it, or "
            "leave it out."
        )
    raise TorqueError(
        f"{start}, and nothing takes what is left. The meshes leave {count(dof, 'degree')} of freedom, and each needs "
        f'a link that takes the balance, as in torques={{"{free if free in able else able[-1]}": None}}.'
    )


def _sharing(statics: _Statics) -> list[Form]:
    """Equations by which the copies of a mesh share equally, where equilibrium alone leaves their loads open."""
    equations = statics.equations(statics.undriven)
    settled = _determined(_solve(equations)[0])
    first: dict[str, int] = {}
    shared: list[Form] = []
    for number, contact in enumerate(statics.contacts):
        if _load(number) in settled:
            continue
        one = first.setdefault(contact.mesh, number)
        if one != number:
            shared.append({_load(number): _ONE, _load(one): -_ONE})
    left_over = _solve([*equations, *shared])[1][len(equations) :]
    if not all(map(statics.is_zero, left_over)):
        gearbox = statics.kinematics.gearbox
        copies = {name for link in gearbox.copied for name in gearbox.instances(link)}
        raise TorqueError(
            f"{statics.name}: the torques on {_listed(link for link in statics.torques if link in copies)} load copies "
            "of one axis differently, so they cannot share equally. Put the same torque on each copy, or declare the "
            "copies as axes of their own."
        )
    return shared


def _equilibrium(statics: _Statics, sharing: Sequence[Form]) -> _Solution:
    """Solve for the loads until the gears that drive are those that were taken to drive."""
    drivers = statics.undriven
    tried: list[Drivers] = []
    while drivers not in tried:
        tried.append(drivers)
        solved, left_over = _solve([*statics.equations(drivers), *sharing])
        solution = _Solution(statics, drivers, _determined(solved))
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
        contact.mesh for contact, *both in zip(statics.contacts, drivers, tried[-1], strict=True) if both[0] != both[1]
    ]
    raise TorqueError(
        f"{statics.name} locks itself: whichever gear is taken to drive, the losses of the meshes {_listed(undecided)} "
        "turn the flow of power round. Raise mesh_efficiency, or let power flow the other way."
    )


def _result(solution: _Solution) -> Torques:
    statics = solution.statics
    torques = {link: solution.values[link] if given is None else given for link, given in statics.torques.items()}
    powers = {link: torque * statics.speed(link) for link, torque in torques.items()}
    loads = tuple(_tooth_load(solution, number) for number in range(len(statics.contacts)))
    branches = tuple(_branches(solution))
    income = sum((power for power in powers.values() if power > 0), _ZERO)
    outgo = -sum((power for power in powers.values() if power < 0), _ZERO)
    indeterminate = tuple(dict.fromkeys(load.mesh for load in loads if not load.determinate))
    gearing: dict[str, float] = {}
    for load in loads:
        gearing[load.mesh] = gearing.get(load.mesh, 0.0) + abs(load.gearing_power_w)
    known = income > 0 and not indeterminate
    return Torques(
        external=tuple(
            ExternalTorque(link=link, torque_nm=float(torque), power_w=_watts(powers[link]))
            for link, torque in torques.items()
        ),
        frame_torque_nm=_reaction((float(torque), _own_axis(statics, link)) for link, torque in torques.items()),
        tooth_loads=loads,
        branches=branches,
        bearing_loads=tuple(_bearing_loads(solution)),
        input_power_w=_watts(income),
        output_power_w=_watts(outgo),
        efficiency=float(outgo / income) if income > 0 else None,
        circulating_ratio=max(abs(branch.power_w) for branch in branches) / _watts(income) if known else None,
        gearing_ratio=max(gearing.values(), default=0.0) / _watts(income) if known else None,
        indeterminate=indeterminate,
    )


def _tooth_load(solution: _Solution, number: int) -> ToothLoad:
    statics, contact = solution.statics, solution.statics.contacts[number]
    load, flow, driver = solution.load(number), solution.flow(number), solution.driving(number)
    one, two = (
        _float(_times(load, teeth * part))
        for (_, teeth), part in zip(contact.gears, solution.parts(number), strict=True)
    )
    axes = [_axis_on(statics, link, contact.carrier) for link, _ in contact.gears]
    loses = solution.drivers[number] is not None
    return ToothLoad(
        mesh=contact.mesh,
        gears=(contact.gears[0][0], contact.gears[1][0]),
        carrier=contact.carrier,
        determinate=load is not None,
        torques_nm=(one, two),
        carrier_torque_nm=_reaction(zip((one, two), axes, strict=True)),
        gearing_power_w=_watts(flow),
        absolute_power_w=_absolute_power(solution, number),
        driver=None if driver is None else contact.gears[driver][0],
        loss_w=abs(_watts(_times(flow, 1 - statics.efficiencies[number]))) if loses else 0.0,
        forces=None if load is None else _forces(statics, number, float(load), axes),
    )


def _absolute_power(solution: _Solution, number: int) -> float | None:
    """Power from the first to the second gear as the frame sees it, at a gear that turns about the carrier's axis."""
    statics, contact = solution.statics, solution.statics.contacts[number]
    joints, frame = statics.kinematics.joints, statics.kinematics.mechanism.frame
    if contact.carrier == frame:
        return _watts(solution.flow(number))
    holder = joints[contact.carrier]
    if holder.carried_by != frame:
        return None
    for sign, (link, teeth), part in zip((-1, 1), contact.gears, solution.parts(number), strict=True):
        body = statics.kinematics.bodies[link]
        if body == frame or joints[body].axis == holder.axis:
            return _watts(_times(solution.load(number), sign * teeth * part * statics.speed(link)))
    return None


def _branches(solution: _Solution) -> Iterator[Branch]:
    """Sum what the meshes put on each body that turns about an axis at rest."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for body, joint in kinematics.joints.items():
        if joint.carried_by != kinematics.mechanism.frame:
            continue
        for numbers in _places(statics, body):
            torque: Fraction | None = _ZERO
            for number in numbers:
                factor = statics.row(number, solution.drivers[number]).get(body)  # none of a mesh between planets
                share = _ZERO if factor is None else _times(solution.load(number), factor)
                torque = None if torque is None or share is None else torque + share
            yield Branch(
                link=body,
                through=tuple(dict.fromkeys(statics.contacts[number].mesh for number in numbers)),
                torque_nm=_float(torque),
                power_w=_watts(_times(torque, statics.rates[body])),
            )


def _places(statics: _Statics, body: str) -> list[list[int]]:
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


def _forces(statics: _Statics, number: int, load_nm: float, axes: Sequence[Vector]) -> ToothForces | None:
    """Resolve a tooth load at the working pitch point of a gear pair with parallel axes.

    With ``d = m Z / cos b`` the transverse force is ``2 Z L / (d cos a_t)`` along the line of action, which
    stands at the working angle; `_angles`.
    """
    mesh = _mesh(statics, number)
    angles = _angles(statics, number, axes)
    if mesh.module_mm is None or angles is None:
        return None
    at_reference_n = 2 * abs(load_nm) * math.cos(angles.helix_rad) / (1e-3 * mesh.module_mm)
    line_n = at_reference_n / math.cos(angles.transverse_rad)
    return ToothForces(
        tangential_n=line_n * math.cos(angles.working_rad),
        radial_n=line_n * math.sin(angles.working_rad),
        axial_n=at_reference_n * math.tan(angles.helix_rad),
    )


@dataclass(frozen=True)
class _Angles:
    """Helix, transverse and working transverse pressure angle of a pair; its sum of teeth, internal negative."""

    helix_rad: float
    transverse_rad: float
    working_rad: float
    teeth: int


def _angles(statics: _Statics, number: int, axes: Sequence[Vector]) -> _Angles | None:
    """Return the angles of a gear pair; None without a pressure angle, or where its axes are not parallel."""
    mesh = _mesh(statics, number)
    along = sum(a * b for a, b in zip(*axes, strict=True))
    if mesh.pressure_angle_deg is None or mesh.kind or abs(abs(along) - 1) > _PARALLEL:
        return None
    (_, one), (_, two) = statics.contacts[number].gears
    teeth = abs(one) + abs(two) if one * two * along > 0 else -abs(abs(one) - abs(two))
    helix_rad = math.radians(abs(mesh.helix_angle_deg or 0.0))
    transverse_rad = math.atan(math.tan(math.radians(mesh.pressure_angle_deg)) / math.cos(helix_rad))
    return _Angles(helix_rad, transverse_rad, _working_angle(mesh, transverse_rad, teeth), teeth)


def _mesh(statics: _Statics, number: int) -> Mesh:
    name = statics.contacts[number].mesh
    return next(mesh for mesh in statics.kinematics.gearbox.meshes if mesh.name == name)


def _working_angle(mesh: Mesh, transverse_rad: float, teeth: int) -> float:
    """Return the transverse working pressure angle in rad (ISO 21771).

    ``inv a_w = inv a_t + 2 tan a_n sum(x) / sum(z)``, internal teeth counted negative, by Newton's method: the
    involute function is convex, so that from the right all steps descend.
    """
    shift = sum(mesh.profile_shift or (0.0,))
    if shift == 0:
        return transverse_rad
    normal_rad = math.radians(mesh.pressure_angle_deg or 0.0)
    involute = math.tan(transverse_rad) - transverse_rad
    involute += 2 * math.tan(normal_rad) * shift / teeth if teeth else -involute
    if involute <= 0:
        raise TorqueError(
            f'mesh "{mesh.name}": with profile_shift = {list(mesh.profile_shift or ())} its gears have no common pitch '
            "point; correct the shifts (signs as in ISO 21771)."
        )
    angle = math.atan(math.cbrt(3 * involute) + involute)  # no less than the solution, as inv a > a^3 / 3
    for _ in range(60):
        step = (math.tan(angle) - angle - involute) / math.tan(angle) ** 2
        angle -= step
        if abs(step) < 1e-15:  # noqa: PLR2004
            break
    return angle


# ---- bearing loads: forces of the teeth in space, and a shaft in two bearings ---------------------------------------


def _bearing_loads(solution: _Solution) -> Iterator[BearingLoad]:
    for bearing in solution.statics.kinematics.gearbox.bearings:
        try:
            loads = {load.bearing: load for load in _reactions(solution, _borne(solution.statics, bearing))}
        except _OpenError as caught:
            status = str(caught)
            loads = {
                name: BearingLoad(bearing=name, radial_n=_UNKNOWN, axial_n=math.nan, status=status)
                for name in bearing.names
            }
        yield from (loads[name] for name in bearing.names)


def _rings(statics: _Statics, bearing: Bearing) -> set[str]:
    """Return the bodies a bearing stands between, all copies of a copied link."""
    kinematics = statics.kinematics
    links = (bearing.inner_ring, bearing.outer_ring)
    return {kinematics.bodies[name] for link in links for name in kinematics.gearbox.instances(link)}


def _borne(statics: _Statics, bearing: Bearing) -> str:
    """Return the body that a bearing holds in the frame, one that statics covers."""
    kinematics = statics.kinematics
    frame, copied = kinematics.mechanism.frame, kinematics.gearbox.copied
    for link in (bearing.inner_ring, bearing.outer_ring):
        if link in copied:
            raise _OpenError(f'"{link}" stands for {copied[link]} copies, whose places are not declared: not covered')
    rings = _rings(statics, bearing)
    if frame not in rings or len(rings) == 1:
        raise _OpenError(
            f"neither of its rings ({_listed(sorted(rings))}) is at rest while the other turns: not covered"
        )
    (body,) = rings - {frame}
    carried = [name for name, joint in kinematics.joints.items() if joint.carried_by == body]
    if carried:
        raise _OpenError(f'"{body}" carries {_listed(carried)}, whose loads it passes on: not covered')
    return body


def _reactions(solution: _Solution, body: str) -> tuple[BearingLoad, BearingLoad]:
    """Balance the tooth forces on a body in its two bearings.

    With force ``F`` and moment ``M`` of the teeth about the first bearing, the second one, ``l`` further along the
    axis ``d``, reacts across the axis with ``d x M / l``, and the first one with what is left of ``-F``.
    """
    statics = solution.statics
    (one, first_mm), (two, second_mm) = _supports(statics, body)
    points, forces = _acting(solution, body)
    axis, direction = _fixed_axis(statics, statics.kinematics.joints[body].axis)
    at_first = np.array(axis.through) + first_mm * direction
    second = np.cross(direction, np.cross(points - at_first, forces).sum(axis=0)) / (second_mm - first_mm)
    thrusts = forces @ direction
    first = thrusts.sum() * direction - forces.sum(axis=0) - second
    axial, status = _axial(statics, (one, two), thrusts)
    return (
        BearingLoad(bearing=one, radial_n=_vector(first), axial_n=axial[0], status=status),
        BearingLoad(bearing=two, radial_n=_vector(second), axial_n=axial[1], status=status),
    )


def _supports(statics: _Statics, body: str) -> tuple[tuple[str, float], tuple[str, float]]:
    """Return the names and positions in mm of the two bearings that hold a body."""
    holding = [bearing for bearing in statics.kinematics.gearbox.bearings if body in _rings(statics, bearing)]
    names = [name for bearing in holding for name in bearing.names]
    if len(names) != 2:  # noqa: PLR2004
        raise _OpenError(
            f'"{body}" runs in {count(len(names), "bearing")} ({_listed(names)}); statics settles exactly two: '
            "indeterminate"
        )
    others = set[str]().union(*(_rings(statics, bearing) for bearing in holding)) - {body}
    if others != {statics.kinematics.mechanism.frame}:
        raise _OpenError(f'"{body}" also runs in a bearing on a shaft that turns ({_listed(names)}): indeterminate')
    places = [place for bearing in holding for place in bearing.position_mm or ()]
    if len(places) < len(names):
        without = [name for bearing in holding if bearing.position_mm is None for name in bearing.names]
        raise _OpenError(f"position_mm of {_listed(without)} is not declared; add it")
    if places[0] == places[1]:
        raise _OpenError(f"{_listed(names)} sit in one place, position_mm = {places[0]:g}: indeterminate")
    return (names[0], places[0]), (names[1], places[1])


def _acting(solution: _Solution, body: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the meshes act on a body, (n, 3) mm, and with which forces, (n, 3) N."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for contact in kinematics.contacts:
        if len(contact.gears) == 1 and kinematics.bodies[contact.gears[0][0]] == body:
            raise _OpenError(f'mesh "{contact.mesh}" has a mate that is not declared, so its force has no direction')
    points, forces = [], []
    for number, contact in enumerate(statics.contacts):
        gears = [kinematics.bodies[link] for link, _ in contact.gears]
        if body in gears:
            point, force = _force(solution, number)
            points.append(point)
            forces.append(force if gears[0] == body else -force)
    return np.array(points).reshape(-1, 3), np.array(forces).reshape(-1, 3)


def _force(solution: _Solution, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pitch point of a contact in mm, and the force there on its first gear in N.

    With ``u`` the unit vector to the second axis, the pitch point lies ``a Z_1 / (Z_1 + Z_2)`` along it: beyond the
    pinion of an internal pair. The tangential force turns the first gear about its axis ``d``, the radial one
    parts the gears, and along ``d`` a right-handed helix adds ``-tan b`` times the force round ``d``.
    """
    statics, contact = solution.statics, solution.statics.contacts[number]
    name, mesh, load = f'mesh "{contact.mesh}"', _mesh(statics, number), solution.load(number)
    if contact.carrier != statics.kinematics.mechanism.frame:
        raise _OpenError(f'{name} is held by "{contact.carrier}", not by the frame: loads of planets are not covered')
    if load is None:
        raise _OpenError(f"the load of {name} is indeterminate")
    shared = [
        statics.kinematics.mechanism.shared_axis(statics.kinematics.bodies[link], contact.carrier) or ""
        for link, _ in contact.gears
    ]
    (axis, along), (other, along_other) = (_fixed_axis(statics, at) for at in shared)
    angles = _angles(statics, number, (_vector(along), _vector(along_other)))
    if angles is None or mesh.module_mm is None:
        raise _OpenError(f"{name}: a force needs module_mm, pressure_angle_deg and gears on parallel axes")
    if mesh.position_mm is None:
        raise _OpenError(f"{name}: position_mm is not declared; add it")
    if angles.helix_rad and mesh.hand is None:
        raise _OpenError(f"{name}: the hand of its helix is not declared; add that of its first gear")
    start = np.array(axis.through) + mesh.position_mm * along
    across = np.array(other.through) - start
    across -= across @ along * along
    apart_mm = _distance_mm(mesh, angles, float(np.linalg.norm(across)), (axis.name, other.name))
    unit = across / apart_mm
    teeth, teeth_other = (count for _, count in contact.gears)
    arm_mm = apart_mm * teeth / (teeth + teeth_other * round(float(along @ along_other)))
    round_n = 1e3 * float(load) * teeth / arm_mm  # along d x u, which turns about d where the arm points along u
    radial_n = math.copysign(abs(round_n) * math.tan(angles.working_rad), -angles.teeth)
    slant = math.tan(angles.helix_rad) * math.cos(angles.transverse_rad) / math.cos(angles.working_rad)
    thrust_n = math.copysign(1.0, arm_mm) * round_n * slant * (-1 if mesh.hand == "right" else 1)
    return start + arm_mm * unit, round_n * np.cross(along, unit) + radial_n * unit + thrust_n * along


def _fixed_axis(statics: _Statics, name: str) -> tuple[Axis, NDArray[np.float64]]:
    """Return an axis whose place is declared, and its direction."""
    axis = next(axis for axis in statics.kinematics.gearbox.axes if name in axis.instances())
    if axis.copies is not None:
        raise _OpenError(f'axis "{axis.name}" stands for {axis.copies} copies, whose places are not declared')
    if axis.through is None:
        raise _OpenError(f'axis "{name}": through is not declared; add a point of it in mm')
    return axis, np.array(statics.kinematics.mechanism.directions[name])


def _distance_mm(mesh: Mesh, angles: _Angles, apart_mm: float, axes: tuple[str, str]) -> float:
    """Return the distance of two axes, which has to be that of the gears: ``a = m Z cos a_t / (2 cos b cos a_w)``."""
    reference_mm = (mesh.module_mm or 0.0) * abs(angles.teeth) / (2 * math.cos(angles.helix_rad))
    working_mm = reference_mm * math.cos(angles.transverse_rad) / math.cos(angles.working_rad)
    if not working_mm or abs(apart_mm / working_mm - 1) > _APART:
        raise _OpenError(
            f'mesh "{mesh.name}": axes {_listed(axes)} lie {apart_mm:.6g} mm apart, but its teeth need '
            f"{working_mm:.6g} mm; correct through, module_mm or profile_shift"
        )
    return apart_mm


def _axial(statics: _Statics, names: tuple[str, str], thrusts: NDArray[np.float64]) -> tuple[tuple[float, float], str]:
    """Give the axial reaction to the one bearing that takes it."""
    reaction = -float(thrusts.sum())
    if abs(reaction) <= _NO_THRUST * np.abs(thrusts).sum():
        return (0.0, 0.0), "solved"
    able = {name for bearing in statics.kinematics.gearbox.bearings for name in bearing.takes_axial}
    taking = [name in able for name in names]
    if sum(taking) == 1:
        return (reaction * taking[0], reaction * taking[1]), "solved"
    problem = "both take it: indeterminate" if all(taking) else "takes_axial names neither; add the one that does"
    return (math.nan, math.nan), f"of {_listed(names)} one has to take {abs(reaction):.4g} N along the axis; {problem}"


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) + 0.0 for value in values)  # no minus zero
    return (x, y, z)


def _checked(kinematics: Kinematics, link: str, torque: object) -> Fraction | None:
    gearbox = kinematics.gearbox
    if link not in kinematics.bodies:
        raise TorqueError(
            f'torques: gearbox "{gearbox.name}" has no link "{link}"{closest(link, list(kinematics.links))}'
        )
    if kinematics.bodies[link] == kinematics.mechanism.frame:
        raise TorqueError(
            f'torques: "{link}" belongs to the frame "{gearbox.frame}", which always holds what is left; leave it out '
            "and read frame_torque_nm."
        )
    try:
        kinematics.spin(link)
    except GearboxError:
        raise TorqueError(
            f'torques: the axis of "{link}" turns with its carrier in another direction, so a torque about it comes '
            "from no fixed place; put the torque on a link whose axis rests in the frame."
        ) from None
    if torque is None:
        return None
    if isinstance(torque, bool) or not isinstance(torque, Real) or not math.isfinite(torque):
        raise TorqueError(
            f'torques: "{link}" = {torque!r} is not a finite number of N m; give one, or None where the link takes '
            "the balance."
        )
    return Fraction(torque) if isinstance(torque, int | Fraction) else Fraction(float(torque))


def _efficiencies(kinematics: Kinematics, given: float | Mapping[str, float]) -> tuple[Fraction, ...]:
    contacts = _pairs(kinematics)
    meshes = list(dict.fromkeys(contact.mesh for contact in contacts))
    named = given if isinstance(given, Mapping) else dict.fromkeys(meshes, given)
    for mesh, part in named.items():
        if mesh not in meshes:
            raise TorqueError(f'mesh_efficiency: no mesh "{mesh}" of two gears{closest(mesh, meshes)}')
        if isinstance(part, bool) or not isinstance(part, Real) or not 0 < part <= 1:
            raise TorqueError(f'mesh_efficiency: "{mesh}" = {part!r} is not above 0 and at most 1; 1 loses nothing.')
    return tuple(Fraction(float(named.get(contact.mesh, 1.0))) for contact in contacts)


def _pairs(kinematics: Kinematics) -> tuple[Contact, ...]:
    return tuple(contact for contact in kinematics.contacts if len(contact.gears) == 2)  # noqa: PLR2004


def _own_axis(statics: _Statics, link: str) -> Vector:
    mechanism = statics.kinematics.mechanism
    return mechanism.directions[mechanism.joints[mechanism.bodies[link]].axis]


def _axis_on(statics: _Statics, link: str, carrier: str) -> Vector:
    mechanism = statics.kinematics.mechanism
    return mechanism.directions[mechanism.shared_axis(mechanism.bodies[link], carrier) or ""]


def _reaction(torques: Iterable[tuple[float, Vector]]) -> Vector:
    """Return minus the sum of torques about their directions."""
    x, y, z = 0.0, 0.0, 0.0
    for torque, direction in torques:
        x, y, z = x - torque * direction[0], y - torque * direction[1], z - torque * direction[2]
    return (x, y, z)


def _times(a: Fraction | None, b: Fraction) -> Fraction | None:
    return None if a is None else a * b


def _float(value: Fraction | None) -> float:
    return math.nan if value is None else float(value)


def _watts(power: Fraction | None) -> float:
    """Turn N m times turns a second into W."""
    return 2 * math.pi * _float(power)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f'"{name}"' for name in dict.fromkeys(names))


def _numbers(given: Mapping[str, Fraction]) -> str:
    return ", ".join(f'"{link}" = {float(torque):g}' for link, torque in given.items())


# ---- rational linear algebra: forms are sparse rows, each solved for one of their names ---------------------------


def _load(number: int) -> str:
    """Name the unknown tooth load of a contact; no link is called so."""
    return f"\0{number}"


def _term(link: str, torque: Fraction | None, factor: Fraction) -> Form:
    return {link: factor} if torque is None else {_CONSTANT: torque * factor}


def _add(form: Form, more: Form) -> None:
    for name, factor in more.items():
        form[name] = form.get(name, _ZERO) + factor


def _solve(equations: Iterable[Form]) -> tuple[dict[str, Form], list[Fraction]]:
    """Solve ``form = 0`` for all: unknowns by those left open, and what is left over of each equation."""
    solved: dict[str, Form] = {}
    left_over = [_join(form, solved) for form in equations]
    return solved, left_over


def _join(form: Form, solved: dict[str, Form], *, last: Sequence[str] = ()) -> Fraction:
    """Add the equation ``form = 0``, solved for an unknown that comes late in `last`.

    Returns the constant of the form where no unknown is left to satisfy it, otherwise zero.
    """
    left = reduced(form, solved)
    unknowns = [name for name in left if name != _CONSTANT]
    if not unknowns:
        return left.get(_CONSTANT, _ZERO)
    unknown = max(unknowns, key=last.index) if last else unknowns[0]
    add_pivot(solved, left, unknown)
    return _ZERO


def _determined(solved: Mapping[str, Form]) -> dict[str, Fraction]:
    """Return the unknowns whose expression holds no other unknown."""
    return {name: terms.get(_CONSTANT, _ZERO) for name, terms in solved.items() if set(terms) <= {_CONSTANT}}
