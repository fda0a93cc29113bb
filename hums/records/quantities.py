"""Quantities measured with a record, synchronous averages, and calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from hums.records.channels import (
    attach_time,
    channel_values,
    detach_time,
    measured_quantities,
    sampling,
    vibration_channels,
)
from hums.records.clock import held_times
from hums.records.fields import RATE_REMEDY, RecordError, positive_number, real_vector
from hums.records.validation import check_record
from signals._validation import checked

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

SPELLINGS: Mapping[str, tuple[str, float]] = {
    spelling: (stored, factor)
    for stored, factors in {
        "rev s-1": {"rev s-1": 1.0, "rev/s": 1.0, "Hz": 1.0, "rpm": 1 / 60, "rev/min": 1 / 60, "min-1": 1 / 60},
        "N m": {"N m": 1.0, "Nm": 1.0, "N·m": 1.0, "kN m": 1e3, "kNm": 1e3},
        "N": {"N": 1.0, "kN": 1e3},
        "degC": {"degC": 1.0, "°C": 1.0},
        "K": {"K": 1.0},
        "Pa": {"Pa": 1.0, "kPa": 1e3, "bar": 1e5},
        "W": {"W": 1.0, "kW": 1e3, "MW": 1e6},
        "A": {"A": 1.0},
        "V": {"V": 1.0},
        "m s-1": {"m s-1": 1.0, "m/s": 1.0},
        "1": {"1": 1.0, "%": 0.01},
    }.items()
    for spelling, factor in factors.items()
}
"""The unit of a measured quantity as stored, and the factor to it, by accepted spelling."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A speed, load or temperature measured with the record.

    Attributes
    ----------
    values : float or (n,) array_like
        One number for the record, or samples. NaN marks a gap.
    units : str
        Units such as "N m", "kN", "degC" or "rpm", see `hums.records.quantities.SPELLINGS`; the record holds SI
        units (speeds in rev s-1).
    rate_hz : float or None
        Sampling rate in Hz, if it differs from the record's.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> record = hums.make_record(
    ...     {"vib": np.zeros(1000)}, rate_hz=1000, angle=hums.UnknownAngle(), units="g",
    ...     measured={"force": hums.Measured(values=4.2, units="kN")})
    >>> float(record.force), record.force.units
    (4200.0, 'N')
    """

    values: ArrayLike
    units: str
    rate_hz: float | None = None


@dataclass(frozen=True, kw_only=True)
class AngularAverage:
    """Declares that a record is a synchronous average over one or more revolutions of a shaft or planet.

    Its samples are evenly spaced in the angle of one component; their times are unknown. An average over several
    revolutions may cover a hunting-tooth period.

    Attributes
    ----------
    component : str
        Link over whose revolution is averaged, as in the gearbox file; a copy with its number, "planet 1".
    samples_per_rev : int
        Samples per revolution, at least 8.
    averaged_over : int or None
        Number of revolutions (or periods) averaged; None if unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> average = hums.AngularAverage(component="input", samples_per_rev=512, averaged_over=100)
    >>> angle_rad = 2 * np.pi * np.arange(512) / 512
    >>> record = hums.make_record({"vib": np.cos(23 * angle_rad)}, angle=average, units="g")
    >>> float(record.angle[256]), record.attrs["average_of"]
    (0.5, 'input')
    """

    component: str
    samples_per_rev: int
    averaged_over: int | None = None

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of the record."""
        averaged = {} if self.averaged_over is None else {"averaged_over": self.averaged_over}
        return {"average_of": self.component, "samples_per_rev": self.samples_per_rev, **averaged}


def quantity_units(units: object, what: str) -> tuple[str, float]:
    """Return the unit of a measured quantity as stored in a record, and the factor to it."""
    if isinstance(units, str) and units.strip() in SPELLINGS:
        return SPELLINGS[units.strip()]
    known = ", ".join(f'"{spelling}"' for spelling in SPELLINGS)
    raise RecordError(f"{what}: units={units!r} are not known. Units of measured quantities are one of {known}.")


def measured_variable(measured: Measured, *, name: str, rate_hz: float, start_s: float) -> xr.Variable:
    """Return a measured quantity as a variable of the record, in SI units."""
    what = f'measured "{name}"'
    if not isinstance(measured, Measured):
        raise RecordError(f'{what}: {type(measured).__name__} given; use Measured(values=..., units="N m").')
    units, factor = quantity_units(measured.units, what)
    attrs: dict[str, Any] = {"units": units, "role": "measured"}
    if np.ndim(measured.values) == 0:
        number = float(real_vector(np.atleast_1d(np.asarray(measured.values)), what)[0])
        return xr.Variable((), number * factor, attrs)
    own_hz = rate_hz if measured.rate_hz is None else measured.rate_hz
    held, *_ = held_times(measured.values, what=what, rate_hz=own_hz, start_s=start_s)
    values = real_vector(held, what)
    values = values if factor == 1 else np.multiply(values, values.dtype.type(factor))
    own_hz = positive_number(own_hz, f"{what}: rate_hz", RATE_REMEDY)
    return along_time(name, values, attrs, own_hz=own_hz, rate_hz=rate_hz, start_s=start_s)


def along_time(
    name: str, values: NDArray[Any], attrs: Mapping[str, Any], *, own_hz: float, rate_hz: float, start_s: float
) -> xr.Variable:
    """Return samples along the time axis of a record or, at another rate, along their own."""
    if own_hz == rate_hz:
        return xr.Variable("time", values, attrs)
    return xr.Variable(f"time_{name}", values, {**attrs, "rate_hz": own_hz, "start_s": start_s})


def mean_quantities(record: xr.Dataset) -> dict[str, tuple[float, str]]:
    """Return the mean, gaps excluded, and the unit of each quantity measured with the record, unless it is all gaps."""
    found = {}
    for name in measured_quantities(record):
        values = np.asarray(record[name].values, dtype=np.float64)
        if np.isfinite(values).any():
            found[name] = (float(np.nanmean(values)), str(record[name].attrs["units"]))
    return found


_CALIBRATION = ("sensitivity", "measures", "calibration_factor", "delay_s")
_APPLIED = "applied_"


@checked
def calibrated(record: xr.Dataset) -> xr.Dataset:
    """Return a record in the units of the measured quantities, with channel delays removed.

    Samples become ``values / sensitivity * calibration_factor`` in the units that the channel ``measures``. A channel
    with a ``delay_s`` gets its own time axis, which starts earlier by that delay; samples are not interpolated. The
    values applied and the original units are stored in attributes named ``applied_...``.

    Parameters
    ----------
    record : xarray.Dataset
        Record whose channels have attributes ``sensitivity`` with ``measures``, ``calibration_factor`` or ``delay_s``
        (see `hums.Channel`). Channels without them are unchanged.

    Returns
    -------
    xarray.Dataset
        A new record.

    Raises
    ------
    RecordError
        If no channel declares a calibration, or it was already applied.

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
            f'channel "{earlier[0]}" is already calibrated, as its attributes applied_... show. Use the record as is.'
        )
    declared = [name for name in names if any(key in record[name].attrs for key in _CALIBRATION)]
    if not declared:
        raise RecordError(
            "nothing to calibrate: no channel declares a sensitivity, calibration_factor or delay_s; give them as "
            'Channel(..., units="V", sensitivity=0.1, measures="g"), or use the record as it is.'
        )
    result = attach_time(detach_time(record).assign({name: _calibrated(record, name) for name in declared}))
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
