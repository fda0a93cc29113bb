"""Alarms of components, and the columns of ``alarms.csv``.

| state | becomes | when |
|---|---|---|
| clear, cleared | raised | the index reached 1 in 2 of the last 3 judged records, or 2 in one |
| raised | acknowledged | an acknowledgement is read: it is latched until then; its charts restart |
| acknowledged | cleared | 10 judged records in succession lie below one half |
| acknowledged | raised (anew) | the index exceeds twice the one of the last alarm, by that rule |
| any | cleared | maintenance resets the component |
"""

import math
from dataclasses import dataclass, field
from typing import Any

from signals.monitoring.limits import AT_ONCE, OF, WITHIN

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
CLEAR, RAISED, ACKNOWLEDGED, CLEARED = "clear", "raised", "acknowledged", "cleared"
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

    def acknowledge(self) -> bool:
        """Acknowledge the alarm where it is raised, and return whether it was."""
        if self.state != RAISED:
            return False
        self.row["state"], self.recent, self.quiet = ACKNOWLEDGED, (), 0
        return True
