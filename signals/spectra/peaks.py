"""All lines of a spectrum: local maxima well above the median of their background.

`signals.spectra.lines` tests for a line at an expected order; this module finds lines that nobody expected. The median
of the background is taken over blocks and interpolated between them: a moving median over hundreds of bins costs a
hundred times as much and differs by a few per cent.

Spectra of many short records have no common phase, so they are averaged in power (Bartlett 1948): the resolution and
the mean of the noise remain those of one record, while the scatter falls with the square root of their number. The
known mean of the noise is therefore subtracted, down to its scatter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage, special
from scipy.ndimage import median_filter

from signals._transforms import median
from signals._validation import Array, positive

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals.spectra.spectra import AmplitudeSpectrum


@dataclass(frozen=True, kw_only=True)
class SpectralPeaks:
    """Local maxima of a spectrum that stand out of their background.

    Attributes
    ----------
    position : (peak,) array
        Position in the unit of the axis, in rising order.
    amplitude, background : (peak,) arrays
        Peak amplitude and median amplitude of the background, in the unit of the spectrum.

    Examples
    --------
    >>> from signals.spectra.peaks import SpectralPeaks
    >>> import numpy as np
    >>> SpectralPeaks(position=np.array([2.0]), amplitude=np.array([1.0]), background=np.array([0.1])).position.size
    1
    """

    position: Array = field(metadata={"dims": ("peak",)})
    amplitude: Array = field(metadata={"dims": ("peak",)})
    background: Array = field(metadata={"dims": ("peak",)})


def spectral_peaks(spectrum: AmplitudeSpectrum, *, ratio: float = 4.0) -> SpectralPeaks:
    """Return the local maxima of a spectrum above `ratio` times the median amplitude of their background.

    Parameters
    ----------
    spectrum : AmplitudeSpectrum
        Over orders or frequency.
    ratio : float
        Threshold over the median amplitude; noise alone exceeds four at one point in 65,000 (2^-16).

    Returns
    -------
    SpectralPeaks

    Raises
    ------
    ValueError
        A ratio that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.spectra.peaks import spectral_peaks
    >>> turns = np.arange(4096) / 64
    >>> x = np.cos(2 * np.pi * 10 * turns) + 0.05 * np.random.default_rng(1).standard_normal(4096)
    >>> found = spectral_peaks(amplitude_spectrum(x, rate=64), ratio=20)
    >>> np.round(found.position, 2), np.round(found.amplitude, 1)
    (array([10.]), array([1.]))
    """
    ratio = positive(ratio, name="ratio")
    axis, amplitude = spectrum.axis, spectrum.amplitude
    step = float(axis[1] - axis[0])
    # the background is taken as constant over 0.5 in the unit of the axis (orders)
    block = max(16, int(0.5 / step))  # the median of fewer than 16 scatters by more than a quarter
    count = max(1, amplitude.size // block)
    size = min(block, amplitude.size)
    medians = median(amplitude[: count * size].reshape(count, size))
    # a quiet block between noisy ones keeps its own median; one full of sidebands takes the median of five blocks, so
    # that it does not raise its own background
    medians = np.minimum(medians, median_filter(medians, 5, mode="nearest"))
    inner = amplitude[1:-1]
    places = np.flatnonzero(inner > ratio * medians.min()) + 1  # no other point can stand out
    places = places[(amplitude[places] >= amplitude[places - 1]) & (amplitude[places] > amplitude[places + 1])]
    places = places[axis[places] > 3.0 * spectrum.bin_width]  # leakage of the constant part below
    background = np.interp(places, (np.arange(count) + 0.5) * size, medians)
    high = amplitude[places] > ratio * background
    places, background = places[high], background[high]
    return SpectralPeaks(position=axis[places], amplitude=amplitude[places], background=background)


def noise_left(count: int) -> float:
    """Return the fraction of the noise power that remains in the pooled spectrum of `count` records.

    Examples
    --------
    >>> from signals.spectra.peaks import noise_left
    >>> noise_left(1), noise_left(4), noise_left(1000)  # a tenth at least
    (1.0, 0.5, 0.1)
    """
    # at least 0.1 remains: a sloping background is not known to better than a tenth
    return max(0.1, 1 / math.sqrt(count)) if count > 1 else 1.0


def pooled_spectrum(first: AmplitudeSpectrum, *, power: NDArray[np.float64], count: int) -> AmplitudeSpectrum:
    """Return the mean power of several spectra, less their common noise, as an amplitude spectrum.

    With K spectra of noise power N and a line of amplitude A, the mean power is ``A^2 + N`` with a scatter of
    ``N / sqrt(K)``; the result is ``sqrt(A^2 + N / sqrt(K))``. N is the median over adjacent bins, corrected for the
    gamma distribution of a mean of K. That of one spectrum is its own.

    Parameters
    ----------
    first : AmplitudeSpectrum
        One of the spectra, all of records of equal length and with the same window.
    power : (line,) array
        Sum of their squared amplitudes.
    count : int
        Number of spectra.

    Returns
    -------
    AmplitudeSpectrum
        With phases of zero, since the spectra have no common phase.

    Raises
    ------
    ValueError
        If `power` is not on the axis of `first`.

    Examples
    --------
    A line that stands out in none of 400 short records:

    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.spectra.peaks import pooled_spectrum
    >>> rng, t = np.random.default_rng(0), np.arange(512) / 64
    >>> each = [amplitude_spectrum(0.2 * np.cos(2 * np.pi * 10 * t + rng.uniform(0, 7)) + rng.normal(size=512), rate=64)
    ...         for _ in range(400)]
    >>> pooled = pooled_spectrum(each[0], power=sum(one.amplitude**2 for one in each), count=400)
    >>> float(pooled.axis[np.argmax(pooled.amplitude)]), round(float(pooled.amplitude.max()), 1)
    (10.0, 0.2)
    """
    if power.shape != first.axis.shape:
        raise ValueError(f"power has {power.size} lines but the spectrum has {first.axis.size}; give one for each.")
    amplitude = np.sqrt(power)
    if count > 1:
        # median over 12 bins on either side: three main lobes, so that a single line does not fill them
        reach = max(1, round(12 * first.bin_width / float(first.axis[1] - first.axis[0])))
        median_of_mean = float(special.gammaincinv(count, 0.5)) / count  # of a mean of exponentials
        noise = ndimage.median_filter(power / count, 2 * reach + 1, mode="nearest") / median_of_mean
        # at least 1e-3 of the noise, so that levels in dB exist
        amplitude = np.sqrt(np.maximum(power / count - (1 - noise_left(count)) * noise, 1e-3 * noise))
    return replace(first, amplitude=amplitude, complex_amplitude=amplitude.astype(np.complex128))
