"""Change of series with time: slopes with autocorrelated errors, and the time until a limit.

    y_k = a + b t_k + e_k,  corr(e_j, e_k) = w exp(-|t_j - t_k| / m) for j != k

(white noise and an Ornstein-Uhlenbeck process) by generalised least squares. Memory m and share w are unknown: those on
a grid are weighted by their restricted likelihoods (Patterson and Thompson 1971, Biometrika 58(3), 545-554). Noise
correlated over the whole series looks like a trend, which widens the interval of a short series. The time
until a limit follows from the same regression on growth laws, with a drifting level:

    y_k = a + b u(t_k) + walk(t_k) + e_k,    u(t) = (exp(g s) - 1) / (exp(g) - 1),    s = max(0, (t - o) / (1 - o))

where t runs from 0 to 1 over the observed time. Growth begins at the onset o; with the rate g it accelerates (g > 0),
is linear (0), or saturates (< 0). The random walk is that of the local level (Harvey 1989, Forecasting, Structural Time
Series Models and the Kalman Filter, section 2.3), and e is white noise with an Ornstein-Uhlenbeck process as above. A
short series does not determine these parameters: those on a grid are weighted by their restricted likelihoods, and
paths drawn from the mixture give the interval. A line is the simplest law, so |g| has an exponential prior.

For given parameters the regression is the Kalman filter of the local level with a slope; one factorisation serves the
whole grid and all scores of a machine, which share their times.
"""

import math
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax, stdtr, stdtrit
from scipy.stats import false_discovery_control

from signals.monitoring.location import known_median
from signals.monitoring.memory import correlations

Array = NDArray[np.float64]
FEWEST = 5  # values of which a slope is given: three beyond its two unknowns
SIGNIFICANCE = 0.01  # false discovery rate below which there is a trend
_MOST_GROUPS = 100  # of records, of which longer series are the medians: what a test costs grows with their number
_MEMORIES = np.geomspace(0.01, 1.0, 5)  # over the time watched
_GROWTH = 6.0  # e-foldings over the time watched
_USUAL_DRIFT = 3.0  # deviations (our choice; see `error_models`)


@dataclass(frozen=True, kw_only=True)
class Slopes:
    """Change of series with time; NaN for a series with fewer than 5 values or constant ones.

    Attributes
    ----------
    records : (series,) array
        Number of finite values.
    median, change : (series,) array
        Median of all values, and that of the last third over that of the first, NaN if the latter is not positive.
    slope_per_day, slope_low, slope_high : (series,) array
        Slope and the ends of its 95 % interval, in units of the values per day. For more than 100 records, of the
        medians of 100 consecutive groups.
    p_value : (series,) array
        Probability of a change at least this large without a trend: twice the smaller one (Bonferroni) of a line and of
        accelerating growth, of the logarithms if all values are positive. A step is not a trend.
    adjusted_p : (series,) array
        Expected share of false discoveries among all series with at most this probability (Benjamini and Hochberg 1995,
        J. R. Stat. Soc. B 57(1), 289-300).
    trend : (series,) array of str
        ``rising`` or ``falling`` if that is below `SIGNIFICANCE`, else ``none``, or ``too few to test``.
    form : (series,) array of str
        Growth law with the smaller probability, of a trend: ``line`` or ``growth``.
    """

    records: NDArray[np.int64]
    median: Array
    change: Array
    slope_per_day: Array
    slope_low: Array
    slope_high: Array
    p_value: Array
    adjusted_p: Array
    trend: NDArray[np.str_]
    form: NDArray[np.str_]


def series_slopes(values: Array, days: Array) -> Slopes:
    """Return the changes of the finite `values` (records, series) over ascending `days` (records,)."""
    values, days = values[np.isfinite(days)], days[np.isfinite(days)]
    medians, middles = grouped(values, days)
    rows = [_series(y, days, those, middles) for y, those in zip(values.T, medians.T, strict=True)]
    found = {one.name: np.array([row.get(one.name, np.nan) for row in rows]) for one in fields(Slopes)}
    tested = np.isfinite(found["p_value"])
    found["adjusted_p"][tested] = false_discovery_control(found["p_value"][tested])
    found["trend"][found["adjusted_p"] >= SIGNIFICANCE] = "none"
    found["form"][~(found["adjusted_p"] < SIGNIFICANCE)] = ""
    return Slopes(**found)


def _series(y: Array, days: Array, medians: Array, middles: Array) -> dict[str, Any]:
    """Return what is found of the values (n,) of a series, and of the medians of their groups."""
    known, few = np.isfinite(y), np.isfinite(medians)
    y, row = y[known], {"records": int(known.sum()), "trend": "too few to test", "form": ""}
    if not y.size:
        return row
    third = max(1, y.size // 3)
    first, last = np.median(y[:third]), np.median(y[-third:])
    row |= {"median": np.median(y), "change": last / first if first > 0 else np.nan}
    if y.size >= FEWEST and np.ptp(days[known]) > 0 and np.ptp(y) > 0:
        row |= _change(medians[few], middles[few])
    return row


def _change(y: Array, t: Array) -> dict[str, Any]:
    """Return slope, 95 % interval, growth law and its probability by chance of values (n,) over increasing times."""
    place, unit = (t - t[0]) / np.ptp(t), y.std() / np.ptp(t)
    courses = np.column_stack([place, np.expm1(_GROWTH * place) / np.expm1(_GROWTH)])
    mean, error, dof = _changes(y, courses, t)
    reach = stdtrit(dof, 0.975) * error[0]
    low, slope, high = unit * (mean[0] + reach * np.array([-1, 0, 1]))
    if (y > 0).all():
        mean, error, _ = _changes(np.log(y), courses, t)
    best = int(np.argmax(np.abs(mean) / error))
    p_value = min(1.0, 2 * float(stdtr(dof, -abs(mean[best]) / error[best])) * mean.size)
    return {
        "slope_per_day": slope,
        "slope_low": low,
        "slope_high": high,
        "p_value": p_value,
        "trend": "rising" if mean[best] > 0 else "falling",
        "form": ("line", "growth")[best],
    }


def _changes(y: Array, courses: Array, t: Array) -> tuple[Array, Array, int]:
    """Return the standardised change of values along each growth law, its standard error, and degrees of freedom."""
    fit = regression(y / max(y.std(), 1e-300), courses, error_models(t.tobytes()))
    weight = softmax(fit.log_likelihood, axis=0)
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


# ---- time until a limit ----------------------------------------------------------------------------------------------


_FEWEST_AHEAD = 8  # values: constant, slope, noise, memory, drift and rate are six unknowns
_DRIFTS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)  # deviations of the walk over the time watched, in those of the noise
_RATES = (-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)  # 6: 400-fold growth
_RATE, _ONSET = (axis.ravel() for axis in np.meshgrid(_RATES, (0.0, 0.25, 0.5, 0.75)))
_PRIOR = np.where(_RATE < 0, -_RATE / 0.7, _RATE / 2.0)
_WHITE = 0.2
"""Prior: mean rates of saturation (0.7) and of accelerating growth (2), and the probability of white noise. Our choice
among those for which the intervals of each growth law of the benchmark cover the truth in at least 85 %: the slower
saturation may be, the fewer forecasts have an upper end (docs/benchmarks/fleet.md)."""
_PATHS, _STEPS = 1_000, 300
_HORIZON = 3.0  # times the time watched that a forecast looks ahead; a longer one is a guess
_PROBABLE = 0.95  # share of paths that must rise for a forecast to be given


@dataclass(frozen=True, kw_only=True)
class TimeUntil:
    """Time until a limit: median and ends of the 90 % interval, or the reason why there is none.

    ``reason`` is empty if a forecast is given.
    """

    median: float = math.nan
    low: float = math.nan
    high: float = math.nan
    reason: str = ""


def time_until(limit: float, values: Array, times: Array, *, seed: int = 1) -> TimeUntil:
    """Return the time from the last of the values (n,), at times (n,), until their level reaches a limit above.

    Parameters
    ----------
    limit : float
        In the unit of the values.
    values, times : (n,) array
        The series; of several values at one time the first counts, and of more than 100 values medians of 100
        consecutive groups are taken.
    seed : int
        Seed of the drawn paths.

    Returns
    -------
    TimeUntil
        With a reason instead of numbers if there are fewer than 8 values, if fewer than 95 % of the drawn slopes rise,
        or if more than 5 % of the paths do not reach the limit within three times the observed time, so that the
        interval has no upper end: the trend may be autocorrelated noise, reversing drift, or growth that saturates
        below the limit.
    """
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(times))
    t, first = np.unique(times[known], return_index=True)
    y = values[known[first]]
    if y.size < _FEWEST_AHEAD:
        return TimeUntil(reason=f"{y.size} values are too few for a forecast, which needs {_FEWEST_AHEAD}")
    last = t[-1]
    medians, t = grouped(y[:, None], t)
    y, span, rng = medians[:, 0], np.ptp(t), np.random.default_rng(seed)
    errors = error_models(t.tobytes(), _DRIFTS, white=_WHITE)
    place = (t - t[0]) / span
    fit = regression(y, _course(place[:, None], _RATE, _ONSET), errors)
    posterior = softmax(fit.log_likelihood - _PRIOR)
    drawn = rng.choice(posterior.size, size=_PATHS, p=posterior.ravel())
    model, course = at = np.unravel_index(drawn, posterior.shape)
    std = np.sqrt(fit.variance[at] * fit.dof / rng.chisquare(fit.dof, _PATHS))
    normal = rng.standard_normal((3, _PATHS))
    slope = fit.slope[at] + std * np.sqrt(fit.slope_variance[at]) * normal[0]
    constant = fit.constant[at] - fit.tilt[at] * (slope - fit.slope[at])
    constant += std * np.sqrt(fit.constant_variance[model, 0]) * normal[1]
    rate, onset, drift, walk = _RATE[course], _ONSET[course], errors.drift[model], errors.walk[model]
    left = y - constant[:, None] - slope[:, None] * _course(place, rate[:, None], onset[:, None])
    wandered = ((errors.walk[:, None] @ errors.whiten)[model, 0] * left).sum(axis=1)  # mean of the walk at the end
    wandered += std * np.sqrt(np.maximum(drift**2 - (walk**2).sum(axis=1), 0)) * normal[2]
    if (constant + slope + wandered >= limit).mean() > 0.5:  # noqa: PLR2004
        return TimeUntil(reason="the limit is reached already")
    if (slope > 0).mean() < _PROBABLE:
        return TimeUntil(reason="none can be given: it does not rise for certain")
    ahead = _HORIZON * np.arange(_STEPS + 1)[:, None] / _STEPS
    walks = np.cumsum(rng.standard_normal((_STEPS + 1, _PATHS)) * (ahead > 0), axis=0)
    walks *= std * drift * math.sqrt(_HORIZON / _STEPS)
    reached = constant + slope * _course(1 + ahead, rate, onset) + wandered + walks >= limit
    found = np.where(reached.any(axis=0), ahead[reached.argmax(axis=0), 0] * span - (last - t[-1]), math.inf)
    low, median, high = np.maximum(np.quantile(found, (0.05, 0.5, 0.95), method="inverted_cdf"), 0)
    if math.isinf(high):
        return TimeUntil(reason=f"none can be given: it may take more than {_HORIZON:g} times the time watched")
    return TimeUntil(median=float(median), low=float(low), high=float(high))


def _course(time: Array, rate: Array, onset: Array) -> Array:
    """Return u at times from 0 to 1 over the observed time, and beyond."""
    since, there = np.maximum(0, (time - onset) / (1 - onset)), np.where(rate == 0, 1.0, rate)
    return np.where(rate == 0, since, np.expm1(there * since) / np.expm1(there))
