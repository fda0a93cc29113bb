"""HDF5 files of other programs: every array under its path, with the units of its attribute."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hums.readers.columns import Field, Stated
from hums.records.record import SCHEMA, RecordError
from hums.records.store import open_hdf5

__all__ = ["read"]


def read(path: Path) -> tuple[dict[str, Field], dict[str, Stated]]:
    """Return every array under its path, with dots for slashes, and the units of its attribute ``units``.

    Raises
    ------
    RecordError
        If it is damaged, no HDF5 file, or a record already.
    """
    with open_hdf5(path) as contents:
        try:
            schema = contents.attrs.get("schema")
            found = [] if schema == SCHEMA else list(_arrays("", contents))
            fields = {name: _field(item) for name, item in found}
            stated = {name: _units(item) for name, item in found}
        except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
            raise RecordError(f"{path} is damaged ({error}). Copy it again from where it came.") from error
    if schema == SCHEMA:
        raise RecordError(f"{path} is a record already: open it with open_record, or hums analyze.")
    return fields, stated


def _arrays(prefix: str, group: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    for key, item in group.items():
        if hasattr(item, "items"):
            yield from _arrays(f"{prefix}{key}.", item)
        elif hasattr(item, "shape"):  # unlike a named type
            yield f"{prefix}{key}", item


def _field(item: Any) -> Field:  # noqa: ANN401
    if item.shape is None or item.size == 0:
        return "empty"
    if item.dtype.names:
        return "a table with named columns"
    if item.dtype.kind not in "biuf":
        return {"O": "text", "S": "text", "c": "complex numbers"}.get(item.dtype.kind, f"of type {item.dtype}")
    field: Field = item[()] if item.shape else item[()].reshape(1)
    return field


def _units(item: Any) -> Stated:  # noqa: ANN401
    units = item.attrs.get("units")
    text = units.decode(errors="replace") if isinstance(units, bytes) else units
    return Stated(units=text.strip() or None if isinstance(text, str) else None)
