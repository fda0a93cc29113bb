"""Orders smoothed at the knots of a grid: each on its own first, then together what disturbs one another.

In the midst of a record, a smoother leaves of its neighbours what its response lets through. Where the record ends
or has a gap it leaves more, as much as the causal filter would of what whole hats let through; and a hat cut short
lets through nearly anything. So there more orders are smoothed together, and what the others of the first round
explain is taken out under the hats that are cut.
"""

from math import log, pi

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _block_kernels
from signals.harmonics._information import KnotChain, smooth_knots
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.grid import Grid, hat_sums, pieces_between
from signals.harmonics.model import Floats, Indices
from signals.harmonics.separability import Closeness, coupled, leaks, left_over

Levels = NDArray[np.complex128]

# A hat of which less than this is there tells nothing of an order on its own.
SMALLEST_SHARE = 0.6
# A cut is forgotten to a few per cent in so many memories: of what the hat over it tells, that is little.
FEWEST_MEMORIES = 3.0
# Where a round moves lone amplitudes at cut hats by more than so many tolerances, what it took out under these hats was
# wrong by so much, of which a part is left, and another follows, for them.
MOST_MOVED = 3.0
MOST_ROUNDS = 6
# Orders smoothed together near ends and gaps, at most, where nearly all disturb one another a little.
MOST_AT_ENDS = 12


def smooth_apart(grid: Grid, first: int) -> tuple[Levels, Floats, Floats]:
    """Smooth every order of a record as if it were alone.

    Parameters
    ----------
    grid : the record.
    first : the knot whose innovations count first.

    Returns
    -------
    levels : (channel, order, knot) array.
    variances : (order, knot) array.
    log_variances : (order,) array, sums of the log variances of the innovations from knot `first` on.
    """
    orders = grid.model.orders.size
    weight, _ = grid.weights
    weight = np.where(weight < SMALLEST_SHARE * grid.length, 0.0, weight)
    weight[0] = weight[grid.samples // grid.length :] = 0.0
    data = grid.data * (weight > 0)[:, None, None]
    levels = np.zeros((len(grid.x), orders, grid.knots), dtype=np.complex128)
    variances, log_variances = np.empty((orders, grid.knots)), np.empty(orders)
    for group in _alike(grid, np.arange(orders)):
        levels[:, group], variances[group], log_variances[group] = _alone(
            grid, group, data[group], weight, slice(0, grid.knots), first
        )
    return levels, variances, log_variances


def _alike(grid: Grid, orders: Indices) -> list[Indices]:
    """Return groups of some orders of equal walks: one bandwidth, sums of as many, and all or none of them the mean."""
    if not orders.size:
        return []
    model = grid.model
    keys = np.column_stack([model.orders[orders] != 0, grid.shared[orders], model.bandwidth[orders]])
    _, member = np.unique(keys, axis=0, return_inverse=True)
    return [orders[member.ravel() == number] for number in range(member.max() + 1)]


def _alone(
    grid: Grid, group: Indices, data: Floats, weight: Floats, knots: slice, first: int
) -> tuple[Levels, Floats, float]:
    """Smooth orders that share a walk, each as if alone, over a range of knots.

    Parameters
    ----------
    data : (order, knot, channel, 2) array, sums under the hats, zero where `weight` is.
    weight : (knot,) array, samples under the hats.

    Returns
    -------
    levels : (channel, order, knot) array.
    variance : (knot,) array, of each of them.
    log_variance : as in `smooth_apart`.
    """
    turning = bool(grid.model.orders[group[0]])
    parts = 2 if turning else 1
    channels = len(grid.x)
    lanes = data[..., :parts].transpose(1, 0, 2, 3).reshape(len(weight), 1, -1)
    walk = grid.walk_variance(group[:1])[:, :1]
    chain = KnotChain(
        gram=(weight / parts)[:, None, None],
        data=np.ascontiguousarray(lanes),
        offset=np.ascontiguousarray(grid.weights[1][knots]),
        walk_variance=(walk if len(walk) == 1 else walk[knots]).copy(),
        prior_variance=grid.prior_variance(group[:1], knots.start)[:, :1].copy(),
    )
    found, variance, log_variance = smooth_knots(chain, first=first)
    found = found.reshape(len(weight), group.size, channels, parts).transpose(2, 1, 0, 3)
    levels = found[..., 0].astype(np.complex128)
    if turning:
        levels.imag = found[..., 1]
    return levels, variance[:, 0], parts * log_variance


class _Cut:
    """Hats cut short, and what they say once what the last round explains is taken out.

    Attributes
    ----------
    knots : of such hats.
    left : (order, cut knot, channel, 2) array, sums under them as `Grid.data`, of what all amplitudes leave.
    levels : (order, cut knot, channel, 2) array, amplitudes there.
    """

    def __init__(self, grid: Grid, levels: Levels) -> None:
        self.grid = grid
        weight, offset = grid.weights
        self.knots = np.flatnonzero((weight < (1 - grid.tolerance) * grid.length) | grid.kinked)
        self._pieces = pieces_between(levels, cubic=grid.model.poles > 1)
        self.left = self._sums(np.arange(len(grid.data)), self.knots, of_rest=True)
        place = (self.knots + offset[self.knots]).clip(0, grid.blocks)
        block = np.minimum(place.astype(np.int64), grid.blocks - 1)
        powers = (place - block)[:, None, None] ** np.arange(4)
        at_hats = np.sum(self._pieces[:, :, block] * powers, axis=-1)
        self.levels = at_hats.transpose(1, 2, 0, 3)

    def without_others(self, group: Indices, knots: slice) -> Floats:
        """(order, cut knot, channel, 2) array, sums for a group in a range of knots, less the waveforms of others."""
        there, _ = self.inside(knots)
        return self.left[group][:, there] + self._sums(group, self.knots[there], of_rest=False)

    def _sums(self, orders: Indices, knots: Indices, *, of_rest: bool) -> Floats:
        """Sum under some hats, for some orders, their own waveforms, or what these leave of the record."""
        grid = self.grid
        hats = np.empty((knots.size, orders.size, len(grid.x), 2))
        blocks = np.unique(np.concatenate([knots - 1, knots]).clip(0, grid.blocks - 1))
        for run in np.split(blocks, np.flatnonzero(np.diff(blocks) > 1) + 1):
            if not run.size:
                continue
            first, last = int(run[0]), int(run[-1]) + 1
            sums = np.empty((orders.size, last - first, len(grid.x), 4))
            for samples, some in grid.spans(first, last):
                values = self._waves(orders, samples)
                if of_rest:
                    np.subtract(grid.x[:, samples], values, out=values)
                grid.project(values, samples, orders, sums[:, some.start - first : some.stop - first])
            there = (knots >= first) & (knots <= last)
            hats[there] = hat_sums(sums)[knots[there] - first]
        return hats.swapaxes(0, 1)

    def _waves(self, orders: Indices, samples: slice) -> Floats:
        """(channel, sample) array, the waveforms of some orders added up."""
        model, waves = self.grid.model, np.zeros((len(self.grid.x), samples.stop - samples.start))
        shaft, phase = model.shaft[orders], model.phase(samples)
        for pieces, wave in zip(self._pieces, waves, strict=True):
            own = np.ascontiguousarray(pieces[orders])
            _block_kernels.remodulate(own, self.grid.length, phase, model.orders[orders], shaft, samples.start, wave)
        return waves

    def inside(self, knots: slice) -> tuple[NDArray[np.bool_], Indices]:
        """Return which cut hats lie in a range of knots, and where in it."""
        there = (self.knots >= knots.start) & (self.knots < knots.stop)
        return there, self.knots[there] - knots.start


def couple(
    grid: Grid, closeness: Closeness, first: int, levels: Levels, variances: Floats, log_variances: Floats
) -> float:
    """Smooth together, in place, what the estimates of `smooth_apart` show to disturb one another.

    Parameters
    ----------
    grid, first : as for `smooth_apart`.
    closeness : of its orders.
    levels, variances, log_variances : as `smooth_apart` returns them.

    Returns
    -------
    what orders that were not smoothed together still leave in one another, of the largest amplitude.
    """
    amplitude = np.sqrt(np.mean(np.abs(levels) ** 2, axis=(0, 2)))
    received = closeness.received(Bandwidth.smoother_gain, amplitude)
    groups = coupled(received, amplitude, grid.tolerance)
    everywhere = slice(0, grid.knots)
    for group in groups:
        levels[:, group], variances[group], log_variances[group] = _together(grid, group, everywhere, first)
    if groups and groups[0].size == len(amplitude):
        return 0.0
    return max(left_over(received, amplitude, groups), _couple_ends(grid, closeness, amplitude, levels, variances))


def _couple_ends(grid: Grid, closeness: Closeness, amplitude: Floats, levels: Levels, variances: Floats) -> float:
    """Smooth together, in place, what disturbs one another near ends, gaps and jumps; return what is left of it."""

    def near_ends(bandwidth: Bandwidth, distance: Floats) -> Floats:
        hat = 1.0 / np.maximum(1.0, (pi * grid.length * distance) ** 2)
        folded = np.minimum(distance, 0.5 / grid.length)
        return np.maximum(bandwidth.smoother_gain(distance), hat * np.abs(bandwidth.filter_gain(folded)))

    parts = leaks(closeness.received(near_ends, amplitude), amplitude)
    worst = float(parts[np.isfinite(parts)].max()) / grid.tolerance
    runs = _disturbed_runs(grid, memories=max(FEWEST_MEMORIES, log(max(worst, 1.0))))
    friends_of_run, left = [], [0.0]
    for knots, _ in runs:
        nearby = closeness.within(slice(knots.start * grid.length, min(knots.stop * grid.length, grid.samples)))
        received = nearby.received(near_ends, amplitude)
        friends_of_run.append(_friends(nearby, coupled(received, amplitude, grid.tolerance)))
        left.append(left_over(received, amplitude, friends_of_run[-1]))
    for number in range(MOST_ROUNDS):
        cut = _Cut(grid, levels)
        mended, change = levels.copy(), np.zeros(levels.shape[:2])
        for run, friends in zip(runs, friends_of_run, strict=True):
            for group in friends if number == 0 else []:
                _mend(cut, group, run, mended, variances)
            alone = np.setdiff1d(np.arange(len(amplitude)), np.concatenate([[], *friends]).astype(np.int64))
            for group in _alike(grid, alone):
                _mend_apart(cut, group, run, mended, variances)
            change[:, alone] = np.maximum(change[:, alone], _moved(levels, mended, cut.knots)[:, alone])
        levels[:] = mended
        if np.all(change <= MOST_MOVED * grid.tolerance * amplitude):
            break
    return max(left)


def _friends(nearby: Closeness, disturbed: list[Indices]) -> list[Indices]:
    """Return groups of orders that disturb one another, in parts by frequency where they are many."""
    groups = []
    for group in disturbed:
        by_frequency = group[np.argsort(np.abs(nearby.frequency[group]).mean(axis=1))]
        parts = range(0, group.size, MOST_AT_ENDS)
        groups += [np.sort(by_frequency[start : start + MOST_AT_ENDS]) for start in parts]
    return groups


def _moved(before: Levels, after: Levels, knots: Indices) -> Floats:
    """(channel, order) array, how far amplitudes moved at some knots, at most."""
    return np.asarray(np.abs(after[..., knots] - before[..., knots]).max(axis=2, initial=0.0))


def _disturbed_runs(grid: Grid, *, memories: float) -> list[tuple[slice, slice]]:
    """Ranges of knots where ends of the record, samples missing or jumps of a speed are felt, and wider ones.

    These reach on until the cut through the record is nearly forgotten: by a factor e in a memory.
    """
    missing = grid.length - grid.weights[0]
    missing[0] = missing[grid.samples // grid.length :] = grid.length
    missing[grid.kinked] = grid.length
    reach = grid.reach(memories)
    before = np.concatenate([[0.0], np.cumsum(missing)])
    place = np.arange(grid.knots)
    near = before[np.minimum(place + reach + 1, grid.knots)] - before[np.maximum(place - reach, 0)]
    edges = np.diff(near > grid.tolerance * reach * grid.length, prepend=False, append=False)
    runs: list[slice] = []
    for start, stop in np.flatnonzero(edges).reshape(-1, 2).tolist():
        if runs and start - runs[-1].stop <= 2 * reach:
            runs[-1] = slice(runs[-1].start, stop)
        else:
            runs.append(slice(start, stop))
    margin = grid.reach(FEWEST_MEMORIES)
    return [(run, slice(max(run.start - margin, 0), min(run.stop + margin, grid.knots))) for run in runs]


def _mend(cut: _Cut, group: Indices, run: tuple[slice, slice], levels: Levels, variances: Floats) -> None:
    """Smooth a group together, in place, over a run of knots; the cut through the record lies well outside."""
    kept, knots = run
    data = cut.grid.data[group, knots].copy()
    _, place = cut.inside(knots)
    data[:, place] = cut.without_others(group, knots)
    found, variance, _ = _together(cut.grid, group, knots, 0, data)
    inner = slice(kept.start - knots.start, kept.stop - knots.start)
    levels[:, group, kept] = found[..., inner]
    variances[group, kept] = variance[:, inner]


def _mend_apart(cut: _Cut, group: Indices, run: tuple[slice, slice], levels: Levels, variances: Floats) -> None:
    """Smooth orders of equal walks, each alone, in place, over a run of knots: with cut hats now."""
    kept, knots = run
    grid = cut.grid
    weight, _ = grid.weights
    data = grid.data[group, knots].copy()
    there, place = cut.inside(knots)
    parts = 2 if grid.model.orders[group[0]] else 1
    own = cut.levels[group][:, there] * (weight[knots][place] / parts)[:, None, None]
    data[:, place] = cut.left[group][:, there] + own
    found, variance, _ = _alone(grid, group, data, weight[knots], knots, 0)
    inner = slice(kept.start - knots.start, kept.stop - knots.start)
    levels[:, group, kept] = found[..., inner]
    variances[group, kept] = variance[inner]


def _together(
    grid: Grid, group: Indices, knots: slice, first: int, data: Floats | None = None
) -> tuple[Levels, Floats, Floats]:
    """Smooth a group of orders jointly over a range of knots: as `smooth_apart`, its log variance shared out evenly."""
    model = grid.model.subset(group)
    sums = (grid.data[group, knots] if data is None else data).transpose(1, 3, 0, 2)  # knot, part, order, channel
    columns = np.concatenate([sums[:, 0], sums[:, 1, model.turning]], axis=1)
    walk = grid.walk_variance(group)
    chain = KnotChain(
        gram=grid.gram(group, knots),
        data=columns,
        offset=grid.weights[1][knots],
        walk_variance=walk if len(walk) == 1 else walk[knots],
        prior_variance=grid.prior_variance(group, knots.start),
    )
    found, variance, log_variance = smooth_knots(chain, first=first)
    levels = np.stack([model.amplitude(found[:, :, channel]) for channel in range(columns.shape[2])])
    return levels, model.variance(variance), np.full(group.size, log_variance / group.size)
