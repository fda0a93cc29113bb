"""Limits of control charts for a stated rate of false alarms, with the uncertainty of the baseline in them.

A baseline of few records, which depend on each other, leaves the mean and the deviation of a score uncertain; limits
that leave that out give several times the stated rate of false alarms (Jensen, Jones-Farmer, Champ and Woodall 2006,
J. Qual. Technol. 38(4), 349-364). Here machines are drawn from a model of what is healthy, each learns its own
baseline from as many records as the machine at hand, and the limit is the one at which all of them together raise the
stated number of alarms. Those far in the tail follow the exponential fall of the rate with the limit.

Alarms are those of the EWMAs. The CUSUM says since when a score rises: where the mean of a baseline is off by more than
its allowance it grows for ever, so that a limit which few machines reach is far beyond those of the EWMAs, with which
one factor on all charts would widen them too, and no fault is found by it alone (``docs/benchmarks/fleet.md``).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signals.monitoring.alarm_life import AlarmRule
from signals.monitoring.autocorrelation import Correlation, effective_records, variance_shares
from signals.monitoring.charts import Charts, ChartState
from signals.monitoring.location import learn_baseline

Array = NDArray[np.float64]
_MACHINES, _WATCHED = 6_000, 300  # drawn machines, and records watched of each: 1.8 million records
_SEED = 1  # the same machines for every limit, so that the same records give the same limit
_ALIKE_AT = 100_000.0
"""Records between alarms of a chart alone at which the charts are made alike: about those of one of a machine's tens of
scores, at one alarm of it in several thousand. Alike at commoner values, the chart with the longest tail would decide
the limits of all."""
_THRESHOLDS = 60
_FEWEST_ALARMS = 40  # of a threshold whose rate is taken as measured (its error is 16 %)
_FEWEST_OWN = 60  # values of which the largest twentieth are three
_TAIL_SHARE = 0.05  # of the values, above which a distribution goes on as an exponential one
_PROBABILITIES = (0.0, 0.001, 0.005, 0.02, *(0.05 * k for k in range(1, 20)))
_BEYOND = 10.0 ** np.arange(-1.5, -5.1, -0.25)  # probabilities of the tail above
_DRIFTS = (0.1, 0.2, 0.4, 0.7, 1.0)
"""Shares of the drift for which limits are made; the least is about the error of a share that 300 records show."""
_OF_A_SLOPE = 0.5
"""Error of a slope in what is foretold at the usual covariates, over that of the mean. It is 1 for white scores; for
what drifts the autocorrelations of score and covariate multiply: with a drift of 15 % of the variance, of states of
which half is correlated over 5 and half over 50 records, 0.4."""
_BASELINES = (2, 3, 4, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 65, 80, 100, 120, 150, 200, 250, 300, 400, 500, 700, 1000)
"""Records for which limits are made: the next smaller one is at most a quarter below."""


@dataclass(frozen=True, kw_only=True)
class HealthyScores:
    """Model of the score of a healthy component: how it is spread, how it depends on the records before.

    Attributes
    ----------
    shares : tuple of (white, short, long, season)
        Shares of variance of components of machines; each drawn component has one of them.
    quantiles : tuple of tuple of float
        For each of the `shares`, the `tail_quantiles` of its scores; empty: normal.
    scale_dof : float
        Degrees of freedom with which the deviation of a component scatters about the usual one, and the weight of the
        usual one against a machine's own records; 0: nothing is usual.
    drift : float
        Share of the correlated variance that is there: below 1 where a regression on what was measured with the records
        explains the rest.
    widening : tuple of (baseline records, mean records between alarms, drift, factor)
        By how much limits are wider than the model's, as machines have shown; between them the factor goes with the
        logarithms of the first two and with the drift, beyond them it stays.
    correlation : Correlation
        Lengths of the parts, in records.
    """

    shares: tuple[tuple[float, float, float, float], ...] = ((1.0, 0.0, 0.0, 0.0),)
    quantiles: tuple[tuple[float, ...], ...] = ()
    scale_dof: float = 0.0
    drift: float = 1.0
    widening: tuple[tuple[float, float, float, float], ...] = ()
    correlation: Correlation = field(default_factory=Correlation)

    def draw(self, machines: int, records: int, rng: np.random.Generator) -> Array:
        """Return scores (records, machines) of drawn components, about their mean, in usual deviations."""
        which = rng.integers(len(self.shares), size=machines)
        there = np.asarray(self.shares) * [1.0, self.drift, self.drift, self.drift]
        parts = np.sqrt((there / there.sum(axis=1, keepdims=True))[which].T)
        lengths = (self.correlation.short_records, self.correlation.long_records)
        phase = rng.uniform(0, 2 * np.pi, machines)
        scale = np.sqrt(self.scale_dof / rng.chisquare(self.scale_dof, machines)) if self.scale_dof else 1.0
        states = rng.standard_normal((2, machines))
        decay = np.exp(-1 / np.array(lengths))[:, None]
        found = np.empty((records, machines))
        for number in range(records):
            season = math.sqrt(2) * np.sin(2 * np.pi * number / self.correlation.season_records + phase)
            found[number] = parts[0] * self._white(which, rng) + (parts[1:3] * states).sum(axis=0) + parts[3] * season
            states = decay * states + np.sqrt(1 - decay**2) * rng.standard_normal((2, machines))
        return found * scale

    def _white(self, which: NDArray[np.int64], rng: np.random.Generator) -> Array:
        if not self.quantiles:
            return rng.standard_normal(which.size)
        table, at = np.asarray(self.quantiles), _probabilities()
        drawn = rng.uniform(0, at[-1], which.size)
        low = np.clip(np.searchsorted(at, drawn, side="right") - 1, 0, at.size - 2)
        below, above = table[which, low], table[which, low + 1]
        share = (drawn - at[low]) / (at[low + 1] - at[low])
        return np.asarray(below + share * (above - below), dtype=np.float64)


def _probabilities() -> Array:
    return np.concatenate([_PROBABILITIES, 1 - _BEYOND])


def tail_quantiles(values: Array, independent: float = math.inf) -> tuple[float, ...]:
    """Return quantiles of values (n,), of mean 0 and standard deviation 1, up to a probability of 1e-5 above.

    The largest twentieth is continued as an exponential distribution of their mean excess m, for a sample is no
    distribution beyond its largest value (peaks over a threshold; Pickands 1975, Ann. Stat. 3(1), 119-131, of shape 0).
    Of few `independent` values that mean is uncertain: of k in the tail, the next one exceeds it by x with the
    probability (1 + x/(k m))^-k (predictive distribution; Aitchison and Dunsmore 1975, Statistical Prediction
    Analysis), which is exp(-x/m) for many.
    """
    standard = (values - values.mean()) / values.std()
    start = float(np.quantile(standard, 1 - _TAIL_SHARE))
    excess = float((standard[standard > start] - start).mean())
    body, times = np.quantile(standard, _PROBABILITIES), np.log(_TAIL_SHARE / _BEYOND)
    if math.isfinite(independent):
        few = max(1.0, _TAIL_SHARE * independent)
        times = few * np.expm1(times / few)
    return (*map(float, body), *map(float, start + excess * times))


def own_scores(scores: Array, correlation: Correlation | None = None) -> tuple[HealthyScores, float]:
    """Return the model of a machine's own scores, and their effective number of independent records.

    Parameters
    ----------
    scores : (records, components) array
        Of its baseline, in standard deviations; NaN where missing.
    correlation : Correlation, optional
        Lengths of the correlated parts.

    Returns
    -------
    model : HealthyScores
        With the distribution and the autocorrelation of each component.
    effective : float
        Median over the components of `effective_records`.
    """
    lengths = correlation or Correlation()
    varying = [one for one in scores.T if np.isfinite(one).sum() >= _FEWEST_OWN and np.nanstd(one) > 0]
    if not varying:
        return HealthyScores(correlation=lengths), 0.0
    shares = np.array([variance_shares(one, lengths) for one in varying])
    effective = effective_records(shares, scores.shape[0], lengths)
    model = HealthyScores(
        shares=tuple((float(w), float(x), float(y), float(z)) for w, x, y, z in shares),
        quantiles=tuple(
            tail_quantiles(one[np.isfinite(one)], float(known)) for one, known in zip(varying, effective, strict=True)
        ),
        correlation=lengths,
    )
    return model, float(np.median(effective))


@dataclass(frozen=True, kw_only=True)
class ChartLimits:
    """Limits of the EWMAs of one score.

    Attributes
    ----------
    charts : Charts
        With the allowance for a baseline of that size.
    limits : tuple of float
        Of each EWMA, in deviations of the score.
    every_records : float
        Mean number of records between false alarms of the score.
    decades : float
        How the rate of false alarms falls: it is a tenth where the limits are higher by this factor less 1.
    """

    charts: Charts
    limits: tuple[float, ...]
    every_records: float
    decades: float

    def index(self, state: ChartState) -> Array:
        """Return the condition index (...): the largest EWMA over its limit; 0 is normal, 1 the limit."""
        limits = np.reshape(self.limits, (-1, *[1] * state.rising.ndim))
        return np.asarray(np.maximum((state.values[:-1] / limits).max(axis=0), 0.0))

    def headroom(self, baseline: Array, rule: AlarmRule) -> Array:
        """Return by how much limits (...) are wider for scores that raise an alarm in their baseline (records, ...).

        An alarm that the records of a baseline raise by the rule m of n shows that bursts are normal there, and the
        index of later records is divided by this factor, 1 elsewhere. Single bad records, which the rule leaves out, do
        not count. k bursts of n records that exceed the limit u by a sum s are taken as exponential of unknown
        mean; the next one then exceeds u + x with the probability (1 + x/s)^-k (predictive distribution with a prior
        flat in the logarithm of the mean; Aitchison and Dunsmore 1975, Statistical Prediction Analysis). The factor is
        that at which the rule raises bursts at the stated rate, where they come independently, in a share
        (k + 1/2) / (n + 1) of the records (Jeffreys' prior).
        """
        records = baseline.shape[0]
        if records < rule.within:
            return np.ones(baseline.shape[1:])
        over = np.nan_to_num(baseline) / self.limits[0] - 1
        windows = np.sort(sliding_window_view(over, rule.within, axis=0), axis=-1)
        alarmed = windows[..., -rule.of].max(axis=0) >= 0
        count, total = (over >= 0).sum(axis=0), np.maximum(over, 0).sum(axis=0)
        ways = math.comb(rule.within - 1, rule.of - 1)  # of a window that ends with a burst
        exceeded = (self.every_records * ways) ** (-1 / rule.of)  # probability of a record that the rate allows
        share = (count + 0.5) / (records + 1)
        beyond = total * ((share / exceeded) ** (1 / np.maximum(count, 1)) - 1)
        return np.asarray(np.where(alarmed, 1 + np.maximum(beyond, 0), 1.0))

    def every_records_at(self, index: float) -> float:
        """Return the mean number of records of a healthy component between alarms with the limit at an index."""
        exponent = min((index - 1) / self.decades, 300.0)  # beyond which floats end
        return float(self.every_records * 10**exponent)


@dataclass(frozen=True, kw_only=True)
class MachineLimits:
    """Limits of all scores of a machine: those that are alike in health share theirs.

    Attributes
    ----------
    groups : tuple of ChartLimits
        Of each group of scores.
    of : tuple of int
        Group of each score.
    """

    groups: tuple[ChartLimits, ...]
    of: tuple[int, ...]

    @property
    def charts(self) -> Charts:
        """Charts of all scores, with the allowance of the first group."""
        return self.groups[0].charts

    def index(self, state: ChartState) -> Array:
        """Return the condition index (..., scores): the largest EWMA over its limit; 0 is normal, 1 the limit."""
        return self._of_each([one.index(state) for one in self.groups])

    def headroom(self, baseline: Array, rule: AlarmRule) -> Array:
        """Return by how much limits (..., scores) are wider for what their baseline (records, ..., scores) shows."""
        return self._of_each([one.headroom(baseline, rule) for one in self.groups])

    def bursts(self, baseline: Array, rule: AlarmRule) -> NDArray[np.bool_]:
        """Return whether a record of the baseline (records, ..., scores) would raise an alarm by itself."""
        return self._of_each([np.any(baseline >= rule.at_once * one.limits[0], axis=0) for one in self.groups]) > 0

    def every_records_at(self, index: float) -> float:
        """Return in how many records a healthy score raises an alarm with the limit at an index: the least number."""
        return min(one.every_records_at(index) for one in self.groups)

    def _of_each(self, found: Sequence[Array]) -> Array:
        group = np.array(self.of)
        return np.asarray(np.select([group == number for number in range(len(found))], found))


def chart_limits(
    baseline_records: int, every_records: float, model: HealthyScores, *, rule: AlarmRule | None = None
) -> ChartLimits:
    """Return the limits at which healthy components raise an alarm once in a mean number of records.

    Parameters
    ----------
    baseline_records : int
        Records that a baseline was learned on; limits are those of the next smaller of `_BASELINES`, up to 1,000.
    every_records : float
        Mean number of records between false alarms of one score, over all its EWMAs.
    model : HealthyScores
        What healthy components are like.
    rule : AlarmRule, optional
        When an alarm is raised.

    Returns
    -------
    ChartLimits

    Raises
    ------
    ValueError
        If the baseline has fewer than 2 records, or `every_records` is below 10.
    """
    if baseline_records < _BASELINES[0]:
        raise ValueError(f"a baseline of {baseline_records} records has no spread; learn it on 2 or more.")
    if not every_records >= 10:  # noqa: PLR2004
        raise ValueError(f"every_records = {every_records:g}: an alarm in less than 10 records is no limit; give more.")
    size = max(count for count in _BASELINES if count <= baseline_records)
    drawn = _drawn(size, replace(model, widening=()), rule or AlarmRule())  # what is drawn is the same for all
    threshold = drawn.tail.threshold(every_records)
    wider = _wider(model, size, every_records)
    return ChartLimits(
        charts=Charts(allowance=drawn.allowance),
        limits=tuple(scale * threshold * wider for scale in drawn.scales),
        every_records=every_records,
        decades=-1 / (drawn.tail.slope * threshold),
    )


def machine_limits(
    baseline_records: int,
    every_records: float,
    models: Sequence[HealthyScores],
    of: tuple[int, ...],
    *,
    slopes: float = 0.0,
    drift: float = 1.0,
    rule: AlarmRule | None = None,
) -> MachineLimits:
    """Return the limits of all scores of a machine, each of which raises an alarm equally seldom.

    Parameters
    ----------
    baseline_records : int
        Records that a baseline was learned on.
    every_records : float
        Mean number of records between false alarms of the machine, over all its scores.
    models : sequence of HealthyScores
        What healthy scores of each group are like.
    of : tuple of int
        Group of each score.
    slopes : float
        Effective number of slopes on covariates that were learned on them, too: limits are those of a baseline of
        n / (1 + slopes / 2) records.
    drift : float
        Share of the models' correlated variance that the machine's scores have, as `Normal.drift`; limits are those of
        the next larger of some shares.
    rule : AlarmRule, optional
        When an alarm is raised.
    """
    each = every_records * len(of)
    records = max(_BASELINES[0], int(baseline_records / (1 + _OF_A_SLOPE * slopes)))
    share = min(one for one in _DRIFTS if one >= min(drift, 1.0))
    there = [replace(one, drift=share * one.drift) for one in models[: max(of) + 1]]
    groups = tuple(chart_limits(records, each, one, rule=rule) for one in there)
    return MachineLimits(groups=groups, of=of)


def _wider(model: HealthyScores, size: int, every_records: float) -> float:
    """Return the factor of a model's table of (baseline records, records between alarms, drift, factor)."""

    def at(rows: Sequence[tuple[float, ...]], place: tuple[float, ...]) -> float:
        if not place:
            return rows[0][0]
        steps = sorted({row[0] for row in rows})
        found = [at([row[1:] for row in rows if row[0] == one], place[1:]) for one in steps]
        return float(np.interp(place[0], steps, found))

    rows = [(drift, math.log(records), math.log(every), factor) for records, every, drift, factor in model.widening]
    return at(rows, (model.drift, math.log(size), math.log(every_records))) if rows else 1.0


@dataclass(frozen=True, kw_only=True)
class _Tail:
    """Rates of alarms (log10, falling) at thresholds, and the line that continues them."""

    thresholds: tuple[float, ...]
    rates: tuple[float, ...]
    slope: float
    offset: float

    def threshold(self, every_records: float) -> float:
        """Return the threshold at which an alarm is raised once in a number of records."""
        wanted = -math.log10(every_records)
        if wanted < self.rates[-1]:
            return (wanted - self.offset) / self.slope
        return float(np.interp(-wanted, -np.array(self.rates), self.thresholds))


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """What drawn machines have shown: the allowance of the CUSUM, scales of the EWMAs, and the tail of the largest."""

    allowance: float
    scales: tuple[float, ...]
    tail: _Tail


@lru_cache(maxsize=256)  # of sizes and drifts that machines of one fleet have
def _drawn(baseline: int, model: HealthyScores, rule: AlarmRule) -> _Drawn:
    rng = np.random.default_rng(_SEED)
    scores = model.draw(_MACHINES, baseline + _WATCHED, rng)
    learned, watched = scores[:baseline], scores[baseline:]
    normal = learn_baseline(learned, np.zeros((baseline, 0)), prior_scale=1.0, prior_dof=model.scale_dof)
    standard = (watched - normal.center) / normal.scale
    allowance = 0.5 + 2 * float(standard.mean(axis=0).std())  # half a deviation, and what the mean may be off
    charts = Charts(allowance=allowance)
    state = charts.start((_MACHINES,))
    values = np.empty((len(charts.weights), _WATCHED, _MACHINES), dtype=np.float32)
    for number, score in enumerate(standard):
        state = charts.step(state, score)
        values[:, number] = state.values[:-1]
    scales = np.array([_tail(_peaks(one, rule)).threshold(_ALIKE_AT) for one in values], dtype=np.float32)
    tail = _tail(_peaks((values / scales[:, None, None]).max(axis=0), rule))
    return _Drawn(allowance=allowance, scales=tuple(map(float, scales)), tail=tail)


def _peaks(chart: NDArray[np.float32], rule: AlarmRule) -> Array:
    """Return the largest limit (machines,) at which a chart (records, machines) raises an alarm of each machine.

    In a record an alarm is raised at the least of its own value and the `rule.of`-th largest of the latest ones, or at
    its own value over `rule.at_once`.
    """
    before = np.pad(chart, ((rule.within - 1, 0), (0, 0)))
    latest = np.stack([before[number : number + len(chart)] for number in range(rule.within)])
    reached = np.partition(latest, rule.within - rule.of, axis=0)[rule.within - rule.of]
    alarm = np.maximum(np.minimum(reached, chart), chart / rule.at_once)
    return np.asarray(alarm.max(axis=0), dtype=np.float64)


def _tail(peaks: Array) -> _Tail:
    """Return how the rate of alarms falls with the limit, from the limits (machines,) up to which each raises one."""
    thresholds = np.linspace(min(0.3, float(np.quantile(peaks, 0.5))), float(np.quantile(peaks, 0.9995)), _THRESHOLDS)
    alarms = peaks.size - np.searchsorted(np.sort(peaks), thresholds)
    last = int(np.flatnonzero(alarms >= _FEWEST_ALARMS)[-1])
    rates = np.log10(alarms[: last + 1] / (peaks.size * _WATCHED))
    far = slice(max(0, int(np.searchsorted(-rates, -(rates[-1] + 0.7)))), None)  # the last factor of five
    slope, offset = np.polyfit(thresholds[: last + 1][far], rates[far], 1)
    return _Tail(
        thresholds=tuple(map(float, thresholds[: last + 1])),
        rates=tuple(map(float, rates)),
        slope=float(slope),
        offset=float(offset),
    )
