"""The fast kurtogram, which locates the frequency bands in which a record is impulsive.

The kurtosis of a band's complex envelope c is ``<|c|^4> / <|c|^2>^2 - 2``: zero for stationary Gaussian noise, positive
for impulses, -1 for a pure tone (-s^2 for a tone with the fraction s of the band's power, the rest being noise).

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
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from signals._transforms import forget_plans, transform_of, without_mean
from signals._validation import Array, Samples, checked, positive, real_samples, whole

if TYPE_CHECKING:
    from collections.abc import Iterator

Single = NDArray[np.float32]

FEWEST_SAMPLES = 320  # of the narrowest band, whose filter has 48 taps
PARTS = 16  # of the record
NOISE_NEGENTROPY = 1 - np.euler_gamma  # of exponentially distributed powers, those of noise
NEGENTROPY_SCATTER = 0.53  # standard deviation times sqrt(lines) for such powers (measured)


@dataclass(frozen=True, kw_only=True)
class Kurtogram:
    """Kurtosis of the bands of a filter tree of repeated halving (whole levels), each also in thirds (log2(3) higher).

    Attributes
    ----------
    level, low_hz, high_hz : (band,) arrays
        Level of each band, and its edges in Hz; bands are sorted by level, then frequency.
    kurtosis : (band,) array
        Kurtosis of the complex envelope; NaN for a band without power.
    steady_kurtosis : (band,) array
        Kurtosis without the two sixteenths of the record of largest fourth moment, which removes the contribution of a
        single event but not that of repeated impulses.
    noise_std : (band,) array
        Standard deviation of the kurtosis for stationary Gaussian noise.
    power_share : (band,) array
        Fraction of the power of the record in the band.
    envelope_negentropy : (band,) array, optional
        ``<p ln p>`` over the squared envelope spectrum, where p is the power over its local mean: 1 - 0.577 for noise,
        larger for periodic impulses.
    envelope_lines : (band,) array
        Number of lines in that mean.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import fast_kurtogram
    >>> gram = fast_kurtogram(np.random.default_rng(1).standard_normal(8192), rate_hz=1000, levels=2)
    >>> gram.level.round(2).tolist()
    [0.0, 1.0, 1.0, 1.58, 1.58, 1.58, 2.0, 2.0, 2.0, 2.0]
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
        """Return the levels (rows,) and the kurtosis as an image (rows, cells), with cells of equal width from 0 Hz."""
        levels = np.unique(self.level)
        cells = 3 * 2 ** int(levels[-1])
        rows = [self.kurtosis[self.level == level] for level in levels]
        return levels, np.array([np.repeat(row, cells // row.size) for row in rows])


@checked
def fast_kurtogram(
    x: ArrayLike,
    *,
    rate_hz: float,
    levels: int | None = None,
    with_negentropy: bool = False,
    transform: NDArray[np.complexfloating] | None = None,
) -> Kurtogram:
    """Return the kurtosis over bands and bandwidths from a tree of filters (Antoni 2007).

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    levels : int, optional
        Number of halvings; default: 7, or as many as leave 320 samples in the narrowest band.
    with_negentropy : bool
        Whether to compute the negentropy of the squared envelope spectrum (Antoni 2016).
    transform : (n // 2 + 1,) array, optional
        Fourier transform of the record without its mean (`scipy.fft.rfft`), if known.

    Returns
    -------
    Kurtogram

    Raises
    ------
    ValueError
        A constant or short record, values that are not finite, or too many levels for the record.

    Notes
    -----
    The analytic signal is split into two bands at half its rate and into three at a third, with an oversampling of two;
    the halves are split again. The gain of a band is -0.85 dB at its edges, -6 dB at 1.2 half widths from its centre
    and below -80 dB beyond 1.65. Outputs whose filter extends beyond the record are left out.

    Filters run in single precision and moments are summed in double: rounding adds noise 130 dB below the power of the
    record to each band, and the error of the kurtosis is below 1e-4.

    Examples
    --------
    A resonance at 3 kHz excited by 50 impulses per second, in noise:

    >>> import numpy as np
    >>> from signals import fast_kurtogram
    >>> t = np.arange(20_000) / 20_000
    >>> ring = np.exp(-1500 * (t % 0.02)) * np.sin(2 * np.pi * 3000 * (t % 0.02))
    >>> x = ring + 0.05 * np.random.default_rng(1).standard_normal(t.size)
    >>> gram = fast_kurtogram(x, rate_hz=20_000, levels=4)
    >>> best = np.argmax(gram.kurtosis)
    >>> bool(gram.low_hz[best] <= 3000 <= gram.high_hz[best])
    True
    """
    vibration = _vibration(x, minimum=2 * FEWEST_SAMPLES)
    largest = _largest(vibration)
    vibration /= vibration.dtype.type(largest)  # so that fourth powers stay in the range of single precision
    signal = np.asarray(vibration, dtype=np.float32)
    known = None if transform is None else transform_of(signal, transform)
    rate = positive(rate_hz, name="rate_hz")
    most = int(np.log2(signal.size / FEWEST_SAMPLES))
    depth = min(7, most) if levels is None else whole(levels, name="levels", least=1, most=most)
    rows = sorted(
        (
            (level, index, width, re.size, *_moments(re, im, negentropy=with_negentropy))
            for level, index, width, re, im in _bands(signal, _hilbert_transform(signal, largest, known), depth)
        ),
        key=itemgetter(0, 1),
    )
    *columns, seconds, fourths, negentropy, lines = zip(*rows, strict=True)
    level, index, width, count = (np.array(column, dtype=np.float64) for column in columns)
    second, fourth = np.array(seconds), np.array(fourths)  # (band, part)
    left_out = 2  # parts of largest fourth moment excluded from the steady kurtosis: a spike may lie on a border
    quiet = np.argsort(fourth, axis=1)[:, : PARTS - left_out]
    least, of_least = (np.take_along_axis(each, quiet, axis=1).sum(axis=1) for each in (second, fourth))
    kurtosis = _kurtosis(second.sum(axis=1), fourth.sum(axis=1), count)
    steady = _kurtosis(least, of_least, count * (1 - left_out / PARTS))
    power = second.sum(axis=1) / count
    last_filter = np.where(level == 0, 1, np.where(level % 1 > 0, 3, 2)).tolist()  # number of bands it splits into
    std = 2 * np.sqrt(np.array([_samples_per_independent(factor) for factor in last_filter]) / count)
    share = power / power[0]
    leakage = 1e-7  # of the power of the record; a band with less holds only leakage from others
    empty = share < leakage
    return Kurtogram(
        level=level,
        low_hz=index * width * rate / 2,
        high_hz=(index + 1) * width * rate / 2,
        kurtosis=np.where(empty, np.nan, kurtosis),
        steady_kurtosis=np.where(empty, np.nan, steady),
        noise_std=std,
        power_share=share,
        envelope_negentropy=np.where(empty, np.nan, np.array(negentropy)) if with_negentropy else None,
        envelope_lines=np.array(lines, dtype=np.float64),
    )


def _vibration(x: ArrayLike, *, minimum: int) -> Samples:
    """Return a copy of the signal without its mean, or raise ValueError if only rounding error remains."""
    signal = real_samples(x, name="the signal", minimum=minimum)
    centred = without_mean(signal)
    if _largest(centred) <= signal.size**0.5 * np.finfo(np.float64).eps * _largest(signal):
        raise ValueError(f"the signal is constant ({signal[0]:g}); kurtosis needs a vibration about the mean.")
    return centred


def _largest(x: Samples) -> float:
    return max(float(x.max()), -float(x.min()))


def _bands(signal: Single, imaginary: Single, depth: int) -> Iterator[tuple[float, int, float, Single, Single]]:
    """Yield level, index, width over half the rate, and complex envelope of each band of the tree.

    The bands of a level share memory, since allocation is slow: each must be used before the next is requested.
    """
    from signals.demodulation._kurtogram_kernels import split_band  # noqa: PLC0415

    memory: dict[tuple[int, int], tuple[Single, Single]] = {}
    waiting = [(0, 0, signal, imaginary)]
    while waiting:  # depth first, so that a band is still cached when it is split
        level, index, re, im = waiting.pop()
        yield float(level), index, 0.5**level, re, im
        for factor in (3, 2) if level < depth - 1 else (2,) if level < depth else ():
            taps = _lowpass(factor)
            shape = (factor, (re.size - taps.size) // factor + 1)
            if (level, factor) not in memory:
                memory[level, factor] = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)
            out_re, out_im = memory[level, factor]
            split_band(re, im, taps, factor, out_re, out_im)
            for b in range(factor):
                if factor == 2:  # noqa: PLR2004
                    waiting.append((level + 1, 2 * index + b, out_re[b], out_im[b]))
                else:
                    yield level + float(np.log2(3)), 3 * index + b, 0.5**level / 3, out_re[b], out_im[b]


def _hilbert_transform(signal: Single, largest: float, known: NDArray[np.complexfloating] | None) -> Single:
    """Return the Hilbert transform, the imaginary part of the analytic signal.

    The `known` transform of the signal times `largest` is used if its length is a fast one.
    """
    size = fft.next_fast_len(signal.size, real=True)
    if known is not None and size == signal.size:
        lines = np.empty(known.size, dtype=np.complex64)
        np.multiply(known, -1j / largest, out=lines, casting="same_kind")
    else:
        lines = np.asarray(fft.rfft(signal, size))
        lines *= -1j
    transform = np.asarray(fft.irfft(lines, size, overwrite_x=True)[: signal.size])
    forget_plans(size)
    return transform


@lru_cache(maxsize=2)
def _lowpass(factor: int) -> Single:
    """Return a Kaiser-windowed sinc of gain 1, with its -6 dB cut-off at 1.2 half widths of one of `factor` bands."""
    count = 24 * factor
    cutoff = 0.3 / factor
    offset = np.arange(count) - (count - 1) / 2
    taps = np.sinc(2 * cutoff * offset) * np.kaiser(count, 8.0)
    return np.asarray(taps / taps.sum(), dtype=np.float32)


@lru_cache(maxsize=3)
def _samples_per_independent(factor: int) -> float:
    """Return ``sum |correlation|^4`` over lags, the outputs per independent output for the variance of the kurtosis."""
    if factor == 1:
        return 4 / 3  # the analytic signal of white noise: 1 + 2 sum (2 / (pi k))^4 over odd k
    taps = _lowpass(factor).astype(np.float64)
    correlation = np.array([taps[s:] @ taps[: taps.size - s] for s in range(factor, taps.size, factor)]) / (taps @ taps)
    return float(1 + 2 * np.sum(correlation**4))


def _moments(re: Single, im: Single, *, negentropy: bool) -> tuple[Array, Array, float, int]:
    """Return the sums of second and fourth powers of an envelope by part, its negentropy and the number of lines."""
    from signals.demodulation._kurtogram_kernels import squared_envelope  # noqa: PLC0415

    seconds, fourths, squared = np.empty(PARTS), np.empty(PARTS), np.empty(re.size * negentropy, dtype=re.dtype)
    squared_envelope(re, im, squared, seconds, fourths)
    return seconds, fourths, *(_negentropy(squared) if negentropy else (np.nan, 0))


def _kurtosis(second: Array, fourth: Array, count: Array) -> Array:
    """Return the kurtosis of each band from its sums of second and fourth powers over `count` samples."""
    ratio = np.divide(fourth, second**2, out=np.full(second.size, np.nan), where=second > 0)
    return np.asarray(ratio * count - 2)


def _negentropy(squared_envelope: Single) -> tuple[float, int]:
    """Return ``<p ln p>`` of the squared envelope spectrum, p the power over its local mean, and the line count."""
    # fewer than four cycles per record are drift
    lines = fft.rfft(squared_envelope, fft.next_fast_len(squared_envelope.size, real=True))[4:]
    forget_plans(squared_envelope.size)
    length = max(lines.size // 32, 1)  # 32 sections of the spectrum, each normalised by its mean
    lines = lines[: lines.size // length * length].reshape(-1, length)
    ratio = lines.real**2
    ratio += lines.imag**2
    mean = ratio.mean(axis=1, keepdims=True)
    ratio /= np.where(mean > 0, mean, 1)
    information = np.log(np.maximum(ratio, np.finfo(np.float32).tiny))
    information *= ratio
    return float(information.mean(dtype=np.float64)), int(ratio.size)
