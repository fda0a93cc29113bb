"""All lines of a spectrum, wherever they stand: local maxima well above the median of their background.

`signals.spectra.lines` answers what stands at an expected order, with its probability; this is for what nobody
expected. The median of the background is taken over blocks and interpolated between them: a moving median over
hundreds of bins costs a hundred times as much and differs by some per cent.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from signals._median import median
from signals._validation import Array, positive

if TYPE_CHECKING:
    from signals.spectra.spectra import AmplitudeSpectrum

_BLOCK = 0.5  # width in the axis' unit (orders) over which the background is taken as constant
_FEWEST_BINS = 16  # in a block: the median of fewer scatters by more than a quarter
_SMOOTHED_BLOCKS = 5  # whose median is taken again: a block full of sidebands does not raise its own background
_LOBE_BINS = 3.0  # below this the constant part leaks


@dataclass(frozen=True, kw_only=True)
class SpectralPeaks:
    """Local maxima of a spectrum that stand out.

    Attributes
    ----------
    position : (n,) array
        Rising, in the unit of the axis.
    amplitude, background : (n,) array
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
        Noise alone exceeds four times its median amplitude at one point of 65,000 (2^-16).

    Returns
    -------
    SpectralPeaks

    Raises
    ------
    ValueError
        If `ratio` is not a positive number.

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
    block = max(_FEWEST_BINS, int(_BLOCK / step))
    count = max(1, amplitude.size // block)
    size = min(block, amplitude.size)
    medians = median(amplitude[: count * size].reshape(count, size))
    # a block of little noise between others of much keeps its own, and one filled with lines takes its neighbours'
    medians = np.minimum(medians, median_filter(medians, _SMOOTHED_BLOCKS, mode="nearest"))
    inner = amplitude[1:-1]
    places = np.flatnonzero(inner > ratio * medians.min()) + 1  # the others are below any background
    places = places[(amplitude[places] >= amplitude[places - 1]) & (amplitude[places] > amplitude[places + 1])]
    places = places[axis[places] > _LOBE_BINS * spectrum.bin_width]
    background = np.interp(places, (np.arange(count) + 0.5) * size, medians)
    high = amplitude[places] > ratio * background
    places, background = places[high], background[high]
    return SpectralPeaks(position=axis[places], amplitude=amplitude[places], background=background)
