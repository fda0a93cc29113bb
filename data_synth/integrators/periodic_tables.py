"""Tables of periodic functions of the mesh phase, which compiled code evaluates and integrates to rounding.

Between two jumps a function is divided into equal cells with one polynomial each. Tables of stiffnesses also hold the
first three periodic integrals of the function minus its mean, so that its moments over any interval of phase, across
jumps or cycles, take two look-ups.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

DEGREE = 5
WIDTHS = (6, 7, 8, 9)  # coefficients of the function and of its three integrals, side by side in a row
_MIN_DENSITY, _MAX_DENSITY = 16, 2048  # cells per mesh cycle
_FIT = 1e-11  # of the largest value: cells are halved until the polynomials are this accurate
FIT_ERROR = 1e-9  # the same for transmission errors, which no method integrates exactly; takes a third of the time
_JUMP = 1e-6  # of the largest value: a larger difference between the ends of neighbouring segments is a jump
_STEEP = 50.0  # largest values per cycle: a segment with a steeper mean slope counts as a jump
_LEAST_GAIN = 1.2  # in accuracy of halving, which gains 2 even with a kink within a cell

_NODES = (1 - np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))) / 2
_INTERPOLATE = np.linalg.inv(np.vander(_NODES, increasing=True))
_CHECKED = np.array([0.003, 0.24, 0.64, 0.997])  # where the fit is checked: near the ends of a cell and between nodes


class Waves(NamedTuple):
    """Tables of several periodic functions, one after the other.

    ``periods``, ``means`` (f,); ``segments`` (f + 1,): where the segments of each function begin in ``starts``,
    ``densities`` (cells per cycle), ``firsts`` (first cell), ``counts`` (cells) and ``jumps`` (whether the function
    jumps at its beginning, or is steep on either side), each (segments,); ``rows`` (cells, 30), or (cells, 6) without
    integrals. To find the segment of a phase directly, each period is divided into equal parts, ``lookup_rates`` (f,)
    per cycle; ``lookup`` (parts,) holds the segment in which each begins, from ``segments`` on.
    """

    periods: Array
    means: Array
    segments: Integers
    starts: Array
    densities: Array
    firsts: Integers
    counts: Integers
    jumps: NDArray[np.bool_]
    rows: Array
    lookup_rates: Array
    lookup: Integers


class Wave(NamedTuple):
    """A function of phase in cycles, its period, its jumps in [0, period), and the tolerated misfit of its table."""

    value: Callable[[Array], Array]
    period: float
    jumps: tuple[float, ...] = ()
    misfit: float = _FIT


def tabulated(functions: Sequence[Wave], *, integrals: bool = True) -> Waves:
    """Return the tables of functions, with their integrals or, in a fifth of the memory, without.

    The last table is that of the unit function.
    """
    functions = [*functions, Wave(np.ones_like, 1)]
    tables = [_table(function, integrals=integrals) for function in functions]
    counts = [starts.size for starts, *_ in tables]
    cells = np.cumsum([0, *(rows.shape[0] for *_, rows, _ in tables)])
    segments = np.cumsum([0, *counts], dtype=np.int64)
    rates = [starts.size / function.period for (starts, *_), function in zip(tables, functions, strict=True)]
    lookups = [
        first + np.searchsorted(starts, np.arange(starts.size) / rate, side="right") - 1
        for first, (starts, *_), rate in zip(segments, tables, rates, strict=False)
    ]
    return Waves(
        periods=np.array([float(function.period) for function in functions]),
        means=np.array([mean for *_, mean in tables]),
        segments=segments,
        starts=np.concatenate([starts for starts, *_ in tables]),
        densities=np.concatenate([densities for _, densities, *_ in tables]),
        firsts=np.concatenate([t[2] + cell for t, cell in zip(tables, cells, strict=False)]),
        counts=np.concatenate([t[3] for t in tables]),
        jumps=np.concatenate([t[4] for t in tables]),
        rows=np.concatenate([rows for *_, rows, _ in tables]),
        lookup_rates=np.array(rates),
        lookup=np.concatenate(lookups).astype(np.int64),
    )


Table: TypeAlias = tuple[Array, Array, Integers, Integers, NDArray[np.bool_], Array, float]


def _table(function: Wave, *, integrals: bool) -> Table:
    """Return starts, densities, first cells, cell counts and jumps of the segments, rows of the cells, and the mean."""
    breaks = np.unique(np.array([0.0, *function.jumps, function.period]))
    # phases are rounded, and a value may change by its whole range over the shortest segment
    rounding = 4 * np.finfo(float).eps * function.period / float(np.min(np.diff(breaks)))
    density = _MIN_DENSITY
    starts, widths, counts, rows, error = _fitted(function, breaks, density)
    while error > function.misfit and density < _MAX_DENSITY:
        # the misfit decreases with the power DEGREE + 1; rounding the doublings down avoids too many cells
        doublings = int(np.log2(error / function.misfit) / (DEGREE + 1))
        density = min(density * 2 ** max(1, doublings), _MAX_DENSITY)
        finer = _fitted(function, breaks, density)
        if finer[-1] > error / _LEAST_GAIN and finer[-1] <= rounding:
            break
        starts, widths, counts, rows, error = finer
    mean = _mean(rows, widths)
    firsts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    begins, ends, largest = rows[firsts, 0], rows[firsts + counts - 1].sum(axis=1), np.max(np.abs(rows[:, 0]))
    steep = np.abs(ends - begins) > _STEEP * largest * np.diff(breaks)
    jumps = (np.abs(begins - np.roll(ends, 1)) > _JUMP * largest) | steep | np.roll(steep, 1)
    rows = _with_integrals(rows, widths, mean) if integrals else np.ascontiguousarray(rows)
    return starts, counts / np.diff(breaks), firsts, counts.astype(np.int64), jumps, rows, mean


def _fitted(function: Wave, breaks: Array, density: int) -> tuple[Array, Array, Integers, Array, float]:
    """Return starts of segments, widths of cells, cells per segment, coefficients per cell, and relative misfit."""
    counts = np.maximum(1, np.ceil(np.diff(breaks) * density - 1e-9)).astype(np.int64)
    widths = np.repeat(np.diff(breaks) / counts, counts)
    within = np.arange(widths.size) - np.repeat(np.cumsum(counts) - counts, counts)
    begins = np.repeat(breaks[:-1], counts) + widths * within
    values = function.value(begins[:, None] + widths[:, None] * _NODES)
    rows = values @ _INTERPOLATE.T
    fitted = rows @ np.vander(_CHECKED, DEGREE + 1, increasing=True).T
    misfit = np.max(np.abs(fitted - function.value(begins[:, None] + widths[:, None] * _CHECKED)))
    return breaks[:-1], widths, counts, rows, float(misfit / max(np.max(np.abs(values)), np.finfo(float).tiny))


def _mean(rows: Array, widths: Array) -> float:
    """Return the mean of polynomials over their cells."""
    return float(widths @ (rows @ (1 / np.arange(1, rows.shape[1] + 1))) / widths.sum())


def _with_integrals(rows: Array, widths: Array, mean: float) -> Array:
    """Return the rows extended by those of the three periodic integrals of the function minus its mean."""
    parts = [rows]
    rows = rows.copy()
    rows[:, 0] -= mean
    for _ in range(len(WIDTHS) - 1):
        risen = widths[:, None] * rows / np.arange(1, rows.shape[1] + 1)
        at_begin = np.concatenate([[0.0], np.cumsum(risen.sum(axis=1))[:-1]])
        rows = np.column_stack([at_begin, risen])
        rows[:, 0] -= _mean(rows, widths)
        parts.append(rows)
    return np.ascontiguousarray(np.hstack(parts))
