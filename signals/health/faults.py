"""What a check of a sensor finds."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["clipping", "drop-out", "stuck", "mains hum", "ski slope", "level jump", "offset jump", "spikes"]
Severity = Literal["suspect", "sick"]


@dataclass(frozen=True, kw_only=True)
class SensorFault:
    """One thing that is wrong with a record of a sensor.

    Attributes
    ----------
    kind : str
    severity : "suspect" or "sick"
    size : float
        In numbers, as the sentence explains them.
    sentence : str
        What was seen, where, how large, and what to do.
    """

    kind: Kind
    severity: Severity
    size: float
    sentence: str


def graded(kind: Kind, *, sick: bool, size: float, sentence: str) -> SensorFault:
    """Return a fault that is sick or else suspect."""
    return SensorFault(kind=kind, severity="sick" if sick else "suspect", size=size, sentence=sentence)
