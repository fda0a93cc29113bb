"""Coupled orders: each is smoothed alone first, then those that leak into one another jointly.

Inside a record, the leakage of other orders follows from the smoother's gain, and orders are smoothed jointly in the
parts in which they come close. Near the ends and gaps it is larger, that of the causal filter under a whole triangular
weight; an incomplete weight suppresses hardly anything. So there more orders are smoothed jointly, and the waveforms of
the others, as estimated first, are subtracted from the samples under incomplete weights.

With one pole the gain falls off so slowly that many orders leak a little into one another throughout the record. Their
waveforms are then subtracted from all samples, in rounds, as in the Jacobi iteration for the joint smoother.
"""

from dataclasses import dataclass, replace
from math import inf, pi
from typing import NamedTuple

import numpy as np

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.block_grid import Grid, pieces_between
from signals.harmonics.node_chain import Information, NodeChain, smooth_chain
from signals.harmonics.separability import Closeness, coupled, leaks, left_over
from signals.harmonics.state_space import PRIOR_STD, Complexes, Flags, Floats, Indices

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
    prior = grid.model.subset(group[:1]).prior_variance(step=grid.length)[:, :1]
    before = Information.prior(prior, lanes.shape[3])
    return NodeChain(gram=gram.__getitem__, data=lanes, process_noise=process, before=before)


class Joint(NamedTuple):
    """Orders that are smoothed jointly."""

    group: Indices
    kept: slice  # the nodes for which they are
    nodes: slice  # those whose data are used, some more on either side


def smooth_jointly(grid: Grid, joint: Joint, data: Floats, smoothed: Smoothed) -> None:
    """Smooth a group jointly, in place; `data` are those of `chain_together`."""
    group, kept, nodes = joint
    found = smooth_chain(chain_together(grid, group, nodes, data))
    inner, model = slice(kept.start - nodes.start, kept.stop - nodes.start), grid.model.subset(group)
    for channel, levels in enumerate(np.moveaxis(found.levels, 2, 0)):
        smoothed.levels[channel, group, kept] = model.amplitude(levels)[:, inner]
    smoothed.variances[group, kept] = model.variance(found.variances)[:, inner]
    smoothed.explained[group, kept] = found.explained[inner] / group.size


def chain_together(grid: Grid, group: Indices, nodes: slice, data: Floats) -> NodeChain:
    """Return the chain of a group over a range of nodes, with the products of all its columns.

    `data` is a (node, pole, order, channel, 2) array. Within the record the prior is one without effect.
    """
    model = replace(grid.model.subset(group), prior_std=PRIOR_STD if nodes.start else grid.model.prior_std)

    def products(some: slice) -> Floats:
        return grid.gram(group, slice(nodes.start + some.start, nodes.start + some.stop))

    parts, process = data.transpose(0, 1, 4, 2, 3), grid.process_noise(group)
    return NodeChain(
        gram=products,
        data=np.concatenate([parts[:, :, 0], parts[:, :, 1, model.nonzero]], axis=2),
        process_noise=process if len(process) == 1 else process[nodes],
        before=Information.prior(model.prior_variance(step=grid.length), len(grid.x)),
    )


# ---- Coupling --------------------------------------------------------------------------------------------------------

# Most time constants outside of what is smoothed jointly from which data are used, and about ends and gaps in which
# orders are smoothed jointly that leak into one another there: after so many the largest leakage has faded.
MEMORIES = 6.0
# A round leaves of what it moved the share that an incomplete weight lets through of a line a turn or more a block off.
LEFT_OF_MOVED, MOST_ROUNDS = 1 / (2 * pi), 6
# Largest number of parts of the record that are searched for orders that leak into one another.
MOST_PARTS = 32
# Orders smoothed together, at most, where nearly all disturb one another a little: near ends and gaps; and with one
# pole, if they pass less than `WEAK` of one another, throughout a record so many times as long as what is near its
# ends. Rounds are quicker for more orders, and their joint covariance would take up half of `WEAK`.
MOST_TOGETHER, WEAK, SHORTEST_WEAK = 12, 1e-2, 10


def smooth_coupled(grid: Grid) -> tuple[Smoothed, float]:
    """Smooth every order alone, and jointly those that then leak into one another.

    Returns also the largest leakage between orders that are not smoothed jointly, relative to the largest amplitude.
    """
    smoothed, counts = Smoothed.empty(grid), grid.at_nodes(grid.seen_counts)
    smooth_alone(grid, np.arange(grid.model.orders.size), grid.at_nodes(grid.moments), counts, smoothed)
    size, closeness = smoothed.size, Closeness.of(grid.model)
    joints, left, weak = _inside(grid, closeness, size)
    together = np.zeros((size.size, grid.nodes), dtype=np.bool_)  # where orders are smoothed with others
    whole = np.zeros(grid.nodes, dtype=np.bool_)  # where all are one group, and no others are left to be subtracted
    for joint in joints:
        together[joint.group, joint.kept] = True
        whole[joint.kept] |= joint.group.size == size.size
        smooth_jointly(grid, joint, grid.at_nodes(grid.moments[:, :, joint.group])[joint.nodes], smoothed)
    if whole.all():
        return smoothed, left
    near_ends, more = _near_ends(grid, closeness, size)
    near_ends = [joint for joint in near_ends if not whole[joint.kept].all()]
    for joint in near_ends:
        together[joint.group, joint.kept] = True
    lone = np.flatnonzero(~together.all(axis=1))
    for number in range(MOST_ROUNDS):
        before, others = smoothed.levels.copy(), WithoutOthers(grid, smoothed.levels, None if weak else grid.cut)
        smooth_alone(grid, lone, others.alone(lone), counts, smoothed, together=together)
        for joint in near_ends if number == 0 or (weak and more > grid.tolerance) else []:
            smooth_jointly(grid, joint, others.together(joint.group, joint.nodes), smoothed)
        moved = np.abs(smoothed.levels - before)
        moved = moved if weak else LEFT_OF_MOVED * np.where(together, 0.0, moved)[..., grid.cut]
        # The first round also subtracts what others' estimates have of an order itself, as much as they leave in it.
        if number >= weak and np.all(moved.max(axis=2, initial=0.0) <= grid.tolerance * size):
            break
    left = left if weak else max(left, more)
    if left > 0 and grid.model.poles > 1 and closeness.dwell():
        left = inf  # what others leave in the difference of such orders does not fade in a memory
    return smoothed, left


def _inside(grid: Grid, closeness: Closeness, size: Floats) -> tuple[list[Joint], float, bool]:
    """Return the orders that leak into one another inside the record, and the largest leakage between all others.

    Returned is also whether orders that leak a little are left out. `size` are their (order,) amplitudes.
    """
    gain, least = Bandwidth.smoother_gain, 1 / grid.samples
    received = closeness.received(gain, size, least=least)
    groups = coupled(received, size, grid.tolerance)
    starts = np.arange(0, grid.nodes, max(grid.reach(MEMORIES), grid.nodes // MOST_PARTS))
    stops = np.append(starts[1:], grid.nodes)
    linked = np.zeros((len(groups), starts.size), dtype=np.bool_)
    for part, nodes in enumerate(map(slice, starts.tolist(), stops.tolist()) if groups else ()):
        here = leaks(closeness.within(grid.samples_of(nodes)).received(gain, size, least=least), size)
        linked[:, part] = [np.any(here[np.ix_(group, group)] > grid.tolerance) for group in groups]
    joints, weak = list[Joint](), False
    gains = closeness.received(gain, np.ones_like(size), least=least)
    long = grid.model.bandwidth.shape[1] == 1 and grid.nodes > SHORTEST_WEAK * grid.reach(MEMORIES)
    for group, parts in zip(groups, linked, strict=True):
        weakly = grid.model.poles == 1 and group.size > MOST_TOGETHER and gains[np.ix_(group, group)].max() < WEAK
        if weakly and long and np.mean(grid.cut) < 1 / SHORTEST_WEAK:
            weak = True
            continue
        for first, last in np.flatnonzero(np.diff(parts, prepend=False, append=False)).reshape(-1, 2).tolist():
            kept = slice(int(starts[first]), int(stops[last - 1]))
            joints.append(Joint(group, kept, grid.around(kept, MEMORIES)))
    return joints, left_over(received, size, groups), weak


def _near_ends(grid: Grid, closeness: Closeness, size: Floats) -> tuple[list[Joint], float]:
    """Return the same near ends, gaps and jumps of a speed."""

    def near_ends(bandwidth: Bandwidth, distance: Floats) -> Floats:
        weight = 1.0 / np.maximum(1.0, (pi * grid.length * distance) ** 2)
        folded = np.minimum(distance, 0.5 / grid.length)
        return np.maximum(bandwidth.smoother_gain(distance), weight * np.abs(bandwidth.filter_gain(folded)))

    joints, left = list[Joint](), 0.0
    for cut in _cuts(grid):
        nearby = closeness.within(grid.samples_of(grid.around(cut, MEMORIES)))
        here = nearby.received(near_ends, size, least=1 / grid.samples)
        close, relative = _split(nearby, coupled(here, size, grid.tolerance)), leaks(here, size)
        left = max(left, left_over(here, size, close))
        for group in close:
            # Leakage fades by a factor of e in each time constant: beyond so many, a third of the tolerance is left.
            largest = relative[np.ix_(group, group)].max() / grid.tolerance
            memories = min(1.0 + np.log(max(largest, 1.0)), MEMORIES)
            kept = grid.around(cut, memories)
            joints.append(Joint(group, kept, grid.around(kept, MEMORIES)))
    return joints, left


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

    def together(self, group: Indices, nodes: slice | None = None) -> Floats:
        """(node, pole, order, channel, 2) array of the data at some nodes, of a group without all others."""
        grid = self._grid
        nodes = slice(0, grid.nodes) if nodes is None else nodes
        moments = self._moments[:, :, group]
        for samples, blocks in self._runs:
            if blocks.stop >= nodes.start and blocks.start < nodes.stop:
                moments[blocks] += grid.project(self._weighted(group, samples), blocks, group)
        return grid.at_nodes(moments)[nodes]

    def _weighted(self, orders: Indices, samples: slice) -> Floats:
        """(channel, sample) array, the waveforms of some orders added up, times the triangular weights."""
        return self._grid.waveforms(self._pieces, orders, samples) * self._grid.taper(self._nodes, samples)


def _split(nearby: Closeness, disturbed: list[Indices]) -> list[Indices]:
    """Return groups of orders that leak into one another, large ones divided by frequency."""
    groups = list[Indices]()
    for group in disturbed:
        by_frequency = group[np.argsort(np.abs(nearby.frequency[group]).mean(axis=1))]
        groups += [np.sort(part) for part in np.array_split(by_frequency, -(-group.size // MOST_TOGETHER))]
    return groups


def _cuts(grid: Grid) -> list[slice]:
    """Return ranges of nodes about ends, gaps and jumps of a speed, joined where some time constants apart."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # noqa: PLC0415 - slow to import

    window = 2 * grid.reach(MEMORIES) + 1
    joined = minimum_filter1d(maximum_filter1d(grid.cut, window), window)
    edges = np.flatnonzero(np.diff(joined, prepend=False, append=False)).reshape(-1, 2)
    return [slice(start, stop) for start, stop in edges.tolist()]
