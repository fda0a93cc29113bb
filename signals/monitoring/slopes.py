"""How much each of many series changes with time: slopes whose errors may depend on each other.

    y_k = a + b t_k + e_k,  corr(e_j, e_k) = w exp(-|t_j - t_k| / m) for j != k

(white noise and an Ornstein-Uhlenbeck process) by generalised least squares. Memory m and share w are unknown: those on
a grid are weighted by their restricted likelihoods (Patterson and Thompson 1971, Biometrika 58(3), 545-554). A memory
as long as the series looks like a trend, which widens the interval of a short series. Forecasts take the same
regression, with a level that wanders (`forecast`).
"""

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.trends import FEWEST, grouped

Array = NDArray[np.float64]
_MEMORIES = np.geomspace(0.01, 1.0, 5)  # over the time watched
_SHARES = (0.5, 0.99)  # of the variance that has a memory
_USUAL_DRIFT = 3.0  # deviations (our choice; see `error_models`)


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

    span = np.ptp(t)
    fit = regression(y / y.std(), (t - t[0])[:, None] / span, error_models(t.tobytes()))
    mean = float((fit.weight * fit.slope).sum())
    error = float(np.sqrt((fit.weight * (fit.variance * fit.slope_variance + (fit.slope - mean) ** 2)).sum()))
    reach, unit = student.ppf(0.975, fit.dof) * error, y.std() / span
    ends = {"slope": mean * unit, "slope_low": (mean - reach) * unit, "slope_high": (mean + reach) * unit}
    return ends | {"p_value": 2 * float(student.sf(abs(mean) / error, fit.dof))}


@dataclass(frozen=True, kw_only=True)
class ErrorModels:
    """Models of the errors of values (n,) at some times.

    ``whiten`` (models, n, n) makes errors independent, ``log_weight`` (models,) is the logarithm of the prior
    probability less half of that of the determinant; ``drift`` (models,) is the deviation of a random walk over the
    time watched, in standard deviations of the other errors, and ``walk`` (models, n) its covariance at the last value
    with that at each, whitened.
    """

    whiten: Array
    log_weight: Array
    drift: Array
    walk: Array


@lru_cache(maxsize=16)
def error_models(times: bytes, drifts: tuple[float, ...] = (0.0,), *, white: float = 0.5) -> ErrorModels:
    """Return models of errors at rising times, with each memory and each drift; `white` is the prior of no memory.

    The drift in deviations is exponentially distributed (penalised complexity prior; Simpson et al. 2017, Stat. Sci.
    32(1), 1-28).
    """
    t = np.frombuffer(times)
    place, one = (t - t[0]) / np.ptp(t), np.eye(t.size)
    apart, common = np.abs(place[:, None] - place), np.minimum(place[:, None], place)
    slow = [(1 - share) * one + share * np.exp(-apart / memory) for share in _SHARES for memory in _MEMORIES]
    drift = np.tile(drifts, 1 + len(slow))
    covariance = np.repeat([one, *slow], len(drifts), axis=0) + drift[:, None, None] ** 2 * common
    root = np.linalg.cholesky(covariance)
    prior = np.log(np.repeat([white, *[(1 - white) / len(slow)] * len(slow)], len(drifts))) - drift / _USUAL_DRIFT
    whiten = np.linalg.inv(root)
    return ErrorModels(
        whiten=whiten,
        log_weight=prior - np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1),
        drift=drift,
        walk=drift[:, None] ** 2 * (whiten @ place),
    )


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Regression of values on courses over time, for each model of the errors (models, courses).

    ``weight`` is the posterior probability where each course is as probable before; ``constant``, ``slope`` and
    ``variance`` are estimates, ``slope_variance`` and ``constant_variance`` (that of the constant if the slope is
    known) are over the variance, and ``tilt`` is by how much the constant falls where the slope rises.
    """

    log_likelihood: Array
    constant: Array
    slope: Array
    variance: Array
    slope_variance: Array
    constant_variance: Array
    tilt: Array
    dof: int

    @property
    def weight(self) -> Array:
        """Posterior probabilities (models, courses); each course is as probable before."""
        weight = np.exp(self.log_likelihood - self.log_likelihood.max())
        return np.asarray(weight / weight.sum())


def regression(y: Array, courses: Array, errors: ErrorModels) -> Regression:
    """Return the regression of values (n,) on each of some courses (n, courses), with each model of the errors."""
    whiten, dof = errors.whiten, y.size - 2
    level, rise, white = whiten.sum(axis=2)[..., None], whiten @ courses, (whiten @ y)[..., None]
    ones, cross, square = (level**2).sum(axis=1), (level * rise).sum(axis=1), (rise**2).sum(axis=1)
    of_level, of_rise = (level * white).sum(axis=1), (rise * white).sum(axis=1)
    det = ones * square - cross**2
    slope, constant = (ones * of_rise - cross * of_level) / det, (square * of_level - cross * of_rise) / det
    left = np.maximum((white**2).sum(axis=1) - constant * of_level - slope * of_rise, 1e-20)
    return Regression(
        log_likelihood=errors.log_weight[:, None] - (np.log(det) + dof * np.log(left)) / 2,
        constant=constant,
        slope=slope,
        variance=left / dof,
        slope_variance=ones / det,
        constant_variance=1 / ones,
        tilt=cross / ones,
        dof=dof,
    )
