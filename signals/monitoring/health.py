"""Baselines of a machine's series, and the scores of its components relative to them.

Series are logarithms, so a gain adds equally to all that have the unit of the signal: their median deviation is the
level of the channel, which is monitored separately for rises and sudden falls, and subtracted before components are
judged. A drifting gain is therefore not mistaken for a fault.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.location import SeriesBaseline, learn_baseline
from signals.monitoring.memory import independent_records

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
FEWEST_LEVELS = 8  # series with the signal's unit whose median is a level; of fewer, one fault could move it
_QUANTILES = np.array((0.5, 0.25, 0.75))  # the level, and what is watched: three in four have to rise, or to fall
_LARGEST = 1 / 3  # of the indicators: a fault raises some of those of its kind, and seldom one alone
_RECENT = 0.1  # weight of the EWMA that a sudden fall of the level is held against


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Series of each kind of each component, and those of each channel whose common level is its gain.

    Attributes
    ----------
    components : tuple of tuple of (k,) int array
        Series of each kind of each component, as of its indicators and of its lines, or of each race.
    channels : tuple of (k,) int array
        Series of each channel that have the signal's unit, or a power of it.
    powers : (series,) array
        Power of the signal's unit: 1 for an amplitude, 2 for an energy, 0 for a ratio.
    groups : tuple of int
        Group of the score of each component, 0 or above: scores of one group share their limits. Empty: all in one.
    """

    components: tuple[tuple[Indices, ...], ...]
    channels: tuple[Indices, ...] = ()
    powers: Array
    groups: tuple[int, ...] = ()

    @cached_property
    def kinds(self) -> Indices:
        """Series (kinds, width) of each kind of all components, filled up with -1."""
        rows = (kind for kinds in self.components for kind in kinds)
        return np.array(list(zip_longest(*rows, fillvalue=-1)), dtype=np.int64).T

    @cached_property
    def first(self) -> Indices:
        """First kind (components,) of each component."""
        return np.cumsum([0, *(len(kinds) for kinds in self.components)])[:-1]

    @cached_property
    def series(self) -> tuple[Indices, ...]:
        """Series of each component, of all its kinds."""
        return tuple(map(np.concatenate, self.components))

    @cached_property
    def gains(self) -> Array:
        """Power (channels, series) with which the gain of a channel enters each series."""
        found = np.zeros((len(self.channels), self.powers.size))
        for row, those in zip(found, self.channels, strict=True):
            row[those] = self.powers[those]
        return found

    @property
    def group_of(self) -> tuple[int, ...]:
        """Group of each score; levels belong to the first."""
        return (*(self.groups or (0,) * len(self.components)), *(0,) * (2 * len(self.channels)))


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Typical standard deviations over machines, and their weight as a number of records.

    ``series`` has one for each series, and ``least`` the least one; ``score`` is that of each fused
    score, ``level`` of a channel's level, in the unit of the series.
    """

    series: Array
    score: Array | float
    level: float
    dof: float
    least: Array | float = 0.0


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A record relative to the baseline.

    ``departures`` (..., series) and ``scores`` (..., scores) are in deviations, ``level`` (..., channels) is the median
    deviation of a channel, and ``recent`` (..., channels) the EWMA to which a sudden fall is referred.
    """

    departures: Array
    scores: Array
    level: Array
    recent: Array


@dataclass(frozen=True, kw_only=True)
class Normal:
    """Baselines of the series, levels and scores of a machine.

    ``raw`` is that of the unchanged series, ``series`` without the level of their channel, ``level`` (2, ..., channels)
    of the quantiles whose rise and sudden fall are monitored, and ``score`` that of the fused scores.
    """

    layout: Layout
    raw: SeriesBaseline
    series: SeriesBaseline
    level: SeriesBaseline
    score: SeriesBaseline

    def read(self, values: Array, covariates: Array, recent: Array | None = None) -> Reading:
        """Return a record (..., series) at covariates (..., covariates) relative to the baseline.

        `recent` (..., channels) is that of the preceding record; zero at the start.
        """
        away = self.raw.standardised(values, covariates) * self.raw.scale
        level, *quantiles = _levels(away, self.layout)
        high, low = (found - center for found, center in zip(quantiles, self.level.center, strict=True))
        corrected = values - np.nan_to_num(level) @ self.layout.gains
        departures = self.series.standardised(corrected, covariates) / _wider(self.series, covariates)
        fused = fused_scores(departures, self.layout)
        before = np.zeros_like(level) if recent is None else recent
        levels = np.concatenate([high, before - low], axis=-1) / np.concatenate(self.level.scale, axis=-1)
        components = (fused - self.score.center) / self.score.scale
        return Reading(
            departures=departures,
            scores=np.concatenate([components, levels / _wider(self.raw, covariates)], axis=-1),
            level=level,
            recent=before + _RECENT * np.nan_to_num(low - before),
        )


def learn_normal(
    values: Array, covariates: Array, layout: Layout, prior: Prior, *, independent: Array | float = 1.0
) -> Normal:
    """Learn the baselines from the records.

    Parameters
    ----------
    values : (..., records, series) array
        Logarithms of indicators of at least 2 records; NaN where missing.
    covariates : (..., records, covariates) array
        Operating conditions of the records.
    layout : Layout
        Series by component and channel.
    prior : Prior
        Typical standard deviations.
    independent : float or (..., 1) array
        Ratio of the effective number of independent records to their number, which weights the records' own deviations
        against the typical ones.

    Returns
    -------
    Normal
    """
    records = values.shape[-2]
    learned = partial(learn_baseline, prior_dof=prior.dof, independent=independent)
    raw = learned(values, covariates, prior_scale=prior.series, least_scale=prior.least)
    away = _each(lambda seen, at: raw.standardised(seen, at) * raw.scale, values, covariates)
    level, *quantiles = _levels(away, layout)
    corrected = values - np.nan_to_num(level) @ layout.gains
    series = learned(corrected, covariates, prior_scale=prior.series, least_scale=prior.least)
    new = out_of_sample(records, _each(series.leverage, covariates, axis=-1))
    departures = _each(series.standardised, corrected, covariates) * new[..., None]
    fused = fused_scores(departures, layout)
    nothing = np.zeros((*values.shape[:-1], 0))
    return Normal(
        layout=layout,
        raw=raw,
        series=series,
        level=learned(np.stack(quantiles), np.stack([nothing] * len(quantiles)), prior_scale=prior.level),
        score=learned(fused, nothing, prior_scale=prior.score),
    )


def learn_machine(
    values: Array, covariates: Array, times_s: Array, layout: Layout, prior: Prior
) -> tuple[Normal, Array, Array]:
    """Learn the baselines from records that count by their autocorrelation in time.

    Parameters
    ----------
    values, covariates, layout, prior
        As of `learn_normal`.
    times_s : (records,) array
        Times of the records in seconds.

    Returns
    -------
    Normal
        The baselines.
    (records, ..., scores) array
        Scores of the records themselves.
    (..., scores) array
        Number of independent records of each score.
    """
    records = values.shape[-2]

    def own(normal: Normal) -> Array:
        return _each(lambda seen, at: normal.read(seen, at).scores, values, covariates, axis=0)

    scores = own(learn_normal(values, covariates, layout, prior))
    counted = independent_records(scores.reshape(records, -1), times_s).reshape(2, *scores.shape[1:])
    independent, share = counted[0], np.median(counted[1], axis=-1, keepdims=True) / records
    normal = learn_normal(values, covariates, layout, prior, independent=share)
    return normal, own(normal), independent


def _each(found: Callable[..., Array], *records: Array, axis: int = -2) -> Array:
    """Return what is found of each record of arrays (..., records, numbers), along an axis."""
    return np.stack([found(*(those[..., n, :] for those in records)) for n in range(records[0].shape[-2])], axis=axis)


def _wider(baseline: SeriesBaseline, covariates: Array) -> Array:
    """Return the factor by which deviations (..., 1) widen at covariates, by the errors of slopes."""
    return np.asarray(np.sqrt(1 + baseline.leverage(covariates)[..., None] / (1 + 1 / baseline.records)))


def _levels(departures: Array, layout: Layout) -> Array:
    """Return `_QUANTILES` (3, ..., channels) of the deviations of the series with the signal's unit, NaN of too few."""
    found = np.full((_QUANTILES.size, *departures.shape[:-1], len(layout.channels)), np.nan)
    for number, those in enumerate(layout.channels):
        seen = departures[..., those] / layout.powers[those]
        enough = np.isfinite(seen).sum(axis=-1) >= FEWEST_LEVELS
        quantiles = np.nanquantile(np.where(enough[..., None], seen, 0.0), _QUANTILES, axis=-1)
        found[..., number] = np.where(enough, quantiles, np.nan)
    return found


def fused_scores(departures: Array, layout: Layout) -> Array:
    """Return the score of each component: the maximum over its kinds of the mean of their largest third.

    A compromise between the mean of all, which is best if all rise, and the largest, which is best if one does; a
    single outlier is diluted. A fault of one kind, as of one race of a bearing, is not diluted by the indicators of the
    others. NaN if less than half of every kind has a value.

    Parameters
    ----------
    departures : (..., series) array
        Standardised indicators; NaN where missing.
    layout : Layout
        Series of each kind of each component.

    Returns
    -------
    (..., components) array
    """
    if not layout.components:
        return np.zeros((*departures.shape[:-1], 0))
    unknown = np.full((*departures.shape[:-1], 1), np.nan)
    ordered = np.sort(-np.concatenate([departures, unknown], axis=-1)[..., layout.kinds], axis=-1)  # NaN last
    count = np.isfinite(ordered).sum(axis=-1)
    taken = np.ceil(count * _LARGEST)
    among = np.arange(ordered.shape[-1]) < taken[..., None]
    total = -np.add.reduce(ordered, axis=-1, where=among)
    enough = (count > 0) & (count * 2 >= (layout.kinds >= 0).sum(axis=1))
    found = np.where(enough, total / np.maximum(taken, 1), np.nan)
    return np.asarray(np.fmax.reduceat(found, layout.first, axis=-1))


def out_of_sample(records: int, leverage: Array) -> Array:
    """Return the ratios (...) of the standard deviations about the baseline of a new record and of its own records.

    Each of n independent records deviates from their mean with variance 1 - 1/n, from a regression on them less by its
    leverage h, and a new one with 1 + 1/n. A score that is not linear in the deviations has the same mean for both only
    after this correction.
    """
    return np.asarray(np.sqrt((1 + 1 / records) / np.maximum(1 - 1 / records - leverage, 1 / records)))


def regime(covariates: Array) -> tuple[Array, Array]:
    """Return the lowest and highest covariates (covariates,) at which records are judged.

    The range of the baseline, extended on either side by a tenth of its width and 5 % of its centre (our choice: lines
    change little over that, and no machine is as steady as its declared speed).
    """
    low, high = covariates.min(axis=0), covariates.max(axis=0)
    margin = 0.1 * (high - low) + 0.05 * np.abs(high + low) / 2
    return low - margin, high + margin
