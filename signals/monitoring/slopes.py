"""Change of each of many series with time: slopes with autocorrelated errors.

    y_k = a + b t_k + e_k,  corr(e_j, e_k) = w exp(-|t_j - t_k| / m) for j != k

(white noise and an Ornstein-Uhlenbeck process) by generalised least squares. Memory m and share w are unknown: those on
a grid are weighted by their restricted likelihoods (Patterson and Thompson 1971, Biometrika 58(3), 545-554). Noise
correlated over the whole series looks like a trend, which widens the interval of a short series. Forecasts use the same
regression with a drifting level (`forecast`).
"""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from signals.monitoring.location import known_median
from signals.monitoring.memory import correlations

Array = NDArray[np.float64]
FEWEST = 5  # values of which a slope is given: three beyond its two unknowns
_MOST_GROUPS = 100  # of records, of which longer series are the medians: what a test costs grows with their number
_MEMORIES = np.geomspace(0.01, 1.0, 5)  # over the time watched
_GROWTH = 6.0  # e-foldings over the time watched
_USUAL_DRIFT = 3.0  # deviations (our choice; see `error_models`)


@dataclass(frozen=True, kw_only=True)
class Slopes:
    """Change of series with time; NaN for a series with fewer than 5 values or constant ones.

    Attributes
    ----------
    points : (series,) array
        Number of finite values.
    median, first, last : (series,) array
        Median of all values, of the first third and of the last.
    slope, slope_low, slope_high : (series,) array
        Slope and the ends of its 95 % interval, in units of the values per unit of time. For more than 100 records, of
        the medians of 100 consecutive groups.
    p_value : (series,) array
        Probability of a change at least this large without a trend: twice the smaller one (Bonferroni) of a line and of
        accelerating growth, of the logarithms if all values are positive. A step is not a trend.
    form : (series,) array of str
        Growth law with the smaller probability: ``line`` or ``growth``.
    rises : (series,) array
        Whether it rises rather than falls.
    discovery_rate : (series,) array
        Expected share of false discoveries among all series with at most this probability (Benjamini and Hochberg 1995,
        J. R. Stat. Soc. B 57(1), 289-300).
    """

    points: NDArray[np.int64]
    median: Array
    first: Array
    last: Array
    slope: Array
    slope_low: Array
    slope_high: Array
    p_value: Array
    form: NDArray[np.str_]
    rises: NDArray[np.bool_]
    discovery_rate: Array


def series_slopes(values: Array, times: Array) -> Slopes:
    """Return the changes of the finite `values` (records, series) over `times` (records,)."""
    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order])]
    values, times = values[order], times[order]
    known = np.isfinite(values)
    medians, middles = grouped(values, times)
    found: dict[str, Any] = {one.name: np.full(values.shape[1], np.nan) for one in fields(Slopes)}
    found |= {"points": known.sum(axis=0), "form": np.full(values.shape[1], "", dtype="<U6")}
    for number, rows in enumerate(known.T):
        x, y = times[rows], values[rows, number]
        if not y.size:
            continue
        third = max(1, y.size // 3)
        row: dict[str, Any] = {"median": np.median(y), "first": np.median(y[:third]), "last": np.median(y[-third:])}
        if y.size >= FEWEST and np.ptp(x) > 0 and np.ptp(y) > 0:
            few = np.isfinite(medians[:, number])
            shown, when = medians[few, number], middles[few]
            row |= _change(shown, when)
        for name, value in row.items():
            found[name][number] = value
    found["rises"] = found["rises"] == 1
    found["discovery_rate"] = _discovery_rates(found["p_value"])
    return Slopes(**found)


def _discovery_rates(p_values: Array) -> Array:
    rates, those = np.full(p_values.size, np.nan), np.flatnonzero(np.isfinite(p_values))
    order = those[np.argsort(p_values[those])]
    rates[order] = p_values[order] * order.size / np.arange(1, order.size + 1)
    rates[order] = np.minimum.accumulate(rates[order][::-1])[::-1]  # a larger probability is no better
    return rates


def _change(y: Array, t: Array) -> dict[str, Any]:
    """Return slope, 95 % interval, growth law and its probability by chance of values (n,) over increasing times."""
    place, unit = (t - t[0]) / np.ptp(t), y.std() / np.ptp(t)
    courses = np.column_stack([place, np.expm1(_GROWTH * place) / np.expm1(_GROWTH)])
    mean, error, dof = _changes(y, courses, t)
    reach = stdtrit(dof, 0.975) * error[0]
    found = {"slope": mean[0] * unit, "slope_low": (mean[0] - reach) * unit, "slope_high": (mean[0] + reach) * unit}
    if (y > 0).all():
        mean, error, _ = _changes(np.log(y), courses, t)
    best = int(np.argmax(np.abs(mean) / error))
    p_value = min(1.0, 2 * float(stdtr(dof, -abs(mean[best]) / error[best])) * mean.size)
    return found | {"p_value": p_value, "form": ("line", "growth")[best], "rises": mean[best] > 0}


def _changes(y: Array, courses: Array, t: Array) -> tuple[Array, Array, int]:
    """Return the standardised change of values along each growth law, its standard error, and degrees of freedom."""
    fit = regression(y / max(y.std(), 1e-300), courses, error_models(t.tobytes()))
    weight = np.exp(fit.log_likelihood - fit.log_likelihood.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = (weight * fit.slope).sum(axis=0)
    error = np.sqrt((weight * (fit.variance * fit.slope_variance + (fit.slope - mean) ** 2)).sum(axis=0))
    return mean, error, fit.dof


@dataclass(frozen=True, kw_only=True)
class ErrorModels:
    """Models of the errors of values (n,).

    ``whiten`` (models, n, n) makes errors independent, ``log_weight`` (models,) is the logarithm of the prior
    probability less half of that of the determinant; ``drift`` (models,) is the deviation of a random walk over the
    observed time, in standard deviations of the other errors, and ``walk`` (models, n) its covariance at the last value
    with that at each, whitened.
    """

    whiten: Array
    log_weight: Array
    drift: Array
    walk: Array


@lru_cache(maxsize=16)
def error_models(times: bytes, drifts: tuple[float, ...] = (0.0,), *, white: float = 0.5) -> ErrorModels:
    """Return models of errors at increasing times, with each memory and drift; `white` is the prior of white noise.

    The drift in deviations is exponentially distributed (penalised complexity prior; Simpson et al. 2017, Stat. Sci.
    32(1), 1-28).
    """
    t = np.frombuffer(times)
    place = (t - t[0]) / np.ptp(t)
    correlation, common = correlations(np.abs(place[:, None] - place), _MEMORIES), np.minimum(place[:, None], place)
    slow, drift = len(correlation) - 1, np.tile(drifts, len(correlation))
    covariance = np.repeat(correlation, len(drifts), axis=0) + drift[:, None, None] ** 2 * common
    root = np.linalg.cholesky(covariance)
    prior = np.log(np.repeat([white, *[(1 - white) / slow] * slow], len(drifts))) - drift / _USUAL_DRIFT
    whiten = np.linalg.inv(root)
    return ErrorModels(
        whiten=whiten,
        log_weight=prior - np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1),
        drift=drift,
        walk=drift[:, None] ** 2 * (whiten @ place),
    )


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Regression of values on growth laws, for each model of the errors (models, laws).

    ``log_likelihood`` includes the prior of the models; ``constant``, ``slope`` and ``variance`` are estimates,
    ``slope_variance`` and ``constant_variance`` (that of the constant if the slope is known) are over the variance, and
    ``tilt`` is the decrease of the constant per increase of the slope.
    """

    log_likelihood: Array
    constant: Array
    slope: Array
    variance: Array
    slope_variance: Array
    constant_variance: Array
    tilt: Array
    dof: int


def regression(y: Array, courses: Array, errors: ErrorModels) -> Regression:
    """Return the regression of values (n,) on each growth law (n, laws), with each model of the errors."""
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


def grouped(values: Array, times: Array) -> tuple[Array, Array]:
    """Return `values` (records, series) and ascending `times`; of more than 100 records, medians of groups."""
    if len(times) <= _MOST_GROUPS:
        return values, times
    groups = np.array_split(np.arange(len(times)), _MOST_GROUPS)
    return np.array([known_median(values[g]) for g in groups]), np.array([np.median(times[g]) for g in groups])
