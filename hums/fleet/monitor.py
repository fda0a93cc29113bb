"""Monitoring of a machine record by record: baselines, charts and alarms, as a state of constant size.

The first records are collected for a baseline. Then the baseline is frozen, and every further record is compared with
it. Replacing a component begins a new epoch for it: a baseline is learned from the following records, while the other
components keep theirs.

Alarms of components:

| state | becomes | when |
|---|---|---|
| clear, cleared | raised | the index reached 1 in 2 of the last 3 judged records, or 2 in one |
| raised | acknowledged | an acknowledgement is read: it is latched until then |
| acknowledged | cleared | 10 judged records in succession lie below one half |
| acknowledged | raised (anew) | the index exceeds twice the one of the last alarm, by that rule |
| any | cleared | maintenance resets the component |
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hums.fleet.observation import ACKNOWLEDGED, NOT_ANALYSED, MonitorSettings, Observation, Work, seconds_since_1970
from hums.fleet.series import (
    NOTHING,
    UNKNOWN,
    WHOLE_SIGNAL,
    Keys,
    Series,
    component_parts,
    explanations,
    layout_of,
    limit_table,
    prior_of,
    shared,
    vector,
)
from signals.monitoring.charts import AT_ONCE, OF, WEIGHTS, WITHIN, ChartState, MachineLimits, machine_limits
from signals.monitoring.health import Normal, Reading, fused_scores, learn_machine, regime

Array = NDArray[np.float64]
Driver = tuple[str, str, float, float]
RISES, FALLS, _HEALTH, LEARNING = "level rises", "level falls suddenly", ": health", "learning"
MOST_LEVERAGE = 1.0
"""Variance of the prediction over that of the series above which a record is not judged: the regression would add as
much scatter as the record itself has (our choice)."""
_DRIVERS = 3  # indicators an alarm names, and parts that it may be instead
_MEMORY = WEIGHTS[1]  # of the change that is explained


ALARM_COLUMNS = (
    "machine",
    "component",
    "channel",
    "indicator",
    "record",
    "recorded_at",
    "since",
    "value",
    "severity",
    "state",
    "consequences",
    "other_explanations",
    "baseline",
)
SEVERE = 2.0  # condition index from which an alarm is severe: twice the limit
CLEAR, RAISED, CLEARED = "clear", "raised", "cleared"
AGAIN = 2.0  # growth over the index of the last alarm that raises an acknowledged one anew
_QUIET, _CLEAR_BELOW = 10, 0.5  # records, and their index, after which it clears: one about the limit is one alarm


@dataclass(kw_only=True)
class Alarm:
    """Alarm of a component after the latest record.

    ``row`` is its latest row of ``alarms.csv``, ``recent`` states for each of the latest judged records whether it
    reached the limit, ``quiet`` counts consecutive low records, ``since`` is the time at which the CUSUM last left
    zero, and ``index`` the latest condition index, the largest of the component and of its consequences.
    """

    row: dict[str, Any] = field(default_factory=dict)
    recent: tuple[bool, ...] = ()
    quiet: int = 0
    since: str = ""
    index: float = 0.0

    @property
    def state(self) -> str:
        """One of the words above; `CLEAR` before the first alarm."""
        return str(self.row.get("state", CLEAR))

    @property
    def stands(self) -> bool:
        """Whether it is raised or acknowledged."""
        return self.state in (RAISED, ACKNOWLEDGED)

    @property
    def consequences(self) -> tuple[str, ...]:
        """Components whose rise is attributed to its cause, while it stands."""
        return tuple(filter(None, self.row["consequences"].split("; "))) if self.stands else ()

    def begin(self, row: dict[str, Any]) -> None:
        """Raise the alarm."""
        self.row, self.since, self.recent = row, row["since"], ()

    def follow(self, name: str) -> None:
        """Attribute the rise of a component to its cause."""
        self.row["consequences"] = "; ".join(sorted({*self.consequences, name}))

    def step(self, index: float, *, bursts: bool = False) -> bool:
        """Update the alarm by the condition index of a record, NaN where not judged; return whether one is due.

        With `bursts` in the baseline, no single record raises an alarm.
        """
        if not math.isfinite(index):
            return False
        self.index = index
        limit = AGAIN * self.row["value"] if self.state == ACKNOWLEDGED else 1.0
        self.recent = (*self.recent, index >= limit)[-WITHIN:]
        self.quiet = self.quiet + 1 if index < _CLEAR_BELOW else 0
        reached = sum(self.recent) >= OF or (index >= AT_ONCE * limit and not bursts)
        if index >= limit and reached and self.state != RAISED:
            self.recent = ()
            return True
        if self.state == ACKNOWLEDGED and self.quiet >= _QUIET:
            self.recent = ()
            self.row["state"] = CLEARED
        return False

    def acknowledge(self) -> None:
        """Acknowledge the alarm where it is raised."""
        if self.state == RAISED:
            self.row["state"], self.recent, self.quiet = ACKNOWLEDGED, (), 0


@dataclass(kw_only=True)
class Epoch:
    """A baseline with its charts or, until it is learned, the records collected for it.

    ``names`` has the component of each score; those of one component are adjacent, the first of them of all its series.
    ``watched`` has the places of the scores of each component, and of each monitored quantity of a sensor.
    ``counted``: the baseline is learned from the next records, as after a replacement, whatever the settings choose;
    ``diagnosed`` names the components that a verdict on one of its records diagnosed. ``change`` is the EWMA of the
    deviations of all series.
    """

    pending: list[Observation] = field(default_factory=list)
    counted: bool = False
    identity: str = ""
    records: tuple[str, ...] = ()
    diagnosed: tuple[str, ...] = ()
    series: Keys = NOTHING.keys
    covariates: tuple[str, ...] = ()
    low: Array = field(default_factory=lambda: np.zeros(0))
    high: Array = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()
    watched: dict[str, tuple[int, ...]] = field(default_factory=dict)
    channels: tuple[str, ...] = ()
    normal: Normal | None = None
    limits: MachineLimits | None = None
    bursts: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    charts: ChartState = field(default_factory=ChartState.start)
    recent: Array | None = None
    change: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def learned(self) -> tuple[Normal, MachineLimits]:
        """What is normal, and the limits; ValueError if the baseline is not learned."""
        if self.normal is None or self.limits is None:
            raise ValueError("this baseline is incomplete; monitor more records first.")
        return self.normal, self.limits

    def learn(self, machine: str, settings: MonitorSettings) -> None:
        """Learn the baseline from the collected records, and discard them."""
        seen = self.pending
        every = tuple(sorted(set().union(*(one.values.keys for one in seen))))
        values = np.array([vector(one.values, every) for one in seen])
        kept = np.isfinite(values).sum(axis=0) * 2 >= len(seen)
        self.series = shared(tuple(key for key, keep in zip(every, kept, strict=True) if keep))
        self.covariates = tuple(sorted(set.intersection(*(set(one.covariates) for one in seen))))
        at = np.array([[one.covariates[name] for name in self.covariates] for one in seen]).reshape(len(seen), -1)
        self.low, self.high = regime(at)
        self.names, self.channels, layout = layout_of(self.series)
        scores = (*self.names, *(f"sensor {channel}: {what}" for what in (RISES, FALLS) for channel in self.channels))
        self.watched = {name: tuple(n for n, one in enumerate(scores) if one == name) for name in dict.fromkeys(scores)}
        times_s = np.array([seconds_since_1970(one.recorded_at) for one in seen])
        prior = prior_of(self.series, layout, np.nanmedian(values[:, kept], axis=0))
        self.normal, own, independent = learn_machine(values[:, kept], _logarithms(at), times_s, layout, prior)
        run_length, slopes = settings.false_alarm_every, float(self.normal.series.regressors)
        limits = machine_limits(limit_table(), independent, run_length, layout.group_of, slopes=slopes)
        self.limits, self.bursts = limits.widened(own), limits.bursts(own)
        self.charts = ChartState.start(independent.shape)
        self.recent, self.change = np.zeros(len(self.channels)), np.zeros(len(self.series))
        self.records = tuple(one.record for one in seen)
        self.diagnosed = tuple(sorted({name for one in seen for name in one.diagnosed}))
        text = json.dumps([machine, self.records, self.normal.series.center.tolist()])
        self.identity, self.pending = hashlib.sha256(text.encode()).hexdigest()[:12], []

    def outside(self, seen: Observation) -> str:
        """Return the covariate of a record outside the range of the baseline, or an empty string."""
        at = np.array([seen.covariates.get(name, math.nan) for name in self.covariates])
        for name, value, low, high in zip(self.covariates, at, self.low, self.high, strict=True):
            if not low <= value <= high:
                return f"{name} = {value:.4g} outside {low:.4g} to {high:.4g}"
        if self.learned[0].series.leverage(_logarithms(at)) > MOST_LEVERAGE:
            return f"{', '.join(self.covariates)} too far from those of the baseline to predict normal values"
        return ""

    def read(self, seen: Observation, recent: Array | None = None) -> Reading:
        """Return a record relative to the baseline."""
        at = np.array([seen.covariates[name] for name in self.covariates])
        return self.learned[0].read(vector(seen.values, self.series), _logarithms(at), recent)

    def alarm_from(self, component: str) -> float:
        """Return the rise of all indicators of one kind of a component, times normal, that two records alarm at."""
        (normal, limits), places = self.learned, [n for n, name in enumerate(self.names) if name == component]
        rise = fused_scores(1 / normal.series.scale, normal.layout)
        limit = limits.limits[0, : rise.size] * normal.score.scale + normal.score.center
        return math.exp(np.nanmin((limit / rise)[places])) if places else math.nan

    def verdict_words(self, component: str) -> str:
        """Return the first driver of an alarm by a verdict: a component damaged in the baseline has wide limits."""
        return "diagnosed, as in its baseline" if component in self.diagnosed else "diagnosed"

    def judge(self, seen: Observation) -> tuple[Reading, Array]:
        """Return a record compared with the baseline, and the condition index of every score."""
        limits, reading = self.learned[1], self.read(seen, self.recent)
        self.recent = reading.recent
        self.charts = self.charts.step(reading.scores, allowance=limits.allowance)
        self.change = self.change + _MEMORY * np.nan_to_num(reading.departures - self.change)
        return reading, np.where(np.isfinite(reading.scores), limits.index(self.charts), np.nan)


@dataclass(kw_only=True)
class MachineState:
    """State of a machine between two records.

    Attributes
    ----------
    machine : str
        Its name.
    settings : MonitorSettings
        Settings of its monitoring.
    strata : dict of str to dict of str to Epoch
        Epochs of each regime: of the whole machine (an empty name), then of each component replaced since, the latest
        last.
    regime : str
        Regime of the latest judged record or, before that, of the first record.
    alarms : dict of str to Alarm
        Of each component.
    judged, refused : int
        Numbers of records judged, and refused: outside the range of the baseline, with a faulty tachometer, or not
        analysed.
    unwatched_since : str
        Time of the first of the latest consecutive refused records; empty if the latest was judged.
    last_seconds : float
        Time of the latest record; maintenance between it and the next is applied first.
    serviced : (str, int)
        Latest maintenance, and the number of records judged before; an empty name without any.
    learned, latest : list of str, str
        Digests of the records collected for baselines, and of the latest one, none of which is accepted again.
    """

    machine: str
    settings: MonitorSettings = field(default_factory=MonitorSettings)
    strata: dict[str, dict[str, Epoch]] = field(default_factory=dict)
    regime: str = ""
    alarms: dict[str, Alarm] = field(default_factory=dict)
    judged: int = 0
    refused: int = 0
    unwatched_since: str = ""
    last_seconds: float = -math.inf
    serviced: tuple[str, int] = ("", 0)
    learned: list[str] = field(default_factory=list)
    latest: str = ""

    @property
    def epochs(self) -> dict[str, Epoch]:
        """Epochs of the regime of the latest judged record."""
        return self.strata.get(self.regime) or {"": Epoch()}

    @property
    def baselines(self) -> list[Epoch]:
        """Baselines of all regimes."""
        return [epoch for stratum in self.strata.values() for epoch in stratum.values()]

    def epoch_of(self, component: str) -> str:
        """Return the name of the epoch that governs a component; of several monitored as one, their newest."""
        return next(name for name in reversed(self.epochs) if name in ("", *component_parts(component)))

    @property
    def standing(self) -> dict[str, dict[str, Any]]:
        """Rows in ``alarms.csv`` of the alarms that are raised or acknowledged, by component."""
        return {name: alarm.row for name, alarm in self.alarms.items() if alarm.stands}


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """Result for one record.

    Attributes
    ----------
    judged : bool
        Whether it was compared with a baseline.
    why : str
        If not, why: ``learning``, or the reason for refusing it.
    index : mapping of str to float
        Condition index of each component: 0 normal, 1 alarm; NaN where its sensors are faulty.
    scores : mapping of str to float
        Score of each component in standard deviations.
    drivers : mapping of str to (str, str, float, float)
        Of the series that drives each component: channel, indicator, deviation in standard deviations, and ratio to its
        normal value at this speed and load.
    alarms : tuple of dict
        Alarms raised by this record, rows of ``alarms.csv``.

    Examples
    --------
    See `watch`, which returns it.

    >>> import hums
    >>> hums.Judgement(judged=False, why="learning").alarms
    ()
    """

    judged: bool
    why: str = ""
    index: dict[str, float] = field(default_factory=dict)
    scores: dict[str, float] = field(default_factory=dict)
    drivers: dict[str, Driver] = field(default_factory=dict)
    alarms: tuple[dict[str, Any], ...] = ()


def update(state: MachineState, seen: Observation, *, work: Sequence[Work] = ()) -> Judgement:
    """Update the state of a machine by one more record, and return its judgement.

    Parameters
    ----------
    state : MachineState
        Changed in place.
    seen : Observation
        The record; records come in chronological order.
    work : sequence of Work
        All maintenance; entries between the latest record and this one are applied first.
    """
    if nothing_new := _nothing_new(state, seen):
        return Judgement(judged=False, why=nothing_new)
    _do(state, seen, work)
    if seen.unjudged:
        return _unjudged(state, seen, seen.unjudged, _of_sensors(state, seen))
    stratum = _stratum(state, seen)
    outside = "" if stratum else f"regime {seen.regime!r} is not in the baseline"
    readings = {}
    for governed, epoch in stratum.items():
        if _learns(state, epoch, seen):
            continue
        if refusal := epoch.outside(seen):
            outside = outside or refusal
            continue
        readings[governed] = epoch.judge(seen)
    shown = _of_sensors(state, seen) | _of_verdicts(state, stratum or state.epochs, seen, readings)
    if not readings:
        return _unjudged(state, seen, outside or LEARNING, shown)
    state.judged += 1
    state.regime, state.unwatched_since = seen.regime, ""
    found = Judgement(judged=True)
    for governed, (reading, indices) in readings.items():
        shown |= _of_charts(state, governed, seen, reading, indices, found)
    return replace(found, alarms=_raised(state, seen, shown))


def _nothing_new(state: MachineState, seen: Observation) -> str:
    """Return why a record is a repetition or comes too late, or an empty string; keep its digest."""
    if seconds_since_1970(seen.recorded_at) < state.last_seconds:
        return f"recorded at {seen.recorded_at}, before the latest record; pass records in chronological order"
    if not seen.values.keys:
        return ""
    digest = hashlib.sha256(np.sort(seen.values.values).tobytes()).hexdigest()[:16]
    if digest in (*state.learned, state.latest):
        return "watched before: its indicators are identical to those of an earlier record"
    state.latest = digest
    if any(epoch.normal is None for epoch in state.strata.get(seen.regime, {"": Epoch()}).values()):
        state.learned.append(digest)
    return ""


def _stratum(state: MachineState, seen: Observation) -> dict[str, Epoch]:
    """Return the epochs of a record's regime; none if it first occurs after the baseline of another was learned."""
    if seen.regime in state.strata:
        return state.strata[seen.regime]
    chosen = state.settings.by_choice and state.settings.chosen(seen)
    if any(epoch.normal is not None for epoch in state.baselines) and not chosen:
        return {}
    if not state.strata:
        state.regime = seen.regime
    stratum = {name: Epoch(counted=epoch.counted) for name, epoch in state.epochs.items()}
    return state.strata.setdefault(seen.regime, stratum)


def _learns(state: MachineState, epoch: Epoch, seen: Observation) -> bool:
    """Return whether a record belongs to a baseline or precedes it; learn a baseline that is complete."""
    settings, counted = state.settings, epoch.counted or not state.settings.by_choice
    if epoch.normal is not None:
        return False
    if counted or settings.chosen(seen):
        epoch.pending.append(seen)
        if counted and len(epoch.pending) == settings.baseline_records:
            epoch.learn(state.machine, settings)
        return True
    if len(epoch.pending) < 2:  # noqa: PLR2004
        return True
    epoch.learn(state.machine, settings)  # the first record after those that were chosen
    return False


# ---- what a record shows of each component, and the alarms -----------------------------------------------------------


class _Shown(NamedTuple):
    """What a record shows of a component.

    Its condition index; the channels and indicators that drive it, the largest deviation first; the severity of an
    alarm; the identity of the baseline; since how many records it rises; whether a verdict or its kind names it;
    whether its baseline had bursts; and the epoch whose charts it is judged by.
    """

    value: float
    drivers: Sequence[tuple[str, str]]
    severity: str
    baseline: str = ""
    rising: int = 1
    named: bool = True
    bursts: bool = False
    epoch: Epoch | None = None


def _unjudged(state: MachineState, seen: Observation, why: str, shown: Mapping[str, _Shown]) -> Judgement:
    """Return the judgement of a record that no baseline judges; count it as refused unless one is being learned."""
    if why != LEARNING:
        state.refused += 1
        state.unwatched_since = state.unwatched_since or seen.when
    return Judgement(judged=False, why=why, alarms=_raised(state, seen, shown))


def _of_sensors(state: MachineState, seen: Observation) -> dict[str, _Shown]:
    """Return what a record shows of each sensor that is or was faulty; its index is 1 while it is."""
    if seen.unjudged == NOT_ANALYSED:
        return {}
    sensors = {name[len("sensor ") : -len(_HEALTH)] for name in state.alarms if name.endswith(_HEALTH)}
    return {
        f"sensor {sensor}{_HEALTH}": _Shown(
            float(sensor in seen.faulty), [(sensor, f"health: {seen.faulty.get(sensor, '')}")], "sensor"
        )
        for sensor in sorted(sensors | set(seen.faulty))
    }


def _of_verdicts(
    state: MachineState,
    epochs: Mapping[str, Epoch],
    seen: Observation,
    readings: Mapping[str, tuple[Reading, Array]],
) -> dict[str, _Shown]:
    """Return what verdicts show of components that no baseline judges: none is learned, or it refuses the record.

    While a baseline is learned, a record without a diagnosis counts too, by the same rule of m of n.
    """
    shown = {}
    for component in sorted({*seen.diagnosed, *(name for name in state.alarms if ": " not in name)}):
        governed, diagnosed = state.epoch_of(component), component in seen.diagnosed
        epoch = epochs[governed]
        if (governed not in readings or component not in epoch.names) and (diagnosed or epoch.normal is None):
            drivers = [("", epoch.verdict_words(component))]
            shown[component] = _Shown(float(diagnosed), drivers, "verdict", epoch.identity, rising=2 - diagnosed)
    return shown


def _of_charts(
    state: MachineState, governed: str, seen: Observation, reading: Reading, indices: Array, found: Judgement
) -> dict[str, _Shown]:
    """Return what a record shows of the components that an epoch governs, and enter it into the judgement."""
    epoch, shown, closeness = state.epochs[governed], {}, np.nan_to_num(indices, nan=-np.inf).tolist()
    for name, places in epoch.watched.items():
        component, _, what = name.partition(": ")
        if state.epoch_of(component) != governed:
            continue
        place = max(places, key=closeness.__getitem__)
        charts, diagnosed = float(indices[place]), component in seen.diagnosed and not what
        index = max(1.0, charts) if diagnosed else charts  # at the limit because of the verdict alone
        found.index[name], found.scores[name] = index, float(reading.scores[places[0]])
        severity = "sensor" if what else "severe" if index >= SEVERE else "alarm"
        driving = _drivers(epoch, reading, name, place)
        found.drivers[name], drivers = driving[0], [driver[:2] for driver in driving]
        if diagnosed:
            drivers.insert(0, (drivers[0][0], epoch.verdict_words(component)))
            severity = severity if charts >= 1 else "verdict"
        shown[name] = _Shown(
            value=index,
            drivers=drivers,
            severity=severity,
            baseline=epoch.identity,
            rising=int(epoch.charts.rising[place]),
            named=bool(what) or diagnosed,
            bursts=bool(epoch.bursts[place]),
            epoch=epoch,
        )
    return shown


def _raised(state: MachineState, seen: Observation, shown: Mapping[str, _Shown]) -> tuple[dict[str, Any], ...]:
    """Update all alarms, and return the rows of those raised; what follows from a standing one is listed in its row.

    A rise alarms for the part that explains the change of all series best, which a verdict decides where there is one.
    Impacts of one component appear in the envelopes of others, modulate with its shaft and raise the record's crest
    factor. A further rise is therefore attributed to the largest standing alarm of a component, unless a verdict names
    it or it is twice as large.
    """
    rises, alarms = list[str](), []
    for name, one in shown.items():
        alarm = state.alarms.setdefault(name, Alarm())
        if one.rising <= 1 and not any(alarm.recent) and alarm.state != RAISED:
            alarm.since = seen.when
        together = (shown[other].value for other in (name, *alarm.consequences) if other in shown)
        if alarm.step(max(filter(math.isfinite, together), default=math.nan), bursts=one.bursts):
            rises.append(name)
    for name in sorted(rises, key=lambda rise: (not shown[rise].named, -shown[rise].value)):
        one, alarm = shown[name], state.alarms[name]
        if alarm.state == RAISED:  # by another rise of this record
            continue
        part, others = _explained(state, name, shown)
        standing = {
            other: state.alarms[other].index
            for other in state.standing
            if ": " not in other and not other.startswith(WHOLE_SIGNAL) and other != name
        }
        stands = part != name and state.alarms[part].stands
        cause = part if stands else max(standing, key=standing.__getitem__, default=part)
        again = not name.startswith(WHOLE_SIGNAL) and one.value >= AGAIN * standing.get(cause, 0.0)
        if not stands and (not standing or one.named or again):
            since, cause = alarm.since or seen.when, part
            state.alarms[part].begin(_row(state, seen, part, one) | {"since": since, "other_explanations": others})
            alarms.append(state.alarms[part].row)
        if cause != name:
            state.alarms[cause].follow(name)
    return tuple(alarms)


def _explained(state: MachineState, name: str, shown: Mapping[str, _Shown]) -> tuple[str, str]:
    """Return the part that a rise alarms for, and the other explanations with their log likelihood ratios to it.

    Parts count that explain the change better than an unknown cause. A sensor's alarm is its own. Maintenance may
    change anything; a change begins within d records of it by chance with the probability (2 d + 1) / n, if n records
    were judged.
    """
    one, alarm = shown[name], state.alarms[name]
    if one.epoch is None or ": " in name:
        return name, ""
    scatter = math.sqrt(_MEMORY / (2 - _MEMORY) + 1 / len(one.epoch.records))
    parts, others = explanations(one.epoch.series, one.epoch.change / scatter)
    known = {what: value for what, value in parts.items() if what in shown and value > others[UNKNOWN]}
    part = name if one.named or alarm.state == ACKNOWLEDGED else max(known, key=known.__getitem__, default=name)
    work, before = state.serviced
    if work:
        apart = abs(state.judged - one.rising - before)
        others[work] = max(others.values()) + math.log(state.judged / (2 * apart + 1))
    ranked = sorted((known | others).items(), key=lambda item: -item[1])
    return part, "; ".join(f"{what} {value - parts.get(part, 0.0):+.1f}" for what, value in ranked if what != part)


def _row(state: MachineState, seen: Observation, name: str, shown: _Shown) -> dict[str, Any]:
    """Return the row of a new alarm."""
    return {
        "machine": state.machine,
        "component": name.partition(": ")[0],
        "channel": shown.drivers[0][0],
        "indicator": "; ".join(dict.fromkeys(word for _, word in shown.drivers)),
        "record": seen.record,
        "recorded_at": seen.recorded_at,
        "value": shown.value,
        "severity": shown.severity,
        "state": RAISED,
        "consequences": "",
        "baseline": shown.baseline,
    }


def _drivers(epoch: Epoch, reading: Reading, name: str, place: int) -> list[Driver]:
    """Return channel, indicator, deviation and ratio to normal of what drives a score, the largest deviation first."""
    component, _, what = name.partition(": ")
    if what:
        channel = component.removeprefix("sensor ")
        level = float(reading.level[epoch.channels.index(channel)])
        return [(channel, what, level, math.exp(level))]
    driving = driving_series(epoch, reading, place, most=_DRIVERS)
    return [(key.channel, key.words, departure, ratio) for key, departure, ratio in driving]


def driving_series(epoch: Epoch, reading: Reading, place: int, *, most: int) -> list[tuple[Series, float, float]]:
    """Return series of a score with deviation and ratio to normal, the largest deviation first, unknown ones last."""
    normal, departures = epoch.learned[0], reading.departures
    those = normal.layout.series[place]
    ranked = those[np.argsort(-departures[those], kind="stable")][:most].tolist()
    return [(epoch.series[i], float(departures[i]), math.exp(departures[i] * normal.series.scale[i])) for i in ranked]


# ---- maintenance -----------------------------------------------------------------------------------------------------


def _do(state: MachineState, seen: Observation, work: Sequence[Work]) -> None:
    """Apply the maintenance between the latest record and this one."""
    now = seconds_since_1970(seen.recorded_at)
    if math.isnan(now):
        return
    for one in work:
        if one.machine in ("", state.machine) and state.last_seconds < seconds_since_1970(one.date) <= now:
            if one.action == ACKNOWLEDGED:
                for name, alarm in state.alarms.items():
                    if _of(name, one.component):
                        alarm.acknowledge()
            else:
                _replace(state, one.component)
                state.serviced = f"maintenance {one.date}", state.judged
    state.last_seconds = now


def _of(name: str, component: str) -> bool:
    return not component or component in component_parts(name.partition(": ")[0])


def _replace(state: MachineState, component: str) -> None:
    """Begin a new epoch for a component, or for the whole machine, and clear its alarms."""
    for key, stratum in state.strata.items():
        others = {name: epoch for name, epoch in stratum.items() if component and name != component}
        state.strata[key] = others | {component: Epoch(counted=True)}
    for name in list(state.alarms):
        if _of(name, component):
            state.alarms.pop(name).row["state"] = CLEARED


# ---- as text ---------------------------------------------------------------------------------------------------------


def _logarithms(covariates: Array) -> Array:
    """Return the logarithms of positive covariates, and the others unchanged."""
    return np.where(covariates > 0, np.log(np.where(covariates > 0, covariates, 1.0)), covariates)
