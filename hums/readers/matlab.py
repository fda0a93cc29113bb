"""MATLAB files: v4 to v7 by scipy, v7.3 as HDF5."""

import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import ArraysOnDisk, Field, ForeignFile, Stated, descriptions, dotted, phrase_of, stated_of
from hums.readers.description import ImportDescription
from hums.records._netcdf import objects, refuse_size
from hums.records.store import is_array, is_hdf5, open_hdf5, read_array

_CLASSES = {
    "char": "text",
    "cell": "a cell array",
    "function_handle": "a function",
    "struct": "a struct array",
    "string": "a string object",
}


def read(path: Path, spec: ImportDescription) -> ForeignFile:
    """Return every variable by name, the fields of structs under dotted names, and metadata in scalars and texts.

    An element of a struct array is "Y(3)". A scalar `fs`, `SampleRate` or `dt`, or a text `units`, applies to the
    arrays of its struct; `VariableUnits` to those that `VariableNames` lists, or to all in their order.
    """
    fields, values = (_read_hdf5 if is_hdf5(path) else _read_classic)(path, spec.most_bytes)
    scopes: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        scope, _, leaf = name.rpartition(".")
        scopes.setdefault(scope.removesuffix("Properties").removesuffix("."), {})[leaf] = value
    stated = {}
    for scope, named in scopes.items():
        stated[scope] = stated_of(named)
        units = named.get("VariableUnits", ())
        inside = [name for name in descriptions(fields) if name.rpartition(".")[0] == scope and name not in values]
        names = [f"{scope}.{name}".strip(".") for name in named.get("VariableNames", ())] or inside
        if len(names) == len(units):
            stated |= {name: Stated(units=unit or None) for name, unit in zip(names, units, strict=True)}
        elif units:
            stated[scope] = replace(
                stated[scope], notes=(*stated[scope].notes, f"states VariableUnits={units}, which is not applied")
            )
    return ForeignFile(path=path, fields=fields, stated=stated)


# ---- v4 to v7 ----------------------------------------------------------------------------------------------


def _read_classic(path: Path, most_bytes: int | None) -> tuple[dict[str, Field], dict[str, Any]]:
    """Return every variable of a MATLAB file before version 7.3, and its scalars and texts."""
    from scipy.io import loadmat  # noqa: PLC0415

    for declared in _packed_sizes(path):
        refuse_size(declared, f"{path}: a compressed variable", path.stat().st_size, most_bytes=most_bytes)
    contents = loadmat(path)
    leaves = {
        name: leaf
        for key, value in contents.items()
        if not key.startswith("__")
        for name, leaf in _classic_leaves(key, value)
    }
    values = {name: plain for name, leaf in leaves.items() if (plain := _classic_value(leaf)) is not None}
    return {name: _classic_field(leaf) for name, leaf in leaves.items()}, values


def _packed_sizes(path: Path) -> Iterator[int]:
    """Yield the declared size in bytes of each compressed variable of a version 5 to 7 file."""
    header_bytes, compressed = 128, 15  # of version 5: the text before the first variable; its type miCOMPRESSED
    with path.open("rb") as stream:
        header = stream.read(header_bytes)
        order = {b"IM": "<", b"MI": ">"}.get(header[-2:])
        while order and len(tag := stream.read(8)) == 8:  # noqa: PLR2004 - two words
            kind, count = struct.unpack(f"{order}2I", tag)
            start = stream.tell()
            if kind == compressed:
                with suppress(zlib.error):  # scipy reports the damage
                    # 1024 compressed bytes are more than enough for the first eight bytes of the variable
                    inner = zlib.decompressobj().decompress(stream.read(min(count, 1024)), 8)
                    if len(inner) == 8:  # noqa: PLR2004
                        yield struct.unpack(f"{order}2I", inner)[1]
            stream.seek(start + count)


def _classic_leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """Yield the leaves of a variable: each field of each struct, or the variable itself."""
    if not (isinstance(value, np.ndarray) and value.dtype.names and value.dtype.hasobject and value.size):
        yield name, value
        return
    for number, element in enumerate(value.reshape(-1, order="F"), start=1):
        where = name if value.size == 1 else f"{name}({number})"
        for field in value.dtype.names:
            yield from _classic_leaves(f"{where}.{field}", element[field])


def _classic_field(value: Any) -> Field:  # noqa: ANN401
    if not isinstance(value, np.ndarray):
        return "a sparse matrix" if hasattr(value, "tocsc") else "an object"
    if value.dtype.kind in "OV":
        return "a struct array" if value.dtype.names else "a cell array"
    return phrase_of(value.dtype, value.size) or value


def _classic_value(value: Any) -> Any:  # noqa: ANN401
    """Return a scalar, a text or a cell array of texts as a Python object; None for anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.names or not value.size:
        return None
    if value.dtype.kind == "O":
        texts = tuple(_classic_value(cell) if np.size(cell) else "" for cell in value.reshape(-1))
        return texts if all(isinstance(text, str) for text in texts) else None
    return value.reshape(-1)[0].item() if value.size == 1 and value.dtype.kind in "biufU" else None


# ---- v7.3 --------------------------------------------------------------------------------------------------


def _read_hdf5(path: Path, most_bytes: int | None) -> tuple[Mapping[str, Field], dict[str, Any]]:
    """Return every variable of a MATLAB v7.3 file, and its scalars and texts."""
    places: dict[str, str] = {}
    described: dict[str, tuple[int, ...] | str] = {}
    values: dict[str, Any] = {}
    with open_hdf5(path) as contents:
        inside: list[str] = []  # groups whose members are not variables: sparse matrices, contents of cells
        for where, item in objects(contents):
            if any(where.startswith(f"{group}/") for group in inside):
                continue
            sparse = "MATLAB_sparse" in item.attrs
            if sparse or "/#" in where:
                inside.append(where)
            if sparse:
                described[dotted(where)] = "a sparse matrix"
            elif is_array(item) and "/#" not in where:
                for name, element in _hdf5_elements(contents, dotted(where), item):
                    places[name], described[name] = element.name, _hdf5_field(element)
                    values[name] = _hdf5_value(contents, element)

    def read_values(name: str) -> NDArray[np.generic]:
        return np.asarray(read_array(path, places[name], most_bytes=most_bytes)).T  # arrays are in column-major order

    plain = {name: value for name, value in values.items() if value is not None}
    return ArraysOnDisk(path, "a MATLAB file", described, cache(read_values)), plain


def _hdf5_elements(contents: Any, name: str, item: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """Yield an array, or one field of each element of a struct array, which is an array of references."""
    group, _, field = name.rpartition(".")
    if not group or item.dtype.kind != "O" or "MATLAB_class" in item.attrs:
        yield name, item
        return
    for number, reference in enumerate(item[()].T.reshape(-1), start=1):
        if is_array(element := contents[reference]):
            yield f"{group}({number}).{field}", element


def _hdf5_value(contents: Any, item: Any) -> Any:  # noqa: ANN401
    """Return a scalar, a short text or a cell array of them as a Python object; None for anything else."""
    matlab_class = item.attrs.get("MATLAB_class", b"")
    longest_text = 1000  # characters or cells, above which nothing is metadata
    if item.shape is None or not 0 < item.size <= longest_text or item.attrs.get("MATLAB_empty", 0):
        return None
    if matlab_class == b"char":
        return "".join(map(chr, item[()].T.reshape(-1)))
    if matlab_class == b"cell":
        cells = [contents[reference] for reference in item[()].T.reshape(-1)]
        texts = tuple(_hdf5_value(contents, cell) or "" for cell in cells if is_array(cell))
        return texts if all(isinstance(text, str) for text in texts) else None
    return item[()].reshape(-1)[0].item() if item.size == 1 and item.dtype.kind in "biuf" else None


def _hdf5_field(item: Any) -> tuple[int, ...] | str:  # noqa: ANN401
    matlab_class = item.attrs.get("MATLAB_class", b"")
    matlab_class = matlab_class.decode(errors="replace") if isinstance(matlab_class, bytes) else str(matlab_class)
    if item.shape is None or item.attrs.get("MATLAB_empty", 0) or item.size == 0:
        return "empty"
    if item.dtype.names:
        return "complex numbers"
    is_number = re.fullmatch(r"|double|single|logical|u?int(8|16|32|64)", matlab_class)
    if not is_number or item.dtype.kind not in "biuf":
        return _CLASSES.get(matlab_class, "a struct array" if not matlab_class else f"a {matlab_class}")
    return tuple(item.shape[::-1])
