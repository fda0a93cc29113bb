"""Missing, double and spurious tachometer pulses: detection, numbering and repair.

Detection compares each interval with those of the same stripe in the revolutions around it (`_pulse_faults`). Around
the faults, pulses are numbered by dynamic programming over a beam of partial numberings (`_pulse_numbering`): a
missing and an extra pulse each have a cost, and so has the error of each pulse against its prediction from the three
before it. The search begins at the longest run of sound pulses and goes forwards and backwards from there. A first pass
assumes a wide prediction error; a second uses the one that the first has found.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from signals._pulse_faults import (
    doubtful_intervals,
    expected_intervals,
    long_intervals,
    period_of,
    short_intervals,
)
from signals._pulse_numbering import numbered

if TYPE_CHECKING:
    from signals._checks import Array

Counts = NDArray[np.int64]

_DOUBLE = 0.1  # of the interval: an extra pulse this soon after a true one is its double
_MOST_STD, _LEAST_STD = 0.08, 0.01  # of the prediction error, in intervals
_OUTLIER = 2.0  # standard deviations; leaving out a pulse with a smaller prediction error costs more than keeping it
_FEWEST_SOUND = 4  # consecutive pulses to begin from
_CALIBRATION_REVS = 3  # sound ones that suffice to estimate the angles of the stripes
_MOST_MISSING = 8  # consecutive pulses; a longer gap cannot be counted with certainty
_MOST_WRONG = 0.3
_FEW_STRIPES = 8  # up to here stripes may be uneven; with more the intervals are taken as even
_STOP_RATIO = 1.7  # of an interval with a stop to the longer of its neighbours, at least
_STOP_REACH = 1.5  # intervals within which a constant deceleration must end for a stop
_STOP_REVS = 4  # intervals on either side that are fitted
_STOP_RESIDUAL = 0.2  # of that fit at most, over the largest squared speed


def _no_times() -> Array:
    return np.zeros(0)


def _no_indices() -> Counts:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class PulseRepairs:
    """Missing, double and spurious pulses of a tachometer.

    A double pulse follows a true one within a tenth of the interval; any other extra pulse is spurious. Both are left
    out of the phase.

    Attributes
    ----------
    missing, double, spurious : int
        Numbers of such pulses.
    missing_times_s : (missing,) array
        Approximate times of the missing pulses in s.
    double_index, double_times_s : (double,) arrays
        Index in the list of pulses as given, and time in s.
    spurious_index, spurious_times_s : (spurious,) arrays
        The same of the spurious pulses.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import shaft_phase
    >>> repairs = shaft_phase(np.delete(0.1 * np.arange(30), 12)).repairs
    >>> repairs.total, repairs.missing_times_s.round(6).tolist()
    (1, [1.2])
    """

    missing: int = 0
    double: int = 0
    spurious: int = 0
    missing_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("missing",), "units": "s"})
    double_index: Counts = field(default_factory=_no_indices, metadata={"dims": ("double",), "units": "1"})
    double_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("double",), "units": "s"})
    spurious_index: Counts = field(default_factory=_no_indices, metadata={"dims": ("spurious",), "units": "1"})
    spurious_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("spurious",), "units": "s"})

    @property
    def total(self) -> int:
        """Number of missing and extra pulses."""
        return self.missing + self.double + self.spurious


def refuse_faults(times: Array, *, stripes: int, offset: int = 0) -> None:
    """Raise ValueError at the first missing, else the first extra pulse; indices in it count from `offset`."""
    intervals = np.diff(times)
    if intervals.size == 0:
        return
    least, most = expected_intervals(intervals, period=period_of(intervals, stripes))
    gaps = long_intervals(intervals, most)
    if gaps.size:
        i = int(gaps[0])
        raise ValueError(
            f"a tachometer pulse is missing: the interval after pulse {offset + i} at {times[i]:g} s lasts "
            f"{intervals[i]:.3g} s, {intervals[i] / most[:, i].mean():.2f} times its neighbours "
            f'({gaps.size} such gaps). Let it be repaired (on_fault="repair"), or use the part of the record without '
            "the gap."
        )
    short = short_intervals(intervals, least)
    if short.any():
        i = int(np.argmax(short))
        runs = np.count_nonzero(np.diff(short, prepend=False) & short)
        raise ValueError(
            f"there is an extra tachometer pulse: pulse {offset + i + 1} at {times[i + 1]:g} s follows "
            f"pulse {offset + i} after {intervals[i]:.3g} s, {intervals[i] / least[:, i].max():.2f} of the usual time "
            f"({runs} such places). Take false and double pulses out of the "
            'list, let them be repaired (on_fault="repair"), or use the part of the record without them.'
        )


def number_pulses(times: Array, *, stripes: int) -> tuple[Counts, Counts]:
    """Return the indices of the true pulses, and their numbers from zero with missing pulses counted, (kept,) each.

    Raises
    ------
    ValueError
        More faults than can be distinguished from a change of speed.
    """
    everything = np.arange(times.size)
    intervals = np.diff(times)
    if intervals.size < 3:  # noqa: PLR2004 - too few to compare
        return everything, everything
    least, most = expected_intervals(intervals, period=period_of(intervals, stripes))
    wrong = short_intervals(intervals, least)
    wrong[long_intervals(intervals, most)] = True
    if not wrong.any():
        return everything, everything
    begin, run = _longest_sound_run(times, wrong)
    anchor = begin + _steadiest_pulse(run, stripes)
    positions = np.arange(stripes) / stripes
    calibrated = run.size >= _CALIBRATION_REVS * stripes
    if calibrated:
        positions = _stripe_positions(run, np.arange(run.size), stripes)
    doubtful = wrong | doubtful_intervals(intervals, least, most)
    kept, counts = numbered(times, positions, doubtful=doubtful, anchor=anchor, std=_MOST_STD)
    if not calibrated and stripes > 1:
        positions = _stripe_positions(times[kept], counts, stripes)
    error = np.abs(_prediction_errors(times[kept], counts, positions))
    std = float(np.clip(1.5 * 1.4826 * np.median(error), _LEAST_STD, _MOST_STD))
    doubtful[kept[-error.size :][error > _OUTLIER * std] - 1] = True
    kept, counts = numbered(times, positions, doubtful=doubtful, anchor=anchor, std=std)
    _refuse_too_many(times, kept, counts)
    return kept, counts - counts[0]


def _refuse_too_many(times: Array, kept: Counts, counts: Counts) -> None:
    """Raise where a gap is too long to count, or too many of the pulses are missing or extra."""
    steps = np.diff(counts)
    missing, extra = int(np.sum(steps - 1)), times.size - kept.size
    if steps.size and steps.max() > _MOST_MISSING + 1:
        i = int(np.argmax(steps))
        raise ValueError(
            f"no tachometer pulse comes from {times[kept[i]]:g} to {times[kept[i + 1]]:g} s, about {steps[i] - 1} are "
            f"missing on end: too many to count for certain. Use the record before or after; if the shaft stood, say "
            "so with standstill_s."
        )
    if missing + extra > _MOST_WRONG * times.size:
        raise ValueError(
            f"the tachometer's pulses cannot be repaired: {missing} would be missing and {extra} extra of "
            f"{times.size}. Check pulses_per_rev and the threshold, or use a sound part of the record."
        )


def repairs_of(times: Array, kept: Counts, counts: Counts, *, offset: int = 0) -> PulseRepairs:
    """Return the missing and extra pulses of a numbering; indices count from `offset`."""
    steps = np.diff(counts)
    missing = np.setdiff1d(np.arange(counts[0], counts[-1] + 1), counts, assume_unique=True)
    extra = np.setdiff1d(np.arange(times.size), kept, assume_unique=True)
    before = np.clip(np.searchsorted(kept, extra) - 1, 0, max(steps.size - 1, 0))
    interval = np.diff(times[kept])[before] / steps[before] if steps.size else np.ones(extra.size)
    late = times[extra] - times[kept[before]]
    double = (late > 0) & (late < _DOUBLE * interval)
    return PulseRepairs(
        missing=missing.size,
        double=int(double.sum()),
        spurious=int(extra.size - double.sum()),
        missing_times_s=np.interp(missing, counts, times[kept]),
        double_index=extra[double] + offset,
        double_times_s=times[extra[double]],
        spurious_index=extra[~double] + offset,
        spurious_times_s=times[extra[~double]],
    )


def all_repairs(parts: list[PulseRepairs]) -> PulseRepairs:
    """Return the repairs of consecutive stretches as one."""

    def concatenated(name: str) -> Any:  # noqa: ANN401 - times or indices
        return np.concatenate([getattr(part, name) for part in parts])

    return PulseRepairs(
        missing=sum(part.missing for part in parts),
        double=sum(part.double for part in parts),
        spurious=sum(part.spurious for part in parts),
        missing_times_s=concatenated("missing_times_s"),
        double_index=concatenated("double_index"),
        double_times_s=concatenated("double_times_s"),
        spurious_index=concatenated("spurious_index"),
        spurious_times_s=concatenated("spurious_times_s"),
    )


def possible_stops(times: Array, *, stripes: int) -> Counts:
    """Return the intervals in which the shaft may have stopped: it decelerates before and accelerates after.

    The squared speed is extrapolated over the angle from either side, linearly as at constant acceleration; where both
    lines reach zero near the interval, the shaft may have stopped there, and may have reversed.
    """
    stride = stripes if stripes <= _FEW_STRIPES else 1
    intervals = np.diff(times)
    beside = np.maximum(np.concatenate([[np.inf], intervals[:-1]]), np.concatenate([intervals[1:], [np.inf]]))
    found = [
        i
        for i in np.flatnonzero(intervals > _STOP_RATIO * beside)
        if _stops_near(times[: i + 1][::-1], stride) and _stops_near(times[i + 1 :], stride)
    ]
    return np.array(found, dtype=np.int64)


def _stops_near(times: Array, stride: int) -> bool:
    """Return whether pulses, in order of distance from an interval, extrapolate to zero speed near it."""
    intervals = np.abs(np.diff(times[::stride][: _STOP_REVS + 1]))
    if intervals.size < _STOP_REVS or not np.all(np.diff(intervals) < 0):
        return False
    squared_speed, angle = intervals**-2, np.arange(_STOP_REVS) + 0.5
    slope, level = np.polyfit(angle, squared_speed, 1)
    residual = np.max(np.abs(squared_speed - level - slope * angle))
    fits = residual < _STOP_RESIDUAL * squared_speed.max()
    return bool(fits and slope > 0 and -level / slope > -_STOP_REACH)


def _longest_sound_run(times: Array, wrong: NDArray[np.bool_]) -> tuple[int, Array]:
    """Return the index of the first pulse of the longest run of sound ones, and their times."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], wrong, [True]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins)) if begins.size else 0
    begin, end = (int(begins[longest]), int(ends[longest]) + 1) if begins.size else (0, 0)
    # the first and last pulse may be the wrong one of the faulty interval beside
    begin, end = begin + (begin > 0), end - (end < times.size)
    if end - begin < _FEWEST_SOUND:
        raise ValueError(
            f"the tachometer's pulses cannot be repaired: no {_FEWEST_SOUND} on end of {times.size} are sound. Check "
            "pulses_per_rev and the threshold, or use a sound part of the record."
        )
    return begin, times[begin:end]


def _steadiest_pulse(run: Array, stripes: int) -> int:
    """Return the pulse, whole revolutions into a run, after which the intervals change least.

    A run may hold faults that were not detected; they are unlikely where the speed is steady.
    """
    intervals = np.diff(run)
    period = stripes if intervals.size >= 2 * stripes + _FEWEST_SOUND else 1
    changes = np.abs(np.log(intervals[period:] / intervals[:-period]))
    window = min(_FEWEST_SOUND, changes.size)
    change = np.convolve(changes, np.ones(window), "valid")[: run.size - 2 : stripes]
    return int(np.argmin(change)) * stripes


def _prediction_errors(times: Array, counts: Counts, positions: Array) -> Array:
    """Return each pulse's error, in intervals, against the parabola through the three before it (Lagrange)."""
    angle = counts // positions.size + positions[counts % positions.size]
    if times.size < 4:  # noqa: PLR2004
        return np.full(1, _MOST_STD)
    t = [times[i : times.size - 3 + i] for i in range(4)]
    a = [angle[i : angle.size - 3 + i] for i in range(4)]
    predicted = np.zeros(t[0].size)
    for i in range(3):
        term = t[i] - times[0]
        for j in range(3):
            if j != i:
                term = term * (a[3] - a[j]) / (a[i] - a[j])
        predicted += term
    return np.asarray((t[3] - times[0] - predicted) / (t[3] - t[2]))


def _stripe_positions(times: Array, counts: Counts, stripes: int) -> Array:
    """Return the angles of the stripes in revolutions, (stripes,), as medians over the revolutions."""
    first = counts % stripes == 0
    if np.count_nonzero(first) < 3:  # noqa: PLR2004
        return np.arange(stripes) / stripes
    turns = np.interp(times, times[first], (counts[first] // stripes).astype(np.float64), left=np.nan, right=np.nan)
    fraction = turns - counts // stripes
    positions = np.arange(stripes) / stripes
    for stripe in range(1, stripes):
        found = fraction[(counts % stripes == stripe) & np.isfinite(fraction)]
        if found.size:
            positions[stripe] = np.median(found)
    return np.maximum.accumulate(positions)
