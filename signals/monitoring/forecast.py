"""Time until a series reaches a limit, by regression on growth laws with a drifting level.

    y_k = a + b u(t_k) + walk(t_k) + e_k,    u(t) = (exp(g s) - 1) / (exp(g) - 1),    s = max(0, (t - o) / (1 - o))

where t runs from 0 to 1 over the observed time. Growth begins at the onset o; with the rate g it accelerates (g > 0),
is linear (0), or saturates (< 0). The random walk is that of the local level (Harvey 1989, Forecasting, Structural Time
Series Models and the Kalman Filter, section 2.3), and e is white noise with an Ornstein-Uhlenbeck process (`slopes`). A
short series does not determine these parameters: those on a grid are weighted by their restricted likelihoods, and
paths drawn from the mixture give the interval. A line is the simplest law, so |g| has an exponential prior.

For given parameters the regression is the Kalman filter of the local level with a slope; one factorisation serves the
whole grid and all scores of a machine, which share their times.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from signals.monitoring.slopes import error_models, grouped, regression

Array = NDArray[np.float64]
FEWEST = 8  # values: constant, slope, noise, memory, drift and rate are six unknowns
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
    if y.size < FEWEST:
        return TimeUntil(reason=f"{y.size} values are too few for a forecast, which needs {FEWEST}")
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
