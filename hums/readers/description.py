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
        f"{brief(value)} is no word, list of words in the order of the channels, or table of words by name"
    )


def _scale(value: object) -> Any:  # noqa: ANN401
    inner = value.values() if isinstance(value, dict) else [value]
    if all(is_float(one) and math.isfinite(one) and one != 0 for one in inner):
        return value
    raise ValueError(f"{brief(value)} is no finite number other than zero, or table of such numbers by channel")


def _average(value: object) -> AngularAverage:
    try:
        return AngularAverage(**value) if isinstance(value, dict) else cast("AngularAverage", value)
    except TypeError:
        raise ValueError(f"{brief(value)}: a table of component, samples_per_rev and averaged_over is needed") from None


def _moment(value: object) -> str:
    try:
        return value.isoformat() if isinstance(value, datetime) else datetime.fromisoformat(str(value)).isoformat()
    except ValueError:
        raise ValueError(f"{brief(value)} is no date and time in ISO 8601, as 2013-03-11T03:00:24Z") from None


class ImportDescription(Declared):
    """How files of another program are read: what they hold, and what they do not state.

    Attributes
    ----------
    channels : tuple of str
        Names of the vibration channels in the file; a member of a struct or a group by its path, "bearing.gs". In a
        record the parts of a name are joined by dots.
    units : str, tuple of str or mapping of str to str
        Units of the channels after `scale`: of all, of each in their order, or by name.
    scale : float or mapping of str to float
        Factor from the numbers in the file to `units`, of all channels or by name; for a .wav of integers, the value of
        full scale.
    separator, decimal, encoding : str or None
        Of a text file: the sign between cells, the decimal sign, and the encoding by its Python name.
    header_lines : int or None
        Number of lines above the first row of numbers, the line of names among them.
    rate_hz : float or None
        Sampling rate.
    time_column : str or None
        Column of the times of the samples: in the unit of its header, in `time_unit`, since 1970, or as text.
    time_unit : {"s", "ms", "us"} or None
        Unit of a column of times whose header states none.
    time_zone : str or None
        Of local times in the file or in the names of files, "Europe/Berlin", "UTC" or "+01:00".
    shaft : str
        Shaft that carries the tachometer or turns at the declared speed.
    tach_times, tach_waveform : str or None
        Pulse times in s, or the sampled signal of a tachometer.
    pulses_per_rev : int or None
        Pulses in one revolution of `shaft`.
    threshold, hysteresis : float or None
        Of `tach_waveform`, in its units, as in `hums.TachometerWaveform`.
    shaft_rpm : float or None
        Declared constant speed in rev/min.
    speed_column, speed_units : str
        Measured speed of `shaft` and its units: its mean is the declared speed, from which it may depart by 2 %.
    no_tachometer : bool
        No shaft angle is known: the speed is estimated from the vibration.
    measured : mapping of str to str
        Units of loads, temperatures and other quantities, by their names in the file.
    average : AngularAverage or None
        The channels are averages in angle already: a table of the fields of `hums.AngularAverage`.
    machine : str
        Name of the machine.
    regime : str
        Operating regime, such as "hover" or "cruise": `hums.fleet` learns what is normal for each by itself.
    site, analyst : str
        Where the machine stands and who analyses it, for the head of the report.
    recorded_at : str or None
        Time of the record, ISO 8601; with `every_s` that of the file with the lowest number.
    time_in_names : str or None
        Pattern of the names of files, with the directives of `datetime.strptime`: "acc_%Y%m%d_%H%M%S".
    every_s : float or None
        Seconds from one number in the names of files to the next.
    snapshots : int
        Number of successive files that are joined to one record of snapshots.
    trust : {"declared", "file"} or None
        Which holds where a file contradicts the description; without it a contradiction is refused.
    most_bytes : int or None
        Bytes that one array of a file may take; default a hundred times its size, or 64 MB.

    Examples
    --------
    >>> import hums
    >>> described = hums.ImportDescription(channels=["DE", "ND"], units=["g", "mm/s"], no_tachometer=True)
    >>> described.units_of("ND")
    'mm/s'
    """

    channels: tuple[str, ...] = ()
    units: Annotated[Any, PlainValidator(_units)] | None = None
    scale: Annotated[Any, PlainValidator(_scale)] = 1.0
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
        """Time of the record with its offset from UTC; RecordError where neither it nor `time_zone` states that."""
        if self.recorded_at is None:
            return None
        moment = datetime.fromisoformat(self.recorded_at)
        located = in_zone(moment, self.time_zone) if self.time_zone and moment.tzinfo is None else moment
        return datetime.fromisoformat(utc_text(located))

    def units_of(self, name: str) -> str | None:
        """Return the declared units of a channel."""
        if isinstance(self.units, tuple):
            return dict(zip(self.channels, self.units, strict=True)).get(name)
        return self.units.get(name) if isinstance(self.units, dict) else self.units

    def scale_of(self, name: str) -> float:
        """Return the factor from the numbers of a channel to its units."""
        return float(self.scale.get(name, 1.0) if isinstance(self.scale, dict) else self.scale)

    def keys(self) -> dict[str, Any]:
        """Return the keys that are not left at their defaults, as JSON types."""
        return self.model_dump(mode="json", exclude_defaults=True)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if isinstance(self.units, tuple) and len(self.units) != len(self.channels):
            many = f"units = {list(self.units)} are not as many as the {len(self.channels)} channels"
            raise ValueError(f"{many}; give one for all, or one for each in their order")
        if self.time_zone is not None:
            zone_of(self.time_zone)
        if self.every_s is not None and self.recorded_at is None:
            raise ValueError(f"every_s = {self.every_s:g} needs recorded_at, when the first file was recorded")
        sources = [name for name in ANGLE_SOURCES if getattr(self, name) not in {None, False}]
        if len(sources) > 1:
            raise ValueError(f"{' and '.join(sources)}: the shaft angle has one source; give one of them")
        source = sources[0] if sources else None
        meaningless = [name for name in ("rate_hz", *ANGLE_SOURCES[:-1]) if self.average and getattr(self, name)]
        if meaningless:
            raise ValueError(f"{meaningless[0]} has no meaning for an average in angle; leave it out")
        if source not in {None, "no_tachometer"} and not self.shaft:
            raise ValueError(f'{source} needs the shaft that it belongs to: shaft = "..." (--shaft)')
        if self.pulses_per_rev is not None and source in {"shaft_rpm", "speed_column"}:
            raise ValueError(f"pulses_per_rev has no meaning with {source}; leave one of them out")
        for name in ("threshold", "hysteresis"):
            if getattr(self, name) is not None and source != "tach_waveform":
                raise ValueError(
                    f"{name} = {getattr(self, name):g} belongs to a tach_waveform; name it, or leave it out"
                )
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
        Keys that take the place of those in `description`; None for none.

    Raises
    ------
    RecordError
        A file that cannot be read, an unknown key, or a value of another kind than its key needs.
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
