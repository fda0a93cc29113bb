"""Rows of ``alarms.csv``: what an alarm says."""

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

from signals.monitoring.alarm_life import AlarmState, Life

ALARM_COLUMNS = (
    "machine",
    "component",
    "channel",
    "indicator",
    "record",
    "recorded_at",
    "since",
    "value",
    "limit",
    "false_alarm_every",
    "severity",
    "state",
    "baseline",
    "version",
)
SEVERE = 2.0  # health index from which an alarm is severe: twice the limit
SEVERITIES = ("verdict", "alarm", "severe", "sensor")
"""By a record's own verdict alone; by the charts; by the charts at `SEVERE` times their limit; of a sensor."""


def alarm_row(
    machine: str,
    component: str,
    drivers: Sequence[tuple[str, str]],
    *,
    record: str,
    recorded_at: str,
    since: str,
    value: float,
    severity: str,
    false_alarm_every: float,
    baseline: str = "",
) -> dict[str, Any]:
    """Return an alarm that is raised now; `drivers` are channels and indicators, what departs most first."""
    return {
        "machine": machine,
        "component": component,
        "channel": drivers[0][0] if drivers else "",
        "indicator": "; ".join(dict.fromkeys(name for _, name in drivers)),
        "record": record,
        "recorded_at": recorded_at,
        "since": since,
        "value": value,
        "limit": 1.0,
        "false_alarm_every": false_alarm_every,
        "severity": severity,
        "state": Life.RAISED.name.lower(),
        "baseline": baseline,
        "version": version("hums-toolkit"),
    }


def life_word(alarm: AlarmState) -> str:
    """Return the state of an alarm that was raised once."""
    return "cleared" if alarm.life == Life.CLEAR else Life(int(alarm.life)).name.lower()
