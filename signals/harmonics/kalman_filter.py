"""The causal estimators: the covariance filter, sample by sample, and the filter with steady-state gains.

The prior variance is a million times that of the noise, and the first updates would subtract such numbers from each
other. So the diffuse part of the covariance is a factor V: the covariance is `P + V V^T`, where P, zero at first, is
that of an exactly known initial state. Once V V^T is small it is added to P. Where samples are missing for long, or a
shaft rests, P grows again: then V becomes its Cholesky factor, and P zero.

The effect of the initial covariance vanishes within some time constants. In the frame that rotates with an order the
covariance is then constant but for a ripple at the frequency distances between orders, and so are the gains: those of
a random walk in noise of variance 2R (R for the mean), which `Bandwidth.filter_shares` gives exactly. An order's
complex amplitude has twice these gains, since the real record holds half of a rotating phasor.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, log, sqrt

import numpy as np

from signals.harmonics._filter_kernels import PIECE, filter_covariance, filter_steadily
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.innovations import Innovations
from signals.harmonics.state_space import Complexes, Estimate, Floats, HarmonicModel, lost

# Samples filtered at a time.
SAMPLES_AT_ONCE = 1 << 14
# A covariance is checked before it may grow by so much without observations, as the power `2 poles` of the time in
# units of 1 / bandwidth: eight digits are left. While V is not zero, and each sample updates it too, at least so often.
LARGEST_GROWTH = 1e8
DIFFUSE_CHECK = 1 << 10
# Variances, where that of the noise is 1, below which V V^T is added to P, and above which P is factored: each sample
# adds a rounding error of 1e-16 of them.
LARGEST_ADDED, LARGEST_VARIANCE = 1e2, 1e4
# Above this prior standard deviation, in those of the noise, rounding errors of its square exceed the noise.
LARGEST_PRIOR = 1e9
# Largest relative deviation of the variance from its steady state when the gains are fixed.
STEADY_RTOL = 1e-2
STEADY_AT_ONCE = 1 << 16  # samples at a time with fixed gains


@dataclass
class FilterState:
    """State of the covariance filter before a sample."""

    # (channel, state), predicted for the next sample, real and imaginary parts of the orders in turn: the levels, then
    # their first differences, and so on.
    mean: Floats
    covariance: Floats  # (state, state), P
    factor: Floats  # (state, state), V
    diffuse: bool  # whether V is not zero
    count: int  # samples so far

    @classmethod
    def prior(cls, model: HarmonicModel, *, channels: int) -> "FilterState":
        """Return the state before the first sample, or refuse a prior too wide for double precision."""
        variance = _paired(model, model.prior_variance())
        if variance.max() > LARGEST_PRIOR**2:
            raise lost(model, "exact")
        size = variance.size
        factor = np.diag(np.sqrt(variance.ravel()))
        return cls(np.zeros((channels, size)), np.zeros((size, size)), factor, diffuse=True, count=0)

    def check(self, model: HarmonicModel) -> None:
        """Make P symmetric, and move the covariance between P and V where it is small or large, or raise where lost."""
        P, V = self.covariance, self.factor
        P += P.T
        P *= 0.5
        variance = np.diagonal(P)
        if not (np.isfinite(variance).all() and variance.min() >= 0):
            raise lost(model, "exact")
        if self.diffuse and np.einsum("ab,ab->a", V, V).max() < LARGEST_ADDED:
            P += V @ V.T
            V[:], self.diffuse = 0.0, False
        if variance.max() > LARGEST_VARIANCE:
            # V becomes the factor of the whole covariance; quadratures without variance are left out.
            scale = np.sqrt(variance + np.einsum("ab,ab->a", V, V))
            some = np.flatnonzero(scale)
            unit = scale[some, None]
            try:
                root = np.linalg.cholesky(P[np.ix_(some, some)] / unit / unit.T + 1e-15 * np.eye(some.size))
            except np.linalg.LinAlgError as error:
                raise lost(model, "exact") from error
            both = np.concatenate([root, V[some] / unit], axis=1)
            P[:], V[:] = 0.0, 0.0
            V[np.ix_(some, some)] = unit * np.asarray(np.linalg.qr(both.T, mode="r")).T
            self.diffuse = True


def _paired(model: HarmonicModel, values: Floats) -> Floats:
    """(..., 2 order) array, real and imaginary parts in turn, from (..., column) values; 0 for the mean's imaginary."""
    paired = np.zeros((*values.shape[:-1], 2 * model.orders.size))
    paired[..., ::2] = values[..., : model.orders.size]
    paired[..., 2 * model.nonzero + 1] = values[..., model.orders.size :]
    return paired


def covariance_filter(model: HarmonicModel, x: Floats, *, output_every: int, startup: int, keep: bool) -> Estimate:
    """Filter all channels of a (channel, sample) record, NaN where missing in all channels at once.

    The innovations count from sample `startup` on; those of all samples are in the estimate where `keep`.
    """
    state, innovations = FilterState.prior(model, channels=len(x)), Innovations.none(channels=len(x), keep=keep)
    return innovations.estimate(*filter_on(model, x, state, innovations, output_every=output_every, startup=startup))


def count_innovations(model: HarmonicModel, x: Floats, *, startup: int) -> Innovations:
    """Return the innovations of the covariance filter; parameters as for `covariance_filter`."""
    state, innovations = FilterState.prior(model, channels=len(x)), Innovations.none(channels=len(x))
    filter_on(model, x, state, innovations, output_every=x.shape[1], startup=startup)
    return innovations


def filter_on(
    model: HarmonicModel, x: Floats, state: FilterState, innovations: Innovations, *, output_every: int, startup: int
) -> tuple[Complexes, Floats]:
    """Continue the covariance filter over further samples, (channel, sample), NaN where missing in all channels.

    Updates the state and the sums of innovations; returns (channel, order, output) amplitudes and (order, output)
    variances, means over the quadratures. Outputs and `startup` are counted from the first sample of the record.
    Covariances are checked at sample numbers that do not depend on where a stream is cut into blocks; where one is no
    longer positive definite, FloatingPointError is raised.
    """
    channels, samples = x.shape
    outputs = len(range(-state.count % output_every, samples, output_every))
    levels, variances = np.empty((outputs, channels, 2 * model.orders.size)), np.empty((outputs, model.orders.size))
    longest = int(np.clip(LARGEST_GROWTH ** (0.5 / model.poles) / model.bandwidth.max(), 1, SAMPLES_AT_ONCE))
    orders, shaft = model.orders, model.shaft
    process = _paired(model, model.process_noise(slice(0, 1))) if model.bandwidth.shape[1] == 1 else None
    first, begin, done = state.count, 0, 0
    scratch = np.empty((5, max(PIECE, model.poles * 2 * orders.size))), np.empty((PIECE, 2 * orders.size))
    while begin < samples:
        span = slice(begin, min(begin + SAMPLES_AT_ONCE - state.count % SAMPLES_AT_ONCE, samples))
        phase, q = model.phase(span), process if process is not None else _paired(model, model.process_noise(span))
        values, normalised = np.ascontiguousarray(x[:, span].T), np.zeros((span.stop - begin, channels))
        innovation_variances = np.zeros(len(normalised))
        before = done
        while begin < span.stop:  # from one check of the covariance to the next
            interval = min(longest, DIFFUSE_CHECK) if state.diffuse else longest
            end = min(begin + interval - state.count % interval, span.stop)
            part = slice(begin - span.start, end - span.start)
            skip = -state.count % output_every
            given = values[part], np.ascontiguousarray(phase[:, part]), orders, shaft, q if len(q) == 1 else q[part]
            found = normalised[part], innovation_variances[part], levels[done:], variances[done:]
            own = state.mean, state.covariance, (skip, output_every)
            filter_covariance(*given, *own, *found, state.factor, state.diffuse, *scratch)
            done += len(range(skip, end - begin, output_every))
            state.count, begin = state.count + end - begin, end
            if state.count % interval == 0:
                state.check(model)
        variances[before:done, orders == 0] *= 2  # the mean has one quadrature
        if not variances[before:done].min(initial=np.inf) > 0:
            raise lost(model, "exact")
        innovations.add(normalised.T, innovation_variances, skip=startup - first - span.start)
    return levels.view(np.complex128).transpose(1, 2, 0), variances.T


def startup_samples(model: HarmonicModel) -> int:
    """Return the samples after which the variance is within `STEADY_RTOL` of its steady state."""
    return ceil(log(2 / STEADY_RTOL) / (2 * _band(float(model.bandwidth.min()), model.poles).filter_decay))


# The gains of a bandwidth are needed again for every record.
@lru_cache(maxsize=256)
def _band(width: float, poles: int) -> Bandwidth:
    return Bandwidth(width=width, poles=poles)


def steady_state_filter(
    model: HarmonicModel, x: Floats, *, output_every: int, startup: int, error_bound: float
) -> Estimate:
    """Filter all channels of a record without gaps, with constant bandwidths; arguments as for `covariance_filter`.

    The covariance filter runs until the variance is within `STEADY_RTOL` of its steady state; from there on the gains
    and the variance are those of the steady state, with the given `Estimate.error_bound`.
    """
    channels, samples = x.shape
    begin = min(startup_samples(model), samples)
    state, innovations = FilterState.prior(model, channels=channels), Innovations.none(channels=channels)
    head, variances = filter_on(model, x[:, :begin], state, innovations, output_every=output_every, startup=startup)
    outputs, exact = ceil(samples / output_every), variances.shape[1]
    amplitude = np.empty((outputs, channels, model.orders.size), dtype=np.complex128)
    amplitude[:exact] = head.transpose(2, 0, 1)
    levels = amplitude.view(np.float64)
    bands = [_band(width, model.poles) for width in model.bandwidth[:, 0].tolist()]
    noise = np.where(model.orders == 0, 1.0, 2.0)
    shares = noise * np.stack([band.filter_shares for band in bands], axis=1)
    variance = float(1 + np.sum(shares[0] / (1 - shares[0] / noise)))  # of the innovation, where R = 1
    gains = np.repeat(shares, 2, axis=1)  # (pole, 2 order)
    if exact < outputs:
        variances = np.column_stack([variances, shares[0]])
    predicted = state.mean.reshape(channels, model.poles, -1)
    work, rows = np.empty((3, max(PIECE, gains.shape[1]))), np.empty((PIECE, gains.shape[1]))
    for first in range(begin, samples, STEADY_AT_ONCE):
        span = slice(first, min(first + STEADY_AT_ONCE, samples))
        values, residuals = np.ascontiguousarray(x[:, span].T), np.empty((span.stop - first, channels))
        filter_steadily(
            values, model.phase(span), model.orders, model.shaft, gains, predicted, -first % output_every, output_every,
            work, rows, residuals, levels[ceil(first / output_every) :],
        )  # fmt: skip
        innovations.add(residuals.T / sqrt(variance), np.full(len(residuals), variance), skip=startup - first)
    return innovations.estimate(amplitude.transpose(1, 2, 0), variances, error_bound=error_bound)
