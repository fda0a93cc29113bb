"""Spectral kurtosis, and the fast kurtogram: in which band a record is impulsive.

The kurtosis of a band's complex envelope c is ``<|c|^4> / <|c|^2>^2 - 2``: zero for steady Gaussian noise, above it
for impulses, -1 for a pure tone (-s^2 where a tone holds the share s of the band's power in noise).

References
----------
.. [1] Antoni, "The spectral kurtosis: a useful tool for characterising non-stationary signals", Mechanical Systems
   and Signal Processing 20 (2006).
.. [2] Antoni, "Fast computation of the kurtogram for the detection of transient faults", MSSP 21 (2007).
.. [3] Antoni, "The infogram: entropic evidence of the signature of repetitive transients", MSSP 74 (2016).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from signals._checks import Array, Samples, positive, real_samples, whole
from signals._plans import forget_plans
from signals._windows import window_of
from signals.spectra import hop_of, transformed, without_mean

if TYPE_CHECKING:
    from collections.abc import Iterator

Single = NDArray[np.float32]

LEVELS = 7
FEWEST_SAMPLES = 320  # of the narrowest band: its filter takes 48 of them
PARTS = 16  # of the record
LEFT_OUT = 2  # loudest parts, without which the steady kurtosis is taken: a spike on a seam lies in two
NOISE_NEGENTROPY = 1 - np.euler_gamma  # of exponentially distributed powers, as noise has them
NEGENTROPY_SCATTER = 0.53  # measured: standard deviation times sqrt(lines), for such powers
_TAPS = {2: 48, 3: 72}
_CUTOFF = 0.3  # over the number of bands: 6 dB down 1.2 half widths off the middle
_KAISER_BETA = 8.0
_LEAK = 1e-7  # of the record's power: below, a band holds what the filters let through from others
_LOWEST_LINE = 4  # slower changes than four in a record are drift
_SMOOTHED = 32  # stretches of the squared envelope's spectrum whose mean is its background


@dataclass(frozen=True, kw_only=True)
class SpectralKurtosis:
    """Kurtosis of each line of a short-time Fourier transform, unbiased for Gaussian noise.

    ``noise_std`` is the standard deviation that steady Gaussian noise gives each line; ``effective_frames`` how many
    independent frames the overlapping ones are worth for it.
    """

    frequency_hz: Array = field(metadata={"dims": ("line",), "units": "Hz"})
    kurtosis: Array = field(metadata={"dims": ("line",), "units": "1"})
    frames: int
    effective_frames: float
    noise_std: float
    bin_width_hz: float
    resolution_hz: float
    window: str


def spectral_kurtosis(
    x: ArrayLike, *, rate_hz: float, window_length: int, window: str = "hann", overlap: float = 0.75
) -> SpectralKurtosis:
    """Return the spectral kurtosis by the short-time Fourier transform [1]_.

    The first two lines and the last two are left out: near 0 and half the rate a window sees positive and negative
    frequencies at once, and noise there is not circular.

    Parameters
    ----------
    x : (n,) array
    rate_hz : float
    window_length : int
        Samples: longer than an impulse's ringing, shorter than the time between impulses.
    window : str
        A window of `scipy.signal`.
    overlap : float
        Part of a window that the next one shares, from 0 to below 1.

    Notes
    -----
    From M frames, ``(M + 1) / (M - 1) (M sum(p^2) / sum(p)^2 - 1) - 1`` with p the power has mean zero for noise in
    independent frames (Nita & Gary 2010); M is the effective number where frames overlap.
    """
    signal = _vibration(x, minimum=16)
    rate = positive(rate_hz, name="rate_hz")
    length = whole(window_length, name="window_length", least=8, most=signal.size)
    shape = window_of(window, length)
    hop = hop_of(length, overlap)
    seconds, fourths, count = np.zeros(length // 2 + 1), np.zeros(length // 2 + 1), 0
    for lines in transformed(signal, shape, hop):
        power = lines.real**2 + lines.imag**2
        seconds += power.sum(axis=0)
        fourths += np.sum(power**2, axis=0)
        count += len(lines)
    alike = shape.overlap_correlation(hop)[: count - 1]
    # the part of p^2 that decides is the second Laguerre polynomial of p: frames correlate in it as amplitudes^4
    effective = count / (1 + 2 * np.sum((1 - np.arange(1, alike.size + 1) / count) * alike**4))
    if effective < 2:  # noqa: PLR2004
        raise ValueError(
            f"{count} windows of {length} samples are too few for a kurtosis; shorten the window, or record longer."
        )
    ratio = count * fourths[2:-2] / np.where(seconds[2:-2] > 0, seconds[2:-2], np.nan) ** 2
    return SpectralKurtosis(
        frequency_hz=np.arange(2, length // 2 - 1, dtype=np.float64) * (rate / length),
        kurtosis=(effective + 1) / (effective - 1) * (ratio - 1) - 1,
        frames=count,
        effective_frames=float(effective),
        noise_std=float(2 / np.sqrt(effective)),
        bin_width_hz=rate / length,
        resolution_hz=shape.width_bins * rate / length,
        window=window,
    )


@dataclass(frozen=True, kw_only=True)
class Kurtogram:
    """Kurtosis of the bands of a tree: halves (whole levels) and thirds of halves (levels .58 higher).

    Arrays hold one value a band, by level and then frequency. ``steady_kurtosis`` leaves the loudest two sixteenths of
    the record out: what a single event makes does not survive it, what repeats does. ``noise_std`` is what steady
    noise scatters a kurtosis by. ``envelope_negentropy`` (where asked for) tells how much of the squared envelope
    lies in few lines of its spectrum, each power over its surroundings' mean: ``<p ln p>``, 1 - 0.577 for noise.
    Bands without power (what filters leak is not counted) have kurtosis NaN.
    """

    level: Array = field(metadata={"dims": ("band",), "units": "1"})
    low_hz: Array = field(metadata={"dims": ("band",), "units": "Hz"})
    high_hz: Array = field(metadata={"dims": ("band",), "units": "Hz"})
    kurtosis: Array = field(metadata={"dims": ("band",), "units": "1"})
    steady_kurtosis: Array = field(metadata={"dims": ("band",), "units": "1"})
    noise_std: Array = field(metadata={"dims": ("band",), "units": "1"})
    power_share: Array = field(metadata={"dims": ("band",), "units": "1"})
    envelope_negentropy: Array | None = field(default=None, metadata={"dims": ("band",), "units": "1"})
    envelope_lines: Array = field(metadata={"dims": ("band",), "units": "1"})

    def image(self) -> tuple[Array, Array]:
        """Return the levels (rows,) and the kurtosis as a picture (rows, cells): cells of equal width from 0 Hz."""
        levels = np.unique(self.level)
        cells = 3 * 2 ** int(levels[-1])
        rows = [self.kurtosis[self.level == level] for level in levels]
        return levels, np.array([np.repeat(row, cells // row.size) for row in rows])


def fast_kurtogram(
    x: ArrayLike, *, rate_hz: float, levels: int | None = None, with_negentropy: bool = False
) -> Kurtogram:
    """Return the kurtosis over bands and bandwidths by a tree of filters [2]_.

    The mean is removed and the record made analytic; each band is then split into two, and into three, of half and of
    a third of its rate, twice what its width needs. A band is 0.85 dB down at its edges, 6 dB down 1.2 half widths off
    its middle and 80 dB down from 1.65 on. Outputs that would reach beyond the record are left out.

    Filters run in single precision, moments are summed in double: rounding adds a noise to each band that lies 130 dB
    below the record's power, and a kurtosis errs by less than 1e-4.

    Parameters
    ----------
    x : (n,) array
        Left as it is.
    rate_hz : float
    levels : int, optional
        Halvings; default 7, or as many as leave 320 samples to the narrowest band.
    with_negentropy : bool
        Add the negentropy of the squared envelope's spectrum [3]_.

    Raises
    ------
    ValueError
        A constant or short record, values that are not finite, or more levels than the record carries.
    """
    signal = _in_single_precision(_vibration(x, minimum=2 * FEWEST_SAMPLES))
    rate = positive(rate_hz, name="rate_hz")
    most = int(np.log2(signal.size / FEWEST_SAMPLES))
    depth = min(LEVELS, most) if levels is None else whole(levels, name="levels", least=1, most=most)
    rows = sorted(
        (level, index, width, *_figures(re, im, bands=_split_into(level), negentropy=with_negentropy))
        for level, index, width, re, im in _bands(signal, depth)
    )
    level, index, width, kurtosis, steady, std, power, negentropy, lines = (
        np.array(column, dtype=np.float64) for column in zip(*rows, strict=True)
    )
    share = power / power[0]
    empty = share < _LEAK
    return Kurtogram(
        level=level,
        low_hz=index * width * rate / 2,
        high_hz=(index + 1) * width * rate / 2,
        kurtosis=np.where(empty, np.nan, kurtosis),
        steady_kurtosis=np.where(empty, np.nan, steady),
        noise_std=std,
        power_share=share,
        envelope_negentropy=np.where(empty, np.nan, negentropy) if with_negentropy else None,
        envelope_lines=lines,
    )


def _vibration(x: ArrayLike, *, minimum: int) -> Samples:
    """Return a copy without its mean; ValueError where nothing but rounding is left."""
    signal = real_samples(x, name="the signal", minimum=minimum)
    centred = without_mean(signal)
    if _largest(centred) <= signal.size**0.5 * np.finfo(np.float64).eps * _largest(signal):
        raise ValueError(f"the signal is constant ({signal[0]:g}); kurtosis needs a vibration about the mean.")
    return centred


def _largest(x: Samples) -> float:
    return max(float(x.max()), -float(x.min()))


def _in_single_precision(x: Samples) -> Single:
    """Return the signal, which is lost, over its largest value: squares of squares neither over- nor underflow."""
    x /= x.dtype.type(_largest(x))
    return np.asarray(x, dtype=np.float32)


def _bands(signal: Single, depth: int) -> Iterator[tuple[float, int, float, Single, Single]]:
    """Yield level, index, width over half the rate, and complex envelope of each band of the tree."""
    from signals._kurtogram_kernels import split_band  # noqa: PLC0415

    waiting = [(0, 0, signal, _hilbert_transform(signal))]
    while waiting:  # depth first: a band and its halves are still in the cache
        level, index, re, im = waiting.pop()
        yield float(level), index, 0.5**level, re, im
        for factor in (3, 2) if level < depth - 1 else (2,) if level < depth else ():
            taps = _lowpass(factor)
            shape = (factor, (re.size - taps.size) // factor + 1)
            out_re, out_im = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)
            split_band(re, im, taps, factor, out_re, out_im)
            for b in range(factor):
                if factor == 2:  # noqa: PLR2004
                    waiting.append((level + 1, 2 * index + b, out_re[b], out_im[b]))
                else:
                    yield level + float(np.log2(3)), 3 * index + b, 0.5**level / 3, out_re[b], out_im[b]


def _hilbert_transform(signal: Single) -> Single:
    """Return the imaginary part of the analytic signal: every line turned back by a quarter."""
    size = fft.next_fast_len(signal.size, real=True)
    lines = fft.rfft(signal, size)
    lines *= -1j
    turned = np.asarray(fft.irfft(lines, size, overwrite_x=True)[: signal.size])
    forget_plans(size)
    return turned


@lru_cache(maxsize=2)
def _lowpass(factor: int) -> Single:
    """Kaiser-windowed sinc of gain 1, half as wide as one of `factor` bands and a fifth more."""
    count = _TAPS[factor]
    cutoff = _CUTOFF / factor
    place = np.arange(count) - (count - 1) / 2
    taps = np.sinc(2 * cutoff * place) * np.kaiser(count, _KAISER_BETA)
    return np.asarray(taps / taps.sum(), dtype=np.float32)


def _split_into(level: float) -> int:
    """Return how many bands the last filter made: 1, 2 or 3."""
    if level == 0:
        return 1
    return 3 if level % 1 > 0 else 2


@lru_cache(maxsize=3)
def _samples_per_independent(factor: int) -> float:
    """How many outputs of a filter the kurtosis of noise counts as one: ``sum |correlation|^4``, as for frames."""
    if factor == 1:
        return 4 / 3  # the analytic signal of white noise: 1 + 2 sum (2 / (pi k))^4 over odd k
    taps = _lowpass(factor).astype(np.float64)
    correlation = np.array([taps[s:] @ taps[: taps.size - s] for s in range(factor, taps.size, factor)]) / (taps @ taps)
    return float(1 + 2 * np.sum(correlation**4))


def _figures(
    re: Single, im: Single, *, bands: int, negentropy: bool
) -> tuple[float, float, float, float, float, float]:
    """Kurtosis, steady kurtosis, its scatter in noise, mean power, negentropy and number of lines of one band."""
    from signals._kurtogram_kernels import squared_envelope  # noqa: PLC0415

    seconds, fourths, squared = np.empty(PARTS), np.empty(PARTS), np.empty_like(re)
    squared_envelope(re, im, squared, seconds, fourths)
    count = re.size
    steady = np.argsort(fourths)[: PARTS - LEFT_OUT]
    std = 2 * np.sqrt(_samples_per_independent(bands) / count)
    found, lines = _negentropy(squared) if negentropy else (np.nan, 0)
    return (
        _kurtosis(seconds.sum(), fourths.sum(), count),
        _kurtosis(seconds[steady].sum(), fourths[steady].sum(), count * (1 - LEFT_OUT / PARTS)),
        float(std),
        float(seconds.sum() / count),
        found,
        float(lines),
    )


def _kurtosis(second: float, fourth: float, count: float) -> float:
    return float(fourth / second**2 * count - 2) if second > 0 else np.nan


def _negentropy(squared_envelope: Single) -> tuple[float, int]:
    """``<p ln p>`` of the squared envelope's spectrum, p the power over its smooth background, and the lines."""
    lines = fft.rfft(squared_envelope, fft.next_fast_len(squared_envelope.size, real=True))[_LOWEST_LINE:]
    forget_plans(squared_envelope.size)
    stretch = max(lines.size // _SMOOTHED, 1)
    lines = lines[: lines.size // stretch * stretch].reshape(-1, stretch)
    ratio = lines.real**2
    ratio += lines.imag**2
    mean = ratio.mean(axis=1, keepdims=True)
    ratio /= np.where(mean > 0, mean, 1)
    information = np.log(np.maximum(ratio, np.finfo(np.float32).tiny))
    information *= ratio
    return float(information.mean(dtype=np.float64)), int(ratio.size)
