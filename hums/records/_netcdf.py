"""Datasets as groups of an HDF5 file in netCDF4 layout, written by h5py.

The layout is that of ``Dataset.to_netcdf(engine="h5netcdf")``: every dimension is an HDF5 dimension scale with its
number ``_Netcdf4Dimid``; one without a coordinate variable is a dataset without storage, with the `NAME` that [1]_
prescribes; variables refer to their scales. Xarray's coders encode booleans, times and missing values.

References
----------
.. [1] Unidata, "NetCDF-4 file format specification", NetCDF user's guide, appendix C.
"""

from collections.abc import Iterator, Mapping
from io import FileIO
from itertools import count
from os import PathLike
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import xarray as xr
from xarray import conventions
from xarray.backends import AbstractDataStore, BackendArray, CachingFileManager
from xarray.core.indexing import ExplicitIndexer, IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

from hums.records._contained import fingerprint, objects

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer

Chunks = Mapping[str, tuple[int, ...]]

_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable."
_COMPLEX = {8: "_PFNC_FLOAT_COMPLEX_TYPE", 16: "_PFNC_DOUBLE_COMPLEX_TYPE"}  # type names of the netCDF library
_OF_LAYOUT = {
    "CLASS",
    "NAME",
    "DIMENSION_LIST",
    "REFERENCE_LIST",
    "_NCProperties",
    "_Netcdf4Coordinates",
    "_Netcdf4Dimid",
}  # no attributes of ours
_UNLIMITED = 1024  # chunk length along a dimension of length 0, which netCDF reads as unlimited
_TEXT = h5py.string_dtype()


def write_netcdf(path: str | PathLike[str], groups: Mapping[str, tuple[xr.Dataset, Chunks]]) -> None:
    """Write datasets to a new file, each to a group.

    Parameters
    ----------
    path : str or Path
        File to write; an existing one is replaced.
    groups : mapping of str to (Dataset, mapping of str to tuple of int)
        By the path of the group, parents before their children: the dataset, and the chunk shape of each variable that
        is stored in chunks with a checksum (fletcher32) each.

    Raises
    ------
    DiskError
        If the disk refuses a write.
    """
    numbers = count()
    with _Disk(path) as disk, h5py.File(disk, "w", track_order=True) as file:
        for where, (dataset, chunks) in groups.items():
            group = file if where == "/" else file.create_group(where, track_order=True)
            _write_group(group, dataset, chunks, numbers)
        version = f"version=2,hdf5={h5py.version.hdf5_version},h5py={h5py.version.version},hums={fingerprint(file)}"
        file.attrs.create("_NCProperties", np.bytes_(version))


def open_netcdf(files: "CachingFileManager[h5py.File]", **options: Any) -> dict[str, xr.Dataset]:  # noqa: ANN401
    """Return the datasets of a file by the path of their group, as `xarray.open_datatree` does in five times as long.

    Parameters
    ----------
    files : CachingFileManager of h5py.File
        Of a file in netCDF4 layout; it is open until a dataset is closed, and values are read on access.
    **options
        To `xarray.open_dataset`.

    Raises
    ------
    OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError
        On broken bytes.
    """
    with files.acquire_context() as file:
        items = dict(objects(file))
        addresses = {h5py.h5o.get_info(item.id).addr: where for where, item in items.items()}
        stores = {"": _Store(files, file)}
        for where, item in items.items():
            if isinstance(item, h5py.Group):
                stores[where] = _Store(files, item)
            elif not item.attrs.get("NAME", b"").startswith(_NO_VARIABLE.encode()):
                group, _, name = where.rpartition("/")
                text = h5py.check_dtype(vlen=item.dtype) is str
                values = np.asarray(item.asstr()[()]).astype(np.str_) if text else _Array(files, where, item)
                data = values if text else LazilyIndexedArray(values)
                stores[group].variables[name] = xr.Variable(_dims(item, name, addresses), data, _attrs(item))
    return {where or "/": xr.open_dataset(store, **options) for where, store in stores.items()}


def _dims(item: h5py.Dataset, name: str, addresses: Mapping[int, str]) -> list[str]:
    """Return the dimensions of an array: the names of its scales, or its own where it is one."""
    if item.attrs.get("CLASS") == b"DIMENSION_SCALE":
        return [name]
    scales = [item.file[references[0]] for references in item.attrs["DIMENSION_LIST"]] if item.ndim else []
    return [addresses[h5py.h5o.get_info(scale.id).addr].rpartition("/")[2] for scale in scales]


def _attrs(item: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Return the attributes: an array of one as its element, rows of text as lists."""
    found = {name: item.attrs[name] for name in item.attrs if name not in _OF_LAYOUT}
    for name, value in found.items():
        if isinstance(value, bytes):
            found[name] = value.decode()
        elif isinstance(value, h5py.Empty):
            found[name] = np.zeros(0, dtype=value.dtype)
        elif isinstance(value, np.ndarray):
            row = value.tolist() if value.dtype.kind == "O" else value
            found[name] = row[0] if len(row) == 1 else row
    return found


class _Store(AbstractDataStore):
    """One group of a file, as `xarray.open_dataset` takes it."""

    def __init__(self, files: "CachingFileManager[h5py.File]", group: h5py.Group) -> None:
        self.files, self.file_name, self.attrs = files, group.file.filename, _attrs(group)
        self.variables = dict[str, xr.Variable]()

    def get_variables(self) -> dict[str, xr.Variable]:
        return self.variables

    def get_attrs(self) -> dict[str, Any]:
        return self.attrs

    def get_encoding(self) -> dict[str, str]:
        return {"source": self.file_name}

    def close(self) -> None:
        self.files.close()


class _Array(BackendArray):
    """An array of a file, read on access."""

    def __init__(self, files: "CachingFileManager[h5py.File]", where: str, item: h5py.Dataset) -> None:
        self.files, self.where, self.shape, self.dtype = files, where, item.shape, item.dtype

    def __getitem__(self, key: ExplicitIndexer) -> Any:  # noqa: ANN401
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER_1VECTOR, self._values)

    def _values(self, key: tuple[Any, ...]) -> Any:  # noqa: ANN401
        with self.files.acquire_context() as file:
            return file[self.where][key]


class DiskError(OSError):
    """A write that the disk refused, for instance because it is full."""


class _Disk(FileIO):
    """A new file that raises the error of a refused write on closing: HDF5 crashes if a write itself raises."""

    def __init__(self, path: str | PathLike[str]) -> None:
        super().__init__(path, "w+")
        self._refused: OSError | None = None

    def write(self, data: "Buffer") -> int:
        """Write all of `data`, or nothing more after the first refusal."""
        rest = memoryview(data).cast("B")
        while len(rest) and self._refused is None:
            try:
                rest = rest[super().write(rest) :]
            except OSError as error:
                self._refused = error
        return memoryview(data).nbytes

    def close(self) -> None:
        """Close the file, and raise if a write was refused."""
        super().close()
        refused, self._refused = self._refused, None
        if refused is not None:
            raise DiskError(refused.errno, refused.strerror) from refused


def _write_group(group: h5py.Group, dataset: xr.Dataset, chunks: Chunks, numbers: Iterator[int]) -> None:
    """Write a dataset into an HDF5 group in the layout of netCDF4, with a dimension scale for each dimension."""
    variables, attrs = conventions.encode_dataset_coordinates(dataset)
    _write_attrs(group, attrs)
    dims = dict.fromkeys(dim for variable in variables.values() for dim in variable.dims)  # `sizes` has no fixed order
    scales = {dim: _new_scale(group, str(dim), dataset, chunks, next(numbers)) for dim in dims}
    for name, variable in variables.items():
        coded = conventions.encode_cf_variable(variable, name=name)
        if name in scales:
            _write_attrs(scales[name], coded.attrs)
            continue
        target = _new_dataset(group, str(name), coded, chunks.get(str(name)))
        _write_attrs(target, coded.attrs)
        for axis, dim in enumerate(variable.dims):
            h5py.h5ds.attach_scale(target.id, scales[dim].id, axis)


def _new_scale(group: h5py.Group, dim: str, dataset: xr.Dataset, chunks: Chunks, number: int) -> h5py.Dataset:
    """Create the scale of a dimension: its coordinate variable, or a dataset without storage."""
    if dim in dataset.variables:
        coded = conventions.encode_cf_variable(dataset.variables[dim], name=dim)
        scale, label = _new_dataset(group, dim, coded, chunks.get(dim)), dim
    else:
        size = dataset.sizes[dim]
        scale = group.create_dataset(dim, shape=(size,), dtype=">f4", track_order=True, **_layout((size,), None))
        label = f"{_NO_VARIABLE}{size:10d}"
    scale.make_scale(label)
    scale.attrs.create("_Netcdf4Dimid", number, dtype=np.int32)
    return scale


def _new_dataset(group: h5py.Group, name: str, variable: xr.Variable, chunks: tuple[int, ...] | None) -> h5py.Dataset:
    """Create an HDF5 dataset with the values of a variable, checksummed where it has chunks.

    With ``zlib`` in its encoding chunks are compressed, as xarray has it.
    """
    values = variable.to_numpy()
    dtype = values.dtype
    if dtype.kind in "UO":
        values, dtype = values.astype(object), _TEXT
    elif dtype.kind == "c":
        dtype = _complex_type(group, dtype)
    created = group.create_dataset(
        name,
        data=values,
        dtype=dtype,
        fletcher32=chunks is not None or None,
        **({"compression": "gzip", "compression_opts": 1, "shuffle": True} if variable.encoding.get("zlib") else {}),
        fillvalue=variable.attrs.get("_FillValue"),
        track_order=True,
        **_layout(values.shape, chunks),
    )
    created.flush()  # chunks are allocated now, and not when the last reference goes
    return created


def _layout(shape: tuple[int, ...], chunks: tuple[int, ...] | None) -> dict[str, Any]:
    """Return chunk shape and maximum shape: a dimension of length 0 is unlimited."""
    if 0 not in shape:
        return {"chunks": chunks}
    return {"chunks": tuple(size or _UNLIMITED for size in shape), "maxshape": tuple(size or None for size in shape)}


def _complex_type(group: h5py.Group, dtype: np.dtype[Any]) -> h5py.Datatype:
    """Return the type of complex numbers, named in the file so that the netCDF library reads it."""
    name = _COMPLEX[dtype.itemsize]
    if name not in group:
        group[name] = dtype
    return group[name]


def _write_attrs(target: h5py.Group | h5py.Dataset, attrs: Mapping[Any, Any]) -> None:
    """Write text with variable length, and a number as an array of one."""
    for name, value in attrs.items():
        values = np.atleast_1d(value)
        if isinstance(value, str):
            target.attrs.create(str(name), value, dtype=_TEXT)
        elif values.dtype.kind in "UO":
            target.attrs.create(str(name), values.astype(object), dtype=_TEXT)
        else:
            target.attrs.create(str(name), values)
