"""Level and slope of a series by a Kalman filter, and the time until it reaches a limit.

The local linear trend (Harvey 1989, Forecasting, Structural Time Series Models and the Kalman Filter, section 2.3.2):

    y_t = level_t + noise,  level_(t+1) = level_t + dt slope_t + ...,  slope_(t+1) = slope_t + ...

with the slope a random walk in continuous time of intensity q, whose integral is the level (Q = q [[dt^3/3, dt^2/2],
[dt^2/2, dt]]). The ratio of q to the variance of the noise is unknown: ratios on a grid are weighted by their
likelihoods (the variance itself integrated out), and the paths of all of them together give the interval.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LocalTrend", "TimeUntil", "local_trend", "time_until"]

Array = NDArray[np.float64]
FEWEST = 8  # values: level, slope, noise and the change of the slope are four unknowns
_SMOOTHNESS = 10.0 ** np.arange(-4.0, 2.5, 0.5)  # change of level by curvature over the whole series, in noise stds
_PATHS, _STEPS = 2_000, 400
_HORIZON = 3.0  # spans of the series that a forecast looks ahead; a longer one is a guess
_PROBABLE = 0.95  # share of paths that must rise at the end for a forecast to be given


@dataclass(frozen=True, kw_only=True)
class LocalTrend:
    """Level and slope at the last value, for each smoothness on the grid.

    Attributes
    ----------
    smoothness : (grid,) array
        Ratio of the slope's intensity to the noise variance, scaled to the span of the series.
    weight : (grid,) array
        Posterior weight of each.
    mean : (grid, 2) array
        Level, and slope per unit of time.
    covariance : (grid, 2, 2) array
        Their covariance for a noise variance of 1.
    variance : (grid,) array
        Estimate of the noise variance.
    dof : int
        Degrees of freedom of that estimate.
    """

    smoothness: Array
    intensity: Array
    weight: Array
    mean: Array
    covariance: Array
    variance: Array
    dof: int


@dataclass(frozen=True, kw_only=True)
class TimeUntil:
    """Time until a limit: median and the ends of the 90 % interval, infinite beyond the horizon; or why there is none.

    ``reason`` is empty where a forecast is given.
    """

    median: float = math.nan
    low: float = math.nan
    high: float = math.nan
    reason: str = ""


def local_trend(values: Array, times: Array) -> LocalTrend:
    """Return level and slope at the last of the values (n,) at rising times (n,).

    Raises
    ------
    ValueError
        If there are fewer than 8 values, or times do not rise.
    """
    known = np.isfinite(values) & np.isfinite(times)
    y, t = values[known], times[known]
    if y.size < FEWEST:
        raise ValueError(f"{y.size} values are too few for a forecast; it needs {FEWEST}.")
    if not (np.diff(t) > 0).all():
        raise ValueError("times of a forecast have to rise; give each value once.")
    span = t[-1] - t[0]
    intensity = _SMOOTHNESS**2 * 3 / span**3  # so that the level leaves its line by that many stds over the span
    fits = [_filtered(y, t, q) for q in intensity]
    dof = y.size - 2
    likelihood = np.array([-0.5 * (log_det + dof * math.log(max(square, 1e-300))) for *_, log_det, square in fits])
    weight = np.exp(likelihood - likelihood.max())
    return LocalTrend(
        smoothness=_SMOOTHNESS,
        intensity=intensity,
        weight=weight / weight.sum(),
        mean=np.array([mean for mean, *_ in fits]),
        covariance=np.array([covariance for _, covariance, *_ in fits]),
        variance=np.array([square / dof for *_, square in fits]),
        dof=dof,
    )


def _filtered(y: Array, t: Array, intensity: float) -> tuple[Array, Array, float, float]:
    """Return mean and covariance at the end, the sum of log innovation variances, and of normalised squares.

    The first two values fix the diffuse start: the level at the second, and the slope between them.
    """
    dt = t[1] - t[0]
    mean = np.array([y[1], (y[1] - y[0]) / dt])
    covariance = np.array([[1.0, 1 / dt], [1 / dt, 2 / dt**2 + intensity * dt / 3]])
    log_det = square = 0.0
    for number in range(2, y.size):
        dt = t[number] - t[number - 1]
        step = np.array([[1.0, dt], [0.0, 1.0]])
        noise = intensity * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        mean = step @ mean
        covariance = step @ covariance @ step.T + noise
        innovation, variance = y[number] - mean[0], covariance[0, 0] + 1.0
        gain = covariance[:, 0] / variance
        mean = mean + gain * innovation
        covariance = covariance - np.outer(gain, covariance[0])
        log_det += math.log(variance)
        square += innovation**2 / variance
    return mean, covariance, log_det, square


def time_until(limit: float, trend: LocalTrend, *, span: float, seed: int = 1) -> TimeUntil:
    """Return the time from the last value until the level first reaches a limit above it.

    Parameters
    ----------
    limit : float
        In the unit of the series.
    trend : LocalTrend
        Of `local_trend`.
    span : float
        Length of the series in time; the forecast looks three of them ahead.
    seed : int
        Of the drawn paths.

    Returns
    -------
    TimeUntil
        With a reason instead of numbers where fewer than 95 % of the drawn slopes rise, or where more than half of the
        paths do not reach the limit within the horizon.
    """
    rng = np.random.default_rng(seed)
    which = rng.choice(trend.weight.size, size=_PATHS, p=trend.weight)
    variance = trend.variance[which] * trend.dof / rng.chisquare(trend.dof, _PATHS)
    root = np.linalg.cholesky(
        trend.covariance + 1e-12 * np.eye(2) * np.trace(trend.covariance, axis1=1, axis2=2)[:, None, None]
    )
    start = trend.mean[which] + np.sqrt(variance)[:, None] * np.einsum(
        "pij,pj->pi", root[which], rng.standard_normal((_PATHS, 2))
    )
    level, slope = start[:, 0], start[:, 1]
    if (level >= limit).mean() > 0.5:  # noqa: PLR2004
        return TimeUntil(reason="the limit is reached already")
    if (slope > 0).mean() < _PROBABLE:
        return TimeUntil(reason="none can be given: it does not rise for certain")
    dt = _HORIZON * span / _STEPS
    intensity = trend.intensity[which] * variance
    found = np.where(level >= limit, 0.0, np.inf)
    for number in range(1, _STEPS + 1):
        kick = np.sqrt(intensity * dt) * rng.standard_normal(_PATHS)
        swing = np.sqrt(intensity * dt**3 / 12) * rng.standard_normal(_PATHS)
        before, level = level, level + dt * (slope + kick / 2) + swing
        slope = slope + kick
        share = np.clip((limit - before) / np.where(level > before, level - before, 1.0), 0, 1)
        found = np.where(np.isinf(found) & (level >= limit), (number - 1 + share) * dt, found)
    low, median, high = np.quantile(found, (0.05, 0.5, 0.95), method="inverted_cdf")
    if math.isinf(median):
        return TimeUntil(reason=f"none can be given: more than {_HORIZON:g} times the time watched")
    return TimeUntil(median=float(median), low=float(low), high=float(high))
