"""HDF5 files of other programs: every array under its path, with the metadata in its attributes."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.readers.columns import ArraysOnDisk, ForeignFile, dotted, phrase_of, stated_of
from hums.readers.description import ImportDescription
from hums.records._netcdf import objects
from hums.records.fields import SCHEMA, RecordError
from hums.records.store import is_array, open_hdf5, read_array


def read(path: Path, spec: ImportDescription) -> ForeignFile:
    """Return every array under its path, with dots for slashes, and the metadata in its and its groups' attributes.

    Arrays are unpacked by the CF conventions: ``scale_factor`` and ``add_offset`` are applied, and missing or invalid
    values become NaN. Arrays are read on access.

    Raises
    ------
    RecordError
        If it is not HDF5, as netCDF of version 3, is already a record, or refers to other files.
    """
    with path.open("rb") as stream:
        if stream.read(3) == b"CDF":
            raise RecordError(f"{path} is netCDF of version 3; convert it to version 4, such as by nccopy -k nc4.")
    with open_hdf5(path) as contents:
        if contents.attrs.get("schema") == SCHEMA:
            raise RecordError(f"{path} is already a record: open it with open_record, or hums analyze.")
        items = {"": contents} | dict(objects(contents))
        found = {dotted(where): where for where, item in items.items() if where and is_array(item)}
        arrays = {name: items[where] for name, where in found.items()}
        described = {name: phrase_of(one.dtype, one.size or 0) or one.shape or (1,) for name, one in arrays.items()}
        attributes = {dotted(where): _plain(item.attrs) for where, item in items.items()}

    def values(name: str) -> NDArray[np.generic]:
        read_values = np.asarray(read_array(path, found[name], most_bytes=spec.most_bytes))
        return _unpacked(np.atleast_1d(read_values), attributes[name])

    stated = {name: stated_of(own) for name, own in attributes.items()}
    return ForeignFile(path=path, fields=ArraysOnDisk(path, "an HDF5 file", described, cache(values)), stated=stated)


def _unpacked(values: NDArray[Any], attributes: Mapping[str, Any]) -> NDArray[np.generic]:
    """Return values by the CF conventions: missing and invalid ones as NaN, the others scaled."""
    packed = xr.Variable([f"axis {axis}" for axis in range(values.ndim)], values, attributes)
    unpacked = xr.conventions.decode_cf_variable("array", packed, decode_times=False, decode_timedelta=False).to_numpy()
    low, high = attributes.get("valid_range", (attributes.get("valid_min"), attributes.get("valid_max")))
    if low is None and high is None:
        return np.asarray(unpacked)
    valid = (values >= (-np.inf if low is None else low)) & (values <= (np.inf if high is None else high))
    return np.where(valid, unpacked, np.nan)


def _plain(attributes: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return attributes, with arrays of one value as scalars."""
    plain = {}
    for key in attributes:
        if key in {"CLASS", "NAME"}:  # of dimension scales
            continue
        try:
            value = attributes[key]
        except (OSError, RuntimeError, KeyError, TypeError):  # of a type that h5py does not read
            continue
        plain[str(key)] = value.reshape(-1)[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return plain
