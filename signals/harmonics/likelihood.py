"""The bandwidth under which a record is most likely: how fast each order's amplitude really varies.

A tracker's `std` is honest when its random walk moves as the amplitudes do. Here the amplitudes walk from node to
node, an eighth of one over the largest bandwidth apart, and are polynomials in between, straight lines with one or two
poles: all information of the samples of a block is in its moments (see `_information_smoother`). The exact likelihood
of that chain is what is left when its states are integrated out one after the other, the product of the densities of a
Kalman filter's innovations [1]_. Orders that come near each other share one chain; the others are tracked first and
subtracted, and those that come near none share the covariance of one, with the data of each beside it.

References
----------
.. [1] F. C. Schweppe, "Evaluation of likelihood functions for Gaussian signals", IEEE Trans. Information Theory
   11, 1965.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, comb, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import positive, whole
from signals.harmonics._information_kernels import FORWARD, filter_information
from signals.harmonics._information_smoother import Information, Measured, NodeChain
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.blocks import BlockFit, block_length, one_of_each, scattered_share
from signals.harmonics.coupling import WithoutOthers
from signals.harmonics.grid import Grid
from signals.harmonics.inputs import check_orders, check_record
from signals.harmonics.model import Floats, HarmonicModel, Indices, Order, lost
from signals.harmonics.separability import Closeness, components
from signals.harmonics.smoothing import chain_alone, chain_together, everywhere, no_neighbours

# A block lasts this fraction of 1 / (largest bandwidth): straight lines between its nodes miss a 150th of an envelope
# at the edge of that band.
BLOCK = 1 / 8
# Orders whose frequencies come within so many largest bandwidths share a chain: subtracting a tracked order takes
# along what its smoother passes of the noise beside it, here a hundredth.
NEAR = 2.5
# An order's own image averages out of the products of its columns where it turns twice in a block.
IMAGE = 2 / BLOCK
# Of one over the record: over it such an amplitude is a constant (one pole) or a polynomial.
SMALLEST = 0.1
# Ratio of the bandwidths tried first, and to what share of itself the best one is then found.
RATIO, FINE = 2.0, 0.02
# Log likelihoods that differ by less are alike: the smaller bandwidth it is. Below some 1 / record they all are.
ALIKE = 1e-3
SWEEPS = 5
# With so many poles amplitudes are so free at the ends of a record that orders must be smoothed together there before
# any is subtracted.
MANY_POLES = 3
# What may be left of a subtracted order, as a part of it.
SUBTRACTED = 3e-4
# Standard deviations of a block's noise: wide enough to leave the shape of the likelihood alone, narrow enough that
# its square does not drown the rest in rounding.
PRIOR_STD = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainLikelihood:
    """The likelihood of data at nodes, as a function of the bandwidths of the walks.

    Attributes
    ----------
    model : the orders, with the poles of their walks.
    length : samples between nodes.
    measured : information in the data, in noise of unit variance.
    before : information on the state at the first node: of two poles at least, since amplitudes of one pole, too, are
        straight lines between nodes; their differences are renewed from node to node.
    """

    model: HarmonicModel
    length: int
    measured: Measured
    before: Information

    @classmethod
    def of(cls, model: HarmonicModel, chain: NodeChain, length: int) -> "ChainLikelihood":
        """Take the data and the prior of a chain."""
        return cls(model=model, length=length, measured=chain.measured(slice(0, chain.nodes)), before=chain.before)

    def lanes(self, some: slice) -> "ChainLikelihood":
        """Return that of some of the lanes alone."""
        vectors = self.measured.vectors.reshape(-1, *self.before.vector.shape)[:, :, some]
        measured = Measured(self.measured.matrices, vectors.reshape(len(vectors), -1).copy())
        return replace(self, measured=measured, before=self.before._replace(vector=self.before.vector[:, some].copy()))

    def log_likelihood(self, bandwidth: ArrayLike) -> Floats:
        """(lane,) logarithms of the density of the data but for a constant; (order,) bandwidths in cycles a sample."""
        width = np.broadcast_to(np.asarray(bandwidth, dtype=np.float64), self.model.orders.shape)
        process = replace(self.model, bandwidth=width[:, None]).process_noise(step=self.length)
        matrix, vector = self.before.copy()
        squares, unkept = np.zeros(vector.shape[1]), (np.empty((0, matrix.size)), np.empty((0, vector.size)))
        columns = len(matrix) // max(2, self.model.poles)  # one where orders share it
        log_determinant = filter_information(
            *self.measured,
            process[:, :columns].copy(),
            self.model.poles == 1,
            FORWARD,
            matrix,
            vector,
            *unkept,
            squares,
        )
        log_determinant += float(np.linalg.slogdet(matrix)[1])
        squares += np.sum(vector * np.linalg.solve(matrix, vector), axis=0)
        return np.asarray((squares - log_determinant) / 2)


def likely_bandwidth(
    x: ArrayLike,
    *,
    phase_rad: ArrayLike | Mapping[str, ArrayLike],
    orders: Sequence[Order] | NDArray[np.float64],
    rate_hz: float | None = None,
    samples_per_rev: float | None = None,
    largest_bandwidth_hz: float | None = None,
    largest_bandwidth_orders: float | None = None,
    poles: int = 1,
    noise_variance: ArrayLike | None = None,
) -> Floats:
    """Return the most likely bandwidth of each order, for `track_orders` with the same poles.

    Parameters
    ----------
    x : (sample,) array, the record in any unit; NaN marks a missing sample.
    phase_rad : (sample,) array, shaft angle in rad, or a mapping from shaft name to such an array.
    orders : cycles per revolution, one number an order; with a mapping, (shaft, order) pairs. 0 is the mean.
    rate_hz : samples per second; with `largest_bandwidth_hz`.
    samples_per_rev : samples per revolution, for a record sampled in angle; with `largest_bandwidth_orders`.
    largest_bandwidth_hz : no bandwidth above this is considered. Orders that come within two and a half times of it
        are weighed together, at the cost of the cube of their number.
    largest_bandwidth_orders : the same in cycles per revolution.
    poles : 1 to 4, how many times the amplitudes' random walk is integrated.
    noise_variance : variance of white noise as dense as the noise beside each order, one number or (order,).
        Unless given, what a tracker with the largest bandwidth estimates.

    Returns
    -------
    (order,) array
        In Hz or in orders, between a tenth of one over the record, where an amplitude is found steady, and the
        largest allowed, where it is found to be faster still.

    Raises
    ------
    ValueError
        An input makes no sense; the sentence says which and what to do.
    """
    record = _one_channel(x)
    pair = _largest(
        hz=(largest_bandwidth_hz, rate_hz),
        orders=(largest_bandwidth_orders, samples_per_rev),
    )
    width, rate = pair.values()
    numbers, _, shaft, phases = check_orders(orders, phase_rad, samples=record.size)
    noise = None if noise_variance is None else _noise(noise_variance, numbers.size)
    model = HarmonicModel(
        orders=numbers,
        shaft=shaft,
        phases=phases,
        bandwidth=np.full((numbers.size, 1), width / rate),
        poles=whole(poles, name="poles", least=1, most=MOST_POLES),
        prior_std=PRIOR_STD,
    )
    kept, member = one_of_each(model)
    try:
        found = _most_likely(model.subset(kept), record, None if noise is None else noise[kept])
    except np.linalg.LinAlgError as error:
        raise lost(model, "fast") from error
    return found[member] * rate


def _most_likely(model: HarmonicModel, x: Floats, noise: Floats | None) -> Floats:
    """(order,) most likely bandwidths in cycles a sample, of orders of which no two are the same."""
    seen, width = ~np.isnan(x), float(model.bandwidth[0, 0])
    # Amplitudes of one pole go straight from node to node here, too, and so are those of others while subtracted.
    smooth = replace(model, poles=max(2, model.poles))
    grid = Grid(
        model=smooth,
        x=x[None],
        seen=seen,
        length=block_length(smooth, x.size, SUBTRACTED),
        tolerance=SUBTRACTED,
        shared=np.ones(model.orders.size, dtype=np.int64),
    )
    startup = min(ceil(1 / width) + smooth.state_size, x.size // 2)
    fit = BlockFit.of(grid, startup=startup, coupled=True)
    if fit.coupling and model.poles >= MANY_POLES:
        fit.coupling.smooth_ends(fit.smoothed)
    elif fit.coupling:
        fit.coupling.smooth_all(fit.smoothed, ends=False)
    if noise is None:
        noise = np.full(model.orders.size, fit.residuals(startup).mean_square[0])
    std = np.sqrt(np.where(noise > 0, noise, 1.0))
    blocks = max(1, int(BLOCK / (width * grid.length)))
    length = blocks * grid.length
    nodes = replace(grid, length=length, model=replace(smooth, prior_std=PRIOR_STD * sqrt(2 / length)))
    others = WithoutOthers(grid, fit.smoothed.levels, everywhere(grid))
    alone, groups = _groups(model, seen, nodes.length)
    found = np.empty(model.orders.size)
    if alone.size:
        data = joined(others.alone(alone), blocks) / std[alone, None, None]
        chain = chain_alone(nodes, alone, data, nodes.at_nodes(nodes.seen_counts))
        found[alone] = _each_alone(ChainLikelihood.of(model.subset(alone[:1]), chain, nodes.length))
    for group in groups:
        data = joined(others.together(group), blocks) / std[group].mean()
        chain = chain_together(nodes, group, slice(0, nodes.nodes), data, no_neighbours(nodes, group))
        found[group] = _together(ChainLikelihood.of(model.subset(group), chain, nodes.length))
    return found


def joined(data: Floats, blocks: int) -> Floats:
    """Return data at every so many nodes, (node, moment, ...), from those at all, both as `Grid.data` has them.

    At the place (h + v) / blocks of the longer block lies v of the short one h.
    """
    moments, filled = data.shape[1], -(-(len(data) - 1) // blocks)
    short = np.zeros((filled * blocks, *data.shape[1:]))
    short[: len(data) - 1] = data[1:]
    shift = np.zeros((blocks, moments, moments))
    for m in range(moments):
        for i in range(m + 1):
            shift[:, m, i] = comb(m, i) * np.arange(blocks, dtype=np.float64) ** (m - i) / float(blocks) ** m
    long = np.einsum("hmi,bhi...->bm...", shift, short.reshape(filled, blocks, *data.shape[1:]))
    return np.concatenate([np.zeros_like(long[:1]), long])


def _grid_of_bandwidths(chain: ChainLikelihood) -> Floats:
    """Return the logarithms of the bandwidths tried first."""
    largest = float(chain.model.bandwidth[0, 0])
    smallest = min(SMALLEST / chain.model.phases[0].size, largest)
    return np.linspace(np.log(smallest), np.log(largest), 2 + int(np.log(largest / smallest) / np.log(RATIO)))


def _each_alone(chain: ChainLikelihood) -> Floats:
    """Return the most likely bandwidth of each order: all by one pass at first, then each from its best."""
    places = _grid_of_bandwidths(chain)
    values = np.array([chain.log_likelihood(np.exp(b)).reshape(-1, 2).sum(axis=1) for b in places])
    found = np.empty(values.shape[1])
    for k in range(found.size):
        own = chain.lanes(slice(2 * k, 2 * k + 2))

        def value(b: Floats, own: ChainLikelihood = own) -> float:
            return float(own.log_likelihood(np.exp(b)).sum())

        found[k : k + 1] = _climb(value, places, values[:, k], orders=1)
    return found


def _together(chain: ChainLikelihood) -> Floats:
    """Return the most likely bandwidths of orders: one for all at first, then each in turn."""
    places = _grid_of_bandwidths(chain)

    def value(b: Floats) -> float:
        return float(chain.log_likelihood(np.exp(b))[0])

    return _climb(value, places, np.array([value(b) for b in places]), orders=chain.model.orders.size)


def _climb(value: Callable[[Floats], float], places: Floats, values: Floats, *, orders: int) -> Floats:
    """Return where a log likelihood is largest, from the best of some places on, one order after the other.

    Every sweep steps half as far: up the slope as long as it rises, then to the vertex of the parabola there.
    """
    best = int(np.argmax(values > values.max() - ALIKE))
    found, here, step = np.full(orders, places[best]), float(values[best]), (places[-1] - places[0]) / places.size / 2
    for _ in range(SWEEPS):
        step, before = step / 2, found.copy()
        for k in range(orders):

            def at(b: float, k: int = k) -> tuple[float, float]:
                tried = found.copy()
                tried[k] = np.clip(b, places[0], places[-1])
                return float(tried[k]), value(tried)

            below, above = at(found[k] - step), at(found[k] + step)
            while below[1] > here - ALIKE and below[0] < found[k]:
                above, (found[k], here) = (found[k], here), below
                below = at(found[k] - step)
            while above[1] > here + ALIKE and above[0] > found[k]:
                below, (found[k], here) = (found[k], here), above
                above = at(found[k] + step)
            curvature = 2 * here - below[1] - above[1]
            if curvature > 0:
                vertex = at(found[k] + step * (above[1] - below[1]) / (2 * curvature))
                found[k], here = vertex if vertex[1] > here + ALIKE else (found[k], here)
        if step < 8 * FINE and np.abs(found - before).max() < 2 * FINE:
            break
    return np.asarray(np.exp(found))


def _groups(model: HarmonicModel, seen: NDArray[np.bool_], block: int) -> tuple[Indices, list[Indices]]:
    """Return the orders that come near none, and groups of those that come near each other or their own image.

    Gaps within blocks may keep in step with a shaft: then no order is alone.
    """
    nearest = Closeness(model, seen.size).nearest
    near = nearest < NEAR * model.bandwidth[0]
    near |= np.diag((np.diag(nearest) < IMAGE * model.bandwidth[0]) | (model.orders == 0))
    if scattered_share(seen, block):
        near |= np.eye(len(near), dtype=np.bool_)
    groups = components(near)
    return np.flatnonzero(~near.any(axis=1)), groups


def _one_channel(x: ArrayLike) -> Floats:
    channels = check_record(x)
    if len(channels) > 1:
        raise ValueError(f"x has {len(channels)} channels; each has bandwidths of its own: pass one channel at a time.")
    if np.isnan(channels).all():
        raise ValueError(f"x has {channels.size} samples, all of them missing (NaN); at least one is needed.")
    return np.asarray(channels[0])


def _largest(*, hz: tuple[float | None, float | None], orders: tuple[float | None, float | None]) -> dict[str, float]:
    """Return the pair that is given, under the names `track_orders` has for it."""
    given = {
        "largest_bandwidth_hz": hz[0],
        "rate_hz": hz[1],
        "largest_bandwidth_orders": orders[0],
        "samples_per_rev": orders[1],
    }
    names = [name for name, value in given.items() if value is not None]
    if names not in (["largest_bandwidth_hz", "rate_hz"], ["largest_bandwidth_orders", "samples_per_rev"]):
        raise ValueError(
            f"largest bandwidth and rate: {', '.join(names) or 'none'} given; needed either largest_bandwidth_hz with "
            "rate_hz or largest_bandwidth_orders with samples_per_rev: pass one whole pair and leave the other out."
        )
    width, rate = (positive(given[name], name=name) for name in names)
    if width >= rate / 2:
        raise ValueError(
            f"{names[0]}={width:g} must be below {rate / 2:g}, half of {names[1]}={rate:g}; choose a smaller one."
        )
    return {names[0].removeprefix("largest_"): width, names[1]: rate}


def _noise(value: ArrayLike, orders: int) -> Floats:
    noise = np.asarray(value, dtype=np.float64)
    if noise.shape not in ((), (orders,)):
        raise ValueError(
            f"noise_variance has shape {noise.shape} for {orders} orders; pass one number for all, or one each."
        )
    return np.array([positive(item, name="noise_variance") for item in np.broadcast_to(noise, orders).tolist()])
