"""Coupled orders: each is smoothed alone first, then those that leak into one another jointly.

In the middle of a record, the leakage of other orders follows from the smoother's gain. Near the ends and gaps it is
larger, that of the causal filter under a whole triangular weight; an incomplete weight suppresses hardly anything. So
there more orders are smoothed jointly, and the waveforms of the others, as estimated first, are subtracted from the
samples under incomplete weights. Where amplitudes are far above `std`, they are subtracted from all samples.
"""

from dataclasses import dataclass
from math import log, pi
from typing import NamedTuple

import numpy as np

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.block_grid import Grid, pieces_between
from signals.harmonics.node_chain import Information, NodeChain, smooth_chain
from signals.harmonics.separability import Closeness, Gain, coupled, leaks, left_over
from signals.harmonics.state_space import Complexes, Flags, Floats, Indices

# ---- Smoothers over the nodes of a grid: of each order alone, and of coupled groups of orders ------------


@dataclass(eq=False)
class Smoothed:
    """Estimated amplitudes and variances at the nodes of a grid."""

    levels: Complexes  # (channel, order, node)
    variances: Floats  # (order, node), of a quadrature where R = 1
    explained: Floats  # (order, node), variance of the fitted waveform summed over the samples a node stands for

    @classmethod
    def empty(cls, grid: Grid) -> "Smoothed":
        """Return arrays for a grid."""
        shape = grid.model.orders.size, grid.nodes
        levels = np.zeros((len(grid.x), *shape), dtype=np.complex128)
        return cls(levels, np.empty(shape), np.zeros(shape))

    @property
    def size(self) -> Floats:
        """(order,) array, root mean square amplitudes; ones where all are zero."""
        amplitude = np.sqrt(np.mean(np.abs(self.levels) ** 2, axis=(0, 2)))
        return np.asarray(amplitude if amplitude.any() else np.ones_like(amplitude))


def smooth_apart(grid: Grid) -> Smoothed:
    """Smooth every order as if it were alone."""
    smoothed = Smoothed.empty(grid)
    data, gram = grid.at_nodes(grid.moments), grid.at_nodes(grid.seen_counts)
    smooth_alone(grid, np.arange(grid.model.orders.size), data, gram, smoothed)
    return smoothed


def smooth_alone(
    grid: Grid, orders: Indices, data: Floats, counts: Floats, smoothed: Smoothed, *, together: Flags | None = None
) -> None:
    """Smooth some orders, each alone, in place.

    `data` and `counts` are those of `chain_alone`; nodes of `together`, (order, node) of all orders, are left out.
    """
    for group in alike(grid, orders):
        chain = chain_alone(grid, group, data[:, :, np.searchsorted(orders, group)], counts)
        found, variance, explained = smooth_chain(chain)
        parts = found.shape[2] // (group.size * len(grid.x))
        found = found.reshape(len(found), group.size, len(grid.x), parts).transpose(2, 1, 0, 3)
        levels = found[..., 0].astype(np.complex128)
        if parts > 1:
            levels.imag = found[..., 1]
        where = True if together is None else ~together[group]
        smoothed.levels[:, group] = np.where(where, levels, smoothed.levels[:, group])
        smoothed.variances[group] = np.where(where, variance[:, 0], smoothed.variances[group])
        smoothed.explained[group] = np.where(where, parts * explained, smoothed.explained[group])


def alike(grid: Grid, orders: Indices) -> list[Indices]:
    """Return groups of orders with equal process noise: of one bandwidth, the mean apart."""
    model = grid.model
    groups: dict[tuple[bool, bytes], list[int]] = {}
    for k in orders.tolist():
        walk = bool(model.orders[k]), model.bandwidth[k].tobytes()
        groups.setdefault(walk, []).append(k)
    return [np.array(group) for group in groups.values()]


def chain_alone(grid: Grid, group: Indices, data: Floats, counts: Floats) -> NodeChain:
    """Return the chain of orders with equal process noise, each as if alone.

    `data` is a (node, pole, order, channel, 2) array, `counts` (node, moment) moments of the observed samples.
    """
    parts = 2 if grid.model.orders[group[0]] else 1
    lanes = np.ascontiguousarray(data[..., :parts].reshape(*data.shape[:2], 1, -1))
    gram, process = counts[:, :, None, None] / parts, grid.process_noise(group[:1])[:, :1].copy()
    before = Information.prior(grid.prior_variance(group[:1])[:, :1], lanes.shape[3])
    return NodeChain(gram=gram, data=lanes, nodes=len(lanes), process_noise=process, before=before)


def smooth_together(grid: Grid) -> Smoothed:
    """Smooth all orders jointly."""
    smoothed = Smoothed.empty(grid)
    smooth_jointly(grid, Joint.throughout(grid, np.arange(grid.model.orders.size)), None, smoothed)
    return smoothed


class Joint(NamedTuple):
    """Orders that are smoothed jointly."""

    group: Indices
    kept: slice  # the nodes for which they are
    nodes: slice  # those whose data are used, some more on either side

    @classmethod
    def throughout(cls, grid: Grid, group: Indices) -> "Joint":
        """Return those of a group smoothed jointly at all nodes."""
        return cls(group, slice(0, grid.nodes), slice(0, grid.nodes))


def smooth_jointly(grid: Grid, joint: Joint, data: Floats | None, smoothed: Smoothed) -> None:
    """Smooth a group jointly, in place; `data` are those of `chain_together`."""
    group, kept, nodes = joint
    found = smooth_chain(chain_together(grid, group, nodes, data))
    inner, model = slice(kept.start - nodes.start, kept.stop - nodes.start), grid.model.subset(group)
    for channel, levels in enumerate(np.moveaxis(found.levels, 2, 0)):
        smoothed.levels[channel, group, kept] = model.amplitude(levels)[:, inner]
    smoothed.variances[group, kept] = model.variance(found.variances)[:, inner]
    smoothed.explained[group, kept] = found.explained[inner] / group.size


def chain_together(grid: Grid, group: Indices, nodes: slice, data: Floats | None) -> NodeChain:
    """Return the chain of a group over a range of nodes, with the products of all its columns.

    `data` is a (node, pole, order, channel, 2) array; None to compute it from the samples, segment by segment.
    """
    nonzero = grid.model.subset(group).nonzero

    def products(some: slice) -> Floats:
        return grid.gram(group, slice(nodes.start + some.start, nodes.start + some.stop))

    def columns(values: Floats) -> Floats:
        parts = values.transpose(0, 1, 4, 2, 3)
        return np.concatenate([parts[:, :, 0], parts[:, :, 1, nonzero]], axis=2)

    def made(some: slice) -> Floats:
        before, last = nodes.start + some.start - 1, min(nodes.start + some.stop, grid.blocks)
        first = max(before, 0)
        moments = grid.project(grid.x[:, first * grid.length : last * grid.length], slice(first, last), group)
        return columns(grid.at_nodes(moments)[before + 1 - first : nodes.start + some.stop - first])

    process = grid.process_noise(group)
    return NodeChain(
        gram=products,
        data=made if data is None else columns(data),
        nodes=nodes.stop - nodes.start,
        process_noise=process if len(process) == 1 else process[nodes],
        before=Information.prior(grid.prior_variance(group, nodes.start), len(grid.x)),
    )


# ---- Coupling --------------------------------------------------------------------------------------------------------

# After so many time constants an end or gap has a hundredth of its effect; where more leaks, as many more as it takes
# to fall to the tolerance.
FEWEST_MEMORIES = 4.0
# So far outside, at least, orders are smoothed jointly too: what is beyond has no effect.
MARGIN = 6.0
# A round leaves of what it moved the share that an incomplete weight lets through of a line a turn or more a block off.
LEFT_OF_MOVED, MOST_ROUNDS = 1 / (2 * pi), 6
# Orders smoothed together near ends and gaps, at most, where nearly all disturb one another a little.
MOST_AT_ENDS = 12


def couple(grid: Grid, closeness: Closeness, smoothed: Smoothed) -> "Coupling | None":
    """Smooth jointly, in place, the orders that leak into one another by the estimates of `smooth_apart`.

    Returns the coupling, for further rounds near ends and gaps and of large amplitudes; None where all orders are one
    group.
    """
    size = smoothed.size
    received = closeness.received(_at_least(grid, Bandwidth.smoother_gain), size)
    groups = coupled(received, size, grid.tolerance)
    for group in groups:
        smooth_jointly(grid, Joint.throughout(grid, group), grid.at_nodes(grid.moments[:, :, group]), smoothed)
    return None if groups and groups[0].size == size.size else Coupling(grid, closeness, groups, received, size)


class Coupling:
    """Groups of orders that leak into one another, in the whole record and near its ends and gaps.

    Attributes
    ----------
    left : largest leakage between orders that are not smoothed jointly, relative to the largest amplitude.
    """

    def __init__(self, grid: Grid, closeness: Closeness, groups: list[Indices], received: Floats, size: Floats) -> None:
        self.grid, self.groups, self.size = grid, groups, size

        def near_ends(bandwidth: Bandwidth, distance: Floats) -> Floats:
            weight = 1.0 / np.maximum(1.0, (pi * grid.length * distance) ** 2)
            folded = np.minimum(distance, 0.5 / grid.length)
            return np.maximum(bandwidth.smoother_gain(distance), weight * np.abs(bandwidth.filter_gain(folded)))

        gain = _at_least(grid, near_ends)
        parts = leaks(closeness.received(gain, size), size)
        worst = float(parts[np.isfinite(parts)].max()) / grid.tolerance
        self.cut = (grid.shares < 1 - grid.tolerance) | grid.jumps
        fading = log(max(worst, 1.0))
        margin = grid.reach(max(MARGIN, fading - 1))
        grouped = np.isin(np.arange(size.size), np.concatenate([[], *groups]))
        self.lone = np.flatnonzero(~grouped)
        self.together = np.repeat(grouped[:, None], grid.nodes, axis=1)  # where orders are smoothed with others
        self.local: list[Joint] = []
        self.left = left_over(received, size, groups)
        for kept, nodes in _disturbed_runs(grid, memories=max(FEWEST_MEMORIES, fading), margin=margin):
            nearby = closeness.within(slice(kept.start * grid.length, min(kept.stop * grid.length, grid.samples)))
            here = nearby.received(gain, size)
            close = _split(nearby, coupled(here, size, grid.tolerance))
            self.left = max(self.left, left_over(here, size, close))
            for group in close:
                self.together[group, kept] = True
                self.local.append(Joint(group, kept, nodes))

    def subtract(self, smoothed: Smoothed, *, everywhere: bool = False) -> None:
        """Subtract the others under incomplete weights, or all, and smooth again, until lone orders converge."""
        grid, nodes = self.grid, np.full_like(self.cut, everywhere) | self.cut
        for number in range(MOST_ROUNDS):
            before, others = smoothed.levels[..., nodes], WithoutOthers(grid, smoothed.levels, nodes)
            if self.lone.size:
                data, gram = others.alone(self.lone), grid.at_nodes(grid.seen_counts)
                smooth_alone(grid, self.lone, data, gram, smoothed, together=self.together)
            if everywhere:
                for group in self.groups:
                    smooth_jointly(grid, Joint.throughout(grid, group), others.together(group), smoothed)
            if number <= everywhere:
                for joint in self.local:
                    smooth_jointly(grid, joint, others.together(joint.group, joint.nodes), smoothed)
            moved = np.where(self.together[:, nodes], 0.0, np.abs(smoothed.levels[..., nodes] - before))
            left = LEFT_OF_MOVED * moved.max(axis=2, initial=0.0)
            if number >= everywhere and np.all(left <= grid.tolerance * self.size):
                break


class WithoutOthers:
    """Moments of a record less the estimated waveforms of other orders, near some nodes, all by default.

    The waveforms are weighted with the sum of the triangular weights of these nodes.
    """

    def __init__(self, grid: Grid, levels: Complexes, nodes: Flags | None = None) -> None:
        nodes = np.ones(grid.nodes, dtype=np.bool_) if nodes is None else nodes
        self._grid, self._nodes = grid, nodes
        self._pieces = pieces_between(levels, cubic=grid.model.poles > 1)
        orders = np.arange(grid.model.orders.size)
        self._runs = list(grid.runs(nodes[:-1] | nodes[1:]))
        self._moments = grid.moments.copy()
        for samples, blocks in self._runs:
            rest = grid.x[:, samples] - self._weighted(orders, samples)
            self._moments[blocks] = grid.project(rest, blocks, orders)

    def alone(self, orders: Indices) -> Floats:
        """(node, pole, order, channel, 2) array of the data at nodes, of orders each without all others.

        Nor are its images left in what is added back of an order.
        """
        grid = self._grid
        moments = self._moments[:, :, orders]
        many = moments.shape[1]
        parts = np.where(grid.model.orders[orders] == 0, 1.0, 2.0)[:, None, None]
        for samples, blocks in self._runs:
            counts = grid.counts(grid.seen[samples] * grid.taper(self._nodes, samples), many + 3)
            hankel = np.stack([counts[:, m : m + 4] for m in range(many)], axis=1)  # block, moment, power
            pieces = self._pieces[:, orders, blocks].transpose(2, 4, 1, 0, 3)  # block, power, order, channel, part
            back = hankel @ pieces.reshape(*pieces.shape[:2], -1)
            moments[blocks] += back.reshape(*back.shape[:2], *pieces.shape[2:]) / parts
        return grid.at_nodes(moments)

    def together(self, group: Indices, nodes: slice = slice(None)) -> Floats:
        """(node, pole, order, channel, 2) array of the data at some nodes, of a group without all others."""
        grid = self._grid
        first, last, _ = nodes.indices(grid.nodes)
        moments = self._moments[:, :, group]
        for samples, blocks in self._runs:
            if blocks.stop >= first and blocks.start < last:
                moments[blocks] += grid.project(self._weighted(group, samples), blocks, group)
        return grid.at_nodes(moments)[nodes]

    def _weighted(self, orders: Indices, samples: slice) -> Floats:
        """(channel, sample) array, the waveforms of some orders added up, times the triangular weights."""
        waves = self._grid.waveforms(self._pieces, orders, samples)
        return waves if self._nodes.all() else waves * self._grid.taper(self._nodes, samples)


def _at_least(grid: Grid, gain: Gain) -> Gain:
    """Return a gain whose bandwidth is at least the resolution of the record, one over its length."""

    def widened(bandwidth: Bandwidth, distance: Floats) -> Floats:
        width = min(max(bandwidth.width, 1.0 / grid.samples), 1.0)
        return gain(Bandwidth(width=width, poles=bandwidth.poles), distance)

    return widened


def _split(nearby: Closeness, disturbed: list[Indices]) -> list[Indices]:
    """Return groups of orders that leak into one another, large ones divided by frequency."""
    groups = []
    for group in disturbed:
        by_frequency = group[np.argsort(np.abs(nearby.frequency[group]).mean(axis=1))]
        parts = range(0, group.size, MOST_AT_ENDS)
        groups += [np.sort(by_frequency[start : start + MOST_AT_ENDS]) for start in parts]
    return groups


def _disturbed_runs(grid: Grid, *, memories: float, margin: int) -> list[tuple[slice, slice]]:
    """Ranges of nodes where ends of the record, missing samples or jumps of a speed have an effect, and wider ones.

    Their effect falls by a factor e in a time constant; it counts for so many of them. A margin counts in nodes.
    """
    missing = grid.length * (1 - grid.shares)
    missing[0] = missing[grid.samples // grid.length :] = grid.length
    missing[grid.jumps] = grid.length
    reach = grid.reach(memories)
    before = np.concatenate([[0.0], np.cumsum(missing)])
    place = np.arange(grid.nodes)
    near = before[np.minimum(place + reach + 1, grid.nodes)] - before[np.maximum(place - reach, 0)]
    edges = np.diff(near > grid.tolerance * reach * grid.length, prepend=False, append=False)
    runs: list[slice] = []
    for start, stop in np.flatnonzero(edges).reshape(-1, 2).tolist():
        if runs and start - runs[-1].stop <= 2 * reach:
            runs[-1] = slice(runs[-1].start, stop)
        else:
            runs.append(slice(start, stop))
    return [(run, slice(max(run.start - margin, 0), min(run.stop + margin, grid.nodes))) for run in runs]
