"""Where a slipping line is: the path through slips that has most power, and whether noise alone would have it.

The record is cut into segments in which the shaft turns equally far, over which amplitude and slip can be taken for
constant. The power of each at a grid of slips is weighed against that of the noise beside; the path through these
cells that has most, less what its changes cost, is found by dynamic programming (Viterbi). Samples at which the shaft
rests tell nothing of a slip, and are left out.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._slip_chance import chance, power_spreads
from signals.harmonics._slip_noise import cells_beside, noise_beside
from signals.harmonics._slip_record import Demodulated, Line, SlipRecord

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

_CELLS_PER_WIDTH = 2  # of slips searched, for each width (1 / segment) of a line
_TURN_OF_BLOCK = 1 / 32  # of a turn, at the edge of what is looked at


@dataclass(frozen=True, kw_only=True, eq=False)
class Ridge:
    """The path of slips with most power.

    Attributes
    ----------
    turning : (segment,) array, `SlipRecord.turning` in the middle of each segment.
    slip : (segment,) array.
    slip_width : the slip that turns the line once more in a segment.
    noise_variance : R.
    false_alarm_probability : bound on that of noise alone having such a path.
    """

    turning: Floats
    slip: Floats
    slip_width: float
    noise_variance: float
    false_alarm_probability: float


def search(record: SlipRecord, line: Line, *, width: Floats, noise_variance: float | None) -> Ridge:
    """Look for the line; `width` is the bandwidth of its amplitude in cycles a sample, one or one a sample."""
    cuts = _cuts(record.turning, min(record.memory_rad(width), 2 * pi * line.steady_rev))
    # The angle comes less far than the shaft turns where it turns back.
    swing = float(np.median([np.ptp(record.phase[a : b + 1]) for a, b in pairwise(cuts)]))
    cell = 2 * pi / swing
    cells = cells_beside(record, line, width=cell, segments=cuts.size - 1)
    farthest = 0.0 if noise_variance is not None else float(np.abs(cells.away).max(initial=0.0))
    reach = max(farthest, line.top * line.largest_slip + cell)
    block = max(1, int(_TURN_OF_BLOCK * record.per_rev / reach))
    turned = record.while_turning()
    data = Demodulated.of(turned, order=line.order, harmonics=line.harmonics, block=block, cuts=cuts)
    seen = replace(turned, x=np.where(np.isnan(turned.x), np.nan, 1.0))
    ones = Demodulated.of(seen, order=line.order, harmonics=2 * line.harmonics, block=block, cuts=cuts)
    noise, counted = (noise_variance, None) if noise_variance else noise_beside(data, cells, order=line.order)
    slip_width = cell / line.top
    half = max(1, ceil(_CELLS_PER_WIDTH * line.largest_slip / slip_width))
    grid = np.linspace(-line.largest_slip, line.largest_slip, 2 * half + 1)
    power = _powers(data, line.order * grid) / noise
    middle = np.interp(cuts[:-1] / 2 + cuts[1:] / 2, np.arange(record.x.size), record.turning)
    change = line.slip_change**2 * np.diff(middle) / (2 * pi) + (grid[1] - grid[0]) ** 2 / 12
    path, score = _best_path(power, grid, change)
    spreads = power_spreads(ones, order=line.order, largest_slip=line.largest_slip)
    return Ridge(
        turning=middle,
        slip=_summits(power, grid, path),
        slip_width=slip_width,
        noise_variance=noise,
        false_alarm_probability=chance(score, grid, change, spreads=spreads, counted=counted),
    )


def _cuts(turning: Floats, span: float) -> Whole:
    """First samples of segments in which the shaft turns by about the span, and one past the last."""
    segments = max(1, round(turning[-1] / span))
    inner = np.searchsorted(turning, turning[-1] * np.arange(1, segments) / segments)
    return np.unique(np.concatenate([[0], inner, [turning.size]]))


def _powers(data: Demodulated, deviations: Floats) -> Floats:
    """Power of each segment at each deviation of the order, summed over the harmonics; white noise has R in each."""
    powers = np.zeros((len(data.parts), deviations.size))
    for segment, part in enumerate(data.parts):
        lead = data.angle[part] - data.angle[part].mean()
        for k, harmonic in enumerate(data.sums, start=1):
            powers[segment] += np.abs(np.exp(-1j * k * np.outer(deviations, lead)) @ harmonic[part]) ** 2
        powers[segment] /= max(1.0, data.counts[part].sum())
    return powers


def _best_path(power: Floats, grid: Floats, change: Floats) -> tuple[Whole, float]:
    """Find the path with most power, less half its squared changes over their variances; and its score."""
    score = power[0]
    came_from = np.empty((len(power), grid.size), dtype=np.int64)
    apart = (grid[:, None] - grid) ** 2 / 2
    for segment, variance in enumerate(change, start=1):
        options = score - apart / variance
        came_from[segment] = options.argmax(axis=1)
        score = options.max(axis=1) + power[segment]
    path = np.empty(len(power), dtype=np.int64)
    path[-1] = score.argmax()
    for segment in range(len(power) - 1, 0, -1):
        path[segment - 1] = came_from[segment, path[segment]]
    return path, float(score.max())


def _summits(power: Floats, grid: Floats, path: Whole) -> Floats:
    """Slips of a path, each moved to the summit of the parabola through its cell and the two beside it."""
    at = np.clip(path, 1, grid.size - 2)
    left, middle, right = (power[np.arange(path.size), at + side] for side in (-1, 0, 1))
    bend = left - 2 * middle + right
    summit = (at == path) & (bend < 0) & (middle >= left) & (middle >= right)
    shift = np.where(summit, 0.5 * (left - right) / np.where(summit, bend, 1.0), 0.0)
    return np.asarray(grid[path] + shift * (grid[1] - grid[0]))
