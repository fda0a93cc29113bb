"""Inputs of monitoring: observations of machines, settings, and maintenance."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.fleet.series import NOTHING, Numbers
from hums.records.fields import natural_key
from signals._validation import SentenceError, checked

NOT_ANALYSED = "not analysed"  # why a record without results is not judged


class FleetError(SentenceError):
    """Raised if records, settings, maintenance or a state of monitoring are not as needed.

    Examples
    --------
    >>> import hums
    >>> try:
    ...     hums.analyze_fleet([], "two-stage", "no-folder")
    ... except hums.FleetError as error:
    ...     print(error)
    no records were named; name files, or folders that hold some.
    """


@dataclass(frozen=True, kw_only=True)
class Observation:
    """One record of a machine.

    Attributes
    ----------
    machine, record, recorded_at : str
        Names and time as stated by the record; the time is empty without a date.
    regime : str
        Operating regime; empty if not stated.
    values : Numbers
        Of each `Series`: logarithms of indicators and lines, without those of faulty sensors.
    covariates : mapping of str to float
        Operating conditions: speed in rev/s, and any measured torque, temperature and other quantities.
    faulty : mapping of str to str
        Reason for each faulty sensor or tachometer.
    unjudged : str
        Reason why the record is not judged, or empty.
    diagnosed : sequence of str
        Components that the record's own verdicts diagnose as damaged.
    """

    machine: str
    record: str
    recorded_at: str = ""
    regime: str = ""
    values: Numbers = NOTHING
    covariates: Mapping[str, float] = field(default_factory=dict)
    faulty: Mapping[str, str] = field(default_factory=dict)
    unjudged: str = ""
    diagnosed: Sequence[str] = ()

    @property
    def when(self) -> str:
        """Time of the record or, without one, its name."""
        return self.recorded_at or self.record


def seconds_since_1970(when: str) -> float:
    """Return the seconds since 1970 of an ISO 8601 time, in UTC if it has no offset; NaN if invalid."""
    try:
        moment = datetime.fromisoformat(when)
    except ValueError:
        return math.nan
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def days_since_1970(moments: Iterable[str]) -> NDArray[np.float64]:
    """Return the days since 1970 of ISO 8601 times; NaN if invalid."""
    return np.array([seconds_since_1970(when) for when in moments], dtype=np.float64) / 86400


def order_key(recorded_at: str, record: str) -> tuple[Any, ...]:
    """Return a key that sorts records by time, then by name with numbers compared as numbers."""
    seconds = seconds_since_1970(recorded_at)
    return (0, seconds, natural_key(record)) if math.isfinite(seconds) else (1, 0.0, natural_key(record))


# ---- settings --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class MonitorSettings:
    """Settings of monitoring.

    Attributes
    ----------
    baseline_records : int
        Number of judged records of which a baseline is learned, at least 2.
    baseline_from, baseline_until : str
        Or the period whose records form the baseline, ISO 8601; an empty end is open.
    healthy : tuple of str
        Or the names of records that are declared healthy.
    false_alarm_every : float
        Mean number of records of a machine from a state without alarms to the first false alarm of any of its
        components and sensors.

    Examples
    --------
    >>> import hums
    >>> hums.MonitorSettings(baseline_until="2026-03-01").by_choice
    True
    """

    baseline_records: int = 30
    baseline_from: str = ""
    baseline_until: str = ""
    healthy: tuple[str, ...] = ()
    false_alarm_every: float = 10_000.0

    def __post_init__(self) -> None:
        if self.baseline_records < 2:  # noqa: PLR2004
            raise FleetError(f"baseline_records = {self.baseline_records}: a deviation needs at least 2 records.")
        if not self.false_alarm_every >= 10:  # noqa: PLR2004
            raise FleetError(f"false_alarm_every = {self.false_alarm_every:g}: give at least 10 records.")
        for name in ("baseline_from", "baseline_until"):
            when = getattr(self, name)
            if when and math.isnan(seconds_since_1970(when)):
                raise FleetError(f"{name} = {when!r} is not an ISO 8601 time, as 2026-03-01.")

    @property
    def by_choice(self) -> bool:
        """Whether the records of the baseline are chosen by time or name, not by number."""
        return bool(self.baseline_from or self.baseline_until or self.healthy)

    def chosen(self, seen: Observation) -> bool:
        """Return whether a record belongs to a baseline that is chosen by time or name."""
        if self.healthy:
            return seen.record in self.healthy
        seconds = seconds_since_1970(seen.recorded_at)
        start, stop = (seconds_since_1970(when) if when else None for when in (self.baseline_from, self.baseline_until))
        return math.isfinite(seconds) and (start is None or seconds >= start) and (stop is None or seconds <= stop)


# ---- maintenance -----------------------------------------------------------------------------------------------------


_COLUMNS = ("date", "component")
REPLACED, ACKNOWLEDGED = "replaced", "acknowledged"


@dataclass(frozen=True, kw_only=True)
class Work:
    """One line of a maintenance file; an empty machine or component means all.

    Examples
    --------
    >>> import hums
    >>> hums.Work(date="2026-03-01", component="input bearing").action
    'replaced'
    """

    date: str
    machine: str = ""
    component: str = ""
    action: str = REPLACED


@checked
def read_maintenance(path: str | Path) -> tuple[Work, ...]:
    r"""Return the entries of a CSV file with columns date and component, and optionally machine and action.

    Parameters
    ----------
    path : str or Path
        ``date`` is in ISO 8601; ``component`` as in ``alarms.csv``, empty for all of a machine; ``action`` is
        ``replaced`` (default: a new baseline is learned) or ``acknowledged``.

    Raises
    ------
    FleetError
        If a column is missing, a date invalid, or an action unknown.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import hums
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "work.csv")
    ...     _ = path.write_text("date,component\n2026-03-01,input bearing\n", encoding="utf-8")
    ...     [(work.component, work.action) for work in hums.read_maintenance(path)]
    [('input bearing', 'replaced')]
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError) as error:
        raise FleetError(f"{path}: the maintenance file cannot be read ({error}); give a CSV file in UTF-8.") from None
    found = []
    for number, row in enumerate(rows, start=2):
        missing = [name for name in _COLUMNS if row.get(name) is None]
        if missing:
            raise FleetError(f"{path}: column {missing[0]!r} is missing; a maintenance file has {', '.join(_COLUMNS)}.")
        given = {one.name: (row.get(one.name) or "").strip() for one in fields(Work)}
        work = Work(**given | {"action": given["action"] or REPLACED})
        if math.isnan(seconds_since_1970(work.date)):
            raise FleetError(f"{path}, line {number}: date {work.date!r} is not an ISO 8601 time, as 2026-03-01.")
        if work.action not in (REPLACED, ACKNOWLEDGED):
            raise FleetError(
                f"{path}, line {number}: action {work.action!r} is unknown; write {REPLACED} or {ACKNOWLEDGED}."
            )
        found.append(work)
    return tuple(sorted(found, key=lambda work: (seconds_since_1970(work.date), work.component, work.action)))
