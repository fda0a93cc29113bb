"""Records and results on disk: HDF5 in netCDF4 layout, checksummed, written atomically.

``xarray.open_dataset(path, engine="h5netcdf")`` reads every file written here, and h5py its arrays; ``time`` is in
seconds for both. `open_record` computes the time axis from start and rate instead, and validates the record.
"""

import json
import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any

import h5py
import numpy as np
import xarray as xr
from xarray.backends import CachingFileManager
from xarray.indexes import RangeIndex

from hums.records._netcdf import (
    Chunks,
    DiskError,
    is_unchanged,
    open_netcdf,
    refuse_reaching_out,
    refuse_size,
    write_netcdf,
)
from hums.records.channels import ANGLE, attach_time, detach_time, kind_of, layout_of, other_layout, stacked
from hums.records.fields import SCHEMA, RecordError, RecordWarning, is_utf8, plain_repr
from hums.records.outputs import atomic_write, check_outputs
from hums.records.validation import check_record
from signals._validation import checked, plain_text


@checked
def save_record(record: xr.Dataset, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a record to a file, which replaces an existing one only once it is complete.

    Parameters
    ----------
    record : xarray.Dataset
        Record from `make_record`, or a slice of one: its time axis is stored as start, count and rate.
    path : str or Path
        File to write.
    force : bool
        Whether to overwrite a file that another program wrote.

    Raises
    ------
    RecordError
        If it is not a record, contains values that HDF5 cannot store, or, without `force`, another program wrote the
        file.
    OSError
        If writing to the disk fails.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import hums
    >>> record = hums.make_record({"vib": np.ones(1000)}, rate_hz=1000, angle=hums.UnknownAngle(), units="g")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     hums.save_record(record.isel(time=slice(500, None)), pathlib.Path(folder) / "half.h5")
    ...     with hums.open_record(pathlib.Path(folder) / "half.h5") as half:
    ...         print(float(half.time[0]), half.sizes["time"])
    0.5 500
    """
    check_outputs([Path(path)], force=force)
    write_record(record, path)


def write_record(record: xr.Dataset, path: str | os.PathLike[str], *, tidy: bool = True) -> None:
    """Write a record as `save_record` does; `tidy` is that of `atomic_write`."""
    check_record(record)
    plain = _with_axes(_writable(detach_time(record), where="record"), record)
    _write({"/": (plain, _all_chunks(plain))}, path, tidy=tidy)


@checked
def open_record(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a record; samples are read on access.

    Parameters
    ----------
    path : str or Path
        File from `save_record`, ``hums convert`` or ``hums synth``.

    Returns
    -------
    xarray.Dataset
        The record, to be closed or used in a ``with`` block.

    Raises
    ------
    RecordError
        If the file is missing, damaged or not a record.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import hums
    >>> record = hums.make_record({"vib": np.ones(1000)}, rate_hz=1000, angle=hums.UnknownAngle(), units="g")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     hums.save_record(record, pathlib.Path(folder) / "record.h5")
    ...     with hums.open_record(pathlib.Path(folder) / "record.h5") as opened:
    ...         print(opened.identical(record), opened.vib.units)
    True g
    """
    file = existing_file(path)
    opened = _opened(file, _check_schema, create_default_indexes=False)["/"]  # indexes would load the time axes
    with _reading(file), ExitStack() as closing:
        closing.callback(opened.close)
        try:
            record = attach_time(opened)
            if isinstance(record.attrs.get("machine"), str):
                record.attrs["machine"] = plain_text(record.attrs["machine"])
            for dim in record.dims:
                if dim in record.coords and dim not in record.xindexes:
                    record = record.set_xindex([dim])
            check_record(record)
        except RecordError as error:
            raise RecordError(f"{file}: {error}") from error
        closing.pop_all()
    record.set_close(opened.close)
    return record


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write a tree of datasets as groups of one file, checksummed and atomically."""
    nodes = {node.path: _writable(node.to_dataset(inherit=False), where=f"group {node.path}") for node in tree.subtree}
    _write({where: (dataset, _all_chunks(dataset)) for where, dataset in nodes.items()}, path)


def open_tree(path: str | os.PathLike[str]) -> xr.DataTree:
    """Open a tree that `write_tree` wrote; values are read on access.

    Raises
    ------
    RecordError
        If the file is missing, damaged or not HDF5.
    """
    groups = _opened(path)
    tree = xr.DataTree.from_dict(groups)
    tree.set_close(groups["/"].close)
    return tree


def write_shard(
    records: Sequence[xr.Dataset], path: str | os.PathLike[str], *, labels: Mapping[str, Sequence[Any]], dtype: str
) -> None:
    """Write records of one layout and their labels to one file, one row per record, checksummed and atomically.

    Parameters
    ----------
    records : sequence of xarray.Dataset
        Records with the same channels and tachometers, of the same lengths and rates.
    path : path
        File to write.
    labels : mapping of str to sequence
        Value of each label for each record, by the name of the label.
    dtype : {"float32", "float64"}
        Type of the stored samples, and of line amplitudes, which are compressed.
    """
    shard = _with_axes(_writable(packed(records, labels, dtype=dtype), where="shard"), records[0])
    chunks = _all_chunks(shard)
    for name in chunks:
        _, *row = shard.variables[name].shape
        if row:  # one chunk per record, so that each can be read alone
            chunks[name] = (1, *_chunks(tuple(row)))
        elif shard.variables[name].dtype.kind == "c":  # line amplitudes vary slowly and shrink to two thirds
            shard.variables[name].encoding = {"zlib": True}
    _write({"/": (shard, chunks)}, path)


def open_shard(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a file that `write_shard` wrote; values are read on access.

    Raises
    ------
    RecordError
        If the file is missing, damaged or not HDF5.
    """
    return _opened(path, create_default_indexes=False)["/"]


def record_of_shard(shard: xr.Dataset, row: int) -> xr.Dataset:
    """Return one record of an open shard, in memory."""
    record = attach_time(unpacked(shard, row))
    check_record(record)
    return record


def open_hdf5(path: str | os.PathLike[str]) -> h5py.File:
    """Open any HDF5 file for reading, as a context manager.

    Raises
    ------
    RecordError
        If it is missing, damaged or not HDF5.
    """
    file = existing_file(path)
    signature = b"\x89HDF\r\n\x1a\n"
    if not is_hdf5(file):
        with file.open("rb") as stream:
            start = stream.read(len(signature))
        if signature.startswith(start):
            raise _damaged(file, f"it ends after {len(start)} bytes")
        raise RecordError(
            f"{file} is not an HDF5 file, so not a record. "
            f"Convert it to one: hums convert {quote(file.name)} record.h5 ..."
        )
    with _reading(file), ExitStack() as closing:
        try:
            contents = closing.enter_context(h5py.File(file, mode="r"))
        except (PermissionError, BlockingIOError) as error:
            raise RecordError(
                f"{file} cannot be read now ({error}); check its permissions and whether a program is writing it."
            ) from error
        refuse_reaching_out(contents)
        closing.pop_all()
    return contents


@contextmanager
def _reading(file: Path) -> Iterator[None]:
    """Turn the errors of HDF5 and its readers on damaged bytes into a `RecordError`."""
    try:
        yield
    except RecordError:
        raise
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise _damaged(file, error) from error


def is_array(item: object) -> bool:
    """Return whether an object of an HDF5 file is a dataset, not a group."""
    return isinstance(item, h5py.Dataset)


def read_array(path: str | os.PathLike[str], where: str, *, most_bytes: int | None = None) -> Any:  # noqa: ANN401
    """Return the values of one dataset of another program's file.

    Raises
    ------
    RecordError
        If it declares more bytes than the file plausibly holds or than `most_bytes`.
    OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, MemoryError
        On damaged bytes.
    """
    with open_hdf5(path) as contents:
        item = contents[where]
        refuse_size(item.nbytes, f'{path}: "{where}"', contents.id.get_filesize(), most_bytes=most_bytes)
        return item[()]


def is_hdf5(path: str | os.PathLike[str]) -> bool:
    """Return whether a file has the signature of HDF5, also after the header of MATLAB v7.3."""
    return bool(h5py.is_hdf5(path))


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of an existing file that is not empty.

    Raises
    ------
    RecordError
        If it is missing, a directory, or empty.
    """
    if not isinstance(path, str | os.PathLike) or "\0" in os.fspath(path):
        raise RecordError(f"path={plain_repr(path)[:100]}: a file name is needed, a str or Path without NUL.")
    file = Path(path)
    if not is_utf8(str(file)):
        raise RecordError(f"{file}: this name is not UTF-8 text, as tables and pages need; rename the file or folder.")
    if file.is_dir():
        raise RecordError(f"{file} is a directory; name a file in it.")
    if not file.exists():
        raise RecordError(f"{file}: there is no such file; check the path.")
    if file.stat().st_size == 0:
        raise RecordError(f"{file} is empty: the program that wrote it did not finish; write it again.")
    return file


# ---- reading -----------------------------------------------------------------------------------------------


def _opened(
    path: str | os.PathLike[str],
    check: Callable[[h5py.File], None] = lambda _: None,
    **options: Any,  # noqa: ANN401
) -> dict[str, xr.Dataset]:
    files = CachingFileManager(open_hdf5, existing_file(path))
    with _reading(Path(path)), ExitStack() as closing:
        closing.callback(files.close)
        with files.acquire_context() as contents:
            check(contents)
        groups = open_netcdf(files, **options)
        closing.pop_all()
    return groups


def _check_schema(contents: h5py.File) -> None:
    file, schema = Path(contents.filename), contents.attrs.get("schema")
    if isinstance(schema, str) and schema == SCHEMA:  # files of other software may have an array there
        _warn_if_changed(file, contents)
        contents.visititems(partial(_refuse_lost_samples, file))
        return
    if schema is None:
        raise RecordError(
            f"{file} is HDF5 but not a record: it states no schema. If it holds signals, convert it to a record: "
            f"hums convert {quote(file.name)} record.h5 ..."
        )
    hint = "convert or simulate it again, or open it with the version that wrote it"
    if str(schema).startswith("hums-shard/"):
        hint = "it is part of a dataset: use hums.open_dataset(folder), or hums.dataset_record for one record"
    raise RecordError(f"{file} has schema {schema}, not {SCHEMA} of a record; {hint}.")


def _warn_if_changed(file: Path, contents: h5py.File) -> None:
    """Warn if names, shapes or attributes differ from those that were written."""
    if unchanged := is_unchanged(contents):
        return
    why = (
        "was written by another program or an older version: its attributes have no checksum."
        if unchanged is None
        else "was changed after it was written: names, shapes or attributes do not match their checksum; compare it "
        "with the original."
    )
    warnings.warn(f"{file} {why}", RecordWarning, stacklevel=3)


def _refuse_lost_samples(file: Path, name: str, item: object) -> None:
    """Refuse an array with chunks missing in the index of the file, which HDF5 reads as never written."""
    if not isinstance(item, h5py.Dataset) or item.chunks is None:
        return
    needed = math.prod(-(-size // chunk) for size, chunk in zip(item.shape, item.chunks, strict=True))
    if item.id.get_num_chunks() != needed:
        raise _damaged(file, f"parts of {quote(name)} are missing")


def _damaged(file: Path, why: object) -> RecordError:
    return RecordError(
        f"{file} is damaged or truncated ({why}). Copy it again from its source, or convert the original again."
    )


# ---- writing -----------------------------------------------------------------------------------------------


def _write(groups: Mapping[str, tuple[xr.Dataset, Chunks]], path: str | os.PathLike[str], *, tidy: bool = True) -> None:
    with atomic_write(path, tidy=tidy) as part:
        try:
            write_netcdf(part, groups)
        except (DiskError, RuntimeError) as error:  # the latter if HDF5 misses a failed write
            raise OSError(f"{path} could not be written ({error}); check the space on its disk.") from error


def _with_axes(plain: xr.Dataset, record: xr.Dataset) -> xr.Dataset:
    """Return the dataset to write with the time axes of a record as coordinates, which compress very well."""
    axes = {}
    for dim, index in record.xindexes.items():
        if isinstance(index, RangeIndex):
            axes[dim] = record.variables[dim].copy(deep=False)
            axes[dim].attrs["units"] = "revolutions" if dim == ANGLE else "s"
            axes[dim].encoding["zlib"] = True
    return plain.assign_coords(xr.Coordinates(axes, indexes={}))


def _all_chunks(dataset: xr.Dataset) -> dict[str, tuple[int, ...]]:
    """Return the chunk shape of every numeric array, since only chunked arrays can have checksums in HDF5.

    The fill value of floats is NaN, xarray's default, so that a chunk missing in a damaged index reads as NaN, which
    the analysis refuses, and not as zeros.
    """
    return {
        str(name): _chunks(variable.shape)
        for name, variable in dataset.variables.items()
        if variable.dtype.kind in "biufcmM" and variable.ndim and variable.size
    }


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the chunk shape of an array, whose longest axis, usually time, is halved until a chunk is small enough."""
    chunks = list(shape)
    most_values = 65536  # values: half a megabyte of float64, which fits HDF5's cache of a megabyte
    while np.prod(chunks, dtype=np.int64) > most_values:
        longest = int(np.argmax(chunks))
        chunks[longest] = -(-chunks[longest] // 2)
    return tuple(chunks)


def _writable(dataset: xr.Dataset, *, where: str) -> xr.Dataset:
    """Return a dataset with attributes that netCDF can store and without the encoding of an earlier file."""
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
    """Return an attribute as a netCDF type: booleans as 0 or 1, times as ISO 8601, sequences as arrays."""
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
        raise RecordError(f"{what} is a {type(value).__name__}; only text, numbers and rows of either can be stored.")
    return array.astype(np.int8) if array.dtype.kind == "b" else array[()]


# ---- records of one layout in one dataset: channels stacked, pulse times padded, true values concatenated ------------
# Channels have the same length and are stacked to (record, time). Pulse times differ in number and are padded with NaN.
# Truth variables differ in number and shape between records (a crack adds lines), so the values of each are
# concatenated along a separate dimension; their dimensions, shapes and attributes are JSON text per record.


_ROWS = "record"
_LAYOUT, _ATTRS = "layout_of_truth", "attrs_of_record"
_COORDINATES = ("snapshot_s",)


def packed(records: Sequence[xr.Dataset], labels: Mapping[str, Sequence[Any]], *, dtype: str) -> xr.Dataset:
    """Return one dataset of records of one layout and their labels.

    Parameters
    ----------
    records : sequence of xarray.Dataset
        Records with the same channels and tachometers, of the same lengths and rates.
    labels : mapping of str to sequence
        Value of each label for each record, by the name of the label.
    dtype : {"float32", "float64"}
        Type of the stored samples, and of the complex amplitudes of their truth; all other numbers are float64.

    Raises
    ------
    ValueError
        If the records differ in layout, or a label has the name of a channel.
    """
    layout, variables = layout_of(records[0]), dict[str, xr.Variable]()
    for record in records:
        if differs := other_layout(layout_of(record), layout):
            raise ValueError(f"{differs}; records of a dataset must have the same channels, lengths and attributes.")
    for name in (name for name in (*layout, *_COORDINATES) if name in records[0].variables):
        parts = [record.variables[name] for record in records]
        # in the requested type; times, speeds and single numbers stay exact
        sampled = parts[0].ndim and kind_of(name, parts[0]) in {"vibration", "waveform", "measured"}
        variables[name] = stacked(parts, _ROWS, dtype if sampled else None)
    for label, values in labels.items():
        if label in variables:
            raise ValueError(f'the label "{label}" has the name of a channel; choose another label.')
        variables[label] = xr.Variable(_ROWS, np.asarray(values), {"role": "label"})
    truths = sorted({str(name) for record in records for name in record.variables if _is_truth(name)})
    for name in truths:
        flat = [record.variables[name].to_numpy().ravel() for record in records if name in record.variables]
        if flat[0].dtype.kind == "c" and dtype == "float32":
            flat = [each.astype(np.complex64) for each in flat]
        variables[name] = xr.Variable(f"flat_{name}", np.concatenate(flat))
    layouts = [_json(_layout(record, truths)) for record in records]
    attrs = [_json(record.attrs) for record in records]
    variables[_LAYOUT], variables[_ATTRS] = (xr.Variable(_ROWS, np.array(texts)) for texts in (layouts, attrs))
    return xr.Dataset(variables, attrs={"schema": "hums-shard/1"})


def unpacked(shard: xr.Dataset, row: int) -> xr.Dataset:
    """Return one record of a packed dataset, without time axes."""
    selected = shard.isel({_ROWS: row})
    variables: dict[str, xr.Variable] = {}
    for name, variable in selected.data_vars.items():
        if variable.attrs.get("role") == "label" or _is_truth(name) or name in (_LAYOUT, _ATTRS):
            continue
        values = variable.to_numpy()
        if _is_padded(variable.variable):
            values = values[..., ~np.isnan(values).all(axis=tuple(range(values.ndim - 1)))]
        variables[str(name)] = xr.Variable(variable.dims, values, variable.attrs)
    layouts = [json.loads(text) for text in shard[_LAYOUT][: row + 1].to_numpy()]
    for name, layout in layouts[row].items():
        start = sum(_size(before[name]) for before in layouts[:row] if name in before)
        flat = shard[name][start : start + _size(layout)].to_numpy()
        variables[name] = xr.Variable(layout["dims"], flat.reshape(layout["shape"]), layout["attrs"])
    coordinates = [name for name, layout in layouts[row].items() if layout["coordinate"]]
    coordinates += [name for name in _COORDINATES if name in variables]
    return xr.Dataset(variables, attrs=json.loads(selected[_ATTRS].item())).set_coords(coordinates)


def _layout(record: xr.Dataset, truths: Sequence[str]) -> dict[str, Any]:
    """Return dimensions, shape and attributes of each truth variable of a record."""
    return {
        name: {
            "dims": list(record.variables[name].dims),
            "shape": list(record.variables[name].shape),
            "attrs": record.variables[name].attrs,
            "coordinate": name in record.coords,
        }
        for name in truths
        if name in record.variables
    }


def _size(layout: Mapping[str, Any]) -> int:
    return int(np.prod(layout["shape"], dtype=np.int64))


def _is_truth(name: object) -> bool:
    return str(name).startswith("truth_")


def _is_padded(variable: xr.Variable) -> bool:
    return any(str(dim).startswith("pulse_") for dim in variable.dims)


def _json(mapping: Mapping[Any, Any]) -> str:
    """Return a mapping as JSON, numpy scalars and arrays as numbers and lists."""
    return json.dumps(dict(mapping), default=lambda value: value.tolist())
