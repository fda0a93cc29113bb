"""Time, in multiples of an rfft, and memory of a call."""

import contextlib
import ctypes
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jobs import Floats

SLOW_S = 1.0  # of a call, from which on it is repeated less often


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much to measure.

    Attributes
    ----------
    samples : of each job; None for all.
    excerpt : samples given to what is too slow for a whole job.
    repeats, slow_repeats : of a timing.
    search : evaluations in the search of a bandwidth.
    with_peers : whether other packages run too.
    lengths : numbers of samples, for the first table of scaling.
    separable, coupled : numbers of orders, for the other two.
    """

    samples: int | None = None
    excerpt: int = 20_000
    repeats: int = 15
    slow_repeats: int = 3
    search: int = 14
    with_peers: bool = True
    lengths: tuple[int, ...] = (125_000, 250_000, 500_000, 1_000_000)
    separable: tuple[int, ...] = (10, 20, 50, 100, 200)
    coupled: tuple[int, ...] = (2, 5, 10, 15, 20)


def seconds(call: Callable[[], object]) -> float:
    """Time one call."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def seconds_a_call(call: Callable[[], object], effort: Effort) -> float:
    """Return the median of several calls, after one that warms up."""
    repeats = effort.repeats if seconds(call) < SLOW_S else effort.slow_repeats
    return statistics.median(seconds(call) for _ in range(repeats))


def time_in_ffts(call: Callable[[], object], record: Floats, effort: Effort) -> float:
    """Time a call that has run before, in those of an rfft of the record, both in turn."""
    repeats = effort.repeats if seconds(call) < SLOW_S else effort.slow_repeats
    both = [(seconds(call), seconds(lambda: np.fft.rfft(record))) for _ in range(repeats)]
    return statistics.median(mine for mine, _ in both) / statistics.median(fft for _, fft in both)


def give_back() -> None:
    """Return freed memory to the system, where the C library can: what grows into it would not show."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def resident_mb(which: Literal["VmRSS", "VmHWM"]) -> float:
    """Resident set of this process, now or at its peak; NaN where the system does not tell."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        if which == "VmRSS":
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts anew
    except OSError:
        return float("nan")
    return next(float(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith(which))
