"""Monitoring on arrays of many machines at once: charts and alarms, and the prior that is learned from them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fleet_analyses import Analyses, Array, Fleet, Resampled
from numpy.typing import NDArray

from hums.fleet.monitor import MOST_LEVERAGE
from hums.fleet.series import layout_of
from signals.monitoring.health import Layout, Normal, Prior, learn_normal
from signals.monitoring.limits import AT_ONCE, machine_limits
from signals.monitoring.memory import Memory, learn_memory

CHUNK = 50  # machines whose series are in memory at a time
RATES = (1_000.0, 10_000.0)
WATCHED = 300
MOST_DOF = 10.0  # real machines differ more than resampled ones: deviations by 22 % (our choice)
DAY_S = 86400.0


@dataclass(frozen=True, kw_only=True)
class Watched:
    """Alarms raised (machines, records, components), and condition indices (machines, records, scores)."""

    raised: NDArray[np.bool_]
    index: NDArray[np.float32]


def watch(fleet: Fleet, baseline: int, rates: Sequence[float], layout: Layout, prior: Prior) -> tuple[Watched, ...]:
    """Return, for each of the rates, alarms of machines whose first records, a day apart, are a baseline."""
    normal, own = learned(fleet, baseline, layout, prior)
    charts = [_Charts(rate, normal, own, prior, fleet.series.shape[1] - baseline) for rate in rates]
    for number, scores in enumerate(later_scores(fleet, baseline, normal)):
        for one in charts:
            one.step(number, scores)
    return tuple(one.found for one in charts)


def learned(fleet: Fleet, baseline: int, layout: Layout, prior: Prior) -> tuple[Normal, Array]:
    """Return what is normal for machines, and the scores (records, machines, scores) of their baselines."""
    series, at = fleet.series[:, :baseline], fleet.measured[:, :baseline]
    normal = learn_normal(series, at, layout, prior)
    shown = np.median(_memory(normal, _own(normal, series, at), prior).shown.reshape(len(series), -1), axis=1)
    normal = learn_normal(series, at, layout, prior, shown=shown[:, None])
    return normal, _own(normal, series, at)


def _own(normal: Normal, series: Array, at: Array) -> Array:
    return np.array([normal.read(series[:, number], at[:, number]).scores for number in range(series.shape[1])])


def _memory(normal: Normal, own: Array, prior: Prior) -> Memory:
    """Return the memory of the scores of all machines, whose records are a day apart."""
    flat, usual = own.reshape(len(own), -1), normal.usual(prior).ravel()
    return learn_memory(flat, DAY_S * np.arange(len(own)), prior_scale=usual)


def later_scores(fleet: Fleet, baseline: int, normal: Normal) -> Iterator[Array]:
    """Yield the scores (machines, scores) of each record after the baseline, NaN where it is refused."""
    series, at = fleet.series, fleet.measured
    recent = np.zeros((len(series), len(normal.layout.channels)))
    for number in range(baseline, series.shape[1]):
        reading = normal.read(series[:, number], at[:, number], recent)
        refused = (normal.series.leverage(at[:, number]) > MOST_LEVERAGE)[:, None]
        recent = np.where(refused, recent, reading.recent)
        yield np.where(refused, np.nan, reading.scores)


class _Charts:
    """Charts and alarms of machines for one rate."""

    def __init__(self, every: float, normal: Normal, own: Array, prior: Prior, watched: int) -> None:
        shape = own.shape[1:]
        self.first = first_scores(normal.layout)
        self.found = Watched(
            raised=np.zeros((shape[0], watched, self.first.size), np.bool_),
            index=np.zeros((shape[0], watched, shape[1]), np.float32),
        )
        slopes = float(np.median(normal.series.regressors))
        self.limits = machine_limits(_memory(normal, own, prior), every / shape[0], slopes=slopes)
        self.headroom = self.limits.headroom(own.reshape(len(own), -1))
        self.charts = self.limits.charts.start((own[0].size,))

    def step(self, number: int, scores: Array) -> None:
        """Take one more record (machines, scores), NaN where it is refused."""
        self.charts = self.limits.charts.step(self.charts, scores.ravel())
        index = self.found.index
        found = (self.limits.index(self.charts) / self.headroom).reshape(scores.shape)
        index[:, number] = np.where(np.isfinite(scores), found, 0)
        latest = np.maximum.reduceat(index[:, max(0, number - 2) : number + 1], self.first, axis=2)
        reached = (latest >= 1).sum(axis=1) >= 2  # noqa: PLR2004 - two of three
        raised = (latest[:, -1] >= 1) & (reached | (latest[:, -1] >= AT_ONCE))
        self.found.raised[:, number] = raised & ~self.found.raised.any(axis=1)  # it stands


def first_scores(layout: Layout) -> NDArray[np.int64]:
    """Return the place of the score of each component; those of its parts, whose series are some of its, are behind."""
    found, seen = [], set[int]()
    for place, those in enumerate(layout.series):
        if not seen.issuperset(those):
            found.append(place)
            seen.update(those)
    return np.array([*found, *range(len(layout.series), layout.scores)])


def two_of_three(index: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the largest limit (machines, records, scores) at which an index (the same) raises an alarm in a record.

    Two of three records at the limit, the last one of them.
    """
    before = np.pad(index, ((0, 0), (2, 0), (0, 0)))
    three = np.sort(np.stack([index, before[:, 1:-1], before[:, :-2]]), axis=0)
    return np.asarray(np.minimum(three[1], index))


def at_rate(largest: Sequence[NDArray[np.float32]], every: float) -> float:
    """Return the factor on limits at which machines with those largest indices raise one alarm in `every` records.

    `largest` holds arrays (machines, components).
    """
    ordered = np.sort(np.concatenate([each.ravel() for each in largest]))[::-1]
    return float(ordered[round(sum(len(each) for each in largest) * WATCHED / every)])


def of_components(index: NDArray[np.float32], layout: Layout) -> NDArray[np.float32]:
    """Return the largest limit (machines, components) at which components raise an alarm by an index of their scores.

    Of a component with parts two records may reach the limit by two of its scores.
    """
    return np.asarray(two_of_three(np.maximum.reduceat(index, first_scores(layout), axis=-1)).max(axis=1))


# ---- the prior -------------------------------------------------------------------------------------------------------


def learn_prior(found: Analyses, resampled: Resampled) -> dict[str, Any]:
    """Return what is usual over healthy machines: of twelve resampled ones with 2,000 records each."""
    rng = np.random.default_rng(11)
    series = resampled.machines(12, 2_000, rng).series
    deviations: dict[str, list[float]] = {}
    for key, std in zip(found.series, np.median(np.nanstd(series, axis=1), axis=0), strict=True):
        deviations.setdefault(key.indicator, []).append(float(std))
    log_std = {name: round(float(np.median(stds)), 3) for name, stds in sorted(deviations.items())}
    _, _, layout = layout_of(found.series)
    usual = np.array([log_std[key.indicator] for key in found.series])
    loose = Prior(series=usual, score=1.0, level=0.1, dof=0.01)
    normal = learn_normal(series[:, :1_000], np.zeros((len(series), 1_000, 0)), layout, loose)
    own, sizes = normal.score_scale, layout.sizes
    power, offset = np.polyfit(np.log(sizes), np.log(np.median(own, axis=0)), 1)
    left = np.log(own) - offset - power * np.log(sizes)
    return {
        "what": "Usual over healthy machines: deviations of logarithms, of scores and of levels.",
        "made_by": "python benchmarks/fleet.py ANALYSES --learn-prior",
        "log_std": log_std,
        "score_std": round(float(np.exp(offset)), 3),
        "score_power": round(float(power), 3),
        "level_std": round(float(np.median(normal.level_scale)), 3),
        "dof": round(float(np.clip(1 / (2 * np.mean(left**2)), 2, MOST_DOF)), 1),  # log s has the variance 1 / (2 dof)
    }
