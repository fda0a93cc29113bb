"""Envelope of a frequency band, and its spectrum over orders."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from signals._checks import Array, positive, real_vector
from signals.phase import ShaftPhase
from signals.resampling import angular_resample
from signals.spectra import AmplitudeSpectrum, order_spectrum


def envelope(x: ArrayLike, *, rate_hz: float, band_hz: tuple[float, float]) -> Array:
    """Return the magnitude of the analytic signal of one band, (n,), in the unit of `x`.

    The mean is removed, the band is cut out with sharp edges in the Fourier transform of the whole record.

    Parameters
    ----------
    x : (n,) array
    rate_hz : float
    band_hz : (low, high)
        Band edges, ``0 <= low < high <= rate_hz / 2``.
    """
    signal = real_vector(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    low, high = (float(edge) for edge in band_hz)
    if not 0 <= low < high <= rate / 2:
        raise ValueError(
            f"band_hz = ({low:g}, {high:g}) must rise and lie between 0 and {rate / 2:g} Hz, half the sampling rate."
        )
    lines = fft.fft(signal - signal.mean())
    frequency = fft.fftfreq(signal.size, 1 / rate)
    lines[(frequency < low) | (frequency > high)] = 0
    return np.asarray(2 * np.abs(fft.ifft(lines)), dtype=np.float64)


def envelope_order_spectrum(
    x: ArrayLike,
    *,
    rate_hz: float,
    band_hz: tuple[float, float],
    phase: ShaftPhase,
    samples_per_rev: int,
    start_s: float = 0.0,
    max_order: float | None = None,
) -> AmplitudeSpectrum:
    """Demodulate a band in time, resample its envelope over angle, and return the spectrum over orders.

    A resonance stays at its frequency while the shaft's speed changes, so the band is cut in time; the
    defect repeats with the shaft, so its line is sharp in orders. Parameters as in `envelope` and
    `signals.angular_resample`.
    """
    over_angle = angular_resample(
        envelope(x, rate_hz=rate_hz, band_hz=band_hz),
        rate_hz=rate_hz,
        phase=phase,
        samples_per_rev=samples_per_rev,
        start_s=start_s,
    )
    return order_spectrum(over_angle, max_order=max_order)
