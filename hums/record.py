"""What a record is: vibration channels and the one thing that tells a shaft's angle.

A record is an `xarray.Dataset`. `make_record` is its one constructor and `check_record` says in a
sentence what keeps a dataset from being one. Undeclared units and rates are refused, never guessed.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from numbers import Integral, Real
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray.indexes import RangeIndex

__all__ = [
    "SCHEMA",
    "UNITS",
    "Channel",
    "NominalSpeed",
    "PulseTimes",
    "RecordError",
    "Sampling",
    "TachometerWaveform",
    "UnknownAngle",
    "attach_time",
    "channel_values",
    "check_record",
    "detach_time",
    "make_record",
    "nominal_speed",
    "sampling",
    "tachometers",
    "turning_speeds",
    "vibration_channels",
]

SCHEMA = "hums-record/1"

UNITS: Mapping[str, tuple[str, ...]] = {
    "g": ("g0", "g_n", "gn"),
    "m s-2": ("m/s^2", "m/s2", "m/s²", "m/s**2", "m s^-2", "m s**-2", "m·s-2"),
    "m s-1": ("m/s", "m s^-1", "m s**-1", "m·s-1"),
    "mm s-1": ("mm/s", "mm s^-1", "mm s**-1", "mm·s-1"),
    "m": (),
    "mm": (),
    "µm": ("um", "\N{GREEK SMALL LETTER MU}m"),
    "V": ("volt", "volts", "Volt", "Volts"),
    "mV": (),
    "Pa": (),
    "N": (),
    "A": (),
    "1": (),
}
"""Units a channel may have, each with the spellings that are read as it."""

_CANONICAL = {spelling: units for units, aliases in UNITS.items() for spelling in (units, *aliases)}

_WAYS_TO_ANGLE = (
    "Give exactly one of: pulse times, angle=PulseTimes(times_s=..., shaft=..., pulses_per_rev=...), on the "
    "command line --tach-times NAME; a tachometer waveform, angle=TachometerWaveform(values=..., shaft=..., "
    "pulses_per_rev=...), --tach-waveform NAME; a declared constant speed, angle=NominalSpeed(rpm=..., "
    "shaft=...), --shaft-rpm RPM. Where there is none, say so, angle=UnknownAngle(), --no-tachometer: the speed is "
    "then estimated from the vibration."
)
_UNKNOWN = "unknown"
_FEWEST_SAMPLES_A_PULSE = 1.5  # the sample times themselves come at 1
_FEWEST_SAMPLES_A_TURN = 4.0  # of the vibration: below, not even the shaft's second harmonic shows
_FEWEST_INTERVALS = 20  # whose median change from turn to turn says something
_MOST_CHANGE_A_TURN = 0.3  # a real shaft's is some per cent; that of random crossings some 60 %
_RATE_REMEDY = "state the samples per second, rate_hz=... (on the command line --rate-hz)"

Kind = Literal["vibration", "waveform", "tachometer", "speed", "truth"]


class RecordError(ValueError):
    """What keeps a dataset, a file or an argument from being a record, in one sentence."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One measured channel.

    Attributes
    ----------
    values : (n,) array_like
        Samples in `units`. NaN marks a gap.
    units : str
        One of `UNITS` or a spelling of it.
    sensor : str
        The transducer, in the words of whoever mounted it.
    direction : (3,) tuple of float, str or None
        Sensitive axis, in the gearbox's coordinates or in words.
    rate_hz : float or None
        Samples per second where they differ from the record's.
    sensitivity : float or None
        `units` for one of `measures`, as 0.1 V for one g; negative where the sensor is mounted the other way round.
        Noted, not applied: see `hums.calibrated`.
    measures : str or None
        Units of what the sensor senses; needed with `sensitivity`.
    calibration_factor : float or None
        What the last calibration found the true value to be, over that by the sensitivity.
    delay_s : float or None
        How much later than the machine the channel shows it.
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
    """Times at which a tachometer's pulses arrived.

    Attributes
    ----------
    times_s : (m,) array_like
        Strictly increasing times in s, on the clock of the record (`start_s` at its first sample).
    shaft : str
        The shaft that carries the tachometer.
    pulses_per_rev : int
        Pulses in one revolution of that shaft.
    name : str
        Name of the variable.
    """

    times_s: ArrayLike
    shaft: str
    pulses_per_rev: int
    name: str = "tachometer"


@dataclass(frozen=True, kw_only=True)
class TachometerWaveform:
    """The sampled signal of a tachometer, in which the pulses are still to be found.

    Attributes
    ----------
    values : (n,) array_like
        Samples in `units`.
    shaft : str
        The shaft that carries the tachometer.
    pulses_per_rev : int
        Pulses in one revolution of that shaft.
    units : str
        One of `UNITS`.
    name : str
        Name of the variable that holds the pulses; the samples are kept as `NAME_waveform`.
    rate_hz : float or None
        Samples per second where they differ from the record's.
    """

    values: ArrayLike
    shaft: str
    pulses_per_rev: int
    units: str = "V"
    name: str = "tachometer"
    rate_hz: float | None = None


@dataclass(frozen=True, kw_only=True)
class NominalSpeed:
    """A constant speed that is declared, not measured.

    Attributes
    ----------
    rpm : float
        Speed of `shaft` in revolutions per minute.
    shaft : str
        The shaft that turns at it.
    """

    rpm: float
    shaft: str


@dataclass(frozen=True, kw_only=True)
class UnknownAngle:
    """Nothing tells the angle of any shaft: an analysis has to estimate the speed from the vibration."""


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """When the samples of a channel were taken: sample `i` of `count` at `start_s + i / rate_hz`.

    Attributes
    ----------
    start_s : float
        Time of the first sample in s.
    rate_hz : float
        Samples per second.
    count : int
        Number of samples.
    """

    start_s: float
    rate_hz: float
    count: int


Angle = PulseTimes | TachometerWaveform | NominalSpeed | UnknownAngle


def make_record(
    channels: Mapping[str, Channel | ArrayLike],
    *,
    rate_hz: float,
    angle: Angle | Sequence[Angle] | None = None,
    units: str | Mapping[str, str] | None = None,
    machine: str = "",
    recorded_at: datetime | str | None = None,
    start_s: float = 0.0,
    truth: Mapping[str, xr.DataArray] | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Build a record from arrays.

    Parameters
    ----------
    channels : mapping of str to Channel or (n,) array_like
        Vibration channels by name.
    rate_hz : float
        Samples per second.
    angle : PulseTimes, TachometerWaveform, NominalSpeed, a sequence of tachometers of one kind, or UnknownAngle
        What tells the angle of a shaft.
    units : str or mapping of str to str, optional
        Units of the channels that are given as bare arrays.
    machine : str
        Which machine was recorded.
    recorded_at : datetime or str, optional
        When the recording began: an aware datetime, or ISO 8601 with its offset from UTC.
    start_s : float
        Time of the first sample in s, on the clock of the pulse times.
    truth : mapping of str to DataArray, optional
        What is known of a synthetic record; every name starts with ``truth_``.
    attrs : mapping, optional
        Further attributes of the record.

    Returns
    -------
    xarray.Dataset
        A record that `check_record` accepts. Its time axis is a lazy range: no float per sample.

    Raises
    ------
    RecordError
        If anything is missing, contradictory or not declared.
    """
    rate = _positive(rate_hz, "rate_hz", _RATE_REMEDY)
    start = _finite(start_s, "start_s")
    variables = {
        name: _channel_variable(channel, name=name, rate_hz=rate, start_s=start)
        for name, channel in _declared_channels(channels, units).items()
    }
    _check_lengths(variables)
    for name, variable in _angle_variables(angle, rate_hz=rate, start_s=start):
        _check_free(name, variables)
        _check_no_vibration(name, variable, variables)
        variables[name] = variable
    _check_lengths(variables)
    _check_dimensions_free(variables)
    own: dict[str, Any] = {
        "schema": SCHEMA,
        "machine": machine,
        "recorded_at": _utc(recorded_at),
        "rate_hz": rate,
        "start_s": start,
    }
    if clash := sorted(own.keys() & (attrs or {}).keys()):
        raise RecordError(f'attrs: "{clash[0]}" is written by make_record itself; give it as an argument.')
    if isinstance(angle, UnknownAngle):
        own["angle"] = _UNKNOWN
    record = attach_time(xr.Dataset(variables, attrs={**own, **(attrs or {})}))
    record = _with_truth(record, truth or {})
    check_record(record)
    return record


def check_record(record: xr.Dataset) -> None:
    """Refuse what is not a record. Samples are not read, only what describes them.

    Raises
    ------
    RecordError
        With the sentence that says what is wrong and what to do about it.
    """
    if not isinstance(record, xr.Dataset):
        raise RecordError(f"a record is an xarray.Dataset, not a {type(record).__name__}; see make_record.")
    if (schema := record.attrs.get("schema")) != SCHEMA:
        raise RecordError(f'attribute schema={schema!r}: a record carries "{SCHEMA}"; build it with make_record.')
    _positive(record.attrs.get("rate_hz"), "attribute rate_hz", _RATE_REMEDY)
    if not vibration_channels(record):
        raise RecordError("no vibration channel: a record needs at least one; name it in channels.")
    for name, variable in record.data_vars.items():
        _check_variable(record, str(name), variable)
    _check_angle(record)


def vibration_channels(record: xr.Dataset) -> list[str]:
    """Names of the vibration channels, in the order of the record."""
    return _names(record, "vibration")


def tachometers(record: xr.Dataset) -> list[str]:
    """Names of the variables that hold pulse times, in the order of the record."""
    return _names(record, "tachometer")


def nominal_speed(record: xr.Dataset) -> xr.DataArray | None:
    """Return the declared constant speed in rev s-1, its `shaft` among the attributes, or None."""
    return record.get("nominal_speed")


def sampling(record: xr.Dataset, channel: str) -> Sampling:
    """Tell when the samples of `channel` were taken, also in a slice of a record."""
    variable = record.variables[channel]
    dim = str(variable.dims[0])
    index = record.xindexes.get(dim)
    rate = float(_rate_hz(record, variable))
    count = variable.sizes[dim]
    # Half a sample of drift over the record is where two clocks stop being one.
    if not isinstance(index, RangeIndex) or abs(index.step * rate - 1) * count > 0.5:  # noqa: PLR2004
        raise RecordError(
            f'channel "{channel}": its axis "{dim}" does not run evenly at rate_hz={rate:g}. From a file, '
            "get the record with open_record; to thin it, filter and build a new one: a stride aliases."
        )
    return Sampling(start_s=float(index.start), rate_hz=rate, count=count)


def channel_values(record: xr.Dataset, name: str) -> NDArray[np.floating]:
    """Read one variable of a record, and say which file is damaged if that fails.

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
            f'{source}: "{name}" cannot be read ({error}). The file is damaged: its bytes no longer agree '
            "with their checksum. Restore it, or convert the original again."
        ) from error


def attach_time(dataset: xr.Dataset) -> xr.Dataset:
    """Give every channel its time axis, computed from start, count and rate and never stored."""
    for name in _names(dataset, "vibration", "waveform"):
        variable = dataset.variables[name]
        if variable.ndim != 1:
            raise RecordError(f'channel "{name}": shape {variable.shape}; a channel has one dimension.')
        if variable.size == 0:
            raise RecordError(f'channel "{name}": empty; at least one sample is needed.')
        dim = str(variable.dims[0])
        if isinstance(dataset.xindexes.get(dim), RangeIndex):
            continue
        rate = _positive(_rate_hz(dataset, variable), f'channel "{name}": rate_hz', _RATE_REMEDY)
        if dim in dataset.coords:  # written by other hands, as numbers: a slice then starts where they say
            start = _stored_start(dataset[dim], name=name, rate_hz=rate)
            dataset = dataset.drop_vars(dim)
        else:
            start = _finite(_described(dataset, variable).get("start_s"), f'channel "{name}": start_s')
        count = variable.size
        index = RangeIndex.linspace(start, start + count / rate, num=count, endpoint=False, dim=dim)
        dataset = dataset.assign_coords(xr.Coordinates.from_xindex(index))
    return dataset


def _stored_start(axis: xr.DataArray, *, name: str, rate_hz: float) -> float:
    """Return where an axis of numbers starts, if its ends agree with the rate."""
    if axis.dtype.kind not in "iuf":
        raise RecordError(f'channel "{name}": its axis "{axis.name}" is of type {axis.dtype}; seconds are needed.')
    first, last = float(axis[0]), float(axis[-1])
    if not abs((last - first) * rate_hz - (axis.size - 1)) <= 0.5:  # noqa: PLR2004 - as in `sampling`, and for NaN
        raise RecordError(
            f'channel "{name}": its axis "{axis.name}", {axis.size} samples from {first:g} s to {last:g} s, does not '
            f"run evenly at rate_hz={rate_hz:g}. Correct the rate; a record that was thinned is to be filtered first."
        )
    return first


def detach_time(record: xr.Dataset) -> xr.Dataset:
    """Reduce the time axes to bare dimensions and keep where they start, the inverse of `attach_time`."""
    axes = set()
    for name in _names(record, "vibration", "waveform"):
        when = sampling(record, name)
        dim = str(record.variables[name].dims[0])
        axes.add(dim)
        if dim == "time":
            record = record.assign_attrs(start_s=when.start_s)
        else:
            record = record.assign({name: record[name].assign_attrs(start_s=when.start_s)})
    return record.drop_vars(axes)


# ---- what the parts are ------------------------------------------------------------------------------------


def _kind(name: str, variable: xr.DataArray | xr.Variable) -> Kind | None:
    if name.startswith("truth_"):
        return "truth"
    if name == "nominal_speed":
        return "speed"
    if any(str(dim).startswith("pulse_") for dim in variable.dims):
        return "tachometer"
    role: dict[Any, Kind] = {"vibration": "vibration", "tachometer": "waveform"}
    return role.get(variable.attrs.get("role"))


def _names(record: xr.Dataset, *kinds: Kind) -> list[str]:
    return [str(name) for name, variable in record.data_vars.items() if _kind(str(name), variable) in kinds]


def _described(record: xr.Dataset, variable: xr.DataArray | xr.Variable) -> Mapping[str, Any]:
    """Where rate_hz and start_s of a channel stand: in the record or, at its own rate, in the variable."""
    return record.attrs if variable.dims == ("time",) else variable.attrs


def _rate_hz(record: xr.Dataset, variable: xr.DataArray | xr.Variable) -> Any:  # noqa: ANN401
    return _described(record, variable).get("rate_hz")


# ---- building ----------------------------------------------------------------------------------------------


def _declared_channels(
    channels: Mapping[str, Channel | ArrayLike], units: str | Mapping[str, str] | None
) -> dict[str, Channel]:
    """Turn bare arrays into channels; refuse units for a channel that is not there."""
    if not isinstance(channels, Mapping):
        raise RecordError(
            f'channels: a {type(channels).__name__}, which has no names; give {{"name": values}} or a Channel by name.'
        )
    per_channel = units if isinstance(units, Mapping) else {}
    for name in per_channel:
        if name not in channels:
            raise RecordError(f'units: no channel "{name}"; the channels are {", ".join(channels)}.')
        if isinstance(channels[name], Channel):
            raise RecordError(f'units: channel "{name}" states its own already; remove one of the two.')
    declared = {}
    for name, channel in channels.items():
        _check_name(name, "channel")
        if isinstance(channel, Channel):
            declared[name] = channel
        else:
            stated = units if isinstance(units, str) else per_channel.get(name, "")
            declared[name] = Channel(values=channel, units=stated)
    return declared


def _channel_variable(
    channel: Channel, *, name: str, rate_hz: float, start_s: float, role: str = "vibration"
) -> xr.Variable:
    what = f'channel "{name}"'
    values = _vector(channel.values, what)
    attrs: dict[str, Any] = {"units": _units(channel.units, what), "role": role}
    if channel.sensor:
        attrs["sensor"] = channel.sensor
    if channel.direction is not None:
        attrs["direction"] = _direction(channel.direction, what)
    attrs |= _calibration(channel, what)
    own_rate = rate_hz
    if channel.rate_hz is not None:
        own_rate = _positive(channel.rate_hz, f"{what}: rate_hz", _RATE_REMEDY)
    if own_rate == rate_hz:
        return xr.Variable("time", values, attrs)
    return xr.Variable(f"time_{name}", values, {**attrs, "rate_hz": own_rate, "start_s": start_s})


def _calibration(channel: Channel, what: str) -> dict[str, float | str]:
    """Return what is known of the chain from sensor to file, as attributes that `hums.calibrated` applies."""
    attrs: dict[str, float | str] = {}
    if (channel.sensitivity is None) != (channel.measures is None):
        raise RecordError(
            f"{what}: sensitivity={channel.sensitivity!r} and measures={channel.measures!r} belong together: "
            f'sensitivity=0.1, measures="g" is 0.1 {channel.units} for one g.'
        )
    if channel.measures is not None:
        attrs["measures"] = _units(channel.measures, f"{what}: measures")
    for name in ("sensitivity", "calibration_factor"):
        value = getattr(channel, name)
        if value is not None:
            attrs[name] = _finite(value, f"{what}: {name}", "number other than zero")
            if value == 0:
                raise RecordError(f"{what}: {name}=0: a finite number other than zero is needed.")
    if channel.delay_s is not None:
        attrs["delay_s"] = _finite(channel.delay_s, f"{what}: delay_s")
    return attrs


def _angle_variables(
    angle: Angle | Sequence[Angle] | None, *, rate_hz: float, start_s: float
) -> Iterable[tuple[str, xr.Variable]]:
    """Turn the declared sources of angle, all of one kind, into named variables."""
    for source in _angle_sources(angle):
        if isinstance(source, UnknownAngle):
            continue
        if isinstance(source, NominalSpeed):
            rpm = _positive(source.rpm, "nominal speed: rpm", "state the speed of the shaft in rev/min")
            attrs = {"units": "rev s-1", "shaft": source.shaft, "nominal": 1}
            yield "nominal_speed", xr.Variable((), rpm / 60, attrs)
            continue
        _check_name(source.name, "tachometer")
        attrs = {"units": "s", "shaft": source.shaft, "pulses_per_rev": source.pulses_per_rev}
        if isinstance(source, PulseTimes):
            times_s = _vector(source.times_s, f'tachometer "{source.name}"').astype(np.float64)
        else:
            waveform = _waveform_variable(source, rate_hz=rate_hz, start_s=start_s)
            yield f"{source.name}_waveform", waveform
            times_s, threshold = _found_pulses(source.name, waveform, rate_hz=rate_hz, start_s=start_s)
            attrs["threshold"] = threshold
        yield source.name, xr.Variable(f"pulse_{source.name}", times_s, attrs)


def _angle_sources(angle: Angle | Sequence[Angle] | None) -> list[Angle]:
    sources = [] if angle is None else list(angle) if isinstance(angle, Sequence) else [angle]
    if not sources:
        raise RecordError(f"angle: nothing tells the angle of a shaft. {_WAYS_TO_ANGLE}")
    for source in sources:
        if not isinstance(source, Angle):
            raise RecordError(f"angle: {type(source).__name__} is none of the three. {_WAYS_TO_ANGLE}")
    kinds = {type(source).__name__ for source in sources}
    if len(kinds) > 1 or (len(sources) > 1 and not kinds <= {"PulseTimes", "TachometerWaveform"}):
        found = ", ".join(type(source).__name__ for source in sources)
        raise RecordError(f"angle: {found} contradict each other or repeat. {_WAYS_TO_ANGLE}")
    return sources


def _waveform_variable(source: TachometerWaveform, *, rate_hz: float, start_s: float) -> xr.Variable:
    channel = Channel(values=source.values, units=source.units, rate_hz=source.rate_hz)
    name = f"{source.name}_waveform"
    return _channel_variable(channel, name=name, rate_hz=rate_hz, start_s=start_s, role="tachometer")


def _found_pulses(
    name: str, waveform: xr.Variable, *, rate_hz: float, start_s: float
) -> tuple[NDArray[np.float64], float]:
    from signals.tachometer import pulse_times  # noqa: PLC0415 - only a waveform needs signal processing

    own_rate = waveform.attrs.get("rate_hz", rate_hz)
    try:
        train = pulse_times(waveform.values, rate_hz=own_rate, start_s=start_s)
    except ValueError as error:
        raise RecordError(f'tachometer "{name}": no pulses found in its waveform: {error}') from error
    return np.asarray(train.times_s, dtype=np.float64), float(train.threshold)


def _with_truth(record: xr.Dataset, truth: Mapping[str, xr.DataArray]) -> xr.Dataset:
    axes = set(record.xindexes)  # of time: those of the record hold
    for name, array in truth.items():
        _check_name(name, "truth")
        if not name.startswith("truth_") or not isinstance(array, xr.DataArray):
            raise RecordError(
                f'truth: "{name}", a {type(array).__name__}: each is an xarray.DataArray, named truth_...'
            )
        bare = array.drop_vars(axes & set(array.coords)).to_dataset(name=name)
        try:
            record = record.merge(bare, join="exact", compat="equals")
        except ValueError as error:
            raise RecordError(f'truth: "{name}" does not fit the record: {error}') from error
    return record


# ---- one argument at a time --------------------------------------------------------------------------------


def _vector(values: ArrayLike, what: str) -> NDArray[np.floating]:
    """Return 1-D float32 as it is and every other 1-D real array as float64."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)  # masked samples are gaps
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise RecordError(f"{what}: not an array of numbers ({error}).") from error
    if array.dtype.kind not in "iuf":
        raise RecordError(f"{what}: values of type {array.dtype}; real numbers are needed.")
    if array.ndim != 1:
        raise RecordError(
            f"{what}: shape {array.shape} where one row of numbers is needed; give each column as a channel of its own."
        )
    if array.size == 0:
        raise RecordError(f"{what}: empty; at least one sample is needed.")
    single = array.dtype.kind == "f" and array.dtype.itemsize == np.dtype(np.float32).itemsize
    return array.astype(np.float32 if single else np.float64, copy=False)


def _units(units: object, what: str) -> str:
    valid = ", ".join(f'"{name}"' for name in UNITS)
    if units is None or units == "":
        raise RecordError(
            f'{what}: no units. Declare them, Channel(values=..., units="g") or make_record(..., units="g"), '
            f"on the command line --units g. Units are one of {valid}."
        )
    if not isinstance(units, str) or units.strip() not in _CANONICAL:
        raise RecordError(f"{what}: units={units!r} are not known. Units are one of {valid}.")
    return _CANONICAL[units.strip()]


def _direction(direction: Sequence[float] | str, what: str) -> str | list[float]:
    if isinstance(direction, str):
        return direction
    vector = np.asarray(direction)
    if vector.shape != (3,) or vector.dtype.kind not in "iuf" or not 0 < np.linalg.norm(vector) < np.inf:
        raise RecordError(f"{what}: direction={direction!r}; three numbers, not all zero, or a word are needed.")
    return [float(component) for component in vector]


def _utc(moment: datetime | str | None) -> str:
    if moment is None or moment == "":
        return ""
    try:
        when = datetime.fromisoformat(moment) if isinstance(moment, str) else moment
        offset = when.utcoffset()
    except (ValueError, AttributeError) as error:
        raise RecordError(
            f"recorded_at={moment!r}: a datetime or ISO 8601, as 2013-03-11T03:00:24Z, is needed."
        ) from error
    if offset is None:
        raise RecordError(
            f"recorded_at={moment!s}: no time zone; add its offset from UTC, as {when.isoformat()}+01:00 or ...Z."
        )
    return when.astimezone(UTC).isoformat().replace("+00:00", "Z")


def _positive(value: object, what: str, remedy: str) -> float:
    if isinstance(value, Real) and not isinstance(value, bool | np.bool) and 0 < float(value) < math.inf:
        return float(value)
    raise RecordError(f"{what}={_shown(value)}: a positive, finite number is needed; {remedy}.")


def _finite(value: object, what: str, kind: str = "number of seconds") -> float:
    if isinstance(value, Real) and not isinstance(value, bool | np.bool) and math.isfinite(value):
        return float(value)
    raise RecordError(f"{what}={_shown(value)}: a finite {kind} is needed.")


def _shown(value: object) -> str:
    return repr(value.item() if isinstance(value, np.generic) else value)


# ---- names -------------------------------------------------------------------------------------------------


def _check_name(name: object, what: str) -> None:
    """Refuse names that do not survive a file, where a slash opens a group, or that mean something else."""
    good = isinstance(name, str) and name.strip() == name and name not in {"", ".", ".."}
    if not isinstance(name, str) or not good or "/" in name or "\0" in name:
        raise RecordError(f"{what}: the name {name!r} cannot be kept in a file; use words without / and outer blanks.")
    if what != "truth" and (name in {"time", "nominal_speed"} or name.startswith("truth_")):
        raise RecordError(f'{what}: the name "{name}" has a meaning of its own in a record; choose another.')


def _check_no_vibration(name: str, waveform: xr.Variable, variables: Mapping[str, xr.Variable]) -> None:
    """Refuse a tachometer's waveform that is one of the vibration channels: its pulses would be those of a mesh."""
    if waveform.attrs.get("role") != "tachometer":
        return
    for channel, variable in variables.items():
        same = variable.attrs.get("role") == "vibration" and np.array_equal(variable.values, waveform.values)
        if same:
            raise RecordError(
                f'tachometer "{name.removesuffix("_waveform")}": its waveform is channel "{channel}" itself, sample by '
                "sample; vibration tells no turns. Name the tachometer's own channel (--tach-waveform), or estimate "
                "the speed from the vibration (UnknownAngle, --no-tachometer)."
            )


def _check_free(name: str, taken: Mapping[str, object]) -> None:
    if name in taken:
        raise RecordError(f'two parts of the record are named "{name}"; rename the channel or the tachometer.')


def _check_dimensions_free(variables: Mapping[str, xr.Variable]) -> None:
    for dim in {str(dim) for variable in variables.values() for dim in variable.dims}:
        if dim in variables:
            raise RecordError(f'the name "{dim}" is that of a dimension of the record; choose another.')


def _check_lengths(variables: Mapping[str, xr.Variable]) -> None:
    sizes = {name: variable.size for name, variable in variables.items() if variable.dims == ("time",)}
    if len(set(sizes.values())) > 1:
        usual = Counter(sizes.values()).most_common(1)[0][0]
        odd = ", ".join(f'"{name}" has {size}' for name, size in sizes.items() if size != usual)
        raise RecordError(
            f"channels at one rate have one length: {odd} where the others have {usual} samples. Cut them to "
            "the same span, or state the rate of a channel with Channel(..., rate_hz=...)."
        )


# ---- checking ----------------------------------------------------------------------------------------------


def _check_variable(record: xr.Dataset, name: str, variable: xr.DataArray) -> None:
    kind = _kind(name, variable)
    if kind is None:
        raise RecordError(
            f'variable "{name}" is no part of a record: a channel has the attributes role="vibration" and '
            "units; what is known of a synthetic record is named truth_..."
        )
    if kind in {"vibration", "waveform"}:
        _check_channel(record, name, variable)
    elif kind == "tachometer":
        _check_tachometer(name, variable)
    elif kind == "speed":
        _positive(variable.values[()], "nominal_speed", "state the speed of the shaft in rev s-1")
        _check_shaft("nominal_speed", variable)


def _check_channel(record: xr.Dataset, name: str, variable: xr.DataArray) -> None:
    what = f'channel "{name}"'
    if variable.ndim != 1 or not (variable.dims == ("time",) or str(variable.dims[0]).startswith("time_")):
        raise RecordError(
            f'{what}: dimensions {variable.dims}; a channel has one, "time" or, at a rate of its own, "time_{name}".'
        )
    if variable.dtype not in (np.float32, np.float64):
        raise RecordError(f"{what}: values of type {variable.dtype}; float32 or float64 are needed.")
    if variable.size == 0:
        raise RecordError(f"{what}: empty; at least one sample is needed.")
    units = variable.attrs.get("units")
    if _units(units, what) != units:
        raise RecordError(f'{what}: units="{units}" are written "{_units(units, what)}" in a record.')
    _positive(_rate_hz(record, variable), f"{what}: rate_hz", _RATE_REMEDY)
    sampling(record, name)


def _check_angle(record: xr.Dataset) -> None:
    names, nominal = tachometers(record), nominal_speed(record)
    if not names and nominal is None and record.attrs.get("angle") != _UNKNOWN:
        raise RecordError(f"angle: nothing in this record tells the angle of a shaft. {_WAYS_TO_ANGLE}")
    if names and nominal is not None:
        raise RecordError(f'angle: both nominal_speed and the tachometer "{names[0]}". {_WAYS_TO_ANGLE}')
    spans = [sampling(record, name) for name in vibration_channels(record)]
    first_s = min(span.start_s for span in spans)
    last_s = max(span.start_s + span.count / span.rate_hz for span in spans)
    for name in names:
        times_s = record[name].values
        if times_s[-1] < first_s or times_s[0] > last_s:
            raise RecordError(
                f'tachometer "{name}": its pulses, {times_s[0]:g} s to {times_s[-1]:g} s, lie outside of the '
                f"record, {first_s:g} s to {last_s:g} s. Pulse times are seconds (not sample numbers) on the "
                "record's clock, which shows start_s at the first sample."
            )
    _check_speeds(record)


def _check_speeds(record: xr.Dataset) -> None:
    """Refuse a shaft that turns, or pulses that come, faster than the fastest channel can show."""
    rate_hz = max(sampling(record, name).rate_hz for name in _names(record, "vibration", "waveform"))
    nominal = nominal_speed(record)
    if nominal is not None and float(nominal) >= rate_hz / 2:
        raise RecordError(
            f"nominal speed: {float(nominal) * 60:g} rpm is {float(nominal):g} revolutions a second, which samples at "
            f"{rate_hz:g} Hz cannot show; below {rate_hz / 2:g} is needed. Correct the speed (rpm) or the rate."
        )
    for name in tachometers(record):
        _check_spacing(name, record[name], rate_hz)


def _check_spacing(name: str, pulses: xr.DataArray, rate_hz: float) -> None:
    """Refuse pulses that no shaft makes whose vibration is sampled at `rate_hz`."""
    times_s, per_rev = pulses.values, int(pulses.attrs["pulses_per_rev"])
    spacing_s = (times_s[-1] - times_s[0]) / (times_s.size - 1)
    what = f'tachometer "{name}": its pulses are {spacing_s:.3g} s apart on average'
    if spacing_s * rate_hz < _FEWEST_SAMPLES_A_PULSE:
        raise RecordError(
            f"{what}, {spacing_s * rate_hz:.3g} samples at {rate_hz:g} Hz: a pulse about every sample, or more. Give "
            "the moments at which the pulses came, in seconds, not the times of the samples; or correct the rate."
        )
    if spacing_s * per_rev * rate_hz < _FEWEST_SAMPLES_A_TURN:
        raise RecordError(
            f"{what}, which at {per_rev} a revolution makes {1 / (spacing_s * per_rev):.4g} rev/s, a turn every "
            f"{spacing_s * per_rev * rate_hz:.3g} samples at {rate_hz:g} Hz; the vibration shows nothing of so fast a "
            "shaft. Correct the times (seconds), pulses_per_rev (--pulses-per-rev) or the rate."
        )
    intervals = np.diff(times_s)
    if intervals.size < per_rev + _FEWEST_INTERVALS:
        return
    change = float(np.median(np.abs(intervals[per_rev:] - intervals[:-per_rev])) / np.median(intervals))
    if change > _MOST_CHANGE_A_TURN:
        raise RecordError(
            f"{what} and come without order: from one revolution to the next their distance changes by {change:.0%}, "
            "in the middle of all. No shaft turns like that; is this a vibration, not a tachometer's signal? Name "
            "the tachometer's own channel or pulse times (--tach-waveform, --tach-times)."
        )


def turning_speeds(pulses: xr.DataArray) -> tuple[float, float, float] | None:
    """Return the median speed that a tachometer's pulses tell, and what 1 % and 99 % of its revolutions stay below.

    In rev/s, straight from the pulse times: missed and spurious ones are not repaired here. None where the pulses make
    no whole revolution.
    """
    times_s, per_rev = pulses.values, int(pulses.attrs["pulses_per_rev"])
    if times_s.size <= per_rev:
        return None
    middle, low, high = np.percentile(1 / (times_s[per_rev:] - times_s[:-per_rev]), [50, 1, 99])
    return float(middle), float(low), float(high)


def _check_tachometer(name: str, variable: xr.DataArray) -> None:
    what = f'tachometer "{name}"'
    if variable.ndim != 1 or variable.dtype != np.float64:
        raise RecordError(f"{what}: {variable.ndim}-D {variable.dtype}; a row of float64 times is needed.")
    pulses = variable.attrs.get("pulses_per_rev")
    if not isinstance(pulses, Integral) or isinstance(pulses, bool) or pulses < 1:
        raise RecordError(
            f"{what}: pulses_per_rev={_shown(pulses)}: a positive whole number is needed (--pulses-per-rev)."
        )
    _check_shaft(what, variable)
    _check_pulses(what, variable.values)


def _check_shaft(what: str, variable: xr.DataArray) -> None:
    shaft = variable.attrs.get("shaft")
    if not isinstance(shaft, str) or not shaft:
        raise RecordError(f'{what}: shaft={_shown(shaft)}; name the shaft it turns with, shaft="..." (--shaft).')


def _check_pulses(what: str, times_s: NDArray[np.float64]) -> None:
    if times_s.size < 2:  # noqa: PLR2004 - a speed is a difference
        raise RecordError(f"{what}: {times_s.size} pulse; at least 2 are needed to tell a speed.")
    bad = np.flatnonzero(~np.isfinite(times_s))
    if bad.size:
        raise RecordError(f"{what}: pulse {bad[0]} is at {times_s[bad[0]]}; leave out a pulse whose time is unknown.")
    backwards = np.flatnonzero(np.diff(times_s) <= 0)
    if backwards.size:
        at = backwards[0]
        equal = times_s[at + 1] == times_s[at]
        how = (
            f"two of its times are equal: pulses {at} and {at + 1} are both at {times_s[at]:.9g} s"
            if equal
            else f"its times run backwards: pulse {at + 1} is at {times_s[at + 1]:.9g} s, pulse {at} at "
            f"{times_s[at]:.9g} s"
        )
        raise RecordError(
            f"{what}: {how} ({backwards.size} such places in {times_s.size}). Remove repeated pulses; "
            "if these are samples of the tachometer's signal and not times, give them as a "
            "TachometerWaveform (on the command line --tach-waveform)."
        )
