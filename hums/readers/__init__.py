"""Conversion of files of other programs to records; the suffix selects the reader.

A reader returns the contents of a file by name: an array, or a phrase that describes what is not numeric. What the file
does not state (units, rate, shaft) the caller declares; nothing is guessed.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hums.readers.columns import ArraysOnDisk, ForeignFile, Stated, canonical_units
from hums.readers.time_axis import SINCE_1970, Agreement, Clocks, TimeUnit, Trust, seconds_of
from hums.records.fields import RecordWarning, utc_text
from hums.records.quantities import AngularAverage, Measured, quantity_units
from hums.records.record import (
    Angle,
    Channel,
    NominalSpeed,
    PulseTimes,
    RecordError,
    TachometerWaveform,
    UnknownAngle,
    make_record,
)
from hums.records.store import existing_file
from signals._validation import brief, checked, is_float

if TYPE_CHECKING:
    from os import PathLike

    import xarray as xr
    from numpy.typing import NDArray

__all__ = ["SUFFIXES", "ForeignFile", "Stated", "convert", "read_file"]

# The module that reads each suffix, and the options of `read_file` that it takes.
_READERS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    ".mat": ("matlab", ("most_bytes",)),
    ".wav": ("wav", ()),
    **dict.fromkeys((".csv", ".txt", ".tsv", ".asc"), ("csv", ("decimal",))),
    ".tdms": ("tdms", ()),
    **dict.fromkeys((".uff", ".unv"), ("uff", ())),
    **dict.fromkeys((".h5", ".hdf5", ".nc"), ("hdf5", ("most_bytes",))),
    **dict.fromkeys((".npy", ".npz"), ("numpy_files", ("most_bytes",))),
}
SUFFIXES = tuple(_READERS)
_STEADY = 0.02  # largest deviation of a measured speed from its mean: that of lines from a declared one, by default


@checked
def read_file(
    path: str | PathLike[str], *, most_bytes: int | None = None, decimal: Literal[".", ","] | None = None
) -> ForeignFile:
    r"""Return the contents of another program's file, read by the reader of its suffix.

    Parameters
    ----------
    path : str or Path
        A .mat, .wav, .csv, .txt, .tsv, .asc, .tdms, .uff, .unv, .h5, .hdf5, .nc, .npy or .npz file.
    most_bytes : int, optional
        Bytes that one array of an HDF5, .mat or .npz file may take; default a hundred times the
        size of the file, or 64 MB.
    decimal : {".", ","}, optional
        Decimal sign of a text file; needed where its numbers do not show which it is, as "1.485" alone.

    Returns
    -------
    ForeignFile
        The arrays of HDF5 files are read when they are asked for.

    Raises
    ------
    RecordError
        If the file is missing or damaged, or there is no reader for its suffix.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from hums.readers import read_file
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     _ = path.write_text("time,vib\n0.0,1.5\n0.1,2.5\n", encoding="utf-8")
    ...     print(read_file(path).fields["vib"].tolist())
    [1.5, 2.5]
    """
    file = existing_file(path)
    suffix = file.suffix.lower()
    if suffix[1:].isdigit():  # as of 2003.10.22.12.06.24, a time and no suffix
        suffix = ".txt"
    if suffix not in _READERS:
        raise RecordError(
            f'{file}: no reader for the suffix "{suffix}"; known are {", ".join(SUFFIXES)}. Export the signals '
            "to one of them, or build the record in Python with make_record."
        )
    module, options = _READERS[suffix]
    given = {"most_bytes": most_bytes, "decimal": decimal}
    read = import_module(f"hums.readers.{module}").read  # each reader loads only its own library
    fields, stated = read(file, **{name: given[name] for name in options})
    return ForeignFile(
        path=file,
        fields=fields if isinstance(fields, ArraysOnDisk) else MappingProxyType(dict(fields)),
        stated=MappingProxyType(dict(stated)),
    )


def convert(
    source: str | PathLike[str],
    *,
    channels: Sequence[str],
    units: str | Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    tach_times: str | None = None,
    tach_waveform: str | None = None,
    pulses_per_rev: int | None = None,
    shaft: str | None = None,
    shaft_rpm: float | None = None,
    speed_column: str | None = None,
    speed_units: str = "",
    no_tachometer: bool = False,
    measured: Mapping[str, str] | None = None,
    average_of: str | None = None,
    samples_per_rev: int | None = None,
    averaged_over: int | None = None,
    scale: float = 1.0,
    time_unit: TimeUnit | None = None,
    machine: str = "",
    recorded_at: datetime | str | None = None,
    time_column: str | None = None,
    most_bytes: int | None = None,
    decimal: Literal[".", ","] | None = None,
    trust: Trust | None = None,
) -> xr.Dataset:
    """Convert another program's file to a record.

    What the file states is compared with what is declared: rates, times of samples, starts and units. Samples that its
    times leave out become NaN.

    Parameters
    ----------
    source : str or Path
        A .mat, .wav, .csv, .txt, .tsv, .asc, .tdms, .uff, .unv, .h5, .hdf5, .nc, .npy or .npz file.
    channels : sequence of str
        Names of the vibration channels in the file; a member of a struct or a group by its path, ``bearing.gs`` or
        ``bearing/gs``. In the record the parts of a name are joined by dots.
    units : str or mapping of str to str, optional
        Units of the channels after `scale`; needed where the file states none.
    rate_hz : float, optional
        Samples per second; needed where neither the file nor a column of times states them.
    tach_times, tach_waveform : str, optional
        Name of the pulse times in s, or of the sampled tachometer signal.
    pulses_per_rev : int, optional
        Pulses in one revolution of `shaft`; needed with either tachometer.
    shaft : str, optional
        Shaft that carries the tachometer or turns at `shaft_rpm`.
    shaft_rpm : float, optional
        Declared constant speed in rev/min.
    speed_column, speed_units : str, optional
        Name of the measured speed of `shaft`, and its units, such as "rpm": its mean is the declared speed, and it is
        refused where it departs from that by more than 2 %.
    no_tachometer : bool
        Declare that no shaft angle is known: the speed has to be estimated from the vibration.
    measured : mapping of str to str, optional
        Loads, temperatures and other quantities measured with the record: the units of each by its name in the file.
    average_of : str, optional
        Component of which the channels are an average in angle already, see `hums.AngularAverage`.
    samples_per_rev, averaged_over : int, optional
        Samples per revolution of that average, and number of revolutions averaged.
    scale : float
        Factor from the numbers in the file to `units`; for a .wav of integers, the value of full scale.
    time_unit : {"s", "ms", "us"}, optional
        Unit of a column of times whose header states none, as "time" alone; such a column states the rate.
    machine, recorded_at
        As in `make_record`; the file may state when it was recorded.
    time_column : str, optional
        Name of the times of the samples, whose first one is `recorded_at`: in s since 1970, or ISO 8601 with an offset.
    most_bytes, decimal : optional
        As in `read_file`.
    trust : {"declared", "file"}, optional
        Which holds where the file contradicts a declaration: the attribute ``notes`` of the record says where. Without
        it a contradiction is refused.

    Returns
    -------
    xarray.Dataset
        A record with the name of the file in attribute ``source``.

    Raises
    ------
    RecordError
        If the file cannot be read, or its contents and the declarations are incomplete or contradictory.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import hums
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     np.savetxt(path, np.ones(1000), header="vib", comments="")
    ...     record = hums.convert(path, channels=["vib"], units="g", rate_hz=1000, shaft="input", shaft_rpm=600)
    >>> float(record.vib[0]), float(record.nominal_speed), record.attrs["source"]
    (1.0, 10.0, 'log.csv')
    """
    file = read_file(source, most_bytes=most_bytes, decimal=decimal)
    if isinstance(channels, str) or not np.iterable(channels) or not all(isinstance(name, str) for name in channels):
        raise RecordError(f"channels={brief(channels)}: names of channels are needed, one or more (--channel).")
    if not isinstance(units, str | Mapping | None):
        raise RecordError(f"units={brief(units)}: a word, or words by the names of channels, are needed (--units).")
    if trust not in {None, "declared", "file"}:
        raise RecordError(f'trust={brief(trust)}: "declared" or "file" is needed (--trust).')
    channels = tuple(channels)
    if not channels:
        raise RecordError(f"channels: none named (--channel). {file.path.name}: {file.contents()}")
    factor = _scale(scale)
    if isinstance(units, Mapping) and (unknown := [name for name in units if name not in channels]):
        raise RecordError(f'units: no channel "{unknown[0]}"; the channels are {", ".join(channels)}.')
    agreement = Agreement(file=file, trust=trust)
    average = _average(file, average_of, samples_per_rev, averaged_over, rate_hz=rate_hz)
    given = {
        "--tach-times": tach_times,
        "--tach-waveform": tach_waveform,
        "--shaft-rpm": shaft_rpm,
        "--speed-column": speed_column,
        "--no-tachometer": no_tachometer or None,
        "--shaft": shaft,
        "--pulses-per-rev": pulses_per_rev,
    }
    given = {option: value for option, value in given.items() if value is not None}
    angle_source = _angle_source(given, is_average=average is not None)
    sampled = [*channels, *([tach_waveform] if tach_waveform else [])]
    clocks = Clocks(
        agreement=agreement,
        rate_hz=rate_hz,
        time_unit=time_unit,
        time_column=file.name(time_column) if time_column else None,
        used={file.name(name) for name in (*sampled, tach_times) if name},
    )
    found = {name: _channel(agreement, name, units, scale=factor) for name in channels}
    start_s, epoch = 0.0, None
    if average is None:
        start_s, epoch = clocks.start_and_epoch(sampled)
        each = {name: clocks.of(name) for name in channels}
        found = {
            name: replace(channel, values=each[name].filled(np.asarray(channel.values)), rate_hz=each[name].rate_hz)
            for name, channel in found.items()
        }
    began = _moment(file, time_column) if time_column else epoch
    if recorded_at is not None and began is not None:
        recorded_at = _settled_moment(agreement, recorded_at, began, start_s=start_s)
    angle = average or _angle(clocks, angle_source, given, speed_units=speed_units, epoch=epoch)
    quantities = _measured(agreement, measured or {}, clocks=None if average else clocks, channel=channels[0])
    for name in channels:
        agreement.notes.extend(f'"{name}" states {text}, which is not applied' for text in file.metadata(name).unread)
    if agreement.notes:
        warnings.warn(f"{file.path.name}: {'. '.join(agreement.notes)}.", RecordWarning, stacklevel=2)
    return make_record(
        {file.label(name): channel for name, channel in found.items()},
        rate_hz=None if average else clocks.of(channels[0]).rate_hz,
        angle=angle,
        measured=quantities,
        machine=machine,
        recorded_at=recorded_at if recorded_at is not None else began,
        start_s=start_s,
        attrs={"source": file.path.name} | ({"notes": ". ".join(agreement.notes)} if agreement.notes else {}),
    )


def _channel(agreement: Agreement, name: str, units: str | Mapping[str, str] | None, *, scale: float) -> Channel:
    """Return a field as a channel in its units, with what the file states about its sensor."""
    stated = agreement.file.metadata(name)
    channel = Channel(
        values=_scaled(agreement.file.vector(name), scale),
        units=_units(agreement, name, units, scale=scale),
        delay_s=stated.delay_s,
    )
    volts = {"V": 1.0, "mV": 1e-3}.get(canonical_units(channel.units) or "")
    if stated.sensitivity is None or volts is None or scale != 1:
        return channel
    return replace(channel, sensitivity=stated.sensitivity / volts, measures=stated.measures)


def _settled_moment(
    agreement: Agreement, declared: datetime | str, stated: datetime, *, start_s: float
) -> datetime | str:
    """Return when a file was recorded; the time that is declared may be that of its end, to the minute."""
    late_s = (datetime.fromisoformat(utc_text(declared)) - stated).total_seconds() - start_s
    if abs(late_s) <= _MINUTES_S:
        return declared
    contradiction = f"recorded_at={declared} contradicts {agreement.file.path.name}, which states {utc_text(stated)}"
    settled: datetime | str = agreement.settle(contradiction, declared, stated)
    return settled


_MINUTES_S = 300.0


def _angle_source(given: Mapping[str, Any], *, is_average: bool) -> str | None:
    """Return the option that declares the source of shaft angle, None where none does: make_record raises the error."""
    if is_average:
        if meaningless := [option for option in given if option != "--no-tachometer"]:
            raise RecordError(f"{meaningless[0]} has no meaning for an average in angle (--average-of); leave it out.")
        return None
    sources = [option for option in given if option not in {"--shaft", "--pulses-per-rev"}]
    if len(sources) > 1:
        raise RecordError(f"{' and '.join(sources)}: the shaft angle has one source; give one of them.")
    shaft = given.get("--shaft")
    if sources and sources != ["--no-tachometer"] and (not isinstance(shaft, str) or not shaft):
        raise RecordError(f'{sources[0]} needs the shaft it belongs to: shaft="..." (--shaft).')
    return sources[0] if sources else None


def _angle(
    clocks: Clocks, source: str | None, given: Mapping[str, Any], *, speed_units: str, epoch: datetime | None
) -> Angle | None:
    """Return the declared source of shaft angle, None where there is none."""
    file, agreement = clocks.agreement.file, clocks.agreement
    shaft, per_rev = given.get("--shaft", ""), given.get("--pulses-per-rev")
    if source is None or source == "--no-tachometer":
        return None if source is None else UnknownAngle()
    if source in {"--shaft-rpm", "--speed-column"}:
        if per_rev is not None:
            raise RecordError(f"--pulses-per-rev has no meaning with {source}; leave one of them out.")
        if source == "--shaft-rpm":
            return NominalSpeed(rpm=given[source], shaft=shaft)
        return NominalSpeed(rpm=60 * _steady_speed_hz(agreement, given[source], speed_units), shaft=shaft)
    name = given[source]
    stated = file.metadata(name).pulses_per_rev
    per_rev = int(stated) if per_rev is None and stated is not None and float(stated).is_integer() else per_rev
    if per_rev is None:
        raise RecordError(
            f'{source} needs the pulses in one revolution of "{shaft}": pulses_per_rev=... (--pulses-per-rev).'
        )
    if stated is not None and stated != per_rev:
        contradiction = f'pulses_per_rev={per_rev} contradicts {file.path.name}, which states {stated:g} for "{name}"'
        per_rev = agreement.settle(contradiction, per_rev, int(stated))
    if source == "--tach-times":
        times_s = _unpadded(seconds_of(file, name, epoch=epoch))
        return PulseTimes(times_s=times_s, shaft=shaft, pulses_per_rev=per_rev)
    clock = clocks.of(name)
    return TachometerWaveform(
        values=clock.filled(file.vector(name)), shaft=shaft, pulses_per_rev=per_rev, rate_hz=clock.rate_hz
    )


def _quantity_units(agreement: Agreement, name: str, declared: str, what: str) -> str:
    """Return the units of a measured quantity, declared or stated by the file."""
    stated = agreement.file.metadata(name).units
    if stated is None or not declared:
        return stated or declared
    try:
        if quantity_units(declared, what) == quantity_units(stated, what):
            return declared
    except RecordError:
        return declared
    contradiction = f'{what}: units="{declared}" contradict {agreement.file.path.name}, which states "{stated}"'
    settled: str = agreement.settle(contradiction, declared, stated)
    return settled


def _steady_speed_hz(agreement: Agreement, name: str, units: str) -> float:
    """Return the mean of a measured speed in rev/s; refuse one that is not steady."""
    file, what = agreement.file, f'speed "{name}" (--speed-units)'
    units = _quantity_units(agreement, name, units, what)
    unit, factor = quantity_units(units, what)
    values = np.asarray(file.vector(name), dtype=np.float64) * factor
    values = np.abs(values[np.isfinite(values)])
    if unit != "rev s-1" or not values.size or not values.mean() > 0:
        raise RecordError(f'{file.path.name}: "{name}" in {units} holds no speed above zero; name the column of one.')
    mean = float(values.mean())
    off = float(np.max(np.abs(values - mean))) / mean
    if off > _STEADY:
        raise RecordError(
            f'{file.path.name}: the speed "{name}" departs by {off:.1%} from its mean, {60 * mean:.6g} rpm; at most '
            f"{_STEADY:.0%} is a constant speed. Name a tachometer (--tach-times, --tach-waveform), or have the speed "
            "estimated from the vibration (--no-tachometer)."
        )
    return mean


def _measured(
    agreement: Agreement, units: Mapping[str, str], *, clocks: Clocks | None, channel: str
) -> dict[str, Measured]:
    """Return the quantities measured with a record: a number each, or samples at its rate or at one of their own."""
    found, file = {}, agreement.file
    count = file.vector(channel).size
    for name, declared in units.items():
        values = np.asarray(file.vector(name), dtype=np.float64)
        unit = _quantity_units(agreement, name, declared, f'measured "{name}"')
        if clocks is None or values.size == 1:
            if not np.isfinite(values).any():
                raise RecordError(f'{file.path.name}: "{name}" holds no number; leave it out of --measured.')
            found[file.label(name)] = Measured(values=float(np.nanmean(values)), units=unit)
            continue
        rate_hz = file.metadata(name).rate_hz
        if values.size == count:
            values, rate_hz = clocks.of(channel).filled(values), None
        elif rate_hz is None:
            raise RecordError(
                f'{file.path.name}: "{name}" has {values.size} values beside {count} samples, and states no rate; '
                "build the record in Python, Measured(values=..., units=..., rate_hz=...)."
            )
        found[file.label(name)] = Measured(values=values, units=unit, rate_hz=rate_hz)
    return found


def _average(
    file: ForeignFile,
    component: str | None,
    samples_per_rev: int | None,
    averaged_over: int | None,
    *,
    rate_hz: float | None,
) -> AngularAverage | None:
    """Return the declared average in angle; None where the file holds samples over time."""
    if component is None and samples_per_rev is None and averaged_over is None:
        return None
    if component is None or samples_per_rev is None:
        raise RecordError(
            "an average in angle needs the component whose revolution it is and its samples in one: average_of=..., "
            "samples_per_rev=... (--average-of, --samples-per-rev)."
        )
    if rate_hz is not None:
        raise RecordError(f"{file.path.name}: an average in angle has no samples per second; leave out --rate-hz.")
    return AngularAverage(component=component, samples_per_rev=samples_per_rev, averaged_over=averaged_over)


def _moment(file: ForeignFile, name: str) -> datetime:
    """Return the first of the times of a column, which are seconds since 1970."""
    values = np.asarray(seconds_of(file, name, epoch=SINCE_1970), dtype=np.float64)
    if not (values.size and math.isfinite(values[0]) and 0 < values[0] < _YEAR_9999):
        raise RecordError(
            f'{file.path.name}: "{name}" begins with {values[0] if values.size else "nothing"}, which is no time in s '
            "since 1970. Give the time with --recorded-at, or in the names of the files."
        )
    return datetime.fromtimestamp(float(values[0]), tz=UTC)


_YEAR_9999 = 253370764800.0  # s


def _units(agreement: Agreement, name: str, units: str | Mapping[str, str] | None, *, scale: float) -> str:
    """Return the units of a channel, declared or stated by the file; stated units hold only at scale 1."""
    file = agreement.file
    declared = units.get(name) if isinstance(units, Mapping) else units
    stated = file.metadata(name).units
    if stated is None:
        return declared or ""
    if scale != 1:
        if declared is None:
            raise RecordError(
                f'{file.path.name} states "{stated}" for "{name}", which scale={scale:g} turns into something else: '
                'declare it, units="..." (--units).'
            )
        return declared
    known = {canonical_units(one) for one in (declared or stated, stated)}
    if len(known) > 1 and None not in known:
        contradiction = f'units="{declared}" contradict {file.path.name}, which states "{stated}" for "{name}"'
        remedy = f'Give the factor from "{stated}" to "{declared}", scale=... (--scale), or leave --units out. '
        settled: str = agreement.settle(contradiction, declared, stated, remedy=remedy)
        return settled
    return declared or stated


def _scale(scale: float) -> float:
    if not is_float(scale) or not math.isfinite(scale) or scale == 0:
        raise RecordError(f"scale={brief(scale)}: a finite number other than zero is needed (--scale).")
    return float(scale)


def _scaled(values: NDArray[np.generic], factor: float) -> NDArray[np.generic]:
    return values if factor == 1 else np.multiply(values, factor)


def _unpadded(times_s: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return times without the NaN at their end, with which a table pads a shorter column."""
    if times_s.dtype.kind != "f":
        return times_s
    filled = np.flatnonzero(~np.isnan(times_s))
    return times_s[: filled[-1] + 1] if filled.size else times_s
