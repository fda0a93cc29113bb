"""Control charts of a score, record by record: exponentially weighted means and a cumulative sum.

EWMA: Roberts (1959), Technometrics 1(3), 239-250; of weight 1 it is Shewhart's chart of single values. CUSUM: Page
(1954), Biometrika 41, 100-115. One-sided: a decrease is not a fault.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ChartState:
    """Charts after the latest record.

    Attributes
    ----------
    values : (charts, ...) array
        EWMAs in the order of their weights, then the CUSUM, in standard deviations of the score.
    rising : (...) array
        Records since the CUSUM was last zero, the maximum-likelihood estimate of when the mean changed.
    """

    values: Array
    rising: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Charts:
    """Weights of the EWMAs, and the allowance of the CUSUM in standard deviations.

    Attributes
    ----------
    weights : tuple of float
        1 detects a jump in one record; 0.2 and 0.05 detect shifts of about 1 and 0.5 standard deviations soonest (Lucas
        and Saccucci 1990, Technometrics 32(1), 1-12). The first must be 1: its chart is the latest score.
    allowance : float
        Subtracted from each value: half of the shift to be detected, plus the uncertainty of the baseline's mean.
    alone : float
        Largest contribution of a record, in deviations, to charts with memory, unless the preceding one was as high: a
        single outlier would otherwise persist in the EWMAs and the CUSUM and raise an alarm of two in three by itself
        (two in a row; Lucas and Crosier 1982, Commun. Stat. Theory Methods 11(23), 2669-2685). Three: a normal score
        exceeds that once in 740 records (our choice).
    """

    weights: tuple[float, ...] = (1.0, 0.2, 0.05)
    allowance: float = 0.5
    alone: float = 3.0

    def __post_init__(self) -> None:
        if not self.weights or self.weights[0] != 1.0:
            raise ValueError(f"weights = {self.weights}: the first chart is the latest score; begin with 1.")

    def start(self, shape: tuple[int, ...] = ()) -> ChartState:
        """Return the charts of scores of a given shape before the first record."""
        return ChartState(values=np.zeros((len(self.weights) + 1, *shape)), rising=np.zeros(shape, dtype=np.int64))

    def restart(self, state: ChartState, place: int) -> ChartState:
        """Return the charts with those of one score reset."""
        values, rising = state.values.copy(), state.rising.copy()
        values[..., place], rising[..., place] = 0.0, 0
        return ChartState(values=values, rising=rising)

    def step(self, state: ChartState, score: Array) -> ChartState:
        """Return the charts after one more record with `score` (...); NaN leaves them unchanged."""
        judged = np.isfinite(score)
        weights = np.reshape(self.weights, (-1, *[1] * np.ndim(score)))
        counted = np.minimum(score, np.maximum(self.alone, state.values[0]))
        ewma = state.values[:-1] + weights * (
            np.stack([score, *[counted] * (len(self.weights) - 1)]) - state.values[:-1]
        )
        cusum = np.maximum(0.0, state.values[-1] + counted - self.allowance)
        values = np.where(judged, np.concatenate([ewma, cusum[None]]), state.values)
        rising = np.where(judged, np.where(cusum > 0, state.rising + 1, 0), state.rising)
        return replace(state, values=values, rising=rising)
