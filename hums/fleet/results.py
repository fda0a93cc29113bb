"""Results of one record: the part of an analysis that `hums.fleet` stores."""

import json
import math
from collections.abc import Sequence
from typing import Any

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.findings import NOT_JUDGED, not_judged_words
from hums.analysis.result import Analysis, group
from hums.fleet.series import CONDITION, INDICATOR, LINE, named

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
