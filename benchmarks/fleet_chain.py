"""Monitoring on arrays of many machines at once: charts and alarms."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from fleet_analyses import Array, Fleet
from numpy.typing import NDArray

from hums.fleet.monitor import MOST_LEVERAGE
from hums.fleet.series import limit_table
from signals.monitoring.charts import AT_ONCE, ChartState, machine_limits
from signals.monitoring.health import Layout, Normal, Prior, learn_machine

CHUNK = 50  # machines whose series are in memory at a time
RATES = (1_000.0, 10_000.0)
WATCHED = 300
DAY_S = 86_400.0


@dataclass(frozen=True, kw_only=True)
class Watched:
    """Records after the baseline until the first alarm (machines,), infinite where none is, and condition indices.

    The indices are (machines, records, scores).
    """

    until_alarm: Array
    index: NDArray[np.float32]


def watch(fleet: Fleet, baseline: int, rates: Sequence[float], layout: Layout, prior: Prior) -> tuple[Watched, ...]:
    """Return, for each of the rates, alarms of machines whose first records, a day apart, are a baseline."""
    series, measured = fleet.series[:, :baseline], fleet.measured[:, :baseline]
    normal, own, independent = learn_machine(series, measured, DAY_S * np.arange(float(baseline)), layout, prior)
    charts = [_Charts(rate, normal, own, independent, fleet.series.shape[1] - baseline) for rate in rates]
    for number, scores in enumerate(later_scores(fleet, baseline, normal)):
        for one in charts:
            one.step(number, scores)
    return tuple(one.watched for one in charts)


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

    def __init__(self, every: float, normal: Normal, own: Array, independent: Array, watched: int) -> None:
        machines, of = len(independent), normal.layout.group_of
        self.first = first_scores(normal.layout)
        self.index = np.zeros((machines, watched, len(of)), np.float32)
        slopes = np.repeat(normal.series.regressors, len(of))
        groups = of * machines
        limits = machine_limits(limit_table(), independent.ravel(), every / machines, groups, slopes=slopes)
        self.limits = limits.widened(own.reshape(len(own), -1))
        self.charts = ChartState.start((independent.size,))

    @property
    def watched(self) -> Watched:
        """What was found."""
        index = np.maximum.reduceat(self.index, self.first, axis=2)
        raised = np.any((two_of_three(index) >= 1) | (index >= AT_ONCE), axis=2)
        until = np.where(raised.any(axis=1), 1 + raised.argmax(axis=1), np.inf)
        return Watched(until_alarm=until, index=self.index)

    def step(self, number: int, scores: Array) -> None:
        """Take one more record (machines, scores), NaN where it is refused."""
        self.charts = self.charts.step(scores.ravel(), allowance=self.limits.allowance)
        found = self.limits.index(self.charts).reshape(scores.shape)
        self.index[:, number] = np.where(np.isfinite(scores), found, 0)


def first_scores(layout: Layout) -> NDArray[np.int64]:
    """Return the place of the score of each component; those of its parts are behind it."""
    return np.flatnonzero(np.array(layout.group_of) == 0)


def two_of_three(index: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the largest limit (machines, records, scores) at which an index (the same) raises an alarm in a record.

    Two of three records at the limit, the last one of them.
    """
    before = np.pad(index, ((0, 0), (2, 0), (0, 0)))
    three = np.sort(np.stack([index, before[:, 1:-1], before[:, :-2]]), axis=0)
    return np.asarray(np.minimum(three[1], index))


def at_rate(largest: Array, every: float) -> float:
    """Return the factor on limits at which machines with those largest indices raise one alarm in `every` records."""
    return float(np.sort(largest)[::-1][round(largest.size * WATCHED / every)])


def largest(index: NDArray[np.float32], layout: Layout) -> NDArray[np.float32]:
    """Return the largest limit (machines,) at which machines raise an alarm by an index of their scores.

    Of a component with parts two records may reach the limit by two of its scores.
    """
    return np.asarray(two_of_three(np.maximum.reduceat(index, first_scores(layout), axis=-1)).max(axis=(1, 2)))
