"""Complex amplitudes of shaft harmonics by Kalman filter and smoother, every sample in turn.

The filter goes from angles to amplitudes in one sweep. For the smoother a covariance filter goes forward, what later
data say is gathered backward, and the two meet at the outputs, stretch by stretch, so that memory beyond the outputs
grows with the square root of the record.
"""

import numpy as np

from signals._memory import LINE, room
from signals.harmonics import _sample_kernels
from signals.harmonics._chain import Chain, Flags, Floats, State, look_interval, padded, smooth_chain
from signals.harmonics._tally import Tally
from signals.harmonics.model import Complexes, Estimate, Estimator, HarmonicModel, lost

# Samples filtered at a time: what comes of them is looked at while it is in the cache.
SAMPLES_AT_ONCE = 1 << 14


def exact(
    model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int, keep: bool = False
) -> Estimate:
    """Filter or smooth sample by sample.

    A sample costs a few times (poles columns)^2 operations, an output of the smoother (poles columns)^3.

    Parameters
    ----------
    model : what is estimated.
    x : (channel, sample) array, NaN where missing: in all channels at once.
    estimator : "smoother" or "filter".
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    keep : whether the innovations of all samples are wanted.
    """
    track = _smooth if estimator == "smoother" else _filter
    return track(model, x, output_every=output_every, startup=startup, keep=keep)


def memory(model: HarmonicModel) -> float:
    """Return the samples in which the widest order is forgotten."""
    return 1 / float(model.bandwidth.max())


def _filter(model: HarmonicModel, x: Floats, *, output_every: int, startup: int, keep: bool) -> Estimate:
    state, tally = start(model, channels=len(x)), Tally.empty(channels=len(x), keep=keep)
    amplitude, variance = filter_on(model, x, state, tally, first=0, output_every=output_every, startup=startup)
    return _estimate(amplitude, variance, tally)


def start(model: HarmonicModel, *, channels: int) -> State:
    """State before the first sample."""
    return State.prior(padded(model.prior_variance()), channels=channels)


def filter_on(
    model: HarmonicModel, x: Floats, state: State, tally: Tally, *, first: int, output_every: int, startup: int,
    into: tuple[Complexes, Floats] | None = None,
) -> tuple[Complexes, Floats]:  # fmt: skip
    """Filter on from a state: carry it over these samples and count their innovations.

    Parameters
    ----------
    model : what is estimated, with the angles of these samples, maybe of later ones too.
    x : (channel, sample) array, NaN where missing: in all channels at once.
    state, tally : updated.
    first : number of the first of these samples in the whole record.
    output_every : samples between outputs, of the whole record.
    startup : number of the first sample whose innovation counts.
    into : arrays as those returned, of these outputs or more, to be filled from the first on; fresh ones unless given.

    Returns
    -------
    amplitude : (channel, order, output) array.
    variance : (order, output) array, mean over the quadratures.

    Raises
    ------
    FloatingPointError
        The covariance lost its digits.
    """
    channels, samples = x.shape
    skip = -first % output_every
    outputs = len(range(skip, samples, output_every))
    amplitude, variance = into or _lined_room(channels, model.orders.size, outputs)
    numbers = amplitude.view(np.float64)
    interval, done = look_interval(memory(model)), 0
    steady = _walk(model, slice(0, 1)) if model.bandwidth.shape[1] == 1 else None
    for begin in range(0, samples, SAMPLES_AT_ONCE):
        span = slice(begin, min(begin + SAMPLES_AT_ONCE, samples))
        size, before = span.stop - begin, done
        innovations, roots = np.empty((size, 1, channels)), np.empty((size, 1))
        done = _sample_kernels.filter_samples(
            model.plan.recipe, model.plan.places, model.phase(span), np.ascontiguousarray(x[:, span]),
            _walk(model, span) if steady is None else steady, interval, state.status, state.vector, state.matrix,
            innovations, roots, (skip - begin) % output_every, output_every, done, numbers, variance,
        )  # fmt: skip
        if not variance[:, before:done].min(initial=np.inf) > 0:
            raise lost(model, "exact")
        tally.add(innovations, roots, skip=startup - first - begin)
    return amplitude[..., :outputs], variance[:, :outputs]


def _lined_room(channels: int, orders: int, outputs: int) -> tuple[Complexes, Floats]:
    return _lined(channels, orders, 2 * outputs).view(np.complex128), _lined(orders, outputs)


def _lined(*shape: int) -> Floats:
    """Return room whose rows begin where lines of the cache do, and are a little longer than asked for.

    Rows at distances of whole pages would fight for the same lines.
    """
    lines = shape[-1] // LINE + 1
    lines += lines % LINE == 0
    return room(*shape[:-1], lines * LINE)


def chain_of(model: HarmonicModel, x: Floats, wanted: Flags) -> Chain:
    """Return the samples as a chain, with outputs where wanted."""
    recipe, places, width = model.plan.recipe, model.plan.places, padded(model.prior_variance()).shape[1]
    return Chain(
        measurements=lambda span: (
            _sample_kernels.measured(recipe, places, model.phase(span), width),
            x[:, span].T[:, None, :],
        ),
        walk_variance=model.walk_variance,
        prior_variance=model.prior_variance(),
        wanted=wanted,
        channels=len(x),
        memory=memory(model),
    )


def parts(model: HarmonicModel, levels: Floats, variances: Floats) -> tuple[Complexes, Floats]:
    """(channel, order, output) amplitudes and (order, output) variances of a chain's levels."""
    return np.stack([model.amplitude(own) for own in levels]), model.variance(variances)


def _walk(model: HarmonicModel, span: slice) -> Floats:
    return np.ascontiguousarray(padded(model.walk_variance(span)))


def _smooth(model: HarmonicModel, x: Floats, *, output_every: int, startup: int, keep: bool) -> Estimate:
    wanted = np.zeros(x.shape[1], dtype=np.bool_)
    wanted[::output_every] = True
    levels, variances, tally = smooth_chain(chain_of(model, x, wanted), startup, keep=keep)
    return _estimate(*parts(model, levels, variances), tally)


def _estimate(amplitude: Complexes, variance: Floats, tally: Tally) -> Estimate:
    return Estimate(
        amplitude=amplitude,
        variance=variance,
        innovation_mean_square=tally.mean_square,
        innovation_log_variance=tally.log_variance / max(tally.count, 1),
        innovation_autocorrelation=tally.autocorrelation,
        innovation_samples=tally.count,
        innovations=None if tally.kept is None else np.concatenate(tally.kept)[:, 0].T,
        innovation_roots=None if tally.kept_roots is None else np.concatenate(tally.kept_roots)[:, 0],
    )
