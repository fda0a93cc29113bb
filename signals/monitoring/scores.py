"""A score of a component from its standardised indicators."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_LARGEST = 1 / 3  # of the indicators: a fault raises some of those of its kind, and seldom one alone


@dataclass(frozen=True, kw_only=True)
class Kinds:
    """Series of each kind of all components as one table, so that one sort serves all of them.

    Attributes
    ----------
    series : (kinds, width) array
        Series of each kind, -1 after the last.
    sizes : (kinds,) array
        Number of series of each.
    first : (components,) array
        First kind of each component.
    """

    series: Indices
    sizes: Indices
    first: Indices


def kinds_of(groups: Sequence[Sequence[Indices]]) -> Kinds:
    """Return the table of the series of each kind of each component; a component has at least one kind."""
    sizes = np.array([kind.size for kinds in groups for kind in kinds], dtype=np.int64)
    series = np.full((sizes.size, max(sizes, default=0)), -1, dtype=np.int64)
    for row, kind in zip(series, (kind for kinds in groups for kind in kinds), strict=True):
        row[: kind.size] = kind
    first = np.cumsum([0, *(len(kinds) for kinds in groups)])[:-1]
    return Kinds(series=series, sizes=sizes, first=first.astype(np.int64))


def fused_scores(departures: Array, kinds: Kinds) -> Array:
    """Return the score of each component: the largest over its kinds of the mean of their largest third.

    Between the mean of all, which is best where all rise alike, and the largest, which is best where one does; a single
    indicator that strays is diluted. A fault of one kind, as of one race of a bearing, is not diluted by the indicators
    of the others. NaN where less than half of every kind has a value.

    Parameters
    ----------
    departures : (..., series) array
        Standardised indicators; NaN where missing.
    kinds : Kinds
        Series of each kind of each component.

    Returns
    -------
    (..., components) array
    """
    if not kinds.first.size:
        return np.zeros((*departures.shape[:-1], 0))
    padded = np.concatenate([departures, np.full((*departures.shape[:-1], 1), np.nan)], axis=-1)
    ordered = np.sort(-padded[..., kinds.series], axis=-1)  # NaN last
    count = np.isfinite(ordered).sum(axis=-1)
    taken = np.ceil(count * _LARGEST)
    among = np.arange(ordered.shape[-1]) < taken[..., None]
    total = -np.add.reduce(ordered, axis=-1, where=among)
    enough = (count > 0) & (count * 2 >= kinds.sizes)
    found = np.where(enough, total / np.maximum(taken, 1), np.nan)
    return np.asarray(np.fmax.reduceat(found, kinds.first, axis=-1))


def out_of_sample(records: int, leverage: Array) -> Array:
    """Return the ratios (...) of the deviations of a new record and of a baseline's own about what that foretells.

    Of n independent records each departs from their mean with variance 1 - 1/n, from a regression on them by its
    leverage h less, a new one with 1 + 1/n. A score that is not linear in the departures has the same mean for both
    only after this correction.
    """
    return np.asarray(np.sqrt((1 + 1 / records) / np.maximum(1 - 1 / records - leverage, 1 / records)))
