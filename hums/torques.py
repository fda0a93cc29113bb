"""Static torques, tooth loads, forces and power of a mechanism, by virtual work.

`solve_torques` is the door. Behind it `hums.statics` writes the equations, `hums.equilibrium` solves them in
rational arithmetic, `hums.power_flow`, `hums.tooth_forces` and `hums.bearing_loads` say what follows, and
`hums.loads` holds the results. Power balances to the rounding of the result.
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
    statics = Statics(
        kinematics,
        {link: _checked(kinematics, link, torque) for link, torque in torques.items()},
        kinematics.rates(speeds),
        _efficiencies(kinematics, mesh_efficiency),
    )
    return _result(solve_equilibrium(statics))


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
    contacts = gear_pairs(kinematics)
    meshes = list(dict.fromkeys(contact.mesh for contact in contacts))
    named = given if isinstance(given, Mapping) else dict.fromkeys(meshes, given)
    for mesh, part in named.items():
        if mesh not in meshes:
            raise TorqueError(f'mesh_efficiency: no mesh "{mesh}" of two gears{closest(mesh, meshes)}')
        if isinstance(part, bool) or not isinstance(part, Real) or not 0 < part <= 1:
            raise TorqueError(f'mesh_efficiency: "{mesh}" = {part!r} is not above 0 and at most 1; 1 loses nothing.')
    return tuple(Fraction(float(named.get(contact.mesh, 1.0))) for contact in contacts)


def _result(solution: Solution) -> Torques:
    statics, mechanism = solution.statics, solution.statics.kinematics.mechanism
    torques = {link: solution.values[link] if given is None else given for link, given in statics.torques.items()}
    powers = {link: torque * statics.speed(link) for link, torque in torques.items()}
    directions = [mechanism.directions[mechanism.joints[mechanism.bodies[link]].axis] for link in torques]
    loads = tuple(tooth_load(solution, number) for number in range(len(statics.contacts)))
    flows = tuple(branches(solution))
    income = sum((power for power in powers.values() if power > 0), _ZERO)
    outgo = -sum((power for power in powers.values() if power < 0), _ZERO)
    indeterminate = tuple(dict.fromkeys(load.mesh for load in loads if not load.determinate))
    gearing: dict[str, float] = {}
    for load in loads:
        gearing[load.mesh] = gearing.get(load.mesh, 0.0) + abs(load.gearing_power_w)
    largest = max((abs(branch.power_w) for branch in flows), default=0.0)  # rigid links pass power on without a mesh
    known = income > 0 and not indeterminate
    return Torques(
        external=tuple(
            ExternalTorque(link=link, torque_nm=float(torque), power_w=watts(powers[link]))
            for link, torque in torques.items()
        ),
        frame_torque_nm=reaction(zip(map(float, torques.values()), directions, strict=True)),
        tooth_loads=loads,
        branches=flows,
        bearing_loads=tuple(bearing_loads(solution)),
        input_power_w=watts(income),
        output_power_w=watts(outgo),
        efficiency=float(outgo / income) if income > 0 else None,
        circulating_ratio=largest / watts(income) if known else None,
        gearing_ratio=max(gearing.values(), default=0.0) / watts(income) if known else None,
        indeterminate=indeterminate,
    )
