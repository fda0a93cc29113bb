"""What a call costs where no memory waits for it, and where `std` is wanted."""

import statistics
import time
from collections.abc import Sequence
from typing import Literal

import numpy as np

from signals.harmonics import track_orders
from tracking.clock import Effort, give_back, seconds
from tracking.measuring import Row, only
from tracking.tables import table

Method = Literal["exact", "fast"]
CASES: tuple[tuple[str, Method], ...] = (("J1", "exact"), ("J3", "fast"))


def fresh(rows: Sequence[Row], effort: Effort) -> list[str]:
    """Time the one-pole filters with all outputs once more, the four ways of each in turn."""
    lines = []
    for name, method in CASES:
        for row in only(rows, name, estimator="filter", method=method, poles=1):
            times = _four_ways(row, method, effort)
            lines.append((f"{name} filter, {method}, 1 pole, all outputs", *(f"{multiple:.3g}" for multiple in times)))
    head = ("what", "a call again", "and its `std`", "a first call, in fresh memory", "and its `std`")
    return table(head, lines)


def _four_ways(row: Row, method: Method, effort: Effort) -> list[float]:
    """Return, in rffts, a call in memory used before, the same up to its `std`, then the two in fresh memory."""
    took: list[tuple[float, ...]] = []
    for _ in range(effort.repeats):
        give_back()
        first = _with_std(row, method)
        took.append((*_with_std(row, method), *first, seconds(lambda: np.fft.rfft(row.job.x))))
    *calls, fft = (statistics.median(times) for times in zip(*took, strict=True))
    return [call / fft for call in calls]


def _with_std(row: Row, method: Method) -> tuple[float, float]:
    """Seconds of a call, and of it and its `std`."""
    start = time.perf_counter()
    tracks = track_orders(**row.job.tracking(row.bandwidth), estimator="filter", method=method, poles=1)
    called = time.perf_counter() - start
    _ = tracks.std
    return called, time.perf_counter() - start
