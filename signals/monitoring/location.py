"""Robust mean and standard deviation of a baseline, and robust regression on operating conditions.

The location is Huber's M estimate with k = 1.5 (95 % efficient, Huber 1964, Ann. Math. Stat. 35, 73-101), started at
the median and the median absolute deviation; the variance is that of the values winsorised at k, made consistent for a
normal distribution (Huber's proposal 2). A few outliers therefore affect neither.

A regression on few records extrapolates poorly. Slopes, in deviations of their series, have the prior N(0, tau^2) for
each covariate, with tau^2 estimated from all series of the machine: the mean of their squared slopes less that of their
errors (empirical Bayes; Efron and Morris 1973, J. Am. Stat. Assoc. 68, 117-130). A covariate has no slope unless the
former is twice the latter: no dependence on it is certain. The remaining uncertainty of the value predicted at
covariates x from their centre, x' (X'X + 1/tau^2)^-1 x, widens the deviation there as in the prediction interval of a
regression (Draper and Smith 1998, Applied Regression Analysis, section 3.1).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_HUBER = 1.5
_MAD = 1.4826  # of a normal distribution: 1 / the quantile at 3/4
_STEPS = 12  # of reweighting; it converges by a factor of three or more a step
_FEWEST_PER_COVARIATE = 10  # records; below, a slope's error would add more than it removes
_CERTAIN = 2.0
"""Ratio of the mean squared slope to its squared error above which a covariate has slopes. Series are correlated: with
ten independent ones without slopes, 3 % of the machines exceed it (our choice)."""


def _winsorised_variance(k: float) -> float:
    """Return the mean of min(|x|, k)^2 of a standard normal variable."""
    density = math.exp(-k * k / 2) / math.sqrt(2 * math.pi)
    inside = math.erf(k / math.sqrt(2))
    return inside - 2 * k * density + k * k * (1 - inside)


_CONSISTENT = 1 / math.sqrt(_winsorised_variance(_HUBER))


@dataclass(frozen=True, kw_only=True)
class SeriesBaseline:
    """Baseline of several series: location, scale and slopes on covariates.

    Attributes
    ----------
    center, scale : (..., series) array
        Robust mean and standard deviation; NaN if a series has too few values.
    slopes : (..., covariates, series) array
        Change of the mean per unit of each covariate.
    covariate_center : (..., covariates) array
        Covariates to which `center` refers.
    slope_variance : (..., covariates, covariates) array
        Covariance of the slopes' errors over the variance of the series.
    regressors : (...) array
        Effective number of slopes: 1 for a covariate with a well-determined slope, 0 for an irrelevant one.
    records : int
        Number of records.
    """

    center: Array
    scale: Array
    slopes: Array
    covariate_center: Array
    slope_variance: Array
    regressors: Array
    records: int

    def standardised(self, values: Array, covariates: Array) -> Array:
        """Return values (..., series) at covariates (..., covariates) as deviations in units of the scale."""
        shift = np.einsum("...c,...cs->...s", covariates - self.covariate_center, self.slopes)
        return np.asarray((values - self.center - shift) / self.scale)

    def leverage(self, covariates: Array) -> Array:
        """Return the variance (...) that the errors of slopes add at covariates, over the variance of the series."""
        away = covariates - self.covariate_center
        return np.asarray(np.einsum("...c,...cd,...d->...", away, self.slope_variance, away))

    def per_record(self) -> "SeriesBaseline":
        """Return the baseline with an axis for records inserted before that of series or covariates."""
        return replace(
            self,
            center=self.center[..., None, :],
            scale=self.scale[..., None, :],
            slopes=self.slopes[..., None, :, :],
            covariate_center=self.covariate_center[..., None, :],
            slope_variance=self.slope_variance[..., None, :, :],
            regressors=self.regressors[..., None],
        )


def learn_baseline(
    values: Array,
    covariates: Array,
    *,
    prior_scale: Array | float = math.nan,
    prior_dof: float = 0.0,
    independent: Array | float = 1.0,
) -> SeriesBaseline:
    """Learn the baseline of series from records.

    Parameters
    ----------
    values : (..., records, series) array
        The series; NaN for missing values. One with values in fewer than half of them has no baseline.
    covariates : (..., records, covariates) array
        Operating conditions; none: (..., records, 0). A constant covariate has no slope, nor has any with fewer than
        ten records per covariate.
    prior_scale : array or float
        Typical standard deviation of each series, NaN if unknown.
    prior_dof : float
        Weight of the typical one, as a number of records: variances are averaged as in a scaled inverse chi-squared
        prior (Gelman et al. 2013, Bayesian Data Analysis, section 2.6).
    independent : float or (..., 1) array
        Ratio of the effective number of independent records to their number, which weights a deviation against the
        typical one.

    Returns
    -------
    SeriesBaseline
    """
    records, count = values.shape[-2], covariates.shape[-1]
    slopes, middle = np.zeros((*values.shape[:-2], count, values.shape[-1])), np.zeros((*covariates.shape[:-2], count))
    if count:
        middle = np.median(covariates, axis=-2)
    errors, regressors = np.zeros((*middle.shape, count)), np.zeros(middle.shape[:-1])
    center, scale, weights = _location(values)
    known = np.isfinite(values).sum(axis=-2)
    if count and records >= _FEWEST_PER_COVARIATE * (count + 1):
        design = covariates - middle[..., None, :]
        precision = np.zeros(middle.shape)
        for step in range(2 * _STEPS):  # first without a prior, which follows from what is found
            if step == _STEPS:
                precision = _slope_precision(slopes / scale[..., None, :], design)
            slopes = _slopes(values - center[..., None, :], design, weights, precision)
            center, scale, weights = _location(values - design @ slopes)
        errors, regressors = _slope_errors(design, precision)
        scale = scale * np.sqrt((known - 1) / np.maximum(known - 1 - regressors[..., None], 1))
    usual = np.broadcast_to(np.asarray(prior_scale, dtype=np.float64), scale.shape)
    own = independent * np.maximum(known - 1 - regressors[..., None], 0)
    weighted = np.where(np.isfinite(usual), prior_dof, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (np.where(own > 0, own * scale**2, 0) + np.where(weighted > 0, weighted * usual**2, 0)) / (
            own + weighted
        )
    pooled = np.sqrt(mean)
    watched = (2 * known >= max(2, records)) & (pooled > 0)
    return SeriesBaseline(
        center=np.where(watched, center, np.nan),
        scale=np.where(watched, pooled, np.nan),
        slopes=slopes,
        covariate_center=middle,
        slope_variance=errors,
        regressors=regressors,
        records=records,
    )


def _location(values: Array) -> tuple[Array, Array, Array]:
    """Return Huber's location and scale along the records, and the weights (..., records, series)."""
    known = np.isfinite(values)
    count = known.sum(axis=-2)
    work = np.sort(np.where(known, values, np.inf), axis=-2)  # one array for all steps: they are bound by memory
    center = known_median(work, count)
    away = np.where(known, values - center[..., None, :], 0.0)
    work[:] = np.where(known, np.abs(away), np.inf)
    work.sort(axis=-2)
    scale = _MAD * known_median(work, count)
    weights = work
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(_STEPS):
            bound = _HUBER * scale[..., None, :]
            np.divide(bound, np.abs(away, out=weights), out=weights)
            np.fmin(weights, 1.0, out=weights)
            weights *= known
            step = np.einsum("...rs,...rs->...s", weights, away) / weights.sum(axis=-2)
            center = center + step
            away -= np.where(known, step[..., None, :], 0.0)
            clipped = np.clip(away, -bound, bound)
            scale = _CONSISTENT * np.sqrt(np.einsum("...rs,...rs->...s", clipped, clipped) / np.maximum(count - 1, 1))
    return center, scale, weights


def known_median(ordered: Array, count: NDArray[np.int64]) -> Array:
    """Return the medians (..., series) of sorted values (..., records, series), of which the first `count` are known.

    They are NaN where none is.
    """
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, ordered.shape[-2] - 1)
    pick = [np.take_along_axis(ordered, at[..., None, :], axis=-2)[..., 0, :] for at in (low, high)]
    return np.where(count > 0, (pick[0] + pick[1]) / 2, np.nan)


def _slopes(values: Array, design: Array, weights: Array, precision: Array) -> Array:
    """Return weighted least-squares slopes (..., covariates, series) with a prior of given precision about zero.

    `precision` (..., covariates) is relative to that of a record; a covariate of infinite precision has no slope.
    """
    filled = np.where(np.isfinite(values), values, 0.0)
    products = (design[..., :, None] * design[..., None, :]).reshape(*design.shape[:-1], -1)
    normal = (np.swapaxes(weights, -1, -2) @ products).reshape(*design.shape[:-2], -1, *design.shape[-1:] * 2)
    right = np.swapaxes(weights * filled, -1, -2) @ design
    normal, none = _with_prior(normal, precision[..., None, :])
    found = np.linalg.solve(normal, right[..., None])[..., 0]
    return np.asarray(np.swapaxes(np.where(none, 0.0, found), -1, -2))


def _with_prior(normal: Array, precision: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return normal equations (..., covariates, covariates) with a prior, and a mask of covariates without a slope."""
    diagonal = np.einsum("...cc->...c", normal)
    none = ~np.isfinite(precision) | (diagonal <= 0)
    added = np.where(none, 1.0, np.where(none, 0.0, precision) + 1e-12 * diagonal)
    kept = np.where(none[..., None] | none[..., None, :], 0.0, normal)
    return kept + added[..., None] * np.eye(normal.shape[-1]), none


def _slope_precision(slopes: Array, design: Array) -> Array:
    """Return the precision (..., covariates) of slopes in deviations (..., covariates, series) over all series."""
    errors, _ = _slope_errors(design, np.zeros(design.shape[:-2] + design.shape[-1:]))
    error = np.einsum("...cc->...c", errors)
    with np.errstate(invalid="ignore", divide="ignore"):
        known = np.isfinite(slopes)
        square = np.where(known, slopes, 0.0) ** 2
        mean = square.sum(axis=-1) / known.sum(axis=-1)
        return np.where(mean >= _CERTAIN * error, 1 / (mean - error), np.inf)


def _slope_errors(design: Array, precision: Array) -> tuple[Array, Array]:
    """Return the covariance of slopes (..., covariates, covariates), and their effective number (...)."""
    information = np.swapaxes(design, -1, -2) @ design
    normal, none = _with_prior(information, precision)
    errors = np.where(none[..., None] | none[..., None, :], 0.0, np.linalg.inv(normal))
    return errors, np.einsum("...cd,...dc->...", errors, information)
