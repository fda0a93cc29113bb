"""How detectable a fault is: the energy it adds over the noise of the healthy record, in dB."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["energy_over_noise_db"]

Array = NDArray[np.float64]

_SEGMENT = 2048
_NEIGHBOURS = 65  # lines of a spectrum: wide enough that harmonics and sidebands do not reach the median


def energy_over_noise_db(added: Array, healthy: Array, *, times: float = 1.0) -> float:
    """Return ``10 log10 sum_k |D_k|^2 / N_k``: the output signal-to-noise ratio of a matched filter.

    D is the spectrum of what the fault adds and N that of the noise, so 0 dB is one standard deviation of white noise
    (Turin 1960, IRE Trans. Inf. Theory 6, 311-329). N is the median of 65 neighbouring lines of the averaged spectrum
    of the healthy record, which lines of the gears do not reach.

    Parameters
    ----------
    added : (n,) array
        Faulty minus healthy record.
    healthy : (n,) array
    times : float
        The energy is multiplied by this: length of the whole record over that of these.

    Returns
    -------
    float
        In dB; minus infinity where nothing is added.

    Examples
    --------
    A sine of amplitude 1 for 10,000 samples in noise of variance 1: 10 log10 5000 = 37 dB.

    >>> import numpy as np
    >>> from data_synth.benchmark.detectability import energy_over_noise_db
    >>> noise = np.random.default_rng(1).standard_normal(10000)
    >>> round(energy_over_noise_db(np.sin(np.arange(10000)), noise))
    37
    """
    from scipy.ndimage import median_filter  # noqa: PLC0415
    from scipy.signal import welch  # noqa: PLC0415

    if not np.any(added):
        return float("-inf")
    segment = min(_SEGMENT, healthy.size)
    _, noise = welch(healthy, window="hann", nperseg=segment)
    frequency, power = welch(added, window="hann", nperseg=segment, detrend=False)
    floor = median_filter(noise, size=_NEIGHBOURS, mode="nearest")
    # one-sided densities per unit of a rate of 1: white noise of variance 1 has 2
    energy = 2 * added.size * times * np.sum(power / floor) * (frequency[1] - frequency[0])
    return float(10 * np.log10(energy))
