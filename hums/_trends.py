"""Whether a series rises or falls, and how fast: Kendall's rank test and the Theil-Sen slope."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
FEWEST = 5  # five in order have p = 2 / 5! = 1/60; of fewer nothing is ever significant
_MOST_POINTS = 400  # for the slope, whose pairs grow with the square
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Trend:
    """How one series went over time.

    Attributes
    ----------
    points : int
        Values that are finite.
    median : float
        Of the values.
    slope, slope_low, slope_high : float
        Median slope of all pairs (Theil 1950, Sen 1968, J. Am. Stat. Assoc. 63, 1379-1389) and the ends of its 95 %
        interval, in the unit of the values for one of time. Beyond 400 values, pairs of medians of as many
        consecutive groups.
    tau : float
        Kendall's rank correlation of value and time (tau-b): 1 if it only ever rises.
    p_value : float
        Of a tau at least this far from zero by chance, if values are exchangeable in time.
    """

    points: int
    median: float
    slope: float
    slope_low: float
    slope_high: float
    tau: float
    p_value: float


def trend(values: Array, times: Array) -> Trend | None:
    """Return the trend of `values` (n,) over `times` (n,), NaN left out; None of fewer than 5, or where all agree."""
    from scipy.stats import kendalltau, theilslopes  # noqa: PLC0415 - heavy

    known = np.isfinite(values) & np.isfinite(times)
    x, y = times[known], np.asarray(values[known], dtype=np.float64)
    if x.size < FEWEST or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    order = np.argsort(x, kind="stable")
    rank = kendalltau(x, y)
    groups = np.array_split(order, min(x.size, _MOST_POINTS))
    middle = np.array([[np.median(x[group]), np.median(y[group])] for group in groups])
    slope = theilslopes(middle[:, 1], middle[:, 0], alpha=CONFIDENCE)
    return Trend(
        points=x.size,
        median=float(np.median(y)),
        slope=float(slope.slope),
        slope_low=float(slope.low_slope),
        slope_high=float(slope.high_slope),
        tau=float(rank.statistic),
        p_value=float(rank.pvalue),
    )


def adjusted(p_values: Array) -> Array:
    """Return p values (n,) adjusted for the false discovery rate among tests that may depend on each other.

    Benjamini and Yekutieli (2001), Ann. Stat. 29(4), 1165-1188.
    """
    from scipy.stats import false_discovery_control  # noqa: PLC0415 - heavy

    return np.asarray(false_discovery_control(p_values, method="by")) if p_values.size else p_values
