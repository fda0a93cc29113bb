"""Compiled loops over the lines of a spectrum: medians of the points beside each, its probability and leakage."""

import math

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Array = NDArray[np.float64]
Places = NDArray[np.int64]

FEWEST_BINS = 8  # beside a line
# measured: the median power of Hann- or box-windowed noise has the variance of the mean of this many independent bins,
# per bin and equivalent noise bandwidth
_MEDIAN_EFFICIENCY = 0.52
_SIGNIFICANT = 3.0  # standard deviations: in flat noise the closer background exceeds them once in some hundred lines
_LINE = 4.0  # times the median amplitude: noise exceeds it at one point of 65,000 (2^-16)
_SAMPLES, _APART = 128, 16  # of a window, and ranks on either side of their median: 2.8 standard deviations of it
_SAMPLED = 4  # points a sample, from which looking at samples first is worth while


@compiled
def _select(values: Array, count: int, rank: int) -> float:
    """Return the value of a rank among the first `count`, which are moved so that no earlier one is larger.

    Quickselect (Hoare 1961, Communications of the ACM 4, 321-322) without branches in its loops: in noise every second
    one would be mispredicted.
    """
    left, right = 0, count - 1
    while left < right:
        a, b, c = values[left], values[(left + right) // 2], values[right]
        pivot = max(min(a, b), min(max(a, b), c))
        split = left
        for n in range(left, right + 1):
            value = values[n]
            values[n] = values[split]
            values[split] = value
            split += value < pivot
        if rank < split:
            right = split - 1
            continue
        left = split
        for n in range(left, right + 1):
            value = values[n]
            values[n] = values[split]
            values[split] = value
            split += value <= pivot
        if rank < split:
            break
        left = split
    return float(values[rank])


@compiled
def _bounds(points: Array, window: Places, count: int, work: Array) -> tuple[float, float]:
    """Return values between which the median of a window of so many points almost certainly lies."""
    if count < _SAMPLED * _SAMPLES:
        return 0.0, np.inf
    taken, every = 0, count // _SAMPLES
    for part in range(0, 4, 2):
        for n in range(window[part], window[part + 1], every):
            work[taken] = points[n]
            taken += 1
    high = _select(work, taken, min(taken // 2 + _APART, taken - 1))
    return _select(work, taken, max(taken // 2 - _APART, 0)), high


@compiled
def _between(points: Array, window: Places, low: float, high: float, work: Array) -> tuple[int, int]:
    """Copy the points of a window from `low` to `high`; return how many lie below them, and how many they are."""
    inside = below = 0
    for part in range(0, 4, 2):
        own = points[window[part] : window[part + 1]]
        for n in range(own.size):
            work[inside] = own[n]
            inside += (own[n] >= low) & (own[n] <= high)
        for n in range(own.size):
            below += own[n] < low
    return below, inside


@compiled
def _middle(work: Array, below: int, inside: int, count: int) -> float:
    """Return the median of the lowest `count` points of a window, -1 where it is not among those copied."""
    rank = count // 2 - below
    if rank >= inside or rank < 1 - count % 2:
        return -1.0
    upper = _select(work, inside, rank)
    if count % 2:
        return upper
    lower = work[0]
    for n in range(rank):
        lower = max(lower, work[n])
    return float((lower + upper) / 2)


@compiled
def _count(values: Array, limit: float) -> int:
    """Return how many values are at most `limit`."""
    count = 0
    for n in range(values.size):
        count += values[n] <= limit
    return count


@compiled
def _at_most(points: Array, window: Places, limit: float) -> int:
    """Return how many points of a window are at most `limit`."""
    return _count(points[window[0] : window[1]], limit) + _count(points[window[2] : window[3]], limit)


@compiled
def medians(points: Array, window: Places, work: Array) -> tuple[float, float, int]:
    """Return the median, that of the points at most `_LINE` times as large, and their number.

    Larger points are taken for lines; they would raise the median and hide weak lines beside them.

    Parameters
    ----------
    points : (n,) array, not negative.
    window : (4,) array, first point and the one after the last below a line, and above it.
    work : array at least as long as the window.
    """
    count = window[1] - window[0] + window[3] - window[2]
    if not count:
        return 0.0, 0.0, 0
    low, high = _bounds(points, window, count, work)
    below, inside = _between(points, window, low, high, work)
    median = _middle(work, below, inside, count)
    if median < 0:
        below, inside = _between(points, window, 0.0, np.inf, work)
        median = _middle(work, below, inside, count)
    kept = _at_most(points, window, _LINE * median)
    quiet = _middle(work, below, inside, kept)
    if quiet < 0:
        below, inside = _between(points, window, 0.0, np.inf, work)
        quiet = _middle(work, below, inside, kept)
    return median, quiet, kept


@compiled
def chance(power_ratio: float, width_bins: float, spread: float, degrees: float) -> float:
    """Return `signals.spectra.lines.false_alarm_probability`."""
    shrink = math.log1p(power_ratio / degrees)
    at_edge = math.exp(-degrees * shrink)
    rate = 2 * math.pi * math.sqrt(spread * power_ratio / math.pi)
    half_moment = math.exp(math.lgamma(degrees + 0.5) - math.lgamma(degrees)) / math.sqrt(degrees)
    crossings = width_bins * rate * half_moment * math.exp(-(degrees + 0.5) * shrink)
    return -math.expm1(-(at_edge + crossings))


@compiled
def _significant(noise: float, bins: float, bandwidth: float) -> float:
    """Return the median amplitude of so many bins from which it is significantly above `noise`."""
    scatter = 1 / math.sqrt(_MEDIAN_EFFICIENCY * max(bins, 1.0) / bandwidth)
    return math.sqrt(1 + _SIGNIFICANT * scatter) * noise


@compiled
def weigh(
    points: Array, wide: Places, close: Places, per_point: float, bandwidth: float, spread: float, lines: Array
) -> None:
    """Weigh lines against the points beside them, and against those closer where these are significantly larger.

    Parameters
    ----------
    points : (n,) array, a spectrum.
    wide, close : (line, 4) arrays, windows as of `medians`; a close one may be empty.
    per_point : float, bins from one point to the next.
    bandwidth, spread : float, of the window.
    lines : (line, 8) array, amplitude and width of the searched band in bins, and to be filled the median of the wide
        window, that without lines, its bins, the noise to which the probability refers, its degrees of freedom, and the
        probability.
    """
    longest = 0
    for n in range(len(wide)):
        longest = max(longest, wide[n, 3] - wide[n, 0], close[n, 3] - close[n, 0])
    work = np.empty(longest + 1)
    for n in range(len(lines)):
        background, quiet, kept = medians(points, wide[n], work)
        noise, bins = quiet, kept * per_point
        size = close[n, 1] - close[n, 0] + close[n, 3] - close[n, 2]
        # fewer bins, without lines, scatter more
        if size and 2 * _at_most(points, close[n], _significant(noise, size * per_point, bandwidth)) <= size:
            _, near, near_kept = medians(points, close[n], work)
            near_bins = near_kept * per_point
            if near_bins >= FEWEST_BINS and near > _significant(noise, near_bins, bandwidth):
                noise, bins = near, near_bins
        degrees = _MEDIAN_EFFICIENCY * bins / bandwidth
        amplitude = lines[n, 0]
        probability = 0.0 if amplitude > 0 else 1.0
        if noise > 0:
            probability = chance((amplitude / noise) ** 2 * math.log(2), lines[n, 1], spread, degrees)
        lines[n, 2], lines[n, 3], lines[n, 4] = background, quiet, kept * per_point
        lines[n, 5], lines[n, 6], lines[n, 7] = noise, degrees, probability


@compiled
def largest(points: Array, first: Places, last: Places, tops: Places) -> None:
    """Find the place of the largest point of each range."""
    for line in range(tops.size):
        top = first[line]
        for n in range(first[line] + 1, last[line]):
            if points[n] > points[top]:
                top = n
        tops[line] = top


@compiled
def leakage(points: Array, place: float, first: int, last: int, least: float, lobes: Array, per_point: float) -> float:
    """Return the largest share that the window spreads to `place` from the points above `least` in a range.

    `lobes` are the relative heights of the window's transform from its middle on, `per_point` of them from one point of
    the spectrum to the next.
    """
    found = 0.0
    for n in range(first, last):
        if points[n] > least:
            at = min(abs(n - place) * per_point, lobes.size - 1.0)
            left = min(int(at), lobes.size - 2)
            found = max(found, points[n] * (lobes[left] + (at - left) * (lobes[left + 1] - lobes[left])))
    return found
