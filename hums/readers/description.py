"""Import descriptions: what files of another program hold and do not state, as a hand-written TOML file."""

import math
from collections.abc import Mapping
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from hums.gearbox.components import Declared, Positive, read_toml, validated
from hums.readers.columns import in_zone, zone_of
from hums.records.fields import RecordError, utc_text
from hums.records.quantities import AngularAverage
from signals._validation import brief, is_float

OF_MANY_FILES = ("time_in_names", "every_s", "snapshots")
ANGLE_SOURCES = ("tach_times", "tach_waveform", "shaft_rpm", "speed_column", "no_tachometer")


def _units(value: object) -> Any:  # noqa: ANN401
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else [value]
    if all(isinstance(one, str) for one in inner):
        return value
    raise ValueError(
        f"{brief(value)} is not a word, a list of words in the order of the channels, or a table of words by name"
    )


def _scale(value: object) -> Any:  # noqa: ANN401
    if isinstance(value, dict) and all(is_float(one) and math.isfinite(one) and one != 0 for one in value.values()):
        return value
    raise ValueError(f"{brief(value)}: a table of finite numbers other than zero by channel is needed, {{ DE = 9.81 }}")


def _average(value: object) -> AngularAverage:
    try:
        return AngularAverage(**value) if isinstance(value, dict) else cast("AngularAverage", value)
    except TypeError:
        raise ValueError(f"{brief(value)}: a table of component, samples_per_rev and averaged_over is needed") from None


def _moment(value: object) -> str:
    try:
        return value.isoformat() if isinstance(value, datetime) else datetime.fromisoformat(str(value)).isoformat()
    except ValueError:
        raise ValueError(f"{brief(value)} is not a date and time in ISO 8601, such as 2013-03-11T03:00:24Z") from None


class ImportDescription(Declared):
    """How files of another program are read: what they hold, and what they do not state.

    Attributes
    ----------
    channels : tuple of str
        Names of the vibration channels in the file; members of structs and groups by path, "bearing.gs". In a record
        the parts of a name are joined by dots.
    units : str, tuple of str or mapping of str to str
        Units of the channels after `scale`: one for all, one per channel in their order, or by name.
    scale : mapping of str to float
        Factor from the numbers in the file to `units`, by channel; for a .wav of integers, the value at full scale.
    separator, decimal, encoding : str or None
        Of a text file: cell separator, decimal sign, and Python name of the encoding.
    header_lines : int or None
        Number of lines above the first row of numbers, the line of names included.
    rate_hz : float or None
        Sampling rate in Hz.
    time_column : str or None
        Column of sample times: in the unit of its header or `time_unit`, in seconds since 1970, or as text.
    time_unit : {"s", "ms", "us"} or None
        Unit of a column of times whose header states none.
    time_zone : str or None
        Time zone of local times in the file or in file names: "Europe/Berlin", "UTC" or "+01:00".
    shaft : str
        Shaft that carries the tachometer or rotates at the declared speed.
    tach_times, tach_waveform : str or None
        Field with the pulse times in s, or with the sampled signal of a tachometer.
    pulses_per_rev : int or None
        Pulses per revolution of `shaft`.
    threshold, hysteresis : float or None
        Trigger level and hysteresis of `tach_waveform` in its units, as in `hums.TachometerWaveform`.
    shaft_rpm : float or None
        Declared constant speed in rev/min.
    speed_column, speed_units : str
        Field with the measured speed of `shaft`, and its units. Its mean is taken as the declared speed, from which it
        may deviate by 2 %.
    no_tachometer : bool
        Whether the shaft angle is unknown, so that the speed is estimated from the vibration.
    measured : mapping of str to str
        Units of loads, temperatures and other quantities, by their names in the file.
    average : AngularAverage or None
        Fields of `hums.AngularAverage`, if the channels are synchronous averages.
    machine : str
        Name of the machine.
    regime : str
        Operating regime, such as "hover" or "cruise", for each of which a fleet learns its own baseline.
    site, analyst : str
        Site of the machine and name of the analyst, for the header of the report.
    recorded_at : str or None
        Time of the record, ISO 8601; with `every_s`, that of the file with the lowest number.
    time_in_names : str or None
        Pattern of file names with directives of `datetime.strptime`: "acc_%Y%m%d_%H%M%S".
    every_s : float or None
        Interval in s between consecutive numbers in file names.
    snapshots : int
        Number of successive files joined into one record of snapshots.
    trust : {"declared", "file"} or None
        Which prevails if a file contradicts the description. Default: contradictions are refused.
    most_bytes : int or None
        Maximum size of one array in bytes. Default: 100 times the size of the file, at least 64 MB.

    Examples
    --------
    >>> import hums
    >>> described = hums.ImportDescription(channels=["DE", "ND"], units=["g", "mm/s"], no_tachometer=True)
    >>> described.units_of("ND")
    'mm/s'
    """

    channels: tuple[str, ...] = ()
    units: Annotated[Any, PlainValidator(_units)] | None = None
    scale: Annotated[Any, PlainValidator(_scale)] = Field(default_factory=dict)
    separator: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    encoding: str | None = None
    header_lines: Annotated[int, Field(ge=0)] | None = None
    rate_hz: Positive | None = None
    time_column: str | None = None
    time_unit: Literal["s", "ms", "us"] | None = None
    time_zone: str | None = None
    shaft: str = ""
    tach_times: str | None = None
    tach_waveform: str | None = None
    pulses_per_rev: Annotated[int, Field(ge=1)] | None = None
    threshold: float | None = None
    hysteresis: Positive | None = None
    shaft_rpm: Positive | None = None
    speed_column: str | None = None
    speed_units: str = ""
    no_tachometer: bool = False
    measured: dict[str, str] = Field(default_factory=dict)
    average: Annotated[AngularAverage, BeforeValidator(_average)] | None = None
    machine: str = ""
    regime: str = ""
    site: str = ""
    analyst: str = ""
    recorded_at: Annotated[Any, PlainValidator(_moment)] | None = None
    time_in_names: str | None = None
    every_s: Positive | None = None
    snapshots: Annotated[int, Field(ge=1)] = 1
    trust: Literal["declared", "file"] | None = None
    most_bytes: Annotated[int, Field(ge=1)] | None = None

    @property
    def moment(self) -> datetime | None:
        """Time of the record with its UTC offset; RecordError if neither it nor `time_zone` states the offset."""
        if self.recorded_at is None:
            return None
        moment = in_zone(datetime.fromisoformat(self.recorded_at), self.time_zone)
        return datetime.fromisoformat(utc_text(moment))

    def units_of(self, name: str) -> str | None:
        """Return the declared units of a channel."""
        if isinstance(self.units, tuple):
            return dict(zip(self.channels, self.units, strict=True)).get(name)
        return self.units.get(name) if isinstance(self.units, dict) else self.units

    def scale_of(self, name: str) -> float:
        """Return the factor from the numbers of a channel to its units."""
        return float(self.scale.get(name, 1.0))

    def keys(self) -> dict[str, Any]:
        """Return the keys that differ from their defaults, as JSON types."""
        return self.model_dump(mode="json", exclude_defaults=True)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if isinstance(self.units, tuple) and len(self.units) != len(self.channels):
            many = f"units = {list(self.units)} do not match the {len(self.channels)} channels"
            raise ValueError(f"{many}; give one for all, or one for each in their order")
        if self.time_zone is not None:
            zone_of(self.time_zone)
        if self.every_s is not None and self.recorded_at is None:
            raise ValueError(f"every_s = {self.every_s:g} needs recorded_at, the time of the first file")
        sources = [name for name in ANGLE_SOURCES if getattr(self, name) not in {None, False}]
        if len(sources) > 1:
            raise ValueError(f"{' and '.join(sources)}: the shaft angle has a single source; give one of them")
        source = sources[0] if sources else None
        meaningless = [name for name in ("rate_hz", *ANGLE_SOURCES[:-1]) if self.average and getattr(self, name)]
        if meaningless:
            raise ValueError(f"{meaningless[0]} has no meaning for a synchronous average; omit it")
        if source not in {None, "no_tachometer"} and not self.shaft:
            raise ValueError(f'{source} needs the shaft to which it refers: shaft = "..." (--shaft)')
        if self.pulses_per_rev is not None and source in {"shaft_rpm", "speed_column"}:
            raise ValueError(f"pulses_per_rev has no meaning with {source}; omit one of them")
        for name in ("threshold", "hysteresis"):
            if getattr(self, name) is not None and source != "tach_waveform":
                raise ValueError(f"{name} = {getattr(self, name):g} needs a tach_waveform; name one, or omit {name}")
        return self


def describe(
    description: ImportDescription | Mapping[str, Any] | str | PathLike[str] | None = None,
    **declared: Any,  # noqa: ANN401
) -> ImportDescription:
    """Return an import description with some of its keys replaced.

    Parameters
    ----------
    description : ImportDescription, mapping or path, optional
        The keys of `ImportDescription`, or a TOML file that holds them.
    **declared
        Keys that override those of `description`; None is ignored.

    Raises
    ------
    RecordError
        If the file cannot be read, a key is unknown, or a value is invalid.
    """
    where, table = "import description", dict[str, Any]()
    if isinstance(description, ImportDescription):
        table = description.model_dump(exclude_defaults=True)
    elif isinstance(description, Mapping):
        table = dict(description)
    elif description is not None:
        where, table = str(description), read_toml(Path(description), error=RecordError)
    table |= {name: value for name, value in declared.items() if value is not None}
    plain = {
        name: value.tolist() if isinstance(value, np.generic | np.ndarray) else value for name, value in table.items()
    }
    return validated(ImportDescription, plain, where=where, error=RecordError)
