"""Likelihood ratio of a line against noise at every bin of a short-time spectrum, normalised by its noise.

The power of noise, over its local mean, is exponentially distributed: density ``exp(-u)``. For a line of unknown
signal-to-noise ratio the mean ``s`` has the prior density ``s^-2`` from 1 on, so

    p_1(u) = integral_1^inf s^-3 exp(-u / s) ds = (1 - (1 + u) exp(-u)) / u^2.

Every record has lines of other sources, and noise that is not white. A fraction of all bins, estimated from the record,
is attributed to them, with the prior density ``s^-2.5``, since most are weaker. A single strong line is therefore weak
evidence: it adds only the logarithm of its amplitude.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import fft
from scipy.special import gamma, gammainc

from signals._validation import Array

DC_BINS = 3.0  # bins that the leakage of an offset reaches with a Hann window
PRESENT = 0.3  # prior probability of a line of an order in a frame
_BLOCK = 24  # bins per median
_SMOOTH = 3  # frames
_HIGH = 8.0  # means that noise exceeds once in 3000 bins
_TABLE = np.linspace(-4.0, 16.0, 4001)  # log of the power ratio


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Short-time power over the local noise, ``ratios`` (bins, frames); `foreign` is the fraction of other lines."""

    ratios: Array
    times_s: Array
    bins_per_hz: float
    foreign: float

    def log_votes(self) -> Array:
        """Return the log likelihood ratio of an order that may be present at each bin, (bins, frames)."""
        table = np.log1p(PRESENT * np.expm1(_log_ratio(self.foreign)))
        return np.asarray(np.interp(np.log(np.maximum(self.ratios, 1e-9)), _TABLE, table))


def _scale_mixture(u: Array, power: float) -> Array:
    """Return the density of an exponential variable whose mean has the density ``power s^-(power + 1)`` from 1 on."""
    return np.asarray(power * gamma(power + 1) * gammainc(power + 1, u) / u ** (power + 1))


@lru_cache(maxsize=8)  # a search asks for that of one record at every speed
def _log_ratio(foreign: float) -> Array:
    """Return the table of log p_1 / p_0 over the power ratio."""
    u = np.exp(_TABLE)
    noise = (1 - foreign) * np.exp(-u) + foreign * _scale_mixture(u, 1.5)
    return np.asarray(np.log(_scale_mixture(u, 1.0)) - np.log(noise))


def lowest_band(signal: Array, *, rate_hz: float, top_hz: float) -> tuple[Array, float]:
    """Return the signal without its mean, low-pass filtered at `top_hz` and decimated, and the new rate."""
    length = fft.next_fast_len(signal.size, real=True)
    # 1.25 times the band that is kept
    fewer = fft.next_fast_len(int(np.ceil(length * min(1.0, 2 * 1.25 * top_hz / rate_hz))), real=True)
    level = signal - signal.mean()
    if fewer >= length:
        return level, rate_hz
    lines = fft.rfft(level, length)[: fewer // 2 + 1]
    rate = rate_hz * fewer / length
    values = fft.irfft(lines, fewer)[: int(np.floor((signal.size - 1) * fewer / length)) + 1]
    return np.asarray(values * (fewer / length)), rate


def short_time_evidence(signal: Array, *, rate_hz: float, frame_s: float) -> Evidence:
    """Return the spectra of Hann frames with 50 % overlap, normalised by their noise.

    The noise at each bin is the median over a block of bins, over log 2, averaged over three frames and interpolated
    between blocks.
    """
    length = int(frame_s * rate_hz) // 2 * 2
    hop = length // 2
    frames = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(length) + 0.5) / length)
    padded = fft.next_fast_len(length, real=True)
    lines = fft.rfft(frames * window, padded, axis=1)
    power = np.ascontiguousarray((lines.real**2 + lines.imag**2).T)
    ratios = _normalised(power, first=int(np.ceil(DC_BINS * padded / length)))
    times = np.asarray((np.arange(frames.shape[0]) * hop + (length - 1) / 2) / rate_hz, dtype=np.float64)
    return Evidence(ratios=ratios, times_s=times, bins_per_hz=padded / rate_hz, foreign=_foreign(ratios))


def _foreign(ratios: Array) -> float:
    """Return the fraction of bins that hold lines."""
    count = np.count_nonzero(ratios > _HIGH)
    shares = (0.005, 0.3)
    return float(np.clip(count / ratios.size - np.exp(-_HIGH), *shares))


def without_steady_lines(evidence: Evidence) -> Evidence:
    """Return the evidence of lines that move from bin to bin: each bin over its own median of the frames, if higher.

    What stays in a bin through half the record, as hum and machines of constant speed do, is noise of that bin.
    """
    own = np.median(evidence.ratios, axis=1, keepdims=True) / np.log(2)
    ratios = evidence.ratios / np.maximum(own, 1.0)
    return replace(evidence, ratios=ratios, foreign=_foreign(ratios))


def _normalised(power: Array, *, first: int) -> Array:
    """Return the power (bins, frames) over its local noise; 1 where the noise is zero."""
    bins, frames = power.shape
    starts = np.unique(np.clip(np.arange(first, bins, _BLOCK // 2), first, max(bins - _BLOCK, first)))
    level = np.array([np.median(power[start : start + _BLOCK], axis=0) for start in starts]) / np.log(2)
    silent = level <= 1e-20 * power.max(initial=0.0)  # rounding
    padded = np.pad(np.log(np.where(silent, 1.0, level)), ((0, 0), (_SMOOTH // 2, _SMOOTH // 2)), mode="edge")
    smooth = np.mean([padded[:, k : k + frames] for k in range(_SMOOTH)], axis=0)
    position = np.interp(np.arange(bins), starts + (_BLOCK - 1) / 2, np.arange(starts.size, dtype=np.float64))
    low = np.minimum(position.astype(np.int64), max(starts.size - 2, 0))
    high = np.minimum(low + 1, starts.size - 1)
    part = (position - low)[:, None]
    noise = np.exp(smooth[low] + part * (smooth[high] - smooth[low]))
    return np.where(silent[low] | silent[high], 1.0, power / noise)


def log_line_ratio(ratios: Array, *, foreign: float) -> Array:
    """Return log p_1 / p_0 for normalised powers of any shape."""
    return np.asarray(np.interp(np.log(np.maximum(ratios, 1e-9)), _TABLE, _log_ratio(foreign)))
