"""Other people's files to records: the suffix decides who reads.

A reader returns what the file holds by name: an array, or the words that say why it is none. What the file
does not state (units, rate, shaft) the caller declares; nothing is guessed.
"""

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from numbers import Real
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hums.record import Angle, NominalSpeed, PulseTimes, RecordError, TachometerWaveform, make_record
from hums.store import existing_file

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["ForeignFile", "convert", "read_file"]

_SUFFIXES = (".mat", ".wav", ".csv")
_CLOCKS = {"t", "time", "t_s", "time_s", "t_sec", "time_sec", "time_seconds"}  # also "Time [s]" and "time (s)"
_SAME_RATE = 0.01


@dataclass(frozen=True, kw_only=True)
class ForeignFile:
    """What another program's file holds.

    Attributes
    ----------
    path : Path
        Where it is.
    fields : mapping of str to array or str
        By name, an array of numbers, or what stands there instead, such as "text".
    rate_hz : float or None
        Samples per second, where the file states them.
    """

    path: Path
    fields: Mapping[str, NDArray[np.generic] | str]
    rate_hz: float | None = None

    def vector(self, name: str) -> NDArray[np.generic]:
        """Return the array `name` as one row of numbers, (n,), whether it was a row or a column."""
        field = self.fields.get(name)
        if field is None:
            raise RecordError(f'{self.path.name} has no "{name}"{_closest(name, self.fields)} {self.contents()}')
        if isinstance(field, str):
            raise RecordError(f'{self.path.name}: "{name}" is {field}, not numbers. {self.contents()}')
        if field.size != max(field.shape, default=1):
            raise RecordError(
                f'{self.path.name}: "{name}" is a table of {_shape(field)} values; a channel is one row or one '
                "column: save each under a name of its own."
            )
        return field.reshape(-1)

    def contents(self) -> str:
        """Say what the file holds, one sentence for arrays and one for the rest."""
        arrays = [f"{name} ({_shape(field)})" for name, field in self.fields.items() if _is_array(field)]
        others = [f"{name} ({field})" for name, field in self.fields.items() if not _is_array(field)]
        rest = f" Not numbers: {', '.join(others)}." if others else ""
        return f"It holds {', '.join(arrays) or 'no array of numbers'}.{rest}"


def read_file(path: str | PathLike[str]) -> ForeignFile:
    """Read a foreign file with the reader of its suffix.

    Raises
    ------
    RecordError
        If there is no file, no reader for it, or the reader does not get through.
    """
    file = existing_file(path)
    rate_hz: float | None = None
    fields: Mapping[str, NDArray[np.generic] | str]
    match file.suffix.lower():
        case ".mat":
            from hums.readers import matlab  # noqa: PLC0415 - each reader loads only its own library

            fields = matlab.read(file)
        case ".wav":
            from hums.readers import wav  # noqa: PLC0415

            rate_hz, fields = wav.read(file)
        case ".csv":
            from hums.readers import csv  # noqa: PLC0415

            fields = csv.read(file)
        case suffix:
            raise RecordError(
                f'{file}: no reader for the suffix "{suffix}"; known are {", ".join(_SUFFIXES)}. Export the signals '
                "to one of them, or build the record in Python with make_record."
            )
    return ForeignFile(path=file, fields=MappingProxyType(dict(fields)), rate_hz=rate_hz)


def convert(
    source: str | PathLike[str],
    *,
    channels: Sequence[str],
    units: str | Mapping[str, str] | None,
    rate_hz: float | None = None,
    tach_times: str | None = None,
    tach_waveform: str | None = None,
    pulses_per_rev: int | None = None,
    shaft: str | None = None,
    shaft_rpm: float | None = None,
    scale: float = 1.0,
    machine: str = "",
    recorded_at: datetime | str | None = None,
) -> "xr.Dataset":
    """Make a record of another program's file.

    Parameters
    ----------
    source : path
        A .mat, .wav or .csv file.
    channels : sequence of str
        Names of the vibration channels in the file; a field of a struct by its path, ``bearing.gs``.
    units : str or mapping of str to str
        Units of the channels after `scale`.
    rate_hz : float, optional
        Samples per second; only a .wav file states its own.
    tach_times, tach_waveform : str, optional
        Name of the pulse times in s, or of the sampled tachometer signal.
    pulses_per_rev : int, optional
        Pulses in one revolution of `shaft`; needed with either tachometer.
    shaft : str
        The shaft that carries the tachometer or turns at `shaft_rpm`.
    shaft_rpm : float, optional
        Declared constant speed in rev/min.
    scale : float
        Factor from the numbers in the file to `units`; for a .wav of integers, what full scale means.
    machine, recorded_at
        As in `make_record`.

    Returns
    -------
    xarray.Dataset
        A record; attribute ``source`` names the file.
    """
    file = read_file(source)
    if not channels:
        raise RecordError(f"channels: none named (--channel). {file.path.name}: {file.contents()}")
    factor = _scale(scale)
    values = {name: _scaled(file.vector(name), factor) for name in channels}
    rate = _rate_hz(file, rate_hz)
    _refuse_other_clock(file, rate, count=values[channels[0]].size, other_than=(*channels, tach_times, tach_waveform))
    return make_record(
        values,
        rate_hz=rate,
        units=units,
        angle=_angle(
            file,
            tach_times=tach_times,
            tach_waveform=tach_waveform,
            pulses_per_rev=pulses_per_rev,
            shaft=shaft,
            shaft_rpm=shaft_rpm,
        ),
        machine=machine,
        recorded_at=recorded_at,
        attrs={"source": file.path.name},
    )


def _angle(
    file: ForeignFile,
    *,
    tach_times: str | None,
    tach_waveform: str | None,
    pulses_per_rev: int | None,
    shaft: str | None,
    shaft_rpm: float | None,
) -> Angle | None:
    options = {"--tach-times": tach_times, "--tach-waveform": tach_waveform, "--shaft-rpm": shaft_rpm}
    given = [option for option, value in options.items() if value is not None]
    if not given:
        return None  # make_record says which three ways there are
    if len(given) > 1:
        raise RecordError(f"{' and '.join(given)}: one thing tells the angle of the shaft; give one of them.")
    if not shaft:
        raise RecordError(f'{given[0]} needs the shaft it belongs to: shaft="..." (--shaft).')
    if shaft_rpm is not None:
        if pulses_per_rev is not None:
            raise RecordError("--pulses-per-rev has no meaning with --shaft-rpm; leave one of them out.")
        return NominalSpeed(rpm=shaft_rpm, shaft=shaft)
    if pulses_per_rev is None:
        raise RecordError(
            f'{given[0]} needs the pulses in one revolution of "{shaft}": pulses_per_rev=... (--pulses-per-rev).'
        )
    if tach_times is not None:
        times_s = _unpadded(file.vector(tach_times))
        return PulseTimes(times_s=times_s, shaft=shaft, pulses_per_rev=pulses_per_rev)
    values = file.vector(str(tach_waveform))
    return TachometerWaveform(values=values, shaft=shaft, pulses_per_rev=pulses_per_rev)


def _rate_hz(file: ForeignFile, declared: float | None) -> float:
    """Return the declared rate or the file's; a header of whole numbers may have dropped a fraction."""
    if declared is None:
        if file.rate_hz is None:
            raise RecordError(
                f"{file.path.name} does not state its samples per second: rate_hz=... (--rate-hz) is needed."
            )
        return file.rate_hz
    if file.rate_hz is not None and isinstance(declared, Real) and abs(declared - file.rate_hz) >= 1:
        raise RecordError(
            f"rate_hz={declared:g} contradicts {file.path.name}, which states {file.rate_hz:g} Hz; leave "
            "--rate-hz out, or correct the file."
        )
    return declared


def _refuse_other_clock(file: ForeignFile, rate_hz: float, *, count: int, other_than: Sequence[str | None]) -> None:
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


def _scale(scale: float) -> float:
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not math.isfinite(scale) or scale == 0:
        raise RecordError(f"scale={scale!r}: a finite number other than zero is needed (--scale).")
    return float(scale)


def _scaled(values: NDArray[np.generic], factor: float) -> NDArray[np.generic]:
    return values if factor == 1 else np.multiply(values, factor)


def _unpadded(times_s: NDArray[np.generic]) -> NDArray[np.generic]:
    """Cut the blanks at the end, with which a table fills a column that is shorter than its neighbours."""
    if times_s.dtype.kind != "f":
        return times_s
    filled = np.flatnonzero(~np.isnan(times_s))
    return times_s[: filled[-1] + 1] if filled.size else times_s


def _is_array(field: NDArray[np.generic] | str) -> bool:
    return not isinstance(field, str)


def _shape(field: NDArray[np.generic] | str) -> str:
    return field if isinstance(field, str) else " x ".join(map(str, field.shape)) or "1"


def _closest(name: str, names: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name, list(names), n=1)
    return f'; did you mean "{near[0]}"?' if near else "."
