"""Which of many series of the same records rise, step or grow: block permutations and a false discovery rate.

Records are put in another order in blocks, the same for all series, so that neither the dependence of the series on
each other nor that of neighbouring records is lost. The statistic of a series is the largest of three: its rank
correlation with time (monotone), and the correlations of its logarithm with the best step (the largest difference of
the means on either side of a record) and with time (exponential growth).
The false discovery rate at a value is the mean number of series that exceed it in the permutations over the number
that does (Tusher, Tibshirani and Chu 2001, PNAS 98(9), 5116-5121).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
FORMS = ("monotone", "step", "exponential")
FEWEST = 5  # records: five in order have p = 2 / 5! = 1/60; fewer are never significant
_PERMUTATIONS = 999
_MOST_GROUPS = 100  # of records, of which longer series are the medians: what a test costs grows with their number
_BLOCKS_FROM = 24  # records from which blocks leave enough orders: with blocks of 3, 8! of them
_MOST_STEPS = 24  # places of a step that are tried
_LEVEL = 0.99  # quantile of its permutations at which the three statistics are made alike


@dataclass(frozen=True, kw_only=True)
class TrendTests:
    """Tests of several series.

    Attributes
    ----------
    form : (series,) array of str
        Which of the three statistics is largest.
    rises : (series,) array
        Whether it rises rather than falls.
    discovery_rate : (series,) array
        Expected share of false ones among all series with at least this statistic; NaN for a constant series.
    """

    form: NDArray[np.str_]
    rises: NDArray[np.bool_]
    discovery_rate: Array


def trend_tests(values: Array, times: Array, *, seed: int = 1) -> TrendTests:
    """Return tests of the logarithms of series for trends over time.

    Parameters
    ----------
    values : (records, series) array
        Logarithms, NaN where missing.
    times : (records,) array
        Time of each record.
    seed : int
        Of the permutations.

    Raises
    ------
    ValueError
        If there are fewer than 5 records.
    """
    if len(times) < FEWEST:
        raise ValueError(f"{len(times)} records are too few to test; a trend needs {FEWEST}.")
    values, times = grouped(values[np.argsort(times, kind="stable")], np.sort(times))
    count, block = len(times), 1
    if count >= _BLOCKS_FROM:
        block = math.ceil(count ** (1 / 3))  # the rate of blocks for the variance of a mean (Kuensch 1989)
    varies = np.nanmax(values, axis=0, initial=-np.inf) > np.nanmin(values, axis=0, initial=np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        ranks, logs = _standardised(_ranks(values)), _standardised(values)
    shapes = _trend_shapes(times)
    orders = _block_orders(count, block, seed)
    signed = _correlations(ranks, logs, shapes[None])[0]
    permuted = np.moveaxis(shapes.astype(np.float32)[:, orders], 0, 1)
    drawn = np.abs(_correlations(ranks.astype(np.float32), logs.astype(np.float32), permuted))  # (orders, 3, series)
    alike = np.maximum(np.quantile(drawn[:, :, varies], _LEVEL, axis=(0, 2)) if varies.any() else np.ones(3), 1e-12)
    found = (np.abs(signed) / alike[:, None]).max(axis=0)
    null = (drawn / alike[:, None]).max(axis=1)
    place = np.abs(signed).argmax(axis=0)
    rises = np.take_along_axis(signed, place[None], axis=0)[0] > 0
    slack = 1e-5  # a permutation that restores the order has the same statistic but for the rounding of 4-byte floats
    return TrendTests(
        form=np.array(FORMS)[place],
        rises=rises,
        discovery_rate=_discovery_rate(found, null, varies, slack),
    )


def _discovery_rate(found: Array, null: Array, varies: NDArray[np.bool_], slack: float) -> Array:
    rates = np.full(found.size, np.nan)
    those = np.flatnonzero(varies)[np.argsort(-found[varies], kind="stable")]
    pool = np.sort(null[:, varies], axis=None).astype(np.float64)
    exceeding = pool.size - np.searchsorted(pool, found[those] - slack)
    rates[those] = (exceeding + 1) / (len(null) + 1) / np.arange(1, those.size + 1)
    for later, place in zip(those[:0:-1], those[-2::-1], strict=True):  # a larger statistic is no worse
        rates[place] = min(rates[place], rates[later])
    return np.asarray(np.minimum(rates, 1.0))


def _trend_shapes(times: Array) -> Array:
    """Return shapes over time of mean square 1 (2 + steps, records): ranks, steps after some records, and time."""
    count = len(times)
    least = 1 if count < _BLOCKS_FROM else 3
    after = np.unique(np.linspace(least, count - least, min(_MOST_STEPS, count - 2 * least + 1)).round().astype(int))
    steps = (np.arange(count) >= after[:, None]).astype(np.float64)
    return np.stack([_standardised(shape) for shape in (np.arange(count, dtype=np.float64), *steps, times)])


def _correlations(ranks: Floats, logs: Floats, shapes: Floats) -> Floats:
    """Return the signed correlations (orders, 3, series) with shapes (orders, shapes, records).

    Steps one by one: all at once leave the cache.
    """
    steps = shapes[:, 1] @ logs
    for number in range(2, shapes.shape[1] - 1):
        one = shapes[:, number] @ logs
        np.copyto(steps, one, where=np.abs(one) > np.abs(steps))
    return np.stack([shapes[:, 0] @ ranks, steps, shapes[:, -1] @ logs], axis=1) / len(ranks)


@lru_cache(maxsize=8)
def _block_orders(count: int, block: int, seed: int) -> NDArray[np.int64]:
    """Return the orders (permutations, records), the same for all machines with as many records."""
    rng = np.random.default_rng(seed)
    return np.array([_block_order(count, block, rng) for _ in range(_PERMUTATIONS)])


def _block_order(count: int, block: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the records in blocks of another order; where the first block begins is random, too."""
    turned = np.roll(np.arange(count), -int(rng.integers(block)))
    blocks = np.array_split(turned, max(1, count // block))
    return np.concatenate([blocks[i] for i in rng.permutation(len(blocks))])


def _standardised(values: Array) -> Array:
    known = np.isfinite(values)
    count = np.maximum(known.sum(axis=0), 1)
    filled = np.where(known, values, 0.0)
    centred = np.where(known, filled - filled.sum(axis=0) / count, 0.0)
    std = np.sqrt((centred**2).sum(axis=0) / count)
    return np.asarray(np.where(std > 0, centred / np.where(std > 0, std, 1.0), 0.0))


def _ranks(values: Array) -> Array:
    """Return ranks (records, series), equal values their mean rank; NaN where missing."""
    order = np.argsort(values, axis=0, kind="stable")  # NaN last
    differs = np.ones((len(values) + 1, values.shape[1]), dtype=np.bool_)
    differs[1:-1] = np.diff(np.take_along_axis(values, order, axis=0), axis=0) != 0
    place = np.arange(len(values) + 1)[:, None]
    first = np.maximum.accumulate(np.where(differs, place, 0), axis=0)[:-1]
    after = np.minimum.accumulate(np.where(differs, place, len(values))[::-1], axis=0)[::-1][1:]
    ranks = np.empty(values.shape)
    np.put_along_axis(ranks, order, (first + after + 1) / 2, axis=0)
    return np.where(np.isfinite(values), ranks, np.nan)


def grouped(values: Array, times: Array) -> tuple[Array, Array]:
    """Return `values` (records, series) and ascending `times`; of more than 100 records, medians of groups."""
    if len(times) <= _MOST_GROUPS:
        return values, times
    groups = np.array_split(np.arange(len(times)), _MOST_GROUPS)
    middle = [np.where(np.isfinite(values[g]).any(axis=0), _median(values[g]), np.nan) for g in groups]
    return np.array(middle), np.array([np.median(times[g]) for g in groups])


def _median(values: Array) -> Array:
    ordered = np.sort(values, axis=0)  # NaN last
    count = np.isfinite(values).sum(axis=0)
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, len(values) - 1)
    pick = [np.take_along_axis(ordered, at[None], axis=0)[0] for at in (low, high)]
    return np.asarray((pick[0] + pick[1]) / 2)
