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

from hums.records._contained import fingerprint

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
    "_FillValue",
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


def arrays_along(file: h5py.File, dim: str) -> dict[str, tuple[h5py.Dataset, tuple[str, ...], dict[str, Any]]]:
    """Return the arrays at the top of a file whose first dimension is `dim`, each with its dimensions and attributes.

    Xarray opens all arrays of a file, in a fifth of a second for some fifty.
    """
    found = {}
    for name, item in file.items():
        if isinstance(item, h5py.Dataset) and "DIMENSION_LIST" in item.attrs:
            dims = tuple(str(scales[0].name).rpartition("/")[2] for scales in item.dims)
            if dims[0] == dim:
                attrs = {key: value for key, value in item.attrs.items() if key not in _OF_LAYOUT}
                single = {key: value[0] for key, value in attrs.items() if np.shape(value) == (1,)}
                found[name] = item, dims, attrs | single
    return found


def decoded(item: h5py.Dataset, dims: tuple[str, ...], attrs: dict[str, Any]) -> xr.Variable:
    """Return an array of `arrays_along` in memory."""
    text = h5py.check_string_dtype(item.dtype) is not None
    return conventions.decode_cf_variable(
        item.name, xr.Variable(dims, item.asstr()[()].astype(np.str_) if text else item[()], attrs)
    ).load()


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
