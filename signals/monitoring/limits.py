"""Limits of control charts for a stated rate of false alarms, with the uncertainty of the baseline in them.

A baseline of few records, which depend on each other, leaves the mean and the deviation of a score uncertain; limits
that leave that out give several times the stated rate of false alarms (Jensen, Jones-Farmer, Champ and Woodall 2006,
J. Qual. Technol. 38(4), 349-364). A table has the limits at which healthy machines, each with its own baseline of as
many records, raised the stated number of alarms.

Alarms are those of the EWMAs. The CUSUM says since when a score rises: where the mean of a baseline is off by more than
its allowance it grows for ever, so that a limit which few machines reach is far beyond those of the EWMAs.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signals.monitoring.charts import Charts, ChartState

Array = NDArray[np.float64]
OF, WITHIN = 2, 3  # records at the limit that raise an alarm: what a single one shows is left out
AT_ONCE = 2.0  # index at which a single record does
_OF_A_SLOPE = 0.5
"""Error of a slope in what is foretold at the usual covariates, over that of the mean. It is 1 for white scores; for
what drifts the autocorrelations of score and covariate multiply: with a drift of 15 % of the variance, of states of
which half is correlated over 5 and half over 50 records, 0.4."""


@dataclass(frozen=True, kw_only=True)
class LimitTable:
    """Limits that healthy machines have shown.

    Attributes
    ----------
    baselines : (baselines,) array
        Independent records that a baseline was learned on.
    every : (rates,) array
        Mean records between false alarms of one score.
    limits : (groups, baselines, rates, ewmas) array
        Of each EWMA, in deviations of the score, for each group of scores that are alike in health.
    allowances : (baselines,) array
        Of the CUSUM: half a deviation, and what the mean may be off.
    """

    baselines: Array
    every: Array
    limits: Array
    allowances: Array

    def at(self, independent: Array, every: float, groups: tuple[int, ...]) -> Array:
        """Return the limits (ewmas, scores) for baselines of `independent` records (scores,), between the table's."""
        logs = np.log(self.limits)
        low, share = _place(np.array(every), self.every)
        logs = logs[:, :, low] + share * (logs[:, :, low + 1] - logs[:, :, low])
        low, share = _place(independent, self.baselines)
        group, share = np.array(groups), share[:, None]
        return np.asarray(np.exp(logs[group, low] + share * (logs[group, low + 1] - logs[group, low])).T)


def _place(value: Array, grid: Array) -> tuple[NDArray[np.int64], Array]:
    """Return after which points of a grid values lie, at most the last but one, and how far on in its logarithm."""
    place = np.interp(np.log(value), np.log(grid), np.arange(grid.size))
    low = np.minimum(place.astype(np.int64), grid.size - 2)
    return low, place - low


@dataclass(frozen=True, kw_only=True)
class MachineLimits:
    """Limits of all scores of a machine.

    Attributes
    ----------
    charts : Charts
        With the allowance for a baseline of that size.
    limits : (ewmas, scores) array
        Of each EWMA, in deviations of the score.
    every_records : float
        Mean number of records between false alarms of each score.
    decades : (scores,) array
        How the rate of false alarms falls: it is a tenth where the limits are higher by this factor less 1.
    """

    charts: Charts
    limits: Array
    every_records: float
    decades: Array

    def index(self, state: ChartState) -> Array:
        """Return the condition index (..., scores): the largest EWMA over its limit; 0 is normal, 1 the limit."""
        limits = self.limits.reshape(len(self.limits), *[1] * (state.rising.ndim - 1), -1)
        return np.asarray(np.maximum((state.values[:-1] / limits).max(axis=0), 0.0))

    def headroom(self, baseline: Array) -> Array:
        """Return by how much limits (scores,) are wider for scores with an alarm in their baseline (records, scores).

        An alarm that the records of a baseline raise by the rule m of n shows that bursts are normal there, and the
        index of later records is divided by this factor, 1 elsewhere. Single bad records, which the rule leaves out, do
        not count. k bursts of n records that exceed the limit u by a sum s are taken as exponential of unknown
        mean; the next one then exceeds u + x with the probability (1 + x/s)^-k (predictive distribution with a prior
        flat in the logarithm of the mean; Aitchison and Dunsmore 1975, Statistical Prediction Analysis). The factor is
        that at which the rule raises bursts at the stated rate, where they come independently, in a share
        (k + 1/2) / (n + 1) of the records (Jeffreys' prior).
        """
        records = baseline.shape[0]
        if records < WITHIN:
            return np.ones(baseline.shape[1:])
        over = np.nan_to_num(baseline) / self.limits[0] - 1
        windows = np.sort(sliding_window_view(over, WITHIN, axis=0), axis=-1)
        alarmed = windows[..., -OF].max(axis=0) >= 0
        count, total = (over >= 0).sum(axis=0), np.maximum(over, 0).sum(axis=0)
        ways = math.comb(WITHIN - 1, OF - 1)  # of a window that ends with a burst
        exceeded = (self.every_records * ways) ** (-1 / OF)  # probability of a record that the rate allows
        share = (count + 0.5) / (records + 1)
        beyond = total * ((share / exceeded) ** (1 / np.maximum(count, 1)) - 1)
        return np.asarray(np.where(alarmed, 1 + np.maximum(beyond, 0), 1.0))

    def bursts(self, baseline: Array) -> NDArray[np.bool_]:
        """Return whether a record of the baseline (records, ..., scores) would raise an alarm by itself."""
        return np.asarray(np.any(baseline >= AT_ONCE * self.limits[0], axis=0))

    def every_records_at(self, index: float) -> float:
        """Return in how many records a healthy score raises an alarm with the limit at an index: the least number."""
        exponent = np.minimum((index - 1) / self.decades, 300.0)  # beyond which floats end
        return float(self.every_records * 10 ** exponent.min())


def machine_limits(
    table: LimitTable, independent: Array, every_records: float, groups: tuple[int, ...], *, slopes: Array | float = 0.0
) -> MachineLimits:
    """Return the limits of all scores of a machine, each of which raises an alarm equally seldom.

    Parameters
    ----------
    table : LimitTable
        What healthy machines have shown.
    independent : (scores,) array
        Independent records that the baseline of each score was learned on.
    every_records : float
        Mean number of records of the machine until the first false alarm, over all its scores.
    groups : tuple of int
        Group of each score.
    slopes : float or (scores,) array
        Effective number of slopes on covariates that were learned on them, too: limits are those of a baseline of
        n / (1 + slopes / 2) records.
    """
    records, each = np.asarray(independent) / (1 + _OF_A_SLOPE * slopes), every_records * len(groups)
    limits = table.at(records, each, groups)
    allowance = float(np.interp(np.median(records), table.baselines, table.allowances))
    return MachineLimits(
        charts=Charts(allowance=allowance),
        limits=limits,
        every_records=each,
        decades=(table.at(records, 10 * each, groups) / limits - 1)[0],
    )
