"""MATLAB files: v4 to v7 by scipy, v7.3 as HDF5."""

import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import ArraysOnDisk, Field, dotted
from hums.records.record import RecordError
from hums.records.store import is_array, is_hdf5, objects, open_hdf5, read_array, refuse_size

__all__ = ["read"]

_CLASSES = {
    "char": "text",
    "cell": "a cell array",
    "function_handle": "a function",
    "struct": "a struct array",
    "string": "a string object",
}
_HEADER_BYTES, _COMPRESSED = 128, 15  # of version 5: the text before the first variable; its type miCOMPRESSED
_TAG_BYTES = 1024  # of a compressed variable: more than enough for the first eight of what it unpacks to
_NUMBERS = ("", "double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))


def read(path: Path, *, most_bytes: int | None = None) -> Mapping[str, Field]:
    """Return every variable by name, the fields of structs under dotted names.

    Returns
    -------
    mapping of str to array or str
        An array in MATLAB's shape, or a phrase that describes what is not numeric.
    """
    return _read_hdf5(path, most_bytes) if is_hdf5(path) else _read_classic(path, most_bytes)


# ---- v4 to v7 ----------------------------------------------------------------------------------------------


def _read_classic(path: Path, most_bytes: int | None) -> dict[str, Field]:
    """Return every variable of a MATLAB file before version 7.3, read by scipy."""
    from scipy.io import loadmat  # noqa: PLC0415

    for declared in _packed_sizes(path):
        refuse_size(declared, f"{path}: a compressed variable", path.stat().st_size, most_bytes=most_bytes)
    try:
        contents = loadmat(path)
    except Exception as error:  # a parser may fail in any way on damaged bytes
        raise RecordError(
            f"{path} is no MATLAB file, or damaged ({error}). Copy it again, or save it again in MATLAB."
        ) from error
    return {
        name: field
        for key, value in contents.items()
        if not key.startswith("__")
        for name, field in _classic_fields(key, value)
    }


def _packed_sizes(path: Path) -> Iterator[int]:
    """Yield the bytes that each compressed variable of a version 5 to 7 file says it has."""
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        order = {b"IM": "<", b"MI": ">"}.get(header[-2:])
        while order and len(tag := stream.read(8)) == 8:  # noqa: PLR2004 - two words
            kind, count = struct.unpack(f"{order}2I", tag)
            start = stream.tell()
            if kind == _COMPRESSED:
                with suppress(zlib.error):  # scipy names what is damaged
                    inner = zlib.decompressobj().decompress(stream.read(min(count, _TAG_BYTES)), 8)
                    if len(inner) == 8:  # noqa: PLR2004
                        yield struct.unpack(f"{order}2I", inner)[1]
            stream.seek(start + count)


def _classic_fields(name: str, value: Any) -> Iterator[tuple[str, Field]]:  # noqa: ANN401
    if not isinstance(value, np.ndarray):
        yield name, "a sparse matrix" if hasattr(value, "tocsc") else "an object"
    elif value.dtype.names and value.size == 1 and value.dtype.hasobject:
        for field in value.dtype.names:
            yield from _classic_fields(f"{name}.{field}", value.reshape(-1)[0][field])
    elif value.dtype.names:
        yield name, "a struct array"
    else:
        other = {"O": "a cell array", "U": "text", "S": "text", "c": "complex numbers"}
        yield name, other.get(value.dtype.kind, "empty" if value.size == 0 else value)


# ---- v7.3 --------------------------------------------------------------------------------------------------


def _read_hdf5(path: Path, most_bytes: int | None) -> Mapping[str, Field]:
    """Return every variable of a MATLAB v7.3 file; arrays are read when they are asked for."""
    places: dict[str, str] = {}
    described: dict[str, tuple[int, ...] | str] = {}
    try:
        with open_hdf5(path) as contents:
            inside: list[str] = []  # groups whose members are no variables: sparse matrices, contents of cells
            for where, item in objects(contents):
                if any(where.startswith(f"{group}/") for group in inside):
                    continue
                name = dotted(where)
                sparse = "MATLAB_sparse" in item.attrs
                if sparse or "/#" in where:
                    inside.append(where)
                if sparse:
                    described[name] = "a sparse matrix"
                elif is_array(item) and "/#" not in where:
                    places[name], described[name] = where, _hdf5_field(item)
    except RecordError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise RecordError(f"{path} is damaged ({error}). Copy it again, or save it again in MATLAB.") from error

    def values(name: str) -> NDArray[np.generic]:
        return np.asarray(read_array(path, places[name], most_bytes=most_bytes)).T  # arrays are in column-major order

    return ArraysOnDisk(described, values)


def _hdf5_field(item: Any) -> tuple[int, ...] | str:  # noqa: ANN401
    matlab_class = item.attrs.get("MATLAB_class", b"")
    matlab_class = matlab_class.decode(errors="replace") if isinstance(matlab_class, bytes) else str(matlab_class)
    if item.shape is None or item.attrs.get("MATLAB_empty", 0) or item.size == 0:
        return "empty"
    if item.dtype.names:
        return "complex numbers"
    if matlab_class not in _NUMBERS or item.dtype.kind not in "biuf":
        return _CLASSES.get(matlab_class, "a struct array" if not matlab_class else f"a {matlab_class}")
    return tuple(item.shape[::-1])
