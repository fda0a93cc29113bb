"""Spectra of many short records, pooled by power.

The phases of short records do not agree, so that their spectra are averaged in power (Bartlett 1948). The resolution
stays that of one record, and so does the mean of the noise; what the average makes smaller is its scatter, by the
square root of their number. The part of the noise that is known to be there is therefore subtracted, and what is left
is as uncertain as the noise of one record with so much less noise.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage, special

from signals.spectra.spectra import AmplitudeSpectrum

__all__ = ["pooled_spectrum"]

_BESIDE = 12  # bins on either side whose median is the noise: three main lobes, so that one line does not fill it
_KNOWN = 0.1  # of the noise at least is left: a background that slopes is not known better than to a tenth
_FLOOR = 1e-3  # of the noise, in place of what falls below it, so that levels in dB exist


def pooled_spectrum(spectra: Sequence[AmplitudeSpectrum]) -> AmplitudeSpectrum:
    """Return the mean power of spectra on one axis, less the noise that stands in all of them, as amplitudes.

    With K spectra of noise power N and a line of amplitude A, the mean power is ``A^2 + N`` with a scatter of
    ``N / sqrt(K)``; the result is ``sqrt(A^2 + N / sqrt(K))``. N is the median over the bins beside, corrected for the
    gamma distribution of a mean of K. Of one spectrum it is that spectrum itself.

    Parameters
    ----------
    spectra : sequence of AmplitudeSpectrum
        Of records of one length, with one window.

    Returns
    -------
    AmplitudeSpectrum
        Its phases are zero: they have none in common.

    Raises
    ------
    ValueError
        If there are none, or their axes differ.

    Examples
    --------
    A line that stands out of none of a hundred short records by itself:

    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.spectra.pooling import pooled_spectrum
    >>> rng, t = np.random.default_rng(0), np.arange(512) / 64
    >>> each = [amplitude_spectrum(0.2 * np.cos(2 * np.pi * 10 * t + rng.uniform(0, 7)) + rng.normal(size=512), rate=64)
    ...         for _ in range(400)]
    >>> pooled = pooled_spectrum(each)
    >>> float(pooled.axis[np.argmax(pooled.amplitude)]), round(float(pooled.amplitude.max()), 1)
    (10.0, 0.2)
    """
    if not spectra:
        raise ValueError("no spectrum to pool; give one at least.")
    first, count = spectra[0], len(spectra)
    if count == 1:
        return first
    if any(one.axis.shape != first.axis.shape or not np.allclose(one.axis, first.axis) for one in spectra):
        raise ValueError("the spectra to pool have different axes; cut their records to one length.")
    power = np.mean([one.amplitude**2 for one in spectra], axis=0)
    reach = max(1, round(_BESIDE * first.bin_width / float(first.axis[1] - first.axis[0])))
    median_of_mean = float(special.gammaincinv(count, 0.5)) / count  # median over mean of a mean of K exponentials
    noise = ndimage.median_filter(power, 2 * reach + 1, mode="nearest") / median_of_mean
    left = power - (1 - max(_KNOWN, 1 / math.sqrt(count))) * noise
    amplitude = np.sqrt(np.maximum(left, _FLOOR * noise))
    return replace(first, amplitude=amplitude, complex_amplitude=amplitude.astype(np.complex128))
