"""Tables of periodic functions of the mesh phase, which compiled code evaluates and integrates to rounding.

Between two jumps a function is divided into equal cells with one polynomial each. Tables of stiffnesses also hold the
first three periodic integrals of the function minus its mean, so that its moments over any interval of phase, across
jumps or cycles, take two look-ups.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from data_synth.gears.mesh_stiffness import Constant

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

DEGREE = 5
WIDTHS = (6, 7, 8, 9)  # coefficients of the function and of its three integrals, side by side in a row
_MIN_DENSITY, _MAX_DENSITY = 16, 2048  # cells per mesh cycle
FIT = 1e-11  # of the largest value: cells are halved until the polynomials are this accurate
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


class Periodic(Protocol):
    """A function of phase in cycles; it may list its `jumps` in [0, period)."""

    @property
    def period(self) -> int:
        """Period in cycles."""

    def __call__(self, phase_cycles: Array) -> Array:
        """Return its values at phases in cycles, any shape."""


def tabulated(functions: Sequence[Periodic], *, misfit: float = FIT, integrals: bool = True) -> Waves:
    """Return the tables of functions, with their integrals or, in a fifth of the memory, without.

    `misfit` is the tolerated error relative to the largest value. The last table is that of the unit function.
    """
    tables = [_table(each, misfit=misfit, integrals=integrals) for each in (*functions, Constant(mean=1.0))]
    segments = np.cumsum([0, *(table.starts.size for table in tables)])
    cells = np.cumsum([0, *(table.rows.shape[0] for table in tables)])
    joined = Waves(*(np.concatenate(columns) for columns in zip(*tables, strict=True)))
    return joined._replace(
        segments=segments,
        firsts=np.concatenate([table.firsts + cell for table, cell in zip(tables, cells, strict=False)]),
        lookup=np.concatenate([table.lookup + segment for table, segment in zip(tables, segments, strict=False)]),
    )


def _table(function: Periodic, *, misfit: float, integrals: bool) -> Waves:
    """Return the table of one function."""
    breaks = np.unique(np.array([0.0, *getattr(function, "jumps", ()), function.period]))
    # phases are rounded, and a value may change by its whole range over the shortest segment
    rounding = 4 * np.finfo(float).eps * function.period / float(np.min(np.diff(breaks)))
    density = _MIN_DENSITY
    starts, widths, counts, rows, error = _fitted(function, breaks, density)
    while error > misfit and density < _MAX_DENSITY:
        # the misfit decreases with the power DEGREE + 1; rounding the doublings down avoids too many cells
        doublings = int(np.log2(error / misfit) / (DEGREE + 1))
        density = min(density * 2 ** max(1, doublings), _MAX_DENSITY)
        finer = _fitted(function, breaks, density)
        if finer[-1] > error / _LEAST_GAIN and finer[-1] <= rounding:
            break
        starts, widths, counts, rows, error = finer
    mean = _mean(rows, widths)
    firsts = np.cumsum(counts) - counts
    begins, ends, largest = rows[firsts, 0], rows[firsts + counts - 1].sum(axis=1), np.max(np.abs(rows[:, 0]))
    steep = np.abs(ends - begins) > _STEEP * largest * np.diff(breaks)
    rate = starts.size / function.period
    return Waves(
        periods=np.array([float(function.period)]),
        means=np.array([mean]),
        segments=np.array([0, starts.size]),
        starts=starts,
        densities=counts / np.diff(breaks),
        firsts=firsts,
        counts=counts,
        jumps=(np.abs(begins - np.roll(ends, 1)) > _JUMP * largest) | steep | np.roll(steep, 1),
        rows=_with_integrals(rows, widths, mean) if integrals else np.ascontiguousarray(rows),
        lookup_rates=np.array([rate]),
        lookup=np.searchsorted(starts, np.arange(starts.size) / rate, side="right") - 1,
    )


def _fitted(function: Periodic, breaks: Array, density: int) -> tuple[Array, Array, Integers, Array, float]:
    """Return starts of segments, widths of cells, cells per segment, coefficients per cell, and relative misfit."""
    counts = np.maximum(1, np.ceil(np.diff(breaks) * density - 1e-9)).astype(np.int64)
    widths = np.repeat(np.diff(breaks) / counts, counts)
    within = np.arange(widths.size) - np.repeat(np.cumsum(counts) - counts, counts)
    begins = np.repeat(breaks[:-1], counts) + widths * within
    values = function(begins[:, None] + widths[:, None] * _NODES)
    rows = values @ _INTERPOLATE.T
    fitted = rows @ np.vander(_CHECKED, DEGREE + 1, increasing=True).T
    misfit = np.max(np.abs(fitted - function(begins[:, None] + widths[:, None] * _CHECKED)))
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
