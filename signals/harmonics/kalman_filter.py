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
from math import ceil, log, sqrt

import numpy as np

from signals.harmonics._filter_kernels import PIECE, filter_covariance, filter_steadily
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.state_space import Estimate, Floats, HarmonicModel, Innovations, lost

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


@dataclass
class FilterState:
    """State of the covariance filter before a sample."""

    # (channel, state), predicted for the next sample, real and imaginary parts of the orders in turn: the levels, then
    # their first differences, and so on.
    mean: Floats
    covariance: Floats  # (state, state), P
    factor: Floats  # (state, state), V
    innovations: Innovations  # after start-up
    diffuse: bool  # whether V is not zero
    count: int = 0  # samples so far
    observed: int = 0  # of them, those after the last missing one

    @classmethod
    def prior(cls, model: HarmonicModel, *, channels: int) -> "FilterState":
        """Return the state before the first sample, or refuse a prior too wide for double precision."""
        variance = _paired(model, model.prior_variance())
        if variance.max() > LARGEST_PRIOR**2:
            raise lost(model, "exact")
        size = variance.size
        factor = np.diag(np.sqrt(variance.ravel()))
        innovations = Innovations(np.zeros(channels))
        return cls(np.zeros((channels, size)), np.zeros((size, size)), factor, innovations, diffuse=True)

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


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyGains:
    """The steady state of the filter of constant bandwidths."""

    gains: Floats  # (pole, 2 order), times h the Kalman gains
    variances: Floats  # (order,), of an amplitude's quadratures
    innovation_variance: float
    settling: int  # samples without a missing one after which the variance is within `STEADY_RTOL` of these

    @classmethod
    def of(cls, model: HarmonicModel) -> "SteadyGains":
        """Return the gains of a model, each order as if alone."""
        bands = [Bandwidth(width=width, poles=model.poles) for width in model.bandwidth[:, 0].tolist()]
        noise = np.where(model.orders == 0, 1.0, 2.0)
        shares = noise * np.stack([band.filter_shares for band in bands], axis=1)
        return cls(
            gains=np.repeat(shares, 2, axis=1), variances=shares[0],
            innovation_variance=float(1 + np.sum(shares[0] / (1 - shares[0] / noise))),
            settling=ceil(log(2 / STEADY_RTOL) / (2 * min(band.filter_decay for band in bands))),
        )  # fmt: skip


def filter_on(
    model: HarmonicModel, x: Floats, state: FilterState, *, orders: int, output_every: int, startup: int,
    steady: SteadyGains | None = None,
) -> Estimate:  # fmt: skip
    """Continue the filter over further samples, (channel, sample), NaN where missing in all channels.

    Updates the state and returns estimates of the first `orders`; of their variances in the steady state at the end
    only the first. Outputs and `startup` are counted from the first sample of the record.
    Given steady-state gains, they take over from the covariance filter once it has settled, until a sample is missing.
    Covariances are checked at sample numbers that do not depend on where a stream is cut into blocks; where one is no
    longer positive definite, FloatingPointError is raised.
    """
    (channels, samples), width = x.shape, 2 * model.orders.size
    places = np.arange(-state.count % output_every, samples, output_every)
    levels, variances = np.empty((places.size, channels, 2 * orders)), np.empty((places.size, orders))
    longest = int(np.clip(LARGEST_GROWTH ** (0.5 / model.poles) / model.bandwidth.max(), 1, SAMPLES_AT_ONCE))
    process = _paired(model, model.process_noise(slice(0, 1)))
    missing = np.append(np.flatnonzero(np.isnan(x[0])), samples)
    work, rows = np.empty((5, max(PIECE, model.poles * width))), np.empty((PIECE, width))
    begin, known = 0, 0
    while begin < samples:
        gap = int(missing[np.searchsorted(missing, begin)])
        settled = steady is not None and state.observed >= steady.settling and gap > begin
        interval = min(longest, DIFFUSE_CHECK) if state.diffuse else longest
        end = min(begin + SAMPLES_AT_ONCE, gap) if settled else min(begin + interval - state.count % interval, samples)
        if steady is not None and not settled:
            end = min(end, begin + max(steady.settling - state.observed, 1))
        span, done = slice(begin, end), int(np.searchsorted(places, begin))
        due = slice(done, int(np.searchsorted(places, end)))
        outputs = -state.count % output_every, output_every
        values, normalised = np.ascontiguousarray(x[:, span].T), np.zeros((end - begin, channels))
        given = values, np.ascontiguousarray(model.phase(span)), model.orders, model.shaft
        if steady is not None and settled:
            mean = state.mean.reshape(channels, model.poles, width)
            filter_steadily(*given, steady.gains, mean, *outputs, work, rows, normalised, levels[done:])
            normalised /= sqrt(steady.innovation_variance)
        else:
            q = process if model.bandwidth.shape[1] == 1 else _paired(model, model.process_noise(span))
            own, found = (state.mean, state.covariance), (normalised, levels[done:])
            filter_covariance(
                *given, q, *own, outputs, *found, variances[done:], state.factor, state.diffuse, work, rows
            )
            variances[due, model.orders[:orders] == 0] *= 2  # the mean has one quadrature
            if steady is not None:
                variances[known : due.start] = steady.variances[:orders]
            known = due.stop
            if not variances[due].min(initial=np.inf) > 0:
                raise lost(model, "exact")
        state.innovations.add(normalised.T, ~np.isnan(x[0, span]), skip=startup - state.count)
        last = int(missing[np.searchsorted(missing, end) - 1]) if gap < end else begin - 1 - state.observed
        state.count, state.observed, begin = state.count + end - begin, end - 1 - last, end
        if not settled and state.count % interval == 0:
            state.check(model)
    if steady is not None and known < places.size:
        variances = variances[: known + 1]
        variances[known] = steady.variances[:orders]
    amplitude = levels.view(np.complex128).transpose(1, 2, 0)
    return Estimate(amplitude=amplitude, variance=variances.T, innovations=state.innovations, std_spacing=output_every)
