"""Control charts of a score, record by record: exponentially weighted means and a cumulative sum.

EWMA: Roberts (1959), Technometrics 1(3), 239-250; of weight 1 it is Shewhart's chart of single values. CUSUM: Page
(1954), Biometrika 41, 100-115. One-sided: a decrease is not a fault.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

    def restart(self, place: int) -> "ChartState":
        """Return the charts with those of one score reset."""
        others = np.arange(self.rising.size) != place
        return ChartState(values=self.values * others, rising=self.rising * others)

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
