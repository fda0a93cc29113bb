"""Many alike records in one dataset: channels stacked, pulses padded, truth laid end to end.

Channels have one length, so they stack to (record, time). Pulse times differ in number and are padded with NaN.
Truth differs in everything from one record to the next (a crack adds lines), so the values of each of its
variables lie end to end along a dimension of their own, and what restores them, their dimensions, shape and
attributes, is JSON, a line for each record.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

SCHEMA = "hums-shard/1"
ROWS = "record"
LAYOUT, ATTRS = "layout_of_truth", "attrs_of_record"


def packed(records: Sequence[xr.Dataset], labels: Mapping[str, Sequence[Any]], *, dtype: str) -> xr.Dataset:
    """Return one dataset of alike records and their labels.

    Parameters
    ----------
    records : sequence of xarray.Dataset
        With the same channels and tachometers, of the same lengths and rates.
    labels : mapping of str to sequence
        A value a record, by the name of the label.
    dtype : "float32" or "float64"
        In which the samples are kept; pulse times and truth always are float64.

    Raises
    ------
    ValueError
        If the records are not alike, or a label has the name of a channel.
    """
    names = [str(name) for name in records[0].data_vars if not _is_truth(name)]
    variables: dict[str, xr.Variable] = {name: _stacked(records, name, dtype) for name in names}
    for label, values in labels.items():
        if label in variables:
            raise ValueError(f'the label "{label}" has the name of a channel; give the range another label.')
        variables[label] = xr.Variable(ROWS, np.asarray(values), {"role": "label"})
    truths = sorted({str(name) for record in records for name in record.variables if _is_truth(name)})
    for name in truths:
        flat = [record.variables[name].to_numpy().ravel() for record in records if name in record.variables]
        variables[name] = xr.Variable(f"flat_{name}", np.concatenate(flat))
    layouts = [_text(_layout(record, truths)) for record in records]
    attrs = [_text(record.attrs) for record in records]
    variables[LAYOUT], variables[ATTRS] = (xr.Variable(ROWS, np.array(texts)) for texts in (layouts, attrs))
    return xr.Dataset(variables, attrs={"schema": SCHEMA})


def unpacked(shard: xr.Dataset, row: int) -> xr.Dataset:
    """Return one record of a packed dataset, its time axes still to be attached."""
    here = shard.isel({ROWS: row})
    variables: dict[str, xr.Variable] = {}
    for name, variable in here.data_vars.items():
        if variable.attrs.get("role") == "label" or _is_truth(name) or name in (LAYOUT, ATTRS):
            continue
        values = variable.to_numpy()
        if _is_padded(variable.variable):
            values = values[~np.isnan(values)]
        variables[str(name)] = xr.Variable(variable.dims, values, variable.attrs)
    layouts = [json.loads(text) for text in shard[LAYOUT][: row + 1].to_numpy()]
    for name, layout in layouts[row].items():
        start = sum(_size(before[name]) for before in layouts[:row] if name in before)
        flat = shard[name][start : start + _size(layout)].to_numpy()
        variables[name] = xr.Variable(layout["dims"], flat.reshape(layout["shape"]), layout["attrs"])
    coordinates = [name for name, layout in layouts[row].items() if layout["coordinate"]]
    return xr.Dataset(variables, attrs=json.loads(here[ATTRS].item())).set_coords(coordinates)


def _stacked(records: Sequence[xr.Dataset], name: str, dtype: str) -> xr.Variable:
    first = records[0].variables[name]
    rows = []
    for record in records:
        if name not in record.variables:
            raise ValueError(f'"{name}" is in some records only; the records of a dataset have the same channels.')
        if _text(record.variables[name].attrs) != _text(first.attrs):
            raise ValueError(f'"{name}" is not described alike in all records; units, place and rate are to agree.')
        rows.append(record.variables[name].to_numpy())
    width = max(row.size for row in rows)
    if first.ndim and not _is_padded(first) and min(row.size for row in rows) < width:
        raise ValueError(f'channel "{name}" has different lengths; the records of a dataset are equally long.')
    if first.ndim == 0:
        return xr.Variable(ROWS, np.array(rows), first.attrs)
    stack = np.full((len(rows), width), np.nan, dtype=np.float64 if _is_padded(first) else dtype)
    for target, row in zip(stack, rows, strict=True):
        target[: row.size] = row
    return xr.Variable((ROWS, *first.dims), stack, first.attrs)


def _layout(record: xr.Dataset, truths: Sequence[str]) -> dict[str, Any]:
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


def _text(facts: Mapping[Any, Any]) -> str:
    return json.dumps(dict(facts), default=_plain)


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Translate what JSON lacks, numpy's numbers and rows of them."""
    return value.tolist()
