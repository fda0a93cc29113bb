"""LabVIEW measurement files: a header, then segments, each with its own header.

The format is NI's "Specification for the LabVIEW Measurement File (.lvm)".
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import ForeignFile, Stated, joined, rate_of_step
from hums.readers.csv import encoding_of
from hums.readers.description import ImportDescription
from hums.records.clock import time_scale
from hums.records.fields import RecordError

_SINCE_1904 = datetime(1904, 1, 1, tzinfo=UTC)

Segment = tuple[dict[str, list[str]], list[str], list[list[str]]]
"""The header by tag, the names of the columns, and the rows."""


def read(path: Path, _: ImportDescription) -> ForeignFile:
    """Return every channel, with its segments concatenated, and its units, rate and start.

    The date and time of a segment are local times. With several segments, or packets of which only the first has a
    header, each sample has its own time.

    Raises
    ------
    RecordError
        If the file is not a LabVIEW measurement file, names no channel, or is truncated.
    """
    lines = path.read_text(encoding=encoding_of(path)).splitlines()
    if not lines or not lines[0].startswith("LabVIEW Measurement"):
        raise RecordError(f"{path} is not a LabVIEW measurement file by its first line. Export it again.")
    general, segments = _segments(lines)
    x_columns, decimal = general.get("X_Columns", ["", "One"])[1], general.get("Decimal_Separator", ["", "."])[1]
    step = 2 if x_columns == "Multi" else 1
    found: dict[str, list[tuple[NDArray[np.float64], Stated]]] = {}
    for tags, names, rows in segments:
        longest = max(int(count or 0) for count in tags["Samples"][1:])
        if len(rows) < longest:
            raise RecordError(f"{path} is damaged: a segment has {len(rows)} of {longest} samples. Copy it again.")
        for place in range(1, 1 + step * int(tags["Channels"][1]), step):
            own = {tag: cells[1] for tag, cells in general.items() if tag in {"Date", "Time"}}
            own |= {tag: cells[place] for tag, cells in tags.items() if place < len(cells) and cells[place]}
            appended = len(rows) > longest  # packets without a header
            values = _column(rows if appended else rows[: int(own["Samples"])], place, decimal)
            times = _column(rows, place - 1 if step > 1 else 0, decimal) if appended and x_columns != "No" else None
            found.setdefault(names[place] or f"channel {place}", []).append((values, _stated(own, decimal, times)))
    if not found:
        raise RecordError(f"{path} has no segment header, which names the channels; export it with headers.")
    return ForeignFile(
        path=path,
        fields={name: np.concatenate([values for values, _ in parts]) for name, parts in found.items()},
        stated={name: joined([(values.size, own) for values, own in parts]) for name, parts in found.items()},
    )


def _segments(lines: Sequence[str]) -> tuple[dict[str, list[str]], list[Segment]]:
    """Return the header of the file by tag, and the header, column names and rows of each segment."""
    separator = next((line[9] for line in lines if line.startswith("Separator") and line[9:]), "\t")
    general: dict[str, list[str]] = {}
    segments: list[Segment] = []
    tags: dict[str, list[str]] | None = {}  # None among rows
    special = False
    for cells in ([cell.strip() for cell in line.split(separator)] for line in lines):
        first = cells[0]
        if first == "***Start_Special***" or special:
            special = first != "***End_Special***"
        elif first == "***End_of_Header***" and tags is not None:
            if "Channels" in tags:
                segments.append((tags, [], []))
            general = general or tags
            tags = None if segments else {}
        elif tags is None and not segments[-1][1]:
            segments[-1][1].extend(cells)
        elif any(cells):
            if tags is None and first[:1].isalpha() and first not in {"NaN", "Inf"}:
                tags = {}
            if tags is None:
                segments[-1][2].append(cells)
            else:
                tags[first] = [*cells, ""]
    return general, segments


def _column(rows: list[list[str]], place: int, decimal: str) -> NDArray[np.float64]:
    cells = [row[place].replace(decimal, ".") if place < len(row) else "" for row in rows]
    return np.array([float(cell or "nan") for cell in cells])


def _stated(own: Mapping[str, str], decimal: str, times: NDArray[np.float64] | None) -> Stated:
    """Return the metadata of a channel in a segment header, with times if they are more than a start and a step."""
    units = own.get("Y_Unit_Label")
    if own.get("X_Dimension", "Time") != "Time":
        return Stated(units=units)
    x0, step = (float(own.get(tag, "0").replace(decimal, ".")) for tag in ("X0", "Delta_X"))
    unit_s, _ = time_scale(own.get("X_Unit_Label")) or (1.0, None)
    began = datetime.fromisoformat(f"{own['Date'].replace('/', '-')}T{own['Time']}") if "Date" in own else None
    epoch, start_s = began if began is not None and began.year >= _SINCE_1904.year else None, unit_s * x0
    if start_s > 1e8:  # noqa: PLR2004 - three years: counted from 1904
        epoch, start_s = _SINCE_1904 + timedelta(seconds=start_s), 0.0
    times_s = None if times is None else start_s + unit_s * (times - x0)
    return Stated(units=units, rate_hz=rate_of_step(unit_s * step), start_s=start_s, epoch=epoch, times_s=times_s)
