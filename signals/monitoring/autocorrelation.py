"""Autocorrelation of a series of records as shares of variance: white, correlated over few and over many, seasonal."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LAGS_PER_RECORD = 0.5  # autocorrelations beyond half of the series are those of too few pairs


@dataclass(frozen=True, kw_only=True)
class Correlation:
    """Lengths of the correlated parts, in records: exp(-lag / length), and the period of a season."""

    short_records: float = 5.0
    long_records: float = 50.0
    season_records: float = 365.0

    def of_lags(self, lags: NDArray[Any]) -> Array:
        """Return the autocorrelation (4, lags) of the white, short, long and seasonal parts."""
        lags = np.asarray(lags, dtype=np.float64)
        return np.stack(
            [
                (lags == 0).astype(np.float64),
                np.exp(-lags / self.short_records),
                np.exp(-lags / self.long_records),
                np.cos(2 * np.pi * lags / self.season_records),
            ]
        )


def effective_records(shares: Array, records: int, correlation: Correlation) -> Array:
    """Return the number of independent records whose mean is as uncertain as that of `records` correlated ones.

    n / (1 + 2 sum over lags of (1 - lag/n) rho(lag)); Bayley and Hammersley (1946), J. R. Stat. Soc. Suppl. 8, 184-197.

    Parameters
    ----------
    shares : (..., 4) array
        Share of the variance that is white, short, long and seasonal.
    records : int
        Number of records.
    correlation : Correlation
        Lengths of the parts.
    """
    lags = np.arange(1, records)
    weights = np.asarray(correlation.of_lags(lags) @ (1 - lags / records))
    spread = 1 + 2 * np.asarray(np.asarray(shares) @ weights)
    return np.asarray(records / np.maximum(spread, 1 / max(records, 1)))


def variance_shares(values: Array, correlation: Correlation) -> Array:
    """Return the shares (4,) that fit the sample autocorrelation of a series best, none below zero; they sum to 1.

    Parameters
    ----------
    values : (n,) array
        The series, NaN where a value is missing.
    correlation : Correlation
        Lengths of the parts.

    Returns
    -------
    (4,) array
        White alone where the series has fewer than 8 values or does not vary.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 - heavy

    white = np.array([1.0, 0, 0, 0])
    known = np.isfinite(values)
    count = int(known.sum())
    if count < 8 or np.ptp(values[known]) == 0:  # noqa: PLR2004
        return white
    series = np.where(known, values - values[known].mean(), 0.0)
    lags = np.arange(max(2, int(_LAGS_PER_RECORD * series.size)))
    size = 2 ** math.ceil(math.log2(2 * series.size))
    pairs = _autocovariance(known.astype(np.float64), size, lags)
    sums = _autocovariance(series, size, lags)
    kept = pairs > 0.5  # noqa: PLR2004 - whole numbers with the errors of a transform
    rho = sums[kept] / pairs[kept]
    weight = np.sqrt(pairs[kept])  # the variance of an autocorrelation goes with one over its number of pairs
    found, _ = nnls((correlation.of_lags(lags[kept]) * weight).T, rho * weight)
    return found / found.sum() if found.sum() > 0 else white


def slow_variance(values: Array, *, lags: int = 5) -> tuple[Array, Array]:
    """Return the variance (...) that successive records share, of all series together, and its standard error.

    The mean autocovariance over some lags. Its error is that of white series that do not depend on each other
    (Bartlett 1946, J. R. Stat. Soc. Suppl. 8, 27-41).

    Parameters
    ----------
    values : (..., records, series) array
        The series, NaN where a value is missing.
    lags : int
        From 1 on: what is white has none there, and a process correlated over 5 records the half of its variance.
    """
    known = np.isfinite(values)
    count = np.maximum(known.sum(axis=-2), 1)
    filled = np.where(known, values, 0.0)
    away = np.where(known, filled - (filled.sum(axis=-2) / count)[..., None, :], 0.0)
    shared = np.zeros(values.shape[:-2])
    for lag in range(1, lags + 1):
        pairs = (known[..., lag:, :] & known[..., :-lag, :]).sum(axis=-2)
        products = (away[..., lag:, :] * away[..., :-lag, :]).sum(axis=-2)
        shared += (products / np.maximum(pairs, 1)).sum(axis=-1)
    variance = (away**2).sum(axis=-2) / count
    return shared / lags, np.sqrt((variance**2 / (lags * count)).sum(axis=-1))


def _autocovariance(series: Array, size: int, lags: NDArray[np.int64]) -> Array:
    power = np.abs(np.fft.rfft(series, size)) ** 2
    return np.asarray(np.fft.irfft(power, size)[lags])
