"""The papers' way in: a complex adjacency table T and a table of levels become a gearbox.

In T a gear pair stands as ``T[i, j] = N_i exp(j theta_i)`` and ``T[j, i] = N_j exp(j theta_j)``, teeth and pitch
angles; a turning pair as the same whole number, its level, in both places of the table of levels (Penaud,
Alazard and Amiez 2012, 2.2; the signs of its errata). Only differences of the angles within a pair matter: they
say how the axes of the two gears lie to each other, ``alpha_j - alpha_i = theta_i - theta_j``, up to half a turn,
which is an internal gear's sign.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hums.declared import closest
from hums.gearbox import Bearing, Gearbox, GearboxError

_WHOLE = 1e-6  # how far the modulus of an entry may lie from a whole number of teeth
_TURN = 1e-6  # rad: how well the angles of several meshes must agree about the direction of an axis


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
    """Read a mechanism from its adjacency table.

    Parameters
    ----------
    T : (N, N) complex array
        Gear pairs, 0 where there is none.
    levels : (N, N) array of whole numbers
        Turning pairs, symmetric, 0 where there is none. Turning pairs of one level that hang together share a line.
    frame : int or str
        Link at rest, by index from 0 or by name.
    names : sequence of str, optional
        Names of the links; default "1" ... "N".
    bearings : of `Bearing` or of tables as in a gearbox file
    reference : int or str, optional
        Link whose revolutions orders count.
    name : str

    Returns
    -------
    Gearbox
        Its ``links`` keep the order of the table; meshes stand in the order of the upper triangle, row by row.

    Raises
    ------
    GearboxError
        A table that is not square, a pair with one entry, teeth that are not whole, or angles that contradict
        each other.
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
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[0] != array.shape[1] or array.dtype.kind not in "biufc":  # noqa: PLR2004
        raise GearboxError(f"{what} has shape {array.shape} and type {array.dtype}; give a square table of numbers.")
    if not np.all(np.isfinite(array)):
        i, j = np.argwhere(~np.isfinite(array))[0]
        raise GearboxError(f"{what}[{i}, {j}] = {array[i, j]} is not finite; put 0 where there is no pair.")
    return array.astype(dtype)


def _levels(levels: ArrayLike) -> NDArray[np.int64]:
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
        raise GearboxError(f"{len(found)} names are given for {count} links; give one each.")
    return found


def _link(link: int | str, links: Sequence[str], what: str) -> str:
    if isinstance(link, str):
        if link not in links:
            raise GearboxError(f'{what} = "{link}" is no link{closest(link, list(links))}')
        return link
    if isinstance(link, bool) or not 0 <= link < len(links):
        raise GearboxError(
            f"{what} = {link!r} is no index of {len(links)} links; give 0 to {len(links) - 1}, or a name."
        )
    return links[link]


def _axes(levels: NDArray[np.int64]) -> dict[str, list[int]]:
    """Group the turning pairs of each level into lines: name -> links on it, by index."""
    axes = {}
    for level in np.unique(levels[levels > 0]):
        groups: list[set[int]] = []
        for i, j in np.argwhere(levels == level).tolist():
            touched = [group for group in groups if group & {i, j}]
            groups = [group for group in groups if group not in touched]
            groups.append({i, j}.union(*touched))
        for number, group in enumerate(sorted(groups, key=min)):
            label = f"level {level}" + (f" ({number + 1})" if len(groups) > 1 else "")
            axes[label] = sorted(group)
    return axes


def _meshes(table: NDArray[np.complex128], links: Sequence[str]) -> list[tuple[int, int]]:
    """Return the gear pairs, upper triangle row by row."""
    there = table != 0
    lonely = np.argwhere(there & ~there.T)
    if len(lonely):
        i, j = lonely[0]
        raise GearboxError(
            f'T[{i}, {j}] names a gear of "{links[i]}" against "{links[j]}", but T[{j}, {i}] is 0; '
            "give the teeth of both gears of a pair."
        )
    for i, j in np.argwhere(there).tolist():
        if i == j or abs(abs(table[i, j]) - round(abs(table[i, j]))) > _WHOLE:
            raise GearboxError(
                f"T[{i}, {j}] = {table[i, j]:.6g} has the modulus {abs(table[i, j]):g}; a gear pair of two links with "
                "whole numbers of teeth is needed."
            )
    return [(i, j) for i, j in np.argwhere(there).tolist() if i < j]


def _axis_pair(i: int, j: int, axes: Mapping[str, Sequence[int]]) -> tuple[str, str] | None:
    """Return the axes of two gears, such that one link, their carrier, is on both."""
    for one, members in axes.items():
        for two, others in axes.items():
            if i in members and j in others and (set(members) & set(others)) - {i, j}:
                return one, two
    return None


def _directions(
    table: NDArray[np.complex128], axes: Mapping[str, Sequence[int]], meshes: Sequence[tuple[int, int]]
) -> dict[str, float]:
    """Give every axis its angle in the plane, rad, the first one zero, so that each mesh agrees up to half a turn."""
    turns: dict[str, list[tuple[str, float, str]]] = {axis: [] for axis in axes}
    for i, j in meshes:
        pair = _axis_pair(i, j, axes)
        if pair is not None:  # without a carrier the solver says so, by name
            step = _external(table[i, j])[1] - _external(table[j, i])[1]
            entries = f"T[{i}, {j}] and T[{j}, {i}]"
            turns[pair[0]].append((pair[1], step, entries))
            turns[pair[1]].append((pair[0], -step, entries))
    angle: dict[str, float] = {}
    for start in axes:
        if start in angle:
            continue
        angle[start] = 0.0
        queue = [start]
        for here in queue:
            for there, step, entries in turns[here]:
                if there not in angle:
                    angle[there] = angle[here] + step
                    queue.append(there)
                elif abs(np.sin(angle[there] - angle[here] - step)) > _TURN:
                    other = np.degrees(angle[there] - angle[here])
                    raise GearboxError(
                        f"{entries} turn {there} by {np.degrees(step):.4g} degrees against {here}, but other pairs by "
                        f"{other:.4g}; correct the pitch angles."
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
    (first, angle_i), (second, angle_j) = _external(table[i, j]), _external(table[j, i])
    pair = _axis_pair(i, j, axes)
    if pair is not None and np.cos(angle_i + direction[pair[0]] - angle_j - direction[pair[1]]) < 0:
        first = -first  # against a direction that earlier meshes have settled
    teeth = (first, second)
    return {
        "teeth": {links[i]: teeth[0], links[j]: teeth[1]},
        "pitch_angle_deg": [float(np.degrees(np.angle(table[i, j]))), float(np.degrees(np.angle(table[j, i])))],
    }


def _external(entry: complex) -> tuple[int, float]:
    """Return signed teeth and pitch angle: beyond a right angle a gear is internal, minus and half a turn less."""
    angle = float(np.angle(entry))
    teeth = round(abs(entry))
    return (teeth, angle) if abs(angle) <= np.pi / 2 + _TURN else (-teeth, angle - np.copysign(np.pi, angle))


def _unit(angle: float) -> list[float]:
    """Return a unit vector in the plane, its zeros exact."""
    return [float(np.round(x, 15)) for x in (np.cos(angle), np.sin(angle), 0.0)]
