"""Records: vibration channels and one source of shaft angle in an `xarray.Dataset`.

`make_record` builds a record, `check_record` validates one. Undeclared units and rates are refused, never guessed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from hums.records.channels import ANGLE, attach_time
from hums.records.clock import held_times, time_scale
from hums.records.fields import (
    ANGLE_REMEDY,
    RATE_REMEDY,
    SCHEMA,
    UNKNOWN_ANGLE,
    RecordError,
    check_name,
    direction_of,
    finite_number,
    known_units,
    plain_repr,
    positive_number,
    real_vector,
    start_number,
    utc_text,
)
from hums.records.quantities import AngularAverage, Measured, along_time, measured_variable
from hums.records.validation import check_record
from signals._validation import plain_text

if TYPE_CHECKING:
    from collections.abc import Iterable
    from datetime import datetime

    from numpy.typing import ArrayLike

    from signals.shaft.pulses import PulseTrain


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One measured channel.

    Attributes
    ----------
    values : (n,) array_like
        Samples in `units`. NaN marks a gap.
    units : str
        One of `UNITS`, in any accepted spelling.
    sensor : str
        Name of the sensor.
    direction : (3,) tuple of float, str or None
        Sensitive axis, in the gearbox's coordinates or in words.
    rate_hz : float or None
        Sampling rate in Hz, if it differs from the record's.
    sensitivity : float or None
        Output in `units` per unit of `measures`, such as 0.1 V per g; negative if the sensor is mounted in the opposite
        direction. It is stored, not applied: see `hums.calibrated`.
    measures : str or None
        Units of the measured quantity; required with `sensitivity`.
    calibration_factor : float or None
        True value over the value from `sensitivity`, as found by the last calibration.
    delay_s : float or None
        Delay of the channel relative to the machine, in s.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> channel = hums.Channel(values=np.zeros(1000), units="m/s²", direction=(0, 0, 1))
    >>> record = hums.make_record({"vertical": channel}, rate_hz=1000, angle=hums.UnknownAngle())
    >>> record.vertical.units
    'm s-2'
    """

    values: ArrayLike
    units: str
    sensor: str = ""
    direction: tuple[float, float, float] | str | None = None
    rate_hz: float | None = None
    sensitivity: float | None = None
    measures: str | None = None
    calibration_factor: float | None = None
    delay_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class PulseTimes:
    """Pulse times of a tachometer.

    Attributes
    ----------
    times_s : (m,) array_like
        Strictly increasing times in s, on the clock of the record (`start_s` at its first sample).
    shaft : str
        Shaft that carries the tachometer.
    pulses_per_rev : int
        Pulses per revolution of that shaft.
    name : str
        Name of the tachometer in the record.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> pulses = hums.PulseTimes(times_s=np.arange(0, 1, 0.05), shaft="input", pulses_per_rev=2)  # 10 rev/s
    >>> record = hums.make_record({"vib": np.zeros(1000)}, rate_hz=1000, angle=pulses, units="g")
    >>> record.tachometer.attrs["pulses_per_rev"], record.sizes["pulse_tachometer"]
    (2, 20)
    """

    times_s: ArrayLike
    shaft: str
    pulses_per_rev: int
    name: str = "tachometer"


@dataclass(frozen=True, kw_only=True)
class TachometerWaveform:
    """Sampled signal of a tachometer, in which `make_record` detects the pulses.

    Attributes
    ----------
    values : (n,) array_like
        Samples in `units`.
    shaft : str
        Shaft that carries the tachometer.
    pulses_per_rev : int
        Pulses per revolution of that shaft.
    units : str
        One of `UNITS`.
    name : str
        Name of the tachometer in the record; its samples are named `NAME_waveform`.
    rate_hz : float or None
        Sampling rate in Hz, if it differs from the record's.
    full_scale : float or None
        Range of the channel in `units`; a waveform with a swing below a hundredth of it is refused as hum. Default: 1
        for volts, since conditioned tachometers deliver volts and inputs have ranges of 1 V and more; none for other
        units, whose range is unknown.
    threshold, hysteresis : float or None
        Level in `units` whose upward crossing is a pulse, and the distance on either side of it that the waveform must
        pass. Default: found from the waveform, and stored in the record.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> time_s = np.arange(1000) / 1000
    >>> waveform = hums.TachometerWaveform(values=np.sin(2 * np.pi * 10 * time_s), shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"vib": np.zeros(1000)}, rate_hz=1000, angle=waveform, units="g")
    >>> bool(np.allclose(np.diff(record.tachometer), 0.1))
    True
    """

    values: ArrayLike
    shaft: str
    pulses_per_rev: int
    units: str = "V"
    name: str = "tachometer"
    rate_hz: float | None = None
    full_scale: float | None = None
    threshold: float | None = None
    hysteresis: float | None = None


@dataclass(frozen=True, kw_only=True)
class NominalSpeed:
    """A constant speed that is declared, not measured.

    Attributes
    ----------
    rpm : float
        Speed of `shaft` in revolutions per minute.
    shaft : str
        Shaft that rotates at this speed.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> speed = hums.NominalSpeed(rpm=600, shaft="input")
    >>> record = hums.make_record({"vib": np.zeros(1000)}, rate_hz=1000, angle=speed, units="g")
    >>> float(record.nominal_speed), record.nominal_speed.units
    (10.0, 'rev s-1')
    """

    rpm: float
    shaft: str


@dataclass(frozen=True, kw_only=True)
class UnknownAngle:
    """Declares that no shaft angle is known: an analysis has to estimate the speed from the vibration.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> record = hums.make_record({"vib": np.zeros(1000)}, rate_hz=1000, angle=hums.UnknownAngle(), units="g")
    >>> record.attrs["angle"]
    'unknown'
    """


Angle = PulseTimes | TachometerWaveform | NominalSpeed | UnknownAngle


def make_record(
    channels: Mapping[str, Channel | ArrayLike],
    *,
    rate_hz: float | None = None,
    angle: Angle | Sequence[Angle] | AngularAverage | None = None,
    units: str | Mapping[str, str] | None = None,
    measured: Mapping[str, Measured] | None = None,
    machine: str = "",
    regime: str = "",
    recorded_at: datetime | str | None = None,
    start_s: float = 0.0,
    truth: Mapping[str, xr.DataArray] | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Build a record from arrays.

    Parameters
    ----------
    channels : mapping of str to Channel or (n,) array_like
        Vibration channels by name. An `xarray.DataArray` states its units in the attribute ``units``, and its rate and
        start by a time coordinate, whose gaps are filled with NaN.
    rate_hz : float, optional
        Sampling rate in Hz; required unless a channel states it or the record is a synchronous average.
    angle : PulseTimes, TachometerWaveform, NominalSpeed, a sequence of tachometers of one kind, or UnknownAngle
        Source of shaft angle; or `AngularAverage`, if the channels are synchronous averages.
    units : str or mapping of str to str, optional
        Units of the channels given as bare arrays.
    measured : mapping of str to Measured, optional
        Speeds, loads and temperatures measured with the record, by name.
    machine : str
        Name of the machine.
    regime : str
        Operating regime, such as "hover" or "cruise", for each of which a fleet learns its own baseline.
    recorded_at : datetime or str, optional
        Start time of the recording: an aware datetime, or ISO 8601 with UTC offset.
    start_s : float
        Time of the first sample in s, on the clock of the pulse times.
    truth : mapping of str to DataArray, optional
        True values of a synthetic record; every name starts with ``truth_``.
    attrs : mapping, optional
        Further attributes of the record.

    Returns
    -------
    xarray.Dataset
        A valid record. Its time axis is a lazy range, which stores no value per sample.

    Raises
    ------
    RecordError
        If an argument is missing, contradictory or undeclared.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> time_s = np.arange(2000) / 1000
    >>> pulses = hums.PulseTimes(times_s=np.arange(0, 2, 0.1), shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"vib": np.sin(2 * np.pi * time_s)}, rate_hz=1000, angle=pulses, units="g")
    >>> float(record.time[-1]), record.vib.units
    (1.999, 'g')
    """
    start = finite_number(start_s, "start_s")
    declared = _declared_channels(channels, units)
    required: dict[str, Any]
    if isinstance(angle, AngularAverage):
        if rate_hz is not None or start_s or truth:
            raise RecordError(
                "a synchronous average has no sampling rate in Hz, start time or truth; omit rate_hz (--rate-hz), "
                "start_s and truth, or use the record it was averaged from."
            )
        rate, required = 1.0, dict(angle.attrs)
    else:
        declared, rate_hz, start = _with_own_times(declared, rate_hz=rate_hz, start_s=start)
        rate = positive_number(rate_hz, "rate_hz", RATE_REMEDY)
        required = {"rate_hz": rate, "start_s": start_number(start, "start_s", rate_hz=rate)}
    variables = {
        name: _channel_variable(channel, name=name, rate_hz=rate, start_s=start) for name, channel in declared.items()
    }
    for name, quantity in _by_name(measured, "measured").items():
        check_name(name, "measured")
        _check_new(name, variables)
        variables[name] = measured_variable(quantity, name=name, rate_hz=rate, start_s=start)
        if isinstance(angle, AngularAverage) and variables[name].ndim:
            raise RecordError(f'measured "{name}": a synchronous average has no time axis; give one number, the mean.')
    if not isinstance(angle, AngularAverage):
        for name, variable in _angle_variables(angle, rate_hz=rate, start_s=start):
            _check_new(name, variables)
            _check_not_vibration(name, variable, variables)
            variables[name] = variable
    _check_lengths(variables)
    _check_dimensions(variables)
    for name, text in (("machine", machine), ("regime", regime)):
        if not isinstance(text, str):
            raise RecordError(f"{name}={text!r} is not text; give the name of the {name}.")
    required |= {"schema": SCHEMA, "machine": plain_text(machine), "recorded_at": utc_text(recorded_at)}
    required |= {"regime": plain_text(regime)} if regime else {}
    _refuse_clash(required, attrs)
    if isinstance(angle, UnknownAngle):
        required["angle"] = UNKNOWN_ANGLE
    record = xr.Dataset(variables, attrs={**required, **(attrs or {})})
    angular = {dim: ANGLE for dim in record.dims if dim == "time" and isinstance(angle, AngularAverage)}
    record = attach_time(record.rename_dims(angular))
    record = _with_truth(record, _by_name(truth, "truth"))
    check_record(record)
    return record


def _by_name(given: Mapping[str, Any] | None, argument: str) -> Mapping[str, Any]:
    if given is not None and not isinstance(given, Mapping):
        raise RecordError(f"{argument}={plain_repr(given)}; give a mapping of names to values.")
    return given or {}


def _refuse_clash(required: Mapping[str, Any], attrs: Mapping[str, Any] | None) -> None:
    if clash := sorted(required.keys() & _by_name(attrs, "attrs").keys()):
        raise RecordError(f'attrs: "{clash[0]}" is written by make_record itself; give it as an argument.')


def _declared_channels(
    channels: Mapping[str, Channel | ArrayLike], units: str | Mapping[str, str] | None
) -> dict[str, Channel]:
    """Return all channels as `Channel`; refuse units for a channel that does not exist."""
    if not isinstance(channels, Mapping):
        raise RecordError(
            f'channels: {type(channels).__name__} given, without names; use {{"name": values}} or a Channel by name.'
        )
    per_channel = units if isinstance(units, Mapping) else {}
    for name in per_channel:
        if name not in channels:
            raise RecordError(f'units: no channel "{name}"; the channels are {", ".join(channels)}.')
        if isinstance(channels[name], Channel):
            raise RecordError(f'units: channel "{name}" already states its own; remove one of the two.')
    declared = {}
    for name, channel in channels.items():
        check_name(name, "channel")
        given = units if isinstance(units, str) else per_channel.get(name, "")
        channel = channel if isinstance(channel, Channel) else Channel(values=channel, units=given)  # noqa: PLW2901
        what = f'channel "{name}"'
        own = channel.values.attrs.get("units") if isinstance(channel.values, xr.DataArray) else None
        if own and channel.units and known_units(own, what) != known_units(channel.units, what):
            raise RecordError(f'{what}: units="{channel.units}" contradict its DataArray, which states "{own}".')
        declared[name] = replace(channel, units=own or channel.units)
    return declared


def _with_own_times(
    channels: dict[str, Channel], *, rate_hz: float | None, start_s: float
) -> tuple[dict[str, Channel], float | None, float]:
    """Return channels, their rate and start, with those of DataArrays checked against the declarations."""
    found, rates = {}, [rate_hz]
    for name, channel in channels.items():
        declared = channel.rate_hz if channel.rate_hz is not None else rate_hz
        values, own, start_s = held_times(channel.values, what=f'channel "{name}"', rate_hz=declared, start_s=start_s)
        rates.append(own)
        found[name] = replace(channel, values=values, rate_hz=own)
    return found, next((rate for rate in rates if rate is not None), None), start_s


def _channel_variable(
    channel: Channel, *, name: str, rate_hz: float, start_s: float, role: str = "vibration"
) -> xr.Variable:
    """Return a channel as a variable of the record."""
    what = f'channel "{name}"'
    values = real_vector(channel.values, what)
    attrs: dict[str, Any] = {"units": known_units(channel.units, what), "role": role}
    if not isinstance(channel.sensor, str):
        raise RecordError(f"{what}: sensor={plain_repr(channel.sensor)}; give its name as text.")
    if channel.sensor:
        attrs["sensor"] = plain_text(channel.sensor)
    if channel.direction is not None:
        attrs["direction"] = direction_of(channel.direction, what)
    attrs |= _calibration(channel, what)
    own_hz = rate_hz if channel.rate_hz is None else positive_number(channel.rate_hz, f"{what}: rate_hz", RATE_REMEDY)
    return along_time(name, values, attrs, own_hz=own_hz, rate_hz=rate_hz, start_s=start_s)


def _calibration(channel: Channel, what: str) -> dict[str, float | str]:
    """Return the calibration of a channel as attributes, which `hums.calibrated` applies."""
    attrs: dict[str, float | str] = {}
    if (channel.sensitivity is None) != (channel.measures is None):
        raise RecordError(
            f"{what}: sensitivity={channel.sensitivity!r} and measures={channel.measures!r} belong together: "
            f'sensitivity=0.1, measures="g" means 0.1 {channel.units} per g.'
        )
    if channel.measures is not None:
        attrs["measures"] = known_units(channel.measures, f"{what}: measures")
    for name in ("sensitivity", "calibration_factor"):
        value = getattr(channel, name)
        if value is not None:
            attrs[name] = finite_number(value, f"{what}: {name}", "number other than zero")
            if value == 0:
                raise RecordError(f"{what}: {name}=0: a finite number other than zero is needed.")
    if channel.delay_s is not None:
        attrs["delay_s"] = finite_number(channel.delay_s, f"{what}: delay_s")
    return attrs


def _angle_variables(
    angle: Angle | Sequence[Angle] | None, *, rate_hz: float, start_s: float
) -> Iterable[tuple[str, xr.Variable]]:
    """Yield the declared sources of shaft angle, all of one kind, as named variables."""
    for source in _angle_sources(angle):
        if isinstance(source, UnknownAngle):
            continue
        if isinstance(source, NominalSpeed):
            rpm = positive_number(source.rpm, "nominal speed: rpm", "state the speed of the shaft in rev/min")
            attrs = {"units": "rev s-1", "shaft": source.shaft, "nominal": 1}
            yield "nominal_speed", xr.Variable((), rpm / 60, attrs)
            continue
        check_name(source.name, "tachometer")
        attrs = {"units": "s", "shaft": source.shaft, "pulses_per_rev": source.pulses_per_rev}
        if isinstance(source, PulseTimes):
            times_s = real_vector(source.times_s, f'tachometer "{source.name}"').astype(np.float64)
            scale = time_scale(source.times_s.attrs.get("units")) if isinstance(source.times_s, xr.DataArray) else None
            times_s = times_s * scale[0] if scale is not None else times_s
        else:
            waveform = _waveform_variable(source, rate_hz=rate_hz, start_s=start_s)
            yield f"{source.name}_waveform", waveform
            train = _detected_pulses(source, waveform, rate_hz=rate_hz, start_s=start_s)
            times_s = train.times_s
            attrs |= {"threshold": train.threshold, "hysteresis": train.hysteresis}
        yield source.name, xr.Variable(f"pulse_{source.name}", times_s, attrs)


def _angle_sources(angle: Angle | Sequence[Angle] | None) -> list[Angle]:
    """Return the declared sources of shaft angle; refuse none, unknown types and several kinds."""
    sources = [] if angle is None else list(angle) if isinstance(angle, Sequence) else [angle]
    if not sources:
        raise RecordError(f"angle: no source of shaft angle is given. {ANGLE_REMEDY}")
    for source in sources:
        if not isinstance(source, Angle):
            raise RecordError(f"angle: {type(source).__name__} is not a source of shaft angle. {ANGLE_REMEDY}")
    kinds = {type(source).__name__ for source in sources}
    if len(kinds) > 1 or (len(sources) > 1 and not kinds <= {"PulseTimes", "TachometerWaveform"}):
        found = ", ".join(type(source).__name__ for source in sources)
        raise RecordError(f"angle: {found} contradict each other or repeat. {ANGLE_REMEDY}")
    return sources


def _waveform_variable(source: TachometerWaveform, *, rate_hz: float, start_s: float) -> xr.Variable:
    name, own = f"{source.name}_waveform", source.rate_hz if source.rate_hz is not None else rate_hz
    values, *_ = held_times(source.values, what=f'tachometer "{source.name}"', rate_hz=own, start_s=start_s)
    channel = Channel(values=values, units=source.units, rate_hz=source.rate_hz)
    return _channel_variable(channel, name=name, rate_hz=rate_hz, start_s=start_s, role="tachometer")


def _detected_pulses(
    source: TachometerWaveform, waveform: xr.Variable, *, rate_hz: float, start_s: float
) -> PulseTrain:
    from signals.shaft.tachometer import pulse_times  # noqa: PLC0415 - only a waveform needs signal processing

    own_rate = waveform.attrs.get("rate_hz", rate_hz)
    # 1 V is the smallest input range for tachometers
    full_scale = 1.0 if source.full_scale is None and source.units == "V" else source.full_scale
    try:
        return pulse_times(
            waveform.values,
            rate_hz=own_rate,
            start_s=start_s,
            full_scale=full_scale,
            threshold=source.threshold,
            hysteresis=source.hysteresis,
        )
    except ValueError as error:
        raise RecordError(f'tachometer "{source.name}": no pulses found in its waveform: {error}') from error


def _with_truth(record: xr.Dataset, truth: Mapping[str, xr.DataArray]) -> xr.Dataset:
    """Return the record with its true values, on its own time axes."""
    axes = set(record.xindexes)
    for name, array in truth.items():
        check_name(name, "truth")
        if not name.startswith("truth_") or not isinstance(array, xr.DataArray):
            raise RecordError(f'truth: "{name}" of type {type(array).__name__}: give xarray.DataArrays named truth_...')
        bare = array.drop_vars(axes & set(array.coords)).to_dataset(name=name)
        try:
            record = record.merge(bare, join="exact", compat="equals")
        except ValueError as error:
            raise RecordError(f'truth: "{name}" does not fit the record: {error}') from error
    return record


def _check_not_vibration(name: str, waveform: xr.Variable, variables: Mapping[str, xr.Variable]) -> None:
    """Refuse a tachometer waveform that is a vibration channel, whose pulses would follow a mesh."""
    if waveform.attrs.get("role") != "tachometer":
        return
    for channel, variable in variables.items():
        same = variable.attrs.get("role") == "vibration" and np.array_equal(variable.values, waveform.values)
        if same:
            raise RecordError(
                f'tachometer "{name.removesuffix("_waveform")}": its waveform is identical to vibration channel '
                f'"{channel}", which has no shaft pulses. Name the channel of the tachometer (--tach-waveform), or '
                "estimate the speed from the vibration (UnknownAngle, --no-tachometer)."
            )


def _check_new(name: str, taken: Mapping[str, object]) -> None:
    if name in taken:
        raise RecordError(f'two parts of the record are named "{name}"; rename the channel or the tachometer.')


def _check_dimensions(variables: Mapping[str, xr.Variable]) -> None:
    for dim in {str(dim) for variable in variables.values() for dim in variable.dims}:
        if dim in variables:
            raise RecordError(f'the name "{dim}" is reserved for a dimension of the record; choose another.')


def _check_lengths(variables: Mapping[str, xr.Variable]) -> None:
    sizes = {name: variable.size for name, variable in variables.items() if variable.dims in (("time",), (ANGLE,))}
    if len(set(sizes.values())) > 1:
        usual = Counter(sizes.values()).most_common(1)[0][0]
        odd = ", ".join(f'"{name}" has {size}' for name, size in sizes.items() if size != usual)
        raise RecordError(
            f"channels at the same rate must have the same length: {odd}, the others {usual} samples. Cut them to "
            "the same span, or state the rate of a channel with Channel(..., rate_hz=...)."
        )
