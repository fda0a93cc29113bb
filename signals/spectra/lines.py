"""Detection of a spectral line near an expected order: position, amplitude, noise and false-alarm probability.

The power spectrum of noise alone is exponentially distributed with its local mean. Its maximum within a searched band
of W bins exceeds u times that mean with probability

    1 - exp(-[exp(-u) + W sqrt(m u / pi) exp(-u)]),   m = (2 pi)^2 spread,

the second term being the rate of upward level crossings of the envelope of a Gaussian process (Rice 1945,
eq. 3.8-15), here along frequency, with `spread` the second moment of the squared window. The local mean is itself
estimated, from the median of the background; that estimate is taken as Gamma distributed with K degrees of freedom,
and both terms are averaged over it in closed form, which raises the probability for short records.

The window spreads a strong line into a main lobe and side lobes, which may be the maximum of an adjacent searched band.
Each line is therefore reported with the largest leakage from larger lines nearby.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy import fft

from signals._transforms import window_of
from signals._validation import Array, checked, positive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from signals.spectra.spectra import AmplitudeSpectrum

BACKGROUND_WIDTH = 1.0  # on either side, in the unit of the axis (orders)
_LOBE_BINS = 3.0  # left out on either side of the line
# measured: the median power of Hann- or box-windowed noise has the variance of the mean of this many independent bins,
# per bin and equivalent noise bandwidth
_MEDIAN_EFFICIENCY = 0.52
_FEWEST_BINS = 8
_REACH_BINS = 400  # beyond this a Hann side lobe lies 150 dB below its line

Places: TypeAlias = "NDArray[np.intp]"


@dataclass(frozen=True, kw_only=True)
class Line:
    """The largest line of a spectrum within a searched band.

    Attributes
    ----------
    expected, found : float
        Expected and found position, in the unit of the axis.
    amplitude : float
        Peak amplitude.
    amplitude_std : float
        Standard deviation, due to noise, of the real part of the complex amplitude, and of its imaginary part.
    background : float
        Median amplitude of the background.
    leakage : float
        Largest amplitude that the window spreads to this position from a larger line.
    false_alarm_probability : float
        Probability that noise alone has a maximum this large in the searched band.
    at_edge : bool
        Whether the spectrum still rises at the edge of the searched band, so that no peak lies within it.
    noise : float
        Median noise amplitude on which the probability is based.
    noise_degrees, width_bins, spread : float
        Independent bins in that median, width of the searched band in bins, and `AmplitudeSpectrum.spread`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import amplitude_spectrum, find_line
    >>> x = np.random.default_rng(1).standard_normal(2048)
    >>> line = find_line(amplitude_spectrum(x, rate=64), expected=10.0)
    >>> line.snr < 5 and line.false_alarm_probability > 0.001
    True
    """

    expected: float
    found: float
    amplitude: float
    amplitude_std: float
    background: float
    leakage: float
    false_alarm_probability: float
    at_edge: bool = False
    noise: float = 0.0
    noise_degrees: float = 1e9
    width_bins: float = 0.0
    spread: float = 0.0

    def amplitude_at(self, probability: float) -> float:
        """Return the amplitude that noise alone reaches in the searched band with a given probability.

        It is the smallest amplitude distinguishable from this noise, and larger in short records, whose noise is
        estimated from few bins, than in long ones.

        Parameters
        ----------
        probability : float
            Above 0, at most 1.

        Raises
        ------
        ValueError
            A probability that is not above 0 and at most 1.

        Examples
        --------
        At a single frequency, in noise of known median m, it is ``m sqrt(-log2(p))``:

        >>> from signals import Line
        >>> place = dict(expected=5.0, found=5.0, amplitude=1.0, amplitude_std=0.1, background=0.1, leakage=0.0)
        >>> round(Line(**place, false_alarm_probability=0.5, noise=0.1, noise_degrees=1e9).amplitude_at(2**-16), 4)
        0.4
        """
        if not 0 < probability <= 1:
            raise ValueError(f"probability={probability!r} must be above 0 and at most 1.")
        low, high = 0.0, 1.0

        def chance(power_ratio: float) -> float:
            return false_alarm_probability(
                power_ratio, width_bins=self.width_bins, spread=self.spread, background_degrees=self.noise_degrees
            )

        while chance(high) > probability:
            low, high = high, 2 * high
        for _ in range(30):  # bisection to 1e-9 of the range of power ratios
            middle = (low + high) / 2
            low, high = (low, middle) if chance(middle) <= probability else (middle, high)
        return self.noise * math.sqrt(high / math.log(2))

    @property
    def snr(self) -> float:
        """Ratio of the amplitude to the median amplitude of the background."""
        if self.background > 0:
            return self.amplitude / self.background
        return math.inf if self.amplitude > 0 else 0.0


@checked
def find_line(
    spectrum: AmplitudeSpectrum,
    *,
    expected: float,
    tolerance: float = 0.0,
    background_width: float = BACKGROUND_WIDTH,
    closer: float | None = None,
) -> Line:
    """Return the largest line within ``expected +- tolerance``, with its false-alarm probability.

    Parameters
    ----------
    spectrum : AmplitudeSpectrum
        Over orders or frequency.
    expected : float
        Expected position, in the unit of the axis.
    tolerance : float
        Half the width of the searched band, which is at least one bin wide.
    background_width : float
        Width of the background on either side, from which the noise is estimated, in the unit of the axis.
    closer : float, optional
        A second, smaller width. The wide median underestimates noise close to strong lines, such as that due to
        tachometer jitter; where the median over the smaller width is larger, the false-alarm probability is based on
        it.

    Returns
    -------
    Line
        ``false_alarm_probability`` applies to this one search; for L searches together use `record_probability`.

    Raises
    ------
    ValueError
        A line beyond the end of the spectrum, a negative tolerance, or fewer than eight bins of background.

    Examples
    --------
    A tone of order 10 and amplitude 2 in weak noise:

    >>> import numpy as np
    >>> from signals import amplitude_spectrum, find_line
    >>> turns = np.arange(2048) / 64
    >>> x = 2 * np.cos(2 * np.pi * 10 * turns) + 0.1 * np.random.default_rng(1).standard_normal(2048)
    >>> line = find_line(amplitude_spectrum(x, rate=64), expected=10.02, tolerance=0.1)
    >>> round(line.found, 2), round(line.amplitude, 1), line.false_alarm_probability < 1e-6
    (10.0, 2.0, True)
    """
    expected = positive(expected, name="expected")
    if not 0 <= tolerance < math.inf:
        raise ValueError(f"tolerance={tolerance!r} must be finite and not negative.")
    near = math.nan if closer is None else closer
    (found,) = find_lines(
        spectrum, expected=[expected], tolerance=[tolerance], background_width=background_width, closer=[near]
    )
    if isinstance(found, ValueError):
        raise found
    return found


def find_lines(
    spectrum: AmplitudeSpectrum,
    *,
    expected: Sequence[float],
    tolerance: Sequence[float],
    closer: Sequence[float],
    background_width: float = BACKGROUND_WIDTH,
    seen: float = 1.0,
) -> list[Line | ValueError]:
    """Return the result of `find_line` for several lines of one spectrum, with an error in place of each it refuses.

    Parameters
    ----------
    spectrum, background_width
        As in `find_line`.
    expected, tolerance, closer : sequences of float
        As in `find_line`, for each line; `closer` is NaN where there is none.
    seen : float
        False-alarm probability above which the `leakage` of a line is not computed but NaN.

    Returns
    -------
    list of Line or ValueError

    Examples
    --------
    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.spectra.lines import find_lines
    >>> x = np.cos(2 * np.pi * 10 * np.arange(2048) / 64) + 0.1 * np.random.default_rng(1).standard_normal(2048)
    >>> spectrum = amplitude_spectrum(x, rate=64)
    >>> lines = find_lines(spectrum, expected=[10.0, 99.0], tolerance=[0.0, 0.0], closer=[np.nan, np.nan])
    >>> round(lines[0].amplitude, 1), str(lines[1])
    (1.0, 'a line at 99 +- 0.015625 lies beyond the end of the spectrum at 32; give a spectrum that extends further.')
    """
    axis, bin_width = spectrum.axis, spectrum.bin_width
    background_width = positive(background_width, name="background_width")
    orders = np.asarray(expected, dtype=np.float64)
    half = np.maximum(tolerance, bin_width / 2)
    inside = orders + half <= axis[-1]
    places = np.flatnonzero(inside)
    peaks = _peaks(axis, spectrum.amplitude, (orders - half)[inside], (orders + half)[inside])
    lobe = _lobe(spectrum, peaks[0])
    reaches = np.asarray(closer, dtype=np.float64)[inside]
    wide = _adjacent_points(spectrum, peaks[0], np.full(places.size, background_width), lobe)
    close = _adjacent_points(spectrum, peaks[0], reaches, lobe)
    found: list[Line | ValueError] = [
        ValueError(
            f"a line at {order:g} +- {reach:g} lies beyond the end of the spectrum at {axis[-1]:g}; give a spectrum "
            "that extends further."
        )
        for order, reach in zip(orders.tolist(), half.tolist(), strict=True)
    ]
    columns = (orders[inside], half[inside], *peaks, np.isfinite(reaches))
    rows = zip(*(each.tolist() for each in columns), strict=True)
    for place, row, far, near in zip(places.tolist(), rows, wide, close, strict=True):
        found[place] = _line(spectrum, row, far, near, seen)
    return found


def has_background(bin_width: float, *, background_width: float = BACKGROUND_WIDTH) -> bool:
    """Return whether a spectrum can have enough bins around a line; if False, `find_lines` refuses every line.

    Parameters
    ----------
    bin_width : float
        `AmplitudeSpectrum.bin_width`.
    background_width : float
        As in `find_line`, in the same unit.

    Examples
    --------
    >>> from signals.spectra.lines import has_background
    >>> has_background(1 / 2), has_background(1 / 20)  # records of 2 and of 20 revolutions
    (False, True)
    """
    # one more point on either side, at most a bin wide, may lie within the background
    return 2 * (background_width / bin_width - _LOBE_BINS + 1) >= _FEWEST_BINS


def _line(
    spectrum: AmplitudeSpectrum,
    place: tuple[float, float, float, float, bool, bool],
    wide: tuple[int, int, int, int],
    close: tuple[int, int, int, int],
    seen: float,
) -> Line | ValueError:
    """Return a line from its peak and its background points: first and last, below and above, wide and close.

    `place` holds the expected order, half the searched band, the peak, and whether `closer` is given.
    """
    expected, half, found, amplitude, at_edge, has_closer = place
    points, bin_width = spectrum.amplitude, spectrum.bin_width
    first, last, begin, end = wide
    background, noise, count = _medians(np.concatenate((points[first:last], points[begin:end])))
    per_point = float(spectrum.axis[1] - spectrum.axis[0]) / bin_width
    bins = count * per_point
    if bins < _FEWEST_BINS:
        return ValueError(
            f"only {bins:.1f} bins of background surround the line at {expected:g}, where {_FEWEST_BINS} are needed; "
            "the record is too short."
        )
    used_bins, std = bins, noise / math.sqrt(2 * math.log(2))
    if has_closer:
        first, last, begin, end = close
        below, above = points[first:last], points[begin:end]
        size = below.size + above.size
        least = _significant(noise, size * per_point, spectrum)  # fewer bins, without lines, scatter more
        if 2 * (np.count_nonzero(below <= least) + np.count_nonzero(above <= least)) <= size:  # the median is above
            _, near, count = _medians(np.concatenate((below, above)))
            close_bins = count * per_point
            if close_bins >= _FEWEST_BINS and near > _significant(noise, close_bins, spectrum):
                noise, used_bins = near, close_bins
    degrees, width_bins = _MEDIAN_EFFICIENCY * used_bins / spectrum.noise_bandwidth_bins, 2 * half / bin_width
    probability = 0.0 if amplitude > 0 else 1.0
    if noise > 0:
        probability = false_alarm_probability(
            (amplitude / noise) ** 2 * math.log(2),
            width_bins=width_bins,
            spread=spectrum.spread,
            background_degrees=degrees,
        )
    return Line(
        expected=expected,
        found=found,
        amplitude=amplitude,
        amplitude_std=std,
        background=background,
        leakage=_leakage(spectrum, found, amplitude) if probability <= seen else math.nan,
        false_alarm_probability=probability,
        at_edge=at_edge,
        noise=noise,
        noise_degrees=degrees,
        width_bins=width_bins,
        spread=spectrum.spread,
    )


def _lobe(spectrum: AmplitudeSpectrum, found: Array) -> tuple[Places, Places]:
    """Return the first point of each line's main lobe, and the first one above it."""
    lobe, axis = _LOBE_BINS * spectrum.bin_width, spectrum.axis
    ends = []
    for side, beyond in ((-lobe, (1, 0, -1)), (lobe, (0, 1, 2))):
        # whether a point at the edge belongs to the lobe is decided by its rounded distance
        near = np.clip(axis.searchsorted(found + side)[:, None] - np.array(beyond), 0, axis.size - 1)
        inside = np.abs(axis[near] - found[:, None]) <= lobe
        ends.append(near[np.arange(found.size), inside.argmax(axis=1)])
    return ends[0], ends[1] + 1


def _adjacent_points(
    spectrum: AmplitudeSpectrum, found: Array, reach: Array, lobe: tuple[Places, Places]
) -> list[tuple[int, int, int, int]]:
    """Return the first and last points, up to `reach` below and above each line, without its main lobe."""
    least = np.maximum(found - reach, _LOBE_BINS * spectrum.bin_width)
    first, last = (spectrum.axis.searchsorted(ends) for ends in (least, found + reach))
    columns = (first, lobe[0], np.maximum(lobe[1], first), last)
    return list(zip(*(each.tolist() for each in columns), strict=True))


def _significant(noise: float, bins: float, spectrum: AmplitudeSpectrum) -> float:
    """Return the median amplitude of so many bins that is significantly above `noise`."""
    scatter = 1 / math.sqrt(_MEDIAN_EFFICIENCY * max(bins, 1) / spectrum.noise_bandwidth_bins)
    # 3.0 standard deviations: in flat noise the closer background exceeds them for about one line in several hundred
    return math.sqrt(1 + 3.0 * scatter) * noise


def _medians(values: Array) -> tuple[float, float, int]:
    """Return the median, the median of the values up to 4 times that, and their number; reorder the values.

    Noise exceeds four times its median amplitude once in 65,000 points (2^-16). Larger points are taken for lines,
    which would raise the median and mask weak lines nearby. Values left out are above the median, so that the second
    median lies in the lower half.
    """
    if not values.size:
        return 0.0, 0.0, 0
    half = values.size // 2
    values.partition(half)
    lower = values[: half + 1]
    median = _largest_mean(lower, values.size)
    count = half + 1 + int(np.count_nonzero(values[half + 1 :] <= 4.0 * median))
    if count == values.size:
        return median, median, count
    lower.partition(count // 2)
    return median, _largest_mean(lower[: count // 2 + 1], count), count


def _largest_mean(lower: Array, count: int) -> float:
    """Return the median of `count` values from their lowest ``count // 2 + 1``, the largest of which is last."""
    return float(lower[-1]) if count % 2 else float((lower[:-1].max() + lower[-1]) / 2)


def _leakage(spectrum: AmplitudeSpectrum, found: float, amplitude: float) -> float:
    """Return the largest leakage from any larger point of the spectrum to `found`."""
    axis = spectrum.axis
    reach = _REACH_BINS * spectrum.bin_width
    first, last = axis.searchsorted([found - reach, found + reach])
    around = spectrum.amplitude[first:last]
    # 2.0 is the smallest amplitude relative to the line from which leakage is considered
    larger = around > 2.0 * amplitude
    if not larger.any():
        return 0.0
    distance = np.abs(axis[first:last][larger] - found) / spectrum.bin_width
    bins, height = _lobes(spectrum.window)
    return float(np.max(around[larger] * np.interp(distance, bins, height)))


@lru_cache(maxsize=8)
def _lobes(window: str) -> tuple[Array, Array]:
    """Return distances in bins, and the largest relative magnitude of the window's transform beyond each."""
    length, fine = 4 * _REACH_BINS, 8
    transform = np.abs(fft.rfft(window_of(window, length).weights, length * fine))[: _REACH_BINS * fine + 1]
    envelope = np.maximum.accumulate(transform[::-1])[::-1] / transform[0]
    return np.arange(envelope.size) / fine, np.asarray(envelope, dtype=np.float64)


def false_alarm_probability(
    power_ratio: float, *, width_bins: float, spread: float, background_degrees: float
) -> float:
    """Return the probability that noise alone reaches `power_ratio` times its estimated mean in a searched band.

    Parameters
    ----------
    power_ratio : float
        Power of the line over the estimated mean power of the noise.
    width_bins : float
        Width of the searched band in bins.
    spread : float
        `AmplitudeSpectrum.spread`.
    background_degrees : float
        K, the number of independent bins in the estimate of the mean.

    Examples
    --------
    At a single frequency and with a known mean it is ``1 - exp(-exp(-u))``:

    >>> from signals.spectra.lines import false_alarm_probability
    >>> round(false_alarm_probability(3.0, width_bins=0.0, spread=0.0, background_degrees=1e9), 6)
    0.048568
    """
    u, degrees = power_ratio, background_degrees
    shrink = math.log1p(u / degrees)
    at_edge = math.exp(-degrees * shrink)
    rate = 2 * math.pi * math.sqrt(spread * u / math.pi)
    half_moment = math.exp(math.lgamma(degrees + 0.5) - math.lgamma(degrees)) / math.sqrt(degrees)
    crossings = width_bins * rate * half_moment * math.exp(-(degrees + 0.5) * shrink)
    return -math.expm1(-(at_edge + crossings))


def record_probability(single: float, *, searches: int) -> float:
    """Return the false-alarm probability of `searches` independent searches, each with probability `single`."""
    return -math.expm1(searches * math.log1p(-single)) if single < 1 else 1.0


def _peaks(axis: Array, amplitude: Array, low: Array, high: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return position and height of the maximum in each band, by parabolic interpolation where it is a local maximum.

    The third array is true where it is not: a neighbour outside the band is larger.
    """
    first, last = axis.searchsorted(low), axis.searchsorted(high)
    last = np.maximum(last, first + 1)
    tops = [a + int(amplitude[a:b].argmax()) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
    top = np.array(tops, dtype=np.intp)
    left, middle, right = (amplitude[np.clip(top + side, 0, axis.size - 1)] for side in (-1, 0, 1))
    curvature = left - 2 * middle + right
    at_edge = middle < np.maximum(left, right)
    local = (top > 0) & (top < axis.size - 1) & ~at_edge & (curvature < 0)
    shift = np.divide(0.5 * (left - right), curvature, out=np.zeros(top.size), where=local)
    return axis[top] + shift * (axis[1] - axis[0]), middle - 0.25 * (left - right) * shift, at_edge
