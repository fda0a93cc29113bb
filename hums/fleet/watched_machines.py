"""Monitoring of the machines of a fleet, and of one in an acquisition loop, whose state is kept between records.

Of a fleet, alarms, baselines and condition indices are written into a folder. The state of a machine is kept as JSON,
read bit for bit as written.
"""

import gzip
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from itertools import dropwhile
from pathlib import Path
from typing import Any

import numpy as np

from hums.analysis.result import Analysis
from hums.fleet import monitor, series
from hums.fleet.monitor import ALARM_COLUMNS, SEVERE, Alarm, Judgement, MachineState, update
from hums.fleet.observation import FleetError, MonitorSettings, Observation, Work, days_since_1970, order_key
from hums.fleet.result_files import StoredRecord, results
from hums.fleet.table import write_rows
from hums.jobs import locked
from hums.records.outputs import atomic_write, write_text
from signals._validation import checked
from signals.monitoring import health
from signals.monitoring.slopes import series_slopes


@dataclass(kw_only=True)
class MachineHistory:
    """A machine's state, and the judgement of each of its records.

    ``records`` has each as observed, ``seen``, why it was not judged, its condition indices and scores; ``alarms`` all
    alarms.
    """

    state: MachineState
    records: list[dict[str, Any]] = field(default_factory=list)
    alarms: list[dict[str, Any]] = field(default_factory=list)
    last: Judgement | None = None

    @property
    def waiting(self) -> str:
        """Why no record was judged yet: ``learning``, or ``unwatched`` if all were refused; empty if one was."""
        return "" if self.last else "unwatched" if self.state.unwatched_since else "learning"

    @property
    def severe_scores(self) -> dict[tuple[str, str], float]:
        """Score of each component, by machine and component, at which the middle EWMA is a severe alarm's."""
        epoch, machine = self.state.epochs[""], self.state.machine
        if epoch.limits is None:
            return {}
        of = epoch.limits.limits[1]
        return {(machine, name): SEVERE * float(of[places[0]]) for name, places in epoch.watched.items()}

    @property
    def false_alarms_a_year(self) -> float:
        """Expected false alarms per year at the rate of the records; NaN without their times."""
        days = days_since_1970(one["seen"].recorded_at for one in self.records)
        if not (days.size and days[-1] > days[0]):
            return math.nan
        return 365.25 * (days.size - 1) / float(days[-1] - days[0]) / self.state.settings.false_alarm_every

    def follow(self, seen: Iterable[Observation], work: Sequence[Work]) -> None:
        """Update the state by further records, in chronological order."""
        for one in seen:
            found = update(self.state, one, work=work)
            self.alarms += found.alarms
            self.records.append({"seen": one, "why": found.why, "index": found.index, "scores": found.scores})
            if found.judged:
                self.last = found

    def growth_per_day(self, component: str) -> float:
        """Return the growth of a component's score since it left normal, in deviations per day; NaN if unknown.

        It is the median slope of at least five records since then.
        """
        since = self.state.alarms[component].since if component in self.state.alarms else ""
        those = list(dropwhile(lambda one: one["seen"].when != since, self.records))
        days = days_since_1970(one["seen"].recorded_at for one in those)
        scores = np.array([one["scores"].get(component, math.nan) for one in those], dtype=np.float64)
        return float(series_slopes(scores[:, None], days).slope_per_day[0])


def watch_machines(
    records: Sequence[StoredRecord], *, settings: MonitorSettings, work: Sequence[Work] = ()
) -> list[MachineHistory]:
    """Return the histories of all machines, sorted by name.

    Parameters
    ----------
    records : sequence of StoredRecord
        All records, in any order.
    settings : MonitorSettings
        Settings of monitoring.
    work : sequence of Work
        Maintenance.
    """
    names = sorted({one.machine for one in records})
    found = {name: MachineHistory(state=MachineState(machine=name, settings=settings)) for name in names}
    for one in sorted(records, key=lambda one: order_key(one.recorded_at, one.record)):
        found[one.machine].follow([one], work)
    return list(found.values())


# ---- tables ----------------------------------------------------------------------------------------------------------


def write_alarms(histories: Sequence[MachineHistory], path: Path) -> None:
    """Write ``alarms.csv``, one row per alarm raised, oldest first."""
    rows = [alarm for history in histories for alarm in history.alarms]
    rows.sort(key=lambda row: (*order_key(row["recorded_at"], row["record"]), row["machine"], row["component"]))
    write_rows(path, ALARM_COLUMNS, rows)


def write_components(histories: Sequence[MachineHistory], path: Path) -> None:
    """Write ``components.csv``, one row per component of each machine, the most urgent first."""
    rows = [component_row(one, name) for one in histories for name in (one.last.index if one.last else [""])]
    rows.sort(key=lambda row: (-np.nan_to_num(row["condition_index"], nan=-np.inf), row["machine"]))
    write_rows(path, tuple(rows[0]), rows)


def component_row(history: MachineHistory, name: str) -> dict[str, Any]:
    """Return the row of a component in ``components.csv``; of a machine without a judged record `name` is empty.

    Index and indicator are those of the component or, while its alarm stands, of the largest of its consequences.
    """
    state, alarm = history.state, history.state.alarms.get(name, Alarm())
    epoch = state.epochs[state.epoch_of(name.partition(": ")[0])]
    last = history.last if history.last and epoch.identity else Judgement(judged=False)
    waiting = history.waiting or ("" if epoch.identity else "learning")
    causes = (cause for cause in state.standing if name in state.alarms[cause].consequences)
    life = next((f"follows from {cause}" for cause in causes), alarm.state)
    leading = max((name, *alarm.consequences), key=lambda other: np.nan_to_num(last.index.get(other, -1.0), nan=-1.0))
    channel, indicator, departure, times_normal = last.drivers.get(leading, ("", "", math.nan, math.nan))
    seen = state.judged + state.refused
    return {
        "machine": state.machine,
        "component": name,
        "condition_index": last.index.get(leading, math.nan),
        "state": waiting or life,
        "since": alarm.since,
        "channel": channel,
        "indicator": indicator,
        "indicator_of": leading,
        "departure": departure,
        "times_normal": times_normal,
        "alarm_from_times_normal": epoch.alarm_from(name) if epoch.identity else math.nan,
        "growth_per_day": history.growth_per_day(leading),
        "false_alarms_a_year": history.false_alarms_a_year,
        "refused_share": state.refused / seen if seen else math.nan,
        "unwatched_since": state.unwatched_since,
        "baseline": epoch.identity,
    }


def write_baselines(histories: Sequence[MachineHistory], path: Path) -> None:
    """Write ``baselines.json``: the baselines of each machine, with their identities, records, series and numbers."""
    found = {one.state.machine: [epoch for epoch in one.state.baselines if epoch.identity] for one in histories}
    write_text(path, json.dumps(found, default=_plain))


# ---- in an acquisition loop ------------------------------------------------------------------------------------------


SCHEMA = "hums-watch/15"
_KINDS: Mapping[str, Any] = {
    name: kind for part in (health, monitor, series) for name, kind in vars(part).items() if is_dataclass(kind)
}
_KIND, _KEYS = "__kind__", ("keys", "series")  # of a dataclass or an array; fields that hold names of series


@checked
def watch(
    analysis: Analysis,
    state: str | Path,
    *,
    settings: MonitorSettings | None = None,
    work: Sequence[Work] = (),
) -> Judgement:
    """Compare a new record of a machine with its baseline, and keep the state of the machine in a file.

    The first records form the baseline, which is then frozen. The state has a constant size and is restored bit for
    bit, so that an interrupted loop resumes with identical results. Processes that share a state take turns. A record
    that was given before, or is older than the latest one, is not judged and changes nothing.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze`; the records of one machine come in chronological order.
    state : str or Path
        File of the machine's state, created if missing.
    settings : MonitorSettings, optional
        Settings for a new state; an existing one keeps its own.
    work : sequence of Work, optional
        Maintenance, from `read_maintenance`.

    Returns
    -------
    Judgement
        Whether the record was judged or why not, the condition index of each component (0 normal, 1 alarm), and the
        alarms raised by it, rows of ``alarms.csv``.

    Raises
    ------
    FleetError
        If the file is not a state, or that of another machine.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import hums
    >>> rng, gearbox = np.random.default_rng(0), hums.load_gearbox("two-stage")
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> with TemporaryDirectory() as folder:
    ...     for _ in range(3):
    ...         record = hums.make_record({"housing": rng.normal(size=8000)}, rate_hz=4000, units="g", angle=angle)
    ...         analysis = hums.analyze(record, gearbox)
    ...         found = hums.watch(analysis, f"{folder}/mill.state", settings=hums.MonitorSettings(baseline_records=2))
    ...         print(found.judged, found.why, len(found.alarms))
    False learning 0
    False learning 0
    True  0
    """
    row = results(analysis)
    facts = {name: str(analysis.attrs.get(name, "")) for name in ("record", "machine", "recorded_at")}
    path = Path(state)
    with locked(path.resolve().parent, wait=True):  # from the state that is read to the one that is written
        if path.exists():
            kept = read_state(path)
        else:
            kept = MachineState(machine=facts["machine"], settings=settings or MonitorSettings())
        if facts["machine"] != kept.machine:
            whose = f"of machine {facts['machine']!r} and the state of {kept.machine!r}"
            raise FleetError(f"the record is {whose}; keep a state for each.")
        row |= facts
        seen = Observation(**{one.name: row[one.name] for one in fields(Observation)})
        found = update(kept, seen, work=work)
        write_state(kept, path)
    return found


# ---- the state -----------------------------------------------------------------------------------------------------


def write_state(state: MachineState, path: Path) -> None:
    """Write a state to a file atomically."""
    text = json.dumps({"schema": SCHEMA, "state": state}, default=_plain)
    with atomic_write(path) as part:
        part.write_bytes(gzip.compress(text.encode(), compresslevel=6, mtime=0))


def read_state(path: Path) -> MachineState:
    """Return the state in a file of `write_state`.

    Raises
    ------
    FleetError
        If the file is not a state.
    """
    try:
        table = json.loads(gzip.decompress(path.read_bytes()), object_hook=_restored)
        schema, state = table["schema"], table["state"]
    except Exception as error:  # noqa: BLE001 - of damaged bytes: a broken archive, lists in the place of numbers
        raise FleetError(f"{path}: not a state of hums.watch ({error}); name the file that it wrote.") from None
    if schema != SCHEMA:
        raise FleetError(f"{path} holds {schema!r}, but this version reads {SCHEMA!r}; start again.")
    if not isinstance(state, MachineState):
        raise FleetError(f"{path}: not a state of hums.watch; name the file that it wrote.")
    return state


def _plain(thing: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return a dataclass or an array as a JSON object, with all significant digits of floats."""
    if is_dataclass(thing):
        return {_KIND: type(thing).__name__} | {one.name: getattr(thing, one.name) for one in fields(thing)}
    return {_KIND: "array", "values": thing.ravel().tolist(), "dtype": str(thing.dtype), "shape": thing.shape}


def _restored(table: dict[str, Any]) -> Any:  # noqa: ANN401
    """Return the dataclass or the array of a JSON object of `_plain`, and any other object as it is."""
    kind = table.pop(_KIND, "")
    if kind == "array":
        return np.array(table["values"], dtype=table["dtype"]).reshape(table["shape"])
    for name in (one for one in _KEYS if isinstance(table.get(one), list)):
        table[name] = series.shared(tuple(map(series.Series._make, table[name])))
    return _KINDS[kind](**table) if kind else table
