"""Maintenance file: replaced components and acknowledged alarms."""

import csv
import math
from dataclasses import dataclass, fields
from pathlib import Path

from hums.fleet.alarms import ACKNOWLEDGED
from hums.fleet.observation import FleetError, seconds_since_1970
from signals._validation import checked

_COLUMNS = ("date", "component")
REPLACED = "replaced"


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
