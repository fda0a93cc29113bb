"""Amplitude spectra of whole records, over frequency or order: scaling and resolution stated."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft
from scipy.signal import get_window

from signals._checks import Array, positive, real_vector, whole
from signals.resampling import AngularSignal

PADDING = 8  # zero padding; the grid then meets a Hann line within 0.25 % of its height, a parabola within 0.003 %


@dataclass(frozen=True, kw_only=True)
class AmplitudeSpectrum:
    """Peak amplitude against frequency (Hz) or order, interpolated by zero padding.

    ``resolution`` is the window's full -3 dB width; ``bin_width`` is one over the length of the record, in
    the axis' unit, and the grid is finer than it by the padding.
    """

    axis: Array = field(metadata={"dims": ("line",), "units": "Hz or order"})
    amplitude: Array = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    bin_width: float
    resolution: float
    window: str
    noise_bandwidth_bins: float  # equivalent noise bandwidth of the window
    spread: float  # second moment of the squared window about its middle, over length squared: see signals.lines


def amplitude_spectrum(
    values: ArrayLike,
    *,
    rate: float,
    window: str = "hann",
    padding: int = PADDING,
    maximum: float | None = None,
) -> AmplitudeSpectrum:
    """Return the peak amplitude spectrum of a record with its mean removed.

    Parameters
    ----------
    values : (n,) array
    rate : float
        Samples a second for an axis in Hz, samples a revolution for one in orders.
    window : str
        A window of `scipy.signal`; the amplitude is corrected for its mean, so a line reads its true peak.
    padding : int
        How many times finer than one over the record the axis is.
    maximum : float, optional
        Where the axis ends; default half of `rate`.
    """
    signal = real_vector(values, name="the signal", minimum=4)
    rate = positive(rate, name="rate")
    padding = whole(padding, name="padding", least=1)
    weights = np.asarray(get_window(window, signal.size), dtype=np.float64)
    length = signal.size * padding
    lines = fft.rfft((signal - signal.mean()) * weights, length)
    axis = np.arange(lines.size, dtype=np.float64) * (rate / length)
    keep = slice(None) if maximum is None else slice(int(np.searchsorted(axis, maximum, side="right")))
    place = (np.arange(signal.size) - (signal.size - 1) / 2) / signal.size
    return AmplitudeSpectrum(
        axis=np.asarray(axis[keep]),
        amplitude=np.abs(lines[keep]) * (2 / weights.sum()),
        bin_width=rate / signal.size,
        resolution=_width(window) * rate / signal.size,
        window=window,
        noise_bandwidth_bins=float(signal.size * np.sum(weights**2) / weights.sum() ** 2),
        spread=float(np.sum(place**2 * weights**2) / np.sum(weights**2)),
    )


def order_spectrum(
    signal: AngularSignal, *, window: str = "hann", padding: int = PADDING, max_order: float | None = None
) -> AmplitudeSpectrum:
    """Return the peak amplitude spectrum of an angular signal over orders, up to its passband."""
    limit = signal.passband_orders if max_order is None else min(max_order, signal.passband_orders)
    return amplitude_spectrum(signal.values, rate=signal.samples_per_rev, window=window, padding=padding, maximum=limit)


def _width(window: str) -> float:
    """Full -3 dB width of a window's main lobe in bins, measured on its own transform."""
    length, fine = 512, 64
    lobe = np.abs(fft.rfft(get_window(window, length), length * fine))
    half_power = lobe[0] / np.sqrt(2)
    below = int(np.argmax(lobe < half_power))
    part = (lobe[below - 1] - half_power) / (lobe[below - 1] - lobe[below])
    return float(2 * (below - 1 + part) / fine)
