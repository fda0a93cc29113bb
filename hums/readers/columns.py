"""Contents of another program's file: arrays, and the units, rates and times that the file states."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zoneinfo import ZoneInfo, available_timezones

import numpy as np
from numpy.typing import NDArray

from hums.records.clock import TIMES_S, time_scale, words_of
from hums.records.fields import CANONICAL_UNITS, RecordError, is_utf8
from signals._validation import brief, nearest, plain_text

Field = NDArray[np.generic] | str
"""An array of numbers, or a phrase that describes what is not numeric, such as "text"."""


@dataclass(eq=False)
class ArraysOnDisk(Mapping[str, Field]):
    """Fields by name, whose arrays are read on access.

    Attributes
    ----------
    path, kind : Path and str
        The file, and what it should be, for errors.
    described : mapping of str to tuple of int or str
        By name, the shape of an array, or a phrase that describes what is not numeric.
    read : callable
        Returns the array of a name; cached, so that it is read once.
    """

    path: Path
    kind: str
    described: Mapping[str, tuple[int, ...] | str]
    read: Callable[[str], NDArray[np.generic]]

    def __getitem__(self, name: str) -> Field:
        """Return the array, or the phrase."""
        found = self.described[name]
        if isinstance(found, str):
            return found
        with parsing(self.path, self.kind):
            return self.read(name)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self.described)

    def __len__(self) -> int:
        """Return the number of fields."""
        return len(self.described)


@contextmanager
def parsing(path: Path, kind: str, package: str = "") -> Iterator[None]:
    """Turn any exception of a parser, on damaged bytes or for lack of its package, into a `RecordError`."""
    try:
        yield
    except (RecordError, MemoryError):
        raise
    except ImportError as error:
        raise RecordError(
            f"{path}: reading {kind} requires {package or error.name}, which is not installed: "
            'pip install "hums-toolkit[readers]".'
        ) from error
    except Exception as error:
        why = " ".join(str(error).split())
        raise RecordError(f"{path} is not {kind}, or is damaged ({why}). Copy or export it again.") from error


def dotted(where: str) -> str:
    """Return the name of an array from its path in an HDF5 file."""
    return where.strip("/").replace("/", ".")


def descriptions(fields: Mapping[str, Field]) -> Mapping[str, tuple[int, ...] | str]:
    """Return the shape of each array, or its phrase, without reading arrays from disk."""
    if isinstance(fields, ArraysOnDisk):
        return fields.described
    return {name: value if isinstance(value, str) else value.shape for name, value in fields.items()}


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Metadata of one channel as the file states them; None for what it does not state.

    Attributes
    ----------
    units : str or None
        Units as spelled in the file.
    rate_hz : float or None
        Sampling rate in Hz.
    start_s : float or None
        Time of the first sample in s after `epoch`.
    epoch : datetime or None
        Origin of `start_s` and `times_s`; a local time if it has no UTC offset.
    times_s : (n,) array or None
        Time of each sample in s, if the file states more than a rate.
    title : str or None
        Name as printed in the file, if it includes the units.
    pulses_per_rev : float or None
        Pulses per revolution of a tachometer.
    delay_s : float or None
        Delay of the channel in s.
    sensitivity : float or None
        Output of the sensor in V per unit of `measures`.
    measures : str or None
        Units of the measured quantity.
    notes : tuple of str
        Remarks for the user, such as "states gain=10, which is not applied".
    """

    units: str | None = None
    rate_hz: float | None = None
    start_s: float | None = None
    epoch: datetime | None = None
    times_s: NDArray[np.float64] | None = None
    title: str | None = None
    pulses_per_rev: float | None = None
    delay_s: float | None = None
    sensitivity: float | None = None
    measures: str | None = None
    notes: tuple[str, ...] = ()

    def over(self, general: "Stated") -> "Stated":
        """Return these metadata, completed by those of the container of the channel."""
        own = {one.name: value for one in fields(self) if (value := getattr(self, one.name)) is not None}
        return replace(general, **own | {"notes": self.notes + general.notes})


@dataclass(frozen=True, kw_only=True)
class ForeignFile:
    """Contents of another program's file.

    Attributes
    ----------
    path : Path
        The file.
    fields : mapping of str to array or str
        By name, an array of numbers, or a phrase such as "text". Parts of a name are joined by dots, as in
        "bearing.gs", even if the file uses slashes.
    stated : mapping of str to Stated
        Metadata of fields, of their containers ("bearing" for "bearing.gs"), and under "" of the whole file.
    text_format : mapping of str to str or int
        Separator, decimal sign, encoding and header lines of a text file, as detected or declared.
    """

    path: Path
    fields: Mapping[str, Field]
    stated: Mapping[str, Stated] = field(default_factory=lambda: MappingProxyType({}))
    text_format: Mapping[str, str | int] = field(default_factory=lambda: MappingProxyType({}))

    def name(self, name: str) -> str:
        """Return the key in `fields` for a name as printed, with slashes for dots, or a channel or column number."""
        titled = {key for key, stated in self.stated.items() if stated.title == name}
        arrays = [key for key, shape in descriptions(self.fields).items() if not isinstance(shape, str)]
        found = [key for key in arrays if key in titled or key.rpartition(".")[0] in titled - {""}]
        if len(found) == 1 or name in self.fields:
            return found[0] if len(found) == 1 else name
        asked = name.strip("/").replace("/", ".")
        ends = [key for key in self.fields if key.endswith(f".{asked}")]
        numbered = [key for kind in ("channel", "column") if (key := f"{kind} {name}") in self.fields]
        if asked in self.fields or not (numbered or len(ends) == 1):
            return asked
        return (numbered or ends)[0]

    def label(self, name: str) -> str:
        """Return the name of a field in a record: the requested one if that is the end of a longer name."""
        asked, key = name.strip("/").replace("/", "."), self.name(name)
        of_container = self.stated.get(key.rpartition(".")[0], Stated()).title == name
        return asked if of_container or key.endswith(f".{asked}") else key.replace("/", ".")

    def metadata(self, name: str) -> Stated:
        """Return the metadata of a field, completed by those of its containers."""
        key = self.name(name)
        found = self.stated.get(key, Stated())
        while key:
            key = key.rpartition(".")[0]
            found = found.over(self.stated.get(key, Stated()))
        return found

    def time_scale(self, name: str) -> tuple[float, datetime | None] | None:
        """Return the unit of a field of times in s and its epoch, from its units or a word in its name."""
        stated = self.stated.get(self.name(name), Stated())
        if (scale := time_scale(stated.units)) is not None:
            return scale[0], stated.epoch or scale[1]
        units = (time_scale(word) for word in words_of(stated.title or name)[1:])
        return next((scale for scale in units if scale is not None), None)

    def vector(self, name: str) -> NDArray[np.generic]:
        """Return a numeric row or column as an array (n,)."""
        values = self.fields.get(self.name(name))
        if values is None:
            likely = nearest(name, list(self.fields))
            raise RecordError(f'{self.path.name} has no "{name}".{likely} {self.contents()}')
        if isinstance(values, str):
            raise RecordError(f'{self.path.name}: "{name}" is {values}, not numbers. {self.contents()}')
        if values.size == 0:
            raise RecordError(f'{self.path.name}: "{name}" is empty; at least one sample is needed. {self.contents()}')
        if not is_utf8(self.name(name)):
            raise RecordError(
                f'{self.path.name}: its field name "{name}" is not UTF-8 text; save the file with names in UTF-8.'
            )
        if values.size != max(values.shape, default=1):
            raise RecordError(
                f'{self.path.name}: "{name}" is a table of {_shape(values.shape)} values; a channel is one row or one '
                "column: save each under its own name."
            )
        return values.reshape(-1)

    def contents(self) -> str:
        """Return a description of the contents: a sentence on the arrays and one on the rest."""
        found = descriptions(self.fields)
        arrays = [f"{name} ({_shape(shape)})" for name, shape in found.items() if not isinstance(shape, str)]
        others = [f"{name} ({phrase})" for name, phrase in found.items() if isinstance(phrase, str)]
        rest = f" Not numbers: {_listed(others)}." if others else ""
        return f"It holds {_listed(arrays) or 'no array of numbers'}.{rest}"


def phrase_of(dtype: np.dtype[Any], size: int) -> str:
    """Return a description of an array that holds no numbers, an empty one for others."""
    if not size or dtype.names:
        return "a table with named columns" if size else "empty"
    words = {"O": "text", "S": "text", "U": "text", "M": "times of day", "c": "complex numbers"}
    return "" if dtype.kind in "biuf" else words.get(dtype.kind, f"of type {dtype}")


def rate_of_step(step_s: object) -> float | None:
    """Return the sampling rate in Hz from a time step in s, rounded to an integer within 1e-9; None if invalid."""
    if isinstance(step_s, bool) or not isinstance(step_s, int | float | np.number) or not 0 < float(step_s) < np.inf:
        return None
    rate_hz = 1 / float(step_s)
    # the reciprocal of ten microseconds is 99999.99999999999 Hz
    return float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) <= 1e-9 * rate_hz else rate_hz


def joined(parts: Sequence[tuple[int, Stated]]) -> Stated:
    """Return the metadata of a channel from those of its successive segments, each with its number of samples.

    Several segments give the time of each sample after the epoch of the first.
    """
    _, first = parts[0]
    if len(parts) == 1 or first.rate_hz is None:
        return first
    times_s = []
    for count, own in parts:
        late_s = 0.0 if first.epoch is None or own.epoch is None else (own.epoch - first.epoch).total_seconds()
        even_s = (own.start_s or 0.0) + np.arange(count) / (own.rate_hz or np.nan)
        times_s.append(late_s + (even_s if own.times_s is None else own.times_s))
    return replace(first, times_s=np.concatenate(times_s))


# ---- time zones ------------------------------------------------------------------------------------------------------


def zone_of(name: str) -> tzinfo:
    """Return a time zone by its name, "Europe/Berlin", or its offset from UTC, "+01:00"."""
    try:
        if (offset := datetime.fromisoformat(f"2000-01-01T00:00:00{name}").tzinfo) is not None:
            return offset
    except ValueError:
        pass
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        likely = nearest(name, sorted(available_timezones()))
        raise RecordError(f'time_zone="{name}" is not a name such as "Europe/Berlin" or "+01:00".{likely}') from None


def in_zone(moment: datetime, name: str | None) -> datetime:
    """Return a local time with its UTC offset, if a zone is named and the time has none.

    Raises
    ------
    RecordError
        If a clock change makes it ambiguous or impossible.
    """
    if moment.tzinfo is not None or not name:
        return moment
    first, second = (moment.replace(tzinfo=zone_of(name), fold=fold) for fold in (0, 1))
    if first.utcoffset() != second.utcoffset():
        raise RecordError(
            f'{moment.isoformat()} has two UTC offsets or none in time_zone="{name}", where clocks change then; '
            'state the offset instead, such as "+01:00".'
        )
    return first


def located(file: ForeignFile, zone: str | None) -> ForeignFile:
    """Return a file with its local times in a time zone; without one, they are dropped with a note."""
    stated = dict(file.stated)
    for name, one in file.stated.items():
        epoch = None if one.epoch is None else in_zone(one.epoch, zone)
        if epoch is not None and epoch.tzinfo is None:
            note = f"states the local time {epoch.isoformat()}, which is ignored without time_zone"
            epoch, one = None, replace(one, notes=(*one.notes, note))  # noqa: PLW2901
        stated[name] = replace(one, epoch=epoch)
    return replace(file, stated=stated)


# ---- metadata in attributes, properties, scalars and lines above a table ------------------------------------------

_NAMES = {
    name: re.compile(pattern)
    for name, pattern in {
        "rate_hz": r"fs|sr|sfreq|fsamp|fsample|samplespersecond|"
        r"(sampl\w*|acq\w*|scan|daq|digiti[sz]er|adc|abtast)(rate|freq|frequency|frequenz|clock)",
        "step_s": r"dt|ts|deltat|deltax|wfincrement|xincrement|(sampl\w*|time)(interval|period|step)",
        "units": "unitstring|einheit|y?units?",
        "start_s": "wfstartoffset|t0|starttime|tstart|xstart",
        "epoch": r"t0|datum|recorded(at)?|"
        r"(wf|t|rec\w*|acq\w*|meas\w*|test)?(start|begin|beginn|began|date)(date|time|at)*",
        "title": "(channel)?name",
        "pulses_per_rev": "pulsesperrev(olution)?|ppr",
        "delay_s": "delay",
        "sensitivity": "sensitivity",
        "measures": "sensitivityunits?",
        "unread": "gain|scale|factor|slope|offset|intercept|calibration(factor)?|multiplier",
    }.items()
}
_RATES_HZ = {
    f"{prefix}{unit}": factor
    for prefix, factor in (("", 1.0), ("k", 1e3), ("m", 1e6))
    for unit in ("hz", "sps", "s/s", "sa/s", "samples/s", "samples/sec")
}
"""Units of sampling rates in Hz, in lower case."""


def stated_of(attributes: Mapping[str, object]) -> Stated:
    """Return the metadata that named values state; notes list those that are recognised but not applied."""
    given = {"".join(words_of(str(key))): [str(key), _plain(value)] for key, value in attributes.items()}
    for date, time in (("date", "time"), ("datum", "zeit"), ("datum", "uhrzeit")):
        if date in given and isinstance(given.get(time, ("", None))[1], str):
            given[date][1] = f"{given[date][1]} {given[time][1]}"
    found: dict[str, Any] = {}
    unread = []
    for whole, (key, value) in given.items():
        *words, last = words_of(key) or [""]
        suffix = last if words and (last in _RATES_HZ or last in TIMES_S) else None
        unit = next((given[one][1] for one in (f"{whole}unit", f"{whole}units") if one in given), suffix)
        word = "".join([*words, "" if suffix or last == "utc" else last])
        names = [name for name, pattern in _NAMES.items() if pattern.fullmatch(word) and value is not None]
        read = {name: one for name in names if (one := _value(name, value, unit)) is not None}
        if (names and not read) or read.get("unread", 1.0) not in {0.0, 1.0}:
            unread.append(f"{key}={value:g}" if isinstance(value, int | float) else f"{key}={brief(value)}")
        if last == "utc" and "epoch" in read and read["epoch"].tzinfo is None:
            read["epoch"] = read["epoch"].replace(tzinfo=UTC)
        found = read | found
    measures, sensitivity = found.pop("measures", ""), found.pop("sensitivity", None)
    output, _, measured = (part.strip() for part in measures.partition("/"))
    volts = {"V": 1.0, "mV": 1e-3}
    if sensitivity is not None and measured in CANONICAL_UNITS and output in volts:
        found |= {"sensitivity": sensitivity * volts[output], "measures": measured}
    elif sensitivity is not None:
        unread.append(f"sensitivity={sensitivity:g} {measures}".strip())
    step_s, _ = found.pop("step_s", None), found.pop("unread", None)
    notes = tuple(f"states {text}, which is not applied" for text in unread)
    return Stated(**{"rate_hz": rate_of_step(step_s)} | found, notes=notes)


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a value as a Python object; None if empty, or a TDMS time stamp that was not set."""
    value = value.as_datetime64("us") if hasattr(value, "as_datetime64") else value
    if isinstance(value, np.datetime64):
        return moment_of(f"{value.astype('datetime64[us]')}Z")
    value = value.item() if isinstance(value, np.generic) else value
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    return value.strip() or None if isinstance(value, str) else value


def _value(name: str, value: Any, unit: Any) -> Any:  # noqa: ANN401
    """Return the value of one statement as text, time or a number in SI units; None if it is invalid."""
    if name == "epoch" and isinstance(value, str | datetime):
        return moment_of(value) if isinstance(value, str) else value
    if name in {"units", "title", "measures", "epoch"}:
        return value if isinstance(value, str) else None
    factors = _RATES_HZ if name == "rate_hz" else TIMES_S if name in {"step_s", "start_s", "delay_s"} else {}
    unit = unit if factors else None
    if isinstance(value, str):
        printed = re.fullmatch(r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*([^\d\s].*)?", value)
        if printed is None or re.fullmatch(r"[-+]?[1-9]\d{0,2}[.,]\d{3}", printed[1]):  # "25,600" is ambiguous
            return None
        value, unit = float(printed[1].replace(",", ".")), printed[2] or unit
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    number = value * (1.0 if unit is None else factors.get(str(unit).lower(), np.nan))
    most = 1.0 if name == "step_s" else np.inf  # `ts` may be a time stamp
    return (
        number
        if (-np.inf if name in {"start_s", "delay_s", "sensitivity", "unread"} else 0.0) < number < most
        else None
    )


def moment_of(text: str | None) -> datetime | None:
    """Return a date and time of day; None for other text, and for 1904, which LabVIEW writes for no time."""
    plain = (text or "").replace("/", "-")
    moments = ("%Y-%m-%d %H:%M:%S", "%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M", "%d-%b-%Y %H:%M:%S", "%d-%b-%y %H:%M:%S")
    for form in ("", *moments) if ":" in plain else ():
        with suppress(ValueError):
            found = datetime.strptime(plain, form) if form else datetime.fromisoformat(plain)  # noqa: DTZ007
            return found if found.year > 1904 else None  # noqa: PLR2004
    return None


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "1"


def _listed(names: list[str]) -> str:
    """Return the first names in a row, with control characters escaped."""
    most_listed = 12  # names in a message
    row = ", ".join(plain_text(name)[:60] for name in names[:most_listed])
    return f"{row} and {len(names) - most_listed} more" if len(names) > most_listed else row
