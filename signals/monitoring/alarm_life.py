"""Life of an alarm: clear, raised, acknowledged, and clear again.

| state | becomes | when |
|---|---|---|
| clear | raised | the index reached 1 in `of` of the last `within` judged records, or `at_once` in one |
| raised | acknowledged | somebody acknowledges it: it is latched until then; its charts restart |
| acknowledged | clear | `quiet` judged records in succession lie below `clear_below` |
| acknowledged | raised (anew) | the index exceeds `again` times the one of the last alarm, by that rule |
| any | clear | maintenance resets the component |
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Life(IntEnum):
    """State of an alarm."""

    CLEAR = 0
    RAISED = 1
    ACKNOWLEDGED = 2


@dataclass(frozen=True, kw_only=True)
class AlarmState:
    """Alarms of several indices after the latest record, arrays of one shape.

    ``life`` is a `Life`; ``recent`` has a bit for each of the latest judged records that reached the limit, ``quiet``
    counts those in succession that lie low, ``raised_at`` is the index when the alarm was last raised.
    """

    life: NDArray[np.int64]
    recent: NDArray[np.int64]
    quiet: NDArray[np.int64]
    raised_at: Array

    def of(self, place: int) -> "AlarmState":
        """Return the alarm at a place."""
        return AlarmState(**{name: values[place, ...] for name, values in vars(self).items()})


def stacked(alarms: Sequence[AlarmState]) -> AlarmState:
    """Return alarms of single indices as one."""
    return AlarmState(
        life=np.array([one.life.item() for one in alarms], dtype=np.int64),
        recent=np.array([one.recent.item() for one in alarms], dtype=np.int64),
        quiet=np.array([one.quiet.item() for one in alarms], dtype=np.int64),
        raised_at=np.array([one.raised_at.item() for one in alarms], dtype=np.float64),
    )


@dataclass(frozen=True, kw_only=True)
class AlarmRule:
    """When an alarm is raised and when it is cleared; the table above.

    Attributes
    ----------
    of, within : int
        m and n of "m of n": two of three leave out what a single record shows.
    at_once : float
        Index at which a single record raises an alarm: twice the limit. The limits take it into account.
    quiet : int
        Records below `clear_below` after which an acknowledged alarm clears.
    clear_below : float
        Index below which a record is quiet: half of the limit, so that an index about the limit is one alarm.
    again : float
        Growth over the index of the last alarm that raises an acknowledged one anew.
    """

    of: int = 2
    within: int = 3
    at_once: float = 2.0
    quiet: int = 10
    clear_below: float = 0.5
    again: float = 2.0

    def start(self, shape: tuple[int, ...] = ()) -> AlarmState:
        """Return clear alarms of a shape."""
        zero = np.zeros(shape, dtype=np.int64)
        return AlarmState(life=zero, recent=zero, quiet=zero, raised_at=np.ones(shape))

    def step(
        self, state: AlarmState, index: Array, *, bursts: NDArray[np.bool_] | bool = False
    ) -> tuple[AlarmState, NDArray[np.bool_]]:
        """Return the alarms after a record with health `index` (...), NaN where not judged, and which are raised.

        Where `bursts`, as a baseline had some, no record raises one by itself.
        """
        judged = np.isfinite(index)
        acknowledged = state.life == Life.ACKNOWLEDGED
        limit = np.where(acknowledged, self.again * state.raised_at, 1.0)
        kept = (1 << self.within) - 1
        recent = np.where(judged, ((state.recent << 1) | (index >= limit)) & kept, state.recent)
        quiet = np.where(judged, np.where(index < self.clear_below, state.quiet + 1, 0), state.quiet)
        reached = sum((recent >> bit) & 1 for bit in range(self.within)) >= self.of
        reached |= (index >= self.at_once * limit) & ~np.asarray(bursts)
        raised = judged & (index >= limit) & reached & (state.life != Life.RAISED)
        cleared = acknowledged & (quiet >= self.quiet) & ~raised
        life = np.where(raised, Life.RAISED, np.where(cleared, Life.CLEAR, state.life))
        recent = np.where(raised | cleared, 0, recent)
        raised_at = np.where(raised, index, state.raised_at)
        return AlarmState(life=life, recent=recent, quiet=quiet, raised_at=raised_at), raised

    def acknowledge(self, state: AlarmState, which: NDArray[np.bool_]) -> AlarmState:
        """Return the alarms with the raised ones of `which` acknowledged."""
        now = which & (state.life == Life.RAISED)
        return replace(
            state,
            life=np.where(now, Life.ACKNOWLEDGED, state.life),
            quiet=np.where(now, 0, state.quiet),
            recent=np.where(now, 0, state.recent),
        )
