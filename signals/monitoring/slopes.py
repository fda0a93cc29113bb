"""How much many series of the same records change with time: Kendall's rank correlation and the Theil-Sen slope.

All series at once: pairs of records are compared in arrays, where a call for each series takes longer than its numbers.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.trends import FEWEST

__all__ = ["Slopes", "kendall", "series_slopes", "theil_sen"]

Array = NDArray[np.float64]
_CONFIDENCE_Z = 1.959963984540054  # normal quantile of 0.975
_MOST_POINTS = 100  # of the Theil-Sen slope, whose cost grows with the square
_EXACT = 33  # records up to which p is that of all orders (the normal approximation is within 1e-3 of it beyond)
_BLOCK = 512  # records compared pair by pair; between blocks pairs are counted by merging them
_AT_ONCE = 2**17  # numbers of a piece that stays in the processor's cache


@dataclass(frozen=True, kw_only=True)
class Slopes:
    """Change of series over time; NaN for a series with fewer than 5 values or equal ones.

    Attributes
    ----------
    points : (series,) array
        Number of finite values.
    median, first, last : (series,) array
        Median of all values, of the first third and of the last.
    slope, slope_low, slope_high : (series,) array
        Median slope of all pairs (Theil 1950, Sen 1968, J. Am. Stat. Assoc. 63, 1379-1389) and the ends of its 95 %
        confidence interval, in units of the values per unit of time. Above 100 values, the pairs are those of the
        medians of at most 100 consecutive groups.
    tau : (series,) array
        Kendall's rank correlation of value and time (tau-b): 1 for a series that rises throughout.
    p_value : (series,) array
        Probability of a tau at least this far from zero if the values are exchangeable in time.
    """

    points: NDArray[np.int64]
    median: Array
    first: Array
    last: Array
    slope: Array
    slope_low: Array
    slope_high: Array
    tau: Array
    p_value: Array


def series_slopes(values: Array, times: Array) -> Slopes:
    """Return the changes of the finite `values` (records, series) over `times` (records,)."""
    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order])]
    x, y = times[order], np.asarray(values[order], dtype=np.float64)
    known = np.isfinite(y)
    found = {one.name: np.full(y.shape[1], np.nan) for one in fields(Slopes)} | {"points": known.sum(axis=0)}
    for rows, those in _of_same_gaps(known):
        seen, when = y[np.ix_(rows, those)], x[rows]
        third = max(1, rows.size // 3)
        for name, part in (("median", seen), ("first", seen[:third]), ("last", seen[-third:])):
            found[name][those] = np.median(part, axis=0)
        varies = np.ptp(seen, axis=0) > 0
        if rows.size >= FEWEST and np.ptp(when) > 0 and varies.any():
            found["tau"][those[varies]], found["p_value"][those[varies]] = kendall(seen[:, varies], when)
            slopes = theil_sen(seen[:, varies], when)
            for name, slope in zip(("slope", "slope_low", "slope_high"), slopes, strict=True):
                found[name][those[varies]] = slope
    return Slopes(**found)


def _of_same_gaps(known: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the records that are known and the series, for all series that lack the same records."""
    groups: dict[bytes, list[int]] = {}
    for number, column in enumerate(known.T):
        groups.setdefault(column.tobytes(), []).append(number)
    for those in groups.values():
        rows = np.flatnonzero(known[:, those[0]])
        if rows.size:
            yield rows, np.array(those)


# ---- Kendall's rank correlation --------------------------------------------------------------------------------------


def kendall(values: Array, times: Array) -> tuple[Array, Array]:
    """Return tau-b of series with time, and its two-sided p value.

    Kendall 1970, Rank Correlation Methods, chapters 3 to 5.

    Parameters
    ----------
    values : (records, series) array
        Finite, each series with two different values.
    times : (records,) array
        In ascending order, not all equal.

    Returns
    -------
    tau, p_value : (series,) array
        The p value follows from all orders of the records up to 33 of them without ties, else from the normal
        distribution with the variance for ties.
    """
    from scipy.special import erfc  # noqa: PLC0415 - heavy

    count = len(times)
    ranks, runs = _ranks(values)
    same = np.append(False, np.diff(times) == 0)
    both = np.zeros_like(ranks)
    if same.any():  # among equal times in the order of values, so that none of their pairs is discordant
        ranks = np.take_along_axis(ranks, np.lexsort((ranks.T, np.broadcast_to(times, ranks.T.shape))).T, axis=0)
        both = _run_index(same[:, None] & np.vstack([np.zeros((1, ranks.shape[1]), bool), np.diff(ranks, axis=0) == 0]))
    pairs, of_time = count * (count - 1) / 2, _run_index(same[:, None])
    discordant = _discordant(ranks)
    x_ties, y_ties = of_time.sum(axis=0), runs.sum(axis=0)
    difference = pairs - x_ties - y_ties + both.sum(axis=0) - 2 * discordant
    tau = difference / np.sqrt(pairs - x_ties) / np.sqrt(pairs - y_ties)
    # of t equal ones: t(t-1)(2t+5) and t(t-1)(t-2), as sums over their places in the run
    x1, y1 = ((6 * run * (run + 2)).sum(axis=0) for run in (of_time, runs))
    x0, y0 = ((3 * run * (run - 1)).sum(axis=0) for run in (of_time, runs))
    variance = (2 * pairs * (2 * count + 5) - x1 - y1) / 18 + 2 * x_ties * y_ties / (2 * pairs)
    if count > 2:  # noqa: PLR2004
        variance = variance + x0 * y0 / (18 * pairs * (count - 2))
    p_value = erfc(np.abs(difference) / np.sqrt(2 * variance))
    if count <= _EXACT and not x_ties.any():
        fewer = np.minimum(discordant, pairs - discordant)
        exact = np.minimum(1.0, 2 * _inversions(count)[fewer.astype(np.int64)])
        p_value = np.where(y_ties == 0, exact, p_value)
    return np.asarray(np.clip(tau, -1, 1)), np.asarray(p_value)


def _ranks(values: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return ranks (records, series), equal ones the same, and the places of the sorted values in their runs."""
    order = np.argsort(values, axis=0, kind="stable")
    equal = np.zeros(values.shape, dtype=np.bool_)
    equal[1:] = np.diff(np.take_along_axis(values, order, axis=0), axis=0) == 0
    ranks = np.empty(values.shape, dtype=np.int64)
    np.put_along_axis(ranks, order, np.cumsum(~equal, axis=0), axis=0)
    return ranks, _run_index(equal)


def _run_index(same: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the place in its run of equal values: 0, 1, ..., from whether a value equals the one before."""
    place = np.arange(len(same))[:, None]
    return np.asarray(place - np.maximum.accumulate(np.where(same, 0, place), axis=0))


@lru_cache(maxsize=64)
def _inversions(count: int) -> Array:
    """Return the probability of at most k discordant pairs in a random order, for k from 0 to all."""
    found = np.ones(1)
    for size in range(2, count + 1):
        found = np.convolve(found, np.full(size, 1 / size))
    return np.cumsum(found)


def _discordant(ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of pairs (series,) of records whose ranks (records, series) fall."""
    count, series = ranks.shape
    blocks = 2 ** max(0, math.ceil(math.log2(count / _BLOCK)))
    width = -(-count // blocks)
    padded = np.full((blocks * width, series), count + 1, dtype=np.int16 if count < 2**15 - 1 else np.int32)
    padded[:count] = ranks  # what is added at the end is the largest, and falls with none
    found = np.zeros(series, dtype=np.int64)
    step = max(1, _AT_ONCE // (blocks * width))
    for start in range(0, series, step):
        piece = padded[:, start : start + step].reshape(blocks, width, -1)
        inside = _falling_pairs(np.ascontiguousarray(piece.transpose(1, 0, 2).reshape(width, -1)))
        merged = np.sort(piece.transpose(2, 0, 1), axis=-1)
        between = np.zeros(merged.shape[0], dtype=np.int64)
        while merged.shape[1] > 1:
            size = merged.shape[2]
            merged = merged.reshape(merged.shape[0], -1, 2 * size)
            order = np.argsort(merged, axis=-1, kind="stable")
            before = (order < size) @ np.arange(2 * size) - size * (size - 1) // 2  # later ones before earlier ones
            between += before.sum(axis=-1)
            merged = np.take_along_axis(merged, order, axis=-1)
        found[start : start + step] = inside.reshape(blocks, -1).sum(axis=0) + between
    return found


def _falling_pairs(ranks: NDArray[Any]) -> NDArray[np.int64]:
    """Return the number of falling pairs (columns,) by comparing all: shifts of the array against itself."""
    found = np.zeros(ranks.shape[1], dtype=np.int64)
    counted = np.zeros(ranks.shape, dtype=np.int8)
    for lag in range(1, len(ranks)):
        counted[lag:] += (ranks[lag:] < ranks[:-lag]).view(np.int8)
        if lag % 127 == 0 or lag == len(ranks) - 1:  # before eight bits overflow
            found += counted.sum(axis=0, dtype=np.int64)
            counted[:] = 0
    return found


# ---- Theil-Sen slope -------------------------------------------------------------------------------------------------


def theil_sen(values: Array, times: Array) -> tuple[Array, Array, Array]:
    """Return the median slopes (series,) of all pairs of records and the ends of their 95 % confidence intervals.

    Of `values` (records, series) over ascending `times` (records,), not all equal; above 100 records, those of the
    medians of consecutive groups. The interval is Sen's (1968), by the variance of Kendall's statistic with ties.
    """
    if len(times) > _MOST_POINTS:
        size = -(-len(times) // _MOST_POINTS)
        values, times = _group_medians(values, size), _group_medians(times[:, None], size)[:, 0]
    count = len(times)
    first, second = np.triu_indices(count, 1)
    span = times[second] - times[first]
    first, second, span = first[span > 0], second[span > 0], span[span > 0]
    _, runs = _ranks(values)
    of_time = _run_index(np.append(False, np.diff(times) == 0)[:, None])
    ties = [(6 * run * (run + 2)).sum(axis=0) for run in (of_time, runs)]
    margin = _CONFIDENCE_Z * np.sqrt((count * (count - 1) * (2 * count + 5) - ties[0] - ties[1]) / 18)
    low = np.maximum(np.round((span.size - margin) / 2).astype(np.int64) - 1, 0)
    high = np.minimum(np.round((span.size + margin) / 2).astype(np.int64), span.size - 1)
    found = np.empty((3, values.shape[1]))
    step = max(1, _AT_ONCE // span.size)
    columns = np.ascontiguousarray(values.T)
    for start in range(0, len(columns), step):
        piece = slice(start, start + step)
        slopes = np.sort((columns[piece][:, second] - columns[piece][:, first]) / span, axis=1)
        found[0, piece] = (slopes[:, (span.size - 1) // 2] + slopes[:, span.size // 2]) / 2
        for row, place in zip(found[1:], (low, high), strict=True):
            row[piece] = np.take_along_axis(slopes, place[piece, None], axis=1)[:, 0]
    return found[0], found[1], found[2]


def _group_medians(values: Array, size: int) -> Array:
    """Return the medians of consecutive groups of a size (groups, series); the last may be smaller."""
    whole = len(values) // size * size
    medians = np.median(values[:whole].reshape(-1, size, values.shape[1]), axis=1)
    return np.vstack([medians, np.median(values[whole:], axis=0)]) if whole < len(values) else medians
