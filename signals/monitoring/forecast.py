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
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

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

    growth: Array
    intensity: Array
    weight: Array
    mean: Array
    covariance: Array
    variance: Array
    dof: int


@dataclass(frozen=True, kw_only=True)
class TimeUntil:
    """Time until a limit: median and the ends of the 90 % interval; or why there is none.

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
    y, t = values[known], np.asarray(times[known], dtype=np.float64)
    if y.size < FEWEST:
        raise ValueError(f"{y.size} values are too few for a forecast; it needs {FEWEST}.")
    if not (np.diff(t) > 0).all():
        raise ValueError("times of a forecast have to rise; give each value once.")
    intensity, gains = _gains_at(t.tobytes())
    mean, square = _filtered(y, gains)
    dof = y.size - 2
    # flat in the level and in the rise over the span: the first two values fix both, the rise as their difference / dt
    likelihood = -0.5 * (gains.log_det + dof * np.log(np.maximum(square, 1e-300))) - np.log(gains.first_step)
    smoothness, growth = _grid()
    posterior = likelihood - smoothness / _BEND
    weight = np.exp(posterior - posterior.max())
    return LocalTrend(
        growth=growth,
        intensity=intensity,
        weight=weight / weight.sum(),
        mean=mean,
        covariance=gains.covariance,
        variance=square / dof,
        dof=dof,
    )


def _clock(time: Array, growth: Array, span: float) -> Array:
    """Return the reading of clocks (..., grid), which show the span at the span and run ever faster."""
    rate = np.where(growth > 0, growth, 1.0)
    return np.where(growth > 0, span * np.expm1(rate * time / span) / np.expm1(rate), time + 0 * growth)


@dataclass(frozen=True, kw_only=True)
class _Gains:
    """What a filter does with its values, which follows from their times alone: one row for each after the second.

    ``steps``, ``of_level``, ``of_slope`` and ``variance`` (n - 2, grid) are the steps of the clocks, the gains and the
    variances of the innovations; ``first_step`` (grid,) is that between the first two values, ``covariance``
    (grid, 2, 2) is at the end, and ``log_det`` (grid,) the sum of the logarithms of the variances.
    """

    first_step: Array
    steps: Array
    of_level: Array
    of_slope: Array
    variance: Array
    covariance: Array
    log_det: Array


def _gains(t: Array, intensity: Array) -> _Gains:
    """Return the gains for values at the readings (n, grid) of clocks, each with its intensity (grid,).

    The first two values fix the diffuse start: the level at the second, and the slope between them.
    """
    dt = t[1] - t[0]
    p00, p01, p11 = np.ones_like(dt), 1 / dt, 2 / dt**2 + intensity * dt / 3
    steps = np.diff(t[1:], axis=0)
    of_level, of_slope, variance = (np.empty_like(steps) for _ in range(3))
    for number, step in enumerate(steps):
        q = intensity * step
        p00 = p00 + step * (2 * p01 + step * p11) + q * step**2 / 3  # predict
        p01 = p01 + step * p11 + q * step / 2
        p11 = p11 + q
        variance[number] = p00 + 1.0  # update
        of_level[number], of_slope[number] = p00 / variance[number], p01 / variance[number]
        p11 = p11 - of_slope[number] * p01
        p00, p01 = of_level[number], of_slope[number]
    covariance = np.stack([np.stack([p00, p01], axis=-1), np.stack([p01, p11], axis=-1)], axis=-1)
    return _Gains(
        first_step=dt,
        steps=steps,
        of_level=of_level,
        of_slope=of_slope,
        variance=variance,
        covariance=covariance,
        log_det=np.log(variance).sum(axis=0),
    )


@lru_cache(maxsize=4)
def _gains_at(times: bytes) -> tuple[Array, _Gains]:
    """Return the intensities (grid,) and gains for values at some times; all scores of a machine have the same."""
    t = np.frombuffer(times)
    span = t[-1] - t[0]
    smoothness, growth = _grid()
    intensity = smoothness**2 * 3 / span**3  # so that the level leaves its line by that many stds over the span
    return intensity, _gains(_clock((t - t[0])[:, None], growth, span), intensity)


def _grid() -> tuple[Array, Array]:
    """Return smoothness and growth (grid,), each with each."""
    smoothness, growth = np.meshgrid(_SMOOTHNESS, _GROWTH)
    return smoothness.ravel(), growth.ravel()


def _filtered(y: Array, gains: _Gains) -> tuple[Array, Array]:
    """Return level and slope at the end (grid, 2), and the sums of normalised squares (grid,), of values (n,)."""
    level, slope = np.full_like(gains.first_step, y[1]), (y[1] - y[0]) / gains.first_step
    innovations = np.empty_like(gains.steps)
    for number, value in enumerate(y[2:]):
        level = level + gains.steps[number] * slope  # predict
        innovations[number] = innovation = value - level
        level = level + gains.of_level[number] * innovation  # update
        slope = slope + gains.of_slope[number] * innovation
    return np.stack([level, slope], axis=-1), (innovations**2 / gains.variance).sum(axis=0)


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
        With a reason instead of numbers where fewer than 95 % of the drawn slopes rise, or where more than one in
        twenty of the paths does not reach the limit within the horizon, so that the interval has no upper end.
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
    if math.isinf(high):
        return TimeUntil(reason=f"none can be given: it may take more than {_HORIZON:g} times the time watched")
    return TimeUntil(median=float(median), low=float(low), high=float(high))
