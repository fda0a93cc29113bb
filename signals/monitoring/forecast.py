"""Level and slope of a series by a Kalman filter, and the time until it reaches a limit.

The local linear trend (Harvey 1989, Forecasting, Structural Time Series Models and the Kalman Filter, section 2.3.2):

    y_t = level_t + noise,  level_(t+1) = level_t + dt slope_t + ...,  slope_(t+1) = slope_t + ...

with the slope a random walk in continuous time of intensity q, whose integral is the level (Q = q [[dt^3/3, dt^2/2],
[dt^2/2, dt]]). The ratio of q to the variance of the noise is unknown: ratios on a grid are weighted by their
likelihoods (the variance itself integrated out), and the paths of all of them together give the interval.

Damage often grows faster the larger it is. The same model therefore runs in clocks that go faster and faster,
u = (exp(g t) - 1) / g, in which exponential growth at the rate g is a line, and the rates g are weighted by their
likelihoods, too: g = 0 is the trend above. Each rate is as probable before the series is seen (our choice). Ratios are
not: a line of its clock is the simplest course, and by how much the level leaves it is exponentially distributed (after
the penalised complexity priors of Simpson et al. 2017, Stat. Sci. 32(1), 1-28), or few values leave room for any bend.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LocalTrend", "TimeUntil", "local_trend", "time_until"]

Array = NDArray[np.float64]
FEWEST = 8  # values: level, slope, noise and the change of the slope are four unknowns
_SMOOTHNESS = 10.0 ** np.arange(-4.0, 2.5, 0.5)  # change of level by curvature over the whole series, in noise stds
_GROWTH = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0])  # rates g times the span of the series; 6: 400-fold growth
_BEND = 2.0  # noise stds by which levels usually leave a line of their clock over the series (our choice; see module)
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
    growth : (grid,) array
        Rate of the clock times the span.
    intensity : (grid,) array
        Intensity of the slope's random walk over the noise variance, per unit of the clock.
    weight : (grid,) array
        Posterior weight of each.
    mean : (grid, 2) array
        Level, and slope per unit of the clock, which runs from 0 to the span of the series.
    covariance : (grid, 2, 2) array
        Their covariance for a noise variance of 1.
    variance : (grid,) array
        Estimate of the noise variance.
    dof : int
        Degrees of freedom of that estimate.
    """

    smoothness: Array
    growth: Array
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
    smoothness, growth = (each.ravel() for each in np.meshgrid(_SMOOTHNESS, _GROWTH))
    clock = _clock((t - t[0])[:, None], growth, span)
    intensity = smoothness**2 * 3 / span**3  # so that the level leaves its line by that many stds over the span
    mean, covariance, log_det, square = _filtered(y, clock, intensity)
    dof = y.size - 2
    # flat in the level and in the rise over the span: the first two values fix both, the rise as their difference / dt
    likelihood = -0.5 * (log_det + dof * np.log(np.maximum(square, 1e-300))) - np.log(clock[1] - clock[0])
    posterior = likelihood - smoothness / _BEND
    weight = np.exp(posterior - posterior.max())
    return LocalTrend(
        smoothness=smoothness,
        growth=growth,
        intensity=intensity,
        weight=weight / weight.sum(),
        mean=mean,
        covariance=covariance,
        variance=square / dof,
        dof=dof,
    )


def _clock(time: Array, growth: Array, span: float) -> Array:
    """Return the reading of clocks (..., grid), which show the span at the span and run ever faster."""
    rate = np.where(growth > 0, growth, 1.0)
    return np.where(growth > 0, span * np.expm1(rate * time / span) / np.expm1(rate), time + 0 * growth)


def _filtered(y: Array, t: Array, intensity: Array) -> tuple[Array, Array, Array, Array]:
    """Return mean and covariance at the end, the sum of log innovation variances, and of normalised squares.

    Of the values (n,) in clocks (n, grid), each with its intensity (grid,). The first two values fix the diffuse start:
    the level at the second, and the slope between them.
    """
    dt = t[1] - t[0]
    level, slope = np.full_like(dt, y[1]), (y[1] - y[0]) / dt
    p00, p01, p11 = np.ones_like(dt), 1 / dt, 2 / dt**2 + intensity * dt / 3
    log_det, square = np.zeros_like(dt), np.zeros_like(dt)
    for value, dt in zip(y[2:], np.diff(t[1:], axis=0), strict=True):
        q = intensity * dt
        level = level + dt * slope  # predict
        p00 = p00 + dt * (2 * p01 + dt * p11) + q * dt**2 / 3
        p01 = p01 + dt * p11 + q * dt / 2
        p11 = p11 + q
        innovation, variance = value - level, p00 + 1.0  # update
        gain_level, gain_slope = p00 / variance, p01 / variance
        level, slope = level + gain_level * innovation, slope + gain_slope * innovation
        p11 = p11 - gain_slope * p01
        p00, p01 = p00 / variance, p01 / variance
        log_det += np.log(variance)
        square += innovation**2 / variance
    covariance = np.stack([np.stack([p00, p01], axis=-1), np.stack([p01, p11], axis=-1)], axis=-1)
    return np.stack([level, slope], axis=-1), covariance, log_det, square


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
    ahead = _clock(span + dt * np.arange(_STEPS + 1, dtype=np.float64)[:, None], trend.growth[which], span)
    intensity = trend.intensity[which] * variance
    found = np.where(level >= limit, 0.0, np.inf)
    for number, du in enumerate(np.diff(ahead, axis=0), start=1):
        kick = np.sqrt(intensity * du) * rng.standard_normal(_PATHS)
        swing = np.sqrt(intensity * du**3 / 12) * rng.standard_normal(_PATHS)
        before, level = level, level + du * (slope + kick / 2) + swing
        slope = slope + kick
        share = np.clip((limit - before) / np.where(level > before, level - before, 1.0), 0, 1)
        found = np.where(np.isinf(found) & (level >= limit), (number - 1 + share) * dt, found)
    low, median, high = np.quantile(found, (0.05, 0.5, 0.95), method="inverted_cdf")
    if math.isinf(median):
        return TimeUntil(reason=f"none can be given: more than {_HORIZON:g} times the time watched")
    return TimeUntil(median=float(median), low=float(low), high=float(high))
