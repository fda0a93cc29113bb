"""Whether what a caller declares of the times of a file agrees with what the file says of them."""

import re
from collections.abc import Sequence
from datetime import datetime
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from hums.readers.foreign import ForeignFile
from hums.record import RecordError

__all__ = ["beginning", "rate_hz_of", "refuse_other_clock"]

_CLOCKS = {"t", "time", "t_s", "time_s", "t_sec", "time_sec", "time_seconds"}  # also "Time [s]" and "time (s)"
_SAME_RATE = 0.01
_PRINTED = 1e-5  # a step printed with six digits


def rate_hz_of(file: ForeignFile, name: str, *, declared: float | None) -> float:
    """Return the declared rate of a channel or the file's.

    A header of whole numbers may have dropped a fraction, and a printed step its seventh digit: within 1 Hz, or
    1e-5 of it, what is declared holds.
    """
    stated = file.says(name).rate_hz
    if declared is None:
        if stated is None:
            raise RecordError(
                f"{file.path.name} does not state its samples per second: rate_hz=... (--rate-hz) is needed."
            )
        return stated
    if stated is not None and isinstance(declared, Real):
        apart = abs(declared - stated)
        if apart >= max(min(1.0, _SAME_RATE * stated), _PRINTED * stated):
            raise RecordError(
                f"rate_hz={declared:g} contradicts {file.path.name}, which states {stated:g} Hz; leave "
                "--rate-hz out, or correct the file."
            )
    return declared


def beginning(file: ForeignFile, names: Sequence[str], *, rate_hz: float) -> tuple[float, datetime | None]:
    """Return the time of the first sample in s and the moment it counts from, as the file states them for `names`.

    Raises
    ------
    RecordError
        If they began more than half a sample apart: a record has one clock.
    """
    says = [file.says(name) for name in names]
    starts = [stated.start_s or 0.0 for stated in says]
    moments = [stated.began.timestamp() if stated.began else 0.0 for stated in says]
    for name, start, moment in zip(names, starts, moments, strict=True):
        late = (start - starts[0]) + (moment - moments[0])
        if late and isinstance(rate_hz, Real) and abs(late) * rate_hz > 0.5:  # noqa: PLR2004 - make_record weighs the rate
            raise RecordError(
                f'{file.path.name}: "{name}" begins {late:g} s after "{names[0]}"; a record has one clock. '
                "Convert them one by one, or cut them to the same span."
            )
    return starts[0], says[0].began


def refuse_other_clock(file: ForeignFile, rate_hz: float, *, count: int, other_than: Sequence[str]) -> None:
    """Hold the rate against a column of evenly spaced times, one for each of `count` samples, if there is one."""
    for name, field in file.fields.items():
        plain = re.sub(r"[\W_]+", "_", name.rpartition(".")[2].lower()).strip("_")
        if name in other_than or plain not in _CLOCKS or isinstance(field, str) or max(field.shape, default=1) != count:
            continue
        step_s = _even_step(field.reshape(-1)) if field.size == count else None
        if step_s and isinstance(rate_hz, Real) and abs(step_s * rate_hz - 1) > _SAME_RATE:
            raise RecordError(
                f'rate_hz={rate_hz:g} contradicts {file.path.name}, whose "{name}" goes in steps of {step_s:.6g} s, '
                f"{1 / step_s:.6g} Hz. Correct --rate-hz; if that column is not in seconds, give it another name."
            )


def _even_step(times: NDArray[np.generic]) -> float | None:
    """Return the step of times that rise evenly, however coarsely they are printed, else None."""
    if times.size < 2 or times.dtype.kind not in "iuf":  # noqa: PLR2004
        return None
    numbers = times.astype(np.float64)
    span = numbers[-1] - numbers[0]
    if not (span > 0 and np.isfinite(numbers).all()):
        return None
    even = np.linspace(numbers[0], numbers[-1], numbers.size)
    return float(span / (numbers.size - 1)) if np.max(np.abs(numbers - even)) < _SAME_RATE * span else None
