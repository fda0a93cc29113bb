"""How much each of many series changes with time: Kendall's rank correlation and the Theil-Sen slope, by scipy."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.trends import FEWEST, grouped

Array = NDArray[np.float64]


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
        confidence interval, in units of the values per unit of time. Above 100 records, the pairs are those of the
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
    from scipy.stats import kendalltau, theilslopes  # noqa: PLC0415 - heavy

    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order])]
    values, times = values[order], times[order]
    known = np.isfinite(values)
    medians, middles = grouped(values, times)
    found = {one.name: np.full(values.shape[1], np.nan) for one in fields(Slopes)} | {"points": known.sum(axis=0)}
    for number, rows in enumerate(known.T):
        x, y = times[rows], values[rows, number]
        if not y.size:
            continue
        third = max(1, y.size // 3)
        for name, part in (("median", y), ("first", y[:third]), ("last", y[-third:])):
            found[name][number] = np.median(part)
        if y.size >= FEWEST and np.ptp(x) > 0 and np.ptp(y) > 0:
            found["tau"][number], found["p_value"][number] = kendalltau(x, y)
            few = np.isfinite(medians[:, number])
            slope = theilslopes(medians[few, number], middles[few])
            for name, one in (("slope", slope.slope), ("slope_low", slope.low_slope), ("slope_high", slope.high_slope)):
                found[name][number] = one
    return Slopes(**found)
