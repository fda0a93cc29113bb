"""TDMS files of LabVIEW and its loggers: channels in groups, each with properties."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from hums.readers.columns import Field, Stated, rate_of_step
from hums.records.record import RecordError

__all__ = ["read"]


def read(path: Path) -> tuple[dict[str, Field], dict[str, Stated]]:
    """Return every channel as "group.channel", scaled as the file states, and the metadata of each.

    The metadata are LabVIEW's waveform properties ``unit_string``, ``wf_increment`` (s), ``wf_start_time`` (UTC) and
    ``wf_start_offset`` (s).

    Raises
    ------
    RecordError
        If npTDMS is not installed, or the file is no TDMS file or cut off.
    """
    try:
        import nptdms  # noqa: PLC0415
    except ImportError as error:
        raise RecordError(
            f'{path}: TDMS files are read with npTDMS, which is not installed: pip install "hums-toolkit[readers]".'
        ) from error
    try:
        contents = nptdms.TdmsFile.read(path)
        channels = [channel for group in contents.groups() for channel in group.channels()]
        found = [(_name(channel), channel[:], dict(channel.properties)) for channel in channels]
    except Exception as error:  # a parser may fail in any way on damaged bytes
        raise RecordError(f"{path} is no TDMS file, or damaged ({error}). Copy it again from where it came.") from error
    if contents.file_status.incomplete_final_segment or not channels:
        raise RecordError(f"{path} is damaged: its last part is cut off. Copy it again from where it came.")
    fields = {name: _field(values) for name, values, _ in found}
    if len(fields) < len(found):
        raise RecordError(f"{path}: two of its channels have one name once slashes are dots; rename one of them.")
    return fields, {name: _stated(properties) for name, _, properties in found}


def _name(channel: Any) -> str:  # noqa: ANN401
    return f"{channel.group_name}.{channel.name}".replace("/", ".").strip()


def _field(values: Any) -> Field:  # noqa: ANN401
    array = np.asarray(values)
    if array.size == 0:
        return "empty"
    phrases = {"O": "text", "U": "text", "S": "text", "M": "times of day", "c": "complex numbers"}
    return phrases.get(array.dtype.kind, array)


def _stated(properties: Mapping[str, Any]) -> Stated:
    units, offset, start_time = (properties.get(key) for key in ("unit_string", "wf_start_offset", "wf_start_time"))
    rate_hz = rate_of_step(properties.get("wf_increment"))
    return Stated(
        units=str(units).strip() or None if units is not None else None,
        rate_hz=rate_hz,
        start_s=float(offset) if rate_hz and isinstance(offset, int | float | np.number) else None,
        epoch=_utc_time(start_time) if rate_hz else None,
    )


def _utc_time(stamp: object) -> datetime | None:
    """Return a TDMS time stamp, which is in UTC; None for LabVIEW's zero, in 1904."""
    if not isinstance(stamp, np.datetime64) or np.isnat(stamp):
        return None
    time = datetime.fromisoformat(str(stamp.astype("datetime64[us]"))).replace(tzinfo=UTC)
    return time if time.year > 1904 else None  # noqa: PLR2004
