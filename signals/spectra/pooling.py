"""Spectra of many short records, pooled by power.

The phases of short records do not agree, so that their spectra are averaged in power (Bartlett 1948). The resolution
stays that of one record, and so does the mean of the noise; what the average makes smaller is its scatter, by the
square root of their number. The part of the noise that is known to be there is therefore subtracted, and what is left
is as uncertain as the noise of one record with so much less noise.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from signals.spectra.spectra import AmplitudeSpectrum

_BESIDE = 12  # bins on either side whose median is the noise: three main lobes, so that one line does not fill it
_KNOWN = 0.1  # of the noise at least is left: a background that slopes is not known better than to a tenth
_FLOOR = 1e-3  # of the noise, in place of what falls below it, so that levels in dB exist


def noise_left(count: int) -> float:
    """Return the share of the power of noise that is left in a spectrum pooled of so many.

    Examples
    --------
    >>> from signals.spectra.pooling import noise_left
    >>> noise_left(1), noise_left(4), noise_left(1000)  # a tenth at least
    (1.0, 0.5, 0.1)
    """
    return max(_KNOWN, 1 / math.sqrt(count)) if count > 1 else 1.0


def pooled_spectrum(first: AmplitudeSpectrum, *, power: NDArray[np.float64], count: int) -> AmplitudeSpectrum:
    """Return the mean power of spectra on one axis, less the noise that stands in all of them, as amplitudes.

    With K spectra of noise power N and a line of amplitude A, the mean power is ``A^2 + N`` with a scatter of
    ``N / sqrt(K)``; the result is ``sqrt(A^2 + N / sqrt(K))``. N is the median over the bins beside, corrected for the
    gamma distribution of a mean of K. Of one spectrum it is that spectrum itself.

    Parameters
    ----------
    first : AmplitudeSpectrum
        One of the spectra, which are of records of one length, with one window.
    power : (line,) array
        Sum of their squared amplitudes.
    count : int
        Number of spectra.

    Returns
    -------
    AmplitudeSpectrum
        Its phases are zero: the spectra have none in common.

    Raises
    ------
    ValueError
        If `power` is not on the axis of `first`.

    Examples
    --------
    A line that stands out of none of a hundred short records by itself:

    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.spectra.pooling import pooled_spectrum
    >>> rng, t = np.random.default_rng(0), np.arange(512) / 64
    >>> each = [amplitude_spectrum(0.2 * np.cos(2 * np.pi * 10 * t + rng.uniform(0, 7)) + rng.normal(size=512), rate=64)
    ...         for _ in range(400)]
    >>> pooled = pooled_spectrum(each[0], power=sum(one.amplitude**2 for one in each), count=400)
    >>> float(pooled.axis[np.argmax(pooled.amplitude)]), round(float(pooled.amplitude.max()), 1)
    (10.0, 0.2)
    """
    if power.shape != first.axis.shape:
        raise ValueError(f"power has {power.size} lines, where the spectrum has {first.axis.size}; give one for each.")
    if count == 1:
        return first
    reach = max(1, round(_BESIDE * first.bin_width / float(first.axis[1] - first.axis[0])))
    median_of_mean = float(special.gammaincinv(count, 0.5)) / count  # of a mean of exponentials
    noise = ndimage.median_filter(power / count, 2 * reach + 1, mode="nearest") / median_of_mean
    amplitude = np.sqrt(np.maximum(power / count - (1 - noise_left(count)) * noise, _FLOOR * noise))
    return replace(first, amplitude=amplitude, complex_amplitude=amplitude.astype(np.complex128))
