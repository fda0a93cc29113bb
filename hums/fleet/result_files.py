"""Results of records, the part of their analyses that is stored, and the files that hold them.

Numbers are read as arrays, and names that records share are held once.
"""

import base64
import gzip
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.findings import DIAGNOSED, NOT_JUDGED, not_judged_words
from hums.analysis.result import Analysis, group
from hums.fleet import series
from hums.fleet.observation import Observation
from hums.records.outputs import atomic_write
from signals._validation import plain_text

_NUMBERS = ("values", "lines", "indicators")  # of a row
_MEASURED = ("line_order", "line_amplitude", "snr", "claimed")
_NO_LINES = series.named((), len(series.LINE), len(_MEASURED) - 1)


def results(analysis: Analysis) -> dict[str, Any]:
    """Return what is monitored of a record, and its findings, unjudged components, lines and indicators.

    ``lines`` are `Numbers` under `LINE`: order, amplitude, ratio to the background, and 1 if identified; ``indicators``
    those under `INDICATOR`: the value.
    """
    speed = group(analysis, "speed").variables["speed_hz"].to_numpy()
    mean_speed = {"speed_hz": speed.size / float((1 / speed).sum())} if speed.size else {}
    words = (*series.CONDITION, "verdict", "doubts")
    found = _rows(analysis, "findings", words)
    verdicts = [dict(zip(words, row, strict=True)) for row in (*found, *_rows(analysis, "verdicts", words))]
    of_line = ("line_channel", *series.LINE[2:-1], "line_units", *_MEASURED)
    lines = [
        [channel, name, *line, int(claimed)]
        for name in (ORDER_SPECTRUM, ENVELOPE)
        for channel, *line, claimed in _rows(analysis, name, of_line)
    ]
    of_indicator = (*series.INDICATOR[:-1], "unit", "value")
    indicators = [row for row in _rows(analysis, "indicators", of_indicator) if math.isfinite(row[-1])]
    measured = {
        "lines": series.named(lines, len(series.LINE), len(_MEASURED)),
        "indicators": series.named(indicators, len(series.INDICATOR), 1),
    }
    of_sensor = ("name", "sensor", "status", "reasons")
    sensors = [row for row in _rows(analysis, "health", of_sensor) if row[2] == "faulty"]
    faulty, joint = {name: reasons for name, _, _, reasons in sensors}, series.joint_names(measured["lines"])
    judged = all(sensor != "tachometer" for _, sensor, *_ in sensors)
    diagnosed = {joint.get(name, name) for name, _, word, _ in found if word == DIAGNOSED}
    return measured | {
        "regime": analysis.attrs.get("regime", ""),
        "values": series.series_of(**measured, without=faulty) if judged else series.NOTHING,
        "covariates": mean_speed | json.loads(analysis.attrs.get("measured_json", "{}")),
        "faulty": faulty,
        "unjudged": "" if judged else "faulty tachometer",
        "diagnosed": sorted(diagnosed) if judged else [],
        "findings": [row[:3] for row in found],
        "not_judged": [[row[name] for name in series.CONDITION] for row in verdicts if row["verdict"] == NOT_JUDGED],
        "parts_not_judged": not_judged_words(verdicts),
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
    lines: series.Numbers = _NO_LINES
    orders: NDArray[np.float64] = field(default_factory=series.NOTHING.values.copy)
    indicators: series.Numbers = series.NOTHING
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

    def packed(numbers: series.Numbers) -> list[Any]:
        names = json.dumps(numbers.keys, separators=(",", ":"))
        return [names, numbers.values.shape, base64.b64encode(numbers.values.astype("<f8").tobytes()).decode()]

    return gzip.compress(json.dumps(dict(row), default=packed).encode(), compresslevel=1, mtime=0)


def read_row(path: Path) -> dict[str, Any]:
    """Return the results of one record as `write_row` stored them."""
    row: dict[str, Any] = json.loads(gzip.decompress(path.read_bytes()))
    for name in (one for one in _NUMBERS if one in row):
        names, shape, text = row[name]
        values = np.frombuffer(base64.b64decode(text), dtype="<f8").reshape(shape)
        row[name] = series.Numbers(keys=_keys(names, name == "values"), values=values)
    return row | {
        name: series.shared(tuple(map(tuple, row[name]))) for name in ("findings", "not_judged") if name in row
    }


@lru_cache(maxsize=4096)
def _keys(names: str, of_series: bool) -> series.Keys:
    return series.shared(tuple(map(series.Series._make if of_series else tuple, json.loads(names))))


def read_results(paths: Iterable[Path]) -> list[StoredRecord]:
    """Return the results of all records, in order; each file is read once.

    Memory holds 8 bytes per monitored number and 4 per other number, and each set of names once.
    """
    found, orders = [], dict[int, NDArray[np.float64]]()
    for path in paths:
        row = read_row(path)
        if lines := row.get("lines"):
            row["orders"] = orders.setdefault(id(lines.keys), lines.values[:, 0].copy())
            row["lines"] = series.Numbers(keys=lines.keys, values=lines.values[:, 1:].astype(np.float32))
            row["indicators"] = replace(row["indicators"], values=row["indicators"].values[:, 0].astype(np.float32))
        found.append(StoredRecord(**row))
    return found
