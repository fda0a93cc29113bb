"""The causal filter with settled gains: exact while it starts, then little more than the cost of its phasors.

The Kalman filter's covariance forgets how it started within its memory. In the frame that turns with an order it then
stands still but for a ripple at the distances between orders, and so do its gains: those of a random walk seen in
noise of variance 2R (R for the mean), which `Bandwidth.filter_shares` tells exactly. Twice the share goes to an
order's complex amplitude, since a real sample shows half of what turns.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
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


def ripple(closeness: Closeness) -> float:
    """Return how far settled gains lead from the exact estimates, as a part of the error of these.

    Other orders, and an order's own image, move its gain about the settled one, each by what the causal filter lets
    through at its distance, wherever in the record that is least, and at a beat of its own: what they do adds up in
    square. With more poles a loop takes less before it is unstable. Measured with walks of 2 to 20 orders evenly
    apart, the estimates differed by 0.4 to 0.75 of this; from 1 on they may grow without bound.
    """
    model, nearest = closeness.model, closeness.nearest
    largest = 0.0
    for band, own in _bands(model).items():
        distance = nearest[own]
        gain = np.abs(band.filter_gain(np.minimum(distance, 0.5)))
        gain[np.isinf(distance)] = 0.0
        largest = max(largest, float(np.linalg.norm(gain, axis=1).max()))
    return sqrt(model.poles + 1) * largest


def startup_samples(model: HarmonicModel) -> int:
    """Return the samples, whole eights, after which the variance has come within `UNSETTLED` of where it settles."""
    slowest = min(band.filter_decay for band in _bands(model))
    return ceil(log(2 / UNSETTLED) / (2 * slowest) / WIDE) * WIDE


def _bands(model: HarmonicModel) -> dict[Bandwidth, list[int]]:
    """Return the bandwidths there are and the places of the orders that have them."""
    found: dict[Bandwidth, list[int]] = {}
    for place, width in enumerate(model.bandwidth[:, 0].tolist()):
        found.setdefault(_band(width, model.poles), []).append(place)
    return found


# What follows from a bandwidth is asked for again with every record.
@lru_cache(maxsize=256)
def _band(width: float, poles: int) -> Bandwidth:
    return Bandwidth(width=width, poles=poles)


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
    amplitude = room(channels, model.orders.size, 2 * ceil(samples / output_every)).view(np.complex128)
    first = ceil(begin / output_every)
    variance = room(model.orders.size, min(first + 1, amplitude.shape[-1]))
    into = amplitude, variance
    filter_on(model, x[:, :begin], state, tally, first=0, output_every=output_every, startup=startup, into=into)
    plan = Plan.of(model)
    root = plan.root
    variance[:, first:] = plan.gains[0, : model.orders.size, None]
    square, count, log_variance = tally.square.copy(), tally.count, tally.log_variance
    for span, innovations in _filter_on(model, plan, x, state.vector.sum(axis=0), begin, output_every, amplitude):
        counted = innovations[:, max(startup - span.start, 0) :]
        square += root**2 * np.einsum("cn,cn->c", counted, counted)
        count, log_variance = count + counted.shape[1], log_variance - 2 * counted.shape[1] * log(root)
        some = np.ascontiguousarray(counted[:, -CORRELATED:].T * root)[:, None, :]
        tally.forget()
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
    model: HarmonicModel, plan: "Plan", x: Floats, vector: Floats, begin: int, every: int, amplitude: Complexes
) -> Iterator[tuple[slice, Floats]]:
    """Fill the amplitudes from a sample on, given the state predicted for it; yield (channel, sample) innovations."""
    channels, samples = x.shape
    real, imaginary = _parts(model, vector)
    for first in range(begin, samples, SAMPLES_AT_ONCE):
        span = slice(first, min(first + SAMPLES_AT_ONCE, samples))
        innovations = np.empty((channels, span.stop - first))
        _settled_kernels.filter_on(
            np.ascontiguousarray(x[:, span]), model.phase(span), plan.orders, plan.shaft, model.plan.recipe,
            model.plan.row, plan.gains, plan.response, plan.rises, real, imaginary, innovations, -first % every, every,
            ceil(first / every), amplitude.view(np.float64),
        )  # fmt: skip
        yield span, innovations


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What a filter with settled gains does with an innovation.

    Attributes
    ----------
    orders, shaft : (order,) arrays, those of the model, their number filled up to an even one.
    gains : (pole, order) array, what innovations add to levels and differences.
    root : one over the standard deviation of an innovation where R = 1.
    response, rises : as `_settled_kernels.filter_on` wants them.
    """

    orders: Floats
    shaft: Indices
    gains: Floats
    root: float
    response: Floats
    rises: Floats

    @classmethod
    def of(cls, model: HarmonicModel) -> "Plan":
        """Plan for a model."""
        # Fleets ask again for every record.
        orders, shaft, widths = (values.tolist() for values in (model.orders, model.shaft, model.bandwidth[:, 0]))
        return cls._of(tuple(orders), tuple(shaft), tuple(widths), model.poles)

    @classmethod
    @lru_cache(maxsize=64)
    def _of(cls, orders: tuple[float, ...], shaft: tuple[int, ...], widths: tuple[float, ...], poles: int) -> "Plan":
        shares = np.stack([_band(width, poles).filter_shares for width in widths], axis=1)
        noise = np.where(np.array(orders) == 0, 1.0, 2.0)
        gains, rises = _paired(noise * shares), _rises(poles)
        return cls(
            orders=_paired(np.array(orders)),
            shaft=_paired(np.array(shaft)),
            gains=gains,
            root=float(1 / np.sqrt(1 + np.sum(noise * shares[0] / (1 - shares[0])))),
            response=np.concatenate([np.zeros((gains.shape[1], WIDE + 1)), gains.T @ rises[:, 1:]], axis=1),
            rises=rises,
        )


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
