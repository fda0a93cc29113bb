"""Universal files (UFF): the time histories among their data sets of type 58."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hums.readers.foreign import Field, Stated, rate_of_step
from hums.record import RecordError

__all__ = ["read"]

_FUNCTION = 58
_TIME_RESPONSE = 1
_TIME = 17  # specific data type of an abscissa in seconds
_DIRECTIONS = ("", "+X", "+Y", "+Z", "+RX", "+RY", "+RZ")
_END = b"-1"


def read(path: Path) -> tuple[dict[str, Field], dict[str, Stated]]:
    """Read every function under its response's place: entity where named, node and direction, as "case 3+Z".

    Where two have one place, the number of the data set follows, as "3+Z (2)". The rate and the first time are those
    of an even abscissa in seconds; a text file prints its step with six digits, so a declared rate may be finer.
    Units are the label of the ordinate.

    Raises
    ------
    RecordError
        If pyuff is not installed, or the file is no universal file or cut off.
    """
    try:
        import pyuff  # noqa: PLC0415
    except ImportError as error:
        raise RecordError(
            f'{path}: universal files are read with pyuff, which is not installed: pip install "hums-toolkit[readers]".'
        ) from error
    try:
        found = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # a parser of foreign text fails on broken bytes in any way it likes
        raise RecordError(
            f"{path} is no universal file, or damaged ({error}). Copy it again from where it came."
        ) from error
    sets = [entry for entry in (found if isinstance(found, list) else [found]) if entry]
    if not sets:
        raise RecordError(f"{path} is no whole universal file: no data set in it is complete.")
    functions = [entry for entry in sets if entry.get("type") == _FUNCTION]
    if not _ends_well(path) or any(entry["num_pts"] != len(entry["data"]) for entry in functions):
        raise RecordError(f"{path} is damaged: its last part is cut off. Copy it again from where it came.")
    names = _names(functions)
    return (
        {name: _field(entry) for name, entry in zip(names, functions, strict=True)},
        {name: _stated(entry) for name, entry in zip(names, functions, strict=True)},
    )


def _ends_well(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-min(path.stat().st_size, 4096), 2)
        return stream.read().rstrip().endswith(_END)


def _names(functions: list[Mapping[str, Any]]) -> list[str]:
    places = [_place(entry) for entry in functions]
    times = Counter(places)
    return [place if times[place] == 1 else f"{place} ({number})" for number, place in enumerate(places, start=1)]


def _place(entry: Mapping[str, Any]) -> str:
    """Return entity, node and direction; a direction is a number from 1 to 6, negative against its axis."""
    direction = int(entry["rsp_dir"])
    way = _DIRECTIONS[abs(direction)] if abs(direction) < len(_DIRECTIONS) else f" direction {direction}"
    entity = _label(entry["rsp_ent_name"])
    place = f"{int(entry['rsp_node'])}{way.replace('+', '-') if direction < 0 else way}"
    return f"{entity} {place}".replace("/", ".") if entity else place


def _field(entry: Mapping[str, Any]) -> Field:
    values = np.asarray(entry["data"])
    if entry["func_type"] != _TIME_RESPONSE or values.dtype.kind == "c":
        return f"a function of type {entry['func_type']}, no time history"
    return values if values.size else "empty"


def _stated(entry: Mapping[str, Any]) -> Stated:
    even_time = entry["abscissa_spacing"] == 1 and entry["abscissa_spec_data_type"] == _TIME
    rate_hz = rate_of_step(entry["abscissa_inc"]) if even_time else None
    return Stated(
        units=_label(entry["ordinate_axis_units_lab"]),
        rate_hz=rate_hz,
        start_s=float(entry["abscissa_min"]) if rate_hz else None,
    )


def _label(text: object) -> str | None:
    """Return a label, or None for the word that stands where there is none."""
    words = str(text).strip()
    return None if words.upper() in {"", "NONE"} else words
