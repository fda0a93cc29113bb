"""Control charts of a score, record by record, and their limits for a stated rate of false alarms.

EWMA: Roberts (1959), Technometrics 1(3), 239-250; of weight 1 it is Shewhart's chart of single values. CUSUM: Page
(1954), Biometrika 41, 100-115. One-sided: a decrease is not a fault.

A baseline of few, autocorrelated records leaves the mean and the deviation of a score uncertain; limits that neglect
this give several times the stated rate of false alarms (Jensen, Jones-Farmer, Champ and Woodall 2006, J. Qual. Technol.
38(4), 349-364). A table has the limits at which healthy machines, each with its own baseline of the same size, raised
the stated number of alarms.

Alarms are raised by the EWMAs. The CUSUM dates the onset of a rise: if the mean of a baseline is in error by more than
its allowance, it grows without bound, so a limit that few machines reach would be far beyond those of the EWMAs.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.interpolate import interpn

Array = NDArray[np.float64]


WEIGHTS = (1.0, 0.2, 0.05)
"""Of the EWMAs: 1 detects a jump in one record; 0.2 and 0.05 detect shifts of about 1 and 0.5 standard deviations
soonest (Lucas and Saccucci 1990, Technometrics 32(1), 1-12)."""
_ALONE = 3.0
"""Largest contribution of a record, in deviations, to charts with memory, unless the preceding one was as high: a
single outlier would otherwise persist in the EWMAs and the CUSUM and raise an alarm of two in three by itself (two in a
row; Lucas and Crosier 1982, Commun. Stat. Theory Methods 11(23), 2669-2685). A normal score exceeds three once in 740
records (our choice)."""


@dataclass(frozen=True, kw_only=True)
class ChartState:
    """Charts after the latest record.

    Attributes
    ----------
    values : (charts, ...) array
        EWMAs in the order of their weights, the first of them the latest score, then the CUSUM, in standard deviations
        of the score.
    rising : (...) array
        Records since the CUSUM was last zero, the maximum-likelihood estimate of when the mean changed.
    """

    values: Array
    rising: NDArray[np.int64]

    @classmethod
    def start(cls, shape: tuple[int, ...] = ()) -> "ChartState":
        """Return the charts of scores of a given shape before the first record."""
        return cls(values=np.zeros((len(WEIGHTS) + 1, *shape)), rising=np.zeros(shape, dtype=np.int64))

    def step(self, score: Array, *, allowance: float) -> "ChartState":
        """Return the charts after one more record with `score` (...); NaN leaves them unchanged.

        The CUSUM subtracts the `allowance` from each value, in deviations: half of the shift to be detected, plus the
        uncertainty of the baseline's mean.
        """
        judged = np.isfinite(score)
        weights = np.reshape(WEIGHTS, (-1, *[1] * np.ndim(score)))
        counted = np.minimum(score, np.maximum(_ALONE, self.values[0]))
        ewma = self.values[:-1] + weights * (np.where(weights == 1, score, counted) - self.values[:-1])
        cusum = np.maximum(0.0, self.values[-1] + counted - allowance)
        values = np.where(judged, np.concatenate([ewma, cusum[None]]), self.values)
        rising = np.where(judged, np.where(cusum > 0, self.rising + 1, 0), self.rising)
        return ChartState(values=values, rising=rising)


# ---- limits ----------------------------------------------------------------------------------------------------------


OF, WITHIN = 2, 3  # records at the limit that raise an alarm: what a single one shows is left out
AT_ONCE = 2.0  # index at which a single record does
_OF_A_SLOPE = 0.5
"""Ratio of the contributions of a slope and of the mean to the error of the prediction at typical covariates. It is 1
for white scores; for drift, the autocorrelations of score and covariate multiply: 0.4 for a drift of 15 % of the
variance, half of it correlated over 5 and half over 50 records."""


@dataclass(frozen=True, kw_only=True)
class LimitTable:
    """Limits learned from healthy machines.

    Attributes
    ----------
    baselines : (baselines,) array
        Number of independent records of the baseline.
    every : (rates,) array
        Mean records between false alarms of one score.
    limits : (groups, baselines, rates, ewmas) array
        Of each EWMA, in deviations of the score, for each group of scores with the same distribution in health.
    allowances : (baselines,) array
        Allowance of the CUSUM: half a deviation, plus the uncertainty of the mean.
    """

    baselines: Array
    every: Array
    limits: Array
    allowances: Array


@dataclass(frozen=True, kw_only=True)
class MachineLimits:
    """Limits of all scores of a machine.

    Attributes
    ----------
    allowance : float
        Allowance of the CUSUM for a baseline of that size.
    limits : (ewmas, scores) array
        Of each EWMA, in deviations of the score.
    every_records : float
        Mean number of records between false alarms of each score.
    """

    allowance: float
    limits: Array
    every_records: float

    def index(self, state: ChartState) -> Array:
        """Return the condition index (scores,): the largest EWMA over its limit; 0 is normal, 1 the limit."""
        return np.asarray(np.maximum((state.values[:-1] / self.limits).max(axis=0), 0.0))

    def widened(self, baseline: Array) -> "MachineLimits":
        """Return the limits after alarms in the scores (records, scores) of the baseline itself.

        An alarm that it raises by the rule m of n shows that bursts are normal, and widens the limits of its score by a
        factor. Single outliers, which the rule ignores, do not count. k bursts of n records that exceed the limit u by
        a sum s are taken as exponential of unknown mean; the next one then exceeds u + x with the probability (1 +
        x/s)^-k (predictive distribution with a prior flat in the logarithm of the mean; Aitchison and Dunsmore 1975,
        Statistical Prediction Analysis). The factor is that at which the rule responds to bursts at the stated rate, if
        they occur independently in a share (k + 1/2) / (n + 1) of the records (Jeffreys' prior).
        """
        records = baseline.shape[0]
        if records < WITHIN:
            return self
        over = np.nan_to_num(baseline) / self.limits[0] - 1
        windows = np.sort(sliding_window_view(over, WITHIN, axis=0), axis=-1)
        alarmed = windows[..., -OF].max(axis=0) >= 0
        count, total = (over >= 0).sum(axis=0), np.maximum(over, 0).sum(axis=0)
        ways = math.comb(WITHIN - 1, OF - 1)  # of a window that ends with a burst
        exceeded = (self.every_records * ways) ** (-1 / OF)  # probability of a record that the rate allows
        share = (count + 0.5) / (records + 1)
        beyond = total * ((share / exceeded) ** (1 / np.maximum(count, 1)) - 1)
        return replace(self, limits=self.limits * np.where(alarmed, 1 + np.maximum(beyond, 0), 1.0))

    def bursts(self, baseline: Array) -> NDArray[np.bool_]:
        """Return whether a record of the baseline (records, ..., scores) would raise an alarm by itself."""
        return np.asarray(np.any(baseline >= AT_ONCE * self.limits[0], axis=0))


def machine_limits(
    table: LimitTable, independent: Array, every_records: float, groups: tuple[int, ...], *, slopes: Array | float = 0.0
) -> MachineLimits:
    """Return the limits of all scores of a machine, each with the same rate of false alarms.

    Parameters
    ----------
    table : LimitTable
        Limits learned from healthy machines.
    independent : (scores,) array
        Number of independent records of the baseline of each score.
    every_records : float
        Mean number of records of the machine until the first false alarm, over all its scores.
    groups : tuple of int
        Group of each score.
    slopes : float or (scores,) array
        Effective number of slopes on covariates learned from the same records: limits are those of a baseline of n / (1
        + slopes / 2) records.
    """
    records, each = np.asarray(independent) / (1 + _OF_A_SLOPE * slopes), every_records * len(groups)
    allowance = float(np.interp(np.median(records), table.baselines, table.allowances))
    axes = np.log(table.baselines), np.log(table.every)
    points = np.stack(np.broadcast_arrays(groups, np.log(records), np.log(each)), axis=-1)
    points[:, 1:] = np.clip(points[:, 1:], *np.transpose([axis[[0, -1]] for axis in axes]))
    limits = np.exp(interpn((np.arange(len(table.limits)), *axes), np.log(table.limits), points).T)
    return MachineLimits(allowance=allowance, limits=limits, every_records=each)
