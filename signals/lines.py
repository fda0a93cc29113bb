"""A line near an expected order: where it is, how large, how far above its surroundings, and by what chance.

Noise alone gives a spectrum whose power is exponentially distributed about its local mean. The largest of it
within a searched band of W bins exceeds u times that mean with probability

    1 - exp(-[exp(-u) + W sqrt(m u / pi) exp(-u)]),   m = (2 pi)^2 spread,

the second term being the rate at which the envelope of a Gaussian process rises through a level (Rice 1945,
eq. 3.8-15), here along frequency, with `spread` the second moment of the squared window. The local mean is
itself estimated, from the median of the surroundings; that estimate is taken as Gamma distributed with K
degrees, and both terms are averaged over it in closed form, so short records pay for their uncertainty.

A strong line is not confined to its place: the window spreads it, and a searched band beside it may hold nothing
but its flank or a side lobe. How much the taller lines around can put there is stated beside each line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._checks import Array, positive
from signals._windows import window_of

if TYPE_CHECKING:
    from signals.spectra import AmplitudeSpectrum

SURROUNDINGS = 1.0  # on either side, in the axis' unit (orders)
_LOBE_BINS = 3.0  # left out on either side of the line
# measured: the median power of Hann- or box-windowed noise is known as well as the mean of this many
# independent bins, per bin and equivalent noise bandwidth
_MEDIAN_WORTH = 0.52
_FEWEST_BINS = 8
_REACH_BINS = 400  # beyond this a Hann side lobe lies 150 dB below its line
_SURELY = 3.0  # standard deviations: in level noise the closer background is then larger once in some hundred lines
_LINE = 4.0  # times the median amplitude
_TALLER = 2.0  # a neighbour must be this much taller to be thought to spread here


@dataclass(frozen=True, kw_only=True)
class Line:
    """The largest line of a spectrum within a searched band.

    ``background`` is the median amplitude of the surroundings, ``leakage`` the most that the window spreads to this
    place from a taller line, ``amplitude_std`` the standard deviation that the noise gives each quadrature.
    """

    expected: float
    found: float
    amplitude: float
    amplitude_std: float
    background: float
    leakage: float
    false_alarm_probability: float

    @property
    def snr(self) -> float:
        """Amplitude over the median amplitude of the surroundings, the line left out."""
        if self.background > 0:
            return self.amplitude / self.background
        return math.inf if self.amplitude > 0 else 0.0


def find_line(
    spectrum: AmplitudeSpectrum,
    *,
    expected: float,
    tolerance: float = 0.0,
    surroundings: float = SURROUNDINGS,
    closer: float | None = None,
) -> Line:
    """Find the largest line within ``expected +- tolerance`` and weigh it against its surroundings.

    Parameters
    ----------
    spectrum : AmplitudeSpectrum
        Over orders or frequency.
    expected : float
        Where the line should be, in the axis' unit.
    tolerance : float
        Half the searched band. Below one bin, one bin is searched, since no line is narrower.
    surroundings : float
        How far on either side the background reaches.
    closer : float, optional
        A second, closer reach. Noise that gathers about strong lines, as jitter of the tachometer makes it, is missed
        by the wide median; where the close one is larger the false-alarm probability rests on it.

    Returns
    -------
    Line
        ``false_alarm_probability`` is for this one search; for L searches at once use `record_probability`.

    Raises
    ------
    ValueError
        A line beyond the end of the spectrum, or fewer than eight bins of surroundings.
    """
    axis, bin_width = spectrum.axis, spectrum.bin_width
    expected = positive(expected, name="the expected order")
    surroundings = positive(surroundings, name="surroundings")
    if not 0 <= tolerance < math.inf:
        raise ValueError(f"tolerance = {tolerance!r} must be a finite number of at least 0.")
    half = max(tolerance, bin_width / 2)
    if expected + half > axis[-1]:
        raise ValueError(f"a line at {expected:g} +- {half:g} lies beyond the end of the spectrum, {axis[-1]:g}.")
    found, amplitude = _peak(axis, spectrum.amplitude, expected - half, expected + half)
    background, noise, bins = _background(spectrum, found, surroundings)
    if bins < _FEWEST_BINS:
        raise ValueError(
            f"only {bins:.1f} bins surround the line at {expected:g}, too few to judge it; the record is too short."
        )
    worth, std = bins, noise / math.sqrt(2 * math.log(2))
    if closer is not None:
        _, close, close_bins = _background(spectrum, found, closer)
        scatter = 1 / math.sqrt(_MEDIAN_WORTH * max(close_bins, 1) / spectrum.noise_bandwidth_bins)
        if close_bins >= _FEWEST_BINS and close**2 > (1 + _SURELY * scatter) * noise**2:
            noise, worth = close, close_bins
    probability = 0.0 if amplitude > 0 else 1.0
    if noise > 0:
        probability = false_alarm_probability(
            (amplitude / noise) ** 2 * math.log(2),
            width_bins=2 * half / bin_width,
            spread=spectrum.spread,
            background_degrees=_MEDIAN_WORTH * worth / spectrum.noise_bandwidth_bins,
        )
    return Line(
        expected=expected,
        found=found,
        amplitude=amplitude,
        amplitude_std=std,
        background=background,
        leakage=_leakage(spectrum, found, amplitude),
        false_alarm_probability=probability,
    )


def _background(spectrum: AmplitudeSpectrum, found: float, reach: float) -> tuple[float, float, float]:
    """Median amplitude beside a line; the same without other lines there; and how many bins they rest on.

    Noise passes four times its median once in 65,000 points (2^-16), so what does is taken for a line. Left in, strong
    lines raise the median, and faint ones beside them are weighed against too much noise.
    """
    axis, lobe = spectrum.axis, _LOBE_BINS * spectrum.bin_width
    first, last = np.searchsorted(axis, [max(found - reach, lobe), found + reach])
    beside = spectrum.amplitude[first:last][np.abs(axis[first:last] - found) > lobe]
    if not beside.size:
        return 0.0, 0.0, 0.0
    median = float(np.median(beside))
    level = beside[beside <= _LINE * median]
    return median, float(np.median(level)), float(level.size * (axis[1] - axis[0]) / spectrum.bin_width)


def _leakage(spectrum: AmplitudeSpectrum, found: float, amplitude: float) -> float:
    """Return the most that any taller point of the spectrum spreads to `found` through the window."""
    axis = spectrum.axis
    reach = _REACH_BINS * spectrum.bin_width
    first, last = np.searchsorted(axis, [found - reach, found + reach])
    around = spectrum.amplitude[first:last]
    taller = around > _TALLER * amplitude
    if not taller.any():
        return 0.0
    distance = np.abs(axis[first:last][taller] - found) / spectrum.bin_width
    bins, height = _lobes(spectrum.window)
    return float(np.max(around[taller] * np.interp(distance, bins, height)))


@lru_cache(maxsize=8)
def _lobes(window: str) -> tuple[Array, Array]:
    """Return distances in bins and the largest relative height that the window's transform has from there on."""
    length, fine = 4 * _REACH_BINS, 8
    transform = np.abs(fft.rfft(window_of(window, length).weights, length * fine))[: _REACH_BINS * fine + 1]
    envelope = np.maximum.accumulate(transform[::-1])[::-1] / transform[0]
    return np.arange(envelope.size) / fine, np.asarray(envelope, dtype=np.float64)


def false_alarm_probability(
    power_ratio: float, *, width_bins: float, spread: float, background_degrees: float
) -> float:
    """Return the chance that noise alone reaches `power_ratio` times its estimated mean in a searched band.

    Parameters
    ----------
    power_ratio : float
        Power of the line over the estimated mean power of the noise.
    width_bins : float
        Width of the searched band in bins.
    spread : float
        `AmplitudeSpectrum.spread`.
    background_degrees : float
        K, how many independent bins the estimate of the mean is worth.
    """
    u, degrees = power_ratio, background_degrees
    shrink = math.log1p(u / degrees)
    at_edge = math.exp(-degrees * shrink)
    rate = 2 * math.pi * math.sqrt(spread * u / math.pi)
    half_moment = math.exp(math.lgamma(degrees + 0.5) - math.lgamma(degrees)) / math.sqrt(degrees)
    crossings = width_bins * rate * half_moment * math.exp(-(degrees + 0.5) * shrink)
    return -math.expm1(-(at_edge + crossings))


def record_probability(single: float, *, searches: int) -> float:
    """Return the chance that any of `searches` independent searches reaches what one does with `single`."""
    return -math.expm1(searches * math.log1p(-single)) if single < 1 else 1.0


def _peak(axis: Array, amplitude: Array, low: float, high: float) -> tuple[float, float]:
    """Position and height of the largest point in a band, refined by a parabola where it is a summit."""
    first, last = np.searchsorted(axis, [low, high])
    if last <= first:
        last = first + 1
    top = first + int(np.argmax(amplitude[first:last]))
    if 0 < top < axis.size - 1:
        left, middle, right = amplitude[top - 1 : top + 2]
        bend = left - 2 * middle + right
        if middle >= max(left, right) and bend < 0:
            shift = 0.5 * (left - right) / bend
            return float(axis[top] + shift * (axis[1] - axis[0])), float(middle - 0.25 * (left - right) * shift)
    return float(axis[top]), float(amplitude[top])
