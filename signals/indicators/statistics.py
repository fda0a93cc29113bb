"""Indicators of any waveform: RMS, peak, crest factor and kurtosis. Raw RMS is the baseline for all others."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from signals._validation import Array, Samples, checked, real_samples, real_vector
from signals.angle.averaging import SynchronousAverage

_BLOCK = 2**15

Waveform = ArrayLike | SynchronousAverage


@checked
def rms(x: Waveform) -> float:
    """Return the root mean square about the mean, in the unit of `x`.

    The mean of an accelerometer's signal is its own offset, not vibration.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        Fewer than two samples, or values that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import rms
    >>> round(rms(5 + 2 * np.sin(2 * np.pi * np.arange(100) / 100)), 6)  # 2 / sqrt(2)
    1.414214
    """
    return float(np.sqrt(_mean_power(_centred(_values(x, any_unit=False)), 2)))


@checked
def peak(x: Waveform) -> float:
    """Return the largest deviation from the mean, in the unit of `x`.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Examples
    --------
    >>> from signals.indicators import peak
    >>> peak([1.0, 1.0, 1.0, 5.0])
    3.0
    """
    deviations = _centred(_values(x))
    return max(float(deviations.max()), -float(deviations.min()))


@checked
def crest_factor(x: Waveform) -> float:
    """Return the peak over the RMS: sqrt 2 for a sine (Lebold et al. 2000, MFPG 54).

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import crest_factor
    >>> round(crest_factor(np.sin(2 * np.pi * np.arange(100) / 100)), 6)
    1.414214
    """
    scaled = _scaled(_centred(_values(x)), "the crest factor")
    return float(1 / np.sqrt(_mean_power(scaled, 2)))


@checked
def kurtosis(x: Waveform) -> float:
    """Return the fourth moment about the mean over the variance squared: 3 for Gaussian noise, 1.5 for a sine.

    Dyer & Stewart (1978), "Detection of rolling element bearing damage by statistical vibration analysis", J. Mech.
    Des. 100(2), 229-235.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import kurtosis
    >>> round(kurtosis(np.sin(2 * np.pi * np.arange(100) / 100)), 6)
    1.5
    """
    return normalized_moment(_values(x), order=4, name="the kurtosis")


def normalized_moment(x: Samples, *, order: int, name: str) -> float:
    """Return the central moment of even `order` of an (n,) array over its variance to the power `order / 2`."""
    scaled = _scaled(_centred(x), name)
    return float(_mean_power(scaled, order) / _mean_power(scaled, 2) ** (order // 2))


@checked
def teager_energy(x: Array) -> Array:
    """Return the Teager energy ``x[i]^2 - x[i-1] x[i+1]`` round one revolution: ``A^2 sin(w)^2`` for a sine.

    Kaiser (1990), "On a simple algorithm to calculate the 'energy' of a signal", ICASSP, 381-384.

    Parameters
    ----------
    x : (n,) array
        One revolution, so that the last sample is followed by the first.

    Returns
    -------
    (n,) array
        In the squared unit of `x`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import teager_energy
    >>> teager_energy(2 * np.sin(2 * np.pi * np.arange(12) / 12))[:3].round(6)  # w = 30 degrees a sample
    array([1., 1., 1.])
    """
    values = real_vector(x, name="x", minimum=3)
    return np.asarray(values**2 - np.roll(values, 1) * np.roll(values, -1))


def _values(x: Waveform, *, any_unit: bool = True) -> Samples:
    """Return the samples of a raw signal or an average; refuse what was cut out of an average."""
    if isinstance(x, SynchronousAverage):
        x = x.values
    elif hasattr(x, "removed_orders"):
        raise TypeError(
            f"this indicator takes the raw signal, an array, or a SynchronousAverage, not a {type(x).__name__}; what "
            "was cut out of an average has indicators of its own."
        )
    return real_samples(x, name="the signal", minimum=2, any_unit=any_unit)


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


_MADE_BY = {
    "SynchronousAverage": "synchronous_average",
    "ResidualSignal": "residual_signal",
    "DifferenceSignal": "difference_signal",
    "RegularSignal": "regular_signal",
    "MeshBand": "mesh_band",
    "AmplitudeSpectrum": "envelope_order_spectrum",
}


def expect(signal: object, kind: type, *, indicator: str) -> None:
    """Refuse a signal of another kind than the one an indicator is defined on."""
    if not isinstance(signal, kind):
        raise TypeError(
            f"{indicator} takes a {kind.__name__}, not a {type(signal).__name__}: it is defined for that signal alone. "
            f"Make one with signals.{_MADE_BY[kind.__name__]}."
        )
