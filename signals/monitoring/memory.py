"""How the scores of a machine scatter and depend on each other in time, as far as the records of a baseline tell.

    y_k = mu + e_k + u(t_k),    var e = v s^2,    cov(u(t_j), u(t_k)) = w s^2 exp(-|t_j - t_k| / m)

White noise e and an Ornstein-Uhlenbeck process u, in units of the deviation s that is usual over machines. A memory m
that is longer than a day or flight, and shorter than the time between them, is the effect of the day, nested in the
machine. No short baseline tells v, w and m, so that models on a grid are weighted by their restricted likelihoods
(Patterson and Thompson 1971, Biometrika 58(3), 545-554) and a prior about what is usual, as variances are moderated
(Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3(1), 3).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.charts import Charts

Array = NDArray[np.float64]
_DAY_S = 86400.0
_MEMORIES_S = 1800.0 * 6.0 ** np.arange(6)  # half an hour to 162 days: oil warms within an hour, seasons last
_VARIANCES = 2.0 ** np.arange(-6.0, 4.0)  # of the white noise
_DRIFTS = (0.25, 0.5, 1.0, 2.0)  # variances of what has a memory
_WHITE = 0.5  # prior probability that nothing has one; drifts and memories share the rest evenly
_SPREAD = 0.25
"""Prior of a score's variance: Laplace about the usual one in the logarithm, so that most machines are within a quarter
of it, and one that scatters ten times less is no sign of a memory. With these priors, our choice, the stated rate of
false alarms holds for machines with and without memory and effects of days (`docs/benchmarks/fleet.md`)."""
_MOST = 100  # records whose correlations are looked at, the latest


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Models of the scores of a baseline.

    Attributes
    ----------
    weight : (models, scores) array
        Posterior probability of each model.
    white, drift : (models,) array
        Variances of white noise and of what has a memory, over that usual for the score.
    usual : (scores,) array
        That variance.
    memory : (models,) array of int
        Number of the memory of each model.
    mean_of : (memories,) array
        Variance of the mean of what has a memory over the baseline's records, over that of a record.
    lags : (memories, most) array
        Its correlation 1, 2, ... records apart, where later records come at the intervals of the baseline's.
    records : int
        Of the baseline.
    """

    weight: Array
    white: Array
    drift: Array
    usual: Array
    memory: NDArray[np.int64]
    mean_of: Array
    lags: Array
    records: int

    @property
    def of_mean(self) -> Array:
        """Variance (models,) of the mean of the baseline's records, over that usual for a score."""
        return np.asarray(self.white / self.records + self.drift * self.mean_of[self.memory])

    @property
    def shown(self) -> Array:
        """Share (scores,) of the variance of a score that the records of the baseline show about their mean."""
        hidden = self.drift * self.mean_of[self.memory] / (self.white + self.drift)
        return np.asarray((1 - hidden) @ self.weight)

    def filtered(self, weights: Array) -> Array:
        """Return the variance (models,) of a moving average of scores with `weights` (n,), over that usual."""
        square = np.correlate(weights, weights, mode="full")[weights.size - 1 :]
        reach = min(square.size - 1, self.lags.shape[1])
        drifting = square[0] + 2 * self.lags[:, :reach] @ square[1 : reach + 1]
        return np.asarray(self.white * square[0] + self.drift * drifting[self.memory])


def learn_memory(scores: Array, times_s: Array, *, prior_scale: Array | float) -> Memory:
    """Return what the scores of a baseline tell of their scatter and memory.

    Parameters
    ----------
    scores : (records, scores) array
        About their mean, which a missing value is taken as.
    times_s : (records,) array
        Their times in seconds; where one is NaN, records are taken as a day apart.
    prior_scale : array or float
        Standard deviation that is usual for each score.
    """
    records = len(scores)
    times = times_s if np.isfinite(times_s).all() else _DAY_S * np.arange(records)
    far = Charts().alone  # a few bad records are not the machine's scatter
    latest, t = np.nan_to_num(np.clip(scores[-_MOST:], -far, far)), times[-_MOST:]
    usual = np.broadcast_to(np.square(prior_scale), latest.shape[1:])
    correlation = np.exp(-np.abs(t[:, None] - t) / _MEMORIES_S[:, None, None])
    values, vectors = np.linalg.eigh(correlation)  # in which white noise and drift of any variance are independent
    turned = np.swapaxes(vectors, 1, 2)
    level, found = turned.sum(axis=2), turned @ (latest / np.sqrt(usual))
    drifts = np.array([0.0, *_DRIFTS])
    memory, white, drift = (axis.ravel() for axis in np.meshgrid(np.arange(len(values)), _VARIANCES, drifts))
    precision = 1 / (white[:, None] + drift[:, None] * np.maximum(values[memory], 0.0))
    ones = (precision * level[memory] ** 2).sum(axis=1)
    square, cross = np.empty((2, memory.size, usual.size))
    for number in range(len(values)):
        those = memory == number
        square[those] = precision[those] @ found[number] ** 2
        cross[those] = (precision[those] * level[number]) @ found[number]
    left = square - cross**2 / ones[:, None]
    none = drift == 0  # the same for each memory
    prior = (
        np.where(none, _WHITE, (1 - _WHITE) / len(_DRIFTS))
        / len(values)
        * np.exp(-np.abs(np.log(white + drift)) / _SPREAD)
    )
    likelihood = (np.log(precision).sum(axis=1) - np.log(ones))[:, None] / 2 - left / 2
    weight = prior[:, None] * np.exp(likelihood - likelihood.max(axis=0))
    return Memory(
        weight=weight / weight.sum(axis=0),
        white=white,
        drift=drift,
        usual=usual,
        memory=memory,
        mean_of=correlation.mean(axis=(1, 2)) * t.size / records,
        lags=_lags(t),
        records=records,
    )


def _lags(times: NDArray[Any], most: int = 100) -> Array:
    """Return correlations (memories, most) at lags in records, those between the records at `times` repeated."""
    count = len(times)
    again = np.resize(np.diff(times), count + most) if count > 1 else np.full(count + most, _DAY_S)
    along = np.concatenate([[0.0], np.cumsum(again)])
    starts = np.arange(count)[:, None]
    apart = along[starts + np.arange(1, most + 1)] - along[starts]
    return np.asarray(np.exp(-apart / _MEMORIES_S[:, None, None]).mean(axis=1))
