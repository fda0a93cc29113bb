"""The causal filter with settled gains: exact while it starts, then little more than the cost of its phasors.

The Kalman filter's covariance forgets how it started within its memory. In the frame that turns with an order it then
stands still but for a ripple at the distances between orders, and so do its gains: those of a random walk seen in
noise of variance 2R (R for the mean), which `Bandwidth.filter_shares` tells exactly. Twice the share goes to an
order's complex amplitude, since a real sample shows half of what turns.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import ceil, comb, log, sqrt
from typing import TypeVar

import numpy as np

from signals._lanes import WIDE
from signals._memory import room
from signals.harmonics import _settled_kernels
from signals.harmonics._tally import Tally
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.exact import filter_on, start
from signals.harmonics.model import Complexes, Estimate, Floats, HarmonicModel, Indices
from signals.harmonics.separability import Closeness

# Part of its settled value that the variance may still be off when the gains are fixed.
UNSETTLED = 1e-2
SAMPLES_AT_ONCE = 1 << 17
# Innovations correlated, of every stretch: enough for the lags, and little to do.
CORRELATED = 1 << 12

_Values = TypeVar("_Values", Floats, Indices)


def ripple(model: HarmonicModel, samples: int) -> float:
    """Return how far settled gains lead from the exact estimates, as a part of the error of these.

    Other orders, and an order's own image, move its gain about the settled one, each by what the causal filter lets
    through at its distance, wherever in the record that is least, and at a beat of its own: what they do adds up in
    square. With more poles a loop takes less before it is unstable. Measured with walks of 2 to 20 orders evenly
    apart, the estimates differed by 0.4 to 0.75 of this; from 1 on they may grow without bound.
    """
    nearest, widths = Closeness(model, samples).nearest, model.bandwidth[:, 0]
    largest = 0.0
    for width in np.unique(widths):
        distance = nearest[widths == width]
        gain = np.abs(_bandwidth(model, width).filter_gain(np.minimum(distance, 0.5)))
        largest = max(largest, float(np.linalg.norm(np.where(np.isfinite(distance), gain, 0.0), axis=1).max()))
    return sqrt(model.poles + 1) * largest


def startup_samples(model: HarmonicModel) -> int:
    """Return the samples, whole eights, after which the variance has come within `UNSETTLED` of where it settles."""
    slowest = _bandwidth(model, model.bandwidth[:, 0].min()).filter_decay
    return ceil(log(2 / UNSETTLED) / (2 * slowest) / WIDE) * WIDE


def _bandwidth(model: HarmonicModel, width: float) -> Bandwidth:
    return Bandwidth(width=float(width), poles=model.poles)


def settled(model: HarmonicModel, x: Floats, *, output_every: int, startup: int, error_bound: float) -> Estimate:
    """Filter all channels of a record without gaps, with bandwidths that stay the same.

    Parameters
    ----------
    model : what is estimated.
    x : (channel, sample) array, all finite.
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    error_bound : what the estimate is to say of its error.
    """
    channels, samples = x.shape
    begin = min(startup_samples(model), samples)
    state, tally = start(model, channels=channels), Tally.empty(channels=channels)
    head = replace(model, phases=tuple(phase[:begin] for phase in model.phases))
    amplitude = room(channels, model.orders.size, 2 * ceil(samples / output_every)).view(np.complex128)
    first = ceil(begin / output_every)
    variance = room(model.orders.size, min(first + 1, amplitude.shape[-1]))
    filter_on(
        head, x[:, :begin], state, tally, first=0, output_every=output_every, startup=startup, into=(amplitude, variance)
    )
    gains, root = _gains(model)
    variance[:, first:] = gains[0][:, None]
    square, count, log_variance = tally.square.copy(), tally.count, tally.log_variance
    for span, innovations in _filter_on(model, x, state.vector.sum(axis=0), gains, begin, output_every, amplitude):
        counted = innovations[:, max(startup - span.start, 0) :]
        square += root**2 * np.einsum("cn,cn->c", counted, counted)
        count, log_variance = count + counted.shape[1], log_variance - 2 * counted.shape[1] * log(root)
        some = np.ascontiguousarray(counted[:, -CORRELATED:].T * root)[:, None, :]
        tally.recent, tally.recent_seen = np.zeros_like(tally.recent), np.zeros_like(tally.recent_seen)
        tally.add(some, np.full((len(some), 1), root), skip=0)
    return Estimate(
        amplitude=amplitude,
        variance=variance,
        innovation_mean_square=square / max(count, 1),
        innovation_log_variance=log_variance / max(count, 1),
        innovation_autocorrelation=tally.autocorrelation,
        innovation_samples=tally.count,
        error_bound=error_bound,
    )


def _filter_on(
    model: HarmonicModel, x: Floats, vector: Floats, gains: Floats, begin: int, every: int, amplitude: Complexes
) -> Iterator[tuple[slice, Floats]]:
    """Fill the amplitudes from a sample on, given the state predicted for it; yield (channel, sample) innovations."""
    channels, samples = x.shape
    real, imaginary = _parts(model, vector)
    shares, rises = _paired(gains), _rises(model.poles)
    response = np.concatenate([np.zeros((shares.shape[1], WIDE + 1)), shares.T @ rises[:, 1:]], axis=1)
    orders, shaft = _paired(model.orders), _paired(model.shaft)
    for first in range(begin, samples, SAMPLES_AT_ONCE):
        span = slice(first, min(first + SAMPLES_AT_ONCE, samples))
        innovations = np.empty((channels, span.stop - first))
        _settled_kernels.filter_on(
            np.ascontiguousarray(x[:, span]), model.phase(span), orders, shaft, model.plan.recipe, model.plan.row,
            shares, response, rises, real, imaginary, innovations, -first % every, every, ceil(first / every),
            amplitude.view(np.float64),
        )  # fmt: skip
        yield span, innovations


def _gains(model: HarmonicModel) -> tuple[Floats, float]:
    """(pole, order) array of what innovations add; one over the standard deviation of an innovation where R = 1."""
    widths, which = np.unique(model.bandwidth[:, 0], return_inverse=True)
    shares = np.stack([_bandwidth(model, width).filter_shares for width in widths], axis=1)[:, which]
    noise = np.where(model.orders == 0, 1.0, 2.0)
    return np.ascontiguousarray(noise * shares), float(1 / np.sqrt(1 + np.sum(noise * shares[0] / (1 - shares[0]))))


def _rises(poles: int) -> Floats:
    """(pole, WIDE) array: what a level and its differences add to the levels 0, 1, ... samples on."""
    ahead = range(WIDE)
    return np.array([[float(comb(n + pole - 1, pole)) if pole else 1.0 for n in ahead] for pole in range(poles)])


def _paired(values: _Values) -> _Values:
    """Return the array with its last dimension filled up with zeros to an even number."""
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, values.shape[-1] % 2)])


def _parts(model: HarmonicModel, vector: Floats) -> tuple[Floats, Floats]:
    """(channel, pole, order, WIDE) real and imaginary parts of the amplitudes and their differences, in last places."""
    orders, turning = model.orders.size, model.turning
    states = vector.reshape(len(vector), model.poles, -1)
    real, imaginary = np.zeros((2, len(vector), model.poles, orders + orders % 2, WIDE))
    real[..., :orders, -1] = states[..., :orders]
    imaginary[..., turning, -1] = states[..., orders : orders + turning.size]
    return real, imaginary
