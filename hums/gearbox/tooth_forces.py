"""Tooth forces: components at the pitch point, and vectors in space.

References
----------
ISO 21771 (2007): working pressure angle. Decker, Maschinenelemente: the three components of a tooth force.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hums.gearbox.components import Axis, Bearing, Mesh, Vector, count, quoted
from hums.gearbox.statics import Solution, Statics, TorqueError


@dataclass(frozen=True, kw_only=True)
class ToothForces:
    """Components of the tooth force of one contact at the pitch point, as magnitudes in N.

    The tangential force drives the driven gear, the radial force separates the gears, the axial force acts along the
    axes.
    """

    tangential_n: float
    radial_n: float
    axial_n: float


@dataclass(frozen=True, kw_only=True)
class BearingLoad:
    """Reaction of the frame on a shaft at one bearing; NaN if statics does not determine it.

    Attributes
    ----------
    bearing : str
        Name of the bearing.
    radial_n : (3,) tuple of float
        Radial reaction in N, in the declared coordinates.
    axial_n : float
        Axial reaction in N, positive along the direction of the shaft's axis.
    status : str
        ``"solved"``, or the reason why not. The radial reaction is also valid if only the axial one is indeterminate.
    """

    bearing: str
    radial_n: Vector
    axial_n: float
    status: str


class IndeterminateError(Exception):
    """Reason why a force is not determined, which becomes the `status` of a `BearingLoad`."""


@dataclass(frozen=True, kw_only=True)
class PairAngles:
    """Helix, transverse and working transverse pressure angles of a gear pair, and the signed sum of its teeth."""

    helix_rad: float
    transverse_rad: float
    working_rad: float
    teeth: int

    def distance_mm(self, module_mm: float) -> float:
        """Return the working centre distance in mm, ``a = m |Z| cos a_t / (2 cos b cos a_w)``."""
        reference_mm = module_mm * abs(self.teeth) / (2 * math.cos(self.helix_rad))
        return reference_mm * math.cos(self.transverse_rad) / math.cos(self.working_rad)


def pair_angles(statics: Statics, number: int) -> PairAngles | None:
    """Return the angles of a gear pair; None without a pressure angle, or for axes that are not parallel."""
    mesh = statics.mesh(number)
    cosine = sum(a * b for a, b in zip(*statics.directions(number), strict=True))
    parallel = 1e-12
    if mesh.pressure_angle_deg is None or mesh.kind or abs(abs(cosine) - 1) > parallel:
        return None
    (_, one), (_, two) = statics.contacts[number].gears
    teeth = abs(one) + abs(two) if one * two * cosine > 0 else -abs(abs(one) - abs(two))
    helix_rad = math.radians(abs(mesh.helix_angle_deg or 0.0))
    normal_rad = math.radians(mesh.pressure_angle_deg)
    transverse_rad = math.atan(math.tan(normal_rad) / math.cos(helix_rad))
    return PairAngles(
        helix_rad=helix_rad,
        transverse_rad=transverse_rad,
        working_rad=_working_angle(mesh, normal_rad, transverse_rad, teeth),
        teeth=teeth,
    )


def _working_angle(mesh: Mesh, normal_rad: float, transverse_rad: float, teeth: int) -> float:
    """Return the transverse working pressure angle in rad (ISO 21771).

    ``inv a_w = inv a_t + 2 tan a_n sum(x) / sum(z)``, with internal teeth negative, is solved by Newton's method: as
    the involute function is convex, the iterates decrease from above to the solution.
    """
    shift = sum(mesh.profile_shift or ())
    if shift == 0:
        return transverse_rad
    shift_term = 2 * math.tan(normal_rad) * shift / teeth if teeth else -math.inf
    involute = math.tan(transverse_rad) - transverse_rad + shift_term
    if involute <= 0:
        raise TorqueError(
            f'mesh "{mesh.name}": with profile_shift = {list(mesh.profile_shift or ())} its gears have no common pitch '
            "point; correct the shifts (signs as in ISO 21771)."
        )
    angle = math.atan(math.cbrt(3 * involute) + involute)  # not below the solution, as inv a > a^3 / 3
    converged_rad = 1e-15
    for _ in range(60):
        step = (math.tan(angle) - angle - involute) / math.tan(angle) ** 2
        angle -= step
        if abs(step) < converged_rad:
            break
    return angle


def tooth_forces(solution: Solution, number: int) -> ToothForces | None:
    """Return the components of a tooth force at the working pitch point of a gear pair with parallel axes.

    With the reference diameter ``d = m Z / cos b`` the transverse force along the line of action is
    ``2 Z L / (d cos a_t)``; it is inclined by the working pressure angle. None if the load, the module or an angle is
    unknown.
    """
    load, module_mm = solution.load(number), solution.statics.mesh(number).module_mm
    if load is None:
        return None
    angles = pair_angles(solution.statics, number)
    if module_mm is None or angles is None:
        return None
    reference_n = 2 * abs(float(load)) * math.cos(angles.helix_rad) / (1e-3 * module_mm)
    line_n = reference_n / math.cos(angles.transverse_rad)
    return ToothForces(
        tangential_n=line_n * math.cos(angles.working_rad),
        radial_n=line_n * math.sin(angles.working_rad),
        axial_n=reference_n * math.tan(angles.helix_rad),
    )


# ---- the force in space ---------------------------------------------------------------------------------------------


def force_in_space(solution: Solution, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pitch point of a contact, (3,) mm, and the force there on its first gear, (3,) N.

    With the unit vector ``u`` from the first axis to the second, the pitch point lies ``a Z_1 / (Z_1 + Z_2)`` along it,
    beyond the pinion of an internal pair. With the direction ``d`` of the first axis, the tangential force acts along
    ``d x u``, the radial force separates the gears, and the axial force along ``d`` is ``-tan b`` times the tangential
    force for a right-handed helix.

    Raises
    ------
    IndeterminateError
        If an input is missing or contradictory.
    """
    statics, load = solution.statics, _load_in_frame(solution, number)
    mesh, contact = statics.mesh(number), statics.contacts[number]
    (axis, direction), (other, other_direction) = (located_axis(statics, name) for name in statics.axes(number))
    angles, module_mm, position_mm = _force_inputs(statics, number)
    start = np.array(axis.through) + position_mm * direction
    offset = np.array(other.through) - start
    offset -= offset @ direction * direction
    distance_mm = float(np.linalg.norm(offset))
    working_mm = angles.distance_mm(module_mm)
    distance_tolerance = 1e-3  # of the centre distance: above the rounding of positions and profile shifts
    if not working_mm or abs(distance_mm / working_mm - 1) > distance_tolerance:
        raise IndeterminateError(
            f'mesh "{mesh.name}": axes {quoted((axis.name, other.name))} are {distance_mm:.6g} mm apart, but its teeth '
            f"need {working_mm:.6g} mm; correct through, module_mm or profile_shift"
        )
    unit = offset / distance_mm
    (_, teeth), (_, teeth_other) = contact.gears
    arm_mm = distance_mm * teeth / (teeth + teeth_other * round(float(direction @ other_direction)))
    tangential_n = 1e3 * load * teeth / arm_mm  # along d x u, a positive moment about d for a positive arm
    radial_n = math.copysign(abs(tangential_n) * math.tan(angles.working_rad), -angles.teeth)
    tan_helix = math.tan(angles.helix_rad) * math.cos(angles.transverse_rad) / math.cos(angles.working_rad)
    thrust_n = math.copysign(1.0, arm_mm) * tangential_n * tan_helix * (-1 if mesh.hand == "right" else 1)
    return start + arm_mm * unit, tangential_n * np.cross(direction, unit) + radial_n * unit + thrust_n * direction


def located_axis(statics: Statics, name: str) -> tuple[Axis, NDArray[np.float64]]:
    """Return an axis of declared position and its direction; raise `IndeterminateError` without a position."""
    axis = next(axis for axis in statics.kinematics.gearbox.axes if name in axis.instances())
    if axis.copies is not None:
        raise IndeterminateError(f'axis "{axis.name}" stands for {axis.copies} copies of undeclared position')
    if axis.through is None:
        raise IndeterminateError(f'axis "{name}": through is not declared; add a point on it in mm')
    return axis, np.array(statics.kinematics.mechanism.directions[name])


def _load_in_frame(solution: Solution, number: int) -> float:
    """Return the tooth load of a contact whose carrier is the frame, in N m per tooth."""
    contact, load = solution.statics.contacts[number], solution.load(number)
    name = f'mesh "{contact.mesh}"'
    if contact.carrier != solution.statics.kinematics.mechanism.frame:
        raise IndeterminateError(
            f'{name} is held by "{contact.carrier}", not by the frame: loads of planets are not covered'
        )
    if load is None:
        raise IndeterminateError(f"the load of {name} is indeterminate")
    return float(load)


def _force_inputs(statics: Statics, number: int) -> tuple[PairAngles, float, float]:
    """Return the angles, the module in mm and the position in mm of a contact; refuse undeclared ones."""
    mesh, angles = statics.mesh(number), pair_angles(statics, number)
    name = f'mesh "{mesh.name}"'
    if angles is None or mesh.module_mm is None:
        raise IndeterminateError(f"{name}: a force needs module_mm, pressure_angle_deg and gears on parallel axes")
    if mesh.position_mm is None:
        raise IndeterminateError(f"{name}: position_mm is not declared; add it")
    if angles.helix_rad and mesh.hand is None:
        raise IndeterminateError(f"{name}: the hand of its helix is not declared; add that of its first gear")
    return angles, mesh.module_mm, mesh.position_mm


# ---- Bearing loads by statics of a shaft in two bearings to the frame (Decker, Maschinenelemente) -------------------


def bearing_loads(solution: Solution) -> Iterator[BearingLoad]:
    """Yield the load of every declared bearing, or why it is not determined, in the order of declaration."""
    for bearing in solution.statics.kinematics.gearbox.bearings:
        try:
            loads = {load.bearing: load for load in _reactions(solution, _supported_body(solution.statics, bearing))}
        except IndeterminateError as caught:
            status, nan = str(caught), math.nan
            loads = {
                name: BearingLoad(bearing=name, radial_n=(nan, nan, nan), axial_n=nan, status=status)
                for name in bearing.names
            }
        yield from (loads[name] for name in bearing.names)


def _rings(statics: Statics, bearing: Bearing) -> set[str]:
    """Return the bodies that a bearing connects, all copies of a copied link."""
    kinematics = statics.kinematics
    links = (bearing.inner_ring, bearing.outer_ring)
    return {kinematics.bodies[name] for link in links for name in kinematics.gearbox.instances(link)}


def _supported_body(statics: Statics, bearing: Bearing) -> str:
    """Return the body that a bearing supports in the frame; refuse unsupported arrangements."""
    kinematics = statics.kinematics
    frame, copied = kinematics.mechanism.frame, kinematics.gearbox.copied
    for link in (bearing.inner_ring, bearing.outer_ring):
        if link in copied:
            raise IndeterminateError(f'"{link}" stands for {copied[link]} copies of undeclared position: not covered')
    rings = _rings(statics, bearing)
    if frame not in rings or len(rings) == 1:
        raise IndeterminateError(
            f"neither of its rings ({quoted(sorted(rings))}) is at rest while the other rotates: not covered"
        )
    (body,) = rings - {frame}
    carried = [name for name, joint in kinematics.joints.items() if joint.carried_by == body]
    if carried:
        raise IndeterminateError(f'"{body}" carries {quoted(carried)}, whose loads it transmits: not covered')
    return body


def _reactions(solution: Solution, body: str) -> tuple[BearingLoad, BearingLoad]:
    """Return the reactions of the two bearings of a body to its tooth forces.

    With force ``F`` and moment ``M`` of the teeth about the first bearing, and the second bearing at ``l`` from it
    along the axis ``d``, the radial reaction of the second is ``R_2 = d x M / l`` and that of the first is
    ``-F - R_2``, less its axial part.
    """
    statics = solution.statics
    (one, first_mm), (two, second_mm) = _supports(statics, body)
    points, forces = _tooth_forces_on(solution, body)
    axis, direction = located_axis(statics, statics.kinematics.joints[body].axis)
    at_first = np.array(axis.through) + first_mm * direction
    second = np.cross(direction, np.cross(points - at_first, forces).sum(axis=0)) / (second_mm - first_mm)
    thrusts = forces @ direction
    first = thrusts.sum() * direction - forces.sum(axis=0) - second
    axial, status = _axial(statics, (one, two), thrusts)
    return (
        BearingLoad(bearing=one, radial_n=_vector(first), axial_n=axial[0], status=status),
        BearingLoad(bearing=two, radial_n=_vector(second), axial_n=axial[1], status=status),
    )


def _supports(statics: Statics, body: str) -> tuple[tuple[str, float], tuple[str, float]]:
    """Return the names and positions in mm of the two bearings that hold a body."""
    holding = [bearing for bearing in statics.kinematics.gearbox.bearings if body in _rings(statics, bearing)]
    names = [name for bearing in holding for name in bearing.names]
    if len(names) != 2:  # noqa: PLR2004
        raise IndeterminateError(
            f'"{body}" runs in {count(len(names), "bearing")} ({quoted(names)}); statics determines exactly two: '
            "indeterminate"
        )
    others = {ring for bearing in holding for ring in _rings(statics, bearing)} - {body}
    if others != {statics.kinematics.mechanism.frame}:
        raise IndeterminateError(
            f'"{body}" also runs in a bearing on a rotating shaft ({quoted(names)}): indeterminate'
        )
    positions_mm = [place for bearing in holding for place in bearing.position_mm or ()]
    if len(positions_mm) < len(names):
        without = [name for bearing in holding if bearing.position_mm is None for name in bearing.names]
        raise IndeterminateError(f"position_mm of {quoted(without)} is not declared; add it")
    if positions_mm[0] == positions_mm[1]:
        raise IndeterminateError(f"{quoted(names)} have the same position_mm = {positions_mm[0]:g}: indeterminate")
    return (names[0], positions_mm[0]), (names[1], positions_mm[1])


def _tooth_forces_on(solution: Solution, body: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pitch points of the meshes of a body, (n, 3) mm, and the forces there on it, (n, 3) N."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for contact in kinematics.contacts:
        if len(contact.gears) == 1 and kinematics.bodies[contact.gears[0][0]] == body:
            raise IndeterminateError(
                f'mesh "{contact.mesh}" has an undeclared mate, so the direction of its force is unknown'
            )
    points, forces = [], []
    for number, contact in enumerate(statics.contacts):
        gears = [kinematics.bodies[link] for link, _ in contact.gears]
        if body in gears:
            point, force = force_in_space(solution, number)
            points.append(point)
            forces.append(force if gears[0] == body else -force)
    return np.array(points).reshape(-1, 3), np.array(forces).reshape(-1, 3)


def _axial(statics: Statics, names: tuple[str, str], thrusts: NDArray[np.float64]) -> tuple[tuple[float, float], str]:
    """Return the axial reactions in N, all of it on the bearing that takes axial load, and the status."""
    reaction = -float(thrusts.sum())
    # 1e-12 of the sum of axial force magnitudes: thrusts that cancel within rounding
    if abs(reaction) <= 1e-12 * np.abs(thrusts).sum():
        return (0.0, 0.0), "solved"
    axial = {name for bearing in statics.kinematics.gearbox.bearings for name in bearing.takes_axial}
    takes = [name in axial for name in names]
    if sum(takes) == 1:
        return (reaction * takes[0], reaction * takes[1]), "solved"
    problem = "both do: indeterminate" if all(takes) else "takes_axial names neither; add the one that does"
    return (math.nan, math.nan), f"one of {quoted(names)} must take {abs(reaction):.4g} N axially; {problem}"


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) + 0.0 for value in values)  # turns minus zero into zero
    return (x, y, z)
