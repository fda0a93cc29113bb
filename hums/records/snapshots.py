"""Records of snapshots: many short segments of the same channels, each with its own time."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from hums.records.channels import (
    SNAPSHOT,
    attach_time,
    detach_time,
    kind_of,
    layout_of,
    other_layout,
    stacked,
    tachometers,
)
from hums.records.fields import RecordError
from hums.records.validation import check_record
from signals._validation import brief, checked


def is_snapshots(record: xr.Dataset) -> bool:
    """Return whether a record consists of snapshots."""
    return SNAPSHOT in record.dims


@checked
def join_snapshots(records: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join short records of one machine into one record of snapshots.

    Parameters
    ----------
    records : sequence of xarray.Dataset
        Records in chronological order, with the same layout, rate, length and attributes. The snapshots have times if
        all records state `recorded_at`, else only an order.

    Returns
    -------
    xarray.Dataset
        Each channel (snapshot, time), with time from the start of each snapshot; pulse times (snapshot, pulse_NAME),
        padded with NaN; declared speeds and quantities measured once (snapshot,). The coordinate `snapshot_s` is the
        start of each in s after `recorded_at`. `snapshot_record` extracts one.

    Raises
    ------
    RecordError
        If there are none, or they differ in layout or overlap in time.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> angle = hums.NominalSpeed(rpm=1800, shaft="input")
    >>> records = [
    ...     hums.make_record({"vib": np.zeros(2560)}, rate_hz=25600, units="g", angle=angle, recorded_at=when)
    ...     for when in ("2010-12-01T09:39:39Z", "2010-12-01T09:39:49Z")
    ... ]
    >>> record = hums.join_snapshots(records)
    >>> dict(record.vib.sizes), record.snapshot_s.values.tolist()
    ({'snapshot': 2, 'time': 2560}, [0.0, 10.0])
    """
    if not records:
        raise RecordError("no record to join: give the snapshots in chronological order.")
    for record in records:
        check_record(record)
        if is_snapshots(record) or "samples_per_rev" in record.attrs:
            raise RecordError("a snapshot must be a record of one time segment, not of snapshots and not an average.")
    first = detach_time(records[0])
    plain = [_starting_at(detach_time(record), first.attrs["start_s"]) for record in records]
    layout = layout_of(first) | _common_attrs(first)
    for number, record in enumerate(plain):
        if differs := other_layout(layout_of(record) | _common_attrs(record), layout):
            raise RecordError(
                f"snapshot {number}: {differs}; snapshots must have the same channels, lengths and attributes."
            )
    variables = {name: stacked([record.variables[name] for record in plain], SNAPSHOT) for name in first.data_vars}
    joined = attach_time(xr.Dataset(variables, attrs=first.attrs))
    when = [record.attrs["recorded_at"] for record in plain]
    if all(when):
        moments = [datetime.fromisoformat(text).timestamp() for text in when]
        starts_s = np.array([moment - moments[0] for moment in moments])
        joined = joined.assign_coords(snapshot_s=(SNAPSHOT, starts_s, {"units": "s", "long_name": "after recorded_at"}))
    check_record(joined)
    return joined


@checked
def snapshot_record(record: xr.Dataset, number: int) -> xr.Dataset:
    """Return one snapshot of a record of snapshots as a separate record.

    Parameters
    ----------
    record : xarray.Dataset
        Record of snapshots.
    number : int
        Number of the snapshot, from 0.

    Returns
    -------
    xarray.Dataset
        A record; `recorded_at` is that of the snapshot, if its time is known.

    Raises
    ------
    RecordError
        If the record has no such snapshot.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> angle = hums.NominalSpeed(rpm=1800, shaft="input")
    >>> short = hums.make_record({"vib": np.arange(2560.0)}, rate_hz=25600, units="g", angle=angle)
    >>> record = hums.join_snapshots([short, short])
    >>> hums.snapshot_record(record, 1).identical(short)
    True
    """
    count = record.sizes.get(SNAPSHOT, 0)
    if isinstance(number, bool) or not isinstance(number, int | np.integer) or not 0 <= number < count:
        raise RecordError(f"the record has no snapshot {brief(number)}; its {count} snapshots are numbered from 0.")
    one = record.isel({SNAPSHOT: number})
    if "snapshot_s" in one.coords:
        began = datetime.fromisoformat(record.attrs["recorded_at"])
        after = float(one["snapshot_s"])
        moment = datetime.fromtimestamp(began.timestamp() + after, tz=began.tzinfo).isoformat().replace("+00:00", "Z")
        one = one.drop_vars("snapshot_s").assign_attrs(recorded_at=moment)
    padded = {name: one.variables[name] for name in tachometers(one)}
    trains = {name: times.isel({times.dims[0]: ~np.isnan(times.to_numpy())}) for name, times in padded.items()}
    one = one.drop_vars(padded).assign(trains)
    check_record(one)
    return one


def snapshots_of(record: xr.Dataset) -> Iterator[xr.Dataset]:
    """Yield the snapshots of a record one after another."""
    for number in range(record.sizes[SNAPSHOT]):
        yield snapshot_record(record, number)


def _starting_at(record: xr.Dataset, start_s: float) -> xr.Dataset:
    """Return a record with its clock shifted to another time at its first sample."""
    late_s = record.attrs["start_s"] - start_s
    if not late_s:
        return record
    moved = record.assign_attrs(start_s=start_s)
    for name, variable in record.variables.items():
        if kind_of(str(name), variable) == "tachometer":
            moved[name] = variable.copy(data=variable.to_numpy() - late_s)
        elif "start_s" in variable.attrs:
            moved[name] = variable.copy(deep=False)
            moved[name].attrs["start_s"] = variable.attrs["start_s"] - late_s
    return moved


def _common_attrs(record: xr.Dataset) -> dict[str, Any]:
    """Return the attributes in which snapshots must agree."""
    own = {"recorded_at", "source", "notes"}
    return {str(key): str(value) for key, value in record.attrs.items() if key not in own}
