"""CSV files: columns named by a header line, or numbered without one."""

import codecs
import csv
import re
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hums.readers.columns import Field, ForeignFile, Stated, stated_of
from hums.readers.description import ImportDescription
from hums.records.clock import is_time_name, time_scale
from hums.records.fields import CANONICAL_UNITS, RecordError
from hums.records.quantities import SPELLINGS

if TYPE_CHECKING:
    import pandas as pd

_HEAD = 100  # lines from which the format is detected


def read(path: Path, spec: ImportDescription) -> ForeignFile:
    """Return the columns, (n,) each, under the names of the header or as "column 1", "column 2", ..., and their units.

    A format that is not declared is detected. Separators are semicolons, tabs, commas or else spaces. One decimal sign
    applies to the whole file; the other sign, spaces and apostrophes may separate thousands. Text is UTF-8, UTF-16 or
    Windows-1252. Blank cells are NaN; rows with fewer cells than the first are refused. A header such as "DE [m/s²]"
    states units, which are removed from the name; so does a line of units below it. Lines above the header may state
    the rate.

    Raises
    ------
    RecordError
        If the rows form no table, or the decimal sign is ambiguous.
    """
    import pandas as pd  # noqa: PLC0415

    encoding, separator = spec.encoding or encoding_of(path), spec.separator
    with path.open(encoding=encoding) as stream:
        lines = [line.strip("\r\n") for line in islice(stream, _HEAD + (spec.header_lines or 0))]
    begin, above, titles = _above_numbers(lines, separator, spec.header_lines)
    first, *others = [line for line in lines[above:] if line.strip()] or [""]
    if separator is None:
        separator = _separator(first)
        if separator == " " and others and _separator(others[0]) != " ":
            separator = ","  # one column, whose name has spaces
    without_header = bool(titles) or _are_numbers([_cells(first, separator)])
    decimal = spec.decimal or _decimal(path, encoding, separator, above)
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would lose data
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
        )
    with path.open(encoding=encoding) as stream:  # a short row leaves its last cells blank, one without any none
        blank = table.shape[1] == 1 and sum(1 for _ in stream) > above + len(table) + (not without_header)
    if blank or table.iloc[:, -1].isna().any():
        _refuse_short_rows(path, encoding, separator, above, expected=table.shape[1])
    names = [f"column {number}" if without_header else str(name).strip() for number, name in enumerate(table, 1)]
    names = titles or [re.sub(r"\.(\d+)$", r" (\1)", one) if one.rpartition(".")[0] in table else one for one in names]
    if repeated := [name for name, times in Counter(names).items() if times > 1]:
        raise RecordError(f'{path}: two columns are named "{repeated[0]}"; give each its own name.')
    split = {name: _name_and_units(name) for name in names}
    bare = Counter(short for short, _ in split.values())
    fields, stated = dict[str, Field](), dict[str, Stated]()
    for place, name in enumerate(names):
        short, units = split[name]
        key = short if bare[short] == 1 else name  # "DE [g]" beside "DE [mm/s]": the units tell the columns apart
        values, times = _column(table.iloc[:, place], decimal)
        if isinstance(values, tuple):
            what, row, mostly = values
            line, _ = next(islice(_rows(path, encoding, separator, above), row + (not without_header), None))
            values = f"text, {what} in line {line}"
            is_first = not any(np.isfinite(own[row]) for own in fields.values() if isinstance(own, np.ndarray))
            if mostly and (is_first or is_time_name(name)):
                raise RecordError(
                    f'{path}: "{key}" is {values}, not numbers as in the other rows. Remove rows that are not samples, '
                    "such as statistics at the end; leave single cells without a value blank."
                )
        fields[key] = values
        if times or units:
            stated[key] = replace(times or Stated(units=units), title=name)
    if (general := _stated_above(lines[:above])) != Stated():
        stated[""] = general
    recognised: dict[str, str | int] = {
        "separator": separator,
        "decimal": decimal,
        "encoding": encoding,
        "header_lines": begin,
    }
    return ForeignFile(path=path, fields=fields, stated=stated, text_format=recognised)


def _stated_above(above: list[str]) -> Stated:
    """Return the metadata in lines above a table, such as "Sampling rate [Hz];25600" or "Rate: 25.6 kHz"."""
    lines = [re.split(r"[:=;,\t]", line.strip(), maxsplit=1) for line in above]
    pairs = [(line[0].strip(' "#%'), re.split(r"[;\t]|,(?!\d)", line[1])) for line in lines if len(line) > 1]
    return stated_of({key: " ".join(cell.strip(' "') for cell in cells).strip() for key, cells in pairs})


def _name_and_units(title: str) -> tuple[str, str | None]:
    """Return the name and units of a header such as "DE [m/s²]" or "DE (g)"; units are None if it states none known.

    A single letter in round brackets is a unit only if it is g: "(V)" and "(A)" may mean vertical and axial.
    """
    found = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]]+)\]|\(([^()]+)\))", title)
    if found is None:
        return title, None
    name, square, round_ = found.groups()
    units = (square or round_).strip()
    known = units != "1" and (units in CANONICAL_UNITS or units in SPELLINGS)
    return (name, units) if known and (square or len(units) > 1 or units == "g") else (title, None)


def encoding_of(path: Path) -> str:
    """Return the encoding: UTF-16 by its mark or zero bytes, UTF-8 if all is valid, else Windows-1252 or Latin-1."""
    data = path.read_bytes()
    start = data[: 2 * _HEAD]
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even, odd = start[::2].count(0), start[1::2].count(0)
    if max(even, odd) > 0.9 * len(start) / 2:  # nearly every other byte
        return "utf-16-le" if odd > even else "utf-16-be"
    for encoding in ("utf-8-sig", "cp1252"):  # spreadsheets begin with a byte order mark
        with suppress(UnicodeDecodeError):
            data.decode(encoding)
            return encoding
    return "latin-1"  # which decodes any byte


# ---- decimal sign ----------------------------------------------------------------------------------------------------

_OTHER = {".": ",", ",": "."}
_GROUPS = " '\N{RIGHT SINGLE QUOTATION MARK}\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}"
_EXPONENT = r"(?:[eE][-+]?\d+)?"
_PLAIN = {sign: re.compile(rf"[-+]?(?:\d+\{sign}?\d*|\{sign}\d+){_EXPONENT}") for sign in ".,"}
_THOUSANDS = {sign: re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:\{sign}\d{{3}})+") for sign in ".,"}
_GROUPED = {
    sign: re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:[{_GROUPS}{other}]\d{{3}})+(?:\{sign}\d*)?{_EXPONENT}")
    for sign, other in _OTHER.items()
}


def _decimal(path: Path, encoding: str, separator: str, above: int) -> str:
    """Return the decimal sign of the first unambiguous number; refuse a file in which all are ambiguous."""
    doubtful = ""
    with path.open(encoding=encoding, newline="") as stream:
        lines = (line for line in islice(stream, above, None) if "." in line or "," in line)
        rows = (line.split() for line in lines) if separator == " " else csv.reader(lines, delimiter=separator)
        for cell in (cell.strip() for row in rows for cell in row if "." in cell or "," in cell):
            for sign, other in _OTHER.items():
                if _THOUSANDS[sign].fullmatch(cell):
                    if cell.count(sign) > 1:
                        return other
                    doubtful = doubtful or cell
                elif _PLAIN[sign].fullmatch(cell) or (
                    sign in cell and other in cell and _GROUPED[sign].fullmatch(cell)
                ):
                    return sign
    if doubtful and (separator in ";\t " or "," in doubtful):
        raise RecordError(
            f'{path}: "{doubtful}" may have a decimal sign or a thousands separator; declare which sign is decimal, '
            'decimal = "." or decimal = ",", in an import description (-d).'
        )
    return "."


def _above_numbers(lines: list[str], separator: str | None, header_lines: int | None) -> tuple[int, int, list[str]]:
    """Return the first line of numbers, the number of lines above the header, and titles if units have their own line.

    Numbers begin where three consecutive lines have equally many numbers each, or from where all lines have numbers and
    texts in the same columns. A single line above them is the header.
    """
    rows = [_cells(line, separator or _separator(line)) for line in lines]
    kinds = [tuple(_are_numbers([["0", cell]]) for cell in row) for row in rows]
    alike = (len(set(filter(None, kinds[at:]))) == 1 and any(kinds[at]) for at in range(len(rows) - 2))
    numbers = (at for at, same in enumerate(alike) if same or _are_numbers(rows[at : at + 3]))
    begin = next(numbers, 0) if header_lines is None else min(header_lines, len(rows) - 1)
    rows = [[line] for line in lines] if len(rows[begin]) == 1 else rows  # names may have spaces
    texts = [at for at in range(begin) if lines[at].strip()]
    if len(texts) <= 1:
        return begin, 0, []
    names, units = (rows[at] if len(rows[at]) == len(rows[begin]) else [] for at in texts[-2:])
    if names and units and all(_is_unit(unit.strip(" []()")) for unit in units) and any(units):
        pairs = ((name.strip(), unit.strip(" []()")) for name, unit in zip(names, units, strict=True))
        return begin, begin, [f"{name} [{unit}]" if unit else name for name, unit in pairs]
    return begin, (texts[-1] if units else begin), []


def _is_unit(text: str) -> bool:
    return not text or text in CANONICAL_UNITS or text in SPELLINGS or time_scale(text) is not None


def _are_numbers(rows: list[list[str]]) -> bool:
    """Return whether rows have equally many cells: numbers, times as text or blanks, and at least one number."""
    filled = [[cell.replace(",", ".").strip(' "') for cell in row if cell.strip()] for row in rows]
    numbers = [[cell for cell in row if not _STAMP.fullmatch(cell)] for row in filled]
    return len({len(row) for row in rows}) == 1 and all(row and all(map(_NUMBER.fullmatch, row)) for row in numbers)


_NUMBER = re.compile(rf"{_PLAIN['.'].pattern}|[-+]?(nan|inf)", re.IGNORECASE)
_DATE, _TIME = r"\d+([-/.])\d+\1\d+", r"\d{1,2}:\d{2}(?::[\d.]+)?\s*(?:Z|[AP]M|[-+]\d{2}:?\d{2})?"
_STAMP = re.compile(rf"{_DATE}|(?:{_DATE.replace('1', '2')}[ T])?{_TIME}")
_STAMPS = (
    "ISO8601",
    *("%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S.%f"),
    *("%m/%d/%Y %I:%M:%S.%f %p", "%d/%m/%Y %I:%M:%S.%f %p", "%H:%M:%S.%f"),
)


def _separator(line: str) -> str:
    return next((sign for sign in ";\t," if sign in line), " " if len(line.split()) > 1 else ",")


def _cells(line: str, separator: str) -> list[str]:
    return line.split() if separator == " " else line.split(separator) if line.strip() else []


def _refuse_short_rows(path: Path, encoding: str, separator: str, above: int, *, expected: int) -> None:
    """Refuse a row with too few cells, which pandas would pad, and a blank one of a single cell, which it would skip.

    Blank lines that alternate with numbers are part of the format.
    """
    lines = []
    for line, row in _rows(path, encoding, separator, above):
        lines.append(line)
        if len(row) < expected:
            raise RecordError(
                f"{path}: the row in line {line} has {len(row)} of {expected} cells. Every row needs as many cells as "
                f'the first; keep the separator of a blank cell, "{separator}".'
            )
    steps = np.diff(lines[1:])  # without the header
    if expected == 1 and steps.size and steps.min() < steps.max():
        blank = lines[1 + int(np.argmax(steps != steps[0]))] + 1
        raise RecordError(
            f"{path}: line {blank} is blank, in a single column of numbers. Write nan there if a sample is missing, or "
            "remove the line."
        )


def _rows(path: Path, encoding: str, separator: str, above: int) -> Iterator[tuple[int, list[str]]]:
    """Yield the last line number, from 1, and the cells of each row that is not blank."""
    with path.open(encoding=encoding, newline="") as stream:
        rows = csv.reader(islice(stream, above, None), delimiter=separator, skipinitialspace=True)
        for row in rows:
            if len(row) > 1 or "".join(row).strip():
                yield above + rows.line_num, row


def _column(column: "pd.Series", decimal: str) -> tuple[Field | tuple[str, int, bool], Stated | None]:
    """Return a column as numbers, "empty", or (first text, row, whether most are numbers), and metadata of times."""
    if column.isna().all():
        return "empty", None
    if column.dtype.kind in "iuf":
        return column.to_numpy(), None
    texts = column.dropna().astype(str).str.strip()
    if texts.size and _STAMP.fullmatch(texts.iloc[0].replace("T", " ").replace(",", ".")):
        moments, stated = _stamps(texts.str.replace(",", "."))
        odd = texts[moments.isna()]
        if odd.empty:
            return (moments - moments.iloc[0]).dt.total_seconds().reindex(column.index).to_numpy(), stated
        if odd.size < texts.size:
            return (f'time stamps but for "{odd.iloc[0]}"', odd.index[0], 2 * odd.size < texts.size), None
    is_number = texts.str.fullmatch(_PLAIN[decimal]) | texts.str.fullmatch(_GROUPED[decimal])
    if is_number.all():  # with thousands separators, or integers of more than 64 bits
        plain = texts.str.replace(rf"[{_GROUPS}{_OTHER[decimal]}]", "", regex=True).str.replace(decimal, ".")
        return plain.astype(np.float64).reindex(column.index).to_numpy(), None
    invalid = texts[~is_number]
    return (f'"{invalid.iloc[0]}"', invalid.index[0], bool(is_number.mean() > 0.5)), None  # noqa: PLR2004


def _stamps(plain: "pd.Series") -> "tuple[pd.Series, Stated | None]":
    """Return times parsed in the most frequent format, NaT for others, and their metadata if there are no others."""
    import pandas as pd  # noqa: PLC0415

    few = {form: pd.to_datetime(plain.iloc[:_HEAD], utc=True, format=form, errors="coerce") for form in _STAMPS}
    pattern = max(few, key=lambda form: few[form].count())
    moments = pd.to_datetime(plain, utc=True, format=pattern, errors="coerce")
    if not moments.notna().all():
        return moments, None
    dates = {parsed.iloc[0] for parsed in few.values() if parsed.notna().iloc[0]}
    if len(dates) > 1 or pattern == _STAMPS[-1]:  # 03/04/2024 may be in March or April
        unread = f'states the start "{plain.iloc[0]}", whose date is missing, or ambiguous in day and month'
        return moments, Stated(units="s", notes=(unread,))
    offset = UTC if pattern == _STAMPS[0] and re.search(r"(Z|[-+]\d\d:?\d\d)$", plain.iloc[0]) else None
    return moments, Stated(units="s", epoch=moments.iloc[0].to_pydatetime().replace(tzinfo=offset))
