"""TDMS files of LabVIEW and its loggers: channels in groups, each with properties."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hums.readers.columns import Field, ForeignFile, Stated, joined, phrase_of, stated_of
from hums.readers.description import ImportDescription
from hums.records.fields import RecordError


def read(path: Path, _: ImportDescription) -> ForeignFile:
    """Return every channel as "group.channel", scaled as the file states, with its metadata.

    The metadata are LabVIEW's waveform properties ``unit_string``, ``wf_increment`` (s), ``wf_start_time`` (UTC) and
    ``wf_start_offset`` (s).

    Raises
    ------
    RecordError
        If the file is truncated.
    """
    import nptdms  # noqa: PLC0415

    contents = nptdms.TdmsFile.read(path)
    channels = [channel for group in contents.groups() for channel in group.channels()]
    found = [(_name(channel), np.asarray(channel[:]), channel) for channel in channels]
    pieces = _pieces(path)
    if contents.file_status.incomplete_final_segment or not channels:
        raise RecordError(f"{path} is damaged: its last part is cut off. Copy it again from its source.")
    fields: dict[str, Field] = {name: phrase_of(one.dtype, one.size) or one for name, one, _ in found}
    if len(fields) < len(found):
        raise RecordError(f"{path}: two channels have the same name once slashes become dots; rename one of them.")
    stated = {name: _stated(channel, pieces.get(channel.path, [])) for name, _, channel in found}
    for group in contents.groups():
        stated[group.name.replace("/", ".").strip()] = stated_of(group.properties)
    stated[""] = stated_of(contents.properties)
    return ForeignFile(path=path, fields=fields, stated=stated)


def _pieces(path: Path) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """Return, by channel, the number of samples before each segment that states properties, and these properties.

    npTDMS itself keeps only those of the last segment, whose start is not that of the channel.
    """
    from nptdms.reader import TdmsReader  # noqa: PLC0415

    found: dict[str, list[tuple[int, dict[str, Any]]]] = {}

    class Reader(TdmsReader):  # type: ignore[misc]
        def _update_object_metadata(self, segment: Any) -> None:  # noqa: ANN401
            self.before = {name: data.num_values for name, data in self.object_metadata.items()}
            super()._update_object_metadata(segment)

        def _update_object_properties(self, stated: Any) -> None:  # noqa: ANN401
            for name, properties in (stated or {}).items():
                found.setdefault(name, []).append((self.before.get(name, 0), dict(properties)))
            super()._update_object_properties(stated)

    reader = Reader(path)
    try:
        reader.read_metadata()
    finally:
        reader.close()
    return found


def _name(channel: Any) -> str:  # noqa: ANN401
    return f"{channel.group_name}.{channel.name}".replace("/", ".").strip()


def _stated(channel: Any, pieces: list[tuple[int, dict[str, Any]]]) -> Stated:  # noqa: ANN401
    """Return the metadata of a channel, with the clock of its first segment, and times if a later one differs."""
    stated = stated_of(channel.properties)
    if stated.rate_hz is None:
        return replace(stated, epoch=None, start_s=None)
    clock: dict[str, Any] = {}
    starts: dict[int, Stated] = {}
    of_clock = ("wf_start_time", "wf_start_offset", "wf_increment")
    for first, properties in pieces:
        before, clock = clock, clock | {key: properties[key] for key in of_clock if key in properties}
        if clock != before:
            starts[first] = stated_of(clock)
    counts = np.diff([*starts, len(channel)]).tolist()
    return joined(list(zip(counts, starts.values(), strict=True))).over(stated) if starts else stated
