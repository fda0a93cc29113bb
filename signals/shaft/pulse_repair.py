"""Missing, double and spurious tachometer pulses: detection, numbering and repair.

Detection compares each interval with those of the same stripe in the revolutions around it. Around the faults, pulses
are numbered by dynamic programming over a beam of partial numberings: a missing and an extra pulse each have a cost,
and so has the error of each pulse against its prediction from the three before it. The search begins at the longest run
of sound pulses and goes forwards and backwards from there. A first pass assumes a wide prediction error; a second uses
the one that the first has found.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from signals._validation import Array

# ---- Detection of intervals between pulses that are too long or too short for those of the same stripe around them ---


Counts = NDArray[np.int64]

PERIODS = 5  # intervals on either side that an interval is compared with, each a revolution further
_GAP = 1.7  # a missing pulse merges two intervals: at least this many times the mean of those around it,
_GAP_EITHER = 1.2  # and longer than those of either side alone, which tells it from a deceleration
_PAIR = 1.4  # an extra pulse divides an interval: both parts together are below this, two sound ones about 2
_SHORT = 0.6
_DOUBTFUL = 8.0  # median deviations; the search leaves out no pulse that is off by less than about 16
_NEVER_DOUBTFUL, _ALWAYS_DOUBTFUL = 0.02, 0.25  # of the interval


def period_of(intervals: Array, stripes: int) -> int:
    """Return the distance, in intervals, of those to compare: a revolution, or 1 in a short record."""
    return stripes if intervals.size >= PERIODS * stripes else 1


def long_intervals(intervals: Array, most: Array) -> Counts:
    """Return the indices of intervals too long for their neighbours: pulses are missing in them."""
    return np.flatnonzero((intervals > _GAP * most.mean(axis=0)) & (intervals > _GAP_EITHER * most.max(axis=0)))


def short_intervals(intervals: Array, least: Array) -> NDArray[np.bool_]:
    """Return whether each interval is too short for its neighbours, as an extra pulse makes it.

    An extra pulse shifts the index of every later interval by one. The two parts of a divided interval are therefore
    compared with the interval expected at the first index from before, and at the second from after, which holds for
    uneven stripes too.
    """
    short = intervals < _SHORT * least.min(axis=0)
    halves = np.flatnonzero(intervals[:-1] + intervals[1:] < _PAIR * np.minimum(least[0, :-1], least[1, 1:]))
    short[np.where(intervals[halves] <= intervals[halves + 1], halves, halves + 1)] = True
    return np.asarray(short)


def doubtful_intervals(intervals: Array, least: Array, most: Array) -> NDArray[np.bool_]:
    """Return whether each interval deviates from the expected one by far more than the median interval does."""
    deviation = np.abs(intervals / ((least + most).mean(axis=0) / 2) - 1)
    limit = np.clip(_DOUBTFUL * np.nanmedian(deviation), _NEVER_DOUBTFUL, _ALWAYS_DOUBTFUL)
    return np.asarray(~(deviation <= limit))  # NaN, an unknown deviation, is doubtful


def expected_intervals(intervals: Array, *, period: int) -> tuple[Array, Array]:
    """Return the least and greatest length expected of each, from those before (row 0) and after (row 1), (2, n) each.

    They differ only in the first and last period, where one side stands for both: by its median and by extrapolation.
    """
    n = intervals.size
    sides = [_periods_away(intervals, period=-period), _periods_away(intervals, period=period)]
    expected = np.stack([_median(side) for side in sides])
    least, most = expected.copy(), expected.copy()
    for side, end in ((1, slice(0, period)), (0, slice(n - period, n))):
        extrapolated = _extrapolated(sides[side][end])
        least[:, end] = np.minimum(expected[side, end], extrapolated)
        most[:, end] = np.maximum(expected[side, end], extrapolated)
    return least, most


def _periods_away(intervals: Array, *, period: int) -> Array:
    """Return the intervals 1, 2, ... periods away from each, (n, PERIODS), NaN beyond the ends."""
    index = np.arange(intervals.size)[:, None] + period * np.arange(1, PERIODS + 1)
    inside = (index >= 0) & (index < intervals.size)
    return np.where(inside, intervals[np.where(inside, index, 0)], np.nan)


def _extrapolated(away: Array) -> Array:
    """Return intervals (m,) extrapolated from those 1, 2, ... periods away (m, PERIODS), NaN for fewer than three.

    At a constant acceleration the squared speed is linear in the angle; where it would fall below zero the shaft may
    stop, and the interval is infinite.
    """
    squared_speed = away**-2
    change = _median(np.diff(squared_speed, axis=1))
    periods = np.count_nonzero(np.isfinite(away), axis=1)
    extrapolated = _median(squared_speed) - change * (1 + periods) / 2
    with np.errstate(divide="ignore"):
        length = np.maximum(extrapolated, 0.0) ** -0.5
    return np.where(periods >= 3, length, np.nan)  # noqa: PLR2004


def _median(rows: Array) -> Array:
    """Return the median of each row without its NaN; NaN for a row of nothing else."""
    ordered = np.sort(rows, axis=1)  # NaN last
    filled = np.count_nonzero(np.isfinite(rows), axis=1)
    middle = np.stack([(filled - 1) // 2, filled // 2], axis=1)
    return np.asarray(np.take_along_axis(ordered, middle, axis=1).mean(axis=1))


# Numbering of pulses of which some are missing or extra: a search around doubtful intervals, a count in between.
# The search (`_pulse_repair_kernels.best_numbering`) begins at sound pulses and goes forwards, and backwards over the
# time-reversed list. A while after the last fault all surviving numberings agree, so that a search may end there with
# the result that one through the whole list would have.


_ROUGH = 0.01  # prediction error in intervals from which predictions by two and by three pulses are both allowed
_FAULT_COST = 3.0  # of a missing or an extra pulse, as a negative log likelihood
_BEAM = 24
_SEEDS = 3  # sound pulses that a search begins with
_BEFORE = 8  # pulses from the beginning of a search to the first doubtful interval
_AFTER, _REVS_AFTER = 16, 3  # pulses, and revolutions of them, from the last doubtful interval to its end
_CONVERGED = 8  # pulses at its end whose numbers must be consecutive


def numbered(
    times: Array, positions: Array, *, doubtful: NDArray[np.bool_], anchor: int, std: float
) -> tuple[Counts, Counts]:
    """Return the indices of the pulses kept and their numbers, (kept,) each, that at the anchor being zero.

    Parameters
    ----------
    times : (n,) array
        Pulse times in s.
    positions : (stripe,) array
        Angles of the stripes in revolutions.
    doubtful : (n - 1,) array
        Intervals around which to search.
    anchor : int
        Index of the first of three sound pulses, a pulse of the first stripe.
    std : float
        Standard deviation of the prediction error of a pulse, in intervals.
    """
    kept, counts = _numbered_forwards(times[anchor:], positions, doubtful[anchor:], first=0, std=std)
    reversed_positions = np.concatenate([[0.0], 1 - positions[:0:-1]])
    stop = anchor + _SEEDS
    reversed_times = np.negative(times[:stop][::-1], order="C")
    before, numbers = _numbered_forwards(
        reversed_times, reversed_positions, doubtful[: stop - 1][::-1], first=1 - _SEEDS, std=std
    )
    return (
        np.concatenate([stop - 1 - before[: _SEEDS - 1 : -1], anchor + kept]),
        np.concatenate([-numbers[: _SEEDS - 1 : -1], counts]),
    )


def _numbered_forwards(
    times: Array, positions: Array, doubtful: NDArray[np.bool_], *, first: int, std: float
) -> tuple[Counts, Counts]:
    """Return the indices of the pulses kept and their numbers; the first three are sound, numbered from `first`."""
    from signals.shaft._pulse_repair_kernels import best_numbering  # noqa: PLC0415 - compiled at need

    kept, counts = [np.arange(_SEEDS)], [np.arange(first, first + _SEEDS)]
    done, following = _SEEDS, first + _SEEDS  # pulses numbered so far, and the number of the next
    for start, stop in _searches(doubtful, after=_AFTER + _REVS_AFTER * positions.size):
        if stop <= done:
            continue
        begin, end = max(start, done - _SEEDS), stop
        sound = begin + _SEEDS - done  # pulses before the search, counted one by one
        kept.append(done + np.arange(sound))
        counts.append(following + np.arange(sound))
        while True:
            indices, numbers = best_numbering(
                times[begin:end], positions, following + sound - _SEEDS, _BEAM, std, std > _ROUGH, _FAULT_COST
            )
            if end == times.size or _converged(indices, numbers, end - begin):
                break
            end = min(times.size, 2 * end - begin)
        kept.append(begin + indices[_SEEDS:])
        counts.append(numbers[_SEEDS:])
        done, following = end, int(numbers[-1]) + 1
    return np.concatenate(kept), np.concatenate(counts)


def _searches(doubtful: NDArray[np.bool_], *, after: int) -> list[tuple[int, int]]:
    """Return the first pulse of each search and that after its last, in order; the end of the list is always searched.

    The last pulse has no interval after it to confirm it.
    """
    last = doubtful.size
    index = np.append(np.flatnonzero(doubtful), last)
    apart = np.flatnonzero(np.diff(index) > after + _BEFORE)
    begins = np.maximum(index[np.append(0, apart + 1)] - _BEFORE, 0)
    ends = np.minimum(index[np.append(apart, index.size - 1)] + 1 + after, last + 1)
    begins[-1] = max(min(int(begins[-1]), last - after), 0)
    return [(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]


def _converged(indices: Counts, numbers: Counts, pulses: int) -> bool:
    """Return whether the last pulses of a search are all kept, with consecutive numbers."""
    tail = slice(-_CONVERGED, None)
    return bool(
        indices.size >= _CONVERGED + _SEEDS
        and indices[-_CONVERGED] == pulses - _CONVERGED
        and np.all(np.diff(numbers[tail]) == 1)
    )


# ---- Pulse repair ----------------------------------------------------------------------------------------------------


_DOUBLE = 0.1  # of the interval: an extra pulse this soon after a true one is its double
_MOST_STD, _LEAST_STD = 0.08, 0.01  # of the prediction error, in intervals
_OUTLIER = 2.0  # standard deviations; leaving out a pulse with a smaller prediction error costs more than keeping it
_LATE = 3.0  # of the median prediction error, scaled: some 20 times the jitter, and 7 where the shaft is 3 times faster
_FEWEST_SOUND = 4  # consecutive pulses to begin from
_CALIBRATION_REVS = 3  # sound ones that suffice to estimate the angles of the stripes
_MOST_MISSING = 8  # consecutive pulses; a longer gap cannot be counted with certainty
_MOST_WRONG = 0.3
_STOP_INTERVALS = 4  # on either side that are fitted
_STOP_RATIO = 1.4  # of the longest of them to the shortest, at least
_STOP_REACH = 1.5  # intervals within which a constant deceleration must end for a stop
_STOP_EARLY = 0.25  # of the nearest interval by which it may end outside the two pulses
_STOP_RESIDUAL = 0.25  # of that fit at most, in intervals


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
    wrong = _wrong_intervals(intervals, least, most)
    if stripes == 1 and not wrong.any():
        return everything, everything
    begin, run = _longest_sound_run(times, wrong)
    positions = np.arange(stripes) / stripes
    calibrated = run.size >= _CALIBRATION_REVS * stripes
    if calibrated:
        positions = _stripe_positions(run, np.arange(run.size), stripes)
        wrong |= _wrong_at_the_ends(intervals, positions, begin)
    if not wrong.any():
        return everything, everything
    begin, run = _longest_sound_run(times, wrong)
    anchor = begin + _steadiest_pulse(run, stripes)
    if calibrated:
        positions = _stripe_positions(run, np.arange(run.size), stripes)
    doubtful = wrong | doubtful_intervals(intervals, least, most)
    kept, counts = numbered(times, positions, doubtful=doubtful, anchor=anchor, std=_MOST_STD)
    if not calibrated and stripes > 1:
        positions = _stripe_positions(times[kept], counts, stripes)
    error = np.abs(_prediction_errors(times[kept], counts, positions))
    spread = 1.5 * 1.4826 * float(np.median(error))
    std = min(max(spread, _LEAST_STD), _MOST_STD)
    doubtful[kept[-error.size :][error > _OUTLIER * std] - 1] = True
    kept, counts = numbered(times, positions, doubtful=doubtful, anchor=anchor, std=std)
    kept, counts = _with_late_pulses(times, kept, counts, tolerance=min(_LATE * spread, _DOUBLE))
    _refuse_too_many(times, kept, counts)
    return kept, counts - counts[0]


def _wrong_intervals(intervals: Array, least: Array, most: Array) -> NDArray[np.bool_]:
    """Return whether each interval is too short or too long for its neighbours."""
    wrong = short_intervals(intervals, least)
    wrong[long_intervals(intervals, most)] = True
    return wrong


def _wrong_at_the_ends(intervals: Array, positions: Array, begin: int) -> NDArray[np.bool_]:
    """Return whether each interval of the outer revolutions is wrong for its neighbours, with the stripes made even.

    There the same stripe has passed too seldom to tell a fault from an acceleration; intervals over the angles of their
    stripes, the first of which is pulse `begin`, can be compared with those beside them.
    """
    stripes = positions.size
    widths = np.diff(np.append(positions, 1.0)) * stripes
    even = intervals / np.maximum(widths[(np.arange(intervals.size) - begin) % stripes], 1e-3)
    wrong = _wrong_intervals(even, *expected_intervals(even, period=1))
    wrong[PERIODS * stripes : -PERIODS * stripes] = False
    return wrong


def _with_late_pulses(times: Array, kept: Counts, counts: Counts, *, tolerance: float) -> tuple[Counts, Counts]:
    """Return the numbering with the pulses left out that are where a missing one should be: early or late, not wrong.

    `tolerance` is in intervals. A jitter of many thousand pulses has outliers, of which the search makes a missing and
    a spurious pulse each.
    """
    missing = np.setdiff1d(np.arange(counts[0], counts[-1] + 1), counts, assume_unique=True)
    extra = np.setdiff1d(np.arange(times.size), kept, assume_unique=True)
    if not (missing.size and extra.size):
        return kept, counts
    expected = np.interp(missing, counts, times[kept])
    interval = np.interp(missing + 0.5, counts, times[kept]) - np.interp(missing - 0.5, counts, times[kept])
    nearest = extra[np.argmin(np.abs(times[extra] - expected[:, None]), axis=1)]
    same = np.abs(times[nearest] - expected) < tolerance * interval
    index, first = np.unique(nearest[same], return_index=True)
    order = np.argsort(np.concatenate([kept, index]))
    return np.concatenate([kept, index])[order], np.concatenate([counts, missing[same][first]])[order]


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

    The angle is extrapolated from either side at constant acceleration, from all pulses, else from those of one
    stripe; where both parabolas come to rest between the two pulses, the shaft may have stopped, and may have reversed.
    """
    found = _stops_by(times, 1)
    return found if found.size or stripes == 1 else _stops_by(times, stripes)


def _stops_by(times: Array, stride: int) -> Counts:
    """Return the intervals with a possible stop, by every `stride`-th pulse on either side."""
    reach = _STOP_INTERVALS * stride
    at = np.arange(reach, times.size - 1 - reach)
    before = times[at[:, None] - stride * np.arange(_STOP_INTERVALS + 1)] - times[at, None]
    after = times[at[:, None] + 1 + stride * np.arange(_STOP_INTERVALS + 1)] - times[at + 1, None]
    sides = [np.abs(np.diff(side, axis=1)) for side in (before, after)]
    slowing = [np.all(np.diff(side, axis=1) < 0, axis=1) & (side[:, 0] > _STOP_RATIO * side[:, -1]) for side in sides]
    rows = np.flatnonzero(slowing[0] & slowing[1])
    gap = times[at + 1] - times[at]
    return np.array(
        [at[row] for row in rows if all(_rests(np.abs(side[row]), gap[row]) for side in (before, after))],
        dtype=np.int64,
    )


def _rests(distances: Array, gap: float) -> bool:
    """Return whether pulses, by their time from the nearest one, extrapolate to rest within a gap beside that."""
    near = distances[1]
    angle = np.arange(distances.size)
    bend, speed, level = np.polyfit(distances / near, angle, 2)
    if bend <= 0:
        return False
    rest, turned = speed / (2 * bend), speed**2 / (4 * bend)  # beyond the nearest pulse, in its interval and in turns
    fits = np.max(np.abs(np.polyval((bend, speed, level), distances / near) - angle)) < _STOP_RESIDUAL
    return bool(fits and -_STOP_EARLY <= rest <= gap / near + _STOP_EARLY and turned <= _STOP_REACH)


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
    """Return the angles of the stripes in revolutions, (stripes,), as medians over the revolutions.

    The angle between passes of the first stripe is a cubic spline of time, exact at constant acceleration: linear
    interpolation would bend evenly spaced stripes by the acceleration, with a kink at the first stripe that a repair
    takes for a fault in every revolution.
    """
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - at need

    first = counts % stripes == 0
    if np.count_nonzero(first) < 3:  # noqa: PLR2004
        return np.arange(stripes) / stripes
    turns = CubicSpline(times[first], (counts[first] // stripes).astype(np.float64), extrapolate=False)(times)
    fraction = turns - counts // stripes
    positions = np.arange(stripes) / stripes
    for stripe in range(1, stripes):
        found = fraction[(counts % stripes == stripe) & np.isfinite(fraction)]
        if found.size:
            positions[stripe] = np.median(found)
    return np.maximum.accumulate(positions)
