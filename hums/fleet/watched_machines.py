"""Monitoring of the machines of a fleet: alarms, baselines and condition indices, written into a folder."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import dropwhile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from hums.fleet.alarms import ALARM_COLUMNS, SEVERE, Alarm
from hums.fleet.maintenance import Work
from hums.fleet.monitor import Judgement, MachineState, update
from hums.fleet.monitor_settings import MonitorSettings
from hums.fleet.observation import Observation, days_since_1970, order_key
from hums.fleet.result_files import StoredRecord
from hums.fleet.table import write_rows
from hums.records.store import write_tree
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
    """Return the row of a component in ``components.csv``; of a machine without a judged record `name` is empty."""
    state, alarm = history.state, history.state.alarms.get(name, Alarm())
    epoch = state.epochs[state.epoch_of(name.partition(": ")[0])]
    last = history.last if history.last and epoch.identity else Judgement(judged=False)
    waiting = history.waiting or ("" if epoch.identity else "learning")
    causes = (cause for cause in state.standing if name in state.alarms[cause].consequences)
    life = next((f"follows from {cause}" for cause in causes), alarm.state)
    channel, indicator, departure, times_normal = last.drivers.get(name, ("", "", math.nan, math.nan))
    seen = state.judged + state.refused
    return {
        "machine": state.machine,
        "component": name,
        "condition_index": last.index.get(name, math.nan),
        "state": waiting or life,
        "since": alarm.since,
        "channel": channel,
        "indicator": indicator,
        "departure": departure,
        "times_normal": times_normal,
        "alarm_from_times_normal": epoch.alarm_from(name) if epoch.identity else math.nan,
        "growth_per_day": history.growth_per_day(name),
        "false_alarms_a_year": history.false_alarms_a_year,
        "refused_share": state.refused / seen if seen else math.nan,
        "unwatched_since": state.unwatched_since,
        "baseline": epoch.identity,
    }


def write_baselines(histories: Sequence[MachineHistory], path: Path) -> None:
    """Write ``baseline.h5``: a group for every baseline, with its identity, records, series and numbers.

    ``center``, ``scale`` and ``slope`` are of logarithms, the latter per logarithm of the covariate; ``limit`` is in
    deviations of the score; ``low`` to ``high`` is judged.
    """
    groups: dict[str, xr.Dataset] = {"/": xr.Dataset(attrs={"schema": "hums-baseline/1"})}
    for state, epoch in ((one.state, epoch) for one in histories for epoch in one.state.baselines if epoch.identity):
        (normal, limits), scores = epoch.learned, len(epoch.names)
        series = pd.DataFrame(epoch.series)
        arrays = {
            "center": ("series", normal.series.center),
            "scale": ("series", normal.series.scale),
            "slope": (("covariate", "series"), normal.series.slopes),
            "score_center": ("watched", normal.score.center),
            "score_scale": ("watched", normal.score.scale),
            "limit": (("watched", "chart"), limits.limits[:, :scores].T),
            "low": ("covariate", epoch.low),
            "high": ("covariate", epoch.high),
        }
        words = {"watched": epoch.names, "covariate": epoch.covariates, "record": epoch.records}
        groups[f"/{epoch.identity}"] = xr.Dataset(
            arrays | {name: ("series", series[name].to_numpy(np.str_)) for name in series},
            coords={name: np.array(those, dtype=np.str_) for name, those in words.items()},
            attrs={"machine": state.machine, "identity": epoch.identity},
        )
    write_tree(xr.DataTree.from_dict(groups), path)
