"""Validation of records."""

from numbers import Integral

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.records.channels import (
    ANGLE,
    SNAPSHOT,
    is_average,
    kind_of,
    names_of,
    nominal_speed,
    rate_of,
    sampling,
    tachometers,
    vibration_channels,
)
from hums.records.fields import (
    ANGLE_REMEDY,
    RATE_REMEDY,
    SCHEMA,
    UNKNOWN_ANGLE,
    RecordError,
    known_units,
    plain_repr,
    positive_number,
    utc_text,
)

MIN_SAMPLES_PER_PULSE = 1.5  # at 1 they would be the sample times


def check_record(record: xr.Dataset) -> None:
    """Refuse a dataset that is not a valid record. Vibration samples are not read.

    Raises
    ------
    RecordError
        If it is not a record.
    """
    if not isinstance(record, xr.Dataset):
        raise RecordError(f"a record must be an xarray.Dataset, not {type(record).__name__}; see make_record.")
    if (schema := record.attrs.get("schema")) != SCHEMA:
        raise RecordError(f'attribute schema={schema!r}: a record has "{SCHEMA}"; build it with make_record.')
    if is_average(record):
        _check_average(record)
    else:
        positive_number(record.attrs.get("rate_hz"), "attribute rate_hz", RATE_REMEDY)
    recorded_at = record.attrs.get("recorded_at", "")
    if not isinstance(recorded_at, str):
        raise RecordError(f"attribute recorded_at={plain_repr(recorded_at)}: text is needed, a time in ISO 8601.")
    utc_text(recorded_at)
    if not vibration_channels(record):
        raise RecordError("no vibration channel: a record needs at least one; name it in channels.")
    for name, variable in record.data_vars.items():
        _check_variable(record, str(name), variable)
    if SNAPSHOT in record.dims:
        _check_snapshots(record)
    if not is_average(record):
        _check_angle(record)


def _check_average(record: xr.Dataset) -> None:
    """Refuse a synchronous average that is not of whole revolutions, or has a source of shaft angle."""
    for attr, least in (("samples_per_rev", 8), ("averaged_over", 1)):  # 8: three orders, and the passband's margin
        value = record.attrs.get(attr, least)
        if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
            raise RecordError(f"{attr}={plain_repr(value)}: a whole number of at least {least} is needed.")
    if not isinstance(record.attrs.get("average_of"), str) or not record.attrs["average_of"]:
        raise RecordError("component (attribute average_of): name the link over whose revolution is averaged.")
    if tachometers(record) or nominal_speed(record) is not None:
        raise RecordError("a synchronous average has no tachometer and no speed; omit them.")
    for name in vibration_channels(record):
        count = record[name].size
        if record[name].dims != (ANGLE,):
            raise RecordError(
                f'channel "{name}": dimensions {record[name].dims}; a synchronous average has one, "angle", and no '
                "rate_hz of a channel; omit it."
            )
        if count % (per_rev := int(record.attrs["samples_per_rev"])):
            raise RecordError(
                f'channel "{name}": {count} samples are {count / per_rev:.6g} revolutions of {per_rev} samples; an '
                "average must have whole revolutions. Correct samples_per_rev, or cut the samples."
            )


def _check_snapshots(record: xr.Dataset) -> None:
    """Refuse snapshots whose times overlap or run backwards, and channels without snapshots."""
    for name in names_of(record, "vibration", "waveform", "tachometer"):
        if record[name].dims[0] != SNAPSHOT:
            raise RecordError(f'"{name}" lacks the dimension "{SNAPSHOT}" of the others; join complete records.')
    if "snapshot_s" not in record.coords:
        return
    starts_s = np.asarray(record["snapshot_s"].values, dtype=np.float64)
    long_s = max(when.count / when.rate_hz for when in (sampling(record, name) for name in vibration_channels(record)))
    if starts_s.shape != (record.sizes[SNAPSHOT],) or not np.isfinite(starts_s).all():
        raise RecordError('"snapshot_s": a finite time in s for each snapshot is needed, or none at all.')
    # an overlap of 1 % is accepted, as clocks may be stored in whole milliseconds
    early = np.flatnonzero(np.diff(starts_s) < 0.99 * long_s)
    if early.size:
        at = int(early[0])
        raise RecordError(
            f"snapshot {at + 1} begins {starts_s[at + 1] - starts_s[at]:.6g} s after snapshot {at}, which lasts "
            f"{long_s:.6g} s; snapshots must not overlap and must be in chronological order."
        )


def _check_variable(record: xr.Dataset, name: str, variable: xr.DataArray) -> None:
    kind = kind_of(name, variable)
    if kind is None:
        raise RecordError(
            f'variable "{name}" does not belong in a record: a channel has the attributes role="vibration" and '
            "units; ground truth of a synthetic record is named truth_..."
        )
    if kind in {"vibration", "waveform"}:
        _check_channel(record, name, variable)
    elif kind == "tachometer":
        _check_tachometer(name, variable)
    elif kind == "speed":
        for value in np.atleast_1d(variable.values):
            positive_number(value, "nominal_speed", "state the speed of the shaft in rev s-1")
        _check_shaft("nominal_speed", variable)
    elif kind == "measured" and (variable.dtype.kind != "f" or variable.ndim > 1 + (SNAPSHOT in variable.dims)):
        raise RecordError(
            f'measured "{name}": {variable.ndim}-D {variable.dtype}; a number or a row of them is needed.'
        )


def _check_channel(record: xr.Dataset, name: str, variable: xr.DataArray) -> None:
    what = f'channel "{name}"'
    axis = variable.dims[1:] if variable.dims[:1] == (SNAPSHOT,) else variable.dims
    if len(axis) != 1 or not (axis[0] in {"time", ANGLE} or str(axis[0]).startswith("time_")):
        raise RecordError(
            f'{what}: dimensions {variable.dims}; a channel has one, "time" or, at its own rate, "time_{name}".'
        )
    if variable.dtype not in (np.float32, np.float64):
        raise RecordError(f"{what}: values of type {variable.dtype}; float32 or float64 are needed.")
    if variable.size == 0:
        raise RecordError(f"{what}: empty; at least one sample is needed.")
    units = variable.attrs.get("units")
    if known_units(units, what) != units:
        raise RecordError(f'{what}: units="{units}" must be written "{known_units(units, what)}" in a record.')
    positive_number(rate_of(record, variable), f"{what}: rate_hz", RATE_REMEDY)
    sampling(record, name)


def _check_angle(record: xr.Dataset) -> None:
    names, nominal = tachometers(record), nominal_speed(record)
    if not names and nominal is None and record.attrs.get("angle") != UNKNOWN_ANGLE:
        raise RecordError(f"angle: this record has no source of shaft angle. {ANGLE_REMEDY}")
    if names and nominal is not None:
        raise RecordError(f'angle: both nominal_speed and tachometer "{names[0]}" are given. {ANGLE_REMEDY}')
    spans = [sampling(record, name) for name in vibration_channels(record)]
    first_s = min(span.start_s for span in spans)
    last_s = max(span.start_s + span.count / span.rate_hz for span in spans)
    for name in names:
        for times_s in _each_train(record[name]):
            _check_span(name, times_s, first_s, last_s)
    _check_speeds(record)


def _each_train(pulses: xr.DataArray) -> list[NDArray[np.float64]]:
    """Return the pulse times of each snapshot, or those of the record, without padding."""
    rows = pulses.values if pulses.ndim > 1 else [pulses.values]
    return [row[~np.isnan(row)] if pulses.ndim > 1 else row for row in rows]


def _check_span(name: str, times_s: NDArray[np.float64], first_s: float, last_s: float) -> None:
    if times_s[-1] < first_s or times_s[0] > last_s:
        raise RecordError(
            f'tachometer "{name}": its pulses, {times_s[0]:g} s to {times_s[-1]:g} s, lie outside the '
            f"record, {first_s:g} s to {last_s:g} s. Pulse times must be in seconds (not sample numbers) on the "
            "record's clock, which is start_s at the first sample."
        )


def _check_speeds(record: xr.Dataset) -> None:
    """Refuse a shaft speed or pulse rate that is too high for the highest sampling rate of the record."""
    rate_hz = max(sampling(record, name).rate_hz for name in names_of(record, "vibration", "waveform"))
    nominal = nominal_speed(record)
    fastest = 0.0 if nominal is None else float(np.max(nominal.values))
    if fastest >= rate_hz / 2:
        raise RecordError(
            f"nominal speed: {fastest * 60:g} rpm is {fastest:g} rev/s, which samples at "
            f"{rate_hz:g} Hz cannot resolve; it must be below {rate_hz / 2:g}. Correct the speed (rpm) or the rate."
        )
    for name in tachometers(record):
        for times_s in _each_train(record[name]):
            _check_spacing(name, times_s, int(record[name].attrs["pulses_per_rev"]), rate_hz)


def _check_spacing(name: str, times_s: NDArray[np.float64], per_rev: int, rate_hz: float) -> None:
    """Refuse pulse times that are too dense for `rate_hz` or too irregular for a shaft."""
    spacing_s = (times_s[-1] - times_s[0]) / (times_s.size - 1)
    what = f'tachometer "{name}": its pulses are {spacing_s:.3g} s apart on average'
    if spacing_s * rate_hz < MIN_SAMPLES_PER_PULSE:
        raise RecordError(
            f"{what}, {spacing_s * rate_hz:.3g} samples at {rate_hz:g} Hz, about one pulse per sample or more. Give "
            "the pulse times in seconds, not the sample times; or correct the rate."
        )
    min_samples_per_turn = 4.0  # of the vibration: the shaft's second harmonic at half the sampling rate
    if spacing_s * per_rev * rate_hz < min_samples_per_turn:
        raise RecordError(
            f"{what}, which at {per_rev} per revolution is {1 / (spacing_s * per_rev):.4g} rev/s, a revolution in "
            f"{spacing_s * per_rev * rate_hz:.3g} samples at {rate_hz:g} Hz, too few for the vibration of the shaft. "
            "Correct the times (seconds), pulses_per_rev (--pulses-per-rev) or the rate."
        )
    intervals = np.diff(times_s)
    if intervals.size < per_rev + 20:  # for a meaningful median of their changes
        return
    # pulses of one revolution may be uneven, or revolutions differ during a run-up, but not both
    change = min(
        float(np.median(np.abs(intervals[lag:] - intervals[:-lag])) / np.median(intervals)) for lag in (1, per_rev)
    )
    max_change_per_turn = 0.3  # some per cent for a shaft, some 60 % for random crossings
    if change > max_change_per_turn:
        raise RecordError(
            f"{what}, but irregular: from pulse to pulse and from revolution to revolution, their spacing changes by "
            f"{change:.0%} (median). No shaft rotates like that; the signal may be vibration. Name the channel or "
            "pulse times of the tachometer (--tach-waveform, --tach-times)."
        )


def _check_tachometer(name: str, variable: xr.DataArray) -> None:
    what = f'tachometer "{name}"'
    if variable.ndim != 1 + (SNAPSHOT in variable.dims) or variable.dtype != np.float64:
        raise RecordError(f"{what}: {variable.ndim}-D {variable.dtype}; a row of float64 times is needed.")
    pulses = variable.attrs.get("pulses_per_rev")
    most_pulses = 1_000_000  # more than any encoder has per revolution
    if not isinstance(pulses, Integral) or isinstance(pulses, bool) or not 0 < int(pulses) <= most_pulses:
        raise RecordError(
            f"{what}: pulses_per_rev={plain_repr(pulses)}: a positive whole number, at most {most_pulses}, is needed "
            "(--pulses-per-rev)."
        )
    _check_shaft(what, variable)
    for times_s in _each_train(variable):
        _check_pulses(what, times_s)


def _check_shaft(what: str, variable: xr.DataArray) -> None:
    shaft = variable.attrs.get("shaft")
    if not isinstance(shaft, str) or not shaft:
        raise RecordError(
            f'{what}: shaft={plain_repr(shaft)}; name the shaft that it refers to, shaft="..." (--shaft).'
        )


def _check_pulses(what: str, times_s: NDArray[np.float64]) -> None:
    if times_s.size < 2:  # noqa: PLR2004 - a speed is a difference
        raise RecordError(f"{what}: {times_s.size} pulse; at least 2 are needed to determine a speed.")
    bad = np.flatnonzero(~np.isfinite(times_s))
    if bad.size:
        raise RecordError(f"{what}: pulse {bad[0]} is at {times_s[bad[0]]}; omit pulses whose time is unknown.")
    repeated = np.flatnonzero(np.diff(times_s) <= 0)
    if repeated.size:
        at = repeated[0]
        raise RecordError(
            f"{what}: its times must increase, but pulse {at} is at {times_s[at]:.9g} s and pulse {at + 1} at "
            f"{times_s[at + 1]:.9g} s ({repeated.size} such pulses of {times_s.size}). Remove repeated pulses; if "
            "these are samples of the tachometer signal and not times, give them as a TachometerWaveform "
            "(on the command line --tach-waveform)."
        )
