"""CSV files: columns named by a header line, or numbered without one."""

import codecs
import csv
import re
import warnings
from collections import Counter
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import Stated, canonical_units
from hums.records.record import RecordError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["read"]

_ENCODING = "utf-8-sig"  # spreadsheets begin with a byte order mark
_HEAD = 100  # lines from which the format is detected


def read(path: Path) -> tuple[dict[str, NDArray[np.generic] | str], dict[str, Stated]]:
    """Return the columns, (n,) each, under the names of the header or as "column 1", "column 2", ..., and their units.

    Separators are semicolons, tabs, commas or, without any of them, blanks; with the first two a comma in a number is
    its decimal point. Text is UTF-8, or UTF-16 as some spreadsheets and loggers write it. Blank cells are NaN; rows
    with fewer cells than the first are refused. A header such as "DE [m/s²]" states units, which are then no part of
    the name; so does a line of units below it. Lines of a logger above the header are left out.
    """
    import pandas as pd  # noqa: PLC0415

    encoding = _encoding(path)
    above, titles = _above_numbers(path, encoding)
    first, *others = _head(path, encoding, above) or [""]
    separator = _separator(first)
    if separator == " " and others and _separator(others[0]) != " ":
        separator = ","  # one column, whose name has blanks
    parts = first.split(separator) if separator != " " else first.split()
    cells = [cell.replace(",", ".") for cell in parts if cell.strip()]  # a value may be blank
    without_header = bool(cells) and all(_is_number(cell) for cell in cells)
    rows = [first, *others] if without_header else others
    decimal = "," if separator in ";\t" and any("," in row for row in rows) else "."
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header: data lost
            table = pd.read_csv(
                path,
                sep=separator if separator != " " else r"\s+",
                skiprows=above,
                decimal=decimal,
                header=None if without_header else 0,
                index_col=False,
                skipinitialspace=True,
                low_memory=False,
                encoding=encoding,
                encoding_errors="replace",
            )
    except (ValueError, pd.errors.ParserWarning) as error:
        raise RecordError(
            f"{path} does not read as a table ({error}). Every row needs the columns of the first."
        ) from error
    if table.shape[1] > 1 and table.iloc[:, -1].isna().any():  # a short row leaves its last cells blank
        _refuse_short_rows(path, encoding, separator, above)
    names = [f"column {number}" if without_header else str(name).strip() for number, name in enumerate(table, 1)]
    names = titles or names
    if repeated := [name for name, times in Counter(names).items() if times > 1]:
        raise RecordError(f'{path}: two columns are named "{repeated[0]}"; give each a name of its own.')
    split = {name: _name_and_units(name) for name in names}
    bare = Counter(short for short, _ in split.values())
    fields, stated = {}, {}
    for place, name in enumerate(names):
        short, units = split[name]
        key = short if bare[short] == 1 else name  # "DE [g]" beside "DE [mm/s]": the units tell the columns apart
        fields[key] = _column(table.iloc[:, place])
        if units:
            stated[key] = Stated(units=units, title=name)
    return fields, stated


def _name_and_units(title: str) -> tuple[str, str | None]:
    """Return the name and the units of a header such as "DE [m/s²]" or "DE (g)"; None where it states no known unit.

    One letter in round brackets is taken for units only if it is g: "(V)", "(A)" are vertical and axial, too.
    """
    found = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]]+)\]|\(([^()]+)\))", title)
    if found is None:
        return title, None
    name, square, round_ = found.groups()
    units = (square or round_).strip()
    known = canonical_units(units) is not None and units != "1"
    return (name, units) if known and (square or len(units) > 1 or units == "g") else (title, None)


def _encoding(path: Path) -> str:
    """Return the encoding: UTF-16 by its byte order mark, or without one where every other byte is zero."""
    with path.open("rb") as stream:
        start = stream.read(2 * _HEAD)
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even, odd = start[::2].count(0), start[1::2].count(0)
    if max(even, odd) > 0.9 * len(start) / 2:  # nearly all of one half
        return "utf-16-le" if odd > even else "utf-16-be"
    return _ENCODING


def _head(path: Path, encoding: str, above: int) -> list[str]:
    """Return the first lines that are not blank below those above the table."""
    with path.open(encoding=encoding, errors="replace") as stream:
        return [line.strip("\r\n") for line in islice(filter(str.strip, islice(stream, above, None)), _HEAD)]


def _above_numbers(path: Path, encoding: str) -> tuple[int, list[str]]:
    """Return how many lines stand above a table and its header, and the titles where units have a line of their own.

    A table begins where three lines in a row are as many numbers each. One line above it is its header, as ever.
    """
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = [line.strip("\r\n") for line in islice(stream, _HEAD)]
    rows = [_cells(line) for line in lines]
    begin = next((at for at in range(len(rows) - 2) if _are_numbers(rows[at : at + 3])), 0)
    texts = [at for at in range(begin) if lines[at].strip()]
    if len(texts) <= 1:
        return 0, []
    names, units = (rows[at] if len(rows[at]) == len(rows[begin]) else [] for at in texts[-2:])
    if names and units and all(canonical_units(unit.strip(" []()")) is not None for unit in units):
        return begin, [f"{name.strip()} [{unit.strip(' []()')}]" for name, unit in zip(names, units, strict=True)]
    return (texts[-1] if units else begin), []


def _are_numbers(rows: list[list[str]]) -> bool:
    """Return whether rows have as many cells each, numbers or blank."""
    filled = [[cell.replace(",", ".") for cell in row if cell.strip()] for row in rows]
    return len({len(row) for row in rows}) == 1 and all(row and all(map(_is_number, row)) for row in filled)


def _separator(line: str) -> str:
    return next((sign for sign in ";\t," if sign in line), " " if len(line.split()) > 1 else ",")


def _cells(line: str) -> list[str]:
    separator = _separator(line)
    return line.split() if separator == " " else line.split(separator) if line.strip() else []


def _refuse_short_rows(path: Path, encoding: str, separator: str, above: int) -> None:
    """Refuse a row with fewer cells than the first, which pandas pads like blank cells at its end."""
    with path.open(encoding=encoding, errors="replace", newline="") as stream:
        rows = csv.reader(islice(stream, above, None), delimiter=separator, skipinitialspace=True)
        expected = 0
        for row in rows:
            if len(row) <= 1 and not "".join(row).strip():
                continue
            expected = expected or len(row)
            if len(row) < expected:
                line = above + rows.line_num
                raise RecordError(
                    f"{path}: the row in line {line} has {len(row)} of {expected} cells. Every row needs the columns "
                    f'of the first; end a blank one with its separator, "{separator}".'
                )


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().strip('"'))
    except ValueError:
        return False
    return True


def _is_moment(cell: object) -> bool:
    """Return whether a cell is a time in ISO 8601 with its offset from UTC."""
    try:
        return isinstance(cell, str) and datetime.fromisoformat(cell).tzinfo is not None
    except ValueError:
        return False


def _column(column: "pd.Series") -> NDArray[np.generic] | str:
    """Return a column as numbers, times as seconds since 1970, or a phrase that describes what is not numeric."""
    import pandas as pd  # noqa: PLC0415

    if column.empty:
        return "empty"
    if column.dtype.kind in "iuf":
        return column.to_numpy()
    numbers = pd.to_numeric(column, errors="coerce")
    booleans = column.map(lambda cell: isinstance(cell, bool | np.bool))
    invalid = column[column.notna() & (numbers.isna() | booleans)]
    if not column.isna().iloc[0] and _is_moment(column.iloc[0]):
        moments = pd.to_datetime(column, utc=True, format="ISO8601", errors="coerce")
        if moments.notna().all():
            return (moments - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy()
    if invalid.empty:  # whole numbers of more than 64 bits
        return numbers.to_numpy(dtype=np.float64)
    return f'text, "{invalid.iloc[0]}" in row {invalid.index[0] + 1}'
