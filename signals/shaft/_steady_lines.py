"""Doubt about a speed whose lines keep one frequency: a tone and its harmonics are no shaft.

Lines that move together in the ratios of the drawing are of nothing else. Lines that stay may be the mains, electronics
or another machine: one tone with harmonics explains any two or three of them that are whole multiples of one frequency,
at any speed that puts two listed orders there. What speaks for a steady speed is therefore what a tone does not have:
lines of several families of harmonics, the sidebands at the shaft's turning among them, whose frequencies over the
whole record are in the ratios of their orders.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from signals.shaft._angle_spectrum import in_angle
from signals.shaft._speed_search import (
    MAINS_HARMONICS,
    MAINS_HZ,
    SAME_LINE,
    SHOWS,
    Search,
    is_low,
    leakage_bins,
    search_speeds,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals._validation import Array
    from signals.shaft.phase import ShaftPhase

_FRAME = 0.4  # of the record: four frames
_MOVING = 0.03  # range of the speed, relative, from which on the lines cross bins of the search itself
_BEYOND_NOISE = 16.0  # mean square of the changes of a speed over their variance: four standard deviations
_NARROWER = 2.0  # gain in power of lines along a course that they follow: at a constant speed half is lost or more
_STILL_HZ_S = 1e-6
_HARMONICS = 7  # of one tone, as of the mains
_SIDES = (-2, -1, 1, 2)
_MOST_HUM = 0.5  # of the orders, where all show
_FEWEST_FAMILIES = 3  # two unrelated tones fall on two of a dozen orders of some speed in one record of twenty
_PEAK_BINS, _AROUND_BINS = 3, 40  # of the whole record
# bins times the root of the median beside a peak over it: 2.4 of the 0.7 standard deviations that a Monte Carlo shows
_PEAK_BINS_ERROR = 1.65
_PARABOLA_BINS = 0.1  # more than the bias of a parabola through the logarithms of three bins of a Hann window


def one_tone(signal: Array, rate: float, phase: ShaftPhase, std: Array, orders: Array) -> bool:
    """Return whether a sure speed rests on lines that keep one frequency and may be one tone with its harmonics.

    `std` is the standard deviation of the speed at even times of the phase. A drawing all of whose lines show is taken
    for its shaft, unless they are at harmonics of the mains.
    """
    times = np.linspace(phase.start_s, phase.stop_s, std.size)
    speed = phase.speed_hz(times)
    if np.ptp(speed) > _MOVING * speed.mean():
        return False
    frame_s = _FRAME * float(phase.stop_s - phase.start_s)
    listed = orders[orders * speed.max() < rate / 2]
    searched = np.unique(np.concatenate([listed, *(listed[~is_low(listed)] + side for side in _SIDES)]))
    searched = searched[(searched > 0) & (searched * speed.max() < rate / 2)]
    part = signal[max(int(phase.start_s * rate), 0) : int(phase.stop_s * rate) + 1]
    margin = SAME_LINE / (frame_s * float(listed[-1]))
    search = search_speeds(part, rate, searched, speed.min() - margin, speed.max() + margin, _STILL_HZ_S, frame_s)
    constant = float(search.speeds[np.argmax(search.votes.sum(axis=0))])
    every = np.ones(search.votes.shape[0], dtype=np.bool_)
    scores = search.score(np.full(every.size, constant), every)
    shown = _own_lines(search, constant, scores)
    weights = 1 / np.maximum(std, 1e-12) ** 2
    mean = float(np.average(speed, weights=weights))
    if np.mean((speed - mean) ** 2 * weights) > _BEYOND_NOISE:
        values, _ = in_angle(signal, rate, phase, float(searched[-1]))
        seconds = part.size / rate
        lines = searched[shown & (searched * float(np.ptp(speed)) * seconds > _PEAK_BINS)]  # that would be wider
        along = _peaks(values, lines * float(np.ptp(phase.revolutions)))
        if along.sum() > _NARROWER * _peaks(part, lines * constant * seconds).sum():
            return False
    hum = _hum(searched * constant, frame_s)
    seen = np.isin(orders, searched[shown])
    if seen.all() and np.mean(_hum(orders * constant, frame_s)) < _MOST_HUM:
        return False
    shown &= ~hum
    return _families(_in_tune(part, rate, searched[shown], constant), constant * frame_s) < _FEWEST_FAMILIES


def _power(values: Array) -> Array:
    """Return the power in each bin of the whole record, less its mean, in a Hann window."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(values.size) + 0.5) / values.size)
    return np.asarray(np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2)


def _peaks(values: Array, bins: Array) -> Array:
    """Return the highest power near each place, in bins of the whole record, in a Hann window."""
    power = _power(values) / values.size**2 + np.finfo(float).tiny
    lows = np.clip(np.rint(bins).astype(np.int64) - _PEAK_BINS, 1, power.size - 2)
    return np.array([power[low : low + 2 * _PEAK_BINS + 1].max() for low in lows])


def _in_tune(signal: Array, rate: float, orders: Array, speed_hz: float) -> Array:
    """Return the orders whose peaks over the whole record are in their ratio, as those of unrelated lines are not.

    The speed is the mean by the information of the peaks; the order farthest from it is left out until all are within
    the error of their peaks.
    """
    power = _power(signal)
    at, error = np.zeros(orders.size), np.zeros(orders.size)
    for k, order in enumerate(orders):
        middle = round(order * speed_hz * signal.size / rate)
        low = max(middle - _PEAK_BINS, 1)
        peak = low + int(np.argmax(power[low : middle + _PEAK_BINS + 1]))
        around = power[max(peak - _AROUND_BINS, 0) : peak + _AROUND_BINS + 1]
        left, top, right = np.log(power[peak - 1 : peak + 2] + np.finfo(float).tiny)
        at[k] = peak + 0.5 * (left - right) / (left - 2 * top + right)
        error[k] = _PARABOLA_BINS + _PEAK_BINS_ERROR * np.sqrt(float(np.median(around)) / power[peak])
    kept = np.ones(orders.size, dtype=np.bool_)
    while kept.any():
        weights = (1 / error**2)[kept]
        per_order = float((weights * orders[kept] * at[kept]).sum() / (weights * orders[kept] ** 2).sum())
        off = np.where(kept, np.abs(at - orders * per_order) / error, 0.0)
        if off.max() <= 1:
            break
        kept[np.argmax(off)] = False
    return orders[kept]


def _own_lines(search: Search, speed_hz: float, scores: Array) -> NDArray[np.bool_]:
    """Return which orders show a line of their own, not the leakage of a stronger one."""
    bins = search.orders * speed_hz * search.frame_s
    apart = np.abs(bins[:, None] - bins)
    levels = search.line_level(speed_hz)
    stronger = (levels > levels[:, None]) & (apart <= leakage_bins(search, speed_hz))
    return np.asarray((scores > SHOWS) & ~stronger.any(axis=1))


def _hum(frequencies_hz: Array, frame_s: float) -> NDArray[np.bool_]:
    """Return which frequencies are harmonics of the mains within the resolution of a frame."""
    mains = np.array([number * mains for mains in MAINS_HZ for number in range(1, MAINS_HARMONICS + 1)])
    return np.asarray(np.abs(frequencies_hz[:, None] - mains).min(axis=1) * frame_s <= SAME_LINE)


def _families(orders: Array, bins_per_order: float) -> int:
    """Return how many families explain all lines; one is of whole multiples, up to seven, of one frequency."""
    left, count = orders, 0
    while left.size:
        fundamentals = np.unique(left[:, None] / np.arange(1, _HARMONICS + 1))
        multiple = np.clip(np.rint(left / fundamentals[:, None]), 1, _HARMONICS)
        member = np.abs(left - multiple * fundamentals[:, None]) * bins_per_order <= SAME_LINE
        left = left[~member[np.argmax(member.sum(axis=1))]]
        count += 1
    return count
