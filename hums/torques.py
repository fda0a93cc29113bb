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
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Real
from typing import NoReturn

from hums.declared import closest
from hums.gearbox import GearboxError, Mesh, Vector
from hums.kinematics import Kinematics
from hums.mechanism import Contact

__all__ = ["Branch", "ExternalTorque", "ToothForces", "ToothLoad", "TorqueError", "Torques", "solve_torques"]

Form = dict[
    str, Fraction
]  # a linear form in joint rates by body, or in unknown torques by link and tooth loads by `_load`
Drivers = tuple[int | None, ...]  # of each contact the gear that drives, 0 or 1; None: nothing is lost there
_CONSTANT = ""  # the key of a form's constant term; no link has an empty name
_ZERO = Fraction(0)
_ONE = Fraction(1)
_ROUNDING = Fraction(1, 10**9)  # torques given as decimals balance to this part of the largest
_PARALLEL = 1e-12


class TorqueError(ValueError):
    """Torques that do not balance, that nothing can take, or that cannot be told apart."""


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
class Torques:
    """Static equilibrium of a gearbox under load, and the flow of power through it.

    Attributes
    ----------
    external : torques on the links that were named, given ones and those that take the balance
    frame_torque_nm : (3,) N m
        What holds the frame: the reaction to all external torques, in the declared coordinates.
    tooth_loads : one for each contact of two gears
    branches : what the meshes put on each link that turns about an axis at rest
    input_power_w, output_power_w : float, W
        What flows in by all links together, and what flows out.
    efficiency : float or None
        Output over input; None where no power flows in.
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
    a mesh; without ``helix_angle_deg`` its teeth are straight. Bearing loads would also need where along its axis
    each mesh and each bearing sits, which a gearbox file does not say.

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
    sharing = _sharing(statics)
    drivers, values = _equilibrium(statics, sharing)
    return _result(statics, drivers, values)


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
    def frame(self) -> str:
        return self.kinematics.bodies[self.kinematics.gearbox.frame]

    @cached_property
    def directions(self) -> dict[str, Vector]:
        gearbox = self.kinematics.gearbox
        return {name: gearbox.direction(axis.name) for axis in gearbox.axes for name in axis.instances()}

    @cached_property
    def turns(self) -> tuple[Fraction, ...]:
        """Speed of each contact's first gear relative to the carrier."""
        return tuple(self.speed(contact.gears[0][0], contact.carrier) for contact in self.contacts)

    @property
    def largest(self) -> Fraction:
        return max((abs(torque) for torque in self.torques.values() if torque is not None), default=_ZERO)

    def speed(self, link: str, seen_from: str | None = None) -> Fraction:
        form = self.kinematics.spin(link, seen_from=seen_from)
        return sum((factor * self.rates[body] for body, factor in form.items()), _ZERO)

    def passed_on(self, number: int, driver: int | None) -> tuple[Fraction, Fraction]:
        """Part of the tooth load that reaches each of the two gears of a contact."""
        driven = _ONE if driver is None else self.efficiencies[number]
        return (driven, _ONE) if driver == 1 else (_ONE, driven)

    def row(self, number: int, driver: int | None) -> Form:
        """Torque on each turning pair by one unit of tooth load."""
        contact, row = self.contacts[number], Form()
        for (link, teeth), part in zip(contact.gears, self.passed_on(number, driver), strict=True):
            for body, factor in self.kinematics.spin(link, seen_from=contact.carrier).items():
                row[body] = row.get(body, _ZERO) + teeth * part * factor
        return row

    def equations(self, drivers: Drivers) -> list[Form]:
        """Equilibrium of every turning pair."""
        forms: dict[str, Form] = {body: {} for body in self.kinematics.joints}
        for link, torque in self.torques.items():
            for body, factor in self.kinematics.spin(link).items():
                _add(forms[body], _term(link, torque, factor))
        for number, driver in enumerate(drivers):
            for body, factor in self.row(number, driver).items():
                _add(forms[body], {number: factor})
        return list(forms.values())

    def drivers(self, values: Mapping[str, Fraction]) -> Drivers:
        """Find the gear that drives each contact that loses power."""
        found: list[int | None] = []
        for number, contact in enumerate(self.contacts):
            loses = self.efficiencies[number] < 1 and self.turns[number] != 0
            if loses and number not in values:
                raise TorqueError(
                    f'mesh "{contact.mesh}": its load is indeterminate, and so is its loss; declare meshes that share '
                    'a load as copies of one axis, or give it mesh_efficiency={"' + contact.mesh + '": 1.0}.'
                )
            flow = self.flow(number, values) if loses else None
            found.append(_driver(flow))
        return tuple(found)

    def flow(self, number: int, values: Mapping[str, Fraction]) -> Fraction | None:
        """Power from the first to the second gear of a contact, relative to its carrier and at the driver."""
        if number not in values:
            return None
        return -self.contacts[number].gears[0][1] * values[number] * self.turns[number]


def _check_balance(statics: _Statics) -> None:
    """Hold that each degree of freedom is balanced without losses, and that None says no more than that."""
    kinematics, solved = statics.kinematics, dict[str, Form]()
    moved = {link: _substituted(kinematics.spin(link), kinematics.pivots) for link in statics.torques}
    for free in kinematics.free:
        form = Form()
        scale = _ZERO
        for link, torque in statics.torques.items():
            factor = moved[link].get(free, _ZERO)
            _add(form, _term(link, torque, factor))
            scale = max(scale, abs((torque or _ZERO) * factor))
        if abs(_join(form, solved)) > _ROUNDING * scale:
            _raise_unbalanced(statics, free)
    values = _determined(solved)
    unsettled = [link for link, torque in statics.torques.items() if torque is None and link not in values]
    if unsettled:
        raise TorqueError(
            f'gearbox "{kinematics.gearbox.name}": the torques of {_listed(unsettled)} cannot be told apart, because '
            f"{kinematics.dof} degree(s) of freedom settle as many torques; give that of "
            f'"{unsettled[-1]}" as a number, 0 where nothing loads it.'
        )


def _raise_unbalanced(statics: _Statics, free: str) -> NoReturn:
    """Say what unbalances the motion of the free body `free`, and which link could take it."""
    kinematics = statics.kinematics
    moving = {
        body: joint.carried_by
        for body, joint in kinematics.joints.items()
        if free in _substituted({body: _ONE}, kinematics.pivots)
    }
    loaded = {kinematics.bodies[link]: link for link, torque in statics.torques.items() if torque}
    given = [f'"{link}" = {float(torque):g}' for link, torque in statics.torques.items() if torque]
    named = {kinematics.bodies[link] for link, torque in statics.torques.items() if torque != 0}
    at_rest = [body for body, carrier in moving.items() if carrier == statics.frame and body not in named]
    culprits = [link for body, link in loaded.items() if body in moving]
    start = f'gearbox "{kinematics.gearbox.name}": the torques {", ".join(given)} N m do not balance'
    if len(culprits) > 1:
        raise TorqueError(f'{start}; let one of them follow from the others, as in torques={{"{culprits[-1]}": None}}.')
    if not at_rest:
        raise TorqueError(
            f"{start}, because that on {_listed(culprits)} has no path to another link; declare the mesh that carries "
            "it, or leave it out."
        )
    other = free if free in at_rest else at_rest[-1]
    raise TorqueError(
        f"{start}, and no link takes what is left of the {kinematics.dof} degree(s) of freedom; let one take it, as "
        f'in torques={{"{other}": None}}.'
    )


def _sharing(statics: _Statics) -> list[Form]:
    """Equations by which the copies of a mesh share equally, where equilibrium alone leaves their loads open."""
    lossless = (None,) * len(statics.contacts)
    values = _determined(_solve(statics.equations(lossless))[0])
    first: dict[str, int] = {}
    shared = []
    for number, contact in enumerate(statics.contacts):
        if number not in values:
            one = first.setdefault(contact.mesh, number)
            shared += [{number: _ONE, one: Fraction(-1)}] if one != number else []
    left_over = _solve([*statics.equations(lossless), *shared])[1][len(statics.kinematics.joints) :]
    if any(abs(rest) > _ROUNDING * statics.largest for rest in left_over):
        copies = [link for link in statics.torques if link not in statics.kinematics.gearbox.copied]
        raise TorqueError(
            f"the torques on {_listed(copies)} load copies of one axis unequally, so they cannot share equally; "
            "put the same torque on each copy, or declare the copies as axes of their own."
        )
    return shared


def _equilibrium(statics: _Statics, sharing: Sequence[Form]) -> tuple[Drivers, dict[str, Fraction]]:
    """Solve for the loads until the gears that drive are those that were taken to drive."""
    drivers: Drivers = (None,) * len(statics.contacts)
    tried: list[Drivers] = []
    while drivers not in tried:
        tried.append(drivers)
        solved, left_over = _solve([*statics.equations(drivers), *sharing])
        values = _determined(solved)
        settled = all(link in values for link, torque in statics.torques.items() if torque is None)
        lossy = any(driver is not None for driver in drivers)
        if lossy and (not settled or any(abs(rest) > _ROUNDING * statics.largest for rest in left_over)):
            raise TorqueError(
                "with the losses of the meshes no torques balance; write None for the links that take the balance "
                f"({statics.kinematics.dof} can), or raise mesh_efficiency."
            )
        found = statics.drivers(values)
        if found == drivers:
            return drivers, values
        drivers = found
    names = [
        statics.contacts[number].mesh for number, (a, b) in enumerate(zip(drivers, tried[-1], strict=True)) if a != b
    ]
    raise TorqueError(
        f"the gearbox locks itself: neither gear can drive the meshes {_listed(names)} at the speeds, torques and "
        "mesh_efficiency given; raise the efficiency, or let the power flow the other way."
    )


def _result(statics: _Statics, drivers: Drivers, values: Mapping[str, Fraction]) -> Torques:
    settled = {link: values[link] if torque is None else torque for link, torque in statics.torques.items()}
    power = {link: torque * statics.speed(link) for link, torque in settled.items()}
    external = tuple(
        ExternalTorque(link=link, torque_nm=float(torque), power_w=_watts(power[link]))
        for link, torque in settled.items()
    )
    vectors = [
        (load.torque_nm, statics.directions[statics.kinematics.joints[statics.kinematics.bodies[load.link]].axis])
        for load in external
    ]
    loads = tuple(_tooth_load(statics, number, drivers, values) for number in range(len(statics.contacts)))
    branches = tuple(_branches(statics, drivers, values))
    income = sum((p for p in power.values() if p > 0), _ZERO)
    outgo = -sum((p for p in power.values() if p < 0), _ZERO)
    indeterminate = tuple(dict.fromkeys(load.mesh for load in loads if not load.determinate))
    known = income > 0 and not indeterminate
    gearing: dict[str, float] = {}
    for load in loads:
        gearing[load.mesh] = gearing.get(load.mesh, 0.0) + abs(load.gearing_power_w)
    return Torques(
        external=external,
        frame_torque_nm=_opposite(vectors),
        tooth_loads=loads,
        branches=branches,
        input_power_w=_watts(income),
        output_power_w=_watts(outgo),
        efficiency=float(outgo / income) if income > 0 else None,
        circulating_ratio=max((abs(b.power_w) for b in branches), default=0.0) / _watts(income) if known else None,
        gearing_ratio=max(gearing.values(), default=0.0) / _watts(income) if known else None,
        indeterminate=indeterminate,
    )


def _tooth_load(statics: _Statics, number: int, drivers: Drivers, values: Mapping[str, Fraction]) -> ToothLoad:
    contact = statics.contacts[number]
    load = values.get(number)
    flow = statics.flow(number, values)
    driver = _driver(flow)
    (first, second), parts = contact.gears, statics.passed_on(number, drivers[number])
    torques = tuple(_float(_times(load, teeth * part)) for (_, teeth), part in zip(contact.gears, parts, strict=True))
    lost = drivers[number] is not None
    axes = [_direction(statics, link, contact.carrier) for link, _ in contact.gears]
    return ToothLoad(
        mesh=contact.mesh,
        gears=(first[0], second[0]),
        carrier=contact.carrier,
        determinate=load is not None,
        torques_nm=(torques[0], torques[1]),
        carrier_torque_nm=_opposite(zip(torques, axes, strict=True)),
        gearing_power_w=_watts(flow),
        absolute_power_w=_absolute_power(statics, number, drivers, values),
        driver=None if driver is None else contact.gears[driver][0],
        loss_w=_watts((1 - statics.efficiencies[number]) * abs(flow)) if lost and flow is not None else 0.0,
        forces=_forces(statics, number, load, axes),
    )


def _absolute_power(statics: _Statics, number: int, drivers: Drivers, values: Mapping[str, Fraction]) -> float | None:
    contact, joints = statics.contacts[number], statics.kinematics.joints
    if contact.carrier == statics.frame:
        return _watts(statics.flow(number, values))
    holder = joints[contact.carrier]
    if holder.carried_by != statics.frame:
        return None
    parts = statics.passed_on(number, drivers[number])
    for place, (link, teeth) in enumerate(contact.gears):
        body = statics.kinematics.bodies[link]
        if body == statics.frame or joints[body].axis == holder.axis:
            leaving = _times(values.get(number), -teeth * parts[place] * statics.speed(link))
            return _watts(_times(leaving, Fraction(1 if place == 0 else -1)))
    return None


def _branches(statics: _Statics, drivers: Drivers, values: Mapping[str, Fraction]) -> Iterator[Branch]:
    """Sum what the meshes put on each body that turns about an axis at rest."""
    for body, joint in statics.kinematics.joints.items():
        if joint.carried_by != statics.frame:
            continue
        for numbers in _places(statics, body):
            rows = [statics.row(number, drivers[number]).get(body, _ZERO) for number in numbers]
            loads = [_times(values.get(number), factor) for number, factor in zip(numbers, rows, strict=True)]
            torque = None if None in loads else sum((load for load in loads if load is not None), _ZERO)
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
        if body in gears:
            marks = {f"mesh {contact.mesh}"}
        elif contact.carrier == body:
            planets = {gear for gear in gears if gear in joints and joints[gear].carried_by == body}
            marks = {f"mesh {contact.mesh}", *(f"planet {planet}" for planet in planets)}
        else:
            continue
        joined = [group for group in groups if group[0] & marks]
        groups = [group for group in groups if group not in joined]
        groups.append(
            (marks.union(*(group[0] for group in joined)), [n for group in joined for n in group[1]] + [number])
        )
    return [numbers for _, numbers in groups]


def _forces(statics: _Statics, number: int, load: Fraction | None, axes: Sequence[Vector]) -> ToothForces | None:
    """Resolve a tooth load at the working pitch point of a pair with parallel axes (ISO 21771).

    With ``d = m Z / cos b`` the transverse force at the base cylinder is ``2 Z L / (d cos a_t)``; the working
    angle ``a_w`` splits it, ``inv a_w = inv a_t + 2 tan a_n sum(x) / sum(z)``, internal teeth counted negative.
    """
    contact = statics.contacts[number]
    mesh = next(mesh for mesh in statics.kinematics.gearbox.meshes if mesh.name == contact.mesh)
    along = sum(a * b for a, b in zip(*axes, strict=True))
    if mesh.module_mm is None or mesh.pressure_angle_deg is None or load is None or abs(abs(along) - 1) > _PARALLEL:
        return None
    (_, first), (_, second) = contact.gears
    internal = first * second * along < 0
    teeth = abs(first) + abs(second) if not internal else -abs(abs(first) - abs(second))
    helix, normal = math.radians(mesh.helix_angle_deg or 0.0), math.radians(mesh.pressure_angle_deg)
    transverse = math.atan(math.tan(normal) / math.cos(helix))
    reference_n = 2e3 * abs(float(load)) * math.cos(helix) / mesh.module_mm  # tangential, at the reference cylinder
    base_n = reference_n / math.cos(transverse)
    working = _working_angle(mesh, transverse, normal, teeth)
    return ToothForces(
        tangential_n=base_n * math.cos(working),
        radial_n=base_n * math.sin(working),
        axial_n=reference_n * abs(math.tan(helix)),
    )


def _working_angle(mesh: Mesh, transverse_rad: float, normal_rad: float, teeth: int) -> float:
    """Return the transverse working pressure angle in rad, by Newton's method on the involute function."""
    shift = sum(mesh.profile_shift or (0.0,))
    if shift == 0:
        return transverse_rad
    involute = math.tan(transverse_rad) - transverse_rad + 2 * math.tan(normal_rad) * shift / teeth if teeth else 0.0
    if involute <= 0:
        raise TorqueError(
            f'mesh "{mesh.name}": with profile_shift = {list(mesh.profile_shift or ())} the gears have no common '
            "pitch point; check the signs of the shifts (internal gears as in ISO 21771)."
        )
    angle = math.cbrt(3 * involute)  # the involute function is convex, so Newton's steps descend from the right
    for _ in range(50):
        step = (math.tan(angle) - angle - involute) / math.tan(angle) ** 2
        angle -= step
        if abs(step) < 1e-15:  # noqa: PLR2004
            break
    return angle


def _checked(kinematics: Kinematics, link: str, torque: object) -> Fraction | None:
    gearbox = kinematics.gearbox
    if link not in kinematics.bodies:
        raise TorqueError(
            f'torques: gearbox "{gearbox.name}" has no link "{link}"{closest(link, list(kinematics.links))}'
        )
    if kinematics.bodies[link] == kinematics.bodies[gearbox.frame]:
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
    return tuple(Fraction(named.get(contact.mesh, 1)) for contact in contacts)


def _pairs(kinematics: Kinematics) -> tuple[Contact, ...]:
    return tuple(contact for contact in kinematics.contacts if len(contact.gears) == 2)  # noqa: PLR2004


def _direction(statics: _Statics, link: str, carrier: str) -> Vector:
    """Return the axis a gear shares with its carrier; the frame, which has none of its own, lends the carrier's."""
    body, joints = statics.kinematics.bodies[link], statics.kinematics.joints
    holder = joints.get(carrier)
    held_by_gear = holder is not None and holder.carried_by == body
    return statics.directions[holder.axis if holder is not None and held_by_gear else joints[body].axis]


def _opposite(torques: Iterable[tuple[float, Vector]]) -> Vector:
    """Return minus the sum of torques along their directions."""
    x, y, z = 0.0, 0.0, 0.0
    for torque, direction in torques:
        x, y, z = x - torque * direction[0], y - torque * direction[1], z - torque * direction[2]
    return (x, y, z)


def _driver(flow: Fraction | None) -> int | None:
    return None if not flow else int(flow < 0)


def _term(link: str, torque: Fraction | None, factor: Fraction) -> Form:
    return {link: factor} if torque is None else {_CONSTANT: torque * factor}


def _times(a: Fraction | None, b: Fraction) -> Fraction | None:
    return None if a is None else a * b


def _float(value: Fraction | None) -> float:
    return math.nan if value is None else float(value)


def _watts(power: Fraction | None) -> float:
    """Turn N m times turns a second into W."""
    return 2 * math.pi * _float(power)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f'"{name}"' for name in dict.fromkeys(names))


def _add(form: Form, more: Mapping[str, Fraction]) -> None:
    for key, factor in more.items():
        form[key] = form.get(key, _ZERO) + factor


def _solve(equations: Iterable[Form]) -> tuple[dict[str, Form], list[Fraction]]:
    """Solve ``form = 0`` for every form: unknowns by those left open, and what is left over of each equation."""
    solved: dict[str, Form] = {}
    left_over = [_join(form, solved) for form in equations]
    return solved, left_over


def _join(form: Form, solved: dict[str, Form]) -> Fraction:
    """Add the equation ``form = 0``; return its constant where no unknown is left to satisfy it."""
    left = _substituted(form, solved)
    unknown = next((key for key in left if key != _CONSTANT), None)
    if unknown is None:
        return left.get(_CONSTANT, _ZERO)
    expression = {key: -factor / left[unknown] for key, factor in left.items() if key != unknown}
    for key, terms in solved.items():
        if unknown in terms:
            solved[key] = _substituted(terms, {unknown: expression})
    solved[unknown] = expression
    return _ZERO


def _substituted(form: Mapping[str, Fraction], solved: Mapping[str, Form]) -> Form:
    result = Form()
    for key, factor in form.items():
        _add(result, {other: factor * share for other, share in solved.get(key, {key: _ONE}).items()})
    return {key: factor for key, factor in result.items() if factor}


def _determined(solved: Mapping[str, Form]) -> dict[str, Fraction]:
    """Return the unknowns whose expression holds no other unknown."""
    return {key: terms.get(_CONSTANT, _ZERO) for key, terms in solved.items() if set(terms) <= {_CONSTANT}}
