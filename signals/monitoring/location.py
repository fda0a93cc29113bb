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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_HUBER = 1.5
_CONSISTENT = 0.7784652**-0.5  # mean of min(|x|, 1.5)^2 of a standard normal variable
_MAD = 1.4826  # of a normal distribution: 1 / the quantile at 3/4
_STEPS = 12  # of reweighting; it converges by a factor of three or more a step
_FEWEST_PER_COVARIATE = 10  # records; below, a slope's error would add more than it removes
_ANY = 1e4  # deviations of a series over the range of a covariate: no prior
_CERTAIN = 2.0
"""Ratio of the mean squared slope to its squared error above which a covariate has slopes. Series are correlated: with
ten independent ones without slopes, 3 % of the machines exceed it (our choice)."""


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


def learn_baseline(
    values: Array,
    covariates: Array,
    *,
    prior_scale: Array | float = 0.0,
    prior_dof: float = 0.0,
    least_scale: Array | float = 0.0,
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
        Typical standard deviation of each series.
    prior_dof : float
        Weight of the typical one, as a number of records: variances are averaged as in a scaled inverse chi-squared
        prior (Gelman et al. 2013, Bayesian Data Analysis, section 2.6).
    least_scale : array or float
        Least standard deviation of each series, of what changes more slowly than a baseline lasts.
    independent : float or (..., 1) array
        Ratio of the effective number of independent records to their number, which weights a deviation against the
        typical one.

    Returns
    -------
    SeriesBaseline
    """
    records, count = values.shape[-2], covariates.shape[-1]
    slopes, middle = np.zeros((*values.shape[:-2], count, values.shape[-1])), np.median(covariates, axis=-2)
    errors, regressors = np.zeros((*middle.shape, count)), np.zeros(middle.shape[:-1])
    center, scale, weights = _location(values)
    dof = np.isfinite(values).sum(axis=-2) - 1.0
    if count and records >= _FEWEST_PER_COVARIATE * (count + 1):
        design, varies = covariates - middle[..., None, :], np.ptp(covariates, axis=-2)
        typical = np.divide(_ANY, varies, out=np.zeros_like(varies), where=varies > 0)
        for step in range(2 * _STEPS):  # first without a prior, which follows from what is found
            if step == _STEPS:
                typical = _typical_slopes(slopes / scale[..., None, :], design, typical)
            slopes = _slopes(values - center[..., None, :], design, weights, typical)
            center, scale, weights = _location(values - design @ slopes)
        errors, regressors = _slope_errors(design, typical)
        scale = scale * np.sqrt(dof / np.maximum(dof - regressors[..., None], 1))
    own, usual = independent * np.maximum(dof - regressors[..., None], 0), np.square(prior_scale)
    with np.errstate(invalid="ignore"):
        pooled = np.sqrt((np.nan_to_num(own * scale**2) + prior_dof * usual) / (own + prior_dof))
    pooled = np.maximum(pooled, least_scale)
    watched = (2 * (dof + 1) >= max(2, records)) & (pooled > 0)
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
    center = known_median(values)
    scale = _MAD * known_median(np.abs(values - center[..., None, :]))
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(_STEPS):
            away, bound = values - center[..., None, :], _HUBER * scale[..., None, :]
            clipped = np.clip(away, -bound, bound)
            weights = np.where(known, np.where(clipped == away, 1.0, clipped / away), 0.0)
            center = center + np.nansum(clipped, axis=-2) / weights.sum(axis=-2)
            scale = _CONSISTENT * np.sqrt(np.nansum(clipped**2, axis=-2) / np.maximum(count - 1, 1))
    return center, scale, weights


def known_median(values: Array) -> Array:
    """Return the medians (..., series) of the finite values of (..., records, series), NaN where none is."""
    ordered, count = np.sort(values, axis=-2), np.isfinite(values).sum(axis=-2)  # NaN last
    both = np.stack([np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[-2] - 1)], axis=-2)
    return np.where(count > 0, np.take_along_axis(ordered, both, axis=-2).mean(axis=-2), np.nan)


def _slopes(values: Array, design: Array, weights: Array, typical: Array) -> Array:
    """Return weighted least-squares slopes (..., covariates, series) with the prior N(0, typical^2)."""
    scaled = design * typical[..., None, :]
    products = (scaled[..., :, None] * scaled[..., None, :]).reshape(*scaled.shape[:-1], -1)
    normal = (np.swapaxes(weights, -1, -2) @ products).reshape(*weights.shape[:-2], -1, *scaled.shape[-1:] * 2)
    right = np.swapaxes(weights * np.nan_to_num(values), -1, -2) @ scaled
    found = np.linalg.solve(normal + np.eye(scaled.shape[-1]), right[..., None])[..., 0]
    return np.asarray(np.swapaxes(found * typical[..., None, :], -1, -2))


def _typical_slopes(slopes: Array, design: Array, flat: Array) -> Array:
    """Return the typical slope (..., covariates) over all series from slopes in deviations, 0 if none is certain."""
    error = np.einsum("...cc->...c", _slope_errors(design, flat)[0])
    square = np.nan_to_num(slopes**2).sum(axis=-1) / np.maximum(np.isfinite(slopes).sum(axis=-1), 1)
    return np.sqrt(np.where(square >= _CERTAIN * error, square - error, 0.0))


def _slope_errors(design: Array, typical: Array) -> tuple[Array, Array]:
    """Return the covariance of slopes (..., covariates, covariates), and their effective number (...)."""
    scaled = design * typical[..., None, :]
    information = np.swapaxes(scaled, -1, -2) @ scaled
    inverse = np.linalg.inv(information + np.eye(scaled.shape[-1]))
    outer = typical[..., :, None] * typical[..., None, :]
    return inverse * outer, np.einsum("...cd,...dc->...", inverse, information)
