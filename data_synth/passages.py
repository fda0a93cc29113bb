"""Times at which a shaft passes given angles, through standstill and reversal."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_synth.profile import Angle, Array

_MAX_ITERATIONS = 120  # of Newton's rule or bisection: more than the bits of a double


@dataclass(frozen=True, kw_only=True)
class Crossings:
    """Times at which a shaft passes equally spaced angles.

    Attributes
    ----------
    times_s : (m,) array
        Rising, in s.
    numbers : (m,) int array
        Number of each angle, zero at revolution zero; falling in reverse.
    directions : (m,) int array
        +1 where the angle rises, -1 where it falls.
    """

    times_s: Array = field(metadata={"dims": ("passage",), "units": "s"})
    numbers: NDArray[np.int64] = field(metadata={"dims": ("passage",), "units": "1"})
    directions: NDArray[np.int64] = field(metadata={"dims": ("passage",), "units": "1"})


def crossings(angle: Angle, *, per_rev: float, start_s: float, stop_s: float, offset: float = 0.0) -> Crossings:
    """Return all times from `start_s` to `stop_s` at which ``per_rev * revolutions + offset`` is an integer.

    A shaft that reverses at one of these angles passes it once; one that stands still there, when it starts again.

    Parameters
    ----------
    angle : Angle
        Angle of the shaft.
    per_rev : float
        Angles in one revolution, above zero.
    start_s, stop_s : float
        Ends of the interval in s, both included.
    offset : float
        Value of the counted angle at revolution zero.

    Raises
    ------
    ValueError
        `per_rev` that is not above zero, or an end before the start.
    """
    if not per_rev > 0:
        raise ValueError(f"per_rev = {per_rev:g} is not above zero; give the marks of one revolution")
    if not stop_s >= start_s:
        raise ValueError(f"stop_s = {stop_s:g} lies before start_s = {start_s:g}; give a span of time")
    turning = angle.turning_points_s()
    edges = np.concatenate([[start_s], turning[(turning > start_s) & (turning < stop_s)], [stop_s]])
    marks = per_rev * angle.revolutions(edges) + offset
    found = []
    for run in range(edges.size - 1):
        numbers, direction = _numbers(marks[run], marks[run + 1], last=run == edges.size - 2)
        if numbers.size:
            targets: Array = np.asarray((numbers - offset) / per_rev, dtype=np.float64)
            times = crossing_times(angle, targets, start_s=edges[run], stop_s=edges[run + 1], direction=direction)
            found.append((times, numbers, np.full(numbers.size, direction)))
    if not found:
        return Crossings(times_s=np.empty(0), numbers=np.empty(0, np.int64), directions=np.empty(0, np.int64))
    times, numbers, directions = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Crossings(times_s=times, numbers=numbers, directions=directions)


def _numbers(begin: float, end: float, *, last: bool) -> tuple[NDArray[np.int64], int]:
    """Return the integers from `begin` to `end` in order, and the direction; `end` itself only in the last piece."""
    if begin == end:
        return np.empty(0, np.int64), 0
    if end > begin:
        numbers = np.arange(np.ceil(begin), np.floor(end) + 1, dtype=np.int64)
        return (numbers if last else numbers[numbers < end]), 1
    numbers = np.arange(np.floor(begin), np.ceil(end) - 1, -1, dtype=np.int64)
    return (numbers if last else numbers[numbers > end]), -1


def crossing_times(angle: Angle, targets: Array, *, start_s: float, stop_s: float, direction: int) -> Array:
    """Return the times (n,) at which the angle is `targets` (n,) in a monotone piece: Newton's method in a bracket."""
    low, high = np.full(targets.size, start_s), np.full(targets.size, stop_s)
    ends = angle.revolutions([start_s, stop_s])
    times = start_s + (stop_s - start_s) * np.clip((targets - ends[0]) / (ends[1] - ends[0]), 0, 1)
    before = np.full(targets.size, stop_s - start_s)
    for _ in range(_MAX_ITERATIONS):
        ahead = direction * (angle.revolutions(times) - targets)
        low, high = np.where(ahead <= 0, times, low), np.where(ahead >= 0, times, high)
        speed = direction * angle.speed_hz(times)
        quick = (speed > 0) & (np.abs(ahead) <= speed * before / 2)  # steps that do not halve may run in a circle
        newton = times - np.divide(ahead, speed, out=np.zeros(times.size), where=quick)
        better = np.where(quick & (newton >= low) & (newton <= high), newton, (low + high) / 2)
        before = moved = np.abs(better - times)
        times = better
        if np.all(moved <= 2 * np.spacing(np.abs(times))):
            break
    return np.asarray(times)
