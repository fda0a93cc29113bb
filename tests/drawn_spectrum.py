"""Order spectra made for a test: of drawn noise whose level is given over orders, or of that level itself, with lines.

The noise is Gaussian, so its power is exponentially distributed about the level squared, as in a measured spectrum.
"""

import numpy as np

from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum

PER_REV = 64
REVOLUTIONS = 64


def drawn_spectrum(level, *, rng, lines=()):
    """Return the order spectrum of a drawn record.

    Parameters
    ----------
    level : function of orders (m,), the noise's standard deviation were it white, (m,).
    rng : numpy.random.Generator
    lines : (order, amplitude) pairs; phases are drawn.
    """
    count = PER_REV * REVOLUTIONS
    shaped = np.fft.rfft(rng.standard_normal(count)) * level(np.fft.rfftfreq(count, 1 / PER_REV))
    turns = np.arange(count) / PER_REV
    record = np.fft.irfft(shaped, count)
    for order, amplitude in lines:
        record += amplitude * np.cos(2 * np.pi * (order * turns + rng.uniform()))
    return amplitude_spectrum(record, rate=PER_REV)


def level_spectrum(level, *, lines=(), padding=4):
    """Return a spectrum that is the level itself, without scatter, and lines of one point each on the nearest order."""
    axis = np.arange(PER_REV * REVOLUTIONS * padding // 2) / (REVOLUTIONS * padding)
    amplitude = np.asarray(level(axis), dtype=float)
    for order, height in lines:
        amplitude[np.argmin(np.abs(axis - order))] = height
    return AmplitudeSpectrum(
        axis=axis,
        amplitude=amplitude,
        complex_amplitude=amplitude.astype(complex),
        bin_width=1 / REVOLUTIONS,
        resolution=1.44 / REVOLUTIONS,  # of a Hann window, Harris 1978, as the bandwidth and the second moment
        window="hann",
        noise_bandwidth_bins=1.5,
        spread=0.02,
    )


def typical_amplitude(level):
    """Median amplitude in a Hann-windowed spectrum of noise: power 4 (3/2) level^2 / count, of which ln 2 is median."""
    return level * np.sqrt(6 * np.log(2) / (PER_REV * REVOLUTIONS))
