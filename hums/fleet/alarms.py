"""Columns of ``alarms.csv``, and the words in them."""

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
    "false_alarm_every",
    "severity",
    "state",
    "consequences",
    "baseline",
    "version",
)
SEVERE = 2.0  # condition index from which an alarm is severe: twice the limit


def life_word(alarm: AlarmState) -> str:
    """Return the state of an alarm that was raised once."""
    return "cleared" if alarm.life == Life.CLEAR else Life(int(alarm.life)).name.lower()
