r"""Whether a line of an envelope is locked to the shaft, or to time like a line of another machine at constant speed.

If the speed varies by a few parts in a thousand, a line locked to the shaft is narrow in angle and broad in time; a
line of another machine, or of the mains, is the reverse. Both powers are the largest ones of a line with its harmonics,
with a Hann window over the whole record: with e the envelope over its level, less one, and :math:`\theta` the
revolutions of the reference,

.. math::

    P_\text{angle} = \max_\delta \sum_{k=1}^{K} \Bigl|\sum_n w_n e_n
    e^{-2 \pi j k (o \theta_n + \delta t_n)}\Bigr|^2,

and :math:`P_\text{time}` is the same with a frequency instead of the order. At constant speed they are equal. A line in
time can account for the line in angle only if it contributes as much power there. Harmonic k contributes

.. math::

    P_{\text{time},k} \Bigl|\sum_n w_n e^{2 \pi j k (f t_n - o \theta_n)} \Bigr|^2 \Big/ \Bigl(\sum_n w_n\Bigr)^2.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._validation import positive, real_vector

FEWEST_SAMPLES = 512  # of an envelope
_LEVEL_BLOCKS, _LEVEL_SIDE = 512, 8  # blocks, and those averaged on either side: a thirtieth of the record
_REACH_BINS = 2.5  # by which a line may be off its order: half the main lobe of a Hann window and half a bin

Array = NDArray[np.float64]


class LinePower(NamedTuple):
    """Power of a line and its harmonics, relative to the squared level of the envelope.

    Attributes
    ----------
    in_angle : float
        Power at the order.
    in_time : float
        Power at the frequency; NaN if the speed changes so much (500 bins of the record at this order on either side of
        the middle) that no line of constant frequency could appear as one in angle.
    left_in_angle : float
        Power that the line at the frequency contributes at the order.
    frequency_hz : float
        Frequency of the line in time, in Hz.
    """

    in_angle: float
    in_time: float = math.nan
    left_in_angle: float = math.nan
    frequency_hz: float = math.nan


def power_in_time_and_angle(
    envelope: ArrayLike, *, rate_hz: float, revolutions: ArrayLike, order: float, harmonics: int = 4
) -> LinePower:
    """Return the power of a line and its harmonics in angle and in time.

    Parameters
    ----------
    envelope : (n,) array
        Envelope at uniform times, any unit, above zero on average; at least 512 samples.
    rate_hz : float
        Its sampling rate in Hz.
    revolutions : (n,) array
        Angle of the reference at the same times in revolutions, rising.
    order : float
        Order of the line, above zero.
    harmonics : int
        Number of harmonics included, counting the line itself, as far as the sampling rate permits.

    Returns
    -------
    LinePower

    Raises
    ------
    ValueError
        Too few samples, vectors of different lengths, a reference that does not turn forwards, or an order or rate that
        is not above zero.

    Examples
    --------
    A shaft at 20 rev/s whose speed varies by 0.6 %, and a line of another machine at 66 Hz:

    >>> import numpy as np
    >>> from signals.demodulation.time_or_angle import power_in_time_and_angle
    >>> t = np.arange(8000) / 800
    >>> turns = 20 * t + 0.1 * np.sin(2 * np.pi * 0.2 * t)
    >>> others = 1 + 0.3 * np.cos(2 * np.pi * 66 * t)
    >>> of_others = power_in_time_and_angle(others, rate_hz=800, revolutions=turns, order=3.3)
    >>> round(of_others.in_time / of_others.in_angle, 1), round(of_others.frequency_hz, 2)
    (3.0, 66.0)
    >>> own = 1 + 0.3 * np.cos(2 * np.pi * 3.3 * turns)
    >>> of_own = power_in_time_and_angle(own, rate_hz=800, revolutions=turns, order=3.3)
    >>> round(of_own.in_time / of_own.in_angle, 1)
    0.3
    """
    rate, first = positive(rate_hz, name="rate_hz"), positive(order, name="order")
    values, turns = (
        real_vector(each, name=name, minimum=FEWEST_SAMPLES)
        for each, name in ((envelope, "envelope"), (revolutions, "revolutions"))
    )
    if values.size != turns.size or not turns[-1] > turns[0]:
        raise ValueError(
            f"revolutions has {turns.size} values from {turns[0]:g} to {turns[-1]:g}; give {values.size} rising ones, "
            "one for each sample of the envelope."
        )
    even, times_s = _over_level(values), np.arange(values.size) / rate
    starts = _edges(values.size, _LEVEL_BLOCKS)[:-1]
    speeds_hz = rate * np.diff(turns[starts]) / np.diff(starts)
    slowest_hz, fastest_hz = float(speeds_hz.min()), float(speeds_hz.max())
    middle_hz, spread_bins = (slowest_hz + fastest_hz) / 2, first * (fastest_hz - slowest_hz) / 2 * values.size / rate
    count = max(1, min(harmonics, math.floor(rate / 2 / (first * fastest_hz))))
    in_angle, angle_off = _largest_power(even, first * turns, count, _REACH_BINS)
    furthest_bins = 500.0  # by which the line moves with the speed: 20 ms for a line and its harmonics
    if spread_bins > furthest_bins:
        return LinePower(float(in_angle.sum()))
    in_time, time_off = _largest_power(even, first * middle_hz * times_s, count, max(_REACH_BINS, spread_bins))
    bin_hz = rate / values.size
    frequency_hz = first * middle_hz + time_off * bin_hz
    apart = (frequency_hz - angle_off * bin_hz) * times_s - first * turns
    window = np.hanning(values.size)
    left = [
        power * abs(window @ np.exp(2j * np.pi * harmonic * apart)) ** 2 / window.sum() ** 2
        for harmonic, power in enumerate(in_time, start=1)
    ]
    return LinePower(float(in_angle.sum()), float(in_time.sum()), float(np.sum(left)), float(frequency_hz))


def _edges(size: int, blocks: int) -> NDArray[np.int_]:
    """Return the start of each of nearly equal blocks, and the end of the last."""
    return np.linspace(0, size, blocks + 1).astype(np.int_)


def _means(values: NDArray[np.inexact], blocks: int) -> NDArray[np.inexact]:
    edges = _edges(values.size, blocks)
    return np.asarray(np.add.reduceat(values, edges[:-1]) / np.diff(edges))


def _over_level(values: Array) -> Array:
    """Return values over their slowly varying level, less one."""
    means = np.pad(_means(values, _LEVEL_BLOCKS), _LEVEL_SIDE, mode="edge")
    level = np.convolve(means, np.full(2 * _LEVEL_SIDE + 1, 1 / (2 * _LEVEL_SIDE + 1)), mode="valid")
    # at least 0.05 of the mean, since a level near zero would amplify the noise of a gap
    level = np.maximum(level, 0.05 * max(float(means.mean()), np.finfo(float).tiny))
    return np.asarray(values / np.repeat(level, np.diff(_edges(values.size, _LEVEL_BLOCKS))) - 1.0)


def _largest_power(values: Array, cycles: Array, harmonics: int, reach_bins: float) -> tuple[Array, float]:
    """Return the largest powers of a line and its harmonics within reach of its cycles, and the offset in bins."""
    # 8 blocks per bin of offset, whose averaging loses 2 % of the line
    needed = 2 ** math.ceil(math.log2(8 * harmonics * reach_bins))
    fewest_blocks = 512
    # 4 points per bin of the highest harmonic, at worst a loss of 2 % of its power
    blocks, fine = min(max(fewest_blocks, needed), values.size), 4 * harmonics
    offsets = np.arange(-math.ceil(reach_bins * fine), math.ceil(reach_bins * fine) + 1)
    window, powers = np.hanning(blocks) / blocks, np.zeros((harmonics, offsets.size))
    for harmonic, power in enumerate(powers, start=1):
        turned = values * np.exp(-2j * np.pi * harmonic * cycles)
        spectrum = np.fft.fft(_means(turned, blocks) * window, fine * blocks)
        power[:] = np.abs(spectrum[harmonic * offsets % spectrum.size]) ** 2
    best = int(np.argmax(powers.sum(axis=0)))
    return powers[:, best], float(offsets[best] / fine)
