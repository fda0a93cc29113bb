"""Detection of intervals between pulses that are too long or too short for those of the same stripe around them."""

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array

Counts = NDArray[np.int64]

PERIODS = 5  # intervals on either side that an interval is compared with, each a revolution further
_GAP = 1.7  # a missing pulse merges two intervals: at least this many times the mean of those around it,
_GAP_EITHER = 1.2  # and longer than those of either side alone, which tells it from a deceleration
_PAIR = 1.4  # an extra pulse divides an interval: both parts together are below this, two sound ones about 2
_SHORT = 0.6
_DOUBTFUL = 8.0  # median deviations; the search leaves out no pulse that is off by less than about 16
_NEVER_DOUBTFUL, _ALWAYS_DOUBTFUL = 0.02, 0.25  # of the interval


def period_of(intervals: Array, stripes: int) -> int:
    """Return the distance, in intervals, of those to compare: a revolution, or 1 in a short record."""
    return stripes if intervals.size >= PERIODS * stripes else 1


def long_intervals(intervals: Array, most: Array) -> Counts:
    """Return the indices of intervals too long for their neighbours: pulses are missing in them."""
    return np.flatnonzero((intervals > _GAP * most.mean(axis=0)) & (intervals > _GAP_EITHER * most.max(axis=0)))


def short_intervals(intervals: Array, least: Array) -> NDArray[np.bool_]:
    """Return whether each interval is too short for its neighbours, as an extra pulse makes it.

    An extra pulse shifts the index of every later interval by one. The two parts of a divided interval are therefore
    compared with the interval expected at the first index from before, and at the second from after, which holds for
    uneven stripes too.
    """
    short = intervals < _SHORT * least.min(axis=0)
    halves = np.flatnonzero(intervals[:-1] + intervals[1:] < _PAIR * np.minimum(least[0, :-1], least[1, 1:]))
    short[np.where(intervals[halves] <= intervals[halves + 1], halves, halves + 1)] = True
    return np.asarray(short)


def doubtful_intervals(intervals: Array, least: Array, most: Array) -> NDArray[np.bool_]:
    """Return whether each interval deviates from the expected one by far more than the median interval does."""
    deviation = np.abs(intervals / ((least + most).mean(axis=0) / 2) - 1)
    limit = np.clip(_DOUBTFUL * np.nanmedian(deviation), _NEVER_DOUBTFUL, _ALWAYS_DOUBTFUL)
    return np.asarray(~(deviation <= limit))  # NaN, an unknown deviation, is doubtful


def expected_intervals(intervals: Array, *, period: int) -> tuple[Array, Array]:
    """Return the least and greatest length expected of each, from those before (row 0) and after (row 1), (2, n) each.

    They differ only in the first and last period, where one side stands for both: by its median and by extrapolation.
    """
    n = intervals.size
    sides = [_periods_away(intervals, period=-period), _periods_away(intervals, period=period)]
    expected = np.stack([_median(side) for side in sides])
    least, most = expected.copy(), expected.copy()
    for side, end in ((1, slice(0, period)), (0, slice(n - period, n))):
        extrapolated = _extrapolated(sides[side][end])
        least[:, end] = np.minimum(expected[side, end], extrapolated)
        most[:, end] = np.maximum(expected[side, end], extrapolated)
    return least, most


def _periods_away(intervals: Array, *, period: int) -> Array:
    """Return the intervals 1, 2, ... periods away from each, (n, PERIODS), NaN beyond the ends."""
    index = np.arange(intervals.size)[:, None] + period * np.arange(1, PERIODS + 1)
    inside = (index >= 0) & (index < intervals.size)
    return np.where(inside, intervals[np.where(inside, index, 0)], np.nan)


def _extrapolated(away: Array) -> Array:
    """Return intervals (m,) extrapolated from those 1, 2, ... periods away (m, PERIODS), NaN for fewer than three.

    At a constant acceleration the squared speed is linear in the angle; where it would fall below zero the shaft may
    stop, and the interval is infinite.
    """
    squared_speed = away**-2
    change = _median(np.diff(squared_speed, axis=1))
    periods = np.count_nonzero(np.isfinite(away), axis=1)
    extrapolated = _median(squared_speed) - change * (1 + periods) / 2
    with np.errstate(divide="ignore"):
        length = np.maximum(extrapolated, 0.0) ** -0.5
    return np.where(periods >= 3, length, np.nan)  # noqa: PLR2004


def _median(rows: Array) -> Array:
    """Return the median of each row without its NaN; NaN for a row of nothing else."""
    ordered = np.sort(rows, axis=1)  # NaN last
    filled = np.count_nonzero(np.isfinite(rows), axis=1)
    middle = np.stack([(filled - 1) // 2, filled // 2], axis=1)
    return np.asarray(np.take_along_axis(ordered, middle, axis=1).mean(axis=1))
