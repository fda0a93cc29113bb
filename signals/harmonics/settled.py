"""The causal filter with settled gains: exact while it starts, then little more than the cost of its phasors.

The Kalman filter's covariance forgets how it started within its memory. In the frame that turns with an order it then
stands still but for a ripple at the distances between orders, and so do its gains: those of a random walk seen in
noise of variance 2R (R for the mean), which `Bandwidth.filter_shares` tells exactly. Twice the share goes to an
order's complex amplitude, since a real sample shows half of what turns.
"""

from dataclasses import dataclass, replace
from math import ceil, log

import numpy as np

from signals.harmonics import _settled_kernels
from signals.harmonics._chain import padded
from signals.harmonics._tally import Tally
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.exact import filter_on, start
from signals.harmonics.model import Estimate, Floats, HarmonicModel
from signals.harmonics.separability import Closeness

# Part of its settled value that the variance may still be off when the gains are fixed.
UNSETTLED = 1e-3
SAMPLES_AT_ONCE = 1 << 15
# Innovations correlated, of every stretch: enough for the lags, and an eighth of the cost.
CORRELATED = 1 << 12


def ripple(model: HarmonicModel, samples: int) -> float:
    """Return how far other orders, and an order's own image, move its gain about the settled one, as a part of it.

    That is what the causal filter lets through at their distances, added up, wherever in the record they are least.
    """
    closeness = Closeness(model, samples)
    gains = [0.0]
    for k, bandwidth in enumerate(_bandwidths(model)):
        distance = closeness.nearest[k]
        there = np.isfinite(distance)
        gains.append(float(np.abs(bandwidth.filter_gain(np.minimum(distance[there], 0.5))).sum()))
    return max(gains)


def startup_samples(model: HarmonicModel) -> int:
    """Return the samples after which the variance has come within `UNSETTLED` of where it settles."""
    slowest = min(bandwidth.filter_decay for bandwidth in _bandwidths(model))
    return ceil(log(2 / UNSETTLED) / (2 * slowest))


def _bandwidths(model: HarmonicModel) -> list[Bandwidth]:
    return [Bandwidth(width=float(width), poles=model.poles) for width in model.bandwidth[:, 0]]


def settled(model: HarmonicModel, x: Floats, *, output_every: int, startup: int) -> Estimate:
    """Filter all channels of a record without gaps, with bandwidths that stay the same.

    Parameters
    ----------
    model : what is estimated.
    x : (channel, sample) array, all finite.
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    """
    channels, samples = x.shape
    begin = min(startup_samples(model), samples)
    state, tally = start(model, channels=channels), Tally.empty(channels=channels)
    head = replace(
        model,
        phases=tuple(phase[:begin] for phase in model.phases),
    )
    amplitude = np.empty((channels, model.orders.size, ceil(samples / output_every)), dtype=np.complex128)
    first = ceil(begin / output_every)
    amplitude[..., :first], variance = filter_on(
        head, x[:, :begin], state, tally, first=0, output_every=output_every, startup=startup
    )
    shares = np.stack([bandwidth.filter_shares for bandwidth in _bandwidths(model)], axis=1)
    noise = np.where(model.orders == 0, 1.0, 2.0)
    root = 1 / np.sqrt(1 + np.sum(noise * shares[0] / (1 - shares[0])))
    real, imaginary = _parts(model, state.vector.sum(axis=0))
    given = padded(shares * noise)
    for span_start in range(begin, samples, SAMPLES_AT_ONCE):
        span = slice(span_start, min(span_start + SAMPLES_AT_ONCE, samples))
        innovations = np.empty((channels, span.stop - span.start))
        outputs = slice(ceil(span.start / output_every), ceil(span.stop / output_every))
        phase, skip = model.phase(span), -span.start % output_every
        for channel in range(channels):
            _settled_kernels.filter_on(
                x[channel, span], phase, model.plan.recipe, model.plan.row, given, real[channel], imaginary[channel],
                innovations[channel], skip, output_every, outputs.start, amplitude[channel].view(np.float64),
            )  # fmt: skip
        counted = innovations[:, -CORRELATED:].T[:, None, :] * root
        tally.recent, tally.recent_seen = np.zeros_like(tally.recent), np.zeros_like(tally.recent_seen)
        tally.add(counted, np.full((len(counted), 1), root), skip=startup - span.stop + len(counted))
    return SettledEstimate(
        amplitude=amplitude,
        variance=variance,
        settled_variance=noise * shares[0],
        innovation_mean_square=tally.mean_square,
        innovation_log_variance=tally.log_variance / max(tally.count, 1),
        innovation_autocorrelation=tally.autocorrelation,
        innovation_samples=tally.count,
        error_bound=ripple(model, samples),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SettledEstimate(Estimate):
    """An estimate whose variances are known for the first outputs, (order, output), and stay the same after.

    Attributes
    ----------
    settled_variance : (order,) array.
    """

    settled_variance: Floats

    def std(self, noise: Floats) -> Floats:
        """(channel, order, output) array."""
        std = np.empty(self.amplitude.shape)
        scale = np.sqrt(noise)[:, None]
        known = self.variance.shape[1]
        std[..., :known] = np.sqrt(self.variance) * scale[..., None]
        std[..., known:] = (np.sqrt(self.settled_variance) * scale)[..., None]
        return std


def _parts(model: HarmonicModel, vector: Floats) -> tuple[Floats, Floats]:
    """(channel, pole, width) real and imaginary parts of the amplitudes and their differences, width filled up."""
    orders, turning = model.orders.size, model.turning
    states = vector.reshape(len(vector), model.poles, -1)
    real, imaginary = np.zeros((2, len(vector), model.poles, orders))
    real[:] = states[..., :orders]
    imaginary[..., turning] = states[..., orders : orders + turning.size]
    return padded(real), padded(imaginary)
