"""Trend of a series: Kendall's rank correlation test and the Theil-Sen slope."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
MIN_POINTS = 5  # five in order have p = 2 / 5! = 1/60; fewer are never significant
_MAX_SLOPE_POINTS = 400  # of the Theil-Sen slope, whose cost grows with the square
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Trend:
    """Trend of one series over time.

    Attributes
    ----------
    points : int
        Number of finite values.
    median : float
        Median of the values.
    slope, slope_low, slope_high : float
        Median slope of all pairs (Theil 1950, Sen 1968, J. Am. Stat. Assoc. 63, 1379-1389) and the ends of its 95 %
        confidence interval, in units of the values per unit of time. Above 400 values, the pairs are those of the
        medians of 400 consecutive groups.
    tau : float
        Kendall's rank correlation of value and time (tau-b): 1 for a series that rises throughout.
    p_value : float
        Probability of a tau at least this far from zero if the values are exchangeable in time.
    """

    points: int
    median: float
    slope: float
    slope_low: float
    slope_high: float
    tau: float
    p_value: float


def trend(values: Array, times: Array) -> Trend | None:
    """Return the trend of the finite `values` (n,) over `times` (n,); None for fewer than 5, or all equal ones."""
    from scipy.stats import kendalltau, theilslopes  # noqa: PLC0415 - heavy

    known = np.isfinite(values) & np.isfinite(times)
    x, y = times[known], np.asarray(values[known], dtype=np.float64)
    if x.size < MIN_POINTS or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    order = np.argsort(x, kind="stable")
    rank = kendalltau(x, y)
    groups = np.array_split(order, min(x.size, _MAX_SLOPE_POINTS))
    medians = np.array([[np.median(x[group]), np.median(y[group])] for group in groups])
    slope = theilslopes(medians[:, 1], medians[:, 0], alpha=CONFIDENCE)
    return Trend(
        points=x.size,
        median=float(np.median(y)),
        slope=float(slope.slope),
        slope_low=float(slope.low_slope),
        slope_high=float(slope.high_slope),
        tau=float(rank.statistic),
        p_value=float(rank.pvalue),
    )


def adjusted_p_values(p_values: Array) -> Array:
    """Return p values (n,) adjusted for the false discovery rate among tests that may depend on each other.

    Benjamini and Yekutieli (2001), Ann. Stat. 29(4), 1165-1188.
    """
    from scipy.stats import false_discovery_control  # noqa: PLC0415 - heavy

    return np.asarray(false_discovery_control(p_values, method="by")) if p_values.size else p_values
