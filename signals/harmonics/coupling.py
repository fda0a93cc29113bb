"""Orders smoothed at the knots of a grid: each on its own first, then together what disturbs one another.

In the midst of a record, a smoother leaves of its neighbours what its response lets through. Where the record ends
or has a gap it leaves more, as much as the causal filter would of what whole hats let through; and a hat cut short
lets through nearly anything. So there more orders are smoothed together, and what the others of the first round
explain is taken out of the samples under the hats that are cut. Where amplitudes tower above their uncertainty, it is
taken out of all samples.
"""

from collections.abc import Callable
from math import log, pi

import numpy as np

from signals.harmonics._information import KnotChain
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.grid import Grid
from signals.harmonics.mending import Mended
from signals.harmonics.model import Floats, Indices
from signals.harmonics.separability import Closeness, coupled, leaks, left_over
from signals.harmonics.smoothing import Smoothed, alike, chain_alone, everywhere, keep, smooth_group, smooth_run

Gain = Callable[[Bandwidth, Floats], Floats]
Chains = list[tuple[Indices, KnotChain]]

# Ends and gaps are felt by a hundredth of what they change in so many memories, and in as many as it takes for what
# leaks there to fall to the tolerance.
FEWEST_MEMORIES = 4.0
# So far beyond, at least, orders are taken for alone that are so in the midst. What they tell from there holds as much
# of one another as at an end, and fades as there.
MARGIN = 2.0
# A round that moves an amplitude shows how wrong what it took out under cut hats was. Others keep of that the share
# such a hat has in an estimate, times what it lets through of a line a turn or more a block off: while this is more
# than so many tolerances, another round follows.
MOST_MOVED = 3.0
CUT_LEAK = 1 / (2 * pi)
MOST_ROUNDS = 6
# Rounds in which the others are taken out of all samples: each leaves of what it mends no more than the tolerance.
FULL_ROUNDS = 2
# Orders smoothed together near ends and gaps, at most, where nearly all disturb one another a little.
MOST_AT_ENDS = 12


def couple(grid: Grid, closeness: Closeness, smoothed: Smoothed) -> "Coupling | None":
    """Smooth together, in place, what the estimates of `smooth_apart` show to disturb one another.

    Parameters
    ----------
    grid : the record.
    closeness : of its orders.
    smoothed : as `smooth_apart` returns it.

    Returns
    -------
    how orders hang together; None where all do, everywhere.
    """
    size = smoothed.size
    received = closeness.received(_at_least(grid, Bandwidth.smoother_gain), size)
    groups = coupled(received, size, grid.tolerance)
    chains = [(group, smooth_group(grid, group, grid.data(grid.moments[group]), smoothed)) for group in groups]
    if groups and groups[0].size == size.size:
        return None
    coupling = Coupling(grid, closeness, chains, received, size)
    coupling.mend_ends(smoothed)
    return coupling


class Coupling:
    """Which orders disturb one another, throughout and near ends and gaps, and how they are smoothed there.

    Attributes
    ----------
    left : what orders that are not smoothed together may still leave in one another, of the largest amplitude.
    """

    def __init__(self, grid: Grid, closeness: Closeness, chains: Chains, received: Floats, size: Floats) -> None:
        self.grid, self.chains, self.size = grid, chains, size
        groups = [group for group, _ in chains]

        def near_ends(bandwidth: Bandwidth, distance: Floats) -> Floats:
            hat = 1.0 / np.maximum(1.0, (pi * grid.length * distance) ** 2)
            folded = np.minimum(distance, 0.5 / grid.length)
            return np.maximum(bandwidth.smoother_gain(distance), hat * np.abs(bandwidth.filter_gain(folded)))

        gain = _at_least(grid, near_ends)
        parts = leaks(closeness.received(gain, size), size)
        worst = float(parts[np.isfinite(parts)].max()) / grid.tolerance
        self.cut = (grid.shares < 1 - grid.tolerance) | grid.kinked
        fading = log(max(worst, 1.0))
        memories = max(FEWEST_MEMORIES, fading)
        reach = grid.reach(max(MARGIN, fading - 1))
        self.runs = _disturbed_runs(grid, memories=memories, margin=reach)
        self.friends: list[list[Indices]] = []
        self.left = left_over(received, size, groups)
        for knots, _ in self.runs:
            nearby = closeness.within(slice(knots.start * grid.length, min(knots.stop * grid.length, grid.samples)))
            here = nearby.received(gain, size)
            self.friends.append(_friends(nearby, coupled(here, size, grid.tolerance)))
            self.left = max(self.left, left_over(here, size, self.friends[-1]))
        # Where orders are not by themselves.
        self.taken = np.zeros((size.size, grid.knots), dtype=np.bool_)
        for group in groups:
            self.taken[group] = True
        for (knots, _), friends in zip(self.runs, self.friends, strict=True):
            for group in friends:
                self.taken[group, knots] = True
        self.lone = np.setdiff1d(np.arange(size.size), np.concatenate([[], *groups]).astype(np.int64))

    def mend_ends(self, smoothed: Smoothed) -> None:
        """Take the others out under hats that are cut, and smooth again, until lone amplitudes hardly move."""
        widest = Bandwidth(width=min(float(self.grid.model.bandwidth.max()), 1.0), poles=self.grid.model.poles)
        kept = CUT_LEAK * min(1.0, widest.filter_shares[0] * self.grid.length)
        kept = max(kept, float(np.mean(~self.grid.seen)))  # of which all may be in step with a shaft
        for number in range(MOST_ROUNDS):
            before = smoothed.levels[..., self.cut]
            mended = Mended(self.grid, smoothed.levels, self.cut)
            lone = self.smooth_lone(mended, smoothed)
            if number == 0:
                self.smooth_friends(mended, lone, smoothed)
            moved = np.abs(smoothed.levels[..., self.cut] - before)
            alone = np.where(self.taken[:, self.cut], 0.0, moved).max(axis=2, initial=0.0)
            if np.all(kept * alone <= MOST_MOVED * self.grid.tolerance * self.size):
                break

    def mend_all(self, smoothed: Smoothed) -> None:
        """Take the others out of all samples, and smooth again."""
        for _ in range(FULL_ROUNDS):
            mended = Mended(self.grid, smoothed.levels, everywhere(self.grid))
            lone = self.smooth_lone(mended, smoothed)
            self.chains = [
                (group, smooth_group(self.grid, group, mended.together(group), smoothed)) for group, _ in self.chains
            ]
            self.smooth_friends(mended, lone, smoothed)

    def smooth_lone(self, mended: Mended, smoothed: Smoothed) -> Chains:
        """Smooth, in place, orders where they are by themselves; return groups of them and their chains."""
        chains: Chains = []
        if not self.lone.size:
            return chains
        gram = self.grid.at_knots(self.grid.seen_counts)
        data = mended.alone(self.lone)
        for group in alike(self.grid, self.lone):
            chain = chain_alone(self.grid, group, data[:, :, np.searchsorted(self.lone, group)], gram)
            keep(smoothed, group, chain, ~self.taken[group])
            chains.append((group, chain))
        return chains

    def smooth_friends(self, mended: Mended, lone: Chains, smoothed: Smoothed) -> None:
        """Smooth together, in place, what disturbs one another near ends, gaps and jumps of a speed."""
        for (kept, knots), friends in zip(self.runs, self.friends, strict=True):
            inner = slice(kept.start - knots.start, kept.stop - knots.start)
            beyond = [(members, chain.known_at(knots)) for members, chain in self.chains + lone] if friends else []
            for group in friends:
                data = mended.together(group, knots)
                levels, variance = smooth_run(self.grid, group, knots, data, beyond)
                smoothed.levels[:, group, kept] = levels[..., inner]
                smoothed.variances[group, kept] = variance[:, inner]


def _at_least(grid: Grid, gain: Gain) -> Gain:
    """Return a gain that knows that in a short record nothing is told apart to less than one over its length."""

    def widened(bandwidth: Bandwidth, distance: Floats) -> Floats:
        width = min(max(bandwidth.width, 1.0 / grid.samples), 1.0)
        return gain(Bandwidth(width=width, poles=bandwidth.poles), distance)

    return widened


def _friends(nearby: Closeness, disturbed: list[Indices]) -> list[Indices]:
    """Return groups of orders that disturb one another, in parts by frequency where they are many."""
    groups = []
    for group in disturbed:
        by_frequency = group[np.argsort(np.abs(nearby.frequency[group]).mean(axis=1))]
        parts = range(0, group.size, MOST_AT_ENDS)
        groups += [np.sort(by_frequency[start : start + MOST_AT_ENDS]) for start in parts]
    return groups


def _disturbed_runs(grid: Grid, *, memories: float, margin: int) -> list[tuple[slice, slice]]:
    """Ranges of knots where ends of the record, samples missing or jumps of a speed are felt, and wider ones.

    They are felt, by a factor e less a memory, for so many memories; a margin counts in knots.
    """
    missing = grid.length * (1 - grid.shares)
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
    return [(run, slice(max(run.start - margin, 0), min(run.stop + margin, grid.knots))) for run in runs]
