"""Complex amplitudes of shaft harmonics by Kalman filter and smoother.

`exact` takes every sample in turn. `fast` first condenses each short block of samples into one measurement a
quadrature, taking the amplitudes as constant over the block, and smooths those. Both run the same two sweeps,
a covariance filter forward and an information filter backward, which meet at the outputs. They meet stretch
by stretch, so that memory beyond the outputs grows with the square root of the record.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals.harmonics._chain import Chain, filter_chain, smooth_chain
from signals.harmonics.model import (
    MOST_POLES,
    PRIOR_STD,
    Estimate,
    Estimator,
    Floats,
    HarmonicModel,
    Method,
    Order,
    OrderTracks,
    check_bandwidth,
    check_choice,
    check_integer,
    check_orders,
    check_positive,
    check_samples,
)

# A block of the fast method lasts this fraction of 1 / bandwidth, and a record has at least so many blocks.
BLOCK = 1 / 200
FEWEST_BLOCKS = 64
# With fewer samples a block, condensing them gains nothing.
SHORTEST_BLOCK = 12
# Multiplications, about a third of a nanosecond each, that the exact method may take where "auto" chooses.
EXACT_WORK = 3e9
SAMPLES_AT_ONCE = 1 << 15


def track_orders(
    x: ArrayLike,
    *,
    phase_rad: ArrayLike | Mapping[str, ArrayLike],
    orders: Sequence[Order] | NDArray[np.float64],
    bandwidth_hz: ArrayLike | None = None,
    bandwidth_orders: ArrayLike | None = None,
    rate_hz: float | None = None,
    samples_per_rev: float | None = None,
    poles: int = 1,
    estimator: Estimator = "smoother",
    method: Method | Literal["auto"] = "auto",
    output_every: int = 1,
    noise_variance: float | None = None,
    initial_std: float | None = None,
) -> OrderTracks:
    """Estimate the complex amplitudes of all orders together, each output with its standard deviation.

    Orders are told apart by what they do to the record: close and crossing ones share out their energy, and
    `std` grows where they cannot be told apart.

    Parameters
    ----------
    x : (sample,) array, the record in any unit; NaN marks a missing sample.
    phase_rad : (sample,) array, shaft angle in rad, or a mapping from shaft name to such an array.
    orders : cycles per revolution, one number an order; with a mapping, (shaft, order) pairs. 0 is the mean.
    bandwidth_hz : full -3 dB width of the smoother in Hz, one for all orders or one each; with `rate_hz`.
    bandwidth_orders : the same in cycles per revolution; with `samples_per_rev`.
    rate_hz : samples per second.
    samples_per_rev : samples per revolution, for a record sampled in angle.
    poles : 1 to 4, how many times the amplitudes' random walk is integrated: more make a flatter passband
        with steeper sides.
    estimator : "smoother" uses all samples for each output; "filter" this one and those before it, and at the
        same `bandwidth` is wider.
    method : "exact" takes every sample in turn. "fast", smoother only, condenses blocks of a 200th of
        1 / (widest bandwidth) and interpolates linearly between their centres; in noise it differs from exact by
        about a hundredth of `std`, and for an envelope at the edge of the bandwidth by 1/400 of it at worst,
        by some 1e-4 in most records. "reference" is exact, on filterpy, hundreds of times slower. "auto" takes
        exact where that lasts about a second or blocks would be too short, else fast. The result says which.
    output_every : samples from one output to the next. An exact output costs as much as five samples.
    noise_variance : variance R of the white noise in `x`; estimated from the innovations unless given.
    initial_std : standard deviation of each part of an amplitude about zero before the first sample, in the unit
        of `x`; needs `noise_variance`. Of the i-th difference it is `initial_std (2 pi bandwidth / rate)^i`.
        Default 1000 standard deviations of the noise: it no longer matters a few samples on.

    Returns
    -------
    OrderTracks

    Raises
    ------
    ValueError
        An input makes no sense; the sentence says which and what to do.
    FloatingPointError
        The covariance lost its digits.
    """
    record = check_samples(x)
    order_numbers, shafts, phases = check_orders(orders, phase_rad, samples=record.size)
    bandwidth, rate, units = check_bandwidth(
        bandwidth_hz=bandwidth_hz,
        bandwidth_orders=bandwidth_orders,
        rate_hz=rate_hz,
        samples_per_rev=samples_per_rev,
        orders=order_numbers.size,
    )
    check_choice("estimator", estimator, ("smoother", "filter"))
    check_choice("method", method, ("auto", "exact", "fast", "reference"))
    model = HarmonicModel(
        orders=order_numbers,
        phases=phases,
        bandwidth=bandwidth / rate,
        poles=check_integer("poles", poles, least=1, most=MOST_POLES),
        prior_std=_prior_std(initial_std, noise_variance),
    )
    every = check_integer("output_every", output_every, least=1)
    startup = _startup(model, record, estimate_noise=noise_variance is None)
    chosen = _choose(method, model, record.size, estimator=estimator, output_every=every)
    estimate = _run(chosen, model, record, estimator=estimator, output_every=every, startup=startup)
    noise = estimate.innovation_mean_square if noise_variance is None else float(noise_variance)
    return OrderTracks(
        complex_amplitude=model.amplitude(estimate.levels),
        std=model.std(estimate.variances) * np.sqrt(noise),
        sample_index=np.arange(0, record.size, every),
        orders=order_numbers,
        shafts=shafts,
        bandwidth=bandwidth,
        bandwidth_units=units,
        poles=model.poles,
        estimator=estimator,
        method=chosen,
        noise_variance=noise,
        innovation_variance=noise * float(np.exp(estimate.innovation_log_variance)),
        innovation_mean_square=1.0 if noise_variance is None else estimate.innovation_mean_square / noise,
    )


def _prior_std(initial_std: float | None, noise_variance: float | None) -> float:
    """Return the prior's standard deviation in those of the noise."""
    noise = None if noise_variance is None else check_positive("noise_variance", noise_variance)
    if initial_std is None:
        return PRIOR_STD
    std = check_positive("initial_std", initial_std)
    if noise is None:
        raise ValueError(
            f"initial_std={std:g} weighs against the noise, whose variance is not given; "
            "pass noise_variance too, or neither."
        )
    return float(std / np.sqrt(noise))


def _startup(model: HarmonicModel, x: Floats, *, estimate_noise: bool) -> int:
    """First sample whose innovation counts: after the smoother's memory, or halfway in a short record."""
    observed = np.flatnonzero(~np.isnan(x))
    needed = 2 * model.state_size
    if estimate_noise and observed.size < needed:
        raise ValueError(
            f"x has {observed.size} observed samples; to estimate the noise beside {model.orders.size} orders "
            f"with poles={model.poles}, {needed} are needed: pass noise_variance, or more samples."
        )
    memory = ceil(1 / model.bandwidth.min()) + model.state_size
    return int(observed[min(memory, observed.size // 2)])


def _choose(
    method: Method | Literal["auto"],
    model: HarmonicModel,
    samples: int,
    *,
    estimator: Estimator,
    output_every: int,
) -> Method:
    if method == "fast" and estimator == "filter":
        raise ValueError(
            'method="fast" with estimator="filter": a block holds samples after the output, so its estimate '
            'is not causal; use method="exact" or estimator="smoother".'
        )
    if method != "auto":
        return method
    # Measured: an output costs what five samples do, and every sample its share of the trigonometry.
    work = (samples + 5 * samples / output_every) * (1000 + model.order_of_column.size * model.state_size**2)
    short = _block_length(model, samples) < SHORTEST_BLOCK
    return "exact" if estimator == "filter" or work <= EXACT_WORK or short else "fast"


def _run(
    method: Method, model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int
) -> Estimate:
    try:
        if method == "fast":
            estimate = fast(model, x, output_every=output_every, startup=startup)
        elif method == "exact":
            estimate = exact(model, x, estimator=estimator, output_every=output_every, startup=startup)
        else:
            from signals.harmonics import reference  # noqa: PLC0415  # filterpy is for the oracle alone

            estimate = reference.track(model, x, estimator=estimator, output_every=output_every, startup=startup)
    except np.linalg.LinAlgError as error:
        raise _lost(method, model) from error
    if not np.all(estimate.variances > 0):
        raise _lost(method, model)
    return estimate


def _lost(method: Method, model: HarmonicModel) -> FloatingPointError:
    return FloatingPointError(
        f"method={method!r}: the covariance is not positive definite in double precision, with poles={model.poles}, "
        f"a narrowest bandwidth of {model.bandwidth.min():.3g} cycles a sample and a prior of {model.prior_std:.3g} "
        "standard deviations of the noise; take fewer poles, a lower rate, a wider bandwidth or a smaller "
        "initial_std."
    )


def exact(model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int) -> Estimate:
    """Filter or smooth sample by sample.

    A sample costs (poles columns)^2 operations forward and columns times that backward.

    Parameters
    ----------
    model : what is estimated.
    x : (sample,) array, NaN where missing.
    estimator : "smoother" or "filter".
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    """
    track = smooth_chain if estimator == "smoother" else filter_chain
    wanted = np.zeros(x.size, dtype=np.bool_)
    wanted[::output_every] = True
    # The samples are copied because a kernel would be compiled anew for a read-only array.
    chain = Chain(
        measurements=lambda span: (model.regressors(span)[:, None, :], x[span, None].copy()),
        walk_variance=model.walk_variance(),
        prior_variance=model.prior_variance(),
        wanted=wanted,
    )
    levels, variances, tally = track(chain, startup)
    return Estimate(
        levels=levels,
        variances=variances,
        innovation_mean_square=tally.square / tally.count,
        innovation_log_variance=tally.log_variance / tally.count,
    )


def fast(model: HarmonicModel, x: Floats, *, output_every: int, startup: int) -> Estimate:
    """Smooth over short blocks of samples, each condensed to what it says of constant amplitudes.

    The walk takes one step a block; its variance follows from the bandwidth as for single samples, with one
    block-th of the noise. Interpolation between block centres errs by the square of (envelope frequency times
    block length). What an amplitude does within a block leaks into the orders by about that product itself,
    but with the phase of the sums and differences of two orders, which the smoother averages out unless one
    of these frequencies passes a multiple of the block rate.

    Parameters
    ----------
    model : what is estimated.
    x : (sample,) array, NaN where missing.
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    """
    blocks = ceil(x.size / _block_length(model, x.size))
    edges = np.linspace(0, x.size, blocks + 1).round().astype(np.int64)
    rows, data, residuals = _condense(model, x, edges)
    between = _Between.centres(edges, np.arange(0, x.size, output_every))
    chain = Chain(
        measurements=lambda span: (rows[span], data[span]),
        walk_variance=model.walk_variance(step=x.size / blocks),
        prior_variance=model.prior_variance(step=x.size / blocks),
        wanted=between.wanted,
    )
    first = int(np.searchsorted(edges, startup, side="right")) - 1
    levels, variances, tally = smooth_chain(chain, first)
    count = np.count_nonzero(~np.isnan(x[edges[first] :]))
    # A plain random walk stands still beyond its last datum; a slope goes on, and so does uncertainty.
    return Estimate(
        levels=between.interpolate(levels, extrapolate=model.poles > 1),
        variances=between.interpolate(variances, extrapolate=True),
        innovation_mean_square=(tally.square + float(residuals[first:].sum())) / count,
        innovation_log_variance=tally.log_variance / count,
    )


def _block_length(model: HarmonicModel, samples: int) -> int:
    return max(1, min(int(BLOCK / model.bandwidth.max()), samples // FEWEST_BLOCKS))


def _condense(model: HarmonicModel, x: Floats, edges: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """Replace each block's samples by one measurement a column that say the same of constant amplitudes.

    With the block's regressors A, `[A x]^T [A x] = L L^T`: the first columns of L are the rows, its last row
    holds the data and, at the end, the root of the sum of squares that no amplitude explains.

    Returns
    -------
    rows, data, residuals : (block, column, column), (block, column) and (block,) arrays.
    """
    columns = model.order_of_column.size
    longest = int(np.diff(edges).max())
    scale = float(np.sqrt(np.nanmean(x**2))) or 1.0
    # A whisper of "all is zero" keeps L real where a block is missing or too short to tell orders apart.
    whisper = 1e-13 * longest * np.eye(columns + 1)
    factors = np.empty((edges.size - 1, columns + 1, columns + 1))
    at_once = max(1, SAMPLES_AT_ONCE // longest)
    for start in range(0, edges.size - 1, at_once):
        stop = min(start + at_once, edges.size - 1)
        sample = edges[start:stop, None] + np.arange(longest)
        inside = sample < edges[start + 1 : stop + 1, None]
        sample = np.minimum(sample, x.size - 1)
        inside &= ~np.isnan(x[sample])
        a = np.empty((stop - start, longest, columns + 1))
        a[..., :columns] = model.regressors(sample)
        a[..., columns] = x[sample] / scale
        a[~inside] = 0.0
        factors[start:stop] = np.linalg.cholesky(a.transpose(0, 2, 1) @ a + whisper)
    rows = np.ascontiguousarray(factors[:, :columns, :columns].transpose(0, 2, 1))
    return rows, scale * factors[:, columns, :columns], (scale * factors[:, columns, columns]) ** 2


@dataclass(frozen=True, kw_only=True, eq=False)
class _Between:
    """Where outputs lie between block centres.

    Attributes
    ----------
    wanted : (block,) array, the blocks next to an output.
    left, right : (output,) arrays, which of the wanted blocks these are.
    weight : (output,) array, of the right one; outside 0 to 1 before the first centre and after the last.
    """

    wanted: NDArray[np.bool_]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    weight: Floats

    @classmethod
    def centres(cls, edges: NDArray[np.int64], at: NDArray[np.int64]) -> "_Between":
        """Place the samples `at` between the centres of the blocks with these edges."""
        centres = (edges[:-1] + edges[1:] - 1).astype(np.float64) / 2
        right = np.searchsorted(centres, at).clip(min(1, centres.size - 1), centres.size - 1)
        left = np.maximum(right - 1, 0)
        wanted = np.zeros(centres.size, dtype=np.bool_)
        wanted[left] = wanted[right] = True
        place = np.cumsum(wanted) - 1
        # Only a single block has no distance to its neighbour.
        weight = (at - centres[left]) / np.maximum(centres[right] - centres[left], 1.0)
        return cls(wanted=wanted, left=place[left], right=place[right], weight=weight)

    def interpolate(self, values: Floats, *, extrapolate: bool) -> Floats:
        """(output, column) values, linear in those of the wanted blocks; held beyond them or carried on."""
        weight = self.weight if extrapolate else self.weight.clip(0.0, 1.0)
        columns = [(1 - weight) * column[self.left] + weight * column[self.right] for column in values.T]
        return np.stack(columns, axis=1)
