"""Observation of a machine for monitoring: time, speed, condition of the sensors, and series of one record."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.fleet.series import NOTHING, Numbers
from hums.records.fields import natural_key
from signals._validation import SentenceError

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


def observation(row: Mapping[str, Any]) -> Observation:
    """Return what is monitored of the results of a record with its names."""
    return Observation(**{one.name: row[one.name] for one in fields(Observation)})


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
