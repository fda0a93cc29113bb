"""A fault of a sensor, with its severity."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["clipping", "drop-out", "stuck", "mains hum", "ski slope", "level jump", "offset jump", "spikes"]
Severity = Literal["suspect", "sick"]


@dataclass(frozen=True, kw_only=True)
class SensorFault:
    """One fault in the record of a sensor.

    Attributes
    ----------
    kind : str
        "clipping", "drop-out", "stuck", "mains hum", "ski slope", "level jump", "offset jump" or "spikes".
    severity : str
        "suspect" should be checked, "sick" distorts estimates.
    size : float
        The measure named in the sentence: a share of samples or power, a ratio, or a count.
    sentence : str
        What was found, where, how large, and the remedy.

    Examples
    --------
    >>> from signals import sensor_health
    >>> fault = sensor_health([1.0] * 64, rate_hz=1000, units="g").faults[0]
    >>> print(f"{fault.kind}, {fault.severity}: {fault.sentence}")
    stuck, sick: it is 1 g throughout. Check sensor, cable and supply.
    """

    kind: Kind
    severity: Severity
    size: float
    sentence: str


def graded(kind: Kind, *, sick: bool, size: float, sentence: str) -> SensorFault:
    """Return a fault of severity "sick", or else "suspect"."""
    return SensorFault(kind=kind, severity="sick" if sick else "suspect", size=size, sentence=sentence)
