"""Separation of the deterministic part of a record (gears) from the random part (slipping bearings).

Three methods, each of which returns two parts whose sum is the record:

- `linear_prediction`: the prediction of an autoregressive model, and its error. Cheap and independent of periodicity;
  the random part is also whitened.
- `discrete_random_separation`: a filter from the coherence between the record and its delayed copy. The random part
  keeps its spectrum; requires a steady speed or a record over angle.
- `cepstrum_prewhitening`: all spectral lines set to equal magnitude, without parameters or a model.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.linalg import solve_toeplitz

from signals._validation import Array, checked, real_vector, whole

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, kw_only=True)
class SeparatedSignal:
    """A record in two parts, ``deterministic + random``, starting at its sample `start`.

    Attributes
    ----------
    deterministic, random : (m,) arrays
        Both parts, in the unit of the record.
    start : int
        Index of their first sample in the record.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import SeparatedSignal, cepstrum_prewhitening
    >>> x = np.random.default_rng(1).standard_normal(256)
    >>> parts = cepstrum_prewhitening(x)
    >>> isinstance(parts, SeparatedSignal), bool(np.allclose(parts.deterministic + parts.random, x))
    (True, True)
    """

    deterministic: Array = field(metadata={"dims": ("time",), "units": "as the record"})
    random: Array = field(metadata={"dims": ("time",), "units": "as the record"})
    start: int


@dataclass(frozen=True, kw_only=True)
class LinearPrediction(SeparatedSignal):
    """Prediction ``sum_k coefficients[k - 1] x[n - k]`` of a record (deterministic), and its error (random).

    Attributes
    ----------
    deterministic, random, start
        As in `SeparatedSignal`.
    coefficients : (lag,) array
        Autoregressive coefficients.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import linear_prediction
    >>> linear_prediction(np.random.default_rng(1).standard_normal(256), order=3).order
    3
    """

    coefficients: Array = field(metadata={"dims": ("lag",), "units": "1"})

    @property
    def order(self) -> int:
        """Order of the autoregressive model."""
        return int(self.coefficients.size)


@dataclass(frozen=True, kw_only=True)
class DiscreteRandomSeparation(SeparatedSignal):
    """Discrete-frequency and random part of a record, and the filter that separates them.

    Attributes
    ----------
    deterministic, random, start
        As in `SeparatedSignal`.
    gain, frequency : (frequency,) arrays
        Gain of the filter, 0 to 1, at frequencies in cycles per sample.
    window_length, delay : int
        Lengths of the window and of the delay in samples.
    blocks : int
        Number of blocks averaged, including overlapping ones.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import discrete_random_separation
    >>> tone = np.sin(2 * np.pi * 0.25 * np.arange(4000))
    >>> parts = discrete_random_separation(tone, window_length=64, delay=100)
    >>> round(float(np.interp(0.25, parts.frequency, parts.gain)), 3), parts.start
    (1.0, 32)
    """

    gain: Array = field(metadata={"dims": ("frequency",), "units": "1"})
    frequency: Array = field(metadata={"dims": ("frequency",), "units": "cycles per sample"})
    window_length: int
    delay: int
    blocks: int


@dataclass(frozen=True, kw_only=True)
class CepstrumPrewhitening(SeparatedSignal):
    """A record with all spectral lines set to equal magnitude (random), and the remainder (deterministic).

    Attributes
    ----------
    deterministic, random, start
        As in `SeparatedSignal`.
    level : float
        That magnitude, the geometric mean of the magnitudes of the transform of the record.
    silent_lines : int
        Number of lines set to zero, whose magnitude is rounding error.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import cepstrum_prewhitening
    >>> cepstrum_prewhitening(np.random.default_rng(1).standard_normal(256)).silent_lines
    0
    """

    level: float
    silent_lines: int


@checked
def linear_prediction(x: ArrayLike, *, order: int) -> LinearPrediction:
    """Separate a record by linear prediction, solving the Yule-Walker equations by Levinson's recursion.

    Each sample is predicted from the `order` samples before it, and the first `order` samples from those after them,
    since a stationary record has the same correlation in both directions. Sources: Makhoul 1975
    (Proc. IEEE 63(4), 561-580); Wang & Wong 2002 ("Autoregressive model-based gear fault diagnosis", J. Vib. Acoust.
    124(2), 172-179); Sawalhi, Randall & Endo 2007 (Mech. Syst. Signal Process. 21(6), 2616-2633).

    Parameters
    ----------
    x : (n,) array
        Samples, any unit; their mean is part of the deterministic part.
    order : int
        Order of the model, at least 1 and below n / 2.

    Returns
    -------
    LinearPrediction
        Both parts (n,). The random part of a stationary record is white.

    Raises
    ------
    ValueError
        A record of no more than twice the order.

    Examples
    --------
    An impulse in a tone remains in the random part:

    >>> import numpy as np
    >>> from signals import linear_prediction
    >>> x = np.sin(0.3 * np.arange(2000))
    >>> x[1000] += 1
    >>> parts = linear_prediction(x, order=20)
    >>> int(np.argmax(np.abs(parts.random))), bool(np.allclose(parts.deterministic + parts.random, x))
    (1000, True)
    """
    signal, mean = _centred(x)
    taken = whole(order, name="order", least=1)
    if signal.size <= 2 * taken:
        raise ValueError(
            f"{signal.size} samples are too few for a prediction of order={taken}, which needs more than {2 * taken}; "
            "record longer, or use a lower order."
        )
    lags = _autocorrelation(signal, taken)
    coefficients = np.zeros(taken)
    if lags[0] > 0:
        coefficients = np.asarray(solve_toeplitz(lags[:-1], lags[1:]), dtype=np.float64)
    predicted = np.empty(signal.size)
    predicted[taken:] = _convolved(signal[:-1], coefficients)
    predicted[:taken] = _convolved(signal[2 * taken - 1 : 0 : -1], coefficients)[::-1]
    return LinearPrediction(
        deterministic=predicted + mean, random=signal - predicted, start=0, coefficients=coefficients
    )


@checked
def discrete_random_separation(x: ArrayLike, *, window_length: int, delay: int) -> DiscreteRandomSeparation:
    """Separate discrete frequencies from noise by the transfer function between a record and its delayed copy.

    For the transforms X of blocks of the record and Y of blocks of its delayed copy, ``|E[X conj Y]| / E[|Y|^2]`` is
    ``q / (q + 1)`` for a line with q times the power of the noise, and about ``1 / sqrt(K)`` for noise alone, with K
    independent blocks. It is the gain of a zero-phase filter, whose response is tapered to the length of the window
    (Antoni & Randall 2004, "Unsupervised noise cancellation for vibration signals: part II", Mech. Syst. Signal
    Process. 18(1), 103-117). The denominator used is the mean of ``E[|X|^2]`` and ``E[|Y|^2]``, equal in a stationary
    record, which limits the gain to one.

    Parameters
    ----------
    x : (n,) array
        Samples at constant speed, or over shaft angle; their mean is part of the deterministic part.
    window_length : int
        Samples per block, even. Longer blocks resolve closer lines and increase q, but leave fewer to average.
    delay : int
        Delay in samples: at least the window length, so that blocks share no noise; longer than the correlation time of
        the noise, for example of a resonance; and long enough for bearing slip to decorrelate impacts. For an
        outer-race defect (CWRU OR007@6, 12 kHz, windows of 2048), 88 % of the power is classified as deterministic with
        a delay of 2048, and 4 % with one of 20,000.

    Returns
    -------
    DiscreteRandomSeparation
        Both parts (n - window_length,): half a window at either end is left out.

    Raises
    ------
    ValueError
        An odd window length, a delay shorter than the window, or a record shorter than the delay and eight windows.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import discrete_random_separation
    >>> tone, noise = np.sin(2 * np.pi * 0.25 * np.arange(20_000)), np.random.default_rng(1).standard_normal(20_000)
    >>> parts = discrete_random_separation(tone + noise, window_length=256, delay=256)
    >>> bool(np.corrcoef(parts.deterministic, tone[128:-128])[0, 1] > 0.95)
    True
    """
    signal, mean = _centred(x)
    length = whole(window_length, name="window_length", least=8)
    if length % 2:
        raise ValueError(f"window_length={length} must be even; take {length + 1}.")
    lag = whole(delay, name="delay", least=length)
    fewest_blocks = 8
    if signal.size < lag + fewest_blocks * length:
        raise ValueError(
            f"{signal.size} samples are too few for window_length={length} and delay={lag}: with fewer than "
            f"{lag + fewest_blocks * length}, noise correlates by chance; record longer, or reduce either."
        )
    gain, blocks = _transfer(signal, length, lag)
    half = length // 2
    response = np.fft.fftshift(fft.irfft(gain, 2 * length))[half : half + length + 1] * np.hanning(length + 3)[1:-1]
    filtered = _convolved(signal, response)  # (n - length,)
    return DiscreteRandomSeparation(
        deterministic=filtered + mean,
        random=signal[half:-half] - filtered,
        start=half,
        gain=gain,
        frequency=np.arange(gain.size) / (2 * length),
        window_length=length,
        delay=lag,
        blocks=blocks,
    )


@checked
def cepstrum_prewhitening(x: ArrayLike) -> CepstrumPrewhitening:
    """Whiten a record by setting its real cepstrum to zero except at zero quefrency.

    This is equivalent to dividing the transform by its magnitude and multiplying by the geometric mean of the
    magnitudes. It removes the few strong lines of gears, while impulses, whose many lines keep their phase, remain
    (Borghesani,
    Pennacchi, Randall, Sawalhi & Ricci 2013, "Application of cepstrum pre-whitening for the diagnosis of bearing
    faults under variable speed conditions", Mech. Syst. Signal Process. 36(2), 370-384).

    Parameters
    ----------
    x : (n,) array
        Samples, any unit; their mean is part of the deterministic part.

    Returns
    -------
    CepstrumPrewhitening
        Both parts (n,); the random part is the whitened record.

    Raises
    ------
    ValueError
        Fewer than four samples, or values that are not finite.

    Examples
    --------
    All lines of the whitened record have the same magnitude:

    >>> import numpy as np
    >>> from signals import cepstrum_prewhitening
    >>> parts = cepstrum_prewhitening(np.random.default_rng(1).standard_normal(255))
    >>> bool(np.allclose(np.abs(np.fft.rfft(parts.random))[1:], parts.level))
    True
    """
    signal, mean = _centred(x)
    lines = np.asarray(fft.rfft(signal))
    magnitude = np.abs(lines)
    significant = magnitude > magnitude.max() * signal.size * np.finfo(float).eps
    significant[0] = False  # rounding error, since the mean was removed
    level = float(np.exp(np.mean(np.log(magnitude[significant])))) if significant.any() else 0.0
    flat = np.where(significant, lines * (level / np.where(significant, magnitude, 1.0)), 0.0)
    whitened = np.asarray(fft.irfft(flat, signal.size), dtype=np.float64)
    return CepstrumPrewhitening(
        deterministic=signal - whitened + mean,
        random=whitened,
        start=0,
        level=level,
        silent_lines=int(np.count_nonzero(~significant[1:])),
    )


def _centred(x: ArrayLike) -> tuple[Array, float]:
    """Return a record without its mean, and the mean; zeros if it varies only by rounding error."""
    signal = real_vector(x, name="the signal", minimum=4)
    mean = float(signal.mean())
    centred = signal - mean
    if np.abs(centred).max() <= 4 * np.finfo(float).eps * abs(mean):
        centred[:] = 0.0
    return centred, mean


def _autocorrelation(signal: Array, most: int) -> Array:
    """Return the autocorrelation at lags 0 to `most`, one at lag 0 (zeros for a record of zeros).

    Division by n at every lag keeps it positive definite and the model stable.
    """
    if not signal.any():
        return np.zeros(most + 1)
    length = fft.next_fast_len(signal.size + most, real=True)
    lags = fft.irfft(np.abs(fft.rfft(signal, length)) ** 2, length)[: most + 1]
    return np.asarray(lags / lags[0], dtype=np.float64)


def _convolved(signal: Array, response: Array) -> Array:
    """Return the convolution where the whole response lies within the signal."""
    from scipy.signal import oaconvolve  # noqa: PLC0415

    return np.asarray(oaconvolve(signal, response, mode="valid"), dtype=np.float64)


def _transfer(signal: Array, length: int, lag: int) -> tuple[Array, int]:
    """Return the gain on a grid of half a bin, (length + 1,), and the number of blocks."""
    window = np.hanning(length + 1)[:-1]
    cross = np.zeros(length + 1, dtype=np.complex128)
    power = np.zeros(length + 1)
    hop = length // 4  # 4 hops per block, an overlap of 75 %: more does not reduce the variance with a Hann window
    past = np.lib.stride_tricks.sliding_window_view(signal[: signal.size - lag], length)[::hop]
    now = np.lib.stride_tricks.sliding_window_view(signal[lag:], length)[::hop]
    count = max(1, (1 << 16) // length)  # 1 << 16 samples transformed at once
    for first in range(0, past.shape[0], count):
        before = fft.rfft(past[first : first + count] * window, 2 * length)
        after = fft.rfft(now[first : first + count] * window, 2 * length)
        cross += np.sum(after * np.conj(before), axis=0)
        power += np.sum(np.abs(before) ** 2 + np.abs(after) ** 2, axis=0) / 2
    silent = power <= 0
    return np.where(silent, 0.0, np.abs(cross) / np.where(silent, 1.0, power)), past.shape[0]
