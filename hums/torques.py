"""Static torques, tooth loads, forces and power of a mechanism, by virtual work.

`hums.statics` sets up the equations of `solve_torques`, `hums.equilibrium` solves them in rational arithmetic,
`hums.power_flow`, `hums.tooth_forces` and `hums.bearing_loads` derive the results, the classes of `hums.loads`. Power
balances to the rounding of the result.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from numbers import Real

from hums.bearing_loads import bearing_loads
from hums.declared import closest
from hums.equilibrium import solve_equilibrium
from hums.gearbox import GearboxError
from hums.kinematics import Kinematics
from hums.loads import BearingLoad, Branch, ExternalTorque, ToothForces, ToothLoad, TorqueError, Torques
from hums.power_flow import branches, reaction, tooth_load, watts
from hums.statics import Solution, Statics, gear_pairs

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

_ZERO = Fraction(0)


def solve_torques(
    kinematics: Kinematics,
    torques: Mapping[str, float | Fraction | None],
    *,
    speeds: Mapping[str, float | Fraction] | None = None,
    mesh_efficiency: float | Mapping[str, float] = 1.0,
) -> Torques:
    """Solve the static equilibrium of a mechanism for its unknown torques, tooth loads, power flow and bearing loads.

    Planets of one ``copies`` group share equally where statics alone is indeterminate. Loads that distinct meshes can
    share in any proportion are reported as indeterminate. A mesh whose mate is unknown transmits no load: apply the
    mate's torque to its gear. Tooth forces need ``module_mm`` (of the normal section) and ``pressure_angle_deg`` of
    a mesh; without ``helix_angle_deg`` its teeth are straight.

    Bearing loads follow by statics for a shaft whose axis is fixed in the frame and that runs in exactly two bearings
    to the frame. They need ``through`` (mm) of its axis and those of its mates, ``position_mm`` of its bearings and
    meshes, the inputs of the tooth forces, and for helical teeth ``hand`` and the bearing in ``takes_axial``. External
    torques are taken as pure couples; weights, and the axial force of a radial load on an angular contact, are left
    out. Shafts that planets load or that carry other shafts are not covered. The ``status`` of a bearing load states
    why it is not determined.

    Parameters
    ----------
    kinematics : Kinematics
        From `solve_kinematics`.
    torques : mapping of str to float, Fraction or None
        External torque of each loaded link in N m, along its declared axis, positive in the sense of positive speed.
        None: solved for, for at most as many links as there are degrees of freedom. Links that are not named carry no
        external torque, but the frame takes the reaction.
    speeds : mapping of str to float or Fraction, optional
        Speeds of links in turns a second, as many as there are degrees of freedom. None: one turn a second of the
        gearbox's reference.
    mesh_efficiency : float or mapping of str to float
        Efficiency of all meshes or of meshes by name, relative to the carrier, above 0 and at most 1; a mesh that the
        mapping does not name is lossless.

    Returns
    -------
    Torques

    Raises
    ------
    TorqueError
        Torques that do not balance, more unknown torques than statics can determine, losses so high that the
        mechanism is self-locking.
    GearboxError
        Too few or contradictory speeds, as in `Kinematics.rates`.

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
    """Return a valid external torque as a fraction, None for one to solve for."""
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
    """Return the efficiency of each contact of two gears."""
    contacts = gear_pairs(kinematics)
    meshes = list(dict.fromkeys(contact.mesh for contact in contacts))
    named = given if isinstance(given, Mapping) else dict.fromkeys(meshes, given)
    for mesh, efficiency in named.items():
        if mesh not in meshes:
            raise TorqueError(f'mesh_efficiency: no mesh "{mesh}" of two gears{closest(mesh, meshes)}')
        if isinstance(efficiency, bool) or not isinstance(efficiency, Real) or not 0 < efficiency <= 1:
            raise TorqueError(
                f'mesh_efficiency: "{mesh}" = {efficiency!r} is not above 0 and at most 1; 1 loses nothing.'
            )
    return tuple(Fraction(float(named.get(contact.mesh, 1.0))) for contact in contacts)


def _result(solution: Solution) -> Torques:
    """Return the torques, powers and loads of a solution in floats."""
    statics, mechanism = solution.statics, solution.statics.kinematics.mechanism
    torques = {link: solution.values[link] if given is None else given for link, given in statics.torques.items()}
    powers = {link: torque * statics.speed(link) for link, torque in torques.items()}
    directions = [mechanism.directions[mechanism.joints[mechanism.bodies[link]].axis] for link in torques]
    loads = tuple(tooth_load(solution, number) for number in range(len(statics.contacts)))
    power_branches = tuple(branches(solution))
    power_in = sum((power for power in powers.values() if power > 0), _ZERO)
    power_out = -sum((power for power in powers.values() if power < 0), _ZERO)
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
