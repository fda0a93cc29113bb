"""Mean squares of innovations and residuals, and what of the results follows from them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._arguments import SMALLEST
from signals.harmonics.state_space import Complexes, Estimate, Flags, Floats


@dataclass
class Innovations:
    """Sums over normalised innovations, those over their standard deviations."""

    square: Floats  # (channel,), of their squares
    count: int = 0

    @property
    def mean_square(self) -> Floats:
        """(channel,) array, mean square of the normalised innovations."""
        return self.square / max(self.count, 1)

    def estimate(self, amplitude: Complexes, variance: Floats, **more: Any) -> Estimate:  # noqa: ANN401
        """Return an estimate with these statistics."""
        return Estimate(
            amplitude=amplitude, variance=variance, innovation_mean_square=self.mean_square,
            innovation_samples=self.count, **more,
        )  # fmt: skip

    def add(self, innovations: Floats, seen: Flags, *, skip: int = 0) -> None:
        """Add (channel, sample) normalised innovations, 0 where not `seen`, (sample,), but for the first `skip`."""
        later = innovations[:, max(skip, 0) :]
        self.square += np.einsum("cn,cn->c", later, later)
        self.count += int(np.count_nonzero(seen[max(skip, 0) :]))


def statistics(record: Floats, estimate: Estimate, flags: NDArray[np.uint8], given: float | None) -> dict[str, Any]:
    """Return the (channel, ...) fields of `OrderTracks`; all channels share variances and flags, (order, output).

    `given` is the variance R of the noise; None where the mean square of the innovations estimates it.
    """
    channels, count, mean_square = len(record), estimate.innovation_samples, estimate.innovation_mean_square
    none = 0.0 if count else np.nan
    noise = mean_square.astype(np.float64) if given is None else np.full(channels, float(given))
    if given is None:
        _check_not_faint(record, noise)
    return {
        "complex_amplitude": estimate.amplitude,
        "settling_variance": np.broadcast_to(estimate.variance, (channels, *estimate.variance.shape)),
        "flags": np.broadcast_to(flags, (channels, *flags.shape)),
        "noise_variance": noise,
        "noise_density": np.broadcast_to(noise[:, None, None], (channels, estimate.amplitude.shape[-2], 1)),
        "noise_freedom": np.full((channels, 1, 1), np.inf),
        "innovation_mean_square": np.ones(channels) if given is None else mean_square / noise + none,
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
