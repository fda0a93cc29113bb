"""How much each of many series changes with time: slopes whose errors may depend on each other.

    y_k = a + b t_k + e_k,  corr(e_j, e_k) = w exp(-|t_j - t_k| / m) for j != k

(white noise and an Ornstein-Uhlenbeck process) by generalised least squares. Memory m and share w are unknown: those on
a grid are weighted by their restricted likelihoods (Patterson and Thompson 1971, Biometrika 58(3), 545-554). A memory
as long as the series looks like a trend, which widens the interval of a short series.
"""

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.trends import FEWEST, grouped

Array = NDArray[np.float64]
_MEMORIES = np.geomspace(0.01, 1.0, 5)  # over the time watched
_SHARES = (0.5, 0.99)  # of the variance that has a memory


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
        Slope and the ends of its 95 % interval, in units of the values per unit of time. Above 100 records, it is that
        of the medians of 100 consecutive groups.
    p_value : (series,) array
        Probability of a slope at least this far from zero without a trend.
    """

    points: NDArray[np.int64]
    median: Array
    first: Array
    last: Array
    slope: Array
    slope_low: Array
    slope_high: Array
    p_value: Array


def series_slopes(values: Array, times: Array) -> Slopes:
    """Return the changes of the finite `values` (records, series) over `times` (records,)."""
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
            few = np.isfinite(medians[:, number])
            for name, one in _slope(medians[few, number], middles[few]).items():
                found[name][number] = one
    return Slopes(**found)


def _slope(y: Array, t: Array) -> dict[str, float]:
    """Return the slope of values (n,) over rising times, its 95 % interval and p value."""
    from scipy.stats import t as student  # noqa: PLC0415 - heavy

    span, dof = np.ptp(t), y.size - 2
    whiten, log_det = _whitening(t.tobytes())
    columns = np.stack([np.ones(y.size), (t - t.mean()) / span, (y - y.mean()) / y.std()], axis=1)
    white = whiten @ columns
    (ones, cross, of_level), (_, rise, of_slope), (_, _, square) = np.einsum("mki,mkj->ijm", white, white)
    det = ones * rise - cross**2
    slope, level = (ones * of_slope - cross * of_level) / det, (rise * of_level - cross * of_slope) / det
    left = np.maximum(square - level * of_level - slope * of_slope, 1e-20)
    prior = -np.log([1, *[log_det.size - 1] * (log_det.size - 1)])  # that there is a memory is as likely as not
    likelihood = prior - (log_det + np.log(det) + dof * np.log(left)) / 2
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    mean = float(weight @ slope)
    error = float(np.sqrt(weight @ (left / dof * ones / det + (slope - mean) ** 2)))
    reach, unit = student.ppf(0.975, dof) * error, y.std() / span
    ends = {"slope": mean * unit, "slope_low": (mean - reach) * unit, "slope_high": (mean + reach) * unit}
    return ends | {"p_value": 2 * float(student.sf(abs(mean) / error, dof))}


@lru_cache(maxsize=16)
def _whitening(times: bytes) -> tuple[Array, Array]:
    """Return matrices (models, n, n) that make the errors of each model independent, and log determinants (models,)."""
    t = np.frombuffer(times)
    apart = np.abs(t[:, None] - t) / np.ptp(t)
    one = np.eye(t.size)
    slow = [(1 - share) * one + share * np.exp(-apart / memory) for share in _SHARES for memory in _MEMORIES]
    root = np.linalg.cholesky(np.stack([one, *slow]))
    return np.linalg.inv(root), 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
