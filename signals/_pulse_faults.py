"""Intervals between pulses that are too long or too short, held against those of the same stripe around them."""

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array

Counts = NDArray[np.int64]

LAPS = 5  # intervals on either side that an interval is judged by, each a revolution further
_GAP = 1.7  # a missing pulse makes one interval of two: this many times those around it,
_GAP_BESIDE = 1.2  # and longer than either side alone, which slowing down is not
_PAIR = 1.4  # an extra pulse makes two intervals of one: together below this, where two sound ones are about 2
_SHORT = 0.6
_OUTSTANDING = 8.0  # median deviations; a search gives up no pulse that is less than some 16 off
_SLIGHTLY_OFF, _WELL_OFF = 0.02, 0.25  # of the interval: never doubtful, and always


def lap_of(intervals: Array, stripes: int) -> int:
    """Return how many intervals on the one to hold an interval against stands: a revolution, or the next."""
    return stripes if intervals.size >= LAPS * stripes else 1


def gaps_in(intervals: Array, most: Array) -> Counts:
    """Return the intervals that are too long."""
    return np.flatnonzero((intervals > _GAP * most.mean(axis=0)) & (intervals > _GAP_BESIDE * most.max(axis=0)))


def shorts_in(intervals: Array, least: Array) -> NDArray[np.bool_]:
    """Return whether each interval is too short.

    An extra pulse moves every later one on by a stripe. So two parts of one interval add up to what stood in place of
    the first part before, and of the second after, however uneven the stripes; and a gap is the stripe's interval as
    it was before plus the one that stands in its place after.
    """
    short = intervals < _SHORT * least.min(axis=0)
    halves = np.flatnonzero(intervals[:-1] + intervals[1:] < _PAIR * np.minimum(least[0, :-1], least[1, 1:]))
    short[np.where(intervals[halves] <= intervals[halves + 1], halves, halves + 1)] = True
    return np.asarray(short)


def doubtful_in(intervals: Array, least: Array, most: Array) -> NDArray[np.bool_]:
    """Return whether each interval is off what is usual around it by more than most are."""
    off = np.abs(intervals / ((least + most).mean(axis=0) / 2) - 1)
    ordinary = np.clip(_OUTSTANDING * np.nanmedian(off), _SLIGHTLY_OFF, _WELL_OFF)
    return np.asarray(~(off <= ordinary))  # what cannot be told is doubtful


def usual_intervals(intervals: Array, *, lap: int) -> tuple[Array, Array]:
    """Return the least and the most that each is to be by those before (row 0) and after it (row 1), (2, n) each.

    The two differ where only one side is there, which then stands for both: its median, and its value carried on.
    """
    n = intervals.size
    sides = [_laps_away(intervals, lap=-lap), _laps_away(intervals, lap=lap)]
    usual = np.stack([_median(side) for side in sides])
    least, most = usual.copy(), usual.copy()
    for here, bare in ((1, slice(0, lap)), (0, slice(n - lap, n))):
        carried = _carried_on(sides[here][bare])
        least[:, bare] = np.minimum(usual[here, bare], carried)
        most[:, bare] = np.maximum(usual[here, bare], carried)
    return least, most


def _laps_away(intervals: Array, *, lap: int) -> Array:
    """Return the intervals 1, 2, ... laps away from each, (n, LAPS), NaN beyond the ends."""
    places = np.arange(intervals.size)[:, None] + lap * np.arange(1, LAPS + 1)
    inside = (places >= 0) & (places < intervals.size)
    return np.where(inside, intervals[np.where(inside, places, 0)], np.nan)


def _carried_on(away: Array) -> Array:
    """Length of the intervals (m,) from those 1, 2, ... laps away (m, LAPS), NaN for fewer than three.

    At a constant acceleration the square of the speed changes evenly with the angle; where it would fall below
    zero the shaft may stop, and no interval is too long.
    """
    squared_speed = away**-2
    change = _median(np.diff(squared_speed, axis=1))
    laps = np.count_nonzero(np.isfinite(away), axis=1)
    carried = _median(squared_speed) - change * (1 + laps) / 2
    with np.errstate(divide="ignore"):
        length = np.maximum(carried, 0.0) ** -0.5
    return np.where(laps >= 3, length, np.nan)  # noqa: PLR2004


def _median(rows: Array) -> Array:
    """Median of each row without its NaN; NaN for a row of nothing else."""
    ordered = np.sort(rows, axis=1)  # NaN last
    filled = np.count_nonzero(np.isfinite(rows), axis=1)
    middle = np.stack([(filled - 1) // 2, filled // 2], axis=1)
    return np.asarray(np.take_along_axis(ordered, middle, axis=1).mean(axis=1))
