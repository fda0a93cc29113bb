"""The table of one job."""

from collections.abc import Sequence

import numpy as np
from page_files import table

from tracking.measuring import Row
from tracking.settings import OWN_BANDWIDTHS


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
