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

import numpy as np

from signals.harmonics._block_kernels import phasors
from signals.harmonics.noise_density import SEGMENT, noise_density
from signals.harmonics.state_space import Floats, HarmonicModel, Indices

# Length of a block times the bandwidth, and over the segment in which the random walk of the slip turns the line by a
# radian: holding amplitude and slip constant in a block changes the estimates by a few 1e-4 of their std.
_BLOCK = 1 / 200
_SLIP_BLOCK = 1 / 50
_TURN_OF_BLOCK = 1 / 16  # turns in a block by the largest slip: of the power there, 1.3 % are lost


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipRecord:
    """A record with the shaft angle, which may rest and turn back, and the order searched for."""

    x: Floats  # (n,)
    model: HarmonicModel  # of the harmonics of the order, equally wide, about the angle
    largest_slip: float  # relative to the order
    slip_change: float  # standard deviation of the change of the slip over one revolution
    every: int | None = None  # samples from output to output

    @property
    def steady_rev(self) -> float:
        """Revolutions over which the random walk of the slip turns the highest harmonic by a radian."""
        # A random walk whose variance grows by v per revolution turns the line, in m revolutions, by an angle of
        # variance (2 pi order)^2 v m^3 / 3.
        return float((np.sqrt(3) / (2 * pi * self.model.orders[-1] * self.slip_change)) ** (2 / 3))

    @cached_property
    def turning(self) -> Floats:
        """(n,) array, total rotation of the shaft since the first sample, in either direction, in rad."""
        return np.append(0.0, np.cumsum(np.abs(np.diff(self.model.phases[0]))))

    @cached_property
    def per_rev(self) -> float:
        """Samples per revolution at the speed averaged over the angle, so that rests do not count."""
        step = np.diff(self.model.phases[0])
        return float(2 * pi * self.turning[-1] / (step @ step))

    @cached_property
    def blocks(self) -> tuple[Indices, Indices, Indices]:
        """Blocks with nearly constant amplitude and slip.

        (block + 1,) first samples and one past the last, (block,) middle samples, (output,) blocks with an output.
        """
        n, turns = self.x.size, self.model.orders[-1] * self.largest_slip  # per revolution, due to slip
        most_rev = min(_SLIP_BLOCK * self.steady_rev, _TURN_OF_BLOCK / turns)
        longest = max(1, int(min(_BLOCK / float(self.model.bandwidth.max()), most_rev * self.per_rev)))
        longest -= (longest + 1) % 2 if longest > 1 else 0  # an odd number of samples has a middle one
        every = min(self.every or longest, n)
        shares = -(-every // longest)  # the fewest blocks per output of which none is too long
        count = round(n * shares / every)
        edges = np.append(np.arange(count) * every // shares, n)
        return edges, (edges[:-1] + edges[1:] - 1) // 2, np.arange(shares // 2, count, shares)

    @cached_property
    def segments(self) -> tuple[slice, ...]:
        """Blocks of each segment with nearly constant amplitude and slip."""
        width = np.broadcast_to(self.model.bandwidth[0], self.x.size)[1:]
        per_rev = np.average(width, weights=np.diff(self.turning)) * self.per_rev
        count = max(1, round(self.turning[-1] / (2 * pi) * max(per_rev, 1 / self.steady_rev)))
        turning, begins = self.turning[self.blocks[1]], self.turning[-1] * np.arange(count) / count
        cuts = np.unique([*np.searchsorted(turning, begins).tolist(), turning.size])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(cuts))


_TILTS = np.arange(1, 20) / 20  # theta of the bound
# Estimated R over true R. Above the last ratio the bound is taken at the last, a small loss.
_RATIOS = np.geomspace(1e-4, 1.25, 600)


def search(record: SlipRecord, *, noise_variance: float | None) -> tuple[Floats, float, float, float]:
    """Search for the line.

    Returns the (block,) path of slips with most power, the slip that adds one turn of the line in a segment, R, and a
    bound on the probability of such a path in noise alone.
    """
    model, (edges, centres, _) = record.model, record.blocks
    phase, revolutions = model.phases[0], record.turning[-1] / (2 * pi)
    # Where the shaft turns back, the angle covers less than the total rotation.
    spans = [np.ptp(phase[edges[part.start] : edges[part.stop] + 1]) for part in record.segments]
    slip_width = 2 * pi / float(np.median(spans)) / model.orders[-1]
    half = max(1, ceil(2 * record.largest_slip / slip_width))  # two slips for each width (1 / segment) of a line
    grid = np.linspace(-record.largest_slip, record.largest_slip, 2 * half + 1)
    noise, freedom = noise_variance or 0.0, np.inf
    if noise_variance is None:
        searched = record.largest_slip * model.orders / record.per_rev
        noise, freedom = _on_both_sides(record.x, replace(model, bandwidth=searched[:, None]), np.nan, curved=False)
        if not noise > 0:
            raise ValueError(
                f"x shows {'no noise' if noise == 0 else 'too little'} on both sides of order {model.orders[0]:g}, and "
                "without its variance nothing can be weighed: take a longer record or fewer harmonics, or pass "
                "noise_variance."
            )
    power, powers = _power(record, grid)
    turning = record.turning[centres]
    middle = np.array([(turning[part][0] + turning[part][-1]) / 2 for part in record.segments])
    change = record.slip_change**2 * np.diff(middle) / (2 * pi) + (grid[1] - grid[0]) ** 2 / 12
    slip, score = _best_path(power / noise, grid, change)
    probability = chance(score, grid, change, powers=powers, counted=freedom / 2)
    if noise_variance is None:
        # a smooth course of the slip: the density takes steps in speed for a line that sweeps over its neighbours
        smooth = np.polynomial.Polynomial.fit(middle, slip, min(3, slip.size - 1))(record.turning)
        phase = phase + np.append(0.0, np.cumsum(smooth[1:] * np.diff(phase)))
        widest = max(float(model.bandwidth.max()), 1 / (record.steady_rev * record.per_rev))
        along = replace(model, phases=(phase,), bandwidth=np.full((model.orders.size, 1), widest))
        curved = widest * record.per_rev * revolutions >= SEGMENT
        noise, _ = _on_both_sides(record.x, along, noise, curved=curved)
    return np.interp(turning, middle, slip), slip_width, noise, probability


def _power(record: SlipRecord, grid: Floats) -> tuple[Floats, int]:
    """Return the (segment, slip) sums of the harmonics' powers, R each in white noise, and how many are in a path."""
    (edges, centres, _), orders, phase = record.blocks, record.model.orders, record.model.phases[0]
    # Samples at which the shaft rests hold no information on the slip.
    still = np.concatenate([[True], np.diff(record.turning) == 0, [True]])
    seen = ~(np.isnan(record.x) | (still[:-1] & still[1:]))
    counts = np.array([np.count_nonzero(seen[edges[part.start] : edges[part.stop]]) for part in record.segments])
    power = np.zeros((counts.size, grid.size))
    product, turn = np.where(seen, record.x, 0.0).astype(np.complex128), phasors(orders[0] * phase)
    for order in orders:
        product *= turn
        sums = np.add.reduceat(product, edges[:-1])
        for segment, part in enumerate(record.segments):
            angle = phase[centres[part]]
            away = phasors(np.outer(order * grid, angle - angle.mean()))
            power[segment] += np.abs(away @ sums[part]) ** 2 / max(counts[segment], 1)
    return power, orders.size * int(np.count_nonzero(counts))


def _on_both_sides(x: Floats, model: HarmonicModel, white: float, *, curved: bool) -> tuple[float, float]:
    """Return the geometric mean of the density about the orders and its degrees of freedom."""
    seen = ~np.isnan(x)
    density, freedom = noise_density(np.where(seen, x, 0.0)[None], seen, model, np.array([white]), curved=curved)
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(density).mean())), float(freedom.mean())


def _best_path(power: Floats, grid: Floats, change: Floats) -> tuple[Floats, float]:
    """Return the slips and the score of the best path: power less half the squared changes over their variances."""
    score, came_from, apart = power[0], list[Indices](), (grid[:, None] - grid) ** 2 / 2
    for row, variance in zip(power[1:], change, strict=True):
        options = score - apart / variance
        came_from.append(options.argmax(axis=1))
        score = options.max(axis=1) + row
    path = [int(score.argmax())]
    for before in reversed(came_from):
        path.append(int(before[path[-1]]))
    return grid[path[::-1]], float(score.max())


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
