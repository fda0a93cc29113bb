"""Indicators of any waveform: level, peaks, weight of the tails. Raw RMS is what every other is held against."""

import numpy as np
from numpy.typing import ArrayLike

from signals._checks import Array, Samples, real_samples
from signals.averaging import SynchronousAverage

_BLOCK = 2**15

Waveform = ArrayLike | SynchronousAverage


def rms(x: Waveform) -> float:
    """Return the root mean square about the mean, in the unit of `x`.

    The mean of an accelerometer is its own offset and tells nothing of the machine.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.
    """
    deviations = _deviations(x)
    return float(np.sqrt(_mean_power(deviations, 2)))


def peak(x: Waveform) -> float:
    """Return the largest distance from the mean, in the unit of `x`; of the raw signal or its average."""
    deviations = _deviations(x)
    return max(float(deviations.max()), -float(deviations.min()))


def crest_factor(x: Waveform) -> float:
    """Return peak over RMS: sqrt 2 for a sine (Lebold et al. 2000, MFPG 54); of the raw signal or its average."""
    scaled = _scaled(_deviations(x), "the crest factor")
    return float(1 / np.sqrt(_mean_power(scaled, 2)))


def kurtosis(x: Waveform) -> float:
    """Return the fourth moment about the mean over the variance squared: 3 for Gaussian noise, 1.5 for a sine.

    For the raw signal or its average; of bearing signals since Dyer & Stewart (1978, J. Mech. Des. 100(2), 229-235).
    """
    return normalized_moment(_values(x), order=4, name="the kurtosis")


def normalized_moment(x: Samples, *, order: int, name: str) -> float:
    """Return the central moment of even `order` over the variance to the power of half of it, of an array (n,)."""
    scaled = _scaled(_centred(x), name)
    return float(_mean_power(scaled, order) / _mean_power(scaled, 2) ** (order // 2))


def teager_energy(x: Array) -> Array:
    """Return ``x[i]^2 - x[i-1] x[i+1]`` round one revolution, (n,): ``A^2 sin(w)^2`` for a sine of w rad a sample.

    Source: Kaiser (1990), "On a simple algorithm to calculate the 'energy' of a signal", ICASSP.
    """
    return np.asarray(x**2 - np.roll(x, 1) * np.roll(x, -1))


def _deviations(x: Waveform) -> Samples:
    return _centred(_values(x))


def _values(x: Waveform) -> Samples:
    if isinstance(x, SynchronousAverage):
        x = x.values
    elif hasattr(x, "removed_orders"):
        raise TypeError(
            f"this indicator takes the raw signal, an array, or a SynchronousAverage, not a {type(x).__name__}; what "
            "was cut out of an average has indicators of its own."
        )
    return real_samples(x, name="the signal", minimum=2)


def _centred(values: Samples) -> Samples:
    """Return deviations from the mean; of float32 values in float32, each rounded by 6e-8 of itself."""
    return np.asarray(values - values.mean(dtype=np.float64).astype(values.dtype))


def _mean_power(values: Samples, order: int) -> float:
    """Return the mean of the values to an even power, in blocks: products cost a twentieth of `**`, and no memory."""
    total = 0.0
    for first in range(0, values.size, _BLOCK):
        square = values[first : first + _BLOCK].astype(np.float64) ** 2
        power = square
        for _ in range(order // 2 - 1):
            power = power * square
        total += float(power.sum())
    return total / values.size


def _scaled(deviations: Samples, name: str) -> Samples:
    """Divide deviations by the largest of them, so that their powers neither over- nor underflow."""
    largest = max(float(deviations.max()), -float(deviations.min()))
    if largest == 0:
        raise ValueError(f"{name} of a constant signal is not defined; look at the sensor.")
    deviations /= deviations.dtype.type(largest)
    return deviations
