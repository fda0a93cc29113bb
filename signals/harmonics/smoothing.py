"""Chains over the knots of a grid: of orders each by itself, and of orders that have to do with one another."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._information import KnotChain, Knowledge, smooth_knots
from signals.harmonics._ranked import FEWEST_COLUMNS, smooth_ranked
from signals.harmonics.grid import Grid
from signals.harmonics.model import Floats, Indices

Levels = NDArray[np.complex128]

# The first round leaves out a hat of which less than this is there, of what is there of the fuller of its neighbours.
SMALLEST_SHARE = 0.6


@dataclass(kw_only=True, eq=False)
class Smoothed:
    """Amplitudes at the knots as far as they are known.

    Attributes
    ----------
    levels : (channel, order, knot) array.
    variances : (order, knot) array.
    log_variances : (order,) array, sums of the log variances of the innovations from knot `first` on.
    first : the knot whose innovations count first.
    """

    levels: Levels
    variances: Floats
    log_variances: Floats
    first: int

    @property
    def size(self) -> Floats:
        """(order,) array, root mean square amplitudes; all alike where nothing is known of any."""
        amplitude = np.sqrt(np.mean(np.abs(self.levels) ** 2, axis=(0, 2)))
        return np.asarray(amplitude if amplitude.any() else np.ones_like(amplitude))


def smooth_apart(grid: Grid, first: int) -> Smoothed:
    """Smooth every order of a record as if it were alone, by the whole hats.

    Parameters
    ----------
    grid : the record.
    first : the knot whose innovations count first.
    """
    orders = grid.model.orders.size
    smoothed = Smoothed(
        levels=np.zeros((len(grid.x), orders, grid.knots), dtype=np.complex128),
        variances=np.empty((orders, grid.knots)),
        log_variances=np.empty(orders),
        first=first,
    )
    share = np.pad(grid.shares, 1)
    hidden = grid.shares < SMALLEST_SHARE * np.maximum(np.maximum(share[:-2], share[2:]), grid.shares)
    hidden[0] = hidden[grid.samples // grid.length :] = True
    moments, counts = grid.moments.copy(), grid.seen_counts.copy()
    for samples, blocks in grid.runs(hidden[:-1] | hidden[1:]):
        weight = 1 - grid.taper(hidden, samples)
        moments[:, blocks] = grid.project(weight * grid.x[:, samples], blocks, np.arange(orders))
        counts[blocks] = grid.counts(weight * grid.seen[samples], grid.squares)
    data, gram = grid.data(moments), grid.at_knots(counts)
    for group in alike(grid, np.arange(orders)):
        keep(smoothed, group, chain_alone(grid, group, data[:, :, group], gram), everywhere(grid))
    return smoothed


def everywhere(grid: Grid) -> NDArray[np.bool_]:
    """(knot,) array, true throughout."""
    return np.ones(grid.knots, dtype=np.bool_)


def keep(smoothed: Smoothed, group: Indices, chain: KnotChain, where: NDArray[np.bool_]) -> None:
    """Smooth alike orders, each alone, and keep their amplitudes at some knots, (knot,) or (order of group, knot)."""
    found, variance, log_variance = smooth_knots(chain, first=smoothed.first)
    channels = len(smoothed.levels)
    parts = found.shape[2] // (group.size * channels)
    found = found.reshape(len(found), group.size, channels, parts).transpose(2, 1, 0, 3)
    levels = found[..., 0].astype(np.complex128)
    if parts > 1:
        levels.imag = found[..., 1]
    smoothed.levels[:, group] = np.where(where, levels, smoothed.levels[:, group])
    smoothed.variances[group] = np.where(where, variance[:, 0], smoothed.variances[group])
    smoothed.log_variances[group] = parts * log_variance


def alike(grid: Grid, orders: Indices) -> list[Indices]:
    """Return groups of some orders of equal walks: one bandwidth, sums of as many, and all or none of them the mean."""
    model = grid.model
    groups: dict[tuple[bool, int, bytes], list[int]] = {}
    for k in orders.tolist():
        walk = bool(model.orders[k]), int(grid.shared[k]), model.bandwidth[k].tobytes()
        groups.setdefault(walk, []).append(k)
    return [np.array(group) for group in groups.values()]


def chain_alone(grid: Grid, group: Indices, data: Floats, counts: Floats) -> KnotChain:
    """Return the chain of orders that share a walk, each as if alone.

    Parameters
    ----------
    data : (knot, pole, order, channel, 2) array.
    counts : (knot, moment) array, of the samples these tell of.
    """
    parts = 2 if grid.model.orders[group[0]] else 1
    lanes = np.ascontiguousarray(data[..., :parts].reshape(*data.shape[:2], 1, -1))
    before = Knowledge.prior(grid.prior_variance(group[:1])[:, :1], lanes.shape[3])
    return KnotChain(
        gram=np.ascontiguousarray(counts[:, :, None, None] / parts),
        data=lanes,
        walk_variance=grid.walk_variance(group[:1])[:, :1].copy(),
        before=before,
        after=before.nothing(),
    )


def smooth_group(grid: Grid, group: Indices, data: Floats, smoothed: Smoothed) -> KnotChain:
    """Smooth a group together, in place, over the whole record; return its chain."""
    before = _prior(grid, group, 0)
    chain = _together(grid, group, slice(0, grid.knots), data, (before, before.nothing()))
    levels, variance, log_variance = _solved(grid, group, chain, smoothed.first)
    smoothed.levels[:, group], smoothed.variances[group] = levels, variance
    smoothed.log_variances[group] = log_variance / group.size
    return chain


def smooth_run(
    grid: Grid,
    group: Indices,
    knots: slice,
    data: Floats,
    beyond: list[tuple[Indices, tuple[Knowledge, Knowledge]]],
) -> tuple[Levels, Floats]:
    """Smooth a group together over a range of knots.

    Parameters
    ----------
    data : (knot, pole, order, channel, 2) array, of these knots.
    beyond : of orders that share a chain, alike or together, what all other knots tell: see `KnotChain.known_at`.

    Returns
    -------
    levels : (channel, order, knot) array.
    variances : (order, knot) array.
    """
    before = _prior(grid, group, knots.start)
    after = before.nothing()
    for members, (early, late) in beyond:
        _know(grid, group, members, early, before)
        _know(grid, group, members, late, after)
    levels, variance, _ = _solved(grid, group, _together(grid, group, knots, data, (before, after)), 0)
    return levels, variance


def _prior(grid: Grid, group: Indices, knot: int) -> Knowledge:
    return Knowledge.prior(grid.prior_variance(group, knot), len(grid.x))


def _know(grid: Grid, group: Indices, members: Indices, known: Knowledge, of_group: Knowledge) -> None:
    """Put what is known of orders that share a chain in its place of what is known of a group."""
    poles = grid.model.poles
    columns = _columns(grid, group)
    if len(known.matrix) > poles:
        # Together; of some of them by themselves nothing is said.
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


def _together(grid: Grid, group: Indices, knots: slice, data: Floats, known: tuple[Knowledge, Knowledge]) -> KnotChain:
    """Return the chain of a group over a range of knots, with all that its orders have to do with one another.

    Parameters
    ----------
    data : (knot, pole, order, channel, 2) array.
    known : of the first knot before its data, and of the last one after it.
    """
    turning = grid.model.subset(group).turning
    few = len(_columns(grid, group)) < FEWEST_COLUMNS

    def gram(some: slice) -> Floats:
        return grid.gram(group, slice(knots.start + some.start, knots.start + some.stop))

    sums = data.transpose(0, 1, 4, 2, 3)
    walk = grid.walk_variance(group)
    return KnotChain(
        gram=gram(slice(0, knots.stop - knots.start)) if few else gram,
        data=np.concatenate([sums[:, :, 0], sums[:, :, 1, turning]], axis=2),
        walk_variance=walk if len(walk) == 1 else walk[knots],
        before=known[0],
        after=known[1],
    )


def _solved(grid: Grid, group: Indices, chain: KnotChain, first: int) -> tuple[Levels, Floats, float]:
    """Return (channel, order, knot) levels of a group, (order, knot) variances, and the log variance of all."""
    model = grid.model.subset(group)
    found, variance, log_variance = smooth_ranked(chain, first=first) or smooth_knots(chain, first=first)
    levels = np.stack([model.amplitude(found[:, :, channel]) for channel in range(found.shape[2])])
    return levels, model.variance(variance), log_variance
