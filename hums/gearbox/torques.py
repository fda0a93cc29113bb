"""Static torques, tooth loads, forces and power of a mechanism, by virtual work.

`hums.gearbox.statics` sets up the equations of `solve_torques` and solves them in rational arithmetic;
`hums.gearbox.tooth_forces` derives forces and bearing loads, this module powers, which balance to rounding.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

from hums.gearbox.components import Vector, closest
from hums.gearbox.kinematics import Kinematics
from hums.gearbox.model import GearboxError
from hums.gearbox.rational import ZERO
from hums.gearbox.statics import Solution, Statics, TorqueError, gear_pairs, solve_equilibrium
from hums.gearbox.tooth_forces import BearingLoad, ToothForces, bearing_loads, tooth_forces
from signals._validation import brief, checked, is_float


@dataclass(frozen=True, kw_only=True)
class ExternalTorque:
    """An external torque on a link.

    Attributes
    ----------
    link : str
        Link on which it acts.
    torque_nm : float
        Torque in N m about the link's declared axis.
    power_w : float
        Power in W, positive into the gearbox.
    """

    link: str
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class ToothLoad:
    """Load of one contact of a mesh, one per copy of a planet; NaN if not `determinate`.

    Attributes
    ----------
    mesh : str
        Name of the mesh.
    gears : (str, str)
        Links of the gears, in the order of declaration.
    carrier : str
        Carrier of the contact.
    determinate : bool
        Whether statics determines the load.
    torques_nm : (float, float)
        Torque on each gear about its own axis in N m, with the loss deducted on the driven gear.
    carrier_torque_nm : (3,) tuple of float
        Torque on the carrier in N m, the reaction to both gears, with the axis direction of the first copy for all.
    gearing_power_w : float
        Power in W from the first gear to the second, relative to the carrier, at the driving gear. The loss of a mesh
        is a fraction of it.
    absolute_power_w : float or None
        The same power in W relative to the frame, at the gear that rotates about the carrier's axis. None if there is
        no such gear (between planets), or the axis of the carrier itself moves, so that it depends on position.
    driver : str or None
        The driving gear relative to the carrier; None if no power flows.
    loss_w : float
        Power loss in W.
    forces : ToothForces or None
        Tooth forces; None if the mesh declares no module or pressure angle, or its axes are not parallel.
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
    """A power branch: meshes that act together on a link whose axis is fixed in the frame.

    A gear has one branch per mesh, a carrier one per set of planets, with all copies together. The torques of a link's
    branches and its external torque sum to zero.

    Attributes
    ----------
    link : str
        Link on which the meshes act.
    through : tuple of str
        Names of the meshes.
    torque_nm : float
        Torque on the link in N m.
    power_w : float
        Power in W, positive into the link.
    """

    link: str
    through: tuple[str, ...]
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class Torques:
    """The static equilibrium of a gearbox under load, and the power flow through it.

    Attributes
    ----------
    external : tuple of ExternalTorque
        Given and solved torques of the named links.
    frame_torque_nm : (3,) tuple of float
        Torque that holds the frame, the reaction to all external torques, in N m in the declared coordinates.
    tooth_loads : tuple of ToothLoad
        One per contact of two gears.
    branches : tuple of Branch
        Torque and power of the meshes on each link whose axis is fixed in the frame.
    bearing_loads : tuple of BearingLoad
        One per declared bearing, in the order of declaration.
    input_power_w, output_power_w : float
        Sum of the powers into and out of the gearbox in W.
    efficiency : float or None
        Output over input power; None if no power flows in, 0 if every link drives (self-locking).
    circulating_ratio : float or None
        Power of the largest branch over the input power: 1 for a single path, below 1 for split power, above 1 for
        circulating power. None without input power or with an indeterminate load.
    gearing_ratio : float or None
        Largest power of a mesh relative to its carrier, with all its copies, over the input power. None as above.
    indeterminate : tuple of str
        Names of the meshes whose loads statics does not determine.

    Examples
    --------
    >>> import hums
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99"))
    >>> torques = hums.solve_torques(kinematics, {"sun": 27.0, "carrier": None})
    >>> round(torques.torques_nm["carrier"], 9), round(torques.frame_torque_nm[0], 9)
    (-126.0, 99.0)
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
        """External torque of each named link, in N m."""
        return {load.link: load.torque_nm for load in self.external}

    @property
    def losses_w(self) -> dict[str, float]:
        """Power loss of each mesh in W, all its copies together."""
        losses: dict[str, float] = {}
        for load in self.tooth_loads:
            losses[load.mesh] = losses.get(load.mesh, 0.0) + load.loss_w
        return losses

    def at(self, mesh: str) -> tuple[ToothLoad, ...]:
        """Return the tooth loads of one mesh, one per copy of a planet.

        Parameters
        ----------
        mesh : str
            Name of a mesh of two gears.

        Returns
        -------
        tuple of ToothLoad

        Raises
        ------
        TorqueError
            If there is no such mesh.
        """
        found = tuple(load for load in self.tooth_loads if load.mesh == mesh)
        if not found:
            names = list(dict.fromkeys(load.mesh for load in self.tooth_loads))
            raise TorqueError(f'no mesh "{mesh}" of two gears{closest(mesh, names)}')
        return found


# ---- Power flow: the load of each contact, and the branches of power between the links -------------------------------
# References
# ----------
# H. W. Mueller, Epicyclic Drive Trains, Wayne State University Press (1982): power relative to the carrier,
# circulating power.


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
    """Convert N m rev/s to W, None to NaN."""
    return 2 * math.pi * _float(power)


def _absolute_power(solution: Solution, number: int) -> float | None:
    """Return the absolute power from the first to the second gear, at a gear that rotates about the carrier's axis."""
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
    """Return the torque of some contacts on a body; None if one of their loads is indeterminate."""
    torque = ZERO
    for number in numbers:
        factor = solution.generalized_torque(number).get(body, ZERO)  # zero for the carrier of a mesh between planets
        load = solution.load(number) if factor else ZERO
        if load is None:
            return None
        torque += load * factor
    return torque


def _contact_groups(statics: Statics, body: str) -> list[list[int]]:
    """Return the contacts that act on a body, grouped by mesh for a gear and by planet set for a carrier."""
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


# ---- Torques ---------------------------------------------------------------------------------------------------------


@checked
def solve_torques(
    kinematics: Kinematics,
    torques: Mapping[str, float | Fraction | None],
    *,
    speeds: Mapping[str, float | Fraction] | None = None,
    mesh_efficiency: float | Mapping[str, float] = 1.0,
) -> Torques:
    """Solve the static equilibrium of a mechanism for its unknown torques, tooth loads, power flow and bearing loads.

    Planets of one ``copies`` group share equally if statics alone is indeterminate. Loads that distinct meshes can
    share in any proportion are reported as indeterminate. A mesh whose mate is unknown transmits no load: apply the
    mate's torque to its gear. Tooth forces need ``module_mm`` (in the normal section) and ``pressure_angle_deg`` of
    a mesh; without ``helix_angle_deg`` its teeth are straight.

    Bearing loads follow from statics for a shaft whose axis is fixed in the frame and that runs in exactly two bearings
    to the frame. They need ``through`` (mm) of its axis and those of its mates, ``position_mm`` of its bearings and
    meshes, the inputs of the tooth forces, and for helical teeth ``hand`` and the bearing in ``takes_axial``. External
    torques are assumed to be pure couples; weights, and axial forces induced in angular-contact bearings by radial
    loads, are neglected. Shafts that planets load or that carry other shafts are not covered. The ``status`` of a
    bearing load states why it is not determined.

    Parameters
    ----------
    kinematics : Kinematics
        From `solve_kinematics`.
    torques : mapping of str to float, Fraction or None
        External torque of each loaded link in N m, along its declared axis, positive in the sense of positive speed.
        None: unknown, for at most as many links as there are degrees of freedom. Links that are not named carry no
        external torque; the frame takes the reaction.
    speeds : mapping of str to float or Fraction, optional
        Speeds of links in rev/s, as many as there are degrees of freedom. Default: 1 rev/s for the gearbox's reference.
    mesh_efficiency : float or mapping of str to float
        Efficiency of all meshes or of meshes by name, relative to the carrier, above 0 and at most 1; a mesh that the
        mapping does not name is lossless.

    Returns
    -------
    Torques

    Raises
    ------
    TorqueError
        If torques do not balance, there are more unknown torques than statics can determine, or losses make the
        mechanism self-locking.
    GearboxError
        If speeds are missing or contradictory, as in `Kinematics.rates`.

    Examples
    --------
    >>> import hums
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
    >>> torques = hums.solve_torques(kinematics, {"input": 437.0, "output": None}, mesh_efficiency=0.99)
    >>> round(torques.torques_nm["output"], 6), round(67 * 61 * -(0.99**2), 6)
    (-4005.6687, -4005.6687)
    >>> round(torques.efficiency, 6)
    0.9801
    """
    statics = Statics(
        kinematics,
        {link: _checked(kinematics, link, torque) for link, torque in torques.items()},
        kinematics.rates(speeds),
        _efficiencies(kinematics, mesh_efficiency),
    )
    return _result(solve_equilibrium(statics))


def _checked(kinematics: Kinematics, link: str, torque: object) -> Fraction | None:
    """Return a valid external torque as a fraction, None if unknown."""
    gearbox = kinematics.gearbox
    if link not in kinematics.bodies:
        raise TorqueError(
            f'torques: gearbox "{gearbox.name}" has no link "{link}"{closest(link, list(kinematics.links))}'
        )
    if kinematics.bodies[link] == kinematics.mechanism.frame:
        raise TorqueError(
            f'torques: "{link}" belongs to the frame "{gearbox.frame}", which takes the reaction; omit it and read '
            "frame_torque_nm."
        )
    try:
        kinematics.spin(link)
    except GearboxError:
        raise TorqueError(
            f'torques: the axis of "{link}" rotates with its carrier in another direction, so an external torque about '
            "it has no fixed direction; apply the torque to a link whose axis is fixed in the frame."
        ) from None
    if torque is None:
        return None
    if not is_float(torque) or not math.isfinite(torque):
        raise TorqueError(
            f'torques: "{link}" = {brief(torque)} is not a finite number of N m; give one, or None if it is unknown.'
        )
    return Fraction(torque) if isinstance(torque, int | Fraction) else Fraction(float(torque))


def _efficiencies(kinematics: Kinematics, given: float | Mapping[str, float]) -> tuple[Fraction, ...]:
    """Return the efficiency of each contact of two gears."""
    contacts = gear_pairs(kinematics)
    meshes = list(dict.fromkeys(contact.mesh for contact in contacts))
    named = given if isinstance(given, Mapping) else dict.fromkeys(meshes, given)
    for mesh, efficiency in named.items():
        if mesh not in meshes:
            raise TorqueError(f'mesh_efficiency: no mesh "{mesh}" of two gears{closest(mesh, meshes)}')
        if not is_float(efficiency) or not 0 < efficiency <= 1:
            raise TorqueError(
                f'mesh_efficiency: "{mesh}" = {brief(efficiency)} is not above 0 and at most 1, which is lossless.'
            )
    return tuple(Fraction(float(named.get(contact.mesh, 1.0))) for contact in contacts)


def _result(solution: Solution) -> Torques:
    statics, mechanism = solution.statics, solution.statics.kinematics.mechanism
    torques = {link: solution.values[link] if given is None else given for link, given in statics.torques.items()}
    powers = {link: torque * statics.speed(link) for link, torque in torques.items()}
    directions = [mechanism.directions[mechanism.joints[mechanism.bodies[link]].axis] for link in torques]
    loads = tuple(tooth_load(solution, number) for number in range(len(statics.contacts)))
    power_branches = tuple(branches(solution))
    power_in = sum((power for power in powers.values() if power > 0), ZERO)
    power_out = -sum((power for power in powers.values() if power < 0), ZERO)
    indeterminate = tuple(dict.fromkeys(load.mesh for load in loads if not load.determinate))
    gearing: dict[str, float] = {}
    for load in loads:
        gearing[load.mesh] = gearing.get(load.mesh, 0.0) + abs(load.gearing_power_w)
    largest = max((abs(branch.power_w) for branch in power_branches), default=0.0)
    known = power_in > 0 and not indeterminate
    return Torques(
        external=tuple(
            ExternalTorque(link=link, torque_nm=float(torque), power_w=watts(powers[link]))
            for link, torque in torques.items()
        ),
        frame_torque_nm=reaction(zip(map(float, torques.values()), directions, strict=True)),
        tooth_loads=loads,
        branches=power_branches,
        bearing_loads=tuple(bearing_loads(solution)),
        input_power_w=watts(power_in),
        output_power_w=watts(power_out),
        efficiency=float(power_out / power_in) if power_in > 0 else None,
        circulating_ratio=largest / watts(power_in) if known else None,
        gearing_ratio=max(gearing.values(), default=0.0) / watts(power_in) if known else None,
        indeterminate=indeterminate,
    )
