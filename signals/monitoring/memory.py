"""Effective number of independent records of a baseline, by the autocorrelation of a machine's state.

    corr(y_j, y_k) = w exp(-|t_j - t_k| / m) for j != k

(white noise and an Ornstein-Uhlenbeck process). A baseline is too short to determine memory m and share w: those on a
grid have a prior, and are weighted by their restricted likelihoods (Patterson and Thompson 1971, Biometrika 58(3),
545-554).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

Array = NDArray[np.float64]
_HOUR_S = 3600.0
_MEMORIES_S = _HOUR_S * 4.0 ** np.arange(-3.0, 7.0)  # a minute to 170 days
_PRIOR = np.exp(-0.5 * (np.log(_MEMORIES_S / _HOUR_S) / np.log(32.0)) ** 2)
"""Temperatures of oil and bearings settle within about an hour, loads and seasons change over months: the prior of the
memory is log-normal about an hour, with a deviation of a factor of 32 (our choice). That there is none has the
probability 0.6, so that thirty records a day apart without one count as 27 or more."""
SHARES = (0.5, 0.99)  # of the variance that has a memory
_MOST = 400  # records that are looked at, the latest; a long memory does not average out over those before


def correlations(apart: Array, memories: Array) -> Array:
    """Return correlations (models, n, n) of values `apart` in time: of white noise, then of each share and memory."""
    one = np.eye(len(apart))
    return np.stack([one, *((1 - w) * one + w * np.exp(-apart / memory) for w in SHARES for memory in memories)])


def independent_records(scores: Array, times_s: Array) -> Array:
    """Return the numbers (2, scores) of independent records whose mean, and variance, are as uncertain as the records'.

    The variance of a mean is that of independent records times the mean of the correlations of all pairs, that of a
    variance times the mean of their squares (Bayley and Hammersley 1946, J. R. Stat. Soc. Suppl. 8(2), 184-197): what
    a long memory leaves uncertain is the mean.

    Parameters
    ----------
    scores : (records, scores) array
        Scores of the records of a baseline; one with a missing value, or a constant one, is ignored.
    times_s : (records,) array
        Their times in seconds; if one is NaN, all records count.
    """
    records = len(scores)
    found = np.full((2, scores.shape[1]), float(records))
    if not np.isfinite(times_s).all():
        return found
    latest, t = scores[-_MOST:], times_s[-_MOST:]
    covariance = correlations(np.abs(t[:, None] - t), _MEMORIES_S)
    error = np.stack([covariance.mean(axis=(1, 2)), (covariance**2).mean(axis=(1, 2))])  # of mean and variance
    prior = np.concatenate([[0.6], np.tile(0.2 * _PRIOR / _PRIOR.sum(), len(SHARES))])
    told = np.isfinite(latest).all(axis=0) & (np.ptp(latest, axis=0) > 0)
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(t.size))  # records of the same time have one state
    whiten = np.linalg.inv(root)
    level, white = whiten.sum(axis=2), whiten @ latest[:, told]
    ones = (level**2).sum(axis=1)[:, None]
    left = (white**2).sum(axis=1) - (level[:, None] @ white)[:, 0] ** 2 / ones
    log_det = 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)[:, None]
    likelihood = np.log(prior)[:, None] - (log_det + np.log(ones) + (t.size - 1) * np.log(left)) / 2
    found[:] = 1 / (error @ prior)[:, None]
    found[:, told] = 1 / (error @ softmax(likelihood, axis=0))
    return found
