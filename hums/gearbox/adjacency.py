"""Gearboxes from a complex adjacency table T and a table of levels.

A gear pair has the entries ``T[i, j] = N_i exp(j theta_i)`` and ``T[j, i] = N_j exp(j theta_j)``, numbers of teeth and
pitch angles; a turning pair has the same whole number, its level, at (i, j) and (j, i) of the table of levels. Only the
difference between the angles of a pair matters: it is the angle between the axes of the two gears,
``alpha_j - alpha_i = theta_i - theta_j``, plus pi for an internal gear.

References
----------
J. Penaud, D. Alazard and A. Amiez, Kinematic analysis of spatial geared mechanisms, Journal of Mechanical Design 134
(2012), 021009, section 2.2.
"""

from __future__ import annotations

from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np

from hums.gearbox.components import Bearing, closest, united
from hums.gearbox.model import Gearbox, GearboxError
from signals._validation import brief, checked

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

_ANGLE_TOLERANCE_RAD = 1e-6  # between directions of an axis from several meshes


@checked
def from_adjacency_table(
    T: ArrayLike,
    levels: ArrayLike,
    *,
    frame: int | str,
    names: Sequence[str] | None = None,
    bearings: Iterable[Bearing | Mapping[str, Any]] = (),
    reference: int | str | None = None,
    name: str = "adjacency table",
) -> Gearbox:
    """Return the gearbox of an adjacency table and a table of levels.

    Parameters
    ----------
    T : (N, N) complex array_like
        Gear pairs, ``N_i exp(j theta_i)`` with number of teeth and pitch angle of gear i at (i, j); 0 for no pair.
    levels : (N, N) array_like of int
        Turning pairs, symmetric, 0 for no pair. Connected turning pairs of the same level share an axis.
    frame : int or str
        Link at rest, by index from 0 or by name.
    names : sequence of str, optional
        Names of the links. Default: "1" ... "N".
    bearings : iterable of Bearing or mapping
        Bearings, as objects or as tables of a gearbox file.
    reference : int or str, optional
        Reference shaft of orders.
    name : str
        Name of the gearbox.

    Returns
    -------
    Gearbox
        Gearbox with ``links`` in the order of the table and meshes in that of its upper triangle, row by row.

    Raises
    ------
    GearboxError
        If a table is not square, a pair has only one entry, a number of teeth is not whole, or angles are
        contradictory.

    References
    ----------
    J. Penaud, D. Alazard and A. Amiez, Journal of Mechanical Design 134 (2012), 021009, section 2.2.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> T = np.array([[0, 0, 0], [0, 0, 20], [0, 40, 0]])  # gears 1 and 2 on the frame, link 0
    >>> levels = [[0, 1, 2], [1, 0, 0], [2, 0, 0]]
    >>> gearbox = hums.from_adjacency_table(T, levels, frame=0, names=["frame", "pinion", "wheel"])
    >>> print(hums.solve_kinematics(gearbox).rates({"pinion": 1})["wheel"])
    -1/2
    """
    table, pairs = _square(T, np.complex128, "T"), _levels(levels)
    if table.shape != pairs.shape:
        raise GearboxError(f"T has shape {table.shape} and levels {pairs.shape}; give both for the same links.")
    links = _names(names, len(table))
    axes = _axes(pairs)
    meshes = _meshes(table, links)
    direction = _directions(table, axes, meshes)
    return Gearbox.from_mapping(
        {
            "name": name,
            "frame": _link(frame, links, "frame"),
            **({} if reference is None else {"reference": _link(reference, links, "reference")}),
            "link_order": links,
            "axes": {
                label: {"links": [links[i] for i in members], "direction": _unit(direction[label])}
                for label, members in axes.items()
            },
            "mesh": [_mesh(table, i, j, links, axes, direction) for i, j in meshes],
            "bearing": [b.model_dump(exclude_none=True) if isinstance(b, Bearing) else dict(b) for b in bearings],
        },
        where=name,
    )


def _square(values: ArrayLike, dtype: type, what: str) -> NDArray[Any]:
    """Return a table as a square, finite array."""
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[0] != array.shape[1] or array.dtype.kind not in "biufc":  # noqa: PLR2004
        raise GearboxError(f"{what} has shape {array.shape} and type {array.dtype}; give a square table of numbers.")
    if not np.all(np.isfinite(array)):
        i, j = np.argwhere(~np.isfinite(array))[0]
        raise GearboxError(f"{what}[{i}, {j}] = {array[i, j]} is not finite; use 0 for no pair.")
    return array.astype(dtype)


def _levels(levels: ArrayLike) -> NDArray[np.int64]:
    """Return the table of levels; refuse one that is not symmetric and of whole numbers."""
    given = _square(levels, np.float64, "levels")
    wrong = np.argwhere((given != np.round(given)) | (given < 0) | (given != given.T))
    if len(wrong):
        i, j = wrong[0]
        raise GearboxError(
            f"levels[{i}, {j}] = {given[i, j]:g} and levels[{j}, {i}] = {given[j, i]:g}: give the same whole number, "
            "1 or more, in both places of a turning pair and 0 elsewhere."
        )
    return given.astype(np.int64)


def _names(names: Sequence[str] | None, count: int) -> list[str]:
    found = [str(number + 1) for number in range(count)] if names is None else list(names)
    if len(found) != count:
        raise GearboxError(f"{len(found)} names are given for {count} links; give one for each.")
    return found


def _link(link: int | str, links: Sequence[str], what: str) -> str:
    """Return the name of a link given by index or name."""
    if isinstance(link, str):
        if link not in links:
            raise GearboxError(f'{what} = "{link}" is not a link{closest(link, list(links))}')
        return link
    if not isinstance(link, Integral) or isinstance(link, bool) or not 0 <= link < len(links):
        raise GearboxError(
            f"{what} = {brief(link)} is not an index of {len(links)} links; give 0 to {len(links) - 1}, or a name."
        )
    return links[int(link)]


def _axes(levels: NDArray[np.int64]) -> dict[str, list[int]]:
    """Return the indices of the links on each axis, which joins connected turning pairs of the same level."""
    axes = {}
    for level in np.unique(levels[levels > 0]):
        groups = united(np.argwhere(levels == level).tolist())
        for number, group in enumerate(sorted(groups, key=min)):
            label = f"level {level}" + (f" ({number + 1})" if len(groups) > 1 else "")
            axes[label] = sorted(group)
    return axes


def _meshes(table: NDArray[np.complex128], links: Sequence[str]) -> list[tuple[int, int]]:
    """Return the gear pairs, upper triangle row by row."""
    entries = table != 0
    unpaired = np.argwhere(entries & ~entries.T)
    if len(unpaired):
        i, j = unpaired[0]
        raise GearboxError(
            f'T[{i}, {j}] names a gear of "{links[i]}" against "{links[j]}", but T[{j}, {i}] is 0; '
            "give the numbers of teeth of both gears of a pair."
        )
    teeth_tolerance = 1e-6  # of the modulus of an entry, a whole number of teeth
    for i, j in np.argwhere(entries).tolist():
        if i == j or abs(abs(table[i, j]) - round(abs(table[i, j]))) > teeth_tolerance:
            raise GearboxError(
                f"T[{i}, {j}] = {table[i, j]:.6g} has the modulus {abs(table[i, j]):g}; a gear pair of two links with "
                "whole numbers of teeth is needed."
            )
    return [(i, j) for i, j in np.argwhere(entries).tolist() if i < j]


def _axis_pair(i: int, j: int, axes: Mapping[str, Sequence[int]]) -> tuple[str, str] | None:
    """Return the axes of two gears that share a third link, the carrier; None without one."""
    for one, members in axes.items():
        for two, others in axes.items():
            if i in members and j in others and (set(members) & set(others)) - {i, j}:
                return one, two
    return None


def _directions(
    table: NDArray[np.complex128], axes: Mapping[str, Sequence[int]], meshes: Sequence[tuple[int, int]]
) -> dict[str, float]:
    """Return the angle of every axis in the plane in rad, consistent with each mesh up to a multiple of pi.

    Angles are propagated breadth-first from the first axis of each connected set, whose angle is zero.
    """
    differences: dict[str, list[tuple[str, float, str]]] = {axis: [] for axis in axes}
    for i, j in meshes:
        pair = _axis_pair(i, j, axes)
        if pair is not None:  # the kinematic solver refuses a mesh without a carrier
            step = _external(table[i, j])[1] - _external(table[j, i])[1]
            entries = f"T[{i}, {j}] and T[{j}, {i}]"
            differences[pair[0]].append((pair[1], step, entries))
            differences[pair[1]].append((pair[0], -step, entries))
    angle: dict[str, float] = {}
    for start in axes:
        if start in angle:
            continue
        angle[start] = 0.0
        queue = [start]
        for axis in queue:
            for other, step, entries in differences[axis]:
                if other not in angle:
                    angle[other] = angle[axis] + step
                    queue.append(other)
                elif abs(np.sin(angle[other] - angle[axis] - step)) > _ANGLE_TOLERANCE_RAD:
                    found = np.degrees(angle[other] - angle[axis])
                    raise GearboxError(
                        f"{entries} give an angle of {np.degrees(step):.4g} degrees from {axis} to {other}, but other "
                        f"pairs {found:.4g}; correct the pitch angles."
                    )
    return angle


def _mesh(
    table: NDArray[np.complex128],
    i: int,
    j: int,
    links: Sequence[str],
    axes: Mapping[str, Sequence[int]],
    direction: Mapping[str, float],
) -> dict[str, Any]:
    """Return the table of a mesh as in a gearbox file, its teeth signed for the directions of the axes."""
    (first, angle_i), (second, angle_j) = _external(table[i, j]), _external(table[j, i])
    pair = _axis_pair(i, j, axes)
    if pair is not None and np.cos(angle_i + direction[pair[0]] - angle_j - direction[pair[1]]) < 0:
        first = -first  # opposite to the direction from other meshes
    teeth = (first, second)
    return {
        "teeth": {links[i]: teeth[0], links[j]: teeth[1]},
        "pitch_angle_deg": [float(np.degrees(np.angle(table[i, j]))), float(np.degrees(np.angle(table[j, i])))],
    }


def _external(entry: complex) -> tuple[int, float]:
    """Return signed teeth and a pitch angle within 90 degrees: negative teeth and pi less for an internal gear."""
    angle = float(np.angle(entry))
    teeth = round(abs(entry))
    return (
        (teeth, angle)
        if abs(angle) <= np.pi / 2 + _ANGLE_TOLERANCE_RAD
        else (-teeth, angle - np.copysign(np.pi, angle))
    )


def _unit(angle: float) -> list[float]:
    """Return the unit vector at an angle in the x-y plane, rounded so that zeros are exact."""
    return [float(np.round(x, 15)) for x in (np.cos(angle), np.sin(angle), 0.0)]
