"""Conversion of files of other programs to records; the suffix selects the reader.

A reader returns the contents of a file by name: an array, or a phrase that describes what is not numeric. What the file
does not state (units, rate, shaft) the caller declares; nothing is guessed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from hums.readers.columns import ArraysOnDisk, Field, ForeignFile, Stated, canonical_units
from hums.readers.time_axis import TimeUnit, check_time_column, rate_hz_of, start_and_epoch
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

TEXT = (".csv", ".txt", ".tsv", ".asc")
SUFFIXES = (".mat", ".wav", *TEXT, ".tdms", ".uff", ".unv", ".h5", ".hdf5", ".npy", ".npz")
_STEADY = 0.02  # largest deviation of a measured speed from its mean: that of lines from a declared one, by default


@checked
def read_file(path: str | PathLike[str], *, most_bytes: int | None = None) -> ForeignFile:
    r"""Return the contents of another program's file, read by the reader of its suffix.

    Parameters
    ----------
    path : str or Path
        A .mat, .wav, .csv, .txt, .tsv, .asc, .tdms, .uff, .unv, .h5, .hdf5, .npy or .npz file.
    most_bytes : int, optional
        Bytes that one array of an HDF5, .mat or .npz file may take; default a hundred times the
        size of the file, or 64 MB.

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
    rate_hz: float | None = None
    fields: Mapping[str, Field]
    stated: Mapping[str, Stated] = {}
    match file.suffix.lower():
        case ".mat":
            from hums.readers import matlab  # noqa: PLC0415 - each reader loads only its own library

            fields = matlab.read(file, most_bytes=most_bytes)
        case ".wav":
            from hums.readers import wav  # noqa: PLC0415

            rate_hz, fields = wav.read(file)
        case suffix if suffix in TEXT or suffix[1:].isdigit():  # as of 2003.10.22.12.06.24, a time and no suffix
            from hums.readers import csv  # noqa: PLC0415

            fields, stated = csv.read(file)
        case ".tdms":
            from hums.readers import tdms  # noqa: PLC0415

            fields, stated = tdms.read(file)
        case ".uff" | ".unv":
            from hums.readers import uff  # noqa: PLC0415

            fields, stated = uff.read(file)
        case ".h5" | ".hdf5":
            from hums.readers import hdf5  # noqa: PLC0415

            fields, stated = hdf5.read(file, most_bytes=most_bytes)
        case ".npy" | ".npz":
            from hums.readers import numpy_files  # noqa: PLC0415

            fields = numpy_files.read(file, most_bytes=most_bytes)
        case suffix:
            raise RecordError(
                f'{file}: no reader for the suffix "{suffix}"; known are {", ".join(SUFFIXES)}. Export the signals '
                "to one of them, or build the record in Python with make_record."
            )
    return ForeignFile(
        path=file,
        fields=fields if isinstance(fields, ArraysOnDisk) else MappingProxyType(dict(fields)),
        rate_hz=rate_hz,
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
) -> xr.Dataset:
    """Convert another program's file to a record.

    Parameters
    ----------
    source : str or Path
        A .mat, .wav, .csv, .txt, .tsv, .asc, .tdms, .uff, .unv, .h5, .hdf5, .npy or .npz file.
    channels : sequence of str
        Names of the vibration channels in the file; a member of a struct or a group by its path, ``bearing.gs`` or
        ``bearing/gs``. In the record the parts of a name are joined by dots.
    units : str or mapping of str to str, optional
        Units of the channels after `scale`; needed where the file states none.
    rate_hz : float, optional
        Samples per second; needed where the file states none. A .wav file does, a .tdms or .uff file may.
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
        As in `make_record`; a .tdms file may state when it was recorded.
    time_column : str, optional
        Name of the times of the samples, whose first one is `recorded_at`: in s since 1970, or ISO 8601 with an offset.
    most_bytes : int, optional
        As in `read_file`.

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
    file = read_file(source, most_bytes=most_bytes)
    if isinstance(channels, str) or not np.iterable(channels) or not all(isinstance(name, str) for name in channels):
        raise RecordError(f"channels={brief(channels)}: names of channels are needed, one or more (--channel).")
    if not isinstance(units, str | Mapping | None):
        raise RecordError(f"units={brief(units)}: a word, or words by the names of channels, are needed (--units).")
    channels = tuple(channels)
    if not channels:
        raise RecordError(f"channels: none named (--channel). {file.path.name}: {file.contents()}")
    factor = _scale(scale)
    rate_of = partial(rate_hz_of, file, declared=rate_hz, time_unit=time_unit)
    if isinstance(units, Mapping) and (unknown := [name for name in units if name not in channels]):
        raise RecordError(f'units: no channel "{unknown[0]}"; the channels are {", ".join(channels)}.')
    average = _average(file, average_of, samples_per_rev, averaged_over, rate_hz=rate_hz)
    if average is not None:
        given: dict[str, object] = {"--speed-column": speed_column, "--tach-times": tach_times}
        given |= {
            "--tach-waveform": tach_waveform,
            "--shaft-rpm": shaft_rpm,
            "--shaft": shaft,
            "--pulses-per-rev": pulses_per_rev,
        }
        if named := [option for option, value in given.items() if value is not None]:
            raise RecordError(f"{named[0]} has no meaning for an average in angle (--average-of); leave it out.")
        return make_record(
            {
                file.name(name): Channel(
                    values=_scaled(file.vector(name), factor), units=_units(file, name, units, scale=factor)
                )
                for name in channels
            },
            angle=average,
            measured=_measured(file, measured or {}, count=0),
            machine=machine,
            recorded_at=_moment(file, time_column) if recorded_at is None and time_column else recorded_at,
            attrs={"source": file.path.name},
        )
    values = {
        file.name(name): Channel(
            values=_scaled(file.vector(name), factor),
            units=_units(file, name, units, scale=factor),
            rate_hz=rate_of(name),
        )
        for name in channels
    }
    rate = rate_of(channels[0])
    sampled = [*channels, *([tach_waveform] if tach_waveform else [])]
    start_s, epoch = start_and_epoch(file, sampled, rate_hz=rate)
    used = [file.name(name) for name in (*sampled, tach_times, time_column) if name]
    check_time_column(file, rate, count=file.vector(channels[0]).size, used=used, time_unit=time_unit)
    return make_record(
        values,
        rate_hz=rate,
        angle=_angle(
            file,
            tach_times=tach_times,
            tach_waveform=tach_waveform,
            pulses_per_rev=pulses_per_rev,
            shaft=shaft,
            shaft_rpm=shaft_rpm,
            speed=(speed_column, speed_units),
            no_tachometer=no_tachometer,
            rate_of=rate_of,
        ),
        measured=_measured(file, measured or {}, count=file.vector(channels[0]).size),
        machine=machine,
        recorded_at=recorded_at if recorded_at is not None else (_moment(file, time_column) if time_column else epoch),
        start_s=start_s,
        attrs={"source": file.path.name},
    )


def _angle(
    file: ForeignFile,
    *,
    tach_times: str | None,
    tach_waveform: str | None,
    pulses_per_rev: int | None,
    shaft: str | None,
    shaft_rpm: float | None,
    speed: tuple[str | None, str],
    no_tachometer: bool,
    rate_of: Callable[[str], float],
) -> Angle | None:
    """Return the declared source of shaft angle, None where there is no declaration."""
    options: dict[str, object] = {
        "--tach-times": tach_times,
        "--tach-waveform": tach_waveform,
        "--shaft-rpm": shaft_rpm,
        "--speed-column": speed[0],
        "--no-tachometer": no_tachometer or None,
    }
    given = [option for option, value in options.items() if value is not None]
    if not given:
        return None  # make_record raises the error
    if len(given) > 1:
        raise RecordError(f"{' and '.join(given)}: the shaft angle has one source; give one of them.")
    if no_tachometer:
        return UnknownAngle()
    if not isinstance(shaft, str) or not shaft:
        raise RecordError(f'{given[0]} needs the shaft it belongs to: shaft="..." (--shaft).')
    if shaft_rpm is not None or speed[0] is not None:
        if pulses_per_rev is not None:
            raise RecordError(f"--pulses-per-rev has no meaning with {given[0]}; leave one of them out.")
        if speed[0] is not None:
            return NominalSpeed(rpm=60 * _steady_speed_hz(file, speed[0], speed[1]), shaft=shaft)
        return NominalSpeed(rpm=0.0 if shaft_rpm is None else shaft_rpm, shaft=shaft)
    if pulses_per_rev is None:
        raise RecordError(
            f'{given[0]} needs the pulses in one revolution of "{shaft}": pulses_per_rev=... (--pulses-per-rev).'
        )
    if tach_times is not None:
        times_s = _unpadded(file.vector(tach_times))
        return PulseTimes(times_s=times_s, shaft=shaft, pulses_per_rev=pulses_per_rev)
    name = str(tach_waveform)
    return TachometerWaveform(
        values=file.vector(name),
        shaft=shaft,
        pulses_per_rev=pulses_per_rev,
        rate_hz=rate_of(name),
    )


def _steady_speed_hz(file: ForeignFile, name: str, units: str) -> float:
    """Return the mean of a measured speed in rev/s; refuse one that is not steady."""
    unit, factor = quantity_units(units, f'speed "{name}" (--speed-units)')
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


def _measured(file: ForeignFile, units: Mapping[str, str], *, count: int) -> dict[str, Measured]:
    """Return the quantities measured with a record: a number each, or samples at its rate or at one of their own."""
    found = {}
    for name, unit in units.items():
        values = np.asarray(file.vector(name), dtype=np.float64)
        if count == 0 or values.size == 1:
            if not np.isfinite(values).any():
                raise RecordError(f'{file.path.name}: "{name}" holds no number; leave it out of --measured.')
            found[file.name(name)] = Measured(values=float(np.nanmean(values)), units=unit)
            continue
        rate_hz = file.metadata(name).rate_hz
        if values.size != count and rate_hz is None:
            raise RecordError(
                f'{file.path.name}: "{name}" has {values.size} values beside {count} samples, and states no rate; '
                "build the record in Python, Measured(values=..., units=..., rate_hz=...)."
            )
        found[file.name(name)] = Measured(values=values, units=unit, rate_hz=None if values.size == count else rate_hz)
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
    values = np.asarray(file.vector(name), dtype=np.float64)
    if not (values.size and math.isfinite(values[0]) and 0 < values[0] < _YEAR_9999):
        raise RecordError(
            f'{file.path.name}: "{name}" begins with {values[0] if values.size else "nothing"}, which is no time in s '
            "since 1970. Give the time with --recorded-at, or in the names of the files."
        )
    return datetime.fromtimestamp(float(values[0]), tz=UTC)


_YEAR_9999 = 253370764800.0  # s


def _units(file: ForeignFile, name: str, units: str | Mapping[str, str] | None, *, scale: float) -> str:
    """Return the units of a channel, declared or stated by the file; stated units hold only at scale 1."""
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
    if (
        declared is not None
        and None not in (canonical_units(declared), canonical_units(stated))
        and canonical_units(declared) != canonical_units(stated)
    ):
        raise RecordError(
            f'units="{declared}" contradict {file.path.name}, which states "{stated}" for "{name}". Give the factor '
            f'from "{stated}" to "{declared}", scale=... (--scale), or leave --units out; if the file is wrong, take '
            "its arrays from read_file and build the record with make_record."
        )
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
