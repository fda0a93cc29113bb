"""Detectability of a fault: the signal-to-noise ratio of the filter matched to what the fault adds to a channel."""

import numpy as np
from numpy.typing import ArrayLike

from data_synth.operation.shaft_angle import Array


def matched_filter_snr_db(difference: Array, *, noise_psd: ArrayLike, rate_hz: float) -> float:
    """Return the signal-to-noise ratio at the output of the matched filter, in dB.

    ``4 integral |D(f)|^2 / S(f) df`` from 0 to half the rate, D the Fourier transform of the difference in units s and
    S the one-sided spectral density of the noise [1]_: in white noise of standard deviation s it is
    ``sum d^2 / s^2``. The best detector that knows all of the difference has a deflection of its square root: 14 dB are
    a probability of detection of 0.99 at one false alarm in 200.

    Parameters
    ----------
    difference : (n,) array
        What the fault adds to the noise-free signal.
    noise_psd : float or (n // 2 + 1,) array
        One-sided, in units squared per Hz, at the frequencies of the discrete Fourier transform.
    rate_hz : float

    Returns
    -------
    float
        Infinite where there is no noise, minus infinite where there is no difference.

    Raises
    ------
    ValueError
        A spectral density below zero.

    References
    ----------
    .. [1] G. L. Turin, An introduction to matched filters, IRE Transactions on Information Theory 6 (1960) 311-329.

    Examples
    --------
    A line of amplitude 0.1 for 1000 samples in noise of standard deviation 1: ``1000 * 0.1**2 / 2``.

    >>> import numpy as np
    >>> from data_synth.transfer.detectability import matched_filter_snr_db
    >>> line = 0.1 * np.cos(2 * np.pi * 0.1 * np.arange(1000))
    >>> ratio_db = matched_filter_snr_db(line, noise_psd=2 / 1000, rate_hz=1000.0)
    >>> round(ratio_db, 3), round(float(10 * np.log10(5)), 3)
    (6.99, 6.99)
    """
    psd = np.asarray(noise_psd, dtype=np.float64)
    if np.any(psd < 0):
        raise ValueError(f"noise_psd has {psd.min():g}, but a spectral density is not below zero; give |.|^2.")
    lines = np.abs(np.fft.rfft(difference) / rate_hz) ** 2
    lines[0] /= 2
    if difference.size % 2 == 0:
        lines[-1] /= 2
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(lines > 0, lines / psd, 0.0)
        return float(10 * np.log10(4 * np.sum(ratios) * rate_hz / difference.size))
