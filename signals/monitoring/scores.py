"""A score of a component from its standardised indicators."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["fused_scores", "out_of_sample"]

Array = NDArray[np.float64]
_LARGEST = 1 / 3  # of the indicators: a fault raises some of those of its kind, and seldom one alone


def fused_scores(departures: Array, groups: Sequence[Sequence[NDArray[np.int64]]]) -> Array:
    """Return the score of each component: the largest over its kinds of the mean of their largest third.

    Between the mean of all, which is best where all rise alike, and the largest, which is best where one does; a single
    indicator that strays is diluted. A fault of one kind, as of one race of a bearing, is not diluted by the indicators
    of the others. NaN where less than half of every kind has a value.

    Parameters
    ----------
    departures : (..., series) array
        Standardised indicators; NaN where missing.
    groups : sequence of sequence of (k,) int array
        Series of each kind of each component.

    Returns
    -------
    (..., groups) array
    """
    scores = np.full((*departures.shape[:-1], len(groups)), np.nan)
    of_size: dict[int, list[tuple[int, NDArray[np.int64]]]] = {}
    for number, kinds in enumerate(groups):
        for kind in kinds:
            of_size.setdefault(kind.size, []).append((number, kind))
    for those in of_size.values():  # kinds of one size at once
        found = _largest_third(departures[..., np.array([kind for _, kind in those])])
        for place, (number, _) in enumerate(those):
            scores[..., number] = np.fmax(scores[..., number], found[..., place])
    return scores


def _largest_third(values: Array) -> Array:
    known = np.isfinite(values)
    count = known.sum(axis=-1)
    taken = np.ceil(count * _LARGEST)
    ordered = -np.sort(-np.where(known, values, -np.inf), axis=-1)
    counted = np.arange(values.shape[-1]) < taken[..., None]
    total = np.where(counted, ordered, 0.0).sum(axis=-1)
    enough = (count > 0) & (count * 2 >= values.shape[-1])
    return np.where(enough, total / np.maximum(taken, 1), np.nan)


def out_of_sample(records: int) -> float:
    """Return the ratio of the standard deviations of a new record and of a baseline's own about the baseline's mean.

    Of n independent records each departs from their mean with variance 1 - 1/n, a new one with 1 + 1/n. A score that is
    not linear in the departures has the same mean for both only after this correction.
    """
    return math.sqrt((records + 1) / (records - 1)) if records > 1 else 1.0
