"""Settings of monitoring: baseline, and rate of false alarms."""

import math
from dataclasses import dataclass

from hums.fleet.observation import FleetError, Observation, seconds_since_1970


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
