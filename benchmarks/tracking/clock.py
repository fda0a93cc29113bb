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

from tracking.coverage import KINDS

SLOW_S = 0.5  # of a call, from which on it is repeated less often
ONCE_S = 3.0  # from which on the run that finds the error is the one that is timed


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much to measure.

    Attributes
    ----------
    samples : of each job; None for all.
    excerpt : samples given to what is too slow for a whole job.
    repeats, slow_repeats : of a timing.
    search, slow_search : evaluations in the search of a bandwidth, the second where they are slow.
    with_peers : whether other packages run too.
    channels : of the record with several.
    poles, kinds, records : of the cells of coverage, and records of a slipping line in one.
    lengths : numbers of samples, for the scaling with samples.
    separable, coupled : numbers of orders, for the scaling with orders.
    grown : samples in a record where orders grow, for the smoother on blocks.
    """

    samples: int | None = None
    excerpt: int = 20_000
    repeats: int = 15
    slow_repeats: int = 5
    search: int = 14
    slow_search: int = 8
    with_peers: bool = True
    channels: int = 8
    poles: tuple[int, ...] = (1, 2, 3, 4)
    kinds: tuple[str, ...] = tuple(KINDS)
    records: int = 24
    lengths: tuple[int, ...] = (500_000, 1_000_000, 2_000_000, 4_000_000, 8_000_000)
    separable: tuple[int, ...] = (10, 20, 50, 100, 200)
    coupled: tuple[int, ...] = (5, 10, 20, 40, 60, 80)
    grown: int = 250_000

    def repeats_of(self, took: float) -> int:
        """How often a call of so many seconds is timed."""
        return self.repeats if took < SLOW_S else self.slow_repeats


def seconds(call: Callable[[], object]) -> float:
    """Time one call."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def time_in_ffts(call: Callable[[], object], record: Floats, effort: Effort, *, took: float | None = None) -> float:
    """Time a call in those of an rfft of the record, both in turn.

    Parameters
    ----------
    call : has run before, so that all is compiled.
    record : of the rfft.
    effort : how often to repeat.
    took : seconds of that run, which stand for the call where they are many; by default it runs again first.
    """
    once = seconds(call) if took is None else took
    repeats = range(effort.repeats_of(once))
    both = [(once if once > ONCE_S else seconds(call), seconds(lambda: np.fft.rfft(record))) for _ in repeats]
    return statistics.median(mine for mine, _ in both) / statistics.median(fft for _, fft in both)


def give_back() -> None:
    """Return freed memory to the system, as far as it can be, so that what a call takes shows."""
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
