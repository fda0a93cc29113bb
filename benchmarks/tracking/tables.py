"""Tables in Markdown."""

from collections.abc import Iterable, Sequence

import numpy as np

from tracking.measuring import Row
from tracking.settings import OWN_BANDWIDTHS


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return a table in Markdown with an empty line after it."""
    rows = [head, ["---"] * len(head), *lines]
    return ["| " + " | ".join(row) + " |" for row in rows] + [""]


def job_table(rows: Sequence[Row]) -> list[str]:
    """Return the table of one job."""
    head = ("estimator", "method", "poles", "outputs", "bandwidth", "time", "error", "MB")
    lines = []
    for row in rows:
        s = row.setting
        scaled = " (scaled)" if s.excerpt_of else ""
        memory = f"{max(row.memory, 0):.0f}" if np.isfinite(row.memory) else "-"
        width = "-" if s.family == OWN_BANDWIDTHS else f"{row.bandwidth:g}"
        measured = width, f"{row.time:.3g}{scaled}", f"{row.error:.4f}", memory
        lines.append((s.estimator, s.method, str(s.poles), s.outputs, *measured))
    return table(head, lines)
