"""Results of one record as JSON types: what `hums.fleet` keeps of an analysis."""

import json
import math
from collections.abc import Iterator
from typing import Any

from hums.analysis.findings import NOT_JUDGED, not_judged_words
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.result import (
    Analysis,
    findings_table,
    group,
    health_table,
    indicator_table,
    line_table,
    verdict_table,
)

__all__ = ["results"]


def results(analysis: Analysis) -> dict[str, Any]:
    """Return speed, what else was measured, lines, indicators, findings, unjudged parts and sensors as JSON types."""
    speed, verdicts = group(analysis, "speed")["speed_hz"], verdict_table(analysis).to_dict("records")
    return {
        "error": "",
        "speed_hz": speed.size / float((1 / speed).sum()) if speed.size else math.nan,
        "covariates": json.loads(analysis.attrs.get("measured_json", "{}")),
        "lines": [line for name in (ORDER_SPECTRUM, ENVELOPE) for line in _lines(analysis, name)],
        "indicators": [
            [row[name] for name in ("channel", "component", "kind", "indicator", "unit", "value")]
            for row in indicator_table(analysis).to_dict("records")
            if math.isfinite(row["value"])
        ],
        "findings": [
            [row[name] for name in ("component", "kind", "verdict", "channel", "evidence")]
            for row in findings_table(analysis).to_dict("records")
        ],
        "not_judged": [[row["component"], row["kind"]] for row in verdicts if row["verdict"] == NOT_JUDGED],
        "parts_not_judged": not_judged_words(verdicts),
        "health": [
            [row[name] for name in ("name", "sensor", "status", "reasons")]
            for row in health_table(analysis).to_dict("records")
        ],
    }


def _lines(analysis: Analysis, name: str) -> Iterator[list[Any]]:
    for row in line_table(analysis, name).to_dict("records"):
        key = [row["channel"], name, *(row[part] for part in ("component", "kind", "harmonic", "sideband", "units"))]
        yield [*key, row["order"], row["amplitude"], row["snr"], int(row["claimed"])]
