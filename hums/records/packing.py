"""Records of one layout in one dataset: channels stacked, pulse times padded, true values concatenated.

Channels have one length and are stacked to (record, time). Pulse times differ in number and are padded with NaN.
Truth variables differ in number and shape from record to record (a crack adds lines), so the values of each are
concatenated along a dimension of their own; their dimensions, shapes and attributes are JSON text for each record.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from hums.records.channels import kind_of

_SCHEMA = "hums-shard/1"
_ROWS = "record"
_LAYOUT, _ATTRS = "layout_of_truth", "attrs_of_record"
_COORDINATES = ("snapshot_s",)
_SAMPLES = ("vibration", "waveform", "measured")  # in the type that is asked for; times and speeds are exact


def packed(records: Sequence[xr.Dataset], labels: Mapping[str, Sequence[Any]], *, dtype: str) -> xr.Dataset:
    """Return one dataset of records of one layout and their labels.

    Parameters
    ----------
    records : sequence of xarray.Dataset
        With the same channels and tachometers, of the same lengths and rates.
    labels : mapping of str to sequence
        By the name of a label, its value for each record.
    dtype : {"float32", "float64"}
        Type of the stored samples, and of complex amplitudes of their truth; all other numbers are float64.

    Raises
    ------
    ValueError
        If the records differ in layout, or a label has the name of a channel.
    """
    names = [str(name) for name in records[0].data_vars if not _is_truth(name)]
    names += [name for name in _COORDINATES if name in records[0].coords]
    variables: dict[str, xr.Variable] = {name: _stacked(records, name, dtype) for name in names}
    for label, values in labels.items():
        if label in variables:
            raise ValueError(f'the label "{label}" has the name of a channel; give the range another label.')
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
    return xr.Dataset(variables, attrs={"schema": _SCHEMA})


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


def _stacked(records: Sequence[xr.Dataset], name: str, dtype: str) -> xr.Variable:
    """Return one variable of all records, stacked along the dimension of records."""
    first = records[0].variables[name]
    rows = []
    for record in records:
        if name not in record.variables:
            raise ValueError(f'"{name}" is in some records only; the records of a dataset have the same channels.')
        if _json(record.variables[name].attrs) != _json(first.attrs):
            raise ValueError(f'"{name}" has different attributes in the records; units, place and rate have to agree.')
        rows.append(record.variables[name].to_numpy())
    if len({row.ndim for row in rows}) > 1 or (not _is_padded(first) and len({row.shape for row in rows}) > 1):
        raise ValueError(f'channel "{name}" has different lengths; the records of a dataset are equally long.')
    if first.ndim == 0:
        return xr.Variable(_ROWS, np.array(rows), first.attrs)
    widest = np.max([row.shape for row in rows], axis=0)
    stack = np.full((len(rows), *widest), np.nan, dtype=dtype if kind_of(name, first) in _SAMPLES else np.float64)
    for target, row in zip(stack, rows, strict=True):
        target[tuple(slice(size) for size in row.shape)] = row
    return xr.Variable((_ROWS, *first.dims), stack, first.attrs)


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
