"""Results of one record: the part of an analysis that `hums.fleet` stores."""

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.findings import NOT_JUDGED, not_judged_words
from hums.analysis.result import Analysis, group
from hums.fleet.series import INDICATOR, LINE, named

_PART = ("component", "kind")
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
    findings, others = (list(_rows(analysis, name, ["verdict", "doubts", *_PART])) for name in ("findings", "verdicts"))
    verdicts = [*findings, *others]
    return {
        "error": "",
        "speed_hz": speed.size / float((1 / speed).sum()) if speed.size else math.nan,
        "regime": analysis.attrs.get("regime", ""),
        "covariates": json.loads(analysis.attrs.get("measured_json", "{}")),
        "lines": named(
            (line for name in (ORDER_SPECTRUM, ENVELOPE) for line in _lines(analysis, name)), len(LINE), len(_MEASURED)
        ),
        "indicators": named(
            (
                [row[name] for name in _INDICATOR]
                for row in _rows(analysis, "indicators", _INDICATOR)
                if math.isfinite(row["value"])
            ),
            len(INDICATOR),
            1,
        ),
        "findings": [[row[name] for name in _FINDING] for row in _rows(analysis, "findings", _FINDING)],
        "not_judged": [[row[name] for name in _PART] for row in verdicts if row["verdict"] == NOT_JUDGED],
        "parts_not_judged": not_judged_words(verdicts),
        "health": [[row[name] for name in _HEALTH] for row in _rows(analysis, "health", _HEALTH)],
    }


def _rows(analysis: Analysis, name: str, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a group; a pandas table would take a third of the time of analysing a short record."""
    if name not in analysis.children:
        return
    dataset = analysis.children[name].dataset
    for row in zip(*(dataset.variables[column].to_numpy().tolist() for column in columns), strict=True):
        yield dict(zip(columns, row, strict=True))


def _lines(analysis: Analysis, name: str) -> Iterator[list[Any]]:
    for row in _rows(analysis, name, [*_LINE, *_MEASURED]):
        channel, *line = (row[key] for key in _LINE)
        order, amplitude, snr, claimed = (row[key] for key in _MEASURED)
        yield [channel, name, *line, order, amplitude, snr, int(claimed)]
