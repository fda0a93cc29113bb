"""Bearing loads by statics of a shaft that runs in two bearings to the frame.

Decker, Maschinenelemente, or any other text on gears.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hums.declared import count, quoted
from hums.gearbox import Bearing, Vector
from hums.loads import BearingLoad
from hums.statics import Solution, Statics
from hums.tooth_forces import IndeterminateError, force_in_space, located_axis

_NO_THRUST = 1e-12  # of the sum of axial force magnitudes: thrusts that cancel, to rounding
_UNKNOWN: Vector = (math.nan, math.nan, math.nan)


def bearing_loads(solution: Solution) -> Iterator[BearingLoad]:
    """Yield the load of every declared bearing, or the reason why it is not determined, in the order of declaration."""
    for bearing in solution.statics.kinematics.gearbox.bearings:
        try:
            loads = {load.bearing: load for load in _reactions(solution, _supported_body(solution.statics, bearing))}
        except IndeterminateError as caught:
            status = str(caught)
            loads = {
                name: BearingLoad(bearing=name, radial_n=_UNKNOWN, axial_n=math.nan, status=status)
                for name in bearing.names
            }
        yield from (loads[name] for name in bearing.names)


def _rings(statics: Statics, bearing: Bearing) -> set[str]:
    """Return the bodies that a bearing connects, all copies of a copied link."""
    kinematics = statics.kinematics
    links = (bearing.inner_ring, bearing.outer_ring)
    return {kinematics.bodies[name] for link in links for name in kinematics.gearbox.instances(link)}


def _supported_body(statics: Statics, bearing: Bearing) -> str:
    """Return the body that a bearing supports in the frame; refuse those that are not covered."""
    kinematics = statics.kinematics
    frame, copied = kinematics.mechanism.frame, kinematics.gearbox.copied
    for link in (bearing.inner_ring, bearing.outer_ring):
        if link in copied:
            raise IndeterminateError(
                f'"{link}" stands for {copied[link]} copies, whose places are not declared: not covered'
            )
    rings = _rings(statics, bearing)
    if frame not in rings or len(rings) == 1:
        raise IndeterminateError(
            f"neither of its rings ({quoted(sorted(rings))}) is at rest while the other turns: not covered"
        )
    (body,) = rings - {frame}
    carried = [name for name, joint in kinematics.joints.items() if joint.carried_by == body]
    if carried:
        raise IndeterminateError(f'"{body}" carries {quoted(carried)}, whose loads it passes on: not covered')
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
            f'"{body}" also runs in a bearing on a shaft that turns ({quoted(names)}): indeterminate'
        )
    positions_mm = [place for bearing in holding for place in bearing.position_mm or ()]
    if len(positions_mm) < len(names):
        without = [name for bearing in holding if bearing.position_mm is None for name in bearing.names]
        raise IndeterminateError(f"position_mm of {quoted(without)} is not declared; add it")
    if positions_mm[0] == positions_mm[1]:
        raise IndeterminateError(f"{quoted(names)} sit in one place, position_mm = {positions_mm[0]:g}: indeterminate")
    return (names[0], positions_mm[0]), (names[1], positions_mm[1])


def _tooth_forces_on(solution: Solution, body: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pitch points of the meshes of a body, (n, 3) mm, and the forces there on it, (n, 3) N."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for contact in kinematics.contacts:
        if len(contact.gears) == 1 and kinematics.bodies[contact.gears[0][0]] == body:
            raise IndeterminateError(
                f'mesh "{contact.mesh}" has a mate that is not declared, so its force has no direction'
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
    """Return the axial reactions in N, all of it on the one bearing that takes axial load, and the status."""
    reaction = -float(thrusts.sum())
    if abs(reaction) <= _NO_THRUST * np.abs(thrusts).sum():
        return (0.0, 0.0), "solved"
    axial = {name for bearing in statics.kinematics.gearbox.bearings for name in bearing.takes_axial}
    takes = [name in axial for name in names]
    if sum(takes) == 1:
        return (reaction * takes[0], reaction * takes[1]), "solved"
    problem = "both take it: indeterminate" if all(takes) else "takes_axial names neither; add the one that does"
    return (math.nan, math.nan), f"of {quoted(names)} one has to take {abs(reaction):.4g} N along the axis; {problem}"


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) + 0.0 for value in values)  # turns minus zero into zero
    return (x, y, z)
