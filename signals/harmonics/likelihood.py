"""The bandwidth under which a record is most likely: how fast each order's amplitude really wanders.

A tracker's `std` is honest when its random walk moves as the amplitudes do. Here the amplitudes walk from knot to
knot, an eighth of one over the largest bandwidth apart, and are straight in between: all that the samples of such a
block say of them is a Gram matrix and a vector of sums. The exact likelihood of that chain is the product of the
densities of a Kalman filter's innovations [1]_. Orders that come near each other share one chain; those farther
off are tracked first and subtracted.

References
----------
.. [1] F. C. Schweppe, "Evaluation of likelihood functions for Gaussian signals", IEEE Trans. Information Theory
   11, 1965.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import positive, whole
from signals._compile import compiled
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.inputs import check_orders, check_record
from signals.harmonics.model import Floats, HarmonicModel, Indices, Order
from signals.harmonics.separability import Closeness, components
from signals.harmonics.tracker import track_orders

# A block lasts this fraction of 1 / (largest bandwidth): straight lines between its knots miss a 150th of an envelope
# at the edge of that band.
BLOCK = 1 / 8
# Orders whose frequencies come within so many largest bandwidths share a chain: subtracting a tracked order takes
# the noise beside it along, and with one pole the smoother's skirts are wide.
NEAR = {1: 8.0, 2: 4.0, 3: 3.0, 4: 3.0}
# Of one over the record: over it such an amplitude is a constant (one pole) or a polynomial.
SMALLEST = 0.1
# Ratio of the bandwidths looked at first, and to what share of itself the best one is then found.
RATIO, FINE = 2.0, 0.02
# Log likelihoods that differ by less say nothing: the smaller bandwidth it is. Below some 1 / record they all do.
ALIKE = 1e-3
SWEEPS = 4
# What may be left of a subtracted order, as a part of it.
SUBTRACTED = 1e-4
# Standard deviations of a block's noise: wide enough to leave the shape of the likelihood alone, narrow enough that
# its square does not drown the rest in rounding.
PRIOR_STD = 1e3
SAMPLES_AT_ONCE = 1 << 16


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockModel:
    """Amplitudes that walk from knot to knot, straight in between, and the blocks of samples between the knots.

    Attributes
    ----------
    model : the orders, with the largest bandwidths they may have, in noise of unit variance.
    rows : (block, measurement, 2 columns) array, what multiplies the levels at the knot after the block, and their
        differences from the knot before it.
    data : (block, measurement) array; NaN where a block says nothing.
    samples : in a block.
    """

    model: HarmonicModel
    rows: Floats
    data: Floats
    samples: int

    @property
    def prior_variance(self) -> Floats:
        """(block of the state, column) array: of levels and differences, two blocks at least, at the first knot."""
        variance = self.model.prior_variance(step=self.samples)
        return np.concatenate([variance, np.zeros((max(0, 2 - len(variance)), variance.shape[1]))])

    def log_likelihood(self, bandwidth: ArrayLike) -> float:
        """Logarithm of the density of the data, with (order,) bandwidths in cycles a sample or one for all."""
        width = np.broadcast_to(np.asarray(bandwidth, dtype=np.float64), self.model.orders.shape)
        walk = replace(self.model, bandwidth=width[:, None]).process_noise(step=self.samples)[0]
        return float(_log_likelihood(self.rows, self.data, walk, self.prior_variance, self.model.poles == 1))


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
    largest_bandwidth_hz : no bandwidth above this is considered. Orders that come within four times of it (eight
        times with one pole) are weighed together, at the cost of the cube of their number.
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
    block = max(1, round(BLOCK * rate / width))
    numbers, _, shaft, phases = check_orders(orders, phase_rad, samples=record.size)
    noise = None if noise_variance is None else _noise(noise_variance, numbers.size)
    model = HarmonicModel(
        orders=numbers,
        shaft=shaft,
        phases=phases,
        bandwidth=np.full((numbers.size, 1), width / rate),
        poles=whole(poles, name="poles", least=1, most=MOST_POLES),
        prior_std=PRIOR_STD * np.sqrt(2 / block),
    )
    groups = _groups(model)
    waves = np.zeros((numbers.size, 1))
    if noise is None or len(groups) > 1:
        tracks = track_orders(
            record,
            phase_rad=phase_rad,
            orders=orders,
            poles=poles,
            output_every=max(1, block // 16),
            rtol=SUBTRACTED,
            **pair,  # type: ignore[arg-type]
        )
        noise = np.full(numbers.size, tracks.noise_variance) if noise is None else noise
        waves = _waves(model, tracks.complex_amplitude, tracks.sample_index)
    found = np.empty(numbers.size)
    for group in groups:
        rest = record - np.delete(waves, group, axis=0).sum(axis=0)
        condensed = condense(model.subset(group), rest / np.sqrt(noise[group].mean() or 1.0), block=block)
        found[group] = _most_likely(condensed)
    return found * rate


def condense(model: HarmonicModel, x: Floats, *, block: int) -> BlockModel:
    """Replace the samples of each block by measurements that say the same of amplitudes straight between knots.

    With a block's regressors A and `A^T A = V diag(s) V^T` these measure `sqrt(s) V^T state`, found to be
    `V^T A^T x / sqrt(s)` with unit noise.

    Parameters
    ----------
    model : what the record holds.
    x : (sample,) array in noise of unit variance, NaN where missing.
    block : samples in a block; the last may have fewer.
    """
    step = block * max(1, SAMPLES_AT_ONCE // block)
    parts = [_sums(model, x, slice(start, min(start + step, x.size)), block) for start in range(0, x.size, step)]
    gram, sums = (np.concatenate(part) for part in zip(*parts, strict=True))
    s, v = np.linalg.eigh(gram)
    told = s > 1e-10 * block  # where no digit of s is right, the block is silent in that direction
    root = np.sqrt(np.where(told, s, 1.0))
    return BlockModel(
        model=model,
        rows=np.ascontiguousarray((v * root[:, None, :]).transpose(0, 2, 1)),
        data=np.where(told, np.einsum("nij,ni->nj", v, sums) / root, np.nan),
        samples=block,
    )


def _sums(model: HarmonicModel, x: Floats, span: slice, block: int) -> tuple[Floats, Floats]:
    """Return `A^T A` and `A^T x` of each block, (block, 2 columns, 2 columns) and (block, 2 columns)."""
    level = model.regressors(span)
    back = (np.arange(len(level)) % block) / block - 1.0  # from the next knot
    A = np.concatenate([level, back[:, None] * level, x[span, None]], axis=1)
    A[np.isnan(x[span])] = 0.0
    A = np.concatenate([A, np.zeros((-len(A) % block, A.shape[1]))]).reshape(-1, block, A.shape[1])
    products = A.transpose(0, 2, 1) @ A
    return products[:, :-1, :-1], products[:, :-1, -1]


def _most_likely(condensed: BlockModel) -> Floats:
    """Climb the likelihood, first with one bandwidth for all orders, then with each in turn."""
    model = condensed.model
    largest = float(model.bandwidth[0, 0])
    smallest = min(SMALLEST / model.phases[0].size, largest)
    count = 2 + int(np.log(largest / smallest) / np.log(RATIO))
    grid = np.linspace(np.log(smallest), np.log(largest), count)
    found = np.full(model.orders.size, _peak(lambda b: condensed.log_likelihood(np.exp(b)), grid))
    for _ in range(SWEEPS if found.size > 1 else 0):
        before = found.copy()
        for k in range(found.size):

            def along(b: float, k: int = k) -> float:
                return condensed.log_likelihood(np.exp(np.where(np.arange(found.size) == k, b, found)))

            found[k] = _peak(along, grid)
        if np.abs(found - before).max() < 2 * FINE:
            break
    return np.asarray(np.exp(found))


def _peak(function: Callable[[float], float], grid: Floats) -> float:
    """Return where a log likelihood is largest: the best of an ascending grid, refined between its neighbours."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415  (optimizers are slow to import)

    values = np.array([function(b) for b in grid])
    best = int(np.argmax(values > values.max() - ALIKE))
    around = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    finer = minimize_scalar(lambda b: -function(b), bounds=around, method="bounded", options={"xatol": FINE})
    return float(finer.x) if -finer.fun > values[best] + ALIKE else float(grid[best])


def _groups(model: HarmonicModel) -> list[Indices]:
    """Return the orders that come near each other, directly or by way of others."""
    near = Closeness(model, model.phases[0].size).nearest < NEAR[model.poles] * model.bandwidth[0]
    return components(near | np.eye(model.orders.size, dtype=np.bool_))


def _waves(model: HarmonicModel, amplitudes: NDArray[np.complex128], index: Indices) -> Floats:
    """(order, sample) waveforms of the tracks, their amplitudes interpolated between outputs."""
    sample = np.arange(model.phases[0].size)
    waves = np.empty((len(amplitudes), sample.size))
    for wave, z, order, shaft in zip(waves, amplitudes, model.orders, model.shaft, strict=True):
        angle = order * model.phases[shaft]
        wave[:] = np.interp(sample, index, z.real) * np.cos(angle) - np.interp(sample, index, z.imag) * np.sin(angle)
    return waves


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


@compiled
def _advance(walk: Floats, mean: Floats, covariance: Floats, forget: bool) -> None:
    """Move the filter to the next knot: the highest difference walks, each adds to the one below it."""
    width, size = walk.size, mean.size
    if forget:
        mean[width:] = 0.0
        covariance[width:] = 0.0
        covariance[:, width:] = 0.0
    for a in range(width):
        covariance[size - width + a, size - width + a] += walk[a]
    for a in range(size - width - 1, -1, -1):
        mean[a] += mean[a + width]
        covariance[a] += covariance[a + width]
        covariance[:, a] += covariance[:, a + width]
    for a in range(size):  # nothing else stops an antisymmetric error from growing
        covariance[:a, a] = covariance[a, :a]


@compiled
def _update(row: Floats, datum: float, mean: Floats, covariance: Floats, gain: Floats) -> float:
    """Take one measurement in and return the log density of its innovation."""
    gain[:] = 0.0
    for a in range(row.size):
        gain += row[a] * covariance[a]
    error, variance = datum, 1.0
    for a in range(row.size):
        error -= row[a] * mean[a]
        variance += row[a] * gain[a]
    for a in range(mean.size):
        mean[a] += gain[a] * (error / variance)
        for b in range(mean.size):
            covariance[a, b] -= gain[a] * (gain[b] / variance)
    return float(-0.5 * (error**2 / variance + np.log(2 * np.pi * variance)))


@compiled
def _log_likelihood(rows: Floats, data: Floats, walk: Floats, prior: Floats, forget: bool) -> float:
    """Sum of the log densities of a covariance filter's innovations.

    Parameters
    ----------
    rows, data : as in `BlockModel`.
    walk : (column,) array, variance of the walk from knot to knot.
    prior : (block of the state, column) array, variances at the first knot.
    forget : a plain random walk keeps no difference; each step starts it from nothing.
    """
    mean, gain, covariance, total = np.zeros(prior.size), np.empty(prior.size), np.diag(prior.ravel()), 0.0
    for block in range(len(rows)):
        _advance(walk, mean, covariance, forget)
        for i in range(rows.shape[1]):
            if not np.isnan(data[block, i]):
                total += _update(rows[block, i], data[block, i], mean, covariance, gain)
    return total
