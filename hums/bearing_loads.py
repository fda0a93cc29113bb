"""Bearing loads: the statics of a shaft that runs in two bearings to the frame.

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
from hums.tooth_forces import UnsettledError, force_in_space, placed_axis

_NO_THRUST = 1e-12  # of the axial forces of a shaft: helices whose thrusts cancel leave their rounding
_UNKNOWN: Vector = (math.nan, math.nan, math.nan)


def bearing_loads(solution: Solution) -> Iterator[BearingLoad]:
    """Give the load of every declared bearing, in the order of declaration, or what keeps it from being settled."""
    for bearing in solution.statics.kinematics.gearbox.bearings:
        try:
            loads = {load.bearing: load for load in _reactions(solution, _borne(solution.statics, bearing))}
        except UnsettledError as caught:
            status = str(caught)
            loads = {
                name: BearingLoad(bearing=name, radial_n=_UNKNOWN, axial_n=math.nan, status=status)
                for name in bearing.names
            }
        yield from (loads[name] for name in bearing.names)


def _rings(statics: Statics, bearing: Bearing) -> set[str]:
    """Return the bodies a bearing stands between, all copies of a copied link."""
    kinematics = statics.kinematics
    links = (bearing.inner_ring, bearing.outer_ring)
    return {kinematics.bodies[name] for link in links for name in kinematics.gearbox.instances(link)}


def _borne(statics: Statics, bearing: Bearing) -> str:
    """Return the body that a bearing holds in the frame, one that statics covers."""
    kinematics = statics.kinematics
    frame, copied = kinematics.mechanism.frame, kinematics.gearbox.copied
    for link in (bearing.inner_ring, bearing.outer_ring):
        if link in copied:
            raise UnsettledError(
                f'"{link}" stands for {copied[link]} copies, whose places are not declared: not covered'
            )
    rings = _rings(statics, bearing)
    if frame not in rings or len(rings) == 1:
        raise UnsettledError(
            f"neither of its rings ({quoted(sorted(rings))}) is at rest while the other turns: not covered"
        )
    (body,) = rings - {frame}
    carried = [name for name, joint in kinematics.joints.items() if joint.carried_by == body]
    if carried:
        raise UnsettledError(f'"{body}" carries {quoted(carried)}, whose loads it passes on: not covered')
    return body


def _reactions(solution: Solution, body: str) -> tuple[BearingLoad, BearingLoad]:
    """Balance the tooth forces on a body in its two bearings.

    With force ``F`` and moment ``M`` of the teeth about the first bearing, the second one, ``l`` further along the
    axis ``d``, reacts across the axis with ``d x M / l``, and the first one with what is left of ``-F``.
    """
    statics = solution.statics
    (one, first_mm), (two, second_mm) = _supports(statics, body)
    points, forces = _acting(solution, body)
    axis, direction = placed_axis(statics, statics.kinematics.joints[body].axis)
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
        raise UnsettledError(
            f'"{body}" runs in {count(len(names), "bearing")} ({quoted(names)}); statics settles exactly two: '
            "indeterminate"
        )
    others = {ring for bearing in holding for ring in _rings(statics, bearing)} - {body}
    if others != {statics.kinematics.mechanism.frame}:
        raise UnsettledError(f'"{body}" also runs in a bearing on a shaft that turns ({quoted(names)}): indeterminate')
    places = [place for bearing in holding for place in bearing.position_mm or ()]
    if len(places) < len(names):
        without = [name for bearing in holding if bearing.position_mm is None for name in bearing.names]
        raise UnsettledError(f"position_mm of {quoted(without)} is not declared; add it")
    if places[0] == places[1]:
        raise UnsettledError(f"{quoted(names)} sit in one place, position_mm = {places[0]:g}: indeterminate")
    return (names[0], places[0]), (names[1], places[1])


def _acting(solution: Solution, body: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the meshes act on a body, (n, 3) mm, and with which forces, (n, 3) N."""
    statics, kinematics = solution.statics, solution.statics.kinematics
    for contact in kinematics.contacts:
        if len(contact.gears) == 1 and kinematics.bodies[contact.gears[0][0]] == body:
            raise UnsettledError(
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
    """Give the axial reaction to the one bearing that takes it."""
    reaction = -float(thrusts.sum())
    if abs(reaction) <= _NO_THRUST * np.abs(thrusts).sum():
        return (0.0, 0.0), "solved"
    able = {name for bearing in statics.kinematics.gearbox.bearings for name in bearing.takes_axial}
    taking = [name in able for name in names]
    if sum(taking) == 1:
        return (reaction * taking[0], reaction * taking[1]), "solved"
    problem = "both take it: indeterminate" if all(taking) else "takes_axial names neither; add the one that does"
    return (math.nan, math.nan), f"of {quoted(names)} one has to take {abs(reaction):.4g} N along the axis; {problem}"


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) + 0.0 for value in values)  # no minus zero
    return (x, y, z)
