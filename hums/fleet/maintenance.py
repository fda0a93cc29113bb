"""Maintenance file: replaced components and acknowledged alarms."""

import csv
import math
from dataclasses import dataclass, fields
from pathlib import Path

from hums.fleet.alarms import ACKNOWLEDGED
from hums.fleet.observation import seconds_since_1970
from signals._validation import SentenceError, checked

_COLUMNS = ("date", "component")
REPLACED = "replaced"


class MaintenanceError(SentenceError):
    """Raised if a maintenance file cannot be read.

    Examples
    --------
    >>> import hums
    >>> try:
    ...     hums.read_maintenance("nothing.csv")
    ... except hums.MaintenanceError as error:
    ...     print("cannot be read" in str(error))
    True
    """


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
    serial: str = ""
    action: str = REPLACED


@checked
def read_maintenance(path: str | Path) -> tuple[Work, ...]:
    r"""Return the entries of a CSV file with columns date and component, and optionally machine, serial and action.

    Parameters
    ----------
    path : str or Path
        ``date`` is in ISO 8601; ``component`` as in ``alarms.csv``, empty for all of a machine; ``action`` is
        ``replaced`` (default: a new baseline is learned) or ``acknowledged``.

    Raises
    ------
    MaintenanceError
        If a column is missing, a date invalid, or an action unknown.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import hums
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "work.csv")
    ...     _ = path.write_text("date,component,serial\n2026-03-01,input bearing,B-17\n", encoding="utf-8")
    ...     [(work.component, work.serial) for work in hums.read_maintenance(path)]
    [('input bearing', 'B-17')]
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError) as error:
        raise MaintenanceError(
            f"{path}: the maintenance file cannot be read ({error}); give a CSV file in UTF-8."
        ) from None
    found = []
    for number, row in enumerate(rows, start=2):
        missing = [name for name in _COLUMNS if row.get(name) is None]
        if missing:
            raise MaintenanceError(
                f"{path}: column {missing[0]!r} is missing; a maintenance file has {', '.join(_COLUMNS)}."
            )
        given = {one.name: (row.get(one.name) or "").strip() for one in fields(Work)}
        work = Work(**given | {"action": given["action"] or REPLACED})
        if math.isnan(seconds_since_1970(work.date)):
            raise MaintenanceError(f"{path}, line {number}: date {work.date!r} is not an ISO 8601 time, as 2026-03-01.")
        if work.action not in (REPLACED, ACKNOWLEDGED):
            raise MaintenanceError(
                f"{path}, line {number}: action {work.action!r} is unknown; write {REPLACED} or {ACKNOWLEDGED}."
            )
        found.append(work)
    return tuple(sorted(found, key=lambda work: (seconds_since_1970(work.date), work.component, work.action)))
