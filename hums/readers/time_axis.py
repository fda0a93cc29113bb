"""Sampling rates and start times of foreign files: declared values against those that the file states."""

import math
import re
from collections.abc import Sequence
from datetime import datetime
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import ForeignFile, descriptions, rate_of_step
from hums.records.record import RecordError
from signals._validation import is_float

__all__ = ["TimeUnit", "check_time_column", "rate_hz_of", "start_and_epoch"]

TimeUnit: TypeAlias = Literal["s", "ms", "us"]

_TIME_COLUMNS = {"t", "time", "t_s", "time_s", "t_sec", "time_sec", "time_seconds"}  # also "Time [s]" and "time (s)"
_SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_UNEVEN = 0.25  # of a step: one missing sample in the middle moves the times by half of one
_RATE_TOLERANCE = 0.01
_STEP_TOLERANCE = 1e-5  # a step printed with six digits


def rate_hz_of(file: ForeignFile, name: str, *, declared: float | None, time_unit: TimeUnit | None = None) -> float:
    """Return the samples per second of a channel, declared or stated by the file; refuse a contradiction.

    The declared rate has precedence within 1 Hz, as a header of whole numbers drops a fraction, or within 1e-5, as a
    printed time step drops digits.
    """
    stated = file.metadata(name).rate_hz
    if declared is None:
        if stated is None:
            stated = _rate_of_time_column(file, name, time_unit)
        if stated is None:
            raise RecordError(
                f"{file.path.name} does not state its samples per second: rate_hz=... (--rate-hz) is needed."
            )
        return stated
    if stated is not None and is_float(declared):
        difference = abs(declared - stated)
        if difference >= max(min(1.0, _RATE_TOLERANCE * stated), _STEP_TOLERANCE * stated):
            raise RecordError(
                f"rate_hz={declared:g} contradicts {file.path.name}, which states {stated:g} Hz; leave "
                "--rate-hz out, or correct the file."
            )
    return declared


def _rate_of_time_column(file: ForeignFile, name: str, declared: TimeUnit | None) -> float | None:
    """Return the samples per second of a column of evenly spaced times whose unit is stated or declared, else None.

    Raises
    ------
    RecordError
        If its unit is neither stated nor declared, or both and differ, or the times are not even: a sample may be
        missing.
    """
    count = file.vector(name).size
    for title, shape in descriptions(file.fields).items():
        words = re.sub(r"[\W_]+", " ", title.lower()).split()
        if isinstance(shape, str) or math.prod(shape) != count or count < 2 or words[:1] not in (["t"], ["time"]):  # noqa: PLR2004
            continue
        unit = next((_SECONDS[word] for word in words[1:] if word in _SECONDS), None)
        if declared is not None and unit not in (None, _SECONDS[declared]):
            raise RecordError(
                f'time_unit="{declared}" contradicts {file.path.name}, whose header says "{title}"; leave --time-unit '
                "out, or correct the header."
            )
        unit = _SECONDS[declared] if declared else unit
        if unit is None:
            raise RecordError(
                f'{file.path.name}: the header "{title}" does not say the unit of its times; give it, '
                'time_unit="ms" (--time-unit ms), or write it as in "time (s)", or give rate_hz=... (--rate-hz).'
            )
        times_s = unit * np.asarray(file.fields[title]).reshape(-1).astype(np.float64)
        step_s = (times_s[-1] - times_s[0]) / (count - 1)
        off = np.abs(times_s - np.linspace(times_s[0], times_s[-1], count))
        if not (step_s > 0 and np.max(off) < _UNEVEN * step_s):
            raise RecordError(
                f'{file.path.name}: the times in "{title}" are not evenly spaced, so they state no rate: row '
                f"{int(np.argmax(off)) + 1} is {np.max(off) / abs(step_s or 1):.3g} steps from where it should be. "
                "Resample the record, or give rate_hz=... (--rate-hz) where only the printed times are rounded."
            )
        return rate_of_step(step_s)
    return None


def start_and_epoch(file: ForeignFile, names: Sequence[str], *, rate_hz: float) -> tuple[float, datetime | None]:
    """Return the time of the first sample of some channels in s and the epoch it counts from, as the file states.

    Raises
    ------
    RecordError
        If their first samples are more than half a sample apart.
    """
    metadata = [file.metadata(name) for name in names]
    starts = [stated.start_s or 0.0 for stated in metadata]
    epochs_s = [stated.epoch.timestamp() if stated.epoch else 0.0 for stated in metadata]
    for name, start, epoch_s in zip(names, starts, epochs_s, strict=True):
        late = (start - starts[0]) + (epoch_s - epochs_s[0])
        if late and is_float(rate_hz) and abs(late) * rate_hz > 0.5:  # noqa: PLR2004 - make_record checks the rate
            raise RecordError(
                f'{file.path.name}: "{name}" begins {late:g} s after "{names[0]}"; a record has one clock. '
                "Convert them one by one, or cut them to the same span."
            )
    return starts[0], metadata[0].epoch


def check_time_column(
    file: ForeignFile, rate_hz: float, *, count: int, used: Sequence[str], time_unit: TimeUnit | None = None
) -> None:
    """Check the rate against a column of evenly spaced times of `count` samples, if the file has one."""
    for name, shape in descriptions(file.fields).items():
        normalized = re.sub(r"[\W_]+", "_", name.rpartition(".")[2].lower()).strip("_")
        if name in used or normalized not in _TIME_COLUMNS or isinstance(shape, str) or max(shape, default=1) != count:
            continue
        field = np.asarray(file.fields[name])
        step_s = _even_step(field.reshape(-1)) if field.size == count else None
        if step_s and time_unit and normalized in ("t", "time"):
            step_s *= _SECONDS[time_unit]
        if step_s and is_float(rate_hz) and abs(step_s * rate_hz - 1) > _RATE_TOLERANCE:
            raise RecordError(
                f'rate_hz={rate_hz:g} contradicts {file.path.name}, whose "{name}" goes in steps of {step_s:.6g} s, '
                f"{1 / step_s:.6g} Hz. Correct --rate-hz; if that column is not in seconds, say so (--time-unit)."
            )


def _even_step(times: NDArray[np.generic]) -> float | None:
    """Return the step of evenly spaced times, also coarsely rounded ones, else None."""
    if times.size < 2 or times.dtype.kind not in "iuf":  # noqa: PLR2004
        return None
    numbers = times.astype(np.float64)
    span = numbers[-1] - numbers[0]
    if not (span > 0 and np.isfinite(numbers).all()):
        return None
    linear = np.linspace(numbers[0], numbers[-1], numbers.size)
    return float(span / (numbers.size - 1)) if np.max(np.abs(numbers - linear)) < _RATE_TOLERANCE * span else None
