"""Where a slipping line is: the path through slips that has most power, and whether noise alone would have it.

The record is cut into segments over which amplitude and slip can be taken for constant; the power of each at a grid
of slips, over that of noise beside the band, is exponentially distributed where there is no line. The path through
these cells that has most power, less what its changes cost, is found by dynamic programming (Viterbi). Over all
paths, Markov's inequality for exp(theta score) with the best theta bounds the probability that noise alone has a path
as good. It is the looser the livelier the slip may be.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, log, pi

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _slip_kernels

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Whole = NDArray[np.int64]

_CELLS_PER_WIDTH = 2  # of slips searched, for each width (1 / segment) of a line
_NOISE_CELLS = np.arange(3, 19)  # widths beyond the searched band, on either side, at which the noise is measured
_FEWEST_NOISE_CELLS = 16
_TURN_OF_BLOCK = 1 / 32  # of a turn, at the edge of what is looked at
_TILTS = np.linspace(0.05, 0.95, 19)  # theta of the bound


@dataclass(frozen=True, kw_only=True)
class Line:
    """What is looked for.

    Attributes
    ----------
    order : cycles per revolution.
    harmonics : how many.
    largest_slip : relative.
    slip_change : standard deviation of the slip's change in a revolution.
    """

    order: float
    harmonics: int
    largest_slip: float
    slip_change: float

    @property
    def top(self) -> float:
        """Order of the highest harmonic."""
        return self.order * self.harmonics

    @property
    def steady_rev(self) -> float:
        """Revolutions over which the walk of the slip turns the highest harmonic by a radian."""
        # A walk of variance v a revolution turns by an angle of variance (2 pi order)^2 v m^3 / 3 in m of them.
        return float((np.sqrt(3) / (2 * pi * self.top * self.slip_change)) ** (2 / 3))

    def check(self, x: Floats, phase: Floats) -> None:
        if phase.size != x.size:
            raise ValueError(f"phase_rad has {phase.size} values for {x.size} samples of x; give one angle per sample.")
        if self.largest_slip >= 1:
            raise ValueError(
                f"largest_slip={self.largest_slip:g} is relative to the order and must be below 1; 2 % is 0.02."
            )
        if phase[-1] == phase[0]:
            raise ValueError("phase_rad ends where it began: the shaft has not turned, and no order can be told.")
        step = np.diff(phase)
        np.abs(step, out=step)
        at = int(step.argmax())
        fastest = self.top * (1 + self.largest_slip) * step[at]
        if fastest > pi:
            raise ValueError(
                f"order {self.top:g} with a slip of {self.largest_slip:g} turns by {fastest:.4g} rad between samples "
                f"{at} and {at + 1}; more than pi is above half of the rate: take fewer harmonics, raise the rate, or "
                "mend the phase there."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Ridge:
    """The path of slips with most power.

    Attributes
    ----------
    angle_rad : (segment,) array, shaft angle at the middle of each segment.
    slip : (segment,) array.
    slip_width : the slip that turns the line once more in a segment.
    noise_variance : R.
    false_alarm_probability : bound on that of noise alone having such a path.
    """

    angle_rad: Floats
    slip: Floats
    slip_width: float
    noise_variance: float
    false_alarm_probability: float


def search(x: Floats, phase: Floats, line: Line, *, memory: float, noise_variance: float | None) -> Ridge:
    """Look for the line where its amplitude keeps for `memory` samples."""
    per_rev = x.size * 2 * pi / abs(float(phase[-1] - phase[0]))
    length = min(memory, line.steady_rev * per_rev, float(x.size))
    reach = line.top * line.largest_slip + (_NOISE_CELLS[-1] + 1) * per_rev / length  # orders either side
    block = max(1, int(_TURN_OF_BLOCK * per_rev / reach))
    edges = np.append(np.arange(0, x.size - block // 2, block), x.size)
    sums = np.zeros((line.harmonics, edges.size - 1), dtype=np.complex128)
    counts = np.zeros(edges.size - 1)
    _slip_kernels.demodulate(x, phase, line.order, edges, sums, counts)
    angle = phase[(edges[:-1] + edges[1:]) // 2]
    segments = max(1, round(x.size / length))
    cuts = np.linspace(0, edges.size - 1, segments + 1).round().astype(np.int64)
    parts = [slice(a, b) for a, b in pairwise(cuts) if b > a]
    span = abs(float(phase[-1] - phase[0])) / len(parts)  # rad
    noise = noise_variance or _noise_beside(sums, counts, angle, parts, line=line, width=2 * pi / span)
    slip_width = 2 * pi / (span * line.top)
    half = max(1, ceil(_CELLS_PER_WIDTH * line.largest_slip / slip_width))
    grid = np.linspace(-line.largest_slip, line.largest_slip, 2 * half + 1)
    power = np.array([_power(sums, counts, angle, part, line.order * grid) for part in parts]) / noise
    middle = np.array([angle[part].mean() for part in parts])
    change = line.slip_change**2 * np.abs(np.diff(middle)) / (2 * pi) + (grid[1] - grid[0]) ** 2 / 12
    path, score = _best_path(power, grid, change)
    observed = sum(bool(counts[part].any()) for part in parts)
    return Ridge(
        angle_rad=middle,
        slip=_summits(power, grid, path),
        slip_width=slip_width,
        noise_variance=noise,
        false_alarm_probability=_chance(score, grid, change, degrees=observed * line.harmonics),
    )


def _power(sums: Complexes, counts: Floats, angle: Floats, part: slice, deviations: Floats) -> Floats:
    """Sum over the harmonics of a segment's power at each deviation of the order; white noise has R each."""
    total = np.zeros(deviations.size)
    lead = angle[part] - angle[part].mean()
    for k, harmonic in enumerate(sums, start=1):
        turned = np.exp(-1j * k * np.outer(deviations, lead)) @ harmonic[part]
        total += np.abs(turned) ** 2
    return np.asarray(total / max(1.0, counts[part].sum()))


def _noise_beside(
    sums: Complexes, counts: Floats, angle: Floats, parts: list[slice], *, line: Line, width: float
) -> float:
    """Variance of white noise as dense as that on either side of the searched bands."""
    cells = []
    for k, harmonic in enumerate(sums, start=1):
        far = k * line.order * line.largest_slip + width * _NOISE_CELLS
        beside = np.concatenate([-far[far < k * line.order], far])
        for part in parts:
            lead = angle[part] - angle[part].mean()
            # Hann's window keeps the line itself out of cells three widths away.
            window = 0.5 + 0.5 * np.cos(lead * (2 * pi / max(np.ptp(lead), 1e-300)))
            seen = np.sum(window**2 * counts[part])
            if counts[part].sum() > counts[part].size / 2 and seen > 0:
                turned = np.exp(-1j * np.outer(beside, lead)) @ (window * harmonic[part])
                cells.append(np.abs(turned) ** 2 / seen)
    values = np.concatenate(cells) if cells else np.empty(0)
    noise = float(np.median(values)) / log(2) if values.size >= _FEWEST_NOISE_CELLS else 0.0
    if noise <= 0:
        raise ValueError(
            f"x shows no noise beside order {line.order:g} ({values.size} cells were looked at), and without it "
            "nothing can be weighed: pass noise_variance."
        )
    return noise


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


def _chance(score: float, grid: Floats, change: Floats, *, degrees: int) -> float:
    """Bound the probability that a path through cells of noise reaches this score."""
    apart = (grid[:, None] - grid) ** 2 / 2
    best = 0.0
    for tilt in _TILTS:
        paths, bound = np.ones(grid.size), -tilt * score - degrees * np.log1p(-tilt)
        for variance in change:
            paths = np.exp(-tilt * apart / variance) @ paths
            bound += log(paths.max())
            paths /= paths.max()
        best = min(best, bound + log(paths.sum()))
    return float(np.exp(best))
