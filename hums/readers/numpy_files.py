"""NumPy files: one array, or several by name; the columns of a table are numbered."""

import math
import zipfile
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from hums.readers.columns import ArraysOnDisk, Field, ForeignFile, phrase_of, stated_of
from hums.readers.description import ImportDescription
from hums.records._netcdf import refuse_size


def read(path: Path, spec: ImportDescription) -> ForeignFile:
    """Return the arrays of a .npz by name, or the columns of the array of a .npy as "column 1", "column 2", ...

    Scalars and texts in a .npz, such as `fs` or `units`, are metadata of its arrays.

    Objects are not unpickled, since that would run code from the file. Arrays of a .npz are read on access.
    """
    if not zipfile.is_zipfile(path):
        return ForeignFile(path=path, fields=_columns(np.load(path, allow_pickle=False)))
    with zipfile.ZipFile(path) as archive:
        described = {name.removesuffix(".npy"): _described(archive, name) for name in archive.namelist()}
    read_member = partial(_member, path, {name: size for name, (_, size, _) in described.items()}, spec.most_bytes)
    shapes = {name: phrase or shape for name, (shape, _, phrase) in described.items()}
    fields = ArraysOnDisk(path, "a NumPy file", shapes, cache(read_member))
    longest_text = 1000  # bytes
    scalars = (name for name, (shape, size, _) in described.items() if math.prod(shape) == 1 and size < longest_text)
    stated = {"": stated_of({name: read_member(name).reshape(-1)[0].item() for name in scalars})}
    return ForeignFile(path=path, fields=fields, stated=stated)


def _columns(array: NDArray[Any]) -> dict[str, Field]:
    if array.ndim == 2:  # noqa: PLR2004 - a table
        return {f"column {number}": column for number, column in enumerate(array.T, start=1)}
    return {"column 1": phrase_of(array.dtype, array.size) or array}


def _described(archive: zipfile.ZipFile, name: str) -> tuple[tuple[int, ...], int, str]:
    """Return the shape, size in bytes and description of an array from its header."""
    with archive.open(name) as stream:
        shape, dtype = _header(stream)
    size = int(np.prod(shape, dtype=object))  # a damaged shape may exceed 64 bits
    return shape or (1,), size * dtype.itemsize, phrase_of(dtype, size)


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    if npy.read_magic(stream) == (1, 0):
        shape, _, dtype = npy.read_array_header_1_0(stream)
    else:  # arrays with many named columns
        shape, _, dtype = npy.read_array_header_2_0(stream)
    return shape, dtype


def _member(path: Path, sizes: Mapping[str, int], most_bytes: int | None, name: str) -> NDArray[np.generic]:
    refuse_size(sizes[name], f'{path}: "{name}"', path.stat().st_size, most_bytes=most_bytes)
    with np.load(path, allow_pickle=False) as contents:
        values: NDArray[np.generic] = contents[name]
    return values if values.shape else values.reshape(1)
