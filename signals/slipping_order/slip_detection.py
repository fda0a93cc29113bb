"""Detection of a slipping order: the path of slips with most power, and its false-alarm probability.

The record is cut into segments of equal shaft rotation, over which amplitude and slip can be taken as constant. The
power of each segment at a grid of slips is divided by that of the noise on both sides of the searched band, see
`noise_density`; the path through the grid with the largest sum of powers, less the cost of its changes, is found by
dynamic programming (Viterbi).

White noise of variance R gives a segment's power over R the moments E exp(theta power) = (1 - theta)^-1 for each
harmonic; with less than a turn in a segment they are larger, by less than the bound is too large. Over all paths,
Markov's inequality for exp(theta score) with the best theta bounds the probability of a score, the less tightly the
more the slip may change. The bound is averaged over the distribution of an estimated R.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import ceil, pi
from typing import Self

import numpy as np

from signals.harmonics._block_kernels import phasors
from signals.harmonics.noise_density import SEGMENT, noise_density
from signals.harmonics.state_space import Complexes, Floats, HarmonicModel, Indices


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipRecord:
    """A record with the shaft angle, which may rest and turn back."""

    x: Floats  # (n,)
    phase: Floats  # (n,), rad

    @cached_property
    def turning(self) -> Floats:
        """(n,) array, total rotation of the shaft since the first sample, in either direction, in rad."""
        return np.append(0.0, np.cumsum(np.abs(np.diff(self.phase))))

    @cached_property
    def per_rev(self) -> float:
        """Samples per revolution at the speed averaged over the angle, so that rests do not count."""
        step = np.diff(self.phase)
        return float(2 * pi * self.turning[-1] / (step @ step))


@dataclass(frozen=True, kw_only=True)
class Line:
    """The order searched for."""

    order: float  # of the fundamental, cycles per revolution
    harmonics: int  # number of harmonics
    largest_slip: float  # relative to the order
    slip_change: float  # standard deviation of the slip's change in a revolution

    @property
    def top(self) -> float:
        """Order of the highest harmonic."""
        return self.order * self.harmonics

    @property
    def steady_rev(self) -> float:
        """Revolutions over which the random walk of the slip turns the highest harmonic by a radian."""
        # A random walk of variance v a revolution turns by an angle of variance (2 pi order)^2 v m^3 / 3 in m of them.
        return float((np.sqrt(3) / (2 * pi * self.top * self.slip_change)) ** (2 / 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class Demodulated:
    """A record times exp(-j k order phase), summed over short blocks."""

    sums: Complexes  # (harmonic, block)
    counts: Floats  # (block,), of observed samples
    angle: Floats  # (block,), shaft angle at the middle of each, rad
    parts: tuple[slice, ...]  # the blocks of each segment

    @classmethod
    def of(cls, record: SlipRecord, *, order: float, harmonics: int, block: int, cuts: Indices) -> Self:
        """Sum over blocks of `block` samples, within segments that begin and end at the cuts."""
        n = record.x.size
        begins = np.zeros(n + 1, dtype=np.bool_)
        begins[::block] = begins[cuts] = True
        edges = np.flatnonzero(begins)
        observed = ~np.isnan(record.x)
        turn = phasors(order * record.phase)
        sums = np.empty((harmonics, edges.size - 1), dtype=np.complex128)
        product = np.where(observed, record.x, 0.0).astype(np.complex128)
        for harmonic in sums:
            product *= turn
            np.add.reduceat(product, edges[:-1], out=harmonic)
        return cls(
            sums=sums,
            counts=np.add.reduceat(observed.astype(np.float64), edges[:-1]),
            angle=record.phase[(edges[:-1] + edges[1:]) // 2],
            parts=tuple(slice(int(a), int(b)) for a, b in pairwise(np.searchsorted(edges, cuts))),
        )

    def power(self, part: slice, harmonic: int, deviations: Floats) -> Floats:
        """Return the (deviation,) power of a segment at these order differences from a harmonic; R in white noise."""
        lead = self.angle[part] - self.angle[part].mean()
        sums = phasors(np.outer(deviations, lead)) @ self.sums[harmonic, part]
        return np.asarray((sums.real**2 + sums.imag**2) / (self.counts[part].sum() or 1.0))


_TURN_OF_BLOCK = 1 / 32  # turns in a block at the largest order difference evaluated
_TILTS = np.arange(1, 20) / 20  # theta of the bound
# Estimated R over true R. Above the last ratio the bound is taken at the last, a small loss.
_RATIOS = np.geomspace(1e-4, 1.25, 600)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ridge:
    """The path of slips with most power."""

    turning: Floats  # (segment,), `SlipRecord.turning` in the middle of each segment
    slip: Floats  # (segment,)
    slip_width: float  # slip that adds one turn of the line in a segment
    noise_variance: float  # R
    false_alarm_probability: float  # bound on the probability of such a path in noise alone


def search(record: SlipRecord, line: Line, *, width: Floats, noise_variance: float | None) -> Ridge:
    """Search for the line; `width` is the bandwidth of its amplitude in cycles per sample, (1,) or (sample,)."""
    cuts = _cuts(record, line, width)
    # Where the shaft turns back, the angle covers less than the total rotation.
    cell = 2 * pi / float(np.median([np.ptp(record.phase[a : b + 1]) for a, b in pairwise(cuts)]))
    block = max(1, int(_TURN_OF_BLOCK * record.per_rev / (line.top * line.largest_slip + cell)))
    # Samples at which the shaft rests hold no information on the slip.
    still = np.concatenate([[True], np.diff(record.turning) == 0, [True]])
    turned = replace(record, x=np.where(still[:-1] & still[1:], np.nan, record.x))
    data = Demodulated.of(turned, order=line.order, harmonics=line.harmonics, block=block, cuts=cuts)
    noise, counted = (noise_variance, np.inf) if noise_variance else searched_noise(record, line)

    slip_width = cell / line.top
    half = max(1, ceil(2 * line.largest_slip / slip_width))  # two slips for each width (1 / segment) of a line
    grid = np.linspace(-line.largest_slip, line.largest_slip, 2 * half + 1)
    away = np.outer(np.arange(1, line.harmonics + 1), line.order * grid)
    power = np.array([sum(data.power(part, k, each) for k, each in enumerate(away)) for part in data.parts]) / noise
    middle = np.interp(cuts[:-1] / 2 + cuts[1:] / 2, np.arange(record.x.size), record.turning)
    change = line.slip_change**2 * np.diff(middle) / (2 * pi) + (grid[1] - grid[0]) ** 2 / 12
    slip, score = _best_path(power, grid, change)
    powers = line.harmonics * sum(bool(data.counts[part].any()) for part in data.parts)
    probability = chance(score, grid, change, powers=powers, counted=counted)
    if noise_variance is None:
        noise = noise_along(record, line, middle, slip, width=width, searched=noise)
    return Ridge(
        turning=middle, slip=slip, slip_width=slip_width, noise_variance=noise, false_alarm_probability=probability
    )


def searched_noise(record: SlipRecord, line: Line) -> tuple[float, float]:
    """Return R from both sides of the searched bands, and the number of powers of noise with a mean as certain."""
    searched = line.largest_slip * line.order * np.arange(1.0, line.harmonics + 1) / record.per_rev
    noise, freedom = _on_both_sides(record, line, record.phase, searched, np.nan, curved=False)
    if not noise > 0:
        what = "no noise" if noise == 0 else "too little"
        raise ValueError(
            f"x shows {what} on both sides of order {line.order:g}, and without its variance nothing can be weighed: "
            "take a longer record or fewer harmonics, or pass noise_variance."
        )
    return noise, freedom / 2


def noise_along(
    record: SlipRecord, line: Line, turning: Floats, slip: Floats, *, width: Floats, searched: float
) -> float:
    """Return R from both sides of the harmonics along a path of slips, where `searched` is R about all paths."""
    # a smooth course of the slip: the density takes steps in speed for a line that sweeps over its neighbours
    smooth = np.polynomial.Polynomial.fit(turning, slip, min(3, slip.size - 1))(record.turning)
    phase = record.phase + np.append(0.0, np.cumsum(smooth[1:] * np.diff(record.phase)))
    widest = max(float(width.max()), 1 / (line.steady_rev * record.per_rev))
    curved = widest * record.per_rev * record.turning[-1] / (2 * pi) >= SEGMENT
    return _on_both_sides(record, line, phase, np.full(line.harmonics, widest), searched, curved=curved)[0]


def _on_both_sides(
    record: SlipRecord, line: Line, phase: Floats, bandwidth: Floats, white: float, *, curved: bool
) -> tuple[float, float]:
    """Return the geometric mean of the density about the harmonics and its degrees of freedom."""
    model = HarmonicModel(
        orders=line.order * np.arange(1.0, line.harmonics + 1), shaft=np.zeros(line.harmonics, dtype=np.int64),
        phases=(phase,), bandwidth=bandwidth[:, None], poles=1, prior_std=1.0,
    )  # fmt: skip
    seen = ~np.isnan(record.x)
    density, freedom = noise_density(np.where(seen, record.x, 0.0)[None], seen, model, np.array([white]), curved=curved)
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(density).mean())), float(freedom.mean())


def _cuts(record: SlipRecord, line: Line, width: Floats) -> Indices:
    """Return the first samples of segments with nearly constant amplitude and slip, and the end of the last one."""
    turning = record.turning
    mean = width[0] if width.size == 1 else np.average(width[1:], weights=np.diff(turning))
    longest = 2 * pi / (mean * record.per_rev) if mean > 0 else np.inf
    segments = max(1, round(turning[-1] / min(longest, 2 * pi * line.steady_rev)))
    inner = np.searchsorted(turning, turning[-1] * np.arange(1, segments) / segments)
    return np.unique(np.concatenate([[0], inner, [turning.size]]))


def _best_path(power: Floats, grid: Floats, change: Floats) -> tuple[Floats, float]:
    """Return the slips and the score of the best path: power less half the squared changes over their variances."""
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
    return grid[path], float(score.max())


def chance(score: float, grid: Floats, change: Floats, *, powers: int, counted: float) -> float:
    """Return a bound on the probability that a path through powers of noise reaches this score.

    `grid` are the slips searched, `change`, (segment - 1,), the variances of their changes, `powers` how many there are
    in a path. R is the mean of `counted` powers of noise, infinite where it is known.
    """
    from scipy.special import gammainc  # noqa: PLC0415

    below = gammainc(counted, counted * np.append(_RATIOS[:-1], np.inf)) if counted < np.inf else 1.0 * (_RATIOS >= 1)
    tilts = _RATIOS[:, None] * _TILTS
    nodes = np.append(0.0, np.arange(1, 26) / 20)
    # Logarithms of sums of exponentials are convex: chords lie above.
    paths = np.interp(tilts, nodes, _log_paths(grid, change, nodes))
    bounds = np.exp(np.minimum(0.0, np.min(-powers * np.log1p(-_TILTS) - tilts * score + paths, axis=1)))
    return float(min(1.0, below[0] + bounds[:-1] @ np.diff(below)))


def _log_paths(grid: Floats, change: Floats, tilts: Floats) -> Floats:
    """Return the (theta,) logarithms of the sums of exp(-theta cost) over all paths."""
    cost = tilts[:, None, None] * (grid[:, None] - grid) ** 2 / 2
    paths, total = np.ones((tilts.size, grid.size, 1)), np.zeros((tilts.size, 1, 1))
    for variance in change:
        paths = np.exp(-cost / variance) @ paths
        largest = paths.max(axis=1, keepdims=True)
        total += np.log(largest)
        paths /= largest
    return np.asarray((total + np.log(paths.sum(axis=1, keepdims=True))).ravel())
