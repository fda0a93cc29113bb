"""Limits of control charts for a stated rate of false alarms, with what a baseline leaves uncertain in them.

A baseline of few records, which depend on each other, leaves mean, deviation and memory of a score uncertain; limits
that leave that out give several times the stated rate of false alarms (Jensen, Jones-Farmer, Champ and Woodall 2006,
J. Qual. Technol. 38(4), 349-364). Here limits are quantiles of what is foretold of later records. An alarm by two of
three records needs the mean of two values of a chart, z, to reach the limit u. For each model j of scatter and memory,
with the posterior probability p_j, that mean is a normal variable about the baseline's mean, so that

    sum_j p_j P(N > u / s_j) = q,    s_j^2 = var_j(mean of two of z) + var_j(mean of the baseline)

q is the stated probability of an alarm in a record for single values. An EWMA of weight l exceeds its limit in runs,
since it stays where it is for about 1 / l records, and its q is larger by l^(-1/2) (our choice, with which all charts
together raise at most as many alarms as stated).

Alarms are those of the EWMAs. The CUSUM says since when a score rises: where the mean of a baseline is off by more than
its allowance it grows for ever, so that a limit which few machines reach is far beyond those of the EWMAs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signals.monitoring.charts import Charts, ChartState
from signals.monitoring.memory import Memory

Array = NDArray[np.float64]
OF, WITHIN = 2, 3  # records at the limit that raise an alarm: what a single one shows is left out
AT_ONCE = 2.0  # index at which a single record does


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

        An alarm that the records of a baseline raise by the rule m of n shows that bursts are normal there: limits are
        then twice the index that it had (our choice: few bursts tell little of how large they get), and the index of
        later records is divided by this factor, 1 elsewhere. Single bad records, which the rule leaves out, do not
        count.
        """
        if len(baseline) < WITHIN:
            return np.ones(baseline.shape[1:])
        windows = np.sort(sliding_window_view(np.nan_to_num(baseline) / self.limits[0], WITHIN, axis=0), axis=-1)
        reached = windows[..., -OF].max(axis=0)
        return np.where(reached >= 1, 2 * reached, 1.0)

    def bursts(self, baseline: Array) -> NDArray[np.bool_]:
        """Return whether a record of the baseline (records, ..., scores) would raise an alarm by itself."""
        return np.asarray(np.any(baseline >= AT_ONCE * self.limits[0], axis=0))

    def every_records_at(self, index: float) -> float:
        """Return in how many records a healthy score raises an alarm with the limit at an index: the least number."""
        exponent = np.minimum((index - 1) / self.decades, 300.0)  # beyond which floats end
        return float(self.every_records * 10 ** exponent.min())


def machine_limits(memory: Memory, every_records: float, *, slopes: float = 0.0) -> MachineLimits:
    """Return the limits of all scores of a machine, each of which raises an alarm equally seldom.

    Parameters
    ----------
    memory : Memory
        What the baseline tells of the scores.
    every_records : float
        Mean number of records between false alarms of the machine, over all its scores.
    slopes : float
        Effective number of slopes on covariates that were learned on the baseline, too: each makes what is foretold at
        the usual covariates as uncertain as the mean does.
    """
    each, of_mean = every_records * memory.weight.shape[1], memory.of_mean * (1 + slopes)
    weights = np.array(Charts().weights)[:, None]
    filters = weights * (1 - weights) ** np.arange(memory.lags.shape[1])
    scale = np.sqrt([memory.filtered(np.convolve(one, [0.5, 0.5])) + of_mean for one in filters])
    above = np.minimum(1 / (np.sqrt(weights) * each), 0.4)
    usual = np.sqrt(memory.usual)
    limits, decade = (usual * _quantile(memory.weight, scale, chance) for chance in (above, 0.1 * above))
    off = float(np.median(usual * np.sqrt(of_mean @ memory.weight)))
    return MachineLimits(
        charts=Charts(allowance=0.5 + 2 * off),  # half a deviation, and what the mean may be off
        limits=limits,
        every_records=each,
        decades=(decade / limits - 1)[0],
    )


def _quantile(weight: Array, scale: Array, above: Array) -> Array:
    """Return the values (ewmas, scores) that mixtures of normal variables exceed with a probability (ewmas, 1).

    `weight` (models, scores) is that of normal variables with deviations `scale` (ewmas, models).
    """
    from scipy.special import ndtr, ndtri  # noqa: PLC0415 - slow to import

    high = np.broadcast_to(-ndtri(above) * scale.max(axis=1)[:, None], (len(scale), weight.shape[1]))
    low = np.zeros_like(high)
    for _ in range(14):  # to 0.006 % of the widest model's
        middle = (low + high) / 2
        exceeds = np.einsum("ms,ems->es", weight, ndtr(-middle[:, None] / scale[..., None])) > above
        low, high = np.where(exceeds, middle, low), np.where(exceeds, high, middle)
    return high
