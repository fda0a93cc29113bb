"""A score of a component from its standardised indicators."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["fused_scores", "out_of_sample"]

Array = NDArray[np.float64]
_LARGEST = 1 / 3  # of the indicators: a fault raises some of those of its component, and seldom one alone


def fused_scores(departures: Array, groups: Sequence[NDArray[np.int64]]) -> Array:
    """Return the mean of the largest third of the departures of each group.

    Between the mean of all, which is best where all rise alike, and the largest, which is best where one does; a single
    indicator that strays is diluted. NaN where less than half of a group has a value.

    Parameters
    ----------
    departures : (..., series) array
        Standardised indicators; NaN where missing.
    groups : sequence of (k,) int array
        Series of each component.

    Returns
    -------
    (..., groups) array
    """
    scores = np.full((*departures.shape[:-1], len(groups)), np.nan)
    for number, group in enumerate(groups):
        if not group.size:
            continue
        values = departures[..., group]
        known = np.isfinite(values)
        taken = np.ceil(known.sum(axis=-1) * _LARGEST)
        ordered = -np.sort(-np.where(known, values, -np.inf), axis=-1)
        counted = np.arange(group.size) < taken[..., None]
        total = np.where(counted, ordered, 0.0).sum(axis=-1)
        enough = known.sum(axis=-1) * 2 >= group.size
        scores[..., number] = np.where(enough, total / np.maximum(taken, 1), np.nan)
    return scores


def out_of_sample(records: int) -> float:
    """Return the ratio of the standard deviations of a new record and of a baseline's own about the baseline's mean.

    Of n independent records each departs from their mean with variance 1 - 1/n, a new one with 1 + 1/n. A score that is
    not linear in the departures has the same mean for both only after this correction.
    """
    return math.sqrt((records + 1) / (records - 1)) if records > 1 else 1.0
