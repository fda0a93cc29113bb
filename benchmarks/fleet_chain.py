"""Monitoring on arrays of many machines at once: charts and alarms, and the prior that is learned from them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from fleet_analyses import Analyses, Array, Fleet, Resampled, halves
from numpy.typing import NDArray

from hums.fleet.monitor import MOST_LEVERAGE
from hums.fleet.prior import healthy_scores, prior_of
from hums.fleet.series import layout_of
from signals.monitoring.alarm_life import AlarmRule
from signals.monitoring.autocorrelation import Correlation, variance_shares
from signals.monitoring.health import Layout, Normal, Prior, learn_normal
from signals.monitoring.limits import HealthyScores, machine_limits, tail_quantiles

CHUNK = 50  # machines whose series are in memory at a time
RATES = (1_000.0, 10_000.0)
WATCHED = 300
Key = tuple[int, float, float]  # records of a baseline, mean records between alarms, drift
MOST_DOF = 10.0  # real machines differ more than resampled ones: deviations by 22 % (our choice)


@dataclass(frozen=True, kw_only=True)
class Watched:
    """Alarms raised (machines, records, components), and condition indices (machines, records, scores)."""

    raised: NDArray[np.bool_]
    index: NDArray[np.float32]


def watch(
    fleet: Fleet, baseline: int, rates: Sequence[float], layout: Layout, prior: Prior, models: Sequence[HealthyScores]
) -> tuple[Watched, ...]:
    """Return, for each of the rates, alarms of machines whose first records are a baseline."""
    series, at = fleet.series, fleet.measured
    machines, records = series.shape[:2]
    normal = learn_normal(series[:, :baseline], at[:, :baseline], layout, prior)
    own = np.array([normal.read(series[:, number], at[:, number]).scores for number in range(baseline)])
    charts = [_Charts(rate, normal, own, models, records - baseline) for rate in rates]
    recent = np.zeros((machines, len(layout.channels)))
    for number in range(baseline, records):
        reading = normal.read(series[:, number], at[:, number], recent)
        refused = (normal.series.leverage(at[:, number]) > MOST_LEVERAGE)[:, None]
        recent = np.where(refused, recent, reading.recent)
        for one in charts:
            one.step(number - baseline, np.where(refused, np.nan, reading.scores))
    return tuple(one.found for one in charts)


class _Charts:
    """Charts and alarms of machines for one rate, those with the same limits at once."""

    def __init__(
        self,
        every: float,
        normal: Normal,
        own: Array,
        models: Sequence[HealthyScores],
        watched: int,
    ) -> None:
        self.rule, shape, of = AlarmRule(), own.shape[1:], normal.layout.group_of
        self.first = np.flatnonzero(np.array(of) == 0)  # score of each component, those of its parts behind it
        self.found = Watched(
            raised=np.zeros((shape[0], watched, self.first.size), np.bool_),
            index=np.zeros((shape[0], watched, shape[1]), np.float32),
        )
        limits = [  # as `Epoch.learn` does
            machine_limits(len(own), every, models, of, slopes=float(slopes), drift=float(drift))
            for slopes, drift in zip(normal.series.regressors, normal.drift, strict=True)
        ]
        self.groups = [(one, np.flatnonzero([one == other for other in limits])) for one in dict.fromkeys(limits)]
        self.headroom = [one.headroom(own[:, those], self.rule) for one, those in self.groups]
        self.charts = [one.charts.start((those.size, shape[1])) for one, those in self.groups]
        self.alarms = self.rule.start((shape[0], self.first.size))

    def step(self, number: int, scores: Array) -> None:
        """Take one more record (machines, scores), NaN where it is refused."""
        index = np.full(scores.shape, np.nan)
        for place, (one, those) in enumerate(self.groups):
            self.charts[place] = one.charts.step(self.charts[place], scores[those])
            index[those] = one.index(self.charts[place]) / self.headroom[place]
        index = np.where(np.isfinite(scores), index, np.nan)
        of_components = np.fmax.reduceat(index, self.first, axis=1)
        self.alarms, self.found.raised[:, number] = self.rule.step(self.alarms, of_components)
        self.found.index[:, number] = np.nan_to_num(index)


def score_series(series: Array, baseline: int, layout: Layout, prior: Prior) -> tuple[Array, Normal]:
    """Return the scores (records, machines, scores) of machines against their baselines, and those."""
    machines, records = series.shape[:2]
    normal = learn_normal(series[:, :baseline], np.zeros((machines, baseline, 0)), layout, prior)
    nothing, recent, scores = np.zeros((machines, 0)), None, []
    for number in range(baseline, records):
        reading = normal.read(series[:, number], nothing, recent)
        recent = reading.recent
        scores.append(reading.scores)
    return np.array(scores), normal


def two_of_three(index: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the largest limit (machines, records, scores) at which an index (the same) raises an alarm in a record.

    The rule of `AlarmRule`: two of three records at the limit, the last one of them.
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


def of_components(index: NDArray[np.float32], layout: Layout, group: int | None = None) -> NDArray[np.float32]:
    """Return the largest limit (machines, components) at which components raise an alarm by an index of their scores.

    Of a component with parts two records may reach the limit by two of its scores: by those of a `group`, or of all.
    """
    groups = np.array(layout.group_of)
    component = np.cumsum(groups == 0) - 1  # the score of a component, those of its parts behind it
    those = np.flatnonzero((groups == group) | (group is None))
    first = np.flatnonzero(np.diff(component[those], prepend=-1))
    return np.asarray(two_of_three(np.maximum.reduceat(index[..., those], first, axis=-1)).max(axis=1))


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
    scores, normal = score_series(series, 1_000, layout, loose)
    own, sizes = normal.score_scale, layout.sizes
    power, offset = np.polyfit(np.log(sizes), np.log(np.median(own, axis=0)), 1)
    left = np.log(own) - offset - power * np.log(sizes)
    standard = (scores - scores.mean(axis=0)) / scores.std(axis=0)
    machines, places = range(scores.shape[1]), range(scores.shape[2])
    shares = [
        np.mean([variance_shares(scores[:, machine, place], Correlation()) for machine in machines], axis=0)
        for place in places
    ]
    groups: list[dict[str, list[list[float]]]] = [
        {"shares": [], "quantiles": [], "widening": []} for _ in range(max(layout.group_of) + 1)
    ]
    for place, group in enumerate(layout.group_of):
        groups[group]["shares"].append([round(float(x), 3) for x in shares[place]])
        groups[group]["quantiles"].append([round(float(x), 2) for x in tail_quantiles(standard[:, :, place].ravel())])
    return {
        "what": "Usual over healthy machines: deviations of logarithms, and how scores depend on the records before.",
        "made_by": "python benchmarks/fleet.py ANALYSES --learn-prior",
        "log_std": log_std,
        "score_std": round(float(np.exp(offset)), 3),
        "score_power": round(float(power), 3),
        "level_std": round(float(np.median(normal.level_scale)), 3),
        "dof": round(float(np.clip(1 / (2 * np.mean(left**2)), 2, MOST_DOF)), 1),  # log s has the variance 1 / (2 dof)
        "groups": groups,
    }


def widening(found: Analyses, *, machines: int) -> list[list[list[float]]]:
    """Return by how much limits of each group of scores have to be wider than the model's, for baselines and rates.

    Alarms are counted of components, of which parts share one, as the machine's are. Limits of a prior that is held
    against the fleets of its own analyses lack nothing but what the model of the scores lacks: let f be the factor at
    which they raise the stated number of alarms. It is a group's own, times one of all groups, since a component's
    alarm may take one record of its own score and one of a part's, which no group counts. Fleets of other analyses
    raise more, by the errors of either: the number goes exponentially with the logarithm of the limits, so that errors
    of variance v multiply its mean by exp(v / 2). With a variance that goes as one over the number of analyses, as of
    any mean, the factor of a prior of n analyses against those of m is

        log f(n, m) = log f + c (1 / n + 1 / m)

    c follows from halves of the machines, a prior of one half held against the fleets of the other (cross-validation;
    Stone 1974, J. R. Stat. Soc. B 36(2), 111-147), in three splits, both ways round. The factor taken is that of the
    prior of all against machines of any number, f(n, infinity). One factor is of fleets whose states drift, with the
    model's drift, and one of fleets whose states do not, with none.
    """
    _, _, layout = layout_of(found.series)
    everyone, splits = tuple(range(found.machines)), halves(found.machines)
    sizes = {1.0: {2: machines, 10: machines, 30: 2 * machines, 300: machines}}  # by their cost
    sizes[0.0] = {30: machines, 300: machines // 2}
    own_sizes = {drift: {baseline: 2 * count for baseline, count in of.items()} for drift, of in sizes.items()}
    alone = _factors(_largest(found, [(everyone, everyone)], own_sizes), layout)  # nearer to what is taken: more fleets
    apart = _factors(_largest(found, splits, sizes), layout)
    together = _largest(found, [(everyone, everyone)], own_sizes, widening=_rows(alone, layout))
    one_over = [1 / len(found.resampled(those).healthy) for those in (everyone, *splits[0])]
    share = one_over[0] / (one_over[1] + one_over[2])
    wider = {
        key: [
            at_rate([one[-1] for one in together[key]], key[1]) * of_own * (of_halves / of_own) ** share
            for of_own, of_halves in zip(alone[key], apart[key], strict=True)
        ]
        for key in alone
    }
    return _rows(wider, layout)


def _factors(largest: Mapping[Key, list[list[NDArray[np.float32]]]], layout: Layout) -> dict[Key, list[float]]:
    """Return the factor of each group at which its alarms are the part of the stated ones that its scores are."""
    scores = np.bincount(layout.group_of)
    return {
        key: [at_rate([one[group] for one in of], key[1] * layout.scores / count) for group, count in enumerate(scores)]
        for key, of in largest.items()
    }


def _rows(factors: Mapping[Key, list[float]], layout: Layout) -> list[list[list[float]]]:
    """Return the factors of each group as a prior holds them."""
    return [
        [[key[0], key[1] * layout.scores, key[2], round(of[group], 3)] for key, of in factors.items()]
        for group in range(max(layout.group_of) + 1)
    ]


def _largest(
    found: Analyses,
    pairs: Sequence[tuple[Collection[int], Collection[int]]],
    sizes: Mapping[float, Mapping[int, int]],
    widening: Sequence[list[list[float]]] | None = None,
) -> dict[Key, list[list[NDArray[np.float32]]]]:
    """Return the largest indices of the groups of scores, and of all, of fleets by baseline, rate and drift.

    `pairs` are of machines learned from and watched; `sizes` has the number of machines to watch for each drift and
    baseline, over all pairs; `widening`, if given, that of each group, as a prior holds it.
    """
    _, _, layout = layout_of(found.series)
    largest: dict[Key, list[list[NDArray[np.float32]]]] = {}
    for learned_from, watched in pairs:
        learned = learn_prior(found, found.resampled(learned_from))
        if widening is not None:
            for group, rows in zip(learned["groups"], widening, strict=True):
                group["widening"] = rows
        prior, drifting = prior_of(found.series, layout, learned), healthy_scores(learned)
        unseen = found.resampled(watched)
        for drift, fleets in ((1.0, unseen), (0.0, unseen.still())):
            models = [replace(one, drift=drift) for one in drifting]
            for baseline, count in sizes[drift].items():
                for start in range(0, count // len(pairs), CHUNK):
                    rng = np.random.default_rng([12, *learned_from, start])
                    fleet = fleets.machines(CHUNK, baseline + WATCHED, rng)
                    seen = watch(fleet, baseline, RATES, layout, prior, models)
                    for rate, one in zip(RATES, seen, strict=True):
                        groups = [of_components(one.index, layout, group) for group in (*range(len(models)), None)]
                        largest.setdefault((baseline, rate, drift), []).append(groups)
    return largest
