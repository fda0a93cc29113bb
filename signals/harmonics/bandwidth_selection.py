"""Maximum-likelihood bandwidth of each order: how fast its amplitude varies in a record.

The `std` of a tracker is correct if its random walk varies as fast as the amplitudes do. Here the amplitudes are random
walks over nodes spaced by 0.1 over the largest bandwidth, and polynomials in between, straight lines with one or two
poles: the moments of a block hold all information of its samples (see `node_chain`). The likelihood of the chain of
nodes is obtained by integrating out its states one after the other: it is the product of the densities of a Kalman
filter's innovations [1]_. Close orders share one chain; the others are tracked first and subtracted.

References
----------
.. [1] F. C. Schweppe, "Evaluation of likelihood functions for Gaussian signals", IEEE Trans. Information Theory
   11, 1965.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from signals._validation import checked, positive
from signals.harmonics._arguments import check_channel, check_model, per_order
from signals.harmonics.bandwidth import quadrature_noise, variance_ratio
from signals.harmonics.block_grid import Grid
from signals.harmonics.block_smoother import block_length, residuals, scattered_share
from signals.harmonics.coupling import WithoutOthers, chain_alone, chain_together, smooth_coupled
from signals.harmonics.node_chain import Information, filter_nodes, integrate_out
from signals.harmonics.noise_density import noise_density
from signals.harmonics.separability import Closeness, components
from signals.harmonics.state_space import PRIOR_STD, Flags, Floats, HarmonicModel, Indices, Order, lost

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.harmonics.node_chain import NodeChain

_LEAST_SHARE = 1e-3  # of the bandwidth that a record can show


# Orders whose frequencies come within so many largest bandwidths share a chain: subtracting a tracked order subtracts
# the noise that its smoother passes, at this distance a hundredth.
NEAR = 2.5
# An order's own image averages out of the products of its regressors where it turns twice in a block.
IMAGE = 20
# Smallest bandwidth times the record's length: with it an amplitude is a constant (one pole) or a polynomial.
SMALLEST = 0.1
# Ratio of the bandwidths tried first, and relative tolerance of the best one.
RATIO, FINE = 2.0, 0.02
# Log likelihoods that differ by less are equal, and the smallest bandwidth is taken; below some 1 / record all are.
ALIKE = 1e-3
SWEEPS = 5
# Largest leakage of an order that is not smoothed with another before it is subtracted, and what straight lines between
# nodes lose of an envelope at the edge of the largest bandwidth.
SUBTRACTED, DROOP = 3e-4, 8e-3


def chain_likelihood(model: HarmonicModel, length: int, chain: NodeChain) -> Callable[[Floats], Floats]:
    """Return the function from (order,) bandwidths in cycles per sample to (lane,) log likelihoods, less a constant.

    The chain of nodes, `length` samples apart, has two poles at least, in noise of unit variance: amplitudes of one
    pole are straight lines between nodes, too, with independent differences.
    """
    measured, noise = chain.measured(slice(0, len(chain.data))), quadrature_noise(model.orders, 1.0 / length)
    columns = len(chain.before.matrix) // max(2, model.poles)  # one where orders share it

    def log_likelihood(bandwidth: Floats) -> Floats:
        ratio = variance_ratio(np.minimum(bandwidth * length, 1.0), model.poles)
        process = (ratio * noise)[model.order_of_column[:columns]][None]
        state = Information(*(values.copy() for values in chain.before))
        (size, lanes), width = state.vector.shape, process.shape[1]
        last, squares = (np.empty((1, width, size)), np.empty((1, width)), np.empty((1, width, lanes))), np.zeros(lanes)
        log_determinant = filter_nodes(*measured, process, model.poles == 1, *state, *last, squares)
        # 2 log L = j J^-1 j + the filter's completed squares - log det J - the sum of log det(I + Q J)
        log_determinant += integrate_out(state, squares)[0]
        return np.asarray((squares - log_determinant) / 2)

    return log_likelihood


@checked
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
    """Return the maximum-likelihood bandwidth of each order, for `track_orders` with the same poles.

    Parameters
    ----------
    x : (sample,) array
        The record in any unit; NaN marks a missing sample.
    phase_rad, orders, rate_hz, samples_per_rev, poles
        As for `track_orders`.
    largest_bandwidth_hz, largest_bandwidth_orders
        Upper bound of the search in Hz, with `rate_hz`, or in cycles per revolution, with `samples_per_rev`. Orders
        closer to each other than 2.5 times this are estimated jointly, at a cost that grows with the cube of their
        number.
    noise_variance
        Variance of white noise with the density found around each order, one number or (order,) array; by default
        estimated on both sides of the order, outside the largest bandwidth.

    Returns
    -------
    (order,) array
        Bandwidths in Hz or in orders, between 0.1 over the length of the record (a constant amplitude) and the largest
        allowed (an amplitude that varies at least as fast).

    Raises
    ------
    ValueError
        An argument is out of range or contradicts another; the message names it and the remedy.
    FloatingPointError
        An information matrix is not positive definite in double precision.

    Examples
    --------
    For a constant amplitude in noise, the result is 0.1 over the length of the record, here 0.1 Hz:

    >>> import numpy as np
    >>> from signals.harmonics import likely_bandwidth
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 2 * np.cos(3 * phase_rad) + 0.1 * np.random.default_rng(1).standard_normal(5000)
    >>> print(likely_bandwidth(x, phase_rad=phase_rad, orders=[3], rate_hz=5000, largest_bandwidth_hz=20).round(3))
    [0.1]
    """
    model, record, noise, rate = _checked(
        x, phase_rad, orders, poles=poles, noise_variance=noise_variance,
        largest_bandwidth_hz=largest_bandwidth_hz, largest_bandwidth_orders=largest_bandwidth_orders,
        rate_hz=rate_hz, samples_per_rev=samples_per_rev,
    )  # fmt: skip
    try:
        return _most_likely(model, record, noise) * rate
    except np.linalg.LinAlgError as error:
        raise lost(model, "fast") from error


def _checked(
    x: ArrayLike, phase_rad: ArrayLike | Mapping[str, ArrayLike], orders: Sequence[Order] | NDArray[np.float64], *,
    poles: int, noise_variance: ArrayLike | None, **largest: float | None,
) -> tuple[HarmonicModel, Floats, Floats | None, float]:  # fmt: skip
    """Return the model at the largest bandwidth, the record, the noise of each order, and the rate."""
    record = check_channel(x)
    model, _, widths, _ = check_model(
        orders=orders, phase_rad=phase_rad, samples=record.size, noise_variance=None, initial_std=None, poles=poles,
        **largest,
    )  # fmt: skip
    if model.bandwidth.shape[1] > 1:
        raise ValueError(
            "largest_bandwidth_orders with rate_hz follows the speed, but one bandwidth is sought for a record; pass "
            "largest_bandwidth_hz, or samples_per_rev for a record sampled in angle."
        )
    width, cycles = float(widths[0]), float(model.bandwidth[0, 0])
    if cycles * record.size < _LEAST_SHARE:
        raise ValueError(
            f"the largest bandwidth, {width:g}, is far below what {record.size} samples can show, "
            f"{width / cycles / record.size:.3g}; give that or more."
        )
    if noise_variance is None:
        return model, record, None, width / cycles
    noise = per_order(noise_variance, "noise_variance", orders=model.orders.size)
    return model, record, np.array([positive(item, name="noise_variance") for item in noise.tolist()]), width / cycles


def _most_likely(model: HarmonicModel, x: Floats, noise: Floats | None) -> Floats:
    """Return the (order,) bandwidths in cycles per sample; the model has the largest one."""
    seen, width = ~np.isnan(x), float(model.bandwidth[0, 0])
    # Amplitudes of one pole are straight lines between nodes here, also those that are subtracted.
    smooth = replace(model, poles=max(2, model.poles))
    length = block_length(smooth, x.size, DROOP)
    grid = Grid(model=smooth, x=x[None], seen=seen, length=length, tolerance=SUBTRACTED)
    smoothed, _ = smooth_coupled(grid)
    if noise is None:
        white = residuals(grid, smoothed, min(smooth.startup, x.size // 2)).mean_square
        noise = noise_density(x[None], seen, model, white, curved=False)[0][0].mean(axis=-1)
    std = np.sqrt(np.where(noise > 0, noise, 1.0))
    others = WithoutOthers(grid, smoothed.levels)
    alone, near = _groups(Closeness.of(smooth), seen, length)
    nodes = replace(grid, model=replace(smooth, prior_std=PRIOR_STD * sqrt(2 / length)))
    data, counts = others.alone(alone) / std[alone, None, None], nodes.at_nodes(nodes.seen_counts)
    chains = [
        (order, chain_alone(nodes, order, data[:, :, [place]], counts))
        for place, order in enumerate(alone.reshape(-1, 1))
    ]
    for group in near:
        own = others.together(group) / std[group].mean()
        chains.append((group, chain_together(nodes, group, slice(0, nodes.nodes), own)))
    found, smallest = np.empty(model.orders.size), min(SMALLEST / x.size, width)
    tried = np.linspace(np.log(smallest), np.log(width), 2 + int(np.log(width / smallest) / np.log(RATIO)))
    for group, chain in chains:
        likelihood = chain_likelihood(model.subset(group), length, chain)
        found[group] = _maximise(likelihood, tried, orders=group.size)
    return found


def _maximise(log_likelihood: Callable[[Floats], Floats], start: Floats, *, orders: int) -> Floats:
    """Return the bandwidths of largest likelihood, from the best of equal ones whose logarithms are `start`."""
    from scipy.optimize import Bounds, minimize  # noqa: PLC0415 - slow to import

    values = np.array([log_likelihood(np.exp(b)).sum() for b in start])
    best = np.full(orders, start[np.argmax(values > values.max() - ALIKE)])

    def against(bandwidths: Floats) -> float:
        return -float(log_likelihood(np.exp(bandwidths)).sum())

    options: Any = {"xtol": FINE, "ftol": 1e-12, "maxiter": SWEEPS}  # 0 fails where a sweep moves nothing
    found = minimize(against, best, method="Powell", bounds=Bounds(start[0], start[-1]), options=options)
    return np.asarray(np.exp(found.x if -found.fun > values.max() + ALIKE else best))


def _groups(closeness: Closeness, seen: Flags, block: int) -> tuple[Indices, list[Indices]]:
    """Return the isolated orders, and groups of those that are near each other or their own image.

    No order is isolated where there are gaps within blocks, since they may be synchronous with a shaft.
    """
    model, nearest = closeness.model, closeness.nearest
    near = nearest < NEAR * model.bandwidth[0]
    near |= np.diag((np.diag(nearest) < IMAGE * model.bandwidth[0]) | (model.orders == 0))
    if scattered_share(seen, block):
        near |= np.eye(len(near), dtype=np.bool_)
    groups = components(near)
    return np.flatnonzero(~near.any(axis=1)), groups
