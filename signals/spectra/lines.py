"""Detection of a spectral line near an expected order: position, amplitude, noise and false-alarm probability.

The power spectrum of noise alone is exponentially distributed about its local mean. Its maximum within a searched band
of W bins exceeds u times that mean with probability

    1 - exp(-[exp(-u) + W sqrt(m u / pi) exp(-u)]),   m = (2 pi)^2 spread,

the second term being the rate of upward level crossings of the envelope of a Gaussian process (Rice 1945,
eq. 3.8-15), here along frequency, with `spread` the second moment of the squared window. The local mean is itself
estimated, from the median of the surroundings; that estimate is taken as Gamma distributed with K degrees of freedom,
and both terms are averaged over it in closed form, which raises the probability for short records.

The window spreads a strong line into main lobe and side lobes, which may be the maximum of a searched band beside it.
The largest leakage of the larger lines around is therefore given with each line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy import fft

from signals._validation import Array, checked, positive
from signals._windows import window_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from signals.spectra.spectra import AmplitudeSpectrum

SURROUNDINGS = 1.0  # on either side, in the axis' unit (orders)
_LOBE_BINS = 3.0  # left out on either side of the line
_REACH_BINS, _FINE = 400, 8  # beyond this a Hann side lobe lies 150 dB below its line; points of its table in a bin
_HALVINGS = 30  # of the power ratio's range: to 1e-9 of it
_LARGER = 2.0  # least ratio of a neighbour's amplitude to the line's for its leakage to be considered

Places: TypeAlias = "NDArray[np.int64]"


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
        Standard deviation of the real part of the complex amplitude due to noise, equally of its imaginary part.
    background : float
        Median amplitude of the surroundings.
    leakage : float
        Largest amplitude that the window spreads to this position from a larger line.
    false_alarm_probability : float
        Probability that noise alone has as large a maximum in the searched band.
    at_edge : bool
        Whether the spectrum still rises at the edge of the searched band: then no peak lies in it.
    noise : float
        Median amplitude of noise to which the probability refers.
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
        """Return the amplitude that noise alone reaches in the searched band with a probability.

        A line had to be as large to be told from this noise: in short records, whose noise is known from few bins,
        larger than in long ones.

        Parameters
        ----------
        probability : float
            Above 0, at most 1.

        Examples
        --------
        At a single frequency in noise of known median m it is ``m sqrt(-log2(p))``:

        >>> from signals import Line
        >>> place = dict(expected=5.0, found=5.0, amplitude=1.0, amplitude_std=0.1, background=0.1, leakage=0.0)
        >>> round(Line(**place, false_alarm_probability=0.5, noise=0.1, noise_degrees=1e9).amplitude_at(2**-16), 4)
        0.4
        """
        low, high = 0.0, 1.0

        def chance(power_ratio: float) -> float:
            return false_alarm_probability(
                power_ratio, width_bins=self.width_bins, spread=self.spread, background_degrees=self.noise_degrees
            )

        while chance(high) > probability:
            low, high = high, 2 * high
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if chance(middle) <= probability else (middle, high)
        return self.noise * math.sqrt(high / math.log(2))

    @property
    def snr(self) -> float:
        """Ratio of the amplitude to the median amplitude of the surroundings."""
        if self.background > 0:
            return self.amplitude / self.background
        return math.inf if self.amplitude > 0 else 0.0


@checked
def find_line(
    spectrum: AmplitudeSpectrum,
    *,
    expected: float,
    tolerance: float = 0.0,
    surroundings: float = SURROUNDINGS,
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
    surroundings : float
        Width of the surroundings on either side, from which the noise is estimated.
    closer : float, optional
        A second, smaller width. Noise about strong lines, as tachometer jitter causes it, is underestimated by the
        wide median; where the close one is larger the false-alarm probability is computed from it.

    Returns
    -------
    Line
        ``false_alarm_probability`` is for this one search; for L searches at once use `record_probability`.

    Raises
    ------
    ValueError
        A line beyond the end of the spectrum, or fewer than eight bins of surroundings.

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
    expected = positive(expected, name="the expected order")
    if not 0 <= tolerance < math.inf:
        raise ValueError(f"tolerance = {tolerance!r} must be a finite number of at least 0.")
    near = math.nan if closer is None else closer
    (found,) = find_lines(
        spectrum, expected=[expected], tolerance=[tolerance], surroundings=surroundings, closer=[near]
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
    surroundings: float = SURROUNDINGS,
    seen: float = 1.0,
) -> list[Line | ValueError]:
    """Return what `find_line` does of each of several lines of one spectrum, with an error in place of one it refuses.

    Parameters
    ----------
    spectrum, surroundings
        As in `find_line`.
    expected, tolerance, closer : sequences of float
        As in `find_line`, of each line; `closer` is NaN where there is none.
    seen : float
        Probability from which on a line is noise whose `leakage` nothing reads: it is NaN.

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
    (1.0, 'a line at 99 +- 0.015625 lies beyond the end of the spectrum, 32.')
    """
    from signals.spectra._line_kernels import FEWEST_BINS, weigh  # noqa: PLC0415 - loads numba

    axis, bin_width = spectrum.axis, spectrum.bin_width
    surroundings = positive(surroundings, name="surroundings")
    orders = np.asarray(expected, dtype=np.float64)
    half = np.maximum(tolerance, bin_width / 2)
    inside = orders + half <= axis[-1]
    places = np.flatnonzero(inside)
    position, amplitude, at_edge = _peaks(axis, spectrum.amplitude, (orders - half)[inside], (orders + half)[inside])
    lobe = _lobe(spectrum, position)
    wide = _beside(spectrum, position, np.full(places.size, surroundings), lobe)
    close = _beside(spectrum, position, np.asarray(closer, dtype=np.float64)[inside], lobe)
    lines = np.zeros((places.size, 8))
    lines[:, 0], lines[:, 1] = amplitude, 2 * half[inside] / bin_width
    per_point = float(axis[1] - axis[0]) / bin_width
    weigh(spectrum.amplitude, wide, close, per_point, spectrum.noise_bandwidth_bins, spectrum.spread, lines)
    leaks = _leakage(spectrum, position, amplitude, lines[:, 7] <= seen)
    found: list[Line | ValueError | None] = [None] * orders.size
    rows = (position.tolist(), at_edge.tolist(), leaks.tolist(), lines.tolist())
    for place, at, edge, leak, (top, width, background, quiet, bins, noise, degrees, probability) in zip(
        places.tolist(), *rows, strict=True
    ):
        if bins < FEWEST_BINS:
            found[place] = ValueError(
                f"only {bins:.1f} bins surround the line at {orders[place]:g}, too few to judge it; the record is too "
                "short."
            )
            continue
        found[place] = Line(
            expected=float(orders[place]),
            found=at,
            amplitude=top,
            amplitude_std=quiet / math.sqrt(2 * math.log(2)),
            background=background,
            leakage=leak,
            false_alarm_probability=probability,
            at_edge=edge,
            noise=noise,
            noise_degrees=degrees,
            width_bins=width,
            spread=spectrum.spread,
        )
    return [_beyond(spectrum, float(orders[n]), float(half[n])) if one is None else one for n, one in enumerate(found)]


def _beyond(spectrum: AmplitudeSpectrum, order: float, half: float) -> ValueError:
    return ValueError(f"a line at {order:g} +- {half:g} lies beyond the end of the spectrum, {spectrum.axis[-1]:g}.")


def _lobe(spectrum: AmplitudeSpectrum, found: Array) -> tuple[Places, Places]:
    """Return the first point of each line's main lobe, and the first one above it."""
    lobe, axis = _LOBE_BINS * spectrum.bin_width, spectrum.axis
    ends = []
    for side, beyond in ((-lobe, (1, 0, -1)), (lobe, (0, 1, 2))):
        # a point at the edge of the lobe is in or out by its difference
        near = np.clip(axis.searchsorted(found + side)[:, None] - np.array(beyond), 0, axis.size - 1)
        inside = np.abs(axis[near] - found[:, None]) <= lobe
        ends.append(near[np.arange(found.size), inside.argmax(axis=1)])
    return ends[0], ends[1] + 1


def _beside(spectrum: AmplitudeSpectrum, found: Array, reach: Array, lobe: tuple[Places, Places]) -> Places:
    """Return the points up to `reach` below and above each line, without its main lobe: (line, 4) first and last.

    None where the reach is NaN.
    """
    least = np.maximum(found - reach, _LOBE_BINS * spectrum.bin_width)
    first, last = (spectrum.axis.searchsorted(ends) for ends in (least, found + reach))
    windows = np.stack([first, np.maximum(lobe[0], first), np.maximum(lobe[1], first), last], axis=1)
    windows[:, 3] = np.maximum(windows[:, 3], windows[:, 2])
    windows[np.isnan(reach)] = 0
    return windows


def _leakage(spectrum: AmplitudeSpectrum, found: Array, amplitude: Array, seen: NDArray[np.bool_]) -> Array:
    """Return the largest leakage of any larger point of the spectrum to each line; NaN for those that are not seen."""
    from signals.spectra._line_kernels import leakage  # noqa: PLC0415

    axis, leaks = spectrum.axis, np.full(found.size, np.nan)
    reach = _REACH_BINS * spectrum.bin_width
    first, last = axis.searchsorted(found - reach), axis.searchsorted(found + reach)
    heights, step = _lobes(spectrum.window), float(axis[1] - axis[0])
    for n in np.flatnonzero(seen).tolist():
        place, least = (found[n] - axis[0]) / step, _LARGER * amplitude[n]
        leaks[n] = leakage(
            spectrum.amplitude, place, first[n], last[n], least, heights, _FINE * step / spectrum.bin_width
        )
    return leaks


@lru_cache(maxsize=8)
def _lobes(window: str) -> Array:
    """Return the largest relative magnitude of the window's transform beyond each `_FINE`-th of a bin."""
    length = 4 * _REACH_BINS
    transform = np.abs(fft.rfft(window_of(window, length).weights, length * _FINE))[: _REACH_BINS * _FINE + 1]
    return np.asarray(np.maximum.accumulate(transform[::-1])[::-1] / transform[0], dtype=np.float64)


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
    from signals.spectra._line_kernels import chance  # noqa: PLC0415 - loads numba

    return chance(power_ratio, width_bins, spread, background_degrees)


def record_probability(single: float, *, searches: int) -> float:
    """Return the false-alarm probability of `searches` independent searches, each of probability `single`."""
    return -math.expm1(searches * math.log1p(-single)) if single < 1 else 1.0


def _peaks(axis: Array, amplitude: Array, low: Array, high: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return position and height of the maximum in each band, by parabolic interpolation where it is a local one.

    The third array says that it is none: a neighbour outside the band is larger.
    """
    from signals.spectra._line_kernels import largest  # noqa: PLC0415 - loads numba

    first, last = axis.searchsorted(low), axis.searchsorted(high)
    last = np.maximum(last, first + 1)
    top = np.empty(first.size, dtype=np.int64)
    largest(amplitude, first, last, top)
    left, middle, right = (amplitude[np.clip(top + side, 0, axis.size - 1)] for side in (-1, 0, 1))
    curvature = left - 2 * middle + right
    at_edge = middle < np.maximum(left, right)
    local = (top > 0) & (top < axis.size - 1) & ~at_edge & (curvature < 0)
    shift = np.divide(0.5 * (left - right), curvature, out=np.zeros(top.size), where=local)
    return axis[top] + shift * (axis[1] - axis[0]), middle - 0.25 * (left - right) * shift, at_edge
