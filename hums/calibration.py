"""What the chain from sensor to file did to a record, undone once and noted as done."""

from typing import Any

import numpy as np
import xarray as xr

from hums.record import RecordError, attach_time, channel_values, check_record, sampling, vibration_channels

__all__ = ["calibrated"]

_KNOWN = ("sensitivity", "measures", "calibration_factor", "delay_s")
_APPLIED = "applied_"


def calibrated(record: xr.Dataset) -> xr.Dataset:
    """Return the record in engineering units, on the machine's clock.

    Samples become ``values / sensitivity * calibration_factor`` in the units that the channel ``measures``. A channel
    with a ``delay_s`` gets a time axis of its own that starts so much earlier: no sample is interpolated. What was
    applied stands in attributes named ``applied_...``, with the units from before.

    Parameters
    ----------
    record : xarray.Dataset
        Channels with some of the attributes ``sensitivity`` and ``measures``, ``calibration_factor``, ``delay_s``: see
        `hums.Channel`. A channel without any stays as it is.

    Returns
    -------
    xarray.Dataset
        A record; the one given is not changed.

    Raises
    ------
    RecordError
        Where nothing is declared, or it was applied before.
    """
    check_record(record)
    names = vibration_channels(record)
    done = [name for name in names if any(str(key).startswith(_APPLIED) for key in record[name].attrs)]
    if done:
        raise RecordError(
            f'channel "{done[0]}" was calibrated before: its attributes say what was applied. Use it as it is.'
        )
    declared = [name for name in names if any(key in record[name].attrs for key in _KNOWN)]
    if not declared:
        raise RecordError(
            "nothing to calibrate: no channel declares a sensitivity, calibration_factor or delay_s; give them as "
            'Channel(..., units="V", sensitivity=0.1, measures="g"), or use the record as it is.'
        )
    delayed = [f"time_{name}" for name in declared if record[name].attrs.get("delay_s")]
    found = record.drop_vars([axis for axis in delayed if axis in record.coords])  # they start anew
    found = found.assign({name: _calibrated(record, name) for name in declared})
    used = {dim for name in found.data_vars for dim in found[name].dims}
    found = attach_time(found.drop_vars([axis for axis in found.coords if axis not in used]))[list(record.data_vars)]
    check_record(found)
    return found


def _calibrated(record: xr.Dataset, name: str) -> xr.Variable:
    attrs: dict[str, Any] = dict(record[name].attrs)
    known = {key: attrs.pop(key) for key in _KNOWN if key in attrs}
    values = channel_values(record, name)
    factor = known.get("calibration_factor", 1.0) / known.get("sensitivity", 1.0)
    attrs |= {f"{_APPLIED}{key}": value for key, value in known.items() if key != "measures"}
    if "measures" in known:
        attrs |= {f"{_APPLIED}to_units": attrs["units"], "units": known["measures"]}
    scaled = np.multiply(values, values.dtype.type(factor)) if factor != 1 else values
    when = sampling(record, name)
    if not known.get("delay_s"):
        return xr.Variable(record[name].dims, scaled, attrs)
    attrs |= {"rate_hz": when.rate_hz, "start_s": when.start_s - known["delay_s"]}
    return xr.Variable(f"time_{name}", scaled, attrs)
