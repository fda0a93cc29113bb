"""Results of records, the part of their analyses that is stored, and the files that hold them.

Numbers are read as arrays, and names that records share are held once.
"""

import base64
import gzip
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.findings import NOT_JUDGED, not_judged_words
from hums.analysis.result import Analysis, group
from hums.fleet.observation import Observation, observation
from hums.fleet.series import CONDITION, INDICATOR, LINE, NOTHING, Keys, Numbers, named, shared
from hums.records.outputs import atomic_write
from signals._validation import plain_text

_NUMBERS = ("lines", "indicators")  # of a row
_INDICATOR = ("channel", "component", "kind", "indicator", "unit", "value")
_FINDING = ("component", "kind", "verdict", "channel", "evidence")
_HEALTH = ("name", "sensor", "status", "reasons")
_LINE = ("line_channel", "component", "kind", "harmonic", "sideband", "line_units")
_MEASURED = ("line_order", "line_amplitude", "snr", "claimed")


def results(analysis: Analysis) -> dict[str, Any]:
    """Return speed, measured quantities, findings, unjudged components and sensors as JSON types, and the numbers.

    ``lines`` are `Numbers` under `LINE`: order, amplitude, ratio to the background, and 1 if identified; ``indicators``
    those under `INDICATOR`: the value.
    """
    speed = group(analysis, "speed").variables["speed_hz"].to_numpy()
    words = ("verdict", "doubts", *CONDITION)
    rows = [*_rows(analysis, "findings", words), *_rows(analysis, "verdicts", words)]
    verdicts = [dict(zip(words, row, strict=True)) for row in rows]
    return {
        "error": "",
        "speed_hz": speed.size / float((1 / speed).sum()) if speed.size else math.nan,
        "regime": analysis.attrs.get("regime", ""),
        "covariates": json.loads(analysis.attrs.get("measured_json", "{}")),
        "lines": named(
            (
                [channel, name, *line, int(claimed)]
                for name in (ORDER_SPECTRUM, ENVELOPE)
                for channel, *line, claimed in _rows(analysis, name, (*_LINE, *_MEASURED))
            ),
            len(LINE),
            len(_MEASURED),
        ),
        "indicators": named(
            (row for row in _rows(analysis, "indicators", _INDICATOR) if math.isfinite(row[-1])), len(INDICATOR), 1
        ),
        "findings": _rows(analysis, "findings", _FINDING),
        "not_judged": [[row[name] for name in CONDITION] for row in verdicts if row["verdict"] == NOT_JUDGED],
        "parts_not_judged": not_judged_words(verdicts),
        "health": _rows(analysis, "health", _HEALTH),
    }


def _rows(analysis: Analysis, name: str, columns: Sequence[str]) -> list[list[Any]]:
    """Return the rows of a group; a pandas table would take a third of the time of analysing a short record."""
    if name not in analysis.children:
        return []
    variables = analysis.children[name].dataset.variables
    values = (variables[column].to_numpy().tolist() for column in columns)
    return [list(row) for row in zip(*values, strict=True)]


@dataclass(frozen=True, kw_only=True)
class StoredRecord(Observation):
    """One record: what is monitored, and its lines, indicators and findings.

    ``lines`` has amplitude, ratio to the background, and 1 if identified; ``orders`` are those of the first record with
    such lines; ``indicators`` has their values; ``findings`` component, kind and verdict; ``not_judged`` component and
    kind of each check not made, ``parts_not_judged`` their number and reasons; ``label`` is the class of a record of a
    dataset.
    """

    error: str = ""
    speed_hz: float = np.nan
    lines: Numbers
    orders: NDArray[np.float64]
    indicators: Numbers
    findings: tuple[tuple[str, str, str], ...] = ()
    label: str = ""
    not_judged: tuple[tuple[str, str], ...] = ()
    parts_not_judged: str = ""


def write_row(row: Mapping[str, Any], path: Path) -> None:
    """Write the results of one record, as `packed_row` packs them, into the folder of a run's jobs."""
    plain = {name: plain_text(text) if isinstance(text, str) else text for name, text in row.items()}
    with atomic_write(path, tidy=False) as part:
        part.write_bytes(packed_row(plain))


def packed_row(row: Mapping[str, Any]) -> bytes:
    """Return the results of one record as a file: JSON, with numbers as the base64 text of little-endian doubles.

    The names of the numbers are one text, the same for most records, which is parsed once.
    """
    packed = {}
    for name in (one for one in _NUMBERS if one in row):
        values = np.ascontiguousarray(row[name].values, dtype="<f8")
        names = json.dumps(row[name].keys, separators=(",", ":"))
        packed[name] = [names, list(values.shape), base64.b64encode(values.tobytes()).decode()]
    return gzip.compress(json.dumps(dict(row) | packed).encode(), compresslevel=1, mtime=0)


def read_row(path: Path) -> dict[str, Any]:
    """Return the results of one record as `write_row` stored them."""
    row: dict[str, Any] = json.loads(gzip.decompress(path.read_bytes()))
    for name in (one for one in _NUMBERS if one in row):
        names, shape, text = row[name]
        row[name] = Numbers(keys=_keys(names), values=np.frombuffer(base64.b64decode(text), dtype="<f8").reshape(shape))
    return row


@lru_cache(maxsize=4096)
def _keys(names: str) -> Keys:
    return shared(tuple(map(tuple, json.loads(names))))


def read_results(paths: Iterable[Path]) -> list[StoredRecord]:
    """Return the results of all records, in order; each file is read once.

    Memory holds 8 bytes per monitored number and 4 per other number, and each set of names once.
    """
    orders: dict[int, NDArray[np.float64]] = {}
    return [_stored(path, orders) for path in paths]


def _stored(path: Path, orders: dict[int, NDArray[np.float64]]) -> StoredRecord:
    row = read_row(path)
    lines, indicators = (row.get(name, NOTHING) for name in _NUMBERS)
    return StoredRecord(
        **vars(observation(row)),
        error=row["error"],
        speed_hz=row.get("speed_hz", np.nan),
        lines=Numbers(keys=lines.keys, values=lines.values[:, 1:].astype(np.float32)),
        orders=orders.setdefault(id(lines.keys), lines.values[:, 0].copy()),
        indicators=Numbers(keys=indicators.keys, values=indicators.values[:, 0].astype(np.float32)),
        findings=tuple((component, kind, word) for component, kind, word, *_ in row.get("findings", ())),
        label=row.get("class", ""),
        not_judged=shared(tuple(map(tuple, row.get("not_judged", ())))),
        parts_not_judged=row.get("parts_not_judged", ""),
    )
