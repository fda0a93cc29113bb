"""Contents of another program's file: arrays, and the units, rates and times that the file states."""

import difflib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from hums.records.fields import is_utf8
from hums.records.record import UNITS, RecordError

__all__ = ["Field", "ForeignFile", "Stated", "canonical_units", "rate_of_step"]

Field = NDArray[np.generic] | str
"""An array of numbers, or a phrase that describes what is not numeric, such as "text"."""

_MOST_LISTED = 12  # names in a message
_LONGEST_NAME = 60
_INTEGER_TOLERANCE = 1e-9  # one over a step of ten microseconds is 99999.99999999999 Hz


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
    began : datetime or None
        Time from which `start_s` counts, with its offset from UTC.
    title : str or None
        Name as the file prints it, where that holds the units, too.
    """

    units: str | None = None
    rate_hz: float | None = None
    start_s: float | None = None
    epoch: datetime | None = None
    title: str | None = None


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
    rate_hz : float or None
        Samples per second, where the file states them for all fields.
    stated : mapping of str to Stated
        Metadata of single fields.
    """

    path: Path
    fields: Mapping[str, Field]
    rate_hz: float | None = None
    stated: Mapping[str, Stated] = field(default_factory=lambda: MappingProxyType({}))

    def name(self, name: str) -> str:
        """Return the key in `fields` of a name: as printed, with slashes for dots, or a channel or column by number."""
        if titled := next((key for key, stated in self.stated.items() if stated.title == name), None):
            return titled
        numbered = (f"{kind} {name}" for kind in ("channel", "column"))
        if name not in self.fields and (found := next((key for key in numbered if key in self.fields), None)):
            return found
        return name if name in self.fields else name.strip("/").replace("/", ".")

    def metadata(self, name: str) -> Stated:
        """Return the metadata of a field, with the rate of the file where it has none of its own."""
        own = self.stated.get(self.name(name), Stated())
        return own if own.rate_hz is not None else replace(own, rate_hz=self.rate_hz)

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
    return float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) <= _INTEGER_TOLERANCE * rate_hz else rate_hz


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "1"


def _listed(names: list[str]) -> str:
    """Return the first names in a row, each as a terminal shows it."""
    shown = [
        name.encode("unicode_escape", "backslashreplace").decode() if not name.isprintable() else name for name in names
    ]
    row = ", ".join(name[:_LONGEST_NAME] for name in shown[:_MOST_LISTED])
    return f"{row} and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else row


def _closest(name: str, names: Mapping[str, object]) -> str:
    matches = difflib.get_close_matches(name, list(names), n=1)
    return f'; did you mean "{matches[0]}"?' if matches else "."
