"""Calibration of records: sensitivity, calibration factor and delay of each channel."""

from typing import Any

import numpy as np
import xarray as xr

from hums.records.channels import attach_time, channel_values, sampling, vibration_channels
from hums.records.fields import RecordError
from hums.records.validation import check_record
from signals._validation import checked

_CALIBRATION = ("sensitivity", "measures", "calibration_factor", "delay_s")
_APPLIED = "applied_"


@checked
def calibrated(record: xr.Dataset) -> xr.Dataset:
    """Return a record in the units of the measured quantities, with its delays removed.

    Samples become ``values / sensitivity * calibration_factor`` in the units that the channel ``measures``. A channel
    with a ``delay_s`` gets a time axis of its own that starts that much earlier: no sample is interpolated. The values
    applied are stored in attributes named ``applied_...``, with the earlier units.

    Parameters
    ----------
    record : xarray.Dataset
        Record with channels that have some of the attributes ``sensitivity`` and ``measures``,
        ``calibration_factor``, ``delay_s`` (see `hums.Channel`). Channels without them are not changed.

    Returns
    -------
    xarray.Dataset
        A new record.

    Raises
    ------
    RecordError
        Where no channel declares a calibration, or it was applied before.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> channel = hums.Channel(values=np.full(1000, 0.2), units="V", sensitivity=0.1, measures="g")
    >>> record = hums.make_record({"vib": channel}, rate_hz=1000, angle=hums.UnknownAngle())
    >>> vib = hums.calibrated(record).vib
    >>> float(vib[0]), vib.units
    (2.0, 'g')
    """
    check_record(record)
    names = vibration_channels(record)
    earlier = [name for name in names if any(str(key).startswith(_APPLIED) for key in record[name].attrs)]
    if earlier:
        raise RecordError(
            f'channel "{earlier[0]}" was calibrated before: its attributes list what was applied. Use it as it is.'
        )
    declared = [name for name in names if any(key in record[name].attrs for key in _CALIBRATION)]
    if not declared:
        raise RecordError(
            "nothing to calibrate: no channel declares a sensitivity, calibration_factor or delay_s; give them as "
            'Channel(..., units="V", sensitivity=0.1, measures="g"), or use the record as it is.'
        )
    delayed = [f"time_{name}" for name in declared if record[name].attrs.get("delay_s")]
    result = record.drop_vars([axis for axis in delayed if axis in record.coords])  # their new axes start earlier
    result = result.assign({name: _calibrated(record, name) for name in declared})
    used = {dim for name in result.data_vars for dim in result[name].dims}
    result = attach_time(result.drop_vars([axis for axis in result.coords if axis not in used]))[list(record.data_vars)]
    check_record(result)
    return result


def _calibrated(record: xr.Dataset, name: str) -> xr.Variable:
    """Return a channel with its calibration applied."""
    attrs: dict[str, Any] = dict(record[name].attrs)
    calibration = {key: attrs.pop(key) for key in _CALIBRATION if key in attrs}
    values = channel_values(record, name)
    factor = calibration.get("calibration_factor", 1.0) / calibration.get("sensitivity", 1.0)
    attrs |= {f"{_APPLIED}{key}": value for key, value in calibration.items() if key != "measures"}
    if "measures" in calibration:
        attrs |= {f"{_APPLIED}to_units": attrs["units"], "units": calibration["measures"]}
    scaled = np.multiply(values, values.dtype.type(factor)) if factor != 1 else values
    times = sampling(record, name)
    if not calibration.get("delay_s"):
        return xr.Variable(record[name].dims, scaled, attrs)
    attrs |= {"rate_hz": times.rate_hz, "start_s": times.start_s - calibration["delay_s"]}
    return xr.Variable(f"time_{name}", scaled, attrs)
