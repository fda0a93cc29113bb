"""Information smoothers over the nodes of a grid: of each order alone, and of coupled groups of orders."""

from dataclasses import dataclass

import numpy as np

from signals.harmonics._information_smoother import Gram, Information, NodeChain, Outside, smooth_chain
from signals.harmonics.grid import Flags, Grid
from signals.harmonics.model import Complexes, Floats, Indices

# The first round leaves out a triangular weight of which less than this share is seen, of the share of the fuller of
# its neighbours.
SMALLEST_SHARE = 0.6
# Numbers in the products of columns of all nodes that are kept; more are made again, stretch by stretch.
MOST_KEPT = 1 << 21


@dataclass(kw_only=True, eq=False)
class Smoothed:
    """Estimated amplitudes and variances at the nodes of a grid.

    Attributes
    ----------
    levels : (channel, order, node) array.
    variances : (order, node) array, of a quadrature where R = 1.
    explained : (order, node) array, variance of the fitted waveform summed over the samples a node stands for.
    log_variances : (order,) array, sums of the log variances of the innovations from node `first` on.
    first : first node whose innovations count.
    """

    levels: Complexes
    variances: Floats
    explained: Floats
    log_variances: Floats
    first: int

    @classmethod
    def empty(cls, grid: Grid, first: int) -> "Smoothed":
        """Return arrays for a grid."""
        orders = grid.model.orders.size
        return cls(
            levels=np.zeros((len(grid.x), orders, grid.nodes), dtype=np.complex128),
            variances=np.empty((orders, grid.nodes)),
            explained=np.zeros((orders, grid.nodes)),
            log_variances=np.empty(orders),
            first=first,
        )

    @property
    def size(self) -> Floats:
        """(order,) array, root mean square amplitudes; ones where all are zero."""
        amplitude = np.sqrt(np.mean(np.abs(self.levels) ** 2, axis=(0, 2)))
        return np.asarray(amplitude if amplitude.any() else np.ones_like(amplitude))


def smooth_apart(grid: Grid, first: int) -> Smoothed:
    """Smooth every order as if it were alone, without incomplete triangular weights; innovations count from `first`."""
    orders = grid.model.orders.size
    smoothed = Smoothed.empty(grid, first)
    share = np.pad(grid.shares, 1)
    hidden = grid.shares < SMALLEST_SHARE * np.maximum(np.maximum(share[:-2], share[2:]), grid.shares)
    hidden[0] = hidden[grid.samples // grid.length :] = True
    moments, counts = grid.moments.copy(), grid.seen_counts.copy()
    for samples, blocks in grid.runs(hidden[:-1] | hidden[1:]):
        weight = 1 - grid.taper(hidden, samples)
        moments[blocks] = grid.project(weight * grid.x[:, samples], blocks, np.arange(orders))
        counts[blocks] = grid.counts(weight * grid.seen[samples], grid.squares)
    data, gram = grid.data(moments), grid.at_nodes(counts)
    for group in alike(grid, np.arange(orders)):
        keep(smoothed, group, chain_alone(grid, group, data[:, :, group], gram), everywhere(grid))
    return smoothed


def everywhere(grid: Grid) -> Flags:
    """(node,) array, true throughout."""
    return np.ones(grid.nodes, dtype=np.bool_)


def keep(smoothed: Smoothed, group: Indices, chain: NodeChain, where: Flags) -> None:
    """Smooth orders with equal process noise, each alone, and store their amplitudes at the nodes of `where`."""
    found, variance, explained, log_variance = smooth_chain(chain, first=smoothed.first)
    channels = len(smoothed.levels)
    parts = found.shape[2] // (group.size * channels)
    found = found.reshape(len(found), group.size, channels, parts).transpose(2, 1, 0, 3)
    levels = found[..., 0].astype(np.complex128)
    if parts > 1:
        levels.imag = found[..., 1]
    smoothed.levels[:, group] = np.where(where, levels, smoothed.levels[:, group])
    smoothed.variances[group] = np.where(where, variance[:, 0], smoothed.variances[group])
    smoothed.explained[group] = np.where(where, parts * explained, smoothed.explained[group])
    smoothed.log_variances[group] = parts * log_variance


def alike(grid: Grid, orders: Indices) -> list[Indices]:
    """Return groups of orders with equal process noise: of one bandwidth and multiplicity, the mean apart."""
    model = grid.model
    groups: dict[tuple[bool, int, bytes], list[int]] = {}
    for k in orders.tolist():
        walk = bool(model.orders[k]), int(grid.shared[k]), model.bandwidth[k].tobytes()
        groups.setdefault(walk, []).append(k)
    return [np.array(group) for group in groups.values()]


def chain_alone(grid: Grid, group: Indices, data: Floats, counts: Floats) -> NodeChain:
    """Return the chain of orders with equal process noise, each as if alone.

    `data` is a (node, pole, order, channel, 2) array, `counts` (node, moment) moments of the observed samples.
    """
    parts = 2 if grid.model.orders[group[0]] else 1
    lanes = np.ascontiguousarray(data[..., :parts].reshape(*data.shape[:2], 1, -1))
    before = Information.prior(grid.prior_variance(group[:1])[:, :1], lanes.shape[3])
    return NodeChain(
        gram=np.ascontiguousarray(counts[:, :, None, None] / parts),
        data=lanes,
        nodes=len(lanes),
        process_noise=grid.process_noise(group[:1])[:, :1].copy(),
        before=before,
        after=before.none(),
    )


def smooth_group(grid: Grid, group: Indices, data: Floats, smoothed: Smoothed, gram: Gram | None = None) -> NodeChain:
    """Smooth a group together, in place, over the whole record; return its chain. `gram` is that of an earlier one."""
    chain = chain_together(grid, group, slice(0, grid.nodes), data, no_neighbours(grid, group), gram)
    levels, variance, explained, log_variance = _solved(grid, group, chain, smoothed.first)
    smoothed.levels[:, group], smoothed.variances[group] = levels, variance
    smoothed.explained[group], smoothed.log_variances[group] = explained / group.size, log_variance / group.size
    return chain


def no_neighbours(grid: Grid, group: Indices) -> Outside:
    """Return the information on a group from outside a whole record: the prior, and none."""
    before = _prior(grid, group, 0)
    return before, before.none()


def smooth_run(
    grid: Grid, group: Indices, nodes: slice, data: Floats, outside: list[tuple[Indices, Outside]]
) -> tuple[Complexes, Floats, Floats]:
    """Smooth a group together over a range of nodes.

    Parameters
    ----------
    data : (node, pole, order, channel, 2) array, of these nodes.
    outside : of orders that share a chain, alike or together, the information of all other nodes: `NodeChain.outside`.

    Returns
    -------
    levels, variances, explained : as `Smoothed` has them, of these orders and nodes.
    """
    before = _prior(grid, group, nodes.start)
    after = before.none()
    for members, (early, late) in outside:
        _insert(grid, group, members, early, before)
        _insert(grid, group, members, late, after)
    chain = chain_together(grid, group, nodes, data, (before, after))
    levels, variances, explained, _ = _solved(grid, group, chain, 0)
    return levels, variances, np.broadcast_to(explained / group.size, variances.shape)


def _prior(grid: Grid, group: Indices, node: int) -> Information:
    return Information.prior(grid.prior_variance(group, node), len(grid.x))


def _insert(grid: Grid, group: Indices, members: Indices, known: Information, of_group: Information) -> None:
    """Insert the information on orders that share a chain into that on a group."""
    poles = grid.model.poles
    columns = _columns(grid, group)
    if len(known.matrix) > poles:
        # Together; on some of them by themselves there is none.
        if np.isin(members, group).all():
            place = np.array([columns.index(column) for column in _columns(grid, members)])
            state = (place + len(columns) * np.arange(poles)[:, None]).ravel()
            of_group.matrix[np.ix_(state, state)] = known.matrix
            of_group.vector[state] = known.vector
        return
    vectors = known.vector.reshape(poles, members.size, len(grid.x), -1)
    places = {order: place for place, order in enumerate(members.tolist())}
    for column, (order, part) in enumerate(columns):
        if order in places:
            rows = slice(column, None, len(columns))
            of_group.matrix[rows, rows] = known.matrix
            of_group.vector[rows] = vectors[:, places[order], :, part]


def _columns(grid: Grid, orders: Indices) -> list[tuple[int, int]]:
    """Return the order and the part, 0 real and 1 imaginary, of each column of a model of some orders."""
    owner = grid.model.subset(orders).order_of_column
    return [(int(orders[k]), int(column >= orders.size)) for column, k in enumerate(owner.tolist())]


def chain_together(
    grid: Grid, group: Indices, nodes: slice, data: Floats | None, known: Outside, gram: Gram | None = None
) -> NodeChain:
    """Return the chain of a group over a range of nodes, with the products of all its columns, `gram` if known.

    Parameters
    ----------
    data : (node, pole, order, channel, 2) array; None to compute it from the samples, stretch by stretch.
    known : information on the first node before its data, and on the last one after it.
    """
    nonzero = grid.model.subset(group).nonzero

    def within(some: slice) -> slice:
        return slice(nodes.start + some.start, nodes.start + some.stop)

    def products(some: slice) -> Floats:
        return grid.gram(group, within(some))

    def columns(values: Floats) -> Floats:
        parts = values.transpose(0, 1, 4, 2, 3)
        return np.concatenate([parts[:, :, 0], parts[:, :, 1, nonzero]], axis=2)

    process, count = grid.process_noise(group), nodes.stop - nodes.start
    few = data is not None and count * grid.squares * (group.size + nonzero.size) ** 2 <= MOST_KEPT
    return NodeChain(
        gram=gram if gram is not None else products(slice(0, count)) if few else products,
        data=(lambda some: columns(grid.data_at(group, within(some)))) if data is None else columns(data),
        nodes=count,
        process_noise=process if len(process) == 1 else process[nodes],
        before=known[0],
        after=known[1],
    )


def _solved(grid: Grid, group: Indices, chain: NodeChain, first: int) -> tuple[Complexes, Floats, Floats, float]:
    """Return (channel, order, node) levels of a group, (order, node) variances, and of all what they explain."""
    model = grid.model.subset(group)
    found, variance, explained, log_variance = smooth_chain(chain, first=first)
    levels = np.stack([model.amplitude(found[:, :, channel]) for channel in range(found.shape[2])])
    return levels, model.variance(variance), explained, log_variance
