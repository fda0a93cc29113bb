"""Fast spectral correlation and the envelope spectra derived from it.

References
----------
.. [1] Antoni, Xin & Hamzaoui, "Fast computation of the spectral correlation", Mechanical Systems and Signal
   Processing 92 (2017).
.. [2] Borghesani & Antoni, "A faster algorithm for the calculation of the fast spectral correlation", MSSP 111 (2018):
   the sum over scanned lines is taken before the transform over frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._transforms import Window, window_of, without_mean
from signals._validation import Array, Samples, checked, positive, real_vector, whole

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True)
class SpectralCorrelation:
    """Spectral correlation ``S(alpha, f)``: two-sided cross-spectral density of the components at f and f - alpha.

    Attributes
    ----------
    cyclic_hz, frequency_hz : (cyclic,) and (line,) arrays
        Cyclic frequencies alpha and spectral frequencies f in Hz.
    correlation : (line, cyclic) complex array
        ``S(alpha, f)``, in units squared per Hz; ``S(0, f)`` is the power spectral density.
    cyclic_bin_hz : float
        Spacing of the cyclic frequencies in Hz, the reciprocal of the record length.
    resolution_hz : float
        Full -3 dB width of the window in Hz, the resolution in f.
    frames, hop, window_length : int
        Number of frames, samples between them, and samples of the window.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import spectral_correlation
    >>> x = np.random.default_rng(1).standard_normal(20_000)
    >>> result = spectral_correlation(x, rate_hz=1000, max_cyclic_hz=50)
    >>> result.correlation.shape == (result.frequency_hz.size, result.cyclic_hz.size)
    True
    """

    cyclic_hz: Array = field(metadata={"dims": ("cyclic",), "units": "Hz"})
    frequency_hz: Array = field(metadata={"dims": ("line",), "units": "Hz"})
    correlation: NDArray[np.complex128] = field(
        metadata={"dims": ("line", "cyclic"), "units": "as the record, squared per Hz"}
    )
    cyclic_bin_hz: float
    resolution_hz: float
    frames: int
    hop: int
    window_length: int

    @property
    def power_density(self) -> Array:
        """Two-sided power spectral density, (line,), in units squared per Hz."""
        return np.asarray(self.correlation[:, 0].real)

    def coherence(self) -> NDArray[np.complex128]:
        """Return ``S(alpha, f) / sqrt(S(0, f) S(0, f - alpha))``, (line, cyclic); 0 where there is no power.

        The power spectral density is interpolated linearly between lines. For stationary noise the measured RMS of the
        coherence is about ``0.65 sqrt(window_length / (frames * hop))``.
        """
        power = self.power_density
        position = np.abs(self.frequency_hz[:, None] - self.cyclic_hz) / (self.frequency_hz[1] - self.frequency_hz[0])
        cell = np.minimum(position.astype(np.intp), power.size - 2)
        shifted = power[cell] + (position - cell) * (power[cell + 1] - power[cell])
        common = np.sqrt(np.maximum(power[:, None] * shifted, 0))
        return np.asarray(np.divide(self.correlation, common, out=np.zeros_like(self.correlation), where=common > 0))


@checked
def spectral_correlation(
    x: ArrayLike, *, rate_hz: float, max_cyclic_hz: float, window_length: int = 256
) -> SpectralCorrelation:
    """Return the fast spectral correlation (Fast-SC) up to a cyclic frequency.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit; their mean is removed.
    rate_hz : float
        Sampling rate in Hz.
    max_cyclic_hz : float
        Largest cyclic frequency in Hz, such as ten times a defect frequency. The hop between frames is inversely
        proportional to it.
    window_length : int
        Length of the Hann window in samples, even. The spectral frequencies are ``rate_hz / window_length`` apart.

    Returns
    -------
    SpectralCorrelation
        The number of frames is rounded down to one with a fast Fourier transform, by less than 1 % in long records.

    Raises
    ------
    ValueError
        A record of fewer than 16 frames, an odd window length, or a cyclic frequency above an eighth of the sampling
        rate.

    Notes
    -----
    With X(i, k) the centred short-time Fourier transform, the estimate is

        S(alpha, f_k) = DFT_i[ X(i, k) sum_{p = 0..P} X(i, k - p)* ] / (K rate sum_p R_w(alpha - p rate / N))

    with R_w the Fourier transform of the squared window, N its length, K the number of frames, and P lines up to
    `max_cyclic_hz` (Antoni, Xin and Hamzaoui 2017, with the sum moved inside by Borghesani and Antoni 2018).

    Examples
    --------
    Noise whose amplitude is modulated at 20 Hz; its squared envelope has components at 20 and 40 Hz:

    >>> import numpy as np
    >>> from signals import enhanced_envelope_spectrum, spectral_correlation
    >>> t = np.arange(40_000) / 2000
    >>> x = (1 + np.cos(2 * np.pi * 20 * t)) * np.random.default_rng(1).standard_normal(t.size)
    >>> spectrum = enhanced_envelope_spectrum(spectral_correlation(x, rate_hz=2000, max_cyclic_hz=100))
    >>> float(round(spectrum.cyclic_hz[5 + np.argmax(spectrum.value[5:])], 1))
    20.0
    """
    signal = real_vector(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    length = whole(window_length, name="window_length", least=16, most=signal.size)
    if length % 2:
        raise ValueError(f"window_length={length} must be even, so that its middle is a sample; use {length + 1}.")
    most = positive(max_cyclic_hz, name="max_cyclic_hz")
    if most > rate / 8:
        raise ValueError(f"max_cyclic_hz={most:g} must be at most {rate / 8:g} Hz, an eighth of the sampling rate.")
    shape = window_of("hann", length)
    scanned = int(np.ceil(most * length / rate))
    # no aliasing: cyclic frequencies are periodic in rate / hop, and the scanned lines extend three bins beyond the
    # last, where the transform of the squared window becomes negligible
    hop = max(1, min(int(rate / (2 * most + 2 * 3 * rate / length)), length // 4))
    frames = fft.prev_fast_len((signal.size - length) // hop + 1)
    fewest_frames = 16
    if frames < fewest_frames:
        raise ValueError(
            f"the record holds {frames} frames of {length} samples, {hop} apart; at least {fewest_frames} are needed: "
            "record longer, or reduce window_length."
        )
    kept = int(np.floor(most * frames * hop / rate * (1 + 1e-12))) + 1
    cyclic = np.arange(kept, dtype=np.float64) * (rate / (frames * hop))
    products = _products(without_mean(signal), shape, hop, frames, scanned)
    lines = np.empty((products.shape[0], kept), dtype=np.complex128)
    for k, row in enumerate(products):
        lines[k] = fft.fft(row)[:kept]
    shift = np.exp(-2j * np.pi * np.mod(cyclic * (length / 2 / rate), 1.0))  # phases refer to the first sample
    lines *= shift / (frames * rate * _window_sum(shape, scanned, samples=frames * hop, kept=kept))
    return SpectralCorrelation(
        cyclic_hz=cyclic,
        frequency_hz=np.arange(length // 2 + 1, dtype=np.float64) * (rate / length),
        correlation=lines,
        cyclic_bin_hz=rate / (frames * hop),
        resolution_hz=shape.width_bins * rate / length,
        frames=frames,
        hop=hop,
        window_length=length,
    )


def _products(signal: Samples, shape: Window, hop: int, frames: int, scanned: int) -> NDArray[np.complex128]:
    """Return ``X(i, k) sum_p X(i, k - p)*`` as (lines, frames), phases of X relative to the middle of the window."""
    length = shape.weights.size
    half = length // 2
    segments = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop][:frames]
    out = np.empty((half + 1, frames), dtype=np.complex128)
    count = max(1, 2**17 // length)
    sign = 1.0 - 2.0 * (np.arange(half + 1) % 2)
    for first in range(0, frames, count):
        lines = fft.rfft(segments[first : first + count] * shape.weights, axis=1) * sign
        # lines at negative frequencies are the conjugates of those at positive ones
        mirrored = np.concatenate([lines[:, scanned + 1 : 0 : -1].conj(), lines], axis=1)
        total = np.cumsum(mirrored, axis=1)
        below = total[:, scanned + 1 :] - total[:, : half + 1]
        out[:, first : first + count] = (lines * below.conj()).T
    return out


def _window_sum(shape: Window, scanned: int, *, samples: int, kept: int) -> Array:
    """Return ``sum_p R_w(alpha - p / N)`` at multiples of 1 / `samples`.

    It is the transform of ``w^2 sum_p exp(j 2 pi p n / N)``.
    """
    length = shape.weights.size
    offset = np.arange(length) - length // 2
    scan = np.exp(2j * np.pi / length * np.outer(np.arange(scanned + 1), offset)).sum(axis=0)
    weights = np.zeros(samples, dtype=np.complex128)
    weights[offset] = shape.weights**2 * scan  # the middle at index zero, the first half wrapped to the end
    return np.asarray(fft.fft(weights, overwrite_x=True)[:kept].real, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class CyclicSpectrum:
    """Mean magnitude of the cyclic coherence over a band, against cyclic frequency.

    Attributes
    ----------
    cyclic_hz, value : (cyclic,) arrays
        Cyclic frequencies in Hz, and the mean magnitude, from 0 to about 1.
    floor : float
        Median of `value`, the noise level.
    band_hz : (low, high)
        Band of spectral frequencies in Hz.
    cyclic_bin_hz : float
        Spacing of the cyclic frequencies in Hz.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import enhanced_envelope_spectrum, spectral_correlation
    >>> x = np.random.default_rng(1).standard_normal(20_000)
    >>> spectrum = enhanced_envelope_spectrum(spectral_correlation(x, rate_hz=1000, max_cyclic_hz=50))
    >>> spectrum.band_hz, bool(0 < spectrum.floor < 0.2)
    ((0.0, 500.0), True)
    """

    cyclic_hz: Array = field(metadata={"dims": ("cyclic",), "units": "Hz"})
    value: Array = field(metadata={"dims": ("cyclic",), "units": "1"})
    floor: float
    band_hz: tuple[float, float]
    cyclic_bin_hz: float


@checked
def enhanced_envelope_spectrum(correlation: SpectralCorrelation) -> CyclicSpectrum:
    """Return the enhanced envelope spectrum: the mean of ``abs(coherence(alpha, f))`` over all f (Antoni 2017).

    Parameters
    ----------
    correlation : SpectralCorrelation
        From `spectral_correlation`.

    Returns
    -------
    CyclicSpectrum

    Examples
    --------
    >>> import numpy as np
    >>> from signals import enhanced_envelope_spectrum, spectral_correlation
    >>> x = np.random.default_rng(1).standard_normal(20_000)
    >>> spectrum = enhanced_envelope_spectrum(spectral_correlation(x, rate_hz=1000, max_cyclic_hz=50))
    >>> round(float(spectrum.value[0]), 3)
    1.0
    """
    return improved_envelope_spectrum(correlation, band_hz=(0.0, float(correlation.frequency_hz[-1])))


@checked
def improved_envelope_spectrum(correlation: SpectralCorrelation, *, band_hz: tuple[float, float]) -> CyclicSpectrum:
    """Return the improved envelope spectrum: the mean of ``abs(coherence(alpha, f))`` over a band of f.

    Parameters
    ----------
    correlation : SpectralCorrelation
        From `spectral_correlation`.
    band_hz : (low, high)
        Band in Hz of the resonance excited by the fault, for example from `choose_band`; its edges are included.

    Returns
    -------
    CyclicSpectrum

    Raises
    ------
    ValueError
        A band without a spectral line.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import improved_envelope_spectrum, spectral_correlation
    >>> x = np.random.default_rng(1).standard_normal(20_000)
    >>> correlation = spectral_correlation(x, rate_hz=1000, max_cyclic_hz=50)
    >>> round(float(improved_envelope_spectrum(correlation, band_hz=(100, 300)).value[0]), 3)
    1.0
    """
    low, high = band_hz
    frequency = correlation.frequency_hz
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any():
        raise ValueError(
            f"band_hz = ({low:g}, {high:g}) holds no spectral line; lines are {frequency[1]:g} Hz apart, from 0 to "
            f"{frequency[-1]:g} Hz: widen the band, or increase window_length."
        )
    value = np.abs(correlation.coherence()[inside]).mean(axis=0)
    return CyclicSpectrum(
        cyclic_hz=correlation.cyclic_hz,
        value=value,
        floor=float(np.median(value)),
        band_hz=(float(low), float(high)),
        cyclic_bin_hz=correlation.cyclic_bin_hz,
    )
