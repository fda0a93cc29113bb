"""Fast spectral correlation: power that comes and goes at a cyclic frequency, over spectral frequency.

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

from signals._checks import Array, Samples, positive, real_vector, whole
from signals._windows import Window, window_of
from signals.spectra import without_mean

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_FEWEST_FRAMES = 16
_HANN_REACH = 3  # bins beyond which the squared window's transform is nothing


@dataclass(frozen=True, kw_only=True)
class SpectralCorrelation:
    """Spectral correlation ``S(alpha, f)``, the two-sided density of the power that lines f and f - alpha share.

    ``S(0, f)`` is the power density; ``abs(coherence)`` is free of its colour. Cyclic frequencies stand
    ``cyclic_bin_hz`` apart, one over the record; spectral ones blur over ``resolution_hz``, the window's -3 dB width.
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
        """Two-sided power density, (line,), units squared per Hz."""
        return np.asarray(self.correlation[:, 0].real)

    def coherence(self) -> NDArray[np.complex128]:
        """Return ``S(alpha, f) / sqrt(S(0, f) S(0, f - alpha))``, (line, cyclic); 0 where there is no power.

        Power between the lines is interpolated, and mirrored at zero frequency. What steady noise leaves has a root
        mean square of about 0.65 times the root of ``window_length / (frames * hop)`` (measured).
        """
        power = self.power_density
        place = np.abs(self.frequency_hz[:, None] - self.cyclic_hz) / (self.frequency_hz[1] - self.frequency_hz[0])
        cell = np.minimum(place.astype(np.intp), power.size - 2)
        shifted = power[cell] + (place - cell) * (power[cell + 1] - power[cell])
        common = np.sqrt(np.maximum(power[:, None] * shifted, 0))
        return np.asarray(np.divide(self.correlation, common, out=np.zeros_like(self.correlation), where=common > 0))


def spectral_correlation(
    x: ArrayLike, *, rate_hz: float, max_cyclic_hz: float, window_length: int = 256
) -> SpectralCorrelation:
    """Return the fast spectral correlation (Fast-SC) up to a cyclic frequency.

    Parameters
    ----------
    x : (n,) array
        Its mean is removed.
    rate_hz : float
    max_cyclic_hz : float
        The largest cyclic frequency, say ten times a defect rate: the hop between frames is
        less than half the rate over it.
    window_length : int
        Samples of the Hann window, even. Spectral lines stand `rate_hz` over it apart, and memory grows with it.

    Returns
    -------
    SpectralCorrelation
        From as many frames as transform fast: less than one in a hundred is left out of a long record.

    Raises
    ------
    ValueError
        A record of fewer than 16 frames; a cyclic frequency above an eighth of the rate.

    Notes
    -----
    With X(i, k) the centred short-time Fourier transform, the estimate is

        S(alpha, f_k) = DFT_i[ X(i, k) sum_{p = 0..P} X(i, k - p)* ] / (K rate sum_p R_w(alpha - p rate / N))

    with R_w the Fourier transform of the squared window and P lines reaching max_cyclic_hz ([1]_, the sum moved
    inside by [2]_).
    """
    signal = real_vector(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    length = whole(window_length, name="window_length", least=16, most=signal.size)
    if length % 2:
        raise ValueError(f"window_length={length} must be even, so that its lines centre on a sample; take one more.")
    most = positive(max_cyclic_hz, name="max_cyclic_hz")
    if most > rate / 8:
        raise ValueError(f"max_cyclic_hz={most:g} must be at most {rate / 8:g} Hz, an eighth of the sampling rate.")
    shape = window_of("hann", length)
    scanned = int(np.ceil(most * length / rate))
    # alias-free: cyclic frequencies repeat after rate / hop, and the lines scanned reach three beyond the last
    hop = max(1, min(int(rate / (2 * most + 2 * _HANN_REACH * rate / length)), length // 4))
    frames = fft.prev_fast_len((signal.size - length) // hop + 1)
    if frames < _FEWEST_FRAMES:
        raise ValueError(
            f"the record holds {frames} frames of {length} samples, {hop} apart; at least {_FEWEST_FRAMES} are needed: "
            "record longer, or shorten the window."
        )
    kept = int(np.floor(most * frames * hop / rate * (1 + 1e-12))) + 1
    cyclic = np.arange(kept, dtype=np.float64) * (rate / (frames * hop))
    products = _products(without_mean(signal), shape, hop, frames, scanned)
    lines = np.empty((products.shape[0], kept), dtype=np.complex128)
    for k, row in enumerate(products):
        lines[k] = fft.fft(row)[:kept]
    turn = np.exp(-2j * np.pi * np.mod(cyclic * (length / 2 / rate), 1.0))  # time counts from the first sample
    lines *= turn / (frames * rate * _window_sum(shape, scanned, samples=frames * hop, kept=kept))
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
    """Return ``X(i, k) sum_p X(i, k - p)*`` as (lines, frames), the phases of X those at its window's middle."""
    length = shape.weights.size
    half = length // 2
    segments = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop][:frames]
    out = np.empty((half + 1, frames), dtype=np.complex128)
    some = max(1, 2**17 // length)
    sign = 1.0 - 2.0 * (np.arange(half + 1) % 2)
    for first in range(0, frames, some):
        lines = fft.rfft(segments[first : first + some] * shape.weights, axis=1) * sign
        # lines below zero are the conjugates of those above
        mirrored = np.concatenate([lines[:, scanned + 1 : 0 : -1].conj(), lines], axis=1)
        total = np.cumsum(mirrored, axis=1)
        below = total[:, scanned + 1 :] - total[:, : half + 1]
        out[:, first : first + some] = (lines * below.conj()).T
    return out


def _window_sum(shape: Window, scanned: int, *, samples: int, kept: int) -> Array:
    """Return ``sum_p R_w(alpha - p / N)`` at the multiples of one over `samples`: the transform of w^2 times a sum."""
    length = shape.weights.size
    place = np.arange(length) - length // 2
    scan = np.exp(2j * np.pi / length * np.outer(np.arange(scanned + 1), place)).sum(axis=0)
    weights = np.zeros(samples, dtype=np.complex128)
    weights[place] = shape.weights**2 * scan  # the middle at zero, what lies before it wrapped round
    return np.asarray(fft.fft(weights, overwrite_x=True)[:kept].real, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class CyclicSpectrum:
    """Mean magnitude of the cyclic coherence over a band, against cyclic frequency, from 0 to about 1.

    ``floor`` is the median over the cyclic frequencies: what noise leaves, were there no lines.
    """

    cyclic_hz: Array = field(metadata={"dims": ("cyclic",), "units": "Hz"})
    value: Array = field(metadata={"dims": ("cyclic",), "units": "1"})
    floor: float
    band_hz: tuple[float, float]
    cyclic_bin_hz: float


def enhanced_envelope_spectrum(correlation: SpectralCorrelation) -> CyclicSpectrum:
    """Return ``mean over f of abs(coherence(alpha, f))`` over all spectral frequencies [1]_."""
    return improved_envelope_spectrum(correlation, band_hz=(0.0, float(correlation.frequency_hz[-1])))


def improved_envelope_spectrum(correlation: SpectralCorrelation, *, band_hz: tuple[float, float]) -> CyclicSpectrum:
    """Return the mean of ``abs(coherence(alpha, f))`` over a band of spectral frequency.

    Parameters
    ----------
    correlation : SpectralCorrelation
    band_hz : (low, high)
        Where the fault's resonance lies, say from `signals.choose_band`; lines on the edges belong to it.
    """
    low, high = band_hz
    frequency = correlation.frequency_hz
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any():
        raise ValueError(
            f"band_hz = ({low:g}, {high:g}) holds no spectral line; lines stand {frequency[1]:g} Hz apart from 0 to "
            f"{frequency[-1]:g} Hz: widen the band, or lengthen the window."
        )
    value = np.abs(correlation.coherence()[inside]).mean(axis=0)
    return CyclicSpectrum(
        cyclic_hz=correlation.cyclic_hz,
        value=value,
        floor=float(np.median(value)),
        band_hz=(float(low), float(high)),
        cyclic_bin_hz=correlation.cyclic_bin_hz,
    )
