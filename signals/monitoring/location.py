"""Robust mean and standard deviation of a baseline, and a robust regression on what it was recorded at.

The location is Huber's M estimate with k = 1.5 (95 % efficient, Huber 1964, Ann. Math. Stat. 35, 73-101), started at
the median and the median absolute deviation; the variance is that of the values winsorised at k, made consistent for a
normal distribution (Huber's proposal 2). A few bad records therefore move neither.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SeriesBaseline", "learn_baseline"]

Array = NDArray[np.float64]
_HUBER = 1.5
_MAD = 1.4826  # of a normal distribution: 1 / the quantile at 3/4
_STEPS = 12  # of reweighting; it converges by a factor of three or more a step
_FEWEST_PER_COVARIATE = 10  # records; below, a slope's error would add more than it removes


def _winsorised_variance(k: float) -> float:
    """Return the mean of min(|x|, k)^2 of a standard normal variable."""
    density = math.exp(-k * k / 2) / math.sqrt(2 * math.pi)
    inside = math.erf(k / math.sqrt(2))
    return inside - 2 * k * density + k * k * (1 - inside)


_CONSISTENT = 1 / math.sqrt(_winsorised_variance(_HUBER))


@dataclass(frozen=True, kw_only=True)
class SeriesBaseline:
    """What was normal for several series: their location, scale and slopes on covariates.

    Attributes
    ----------
    center, scale : (..., series) array
        Robust mean and standard deviation; NaN where a series has too few values.
    slopes : (..., covariates, series) array
        Change of the mean per unit of each covariate.
    covariate_center : (..., covariates) array
        Covariates to which `center` refers.
    """

    center: Array
    scale: Array
    slopes: Array
    covariate_center: Array

    def standardised(self, values: Array, covariates: Array) -> Array:
        """Return values (..., series), recorded at covariates (..., covariates), as departures in scales."""
        shift = np.einsum("...c,...cs->...s", covariates - self.covariate_center, self.slopes)
        return np.asarray((values - self.center - shift) / self.scale)


def learn_baseline(
    values: Array,
    covariates: Array,
    *,
    prior_scale: Array | float = math.nan,
    prior_dof: float = 0.0,
    least_share: float = 0.5,
    independent: float = 1.0,
) -> SeriesBaseline:
    """Return the baseline of series from the records it is learned on.

    Parameters
    ----------
    values : (..., records, series) array
        The series; NaN where a record has no value.
    covariates : (..., records, covariates) array
        What the records were made at; none: (..., records, 0). A covariate that does not change, or with fewer than
        ten records for each, has no slope.
    prior_scale : array or float
        Standard deviation that is usual for each series, NaN where unknown.
    prior_dof : float
        Weight of the usual one, as a number of records: variances are averaged as in a scaled inverse chi-squared
        prior (Gelman et al. 2013, Bayesian Data Analysis, section 2.6).
    least_share : float
        Share of the records in which a series has to have a value.
    independent : float
        Effective number of independent records over their number, which a deviation's weight against the usual one has.

    Returns
    -------
    SeriesBaseline
    """
    records, count = values.shape[-2], covariates.shape[-1]
    slopes, middle = np.zeros((*values.shape[:-2], count, values.shape[-1])), np.zeros((*covariates.shape[:-2], count))
    if count:
        middle = np.median(covariates, axis=-2)
    center, scale, weights = _location(values)
    if count and records >= _FEWEST_PER_COVARIATE * (count + 1):
        design = covariates - middle[..., None, :]
        varies = np.ptp(covariates, axis=-2) > 0
        for _ in range(_STEPS):
            slopes = _slopes(values - center[..., None, :], design, weights, varies)
            center, scale, weights = _location(values - design @ slopes)
    known = np.isfinite(values).sum(axis=-2)
    usual = np.broadcast_to(np.asarray(prior_scale, dtype=np.float64), scale.shape)
    own = independent * np.maximum(known - 1 - np.any(slopes != 0, axis=-2), 0)
    weighted = np.where(np.isfinite(usual), prior_dof, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (np.where(own > 0, own * scale**2, 0) + np.where(weighted > 0, weighted * usual**2, 0)) / (
            own + weighted
        )
    pooled = np.sqrt(mean)
    watched = (known >= max(1.0, least_share * records)) & (pooled > 0)
    return SeriesBaseline(
        center=np.where(watched, center, np.nan),
        scale=np.where(watched, pooled, np.nan),
        slopes=slopes,
        covariate_center=middle,
    )


def _location(values: Array) -> tuple[Array, Array, Array]:
    """Return Huber's location and scale along the records, and the weights (..., records, series)."""
    known = np.isfinite(values)
    filled = np.where(known, values, 0.0)
    count = known.sum(axis=-2)
    ordered = np.sort(np.where(known, values, np.inf), axis=-2)
    center = _middle(ordered, count)
    departure = np.where(known, np.abs(values - center[..., None, :]), np.inf)
    scale = _MAD * _middle(np.sort(departure, axis=-2), count)
    weights = known.astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(_STEPS):
            away = np.abs(filled - center[..., None, :]) / scale[..., None, :]
            weights = known * np.minimum(1.0, np.where(away > _HUBER, _HUBER / away, 1.0))
            center = (weights * filled).sum(axis=-2) / weights.sum(axis=-2)
            clipped = np.where(
                known, np.minimum(np.abs(filled - center[..., None, :]), _HUBER * scale[..., None, :]), 0
            )
            scale = _CONSISTENT * np.sqrt((clipped**2).sum(axis=-2) / np.maximum(count - 1, 1))
    return center, scale, weights


def _middle(ordered: Array, count: NDArray[np.int64]) -> Array:
    """Return the medians of sorted values along the records, the known ones first."""
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    high = np.minimum(high, ordered.shape[-2] - 1)
    pick = [np.take_along_axis(ordered, at[..., None, :], axis=-2)[..., 0, :] for at in (low, high)]
    middle = np.where(count % 2 == 0, (pick[0] + pick[1]) / 2, pick[0])
    return np.where(count > 0, middle, np.nan)


def _slopes(values: Array, design: Array, weights: Array, varies: NDArray[np.bool_]) -> Array:
    """Return weighted least-squares slopes (..., covariates, series); zero for a covariate that does not vary."""
    filled = np.where(np.isfinite(values), values, 0.0)
    normal = np.einsum("...rc,...rs,...rd->...scd", design, weights, design)
    right = np.einsum("...rc,...rs->...sc", design, weights * filled)
    diagonal = np.einsum("...scc->...sc", normal)
    steady = ~varies[..., None, :] | (diagonal <= 0)
    normal = normal + np.where(steady, 1.0, 1e-12 * diagonal)[..., None] * np.eye(design.shape[-1])
    found = np.linalg.solve(normal, right[..., None])[..., 0]
    return np.asarray(np.swapaxes(np.where(steady, 0.0, found), -1, -2))
