"""Conversion of files of other programs: the suffix selects the reader.

A reader returns the contents of a file by name: an array, or a phrase that describes what is not numeric. The caller
declares what the file does not state (units, rate, shaft); nothing is guessed.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from hums.readers.columns import ForeignFile, Stated, located, parsing
from hums.readers.time_axis import Import, seconds_of
from hums.records.fields import CANONICAL_UNITS, RecordError, RecordWarning, utc_text
from hums.records.quantities import SPELLINGS, Measured, quantity_units
from hums.records.record import Angle, Channel, NominalSpeed, PulseTimes, TachometerWaveform, UnknownAngle, make_record
from hums.records.store import existing_file
from signals._validation import checked

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from datetime import datetime
    from os import PathLike

    import xarray as xr
    from numpy.typing import NDArray

    from hums.readers.description import ImportDescription

__all__ = ["SUFFIXES", "ForeignFile", "Stated", "convert", "read_file"]

# By suffix: the module that reads it, the kind of file, and the optional package that it needs.
_READERS: Mapping[str, tuple[str, str, str]] = {
    ".mat": ("matlab", "a MATLAB file", ""),
    ".wav": ("wav", "a complete WAV file", ""),
    **dict.fromkeys((".csv", ".txt", ".tsv", ".asc"), ("csv", "a text table", "")),
    ".tdms": ("tdms", "a TDMS file", "npTDMS"),
    ".lvm": ("lvm", "a LabVIEW measurement file", ""),
    **dict.fromkeys((".mf4", ".mdf"), ("mdf", "an MDF file", "asammdf")),
    **dict.fromkeys((".uff", ".unv"), ("uff", "a universal file", "pyuff")),
    **dict.fromkeys((".h5", ".hdf5", ".nc"), ("hdf5", "an HDF5 or netCDF file", "")),
    **dict.fromkeys((".npy", ".npz"), ("numpy_files", "a NumPy file of numbers", "")),
}
SUFFIXES = tuple(_READERS)


@checked
def read_file(
    path: str | PathLike[str],
    description: ImportDescription | Mapping[str, Any] | str | PathLike[str] | None = None,
    **declared: Any,  # noqa: ANN401 - the keys of an ImportDescription, each with its type
) -> ForeignFile:
    r"""Return the contents of another program's file, read by the reader of its suffix.

    Parameters
    ----------
    path : str or Path
        A .mat, .wav, .csv, .txt, .tsv, .asc, .tdms, .lvm, .mf4, .mdf, .uff, .unv, .h5, .hdf5, .nc, .npy or .npz file.
    description : ImportDescription, mapping or path, optional
        Only ``most_bytes`` is used and, for text files, ``separator``, ``decimal``, ``encoding`` and ``header_lines``,
        which are detected if not given. The decimal sign must be given if the numbers are ambiguous, such as "1.485".
    **declared
        Keys that override those of `description`.

    Returns
    -------
    ForeignFile
        Arrays of HDF5 files are read on access.

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
    from hums.readers.description import describe  # noqa: PLC0415 - it loads pydantic

    spec, file = describe(description, **declared), existing_file(path)
    suffix = file.suffix.lower()
    if suffix[1:].isdigit():  # as of 2003.10.22.12.06.24, a time and no suffix
        suffix = ".txt"
    if suffix not in _READERS:
        raise RecordError(
            f'{file}: no reader for the suffix "{suffix}"; supported are {", ".join(SUFFIXES)}. Export the signals '
            "to one of them, or build the record in Python with make_record."
        )
    module, kind, package = _READERS[suffix]
    with parsing(file, kind, package):
        found: ForeignFile = import_module(f"hums.readers.{module}").read(file, spec)
    return found


@checked
def convert(
    source: str | PathLike[str],
    description: ImportDescription | Mapping[str, Any] | str | PathLike[str] | None = None,
    **declared: Any,  # noqa: ANN401 - the keys of an ImportDescription, each with its type
) -> xr.Dataset:
    """Convert another program's file to a record.

    Declarations are checked against what the file states: rates, sample times, start times and units. Samples that the
    sample times skip become NaN.

    Parameters
    ----------
    source : str or Path
        A .mat, .wav, .csv, .txt, .tsv, .asc, .tdms, .lvm, .mf4, .mdf, .uff, .unv, .h5, .hdf5, .nc, .npy or .npz file.
    description : ImportDescription, mapping or path, optional
        What the file holds and does not state, or the path of a TOML file with it.
    **declared
        Keys of `hums.ImportDescription`, which override those of `description`. Usually sufficient are ``channels``,
        ``units``, ``rate_hz``, and one source of the shaft angle, such as ``shaft_rpm`` with ``shaft``.

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
    from hums.readers.description import OF_MANY_FILES, describe  # noqa: PLC0415 - it loads pydantic

    spec = describe(description, **declared)
    if of_many := sorted(spec.model_fields_set.intersection(OF_MANY_FILES)):
        raise RecordError(f"{of_many[0]} applies to many files, not to {source} alone; omit it, or use convert_files.")
    file = located(read_file(source, spec), spec.time_zone)
    if not spec.channels:
        raise RecordError(f"no channel of {file.path.name} is named (--channel, channels). {file.contents()}")
    for name in (*spec.scale, *(spec.units if isinstance(spec.units, dict) else ())):
        file.vector(name)
    if spec.time_column and (count := file.vector(spec.time_column).size) != file.vector(spec.channels[0]).size:
        raise RecordError(
            f'{file.path.name}: time_column="{spec.time_column}" has {count} values, unlike "{spec.channels[0]}"; '
            "name the column of its sample times."
        )
    one = Import(file=file, spec=spec)
    found = {name: _channel(one, name) for name in spec.channels}
    start_s, began, angle = 0.0, None, None
    if spec.average is None:
        start_s, began = one.start_and_epoch()
        angle = _angle(one, epoch=began)
        each = {name: one.of(name) for name in spec.channels}
        found = {
            name: replace(channel, values=each[name].filled(np.asarray(channel.values)), rate_hz=each[name].rate_hz)
            for name, channel in found.items()
        }
    recorded_at = _recorded_at(one, began, start_s=start_s)
    quantities = _measured(one)
    for note in dict.fromkeys(note for name in spec.channels for note in file.metadata(name).notes):
        names = [f'"{name}"' for name in spec.channels if note in file.metadata(name).notes]
        one.note(f"{' and '.join(names)} {note if len(names) == 1 else note.replace('states', 'state', 1)}")
    if one.notes:
        warnings.warn(f"{file.path.name}: {'. '.join(one.notes)}.", RecordWarning, stacklevel=2)
    return make_record(
        {file.label(name): channel for name, channel in found.items()},
        rate_hz=None if spec.average else one.of(spec.channels[0]).rate_hz,
        angle=spec.average or angle,
        measured=quantities,
        machine=spec.machine,
        regime=spec.regime,
        recorded_at=recorded_at,
        start_s=start_s,
        attrs={"source": file.path.name, "site": spec.site, "analyst": spec.analyst, "notes": ". ".join(one.notes)},
    )


def _channel(source: Import, name: str) -> Channel:
    """Return a field as a channel in its units, with the sensor data that the file states."""
    stated, scale = source.file.metadata(name), source.spec.scale_of(name)
    values = source.file.vector(name)
    channel = Channel(
        values=values if scale == 1 else np.multiply(values, scale),
        units=_units(source, name),
        delay_s=stated.delay_s,
    )
    volts = {"V": 1.0, "mV": 1e-3}.get(CANONICAL_UNITS.get(channel.units, ""))
    if stated.sensitivity is None or volts is None or scale != 1:
        return channel
    return replace(channel, sensitivity=stated.sensitivity / volts, measures=stated.measures)


def _recorded_at(source: Import, stated: datetime | None, *, start_s: float) -> datetime | None:
    """Return the time of a record, as declared or stated by the file."""
    declared = source.spec.moment
    minutes_s = 300.0  # a declared time may be that of the record's end, to the minute
    if declared is None or stated is None or abs((declared - stated).total_seconds() - start_s) <= minutes_s:
        return declared or stated
    contradiction = f"recorded_at={declared.isoformat()} contradicts {source.file.path.name}, which states "
    settled: datetime = source.settle(f"{contradiction}{utc_text(stated)}", declared, stated)
    return settled


def _angle(source: Import, *, epoch: datetime | None) -> Angle | None:
    """Return the declared source of the shaft angle; None if there is none, for which make_record raises the error."""
    file, spec = source.file, source.spec
    if spec.no_tachometer:
        return UnknownAngle()
    if spec.shaft_rpm is not None:
        return NominalSpeed(rpm=spec.shaft_rpm, shaft=spec.shaft)
    if spec.speed_column is not None:
        speed_hz = _steady_speed_hz(source, spec.speed_column, spec.speed_units)
        return NominalSpeed(rpm=60 * speed_hz, shaft=spec.shaft)
    name = spec.tach_times or spec.tach_waveform
    if name is None:
        return None
    stated, per_rev = file.metadata(name).pulses_per_rev, spec.pulses_per_rev
    per_rev = int(stated) if per_rev is None and stated is not None and float(stated).is_integer() else per_rev
    if per_rev is None:
        raise RecordError(
            f'the tachometer "{name}" needs its pulses per revolution of "{spec.shaft}": pulses_per_rev=... '
            "(--pulses-per-rev)."
        )
    if stated is not None and stated != per_rev:
        contradiction = f'pulses_per_rev={per_rev} contradicts {file.path.name}, which states {stated:g} for "{name}"'
        per_rev = source.settle(contradiction, per_rev, int(stated))
    if spec.tach_times:
        times_s = _unpadded(seconds_of(file, name, epoch=epoch))
        return PulseTimes(times_s=times_s, shaft=spec.shaft, pulses_per_rev=per_rev)
    clock = source.of(name)
    return TachometerWaveform(
        values=clock.filled(file.vector(name)),
        shaft=spec.shaft,
        pulses_per_rev=per_rev,
        rate_hz=clock.rate_hz,
        threshold=spec.threshold,
        hysteresis=spec.hysteresis,
    )


def _agreed_units(
    source: Import, name: str, declared: str | None, meaning: Callable[[str], object], remedy: str = ""
) -> str:
    """Return the units of a field, declared or stated by the file; units with different known meanings contradict."""
    stated = source.file.metadata(name).units
    meanings = {meaning(units) for units in (declared, stated) if units}
    if len(meanings) > 1 and None not in meanings:
        contradiction = f'units="{declared}" contradict {source.file.path.name}, which states "{stated}" for "{name}"'
        return str(source.settle(contradiction, declared, stated, remedy=remedy))
    return declared or stated or ""


def _steady_speed_hz(source: Import, name: str, units: str) -> float:
    """Return the mean of a measured speed in rev/s; refuse a speed that is not constant."""
    file, units = source.file, _agreed_units(source, name, units, SPELLINGS.get)
    unit, factor = quantity_units(units, f'speed "{name}" (speed_units)')
    values = np.asarray(file.vector(name), dtype=np.float64) * factor
    values = np.abs(values[np.isfinite(values)])
    if unit != "rev s-1" or not values.size or not values.mean() > 0:
        raise RecordError(f'{file.path.name}: "{name}" in {units} holds no speed above zero; name a column that does.')
    mean = float(values.mean())
    off = float(np.max(np.abs(values - mean))) / mean
    steady = 0.02  # largest deviation from the mean: the default tolerance of an analysis for a declared speed
    if off > steady:
        raise RecordError(
            f'{file.path.name}: the speed "{name}" deviates by {off:.1%} from its mean, {60 * mean:.6g} rpm; a '
            f"constant speed deviates by at most {steady:.0%}. Name a tachometer (tach_times, tach_waveform), or have "
            "the speed estimated from the vibration (no_tachometer)."
        )
    return mean


def _measured(source: Import) -> dict[str, Measured]:
    """Return the quantities measured with a record: single numbers, or samples at its rate or their own."""
    found, file, spec = {}, source.file, source.spec
    channel = spec.channels[0]
    count = file.vector(channel).size
    for name, declared in spec.measured.items():
        values = np.asarray(file.vector(name), dtype=np.float64)
        unit = _agreed_units(source, name, declared, SPELLINGS.get)
        if spec.average or values.size == 1:
            if not np.isfinite(values).any():
                raise RecordError(f'{file.path.name}: "{name}" holds no number; remove it from measured.')
            found[file.label(name)] = Measured(values=float(np.nanmean(values)), units=unit)
            continue
        stated, clock = file.metadata(name), source.of(channel)
        if values.size != count and stated.rate_hz is None and stated.times_s is None:
            raise RecordError(
                f'{file.path.name}: "{name}" has {values.size} values for {count} samples, and states no rate; '
                "build the record in Python, Measured(values=..., units=..., rate_hz=...)."
            )
        if values.size != count:  # at its own rate, to which the declared one does not apply
            clock = replace(source, spec=spec.changed(rate_hz=None), clocks={}).of(name)
        found[file.label(name)] = Measured(values=clock.filled(values), units=unit, rate_hz=clock.rate_hz)
    return found


def _units(source: Import, name: str) -> str:
    """Return the units of a channel, declared or stated by the file; stated units apply only at scale 1."""
    scale, declared, stated = source.spec.scale_of(name), source.spec.units_of(name), source.file.metadata(name).units
    if scale == 1:
        remedy = f'Give the factor from "{stated}" to "{declared}", scale={{"{name}": ...}}, or omit the units. '
        return _agreed_units(source, name, declared, CANONICAL_UNITS.get, remedy)
    if stated is not None and declared is None:
        raise RecordError(
            f'{source.file.path.name} states "{stated}" for "{name}", which no longer holds after scale={scale:g}: '
            'declare units="..." (--units).'
        )
    return declared or ""


def _unpadded(times_s: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return times without the trailing NaN that pad a shorter column of a table."""
    filled = np.flatnonzero(~np.isnan(times_s))
    return times_s[: filled[-1] + 1] if filled.size else times_s
