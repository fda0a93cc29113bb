"""Deterministic and random parts of a record: gears repeat themselves, bearings slip and do not.

Three ways, each of which returns both parts and how they were told apart. Their sum is the record.

- `linear_prediction`: what an autoregressive model foretells from the samples before. Cheap, needs no repetition;
  the random part also comes out whitened.
- `discrete_random_separation`: what is still the same a delay later, frequency by frequency. The random part keeps its
  colour; needs a steady speed, or a record over angle.
- `cepstrum_prewhitening`: every line is set to the same height. No setting at all, and no model.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.linalg import solve_toeplitz

from signals._checks import Array, real_vector, whole

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_FEWEST_BLOCKS = 8
_AT_ONCE = 1 << 16  # samples transformed together
_OVERLAP = 4  # blocks begin a quarter of their length apart: more adds nothing to a Hann window's averages


@dataclass(frozen=True, kw_only=True)
class SeparatedSignal:
    """A record in two parts, ``deterministic + random``, from its sample ``start`` on."""

    deterministic: Array = field(metadata={"dims": ("time",), "units": "as the record"})
    random: Array = field(metadata={"dims": ("time",), "units": "as the record"})
    start: int


@dataclass(frozen=True, kw_only=True)
class LinearPrediction(SeparatedSignal):
    """What ``sum_k coefficients[k - 1] x[n - k]`` foretells of a record without its mean, and the error of it."""

    coefficients: Array = field(metadata={"dims": ("lag",), "units": "1"})

    @property
    def order(self) -> int:
        """How many samples before are used."""
        return int(self.coefficients.size)


@dataclass(frozen=True, kw_only=True)
class DiscreteRandomSeparation(SeparatedSignal):
    """What a record has in common with itself ``delay`` samples before, and what it has not.

    ``gain`` is the filter at the frequencies of ``frequency``, in cycles a sample; ``blocks`` how many it was averaged
    over, overlapping ones included.
    """

    gain: Array = field(metadata={"dims": ("frequency",), "units": "1"})
    frequency: Array = field(metadata={"dims": ("frequency",), "units": "cycles per sample"})
    window_length: int
    delay: int
    blocks: int


@dataclass(frozen=True, kw_only=True)
class CepstrumPrewhitening(SeparatedSignal):
    """A record with all its lines set to one height (the random part), and what that took away.

    ``level`` is this height: the geometric mean of the magnitude of the lines of the record's transform;
    ``silent_lines`` how many were set to zero, since they lay at rounding and have no phase to keep.
    """

    level: float
    silent_lines: int


@dataclass(frozen=True, kw_only=True)
class PredictionOrders:
    """How well autoregressive models of every order up to a limit predict a record.

    ``variance`` is that of the prediction error over that of the record, from order 0 on; ``aic`` is Akaike's
    criterion, ``n log(variance) + 2 order``; ``order`` is where it is least.
    """

    order: int
    variance: Array = field(metadata={"dims": ("order",), "units": "1"})
    aic: Array = field(metadata={"dims": ("order",), "units": "1"})


def prediction_orders(x: ArrayLike, *, most: int) -> PredictionOrders:
    """Compare autoregressive models by Akaike's criterion (1974, IEEE Trans. Autom. Control 19(6), 716-723).

    All orders come from one Levinson-Durbin recursion over the autocorrelation of the record. The criterion weighs
    prediction alone; to keep a bearing's impulses out of the model stay below their spacing in samples.

    Parameters
    ----------
    x : (n,) array
    most : int
        The highest order looked at, less than n / 2.
    """
    signal, _ = _centred(x)
    lags = _autocorrelation(signal, whole(most, name="most", least=1, most=max(1, (signal.size - 1) // 2)))
    variance = np.ones(lags.size)
    model = np.zeros(0)
    for order in range(1, lags.size) if lags[0] > 0 else ():
        reflection = (lags[order] - model @ lags[order - 1 : 0 : -1]) / variance[order - 1]
        model = np.append(model - reflection * model[::-1], reflection)
        variance[order] = max(variance[order - 1] * (1 - reflection**2), np.finfo(float).tiny)
    aic = np.asarray(signal.size * np.log(variance) + 2 * np.arange(lags.size), dtype=np.float64)
    return PredictionOrders(order=int(np.argmin(aic)), variance=variance, aic=aic)


def linear_prediction(x: ArrayLike, *, order: int) -> LinearPrediction:
    """Separate a record by linear prediction: the Yule-Walker equations, solved by Levinson's recursion.

    Each sample is predicted from the `order` samples before it; the first `order` ones, which have not as many, from
    those after them, since a stationary record has the same correlation in both directions. Sources: Makhoul 1975
    (Proc. IEEE 63(4), 561-580); Wang & Wong 2002 ("Autoregressive model-based gear fault diagnosis", J. Vib. Acoust.
    124(2), 172-179); Sawalhi, Randall & Endo 2007 (Mech. Syst. Signal Process. 21(6), 2616-2633).

    Parameters
    ----------
    x : (n,) array
        Its mean counts as deterministic.
    order : int
        From 1 to less than n / 2; `prediction_orders` advises.

    Returns
    -------
    LinearPrediction
        Both parts (n,). The random part of a stationary record is white.

    Raises
    ------
    ValueError
        A record of no more than twice the order.
    """
    signal, mean = _centred(x)
    taken = whole(order, name="order", least=1)
    if signal.size <= 2 * taken:
        raise ValueError(
            f"{signal.size} samples are too few for a prediction of order {taken}, which needs more than {2 * taken}; "
            "record longer, or take a lower order."
        )
    lags = _autocorrelation(signal, taken)
    coefficients = np.zeros(taken)
    if lags[0] > 0:
        coefficients = np.asarray(solve_toeplitz(lags[:-1], lags[1:]), dtype=np.float64)
    foretold = np.empty(signal.size)
    foretold[taken:] = _weighted_sums(signal[:-1], coefficients)
    foretold[:taken] = _weighted_sums(signal[2 * taken - 1 : 0 : -1], coefficients)[::-1]
    return LinearPrediction(deterministic=foretold + mean, random=signal - foretold, start=0, coefficients=coefficients)


def discrete_random_separation(x: ArrayLike, *, window_length: int, delay: int) -> DiscreteRandomSeparation:
    """Separate discrete frequencies from noise by the transfer function between a record and its past.

    Of blocks X of the record and blocks Y of the record a delay before, ``|E[X conj Y]| / E[|Y|^2]`` is
    ``q / (q + 1)`` where a line stands q times over the noise in a block's transform, and falls to about
    ``1 / sqrt(K)`` of K independent blocks where there is noise only. It is applied as a filter without phase, tapered
    to the length of the window (Antoni & Randall 2004, "Unsupervised noise cancellation for vibration signals: part
    II", Mech. Syst. Signal Process. 18(1), 103-117). The power is the mean of both blocks' here, which in a steady
    record is the same, and in any other keeps the gain from exceeding one.

    Parameters
    ----------
    x : (n,) array
        At steady speed, or over shaft angle. Its mean counts as deterministic.
    window_length : int
        Samples to a block, an even number. Longer ones tell closer lines apart and raise q, but leave fewer to average.
    delay : int
        In samples. At least the window length, so that no noise is in both blocks; longer than the noise remembers, as
        in a resonance; and long enough for a bearing to slip, which at steady speed takes time: of a rig's outer-race
        defect (CWRU OR007@6, 12 kHz, windows of 2048) 88 % of the power passes for discrete with a delay of 2048 and
        4 % with one of 20,000.

    Returns
    -------
    DiscreteRandomSeparation
        Both parts (n - window_length,): half a window at either end is without its surroundings.

    Raises
    ------
    ValueError
        A delay shorter than the window, or a record shorter than the delay and eight windows.
    """
    signal, mean = _centred(x)
    length = whole(window_length, name="window_length", least=8)
    if length % 2:
        raise ValueError(f"window_length={length} must be even; take {length + 1}.")
    lag = whole(delay, name="delay", least=length)
    if signal.size < lag + _FEWEST_BLOCKS * length:
        raise ValueError(
            f"{signal.size} samples are too few for windows of {length} and a delay of {lag}: below "
            f"{lag + _FEWEST_BLOCKS * length} chance looks like repetition; record longer, or shorten the windows."
        )
    gain, blocks = _transfer(signal, length, lag)
    filtered = _filtered(signal, gain, length)
    half = length // 2
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


def cepstrum_prewhitening(x: ArrayLike) -> CepstrumPrewhitening:
    """Set the whole real cepstrum to zero but at zero quefrency: every line of the record gets one height.

    Equal to dividing the transform by its magnitude and scaling by the geometric mean of it. Lines of gears, which
    are few, lose what made them stand out; impulses, whose lines are many and keep their phase, stand out instead
    (Borghesani, Pennacchi, Randall, Sawalhi & Ricci 2013, "Application of cepstrum pre-whitening for the diagnosis of
    bearing faults under variable speed conditions", Mech. Syst. Signal Process. 36(2), 370-384).

    Parameters
    ----------
    x : (n,) array
        Its mean counts as deterministic.

    Returns
    -------
    CepstrumPrewhitening
        Both parts (n,); the random part is the whitened record.
    """
    signal, mean = _centred(x)
    lines = np.asarray(fft.rfft(signal))
    height = np.abs(lines)
    heard = height > height.max() * signal.size * np.finfo(float).eps
    heard[0] = False  # what rounding left of the mean
    level = float(np.exp(np.mean(np.log(height[heard])))) if heard.any() else 0.0
    flat = np.where(heard, lines * (level / np.where(heard, height, 1.0)), 0.0)
    whitened = np.asarray(fft.irfft(flat, signal.size), dtype=np.float64)
    return CepstrumPrewhitening(
        deterministic=signal - whitened + mean,
        random=whitened,
        start=0,
        level=level,
        silent_lines=int(np.count_nonzero(~heard[1:])),
    )


def _centred(x: ArrayLike) -> tuple[Array, float]:
    """Return a record without its mean, and the mean; zeros where nothing but rounding varies."""
    signal = real_vector(x, name="the signal", minimum=4)
    mean = float(signal.mean())
    centred = signal - mean
    if np.abs(centred).max() <= 4 * np.finfo(float).eps * abs(mean):
        centred[:] = 0.0
    return centred, mean


def _autocorrelation(signal: Array, most: int) -> Array:
    """Return the autocorrelation at lags 0 to `most`, one at lag 0 (zeros for silence).

    Divided by n at every lag, which keeps it positive definite and the model stable.
    """
    if not signal.any():
        return np.zeros(most + 1)
    length = fft.next_fast_len(signal.size + most, real=True)
    lags = fft.irfft(np.abs(fft.rfft(signal, length)) ** 2, length)[: most + 1]
    return np.asarray(lags / lags[0], dtype=np.float64)


def _weighted_sums(past: Array, coefficients: Array) -> Array:
    """Return ``sum_k coefficients[k - 1] past[m - k]`` for m from the order to one beyond the end."""
    from scipy.signal import oaconvolve  # noqa: PLC0415

    return np.asarray(oaconvolve(past, coefficients, mode="valid"), dtype=np.float64)


def _transfer(signal: Array, length: int, lag: int) -> tuple[Array, int]:
    """Return the gain on a grid of half a bin, (length + 1,), and the number of blocks."""
    window = np.hanning(length + 1)[:-1]
    cross = np.zeros(length + 1, dtype=np.complex128)
    power = np.zeros(length + 1)
    every = length // _OVERLAP
    past = np.lib.stride_tricks.sliding_window_view(signal[: signal.size - lag], length)[::every]
    now = np.lib.stride_tricks.sliding_window_view(signal[lag:], length)[::every]
    together = max(1, _AT_ONCE // length)
    for first in range(0, past.shape[0], together):
        before = fft.rfft(past[first : first + together] * window, 2 * length)
        after = fft.rfft(now[first : first + together] * window, 2 * length)
        cross += np.sum(after * np.conj(before), axis=0)
        power += np.sum(np.abs(before) ** 2 + np.abs(after) ** 2, axis=0) / 2
    silent = power <= 0
    return np.where(silent, 0.0, np.abs(cross) / np.where(silent, 1.0, power)), past.shape[0]


def _filtered(signal: Array, gain: Array, length: int) -> Array:
    """Filter by a real gain, its response tapered to `length` + 1 samples: (n - length,)."""
    from scipy.signal import oaconvolve  # noqa: PLC0415

    response = np.fft.fftshift(fft.irfft(gain, 2 * length))[length // 2 : length + length // 2 + 1]
    return np.asarray(oaconvolve(signal, response * np.hanning(length + 3)[1:-1], mode="valid"), dtype=np.float64)
