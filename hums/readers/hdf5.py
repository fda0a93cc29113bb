"""HDF5 files of other programs: every array under its path, with the units of its attribute."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import ArraysOnDisk, Field, Stated, dotted
from hums.records.record import SCHEMA, RecordError
from hums.records.store import is_array, objects, open_hdf5, read_array

__all__ = ["read"]


def read(path: Path, *, most_bytes: int | None = None) -> tuple[Mapping[str, Field], dict[str, Stated]]:
    """Return every array under its path, with dots for slashes, and the units of its attribute ``units``.

    An array is read when it is asked for.

    Raises
    ------
    RecordError
        If it is damaged, no HDF5 file, a record already, or reaches into other files.
    """
    with open_hdf5(path) as contents:
        try:
            schema = contents.attrs.get("schema")
            arrays = [] if schema == SCHEMA else [where for where, item in objects(contents) if is_array(item)]
            found = {dotted(where): where for where in arrays}
            described = {name: _described(contents[where]) for name, where in found.items()}
            stated = {name: _units(contents[where]) for name, where in found.items()}
        except RecordError:
            raise
        except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
            raise RecordError(f"{path} is damaged ({error}). Copy it again from where it came.") from error
    if schema == SCHEMA:
        raise RecordError(f"{path} is a record already: open it with open_record, or hums analyze.")

    def values(name: str) -> NDArray[np.generic]:
        read_values = np.asarray(read_array(path, found[name], most_bytes=most_bytes))
        return read_values if read_values.shape else read_values.reshape(1)

    return ArraysOnDisk(described, values), stated


def _described(item: Any) -> tuple[int, ...] | str:  # noqa: ANN401
    if item.shape is None or item.size == 0:
        return "empty"
    if item.dtype.names:
        return "a table with named columns"
    if item.dtype.kind not in "biuf":
        return {"O": "text", "S": "text", "c": "complex numbers"}.get(item.dtype.kind, f"of type {item.dtype}")
    return tuple(item.shape) or (1,)


def _units(item: Any) -> Stated:  # noqa: ANN401
    units = item.attrs.get("units")
    text = units.decode(errors="replace") if isinstance(units, bytes) else units
    return Stated(units=text.strip() or None if isinstance(text, str) else None)
