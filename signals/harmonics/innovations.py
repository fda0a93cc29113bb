"""Statistics of innovations and residuals: mean square, variance and autocorrelation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._arguments import SMALLEST
from signals.harmonics.state_space import LAGS, Complexes, Estimate, Floats


@dataclass
class Innovations:
    """Sums over normalised innovations, those over their standard deviations."""

    square: Floats  # (channel,), of their squares
    # (channel, LAGS) sums of the products of two that lie 1, 2, ... samples apart, and (LAGS,) numbers of these
    products: Floats
    pairs: Floats
    recent: Floats  # (channel, LAGS), the last ones, 0 where missing
    recent_seen: Floats  # (LAGS,), 1.0 where not missing
    log_variance: float = 0.0  # sum of the logarithms of their variances
    count: int = 0

    @classmethod
    def none(cls, *, channels: int) -> "Innovations":
        """Return empty sums."""
        zeros = np.zeros((channels, LAGS))
        return cls(np.zeros(channels), zeros, np.zeros(LAGS), zeros.copy(), np.zeros(LAGS))

    @property
    def mean_square(self) -> Floats:
        """(channel,) array, mean square of the normalised innovations."""
        return self.square / max(self.count, 1)

    @property
    def autocorrelation(self) -> Floats:
        """(channel, LAGS) array; 0 where there is none."""
        mean = self.mean_square[:, None]
        scale = np.maximum(self.pairs, 1.0) * np.where(mean > 0.0, mean, 1.0)
        return np.asarray(self.products / scale)

    def estimate(self, amplitude: Complexes, variance: Floats, **more: Any) -> Estimate:  # noqa: ANN401
        """Return an estimate with these statistics."""
        return Estimate(
            amplitude=amplitude, variance=variance, innovation_mean_square=self.mean_square,
            innovation_log_variance=self.log_variance / max(self.count, 1), innovation_samples=self.count,
            innovation_autocorrelation=self.autocorrelation, **more,
        )  # fmt: skip

    def separate(self) -> None:
        """Begin a segment that is not adjacent to the last one: no products across the gap."""
        self.recent[:] = self.recent_seen[:] = 0.0

    def add(self, innovations: Floats, variances: Floats, *, skip: int = 0) -> None:
        """Add (channel, sample) normalised innovations and their (sample,) variances, 0 where missing.

        The first `skip` samples, those before the end of start-up, are not in the sums.
        """
        innovations, variances = innovations[:, max(skip, 0) :], variances[max(skip, 0) :]
        if variances.size == 0:
            return
        seen = variances > 0
        self.log_variance += float(np.log(variances if seen.all() else variances[seen]).sum())
        joined = np.concatenate([self.recent, innovations], axis=1)
        known = np.concatenate([self.recent_seen, seen])
        *sums, pairs = (np.correlate(row, row[LAGS:])[::-1] for row in (*joined, known))  # at lags from 0 on
        self.square += [own[0] for own in sums]
        self.products += [own[1:] for own in sums]
        self.count += int(pairs[0])
        self.pairs += pairs[1:]
        self.recent, self.recent_seen = joined[:, -LAGS:].copy(), known[-LAGS:].copy()


def statistics(record: Floats, estimate: Estimate, given: float | None) -> dict[str, Any]:
    """Return the (channel, ...) fields of `OrderTracks` on noise and innovations, and the shared ones of all channels.

    `given` is the variance R of the noise; None where the mean square of the innovations estimates it.
    """
    channels, count, mean_square = len(record), estimate.innovation_samples, estimate.innovation_mean_square
    none = 0.0 if count else np.nan
    noise = mean_square.astype(np.float64) if given is None else np.full(channels, float(given))
    if given is None:
        _check_not_faint(record, noise)
    variance = estimate.variance[None]  # a view where there is one channel
    return {
        "complex_amplitude": estimate.amplitude,
        "settling_variance": variance if channels == 1 else np.broadcast_to(variance, (channels, *variance.shape[1:])),
        "noise_variance": noise,
        "noise_density": np.broadcast_to(noise[:, None, None], (channels, estimate.amplitude.shape[-2], 1)),
        "innovation_variance": noise * np.exp(estimate.innovation_log_variance) + none,
        "innovation_mean_square": np.ones(channels) if given is None else mean_square / noise + none,
        "innovation_autocorrelation": estimate.innovation_autocorrelation + none,
        "whiteness": np.mean(estimate.innovation_autocorrelation**2, axis=1) * count + none,
    }


def _check_not_faint(record: NDArray[np.float64], noise: Floats) -> None:
    """Refuse a record so small that the squares of its samples underflow."""
    for channel in np.flatnonzero(noise < SMALLEST**2):
        values = record[channel]
        largest = max(np.fmax.reduce(values), -np.fmin.reduce(values))
        if 0 < largest < SMALLEST:
            raise ValueError(
                f"x reaches no more than {largest:.3g} in channel {channel}, whose square is too small to estimate "
                "the noise from; scale the record to another unit."
            )
