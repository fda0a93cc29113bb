"""Monitoring on arrays of many machines at once: charts and alarms, and the prior that is learned from them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fleet_analyses import Analyses, Array, Fleet, Resampled
from numpy.typing import NDArray

from hums.fleet.monitor import MOST_LEVERAGE
from hums.fleet.series import layout_of, limit_table, prior_of
from signals.monitoring.charts import Charts
from signals.monitoring.health import Layout, Normal, Prior, learn_normal
from signals.monitoring.limits import AT_ONCE, MachineLimits, machine_limits

CHUNK = 50  # machines whose series are in memory at a time
RATES = (1_000.0, 10_000.0)
WATCHED = 300
MOST_DOF = 10.0  # real machines differ more than resampled ones: deviations by 22 % (our choice)
LEARNED_AT = (2, 3, 4, 6, 8, 10, 15, 20, 30, 50, 100, 200, 300, 1_000)  # baselines, of which limits are learned
LEARNED_RATES = tuple(10.0**power for power in range(2, 9))
ALIKE_AT = 100_000.0
"""Records between alarms of a chart alone at which the charts are made alike: about those of one of a machine's tens of
scores, at one alarm of it in several thousand. Alike at commoner values, the chart with the longest tail would decide
the limits of all."""
THRESHOLDS = 60
FEWEST_ALARMS = 40  # of a threshold whose rate is taken as measured (its error is 16 %)


@dataclass(frozen=True, kw_only=True)
class Watched:
    """Alarms raised (machines, records, components), and condition indices (machines, records, scores)."""

    raised: NDArray[np.bool_]
    index: NDArray[np.float32]


def watch(fleet: Fleet, baseline: int, rates: Sequence[float], layout: Layout, prior: Prior) -> tuple[Watched, ...]:
    """Return, for each of the rates, alarms of machines whose first records, a day apart, are a baseline."""
    normal, own = learned(fleet, baseline, layout, prior)
    charts = [_Charts(rate, normal, own, fleet.series.shape[1] - baseline) for rate in rates]
    for number, scores in enumerate(later_scores(fleet, baseline, normal)):
        for one in charts:
            one.step(number, scores)
    return tuple(one.found for one in charts)


def learned(fleet: Fleet, baseline: int, layout: Layout, prior: Prior) -> tuple[Normal, Array]:
    """Return what is normal for machines, and the scores (records, machines, scores) of their baselines."""
    series, at = fleet.series[:, :baseline], fleet.measured[:, :baseline]
    normal = learn_normal(series, at, layout, prior)
    return normal, np.array([normal.read(series[:, number], at[:, number]).scores for number in range(baseline)])


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
    """Charts and alarms of machines for one rate, those with the same limits at once."""

    def __init__(self, every: float, normal: Normal, own: Array, watched: int) -> None:
        shape, of = own.shape[1:], normal.layout.group_of
        self.first = np.flatnonzero(np.array(of) == 0)  # score of each component, those of its parts behind it
        self.found = Watched(
            raised=np.zeros((shape[0], watched, self.first.size), np.bool_),
            index=np.zeros((shape[0], watched, shape[1]), np.float32),
        )
        slopes = normal.series.regressors.round(1)
        self.groups: list[tuple[MachineLimits, NDArray[np.int64]]] = []
        for one in np.unique(slopes):  # as `Epoch.learn` does
            limits = machine_limits(limit_table(), np.full(len(of), len(own)), every, of, slopes=float(one))
            self.groups.append((limits, np.flatnonzero(slopes == one)))
        self.headroom = [one.headroom(own[:, those]) for one, those in self.groups]
        self.charts = [one.charts.start((those.size, shape[1])) for one, those in self.groups]

    def step(self, number: int, scores: Array) -> None:
        """Take one more record (machines, scores), NaN where it is refused."""
        for place, (one, those) in enumerate(self.groups):
            self.charts[place] = one.charts.step(self.charts[place], scores[those])
            self.found.index[those, number] = one.index(self.charts[place]) / self.headroom[place]
        index = self.found.index
        index[:, number] = np.where(np.isfinite(scores), index[:, number], 0)
        latest = np.maximum.reduceat(index[:, max(0, number - 2) : number + 1], self.first, axis=2)
        reached = (latest >= 1).sum(axis=1) >= 2  # noqa: PLR2004 - two of three
        raised = (latest[:, -1] >= 1) & (reached | (latest[:, -1] >= AT_ONCE))
        self.found.raised[:, number] = raised & ~self.found.raised.any(axis=1)  # it stands


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
    first = np.flatnonzero(np.array(layout.group_of) == 0)  # the score of a component, those of its parts behind it
    return np.asarray(two_of_three(np.maximum.reduceat(index, first, axis=-1)).max(axis=1))


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
    normal, _ = learned(Fleet(series=series, measured=np.zeros((*series.shape[:2], 0))), 1_000, layout, loose)
    own, sizes = normal.score_scale, layout.sizes
    power, offset = np.polyfit(np.log(sizes), np.log(np.median(own, axis=0)), 1)
    left = np.log(own) - offset - power * np.log(sizes)
    return {
        "what": "Usual over healthy machines: deviations of logarithms, and limits of the EWMAs of scores.",
        "made_by": "python benchmarks/fleet.py ANALYSES --learn-prior",
        "log_std": log_std,
        "score_std": round(float(np.exp(offset)), 3),
        "score_power": round(float(power), 3),
        "level_std": round(float(np.median(normal.level_scale)), 3),
        "dof": round(float(np.clip(1 / (2 * np.mean(left**2)), 2, MOST_DOF)), 1),  # log s has the variance 1 / (2 dof)
    }


def learn_limits(
    found: Analyses, resampled: Resampled, learned_prior: dict[str, Any], *, machines: int
) -> dict[str, Any]:
    """Return the limits at which resampled machines, of which each score counts, raise the stated number of alarms.

    The EWMAs are made alike at a rare alarm, and the largest of them over these scales has the limit, by which all are
    multiplied. Beyond the rates that are counted, the logarithm of the rate goes on as a line.
    """
    _, _, layout = layout_of(found.series)
    prior, groups = prior_of(found.series, layout, learned_prior), np.array(layout.group_of)
    limits, allowances = np.empty((groups.max() + 1, len(LEARNED_AT), len(LEARNED_RATES), 3)), []
    for place, baseline in enumerate(LEARNED_AT):
        values, means = [], []
        for start in range(0, machines, CHUNK):
            fleet = resampled.machines(CHUNK, baseline + WATCHED, np.random.default_rng([12, start]))
            normal, _ = learned(fleet, baseline, layout, prior)
            scores = np.array(list(later_scores(fleet, baseline, normal)))
            means.append(scores.mean(axis=0)[:, groups == 0])
            state, charts = Charts().start(scores.shape[1:]), []
            for one in scores:
                state = Charts().step(state, one)
                charts.append(state.values[:-1].astype(np.float32))
            values.append(np.array(charts))
        allowances.append(0.5 + 2 * float(np.concatenate(means).std()))
        found_values = np.concatenate(values, axis=2)  # records, EWMAs, machines, scores
        for group in range(groups.max() + 1):
            those = found_values[..., groups == group].reshape(WATCHED, 3, -1)
            scales = np.array([threshold(peaks(those[:, number]), [ALIKE_AT])[0] for number in range(3)])
            together = (those / scales[:, None]).max(axis=1)
            limits[group, place] = threshold(peaks(together), LEARNED_RATES)[:, None] * scales
    return {
        "baselines": LEARNED_AT,
        "every": LEARNED_RATES,
        "limits": limits.round(3).tolist(),
        "allowances": np.round(allowances, 2).tolist(),
    }


def peaks(chart: NDArray[np.float32]) -> Array:
    """Return the largest limit (scores,) at which a chart (records, scores) raises an alarm of each score."""
    alarms = np.maximum(two_of_three(chart.T[..., None])[..., 0], chart.T / AT_ONCE)
    return np.asarray(alarms.max(axis=1), dtype=np.float64)


def threshold(found: Array, every: Sequence[float]) -> Array:
    """Return the limits at which an alarm is raised once in some numbers of records, from the `peaks` of scores."""
    tried = np.linspace(min(0.3, float(np.quantile(found, 0.5))), float(np.quantile(found, 0.9995)), THRESHOLDS)
    alarms = found.size - np.searchsorted(np.sort(found), tried)
    counted = alarms >= FEWEST_ALARMS
    rates, tried = np.log10(alarms[counted] / (found.size * WATCHED)), tried[counted]
    far = rates <= rates[-1] + 0.7  # the last factor of five
    slope, offset = np.polyfit(tried[far], rates[far], 1)
    wanted = -np.log10(every)
    return np.where(wanted < rates[-1], (wanted - offset) / slope, np.interp(-wanted, -rates, tried))
