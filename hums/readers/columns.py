"""Contents of another program's file: arrays, and the units, rates and times that the file states."""

import difflib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime, tzinfo
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zoneinfo import ZoneInfo, available_timezones

import numpy as np
from numpy.typing import NDArray

from hums.records.clock import TIMES_S, time_scale, words_of
from hums.records.fields import UNITS, RecordError, is_utf8
from signals._validation import brief, nearest, plain_text

Field = NDArray[np.generic] | str
"""An array of numbers, or a phrase that describes what is not numeric, such as "text"."""


class ArraysOnDisk(Mapping[str, Field]):
    """Fields by name, of which an array is read when it is asked for, and kept.

    Parameters
    ----------
    described : mapping of str to tuple of int or str
        By name, the shape of an array, or a phrase that describes what is not numeric.
    read : callable
        Returns the array of a name.
    """

    def __init__(
        self, described: Mapping[str, tuple[int, ...] | str], read: Callable[[str], NDArray[np.generic]]
    ) -> None:
        self.described, self._read = described, lru_cache(maxsize=None)(read)

    def __getitem__(self, name: str) -> Field:
        """Return the array, or the phrase."""
        found = self.described[name]
        return found if isinstance(found, str) else self._read(name)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self.described)

    def __len__(self) -> int:
        """Return the number of fields."""
        return len(self.described)


@contextmanager
def parsing(path: Path, kind: str, package: str = "") -> Iterator[None]:
    """Turn whatever a parser raises on damaged bytes, or for lack of its package, into a sentence."""
    try:
        yield
    except (RecordError, MemoryError):
        raise
    except ImportError as error:
        raise RecordError(
            f"{path}: a {kind} is read with {package or error.name}, which is not installed: "
            'pip install "hums-toolkit[readers]".'
        ) from error
    except Exception as error:
        raise RecordError(f"{path} is no {kind}, or damaged ({error}). Copy or export it again.") from error


def dotted(where: str) -> str:
    """Return the name of an array from its place in an HDF5 file."""
    return where.strip("/").replace("/", ".")


def descriptions(fields: Mapping[str, Field]) -> Mapping[str, tuple[int, ...] | str]:
    """Return the shape of each array, or the phrase, without reading what is on disk."""
    if isinstance(fields, ArraysOnDisk):
        return fields.described
    return {name: value if isinstance(value, str) else value.shape for name, value in fields.items()}


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Metadata of one channel as the file states them; None where it states nothing.

    Attributes
    ----------
    units : str or None
        In the spelling of the file.
    rate_hz : float or None
        Samples per second.
    start_s : float or None
        Time of the first sample in s after `epoch`.
    epoch : datetime or None
        Time from which `start_s` and `times_s` count; without an offset from UTC it is a local time.
    times_s : (n,) array or None
        Time of each sample, where the file states more than a rate.
    title : str or None
        Name as the file prints it, where that holds the units, too.
    pulses_per_rev : float or None
        Of a tachometer.
    delay_s : float or None
        Delay of the channel, in s.
    sensitivity : float or None
        Output of the sensor in V for one unit of `measures`.
    measures : str or None
        Units of the measured quantity.
    notes : tuple of str
        What a user has to know of the channel, as "states gain=10, which is not applied".
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
        """Return these metadata, with those of what contains the channel where it has none of its own."""
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
        "bearing.gs", also where the file has slashes.
    stated : mapping of str to Stated
        Metadata of fields, of what contains them ("bearing" of "bearing.gs"), and under "" of the whole file.
    text_format : mapping of str to str or int
        Separator, decimal sign, encoding and header lines of a text file, as recognised or declared.
    """

    path: Path
    fields: Mapping[str, Field]
    stated: Mapping[str, Stated] = field(default_factory=lambda: MappingProxyType({}))
    text_format: Mapping[str, str | int] = field(default_factory=lambda: MappingProxyType({}))

    def name(self, name: str) -> str:
        """Return the key in `fields` of a name: as printed, with slashes for dots, or a channel or column by number."""
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
        """Return the name of a field in a record: what was asked for where that is the end of a longer name."""
        asked, key = name.strip("/").replace("/", "."), self.name(name)
        of_container = self.stated.get(key.rpartition(".")[0], Stated()).title == name
        return asked if of_container or key.endswith(f".{asked}") else key.replace("/", ".")

    def metadata(self, name: str) -> Stated:
        """Return the metadata of a field, with those of its containers where it has none of its own."""
        key = self.name(name)
        found = self.stated.get(key, Stated())
        while key:
            key = key.rpartition(".")[0]
            found = found.over(self.stated.get(key, Stated()))
        return found

    def time_scale(self, name: str) -> tuple[float, datetime | None] | None:
        """Return the seconds in the unit of a field of times and its epoch, by its units or a word of its name."""
        stated = self.stated.get(self.name(name), Stated())
        if (scale := time_scale(stated.units)) is not None:
            return scale[0], stated.epoch or scale[1]
        units = (time_scale(word) for word in words_of(stated.title or name)[1:])
        return next((scale for scale in units if scale is not None), None)

    def vector(self, name: str) -> NDArray[np.generic]:
        """Return a field that is a row or a column of numbers as an array (n,)."""
        values = self.fields.get(self.name(name))
        if values is None:
            raise RecordError(f'{self.path.name} has no "{name}"{_closest(name, self.fields)} {self.contents()}')
        if isinstance(values, str):
            raise RecordError(f'{self.path.name}: "{name}" is {values}, not numbers. {self.contents()}')
        if values.size == 0:
            raise RecordError(f'{self.path.name}: "{name}" is empty; at least one sample is needed. {self.contents()}')
        if not is_utf8(self.name(name)):
            raise RecordError(
                f'{self.path.name}: the name "{name}" in it is not UTF-8 text; save the file with names in UTF-8.'
            )
        if values.size != max(values.shape, default=1):
            raise RecordError(
                f'{self.path.name}: "{name}" is a table of {_shape(values.shape)} values; a channel is one row or one '
                "column: save each under a name of its own."
            )
        return values.reshape(-1)

    def contents(self) -> str:
        """Return a description of the contents: a sentence for arrays and one for the rest."""
        found = descriptions(self.fields)
        arrays = [f"{name} ({_shape(shape)})" for name, shape in found.items() if not isinstance(shape, str)]
        others = [f"{name} ({phrase})" for name, phrase in found.items() if isinstance(phrase, str)]
        rest = f" Not numbers: {_listed(others)}." if others else ""
        return f"It holds {_listed(arrays) or 'no array of numbers'}.{rest}"


def canonical_units(units: str) -> str | None:
    """Return units in the spelling of `UNITS`, None for unknown ones."""
    return next((name for name, aliases in UNITS.items() if units in (name, *aliases)), None)


def rate_of_step(step_s: object) -> float | None:
    """Return samples per second from the time step, rounded to an integer within 1e-9; None for an invalid step."""
    if isinstance(step_s, bool) or not isinstance(step_s, int | float | np.number) or not 0 < float(step_s) < np.inf:
        return None
    rate_hz = 1 / float(step_s)
    # one over a step of ten microseconds is 99999.99999999999 Hz
    return float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) <= 1e-9 * rate_hz else rate_hz


def joined(parts: Sequence[tuple[int, Stated]]) -> Stated:
    """Return what successive segments of a channel state together, of which each has a number of samples.

    Several segments state the time of each sample, after the epoch of the first.
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
        raise RecordError(f'time_zone="{name}": a name as "Europe/Berlin" or "+01:00" is needed.{likely}') from None


def in_zone(moment: datetime, name: str) -> datetime:
    """Return a local time with its offset from UTC; raise RecordError where the clocks change: it has two or none."""
    first, second = (moment.replace(tzinfo=zone_of(name), fold=fold) for fold in (0, 1))
    if first.utcoffset() != second.utcoffset():
        raise RecordError(
            f'{moment.isoformat()} has two offsets from UTC or none in time_zone="{name}", where clocks change then; '
            'state the offset instead, as "+01:00".'
        )
    return first


def located(file: ForeignFile, zone: str | None) -> ForeignFile:
    """Return a file with its local times in a time zone; without one they are not known."""
    epochs = {name: one.epoch for name, one in file.stated.items() if one.epoch is not None}
    local = {name: epoch for name, epoch in epochs.items() if epoch.tzinfo is None}
    known = {name: in_zone(epoch, zone) if zone else None for name, epoch in local.items()}
    stated = {name: replace(file.stated[name], epoch=epoch) for name, epoch in known.items()}
    for name in () if zone else local:
        note = f"states the local time {local[name].isoformat()}, which is not read without time_zone"
        stated[name] = replace(stated[name], notes=(*stated[name].notes, note))
    return replace(file, stated={**file.stated, **stated})


# ---- what attributes, properties, scalars beside an array and lines above a table state --------------------------

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
"""Samples per second in units of rates, in lower case."""


def stated_of(attributes: Mapping[str, object]) -> Stated:
    """Return what named values state about a channel; notes name those that have a meaning and are not applied."""
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
    if sensitivity is not None and canonical_units(measured) and output in volts:
        found |= {"sensitivity": sensitivity * volts[output], "measures": measured}
    elif sensitivity is not None:
        unread.append(f"sensitivity={sensitivity:g} {measures}".strip())
    step_s, _ = found.pop("step_s", None), found.pop("unread", None)
    notes = tuple(f"states {text}, which is not applied" for text in unread)
    return Stated(**{"rate_hz": rate_of_step(step_s)} | found, notes=notes)


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a value as Python has it; None for nothing, and for a time stamp of TDMS that was not set."""
    value = value.as_datetime64("us") if hasattr(value, "as_datetime64") else value
    if isinstance(value, np.datetime64):
        return moment_of(f"{value.astype('datetime64[us]')}Z")
    value = value.item() if isinstance(value, np.generic) else value
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    return value.strip() or None if isinstance(value, str) else value


def _value(name: str, value: Any, unit: Any) -> Any:  # noqa: ANN401
    """Return the value of one statement: text, a moment or a number in SI units; None where it is none."""
    if name == "epoch" and isinstance(value, str | datetime):
        return moment_of(value) if isinstance(value, str) else value
    if name in {"units", "title", "measures", "epoch"}:
        return value if isinstance(value, str) else None
    factors = _RATES_HZ if name == "rate_hz" else TIMES_S if name in {"step_s", "start_s", "delay_s"} else {}
    unit = unit if factors else None
    if isinstance(value, str):
        printed = re.fullmatch(r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*([^\d\s].*)?", value)
        if printed is None or re.fullmatch(r"[-+]?[1-9]\d{0,2}[.,]\d{3}", printed[1]):  # "25,600": of thousands or not
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
    """Return a date with its time of day; None for other text, and for 1904, where LabVIEW set no time."""
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
    """Return the first names in a row, each as a terminal shows it."""
    most_listed = 12  # names in a message
    row = ", ".join(plain_text(name)[:60] for name in names[:most_listed])
    return f"{row} and {len(names) - most_listed} more" if len(names) > most_listed else row


def _closest(name: str, names: Mapping[str, object]) -> str:
    matches = difflib.get_close_matches(name, list(names), n=1)
    return f'; did you mean "{matches[0]}"?' if matches else "."
