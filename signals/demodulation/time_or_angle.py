r"""Whether a line of an envelope follows the machine's angle, or the clock as another machine at constant speed does.

While the speed wanders by some thousandths, a line that follows the shaft is narrow in angle and broad in time, and one
of another machine, or of the mains, the other way round. Both powers are those of a line with its harmonics where they
are largest, through a Hann window over the whole record: with e the envelope over its level, less one, and
:math:`\theta` the revolutions of the reference,

.. math::

    P_\text{angle} = \max_\delta \sum_{k=1}^{K} \Bigl|\sum_n w_n e_n
    e^{-2 \pi j k (o \theta_n + \delta t_n)}\Bigr|^2,

and :math:`P_\text{time}` the same with the frequency :math:`o \langle\dot\theta\rangle` in place of the order. At
a constant speed both are one.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._validation import positive, real_vector

__all__ = ["FEWEST_SAMPLES", "power_in_time_and_angle"]

FEWEST_SAMPLES = 512  # of an envelope: one a block
_BLOCKS = FEWEST_SAMPLES  # means of a line turned to zero frequency: one 60 bins off, the furthest, loses 2 % of itself
_LEVEL_BLOCKS = 8  # on either side that are the level: a thirtieth of the record
_FINE = 4  # places to a bin of the highest harmonic: the worst has lost 2 % of its power
_REACH_BINS = 2.5  # that a line may be beside its order: half the main lobe of a Hann window and half a bin
_FURTHEST_BINS = 60.0

Array = NDArray[np.float64]


def power_in_time_and_angle(
    envelope: ArrayLike, *, rate_hz: float, revolutions: ArrayLike, order: float, harmonics: int = 4
) -> tuple[float, float, float]:
    """Return the power of a line and its harmonics in time and in angle, and its frequency in time.

    Parameters
    ----------
    envelope : (n,) array
        Envelope at even times, any unit, above zero on average; at least 512 samples.
    rate_hz : float
        Its rate in Hz.
    revolutions : (n,) array
        Angle of the reference at the same times in rev, rising.
    order : float
        Of the line, above zero.
    harmonics : int
        Number of harmonics, the line itself among them, that are counted where the rate holds them.

    Returns
    -------
    in_time, in_angle : float
        Powers of one unit. NaN in time where the speed changes so far that no line of constant frequency is one in
        angle: by 60 bins of the record at this order.
    frequency_hz : float
        Where the line stands in time.

    Raises
    ------
    ValueError
        Too few samples, vectors of different lengths, a reference that does not turn on, or an order or rate that is
        not above zero.

    Examples
    --------
    A shaft of 20 rev/s that wanders by 0.3 %, and a line of another machine at 66 Hz:

    >>> import numpy as np
    >>> from signals.demodulation.time_or_angle import power_in_time_and_angle
    >>> t = np.arange(8000) / 800
    >>> turns = 20 * t + 0.1 * np.sin(2 * np.pi * 0.2 * t)
    >>> others = 1 + 0.3 * np.cos(2 * np.pi * 66 * t)
    >>> time, angle, hz = power_in_time_and_angle(others, rate_hz=800, revolutions=turns, order=3.3)
    >>> round(time / angle, 1), round(hz, 2)
    (2.9, 66.0)
    >>> own = 1 + 0.3 * np.cos(2 * np.pi * 3.3 * turns)
    >>> time, angle, _ = power_in_time_and_angle(own, rate_hz=800, revolutions=turns, order=3.3)
    >>> round(time / angle, 1)
    0.3
    """
    rate, first = positive(rate_hz, name="rate_hz"), positive(order, name="order")
    values, turns = (
        real_vector(each, name=name, minimum=_BLOCKS)
        for each, name in ((envelope, "envelope"), (revolutions, "revolutions"))
    )
    if values.size != turns.size or not turns[-1] > turns[0]:
        raise ValueError(
            f"revolutions has {turns.size} values from {turns[0]:g} to {turns[-1]:g}; as many as the envelope has, "
            f"{values.size}, are needed, and a shaft that turns on."
        )
    kept = values.size // _BLOCKS * _BLOCKS
    even, turns = _over_level(values[:kept]), turns[:kept]
    times_s = np.arange(kept) / rate
    steps = np.diff(turns[:: kept // _BLOCKS])
    mean_hz = (turns[-1] - turns[0]) / (times_s[-1] - times_s[0])
    spread_bins = first * float(np.ptp(steps)) * _BLOCKS / 2
    count = max(1, min(harmonics, math.floor(rate / 2 / (first * mean_hz))))
    in_angle, _ = _largest_power(even, first * turns, count, _REACH_BINS)
    if spread_bins > _FURTHEST_BINS:
        return math.nan, in_angle, math.nan
    reach = max(_REACH_BINS, spread_bins)
    in_time, offset_bins = _largest_power(even, first * mean_hz * times_s, count, reach)
    return in_time, in_angle, float(first * mean_hz + offset_bins * rate / kept)


def _over_level(values: Array) -> Array:
    """Return values over their slowly varying level, less one."""
    blocks = np.pad(values.reshape(_BLOCKS, -1).mean(axis=1), _LEVEL_BLOCKS, mode="edge")
    level = np.convolve(blocks, np.full(2 * _LEVEL_BLOCKS + 1, 1 / (2 * _LEVEL_BLOCKS + 1)), mode="valid")
    return np.asarray(values / np.repeat(level, values.size // _BLOCKS) - 1.0)


def _largest_power(values: Array, cycles: Array, harmonics: int, reach_bins: float) -> tuple[float, float]:
    """Return the largest power of a line and its harmonics within a reach of its cycles, and its distance in bins."""
    window, fine = np.hanning(_BLOCKS), _FINE * harmonics
    offsets = np.arange(-math.ceil(reach_bins * fine), math.ceil(reach_bins * fine) + 1)
    power = np.zeros(offsets.size)
    for harmonic in range(1, harmonics + 1):
        turned = values * np.exp(-2j * np.pi * harmonic * cycles)
        spectrum = np.fft.fft(turned.reshape(_BLOCKS, -1).mean(axis=1) * window, fine * _BLOCKS)
        power += np.abs(spectrum[harmonic * offsets % spectrum.size]) ** 2
    best = int(np.argmax(power))
    return float(power[best]), float(offsets[best] / fine)
