"""Parts of a record: kind of each variable, sampling, time axes, pulse times.

The last dimension of a sampled variable is its axis: ``time``, ``time_NAME`` at its own rate, or ``angle`` of a
synchronous average. In a record of snapshots it is preceded by the dimension ``snapshot``.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.indexes import RangeIndex

from hums.records.fields import RATE_REMEDY, RecordError, positive_number, start_number

Kind = Literal["vibration", "waveform", "tachometer", "speed", "measured", "truth"]
SNAPSHOT, ANGLE = "snapshot", "angle"
_LEVELS = ("threshold", "hysteresis")  # at which the pulses of a tachometer were found


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """Sampling of a channel: sample `i` of `count` is at `start_s + i / rate_hz`.

    Attributes
    ----------
    start_s : float
        Time of the first sample in s.
    rate_hz : float
        Sampling rate in Hz.
    count : int
        Number of samples.
    """

    start_s: float
    rate_hz: float
    count: int


def kind_of(name: str, variable: xr.DataArray | xr.Variable) -> Kind | None:
    """Return the kind of a variable of a record; None if it does not belong to one."""
    if name.startswith("truth_"):
        return "truth"
    if name == "nominal_speed":
        return "speed"
    if any(str(dim).startswith("pulse_") for dim in variable.dims):
        return "tachometer"
    role: dict[Any, Kind] = {"vibration": "vibration", "tachometer": "waveform", "measured": "measured"}
    return role.get(variable.attrs.get("role"))


def names_of(record: xr.Dataset, *kinds: Kind) -> list[str]:
    """Return the names of the variables of some kinds, in the order of the record."""
    variables = record.variables  # cheaper than `data_vars`, which adds coordinates
    return [str(name) for name in record.data_vars if kind_of(str(name), variables[name]) in kinds]


def sampling_attrs(record: xr.Dataset, variable: xr.DataArray | xr.Variable) -> Mapping[str, Any]:
    """Return the attributes with a channel's rate_hz and start_s: its own if it has its own rate, else the record's.

    For a synchronous average they are the samples per revolution, and zero.
    """
    match variable.dims[-1:]:
        case ("time",):
            return record.attrs
        case ("angle",):
            return {"rate_hz": record.attrs.get("samples_per_rev"), "start_s": 0.0}
        case _:
            return variable.attrs


def rate_of(record: xr.Dataset, variable: xr.DataArray | xr.Variable) -> Any:  # noqa: ANN401
    """Return the declared sampling rate of a channel in Hz, unchecked."""
    return sampling_attrs(record, variable).get("rate_hz")


def vibration_channels(record: xr.Dataset) -> list[str]:
    """Return the names of the vibration channels, in the order of the record."""
    return names_of(record, "vibration")


def tachometers(record: xr.Dataset) -> list[str]:
    """Return the names of the tachometers, variables of pulse times, in the order of the record."""
    return names_of(record, "tachometer")


def measured_quantities(record: xr.Dataset) -> list[str]:
    """Return the names of the quantities measured with the record, such as loads and temperatures."""
    return names_of(record, "measured")


def is_average(record: xr.Dataset) -> bool:
    """Return whether a record is a synchronous average."""
    return "samples_per_rev" in record.attrs


def nominal_speed(record: xr.Dataset) -> xr.DataArray | None:
    """Return the declared constant speed in rev s-1, one per snapshot, with attribute `shaft`; None without one."""
    return record.get("nominal_speed")


def sampling(record: xr.Dataset, channel: str) -> Sampling:
    """Return the sampling of a channel, also of a slice of a record; refuse an uneven time axis.

    For a record of snapshots this is the sampling of each snapshot; for a synchronous average it is in revolutions.
    """
    variable = record.variables[channel]
    dim = str(variable.dims[-1])
    index = record.xindexes.get(dim)
    rate = float(rate_of(record, variable))
    count = variable.sizes[dim]
    # more than half a sample of drift over the record would shift samples
    if not isinstance(index, RangeIndex) or abs(index.step * rate - 1) * count > 0.5:  # noqa: PLR2004
        raise RecordError(
            f'channel "{channel}": its axis "{dim}" is not evenly spaced at rate_hz={rate:g}. Read files with '
            "open_record; to reduce the rate, filter first and build a new record, as a stride aliases."
        )
    return Sampling(start_s=float(index.start), rate_hz=rate, count=count)


def layout_of(record: xr.Dataset) -> dict[str, Any]:
    """Return rate, and lengths and attributes of the variables of a record, but ground truth, as JSON types.

    What depends on the pulses of a tachometer is left out: their number, and the levels at which they were found.
    """
    found: dict[str, Any] = {name: record.attrs.get(name) for name in ("rate_hz", "samples_per_rev")}
    for name, one in record.variables.items():
        if (kind := kind_of(str(name), one)) not in {None, "truth"}:
            lengths = one.shape[: -1 if kind == "tachometer" else None]
            attrs = {str(key): value for key, value in one.attrs.items() if key not in _LEVELS}
            found[str(name)] = {"lengths": lengths, **attrs}
    return dict(json.loads(json.dumps(found, default=lambda value: np.asarray(value).tolist())))


def other_layout(own: Mapping[str, Any], first: Mapping[str, Any]) -> str:
    """Return in words what differs between a layout and that of the first record, nothing if they are equal."""
    for name in (*first, *own):
        here, there = own.get(name, "missing"), first.get(name, "missing")
        one_rate = isinstance(here, float) and isinstance(there, float) and math.isclose(here, there, rel_tol=1e-5)
        if here != there and not one_rate:  # rates found from sample times scatter
            return f'"{name}" is {here}, but {there} in the first'
    return ""


def stacked(parts: Sequence[xr.Variable], dim: str, dtype: str | None = None) -> xr.Variable:
    """Return variables of one layout stacked along a new first dimension, shorter ones padded with NaN."""
    first, values = parts[0], [part.to_numpy() for part in parts]
    longest = np.max([one.shape for one in values], axis=0).astype(np.int64)
    stack = np.full((len(parts), *longest), np.nan, dtype=first.dtype if dtype is None else dtype)
    for number, one in enumerate(values):
        where: tuple[Any, ...] = (number, *map(slice, one.shape))
        stack[where] = one
    own = {key for key in _LEVELS if any(part.attrs.get(key) != first.attrs.get(key) for part in parts)}
    return xr.Variable((dim, *first.dims), stack, {key: x for key, x in first.attrs.items() if key not in own})


def channel_values(record: xr.Dataset, name: str) -> NDArray[np.floating]:
    """Return the samples of one variable of a record; errors name the damaged file.

    Returns
    -------
    (n,) array
        Samples in the units of the variable.
    """
    try:
        return record[name].values
    except OSError as error:
        source = record.encoding.get("source", "the file behind this record")
        raise RecordError(
            f'{source}: "{name}" cannot be read ({error}). The file is damaged: its bytes no longer match '
            "their checksum. Restore it, or convert the original again."
        ) from error


def attach_time(dataset: xr.Dataset) -> xr.Dataset:
    """Return a record with a time axis for every channel, as a range computed from start, count and rate."""
    for name in _sampled(dataset):
        variable = dataset.variables[name]
        if variable.ndim != 1 + (SNAPSHOT in variable.dims[:-1]):
            raise RecordError(f'channel "{name}": shape {variable.shape}; a channel has one dimension.')
        if variable.size == 0:
            raise RecordError(f'channel "{name}": empty; at least one sample is needed.')
        dim = str(variable.dims[-1])
        if isinstance(dataset.xindexes.get(dim), RangeIndex):
            continue
        rate = positive_number(rate_of(dataset, variable), f'channel "{name}": rate_hz', RATE_REMEDY)
        if dim in dataset.coords:  # stored as numbers by other software
            start = _stored_start(dataset[dim], name=name, rate_hz=rate)
            dataset = dataset.drop_vars(dim)
        else:
            stated = sampling_attrs(dataset, variable).get("start_s")
            start = start_number(stated, f'channel "{name}": start_s', rate_hz=rate)
        count = variable.sizes[dim]
        index = RangeIndex.linspace(start, start + count / rate, num=count, endpoint=False, dim=dim)
        dataset = dataset.assign_coords(xr.Coordinates.from_xindex(index))
    return dataset


def _sampled(record: xr.Dataset) -> list[str]:
    """Return the names of the variables with an axis of time or angle."""
    names = names_of(record, "vibration", "waveform", "measured")
    return [name for name in names if record.variables[name].dims not in ((), (SNAPSHOT,))]


def _stored_start(axis: xr.DataArray, *, name: str, rate_hz: float) -> float:
    """Return the start of a stored time axis in s; refuse an axis that contradicts the rate."""
    if axis.dtype.kind not in "iuf":
        raise RecordError(f'channel "{name}": its axis "{axis.name}" is of type {axis.dtype}; seconds are needed.')
    first, last = float(axis[0]), float(axis[-1])
    if not abs((last - first) * rate_hz - (axis.size - 1)) <= 0.5:  # noqa: PLR2004 - as in `sampling`, and for NaN
        raise RecordError(
            f'channel "{name}": its axis "{axis.name}", {axis.size} samples from {first:g} s to {last:g} s, is not '
            f"evenly spaced at rate_hz={rate_hz:g}. Correct the rate; filter a record before reducing its rate."
        )
    return first


def detach_time(record: xr.Dataset) -> xr.Dataset:
    """Return a record without time axes and with their starts in attributes, the inverse of `attach_time`."""
    axes = set()
    for name in _sampled(record):
        when = sampling(record, name)
        dim = str(record.variables[name].dims[-1])
        axes.add(dim)
        if dim == ANGLE:
            continue
        if dim == "time":
            record = record.assign_attrs(start_s=when.start_s)
        else:
            record = record.assign({name: record[name].assign_attrs(start_s=when.start_s)})
    return record.drop_vars(axes)


def speed_percentiles(pulses: xr.DataArray) -> tuple[float, float, float] | None:
    """Return the median and the 1st and 99th percentiles of the speed per revolution in rev/s, from pulse times.

    Missing and spurious pulses are not repaired. None for less than a revolution.
    """
    times_s, per_rev = pulses.values, int(pulses.attrs["pulses_per_rev"])
    if times_s.size <= per_rev:
        return None
    middle, low, high = np.percentile(1 / (times_s[per_rev:] - times_s[:-per_rev]), [50, 1, 99])
    return float(middle), float(low), float(high)
