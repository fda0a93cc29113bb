"""Records and results on disk: HDF5 in netCDF4 layout, checksummed, written whole or not at all.

``xarray.open_dataset(path, engine="h5netcdf")`` reads every file written here. What `open_record` adds is
the time axis, which is computed and not stored, and the check.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Final, TypeVar
from uuid import uuid4

import h5py
import numpy as np
import xarray as xr

from hums._netcdf import Chunks, DiskError, write_netcdf
from hums._packing import packed, unpacked
from hums.record import SCHEMA, RecordError, attach_time, check_record, detach_time

__all__ = [
    "existing_file",
    "is_hdf5",
    "open_hdf5",
    "open_record",
    "open_shard",
    "open_tree",
    "record_of_shard",
    "remove_parts",
    "save_record",
    "write_shard",
    "write_tree",
    "written_beside",
]

_ENGINE: Final = "h5netcdf"
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_CHUNK = 65536  # values: half a megabyte of float64, which HDF5's own cache of a megabyte holds
_DAMAGE = (
    OSError,
    RuntimeError,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
)  # what HDF5 and its readers raise on broken bytes

Opened = TypeVar("Opened", xr.Dataset, xr.DataTree)


def save_record(record: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Write a record to `path`; a file that stood there is replaced only once the new one is complete.

    Parameters
    ----------
    record : xarray.Dataset
        What `make_record` built, also a slice of it: its time axis is kept as start, count and rate.
    path : path
        File to write.

    Raises
    ------
    RecordError
        If it is not a record, or holds what HDF5 cannot.
    OSError
        If the disk does not take it.
    """
    check_record(record)
    plain = _writable(detach_time(record), where="record")
    _write({"/": (plain, _all_chunks(plain))}, path)


def open_record(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a record. Samples are read when they are used; close it, or use it in a ``with`` block.

    Raises
    ------
    RecordError
        If there is no whole record at `path`: the sentence tells what there is instead.
    """
    file = existing_file(path)
    _check_schema(file)
    opened = _opened(file, xr.open_dataset)
    try:
        record = attach_time(opened)
        check_record(record)
    except RecordError as error:
        opened.close()
        raise RecordError(f"{file}: {error}") from error
    except _DAMAGE as error:
        opened.close()
        raise _damaged(file, error) from error
    record.set_close(opened.close)
    return record


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write a tree of datasets as groups of one file, with the same care as a record."""
    nodes = {node.path: _writable(node.to_dataset(inherit=False), where=f"group {node.path}") for node in tree.subtree}
    _write({where: (dataset, _all_chunks(dataset)) for where, dataset in nodes.items()}, path)


def open_tree(path: str | os.PathLike[str]) -> xr.DataTree:
    """Open a tree that `write_tree` wrote. Values are read when they are used.

    Raises
    ------
    RecordError
        If the file is missing, damaged or not HDF5.
    """
    return _checked_and_opened(path, xr.open_datatree)


def write_shard(
    records: Sequence[xr.Dataset], path: str | os.PathLike[str], *, labels: Mapping[str, Sequence[Any]], dtype: str
) -> None:
    """Write alike records and their labels to one file, one record a row, with the same care as a record.

    Parameters
    ----------
    records : sequence of xarray.Dataset
        With the same channels and tachometers, of the same lengths and rates.
    path : path
        File to write.
    labels : mapping of str to sequence
        A value a record, by the name of the label.
    dtype : "float32" or "float64"
        In which the samples are kept.
    """
    shard = _writable(packed(records, labels, dtype=dtype), where="shard")
    chunks = _all_chunks(shard)
    for name in chunks:
        _, *row = shard.variables[name].shape
        if row:  # a record is read without its neighbours
            chunks[name] = (1, *_chunks(tuple(row)))
    _write({"/": (shard, chunks)}, path)


def open_shard(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a file that `write_shard` wrote. Values are read when they are used.

    Raises
    ------
    RecordError
        If the file is missing, damaged or not HDF5.
    """
    return _checked_and_opened(path, xr.open_dataset)


def record_of_shard(shard: xr.Dataset, row: int) -> xr.Dataset:
    """Read one record of an open shard."""
    record = attach_time(unpacked(shard, row))
    check_record(record)
    return record


def open_hdf5(path: str | os.PathLike[str]) -> h5py.File:
    """Open any HDF5 file to read, as a context manager.

    Raises
    ------
    RecordError
        If it is missing, damaged or not HDF5.
    """
    file = existing_file(path)
    if not is_hdf5(file):
        with file.open("rb") as stream:
            start = stream.read(len(_SIGNATURE))
        if _SIGNATURE.startswith(start):
            raise _damaged(file, f"it ends after {len(start)} bytes")
        raise RecordError(
            f"{file} is not an HDF5 file, so not a record. Make a record of it: hums convert {file.name} record.h5 ..."
        )
    try:
        return h5py.File(file, mode="r")
    except (PermissionError, BlockingIOError) as error:
        raise RecordError(
            f"{file} cannot be read now ({error}); check who may read it and whether a program still writes it."
        ) from error
    except _DAMAGE as error:
        raise _damaged(file, error) from error


def is_hdf5(path: str | os.PathLike[str]) -> bool:
    """Tell whether the file carries the signature of HDF5, also behind the header of MATLAB v7.3."""
    return bool(h5py.is_hdf5(path))


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return `path` if a file with something in it stands there.

    Raises
    ------
    RecordError
        If there is none, or a directory, or an empty file.
    """
    file = Path(path)
    if file.is_dir():
        raise RecordError(f"{file} is a directory; name a file in it.")
    if not file.exists():
        raise RecordError(f"{file}: there is no such file; check the path.")
    if file.stat().st_size == 0:
        raise RecordError(f"{file} is empty: whatever wrote it did not finish; write it again.")
    return file


# ---- reading -----------------------------------------------------------------------------------------------


def _checked_and_opened(path: str | os.PathLike[str], open_with: Callable[..., Opened]) -> Opened:
    file = existing_file(path)
    open_hdf5(file).close()
    return _opened(file, open_with)


def _opened(file: Path, open_with: Callable[..., Opened]) -> Opened:
    try:
        return open_with(file, engine=_ENGINE)
    except _DAMAGE as error:
        raise _damaged(file, error) from error


def _check_schema(file: Path) -> None:
    try:
        with open_hdf5(file) as contents:
            schema = contents.attrs.get("schema")
    except (OSError, RuntimeError, LookupError) as error:
        raise _damaged(file, error) from error
    if isinstance(schema, str) and schema == SCHEMA:  # other hands may have put an array there
        return
    if schema is None:
        raise RecordError(
            f"{file} is HDF5 but not a record: it carries no schema. If it holds signals, make a record of "
            f"them: hums convert {file.name} record.h5 ..."
        )
    raise RecordError(f"{file} holds {schema}, where a record holds {SCHEMA}; open it with what wrote it.")


def _damaged(file: Path, why: object) -> RecordError:
    return RecordError(
        f"{file} is damaged or cut off ({why}). Copy it again from where it came, or convert the original again."
    )


# ---- writing -----------------------------------------------------------------------------------------------


def _write(groups: Mapping[str, tuple[xr.Dataset, Chunks]], path: str | os.PathLike[str]) -> None:
    with written_beside(path) as part:
        try:
            write_netcdf(part, groups)
        except (DiskError, RuntimeError) as error:  # the latter where HDF5 misses what the disk refused
            raise OSError(f"{path} could not be written ({error}); check the space on its disk.") from error


@contextmanager
def written_beside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a file to write; put it in the place of `path` if all went well, remove it if not."""
    target = Path(path).resolve()  # so that a link goes on pointing to what it pointed to
    if target.is_dir():
        raise RecordError(f"{path} is a directory; name a file in it.")
    if not target.parent.is_dir():
        raise RecordError(f"{path}: there is no directory {target.parent}; create it first.")
    part = target.with_name(f".hums-{uuid4().hex}.part")
    try:
        yield part
        _sync(part)
        part.replace(target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    if os.name == "posix":  # elsewhere a directory cannot be opened, and need not be
        _sync(target.parent)


def remove_parts(folder: Path) -> None:
    """Remove what writers that were killed left in a folder; nothing may be writing there."""
    for part in folder.glob(".hums-*.part"):
        part.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Have the disk hold what was written: without it a power cut can leave a new name on old bytes."""
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _all_chunks(dataset: xr.Dataset) -> dict[str, tuple[int, ...]]:
    """Return the chunks, with a checksum each, of every array of numbers.

    The fill value of floats is NaN, xarray's default: a chunk that HDF5 does not find in a damaged index then reads as
    NaN, which the analysis refuses, and not as a stretch of silence. HDF5 cannot checksum what is not chunked, nor the
    text behind a reference.
    """
    return {
        str(name): _chunks(variable.shape)
        for name, variable in dataset.variables.items()
        if variable.dtype.kind in "biufcmM" and variable.ndim and variable.size
    }


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Halve the longest axis, which is time where there is time, until a chunk is small enough."""
    chunks = list(shape)
    while np.prod(chunks, dtype=np.int64) > _CHUNK:
        longest = int(np.argmax(chunks))
        chunks[longest] = -(-chunks[longest] // 2)
    return tuple(chunks)


def _writable(dataset: xr.Dataset, *, where: str) -> xr.Dataset:
    """Return the dataset with attributes that netCDF holds and without the encoding of an earlier file."""
    plain = dataset.drop_encoding()
    plain.attrs = _plain_attrs(dataset.attrs, where)
    for name, variable in plain.variables.items():
        variable.attrs = _plain_attrs(variable.attrs, f'{where}, variable "{name}"')
    return plain


def _plain_attrs(attrs: Mapping[Any, Any], where: str) -> dict[str, Any]:
    return {
        str(name): _plain(value, f'{where}: attribute "{name}"') for name, value in attrs.items() if value is not None
    }


def _plain(value: Any, what: str) -> Any:  # noqa: ANN401
    """Translate what netCDF lacks: a truth value becomes 0 or 1, a moment ISO 8601, a lone row an array."""
    if isinstance(value, str):
        if "\0" in value:
            raise RecordError(f"{what} contains a NUL character; remove it.")
        return value
    if isinstance(value, bool | np.bool):
        return int(value)
    if isinstance(value, datetime | Path):
        return value.isoformat() if isinstance(value, datetime) else str(value)
    array = np.asarray(value)
    if array.dtype.kind == "U" and array.ndim == 1:
        return [str(item) for item in array]
    if array.dtype.kind not in "biuf":
        raise RecordError(f"{what} is a {type(value).__name__}; only text, numbers and rows of either are kept.")
    return array.astype(np.int8) if array.dtype.kind == "b" else array[()]
