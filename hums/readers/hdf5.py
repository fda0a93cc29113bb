"""HDF5 files of other programs: every array under its path, with what its attributes state."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.readers.columns import ArraysOnDisk, Field, Stated, dotted, stated_of
from hums.records.record import SCHEMA, RecordError
from hums.records.store import is_array, objects, open_hdf5, read_array, refuse_size

__all__ = ["read"]


def read(path: Path, *, most_bytes: int | None = None) -> tuple[Mapping[str, Field], dict[str, Stated]]:
    """Return every array under its path, with dots for slashes, and what attributes of it and of its groups state.

    Arrays are unpacked as the CF conventions have it: ``scale_factor`` and ``add_offset``, values that are missing or
    not valid as NaN. An array is read when it is asked for. A netCDF file of version 3 is read by scipy.

    Raises
    ------
    RecordError
        If it is damaged, neither HDF5 nor netCDF, a record already, or reaches into other files.
    """
    with path.open("rb") as stream:
        if stream.read(3) == b"CDF":
            return _read_netcdf3(path, most_bytes)
    with open_hdf5(path) as contents:
        try:
            schema = contents.attrs.get("schema")
            items = {"": contents} | ({} if schema == SCHEMA else dict(objects(contents)))
            found = {dotted(where): where for where, item in items.items() if where and is_array(item)}
            described = {name: _described(contents[where]) for name, where in found.items()}
            attributes = {dotted(where): _plain(item.attrs) for where, item in items.items()}
        except RecordError:
            raise
        except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
            raise RecordError(f"{path} is damaged ({error}). Copy it again from where it came.") from error
    if schema == SCHEMA:
        raise RecordError(f"{path} is a record already: open it with open_record, or hums analyze.")

    def values(name: str) -> NDArray[np.generic]:
        read_values = np.asarray(read_array(path, found[name], most_bytes=most_bytes))
        return _unpacked(np.atleast_1d(read_values), attributes[name])

    return ArraysOnDisk(described, values), {name: stated_of(own) for name, own in attributes.items()}


def _read_netcdf3(path: Path, most_bytes: int | None) -> tuple[dict[str, Field], dict[str, Stated]]:
    try:
        with xr.open_dataset(path, engine="scipy", decode_cf=False) as contents:
            refuse_size(contents.nbytes, str(path), path.stat().st_size, most_bytes=most_bytes)
            attributes = {str(name): _plain(one.attrs) for name, one in contents.variables.items()}
            fields = dict[str, Field]()
            for name, one in contents.variables.items():
                phrase = _described(one)
                values = np.atleast_1d(one.to_numpy())
                fields[str(name)] = phrase if isinstance(phrase, str) else _unpacked(values, attributes[str(name)])
            general = _plain(contents.attrs)
    except RecordError:
        raise
    except Exception as error:  # a parser may fail in any way on damaged bytes
        raise RecordError(f"{path} is damaged ({error}). Copy it again from where it came.") from error
    return fields, {name: stated_of(own) for name, own in (attributes | {"": general}).items()}


def _unpacked(values: NDArray[np.generic], attributes: Mapping[str, Any]) -> NDArray[np.generic]:
    """Return values as the CF conventions have them: missing ones as NaN, the others scaled."""
    if str(attributes.get("_Unsigned", "")).lower() == "true" and values.dtype.kind == "i":
        values = values.view(f"u{values.dtype.itemsize}")
    missing = np.zeros(values.shape, dtype=bool)
    for key in ("_FillValue", "missing_value"):
        for fill in np.atleast_1d(np.asarray(attributes.get(key, []))):
            missing |= values == fill
    low, high = attributes.get("valid_range", (attributes.get("valid_min"), attributes.get("valid_max")))
    missing |= (values < low) if low is not None else False
    missing |= (values > high) if high is not None else False
    scale, offset = attributes.get("scale_factor"), attributes.get("add_offset")
    if scale is None and offset is None and not missing.any():
        return values
    kind = np.float32 if values.dtype == np.float32 and scale is None is offset else np.float64
    unpacked: NDArray[np.floating] = values.astype(kind)
    unpacked = unpacked * kind(1 if scale is None else scale) + kind(0 if offset is None else offset)
    unpacked[missing] = np.nan
    return unpacked


def _plain(attributes: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return attributes, of which arrays of one value are that value."""
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


def _described(item: Any) -> tuple[int, ...] | str:  # noqa: ANN401
    if item.shape is None or item.size == 0:
        return "empty"
    if item.dtype.names:
        return "a table with named columns"
    if item.dtype.kind not in "biuf":
        return {"O": "text", "S": "text", "c": "complex numbers"}.get(item.dtype.kind, f"of type {item.dtype}")
    return tuple(item.shape) or (1,)
