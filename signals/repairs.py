"""Which pulses of a tachometer are wrong: missing, double or spurious; found, counted, and left out or bridged.

Finding is cheap and holds each interval against those of the same stripe in the revolutions around it. Only where
it finds something are pulses numbered anew: of the many ways to number them, or to leave one out, the least costly
is kept, where a missing and an extra pulse each have a price and so has every pulse off the place that the
three before it foretell (dynamic programming over a beam of partial numberings). It begins at the longest run of
sound pulses and goes both ways. The first pass allows for any motion, the second for what the first has found usual.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from signals._pulse_faults import doubtful_in, gaps_in, lap_of, shorts_in, usual_intervals
from signals._pulse_numbering import numbered

if TYPE_CHECKING:
    from signals._checks import Array

Counts = NDArray[np.int64]

_DOUBLE = 0.1  # of the interval: an extra pulse this soon after a true one is its double
_WIDEST, _NARROWEST = 0.08, 0.01  # standard deviations allowed, in intervals
_OFF = 2.0  # standard deviations; a pulse that is less off its place is dearer to leave out than to keep
_FEWEST_SOUND = 4  # pulses on end, to begin from
_LAPS_KNOWN = 3  # sound ones that tell the places of the stripes
_LONGEST = 8  # missing pulses on end; more cannot be counted for certain
_MOST_WRONG = 0.3
_FEW_STRIPES = 8  # up to here stripes may stand anywhere; of more the intervals are taken as even
_STOP_LONG = 1.7  # times the longer of its neighbours, that an interval with a stop lasts
_STOP_REACH = 1.5  # intervals within which an even deceleration must end for a stop
_STOP_LAPS = 4  # intervals on either side that show it
_STOP_STRAIGHT = 0.2  # how far off an even one they may be, of the largest square of the speed


def _no_times() -> Array:
    return np.zeros(0)


def _no_places() -> Counts:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class PulseRepairs:
    """What was wrong with a list of pulses: how many, and which.

    `missing_times_s` says about when a pulse is missing. A double follows a true pulse within a tenth of the
    interval, any other extra pulse is spurious; both are left out of the phase, and their indices are those of the
    list as given.
    """

    missing: int = 0
    double: int = 0
    spurious: int = 0
    missing_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("missing",), "units": "s"})
    double_index: Counts = field(default_factory=_no_places, metadata={"dims": ("double",), "units": "1"})
    double_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("double",), "units": "s"})
    spurious_index: Counts = field(default_factory=_no_places, metadata={"dims": ("spurious",), "units": "1"})
    spurious_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("spurious",), "units": "s"})

    @property
    def total(self) -> int:
        """How many pulses were wrong."""
        return self.missing + self.double + self.spurious


def refuse_faults(times: Array, *, stripes: int, offset: int = 0) -> None:
    """Raise ValueError at the first missing, else the first extra pulse; pulses are named from `offset` on."""
    intervals = np.diff(times)
    if intervals.size == 0:
        return
    least, most = usual_intervals(intervals, lap=lap_of(intervals, stripes))
    gaps = gaps_in(intervals, most)
    if gaps.size:
        i = int(gaps[0])
        raise ValueError(
            f"a tachometer pulse is missing: the interval after pulse {offset + i} at {times[i]:g} s lasts "
            f"{intervals[i]:.3g} s, {intervals[i] / most[:, i].mean():.2f} times its neighbours "
            f'({gaps.size} such gaps). Let it be repaired (on_fault="repair"), or use the part of the record without '
            "the gap."
        )
    short = shorts_in(intervals, least)
    if short.any():
        i = int(np.argmax(short))
        places = np.count_nonzero(np.diff(short, prepend=False) & short)  # a run is one place
        raise ValueError(
            f"there is an extra tachometer pulse: pulse {offset + i + 1} at {times[i + 1]:g} s follows "
            f"pulse {offset + i} after {intervals[i]:.3g} s, {intervals[i] / least[:, i].max():.2f} of the usual time "
            f"({places} such places). Take false and double pulses out of the "
            'list, let them be repaired (on_fault="repair"), or use the part of the record without them.'
        )


def number_pulses(times: Array, *, stripes: int) -> tuple[Counts, Counts]:
    """Return which pulses are true, and their numbers from zero with the missing ones counted, (kept,) each.

    Raises
    ------
    ValueError
        More faults than can be told from a change of speed.
    """
    everything = np.arange(times.size)
    intervals = np.diff(times)
    if intervals.size < 3:  # noqa: PLR2004 - nothing to hold one against
        return everything, everything
    least, most = usual_intervals(intervals, lap=lap_of(intervals, stripes))
    wrong = shorts_in(intervals, least)
    wrong[gaps_in(intervals, most)] = True
    if not wrong.any():
        return everything, everything
    begin, run = _soundest(times, wrong)
    anchor = begin + _steadiest(run, stripes)
    pattern = np.arange(stripes) / stripes
    known = run.size >= _LAPS_KNOWN * stripes
    if known:
        pattern = _pattern_of(run, np.arange(run.size), stripes)
    doubtful = wrong | doubtful_in(intervals, least, most)
    kept, counts = numbered(times, pattern, doubtful=doubtful, anchor=anchor, width=_WIDEST)
    if not known and stripes > 1:
        pattern = _pattern_of(times[kept], counts, stripes)
    off = np.abs(_off_place(times[kept], counts, pattern))
    width = float(np.clip(1.5 * 1.4826 * np.median(off), _NARROWEST, _WIDEST))
    doubtful[kept[-off.size :][off > _OFF * width] - 1] = True
    kept, counts = numbered(times, pattern, doubtful=doubtful, anchor=anchor, width=width)
    _refuse_hopeless(times, kept, counts)
    return kept, counts - counts[0]


def _refuse_hopeless(times: Array, kept: Counts, counts: Counts) -> None:
    steps = np.diff(counts)
    missing, extra = int(np.sum(steps - 1)), times.size - kept.size
    if steps.size and steps.max() > _LONGEST + 1:
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
    """Tell what a numbering leaves out and bridges; indices count from `offset`."""
    steps = np.diff(counts)
    missing = counts[0] + _left_out(counts - counts[0], int(counts[-1] - counts[0]) + 1)
    extra = _left_out(kept, times.size)
    before = np.clip(np.searchsorted(kept, extra) - 1, 0, max(steps.size - 1, 0))
    # how far after the true pulse, as a share of the interval to the next
    usual = np.diff(times[kept])[before] / steps[before] if steps.size else np.ones(extra.size)
    late = times[extra] - times[kept[before]]
    double = (late > 0) & (late < _DOUBLE * usual)
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


def _left_out(places: Counts, size: int) -> Counts:
    out = np.ones(size, dtype=np.bool_)
    out[places] = False
    return np.flatnonzero(out)


def all_repairs(parts: list[PulseRepairs]) -> PulseRepairs:
    """Return the repairs of consecutive stretches as one."""

    def together(name: str) -> Any:  # noqa: ANN401 - times or indices
        return np.concatenate([getattr(part, name) for part in parts])

    return PulseRepairs(
        missing=sum(part.missing for part in parts),
        double=sum(part.double for part in parts),
        spurious=sum(part.spurious for part in parts),
        missing_times_s=together("missing_times_s"),
        double_index=together("double_index"),
        double_times_s=together("double_times_s"),
        spurious_index=together("spurious_index"),
        spurious_times_s=together("spurious_times_s"),
    )


def possible_stops(times: Array, *, stripes: int) -> Counts:
    """Intervals in which the shaft may have stopped: slowing towards it and gathering speed after it.

    The square of the speed is carried on along the angle from either side, as at a constant acceleration; where both
    lines reach zero about within the interval, the shaft may have stood there, and may have turned back.
    """
    stride = stripes if stripes <= _FEW_STRIPES else 1
    intervals = np.diff(times)
    beside = np.maximum(np.concatenate([[np.inf], intervals[:-1]]), np.concatenate([intervals[1:], [np.inf]]))
    found = [
        i
        for i in np.flatnonzero(intervals > _STOP_LONG * beside)
        if _runs_out(times[: i + 1][::-1], stride) and _runs_out(times[i + 1 :], stride)
    ]
    return np.array(found, dtype=np.int64)


def _runs_out(away: Array, stride: int) -> bool:
    """Whether pulses, told away from a place, show a shaft that stands within reach of it."""
    laps = np.abs(np.diff(away[::stride][: _STOP_LAPS + 1]))
    if laps.size < _STOP_LAPS or not np.all(np.diff(laps) < 0):
        return False
    squares, place = laps**-2, np.arange(_STOP_LAPS) + 0.5
    slope, level = np.polyfit(place, squares, 1)
    straight = np.max(np.abs(squares - level - slope * place)) < _STOP_STRAIGHT * squares.max()
    return bool(straight and slope > 0 and -level / slope > -_STOP_REACH)


def _soundest(times: Array, wrong: NDArray[np.bool_]) -> tuple[int, Array]:
    """Return the longest run of sound pulses, and the index of its first."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], wrong, [True]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins)) if begins.size else 0
    begin, end = (int(begins[longest]), int(ends[longest]) + 1) if begins.size else (0, 0)
    # the outermost may be the wrong ones of the intervals beside
    begin, end = begin + (begin > 0), end - (end < times.size)
    if end - begin < _FEWEST_SOUND:
        raise ValueError(
            f"the tachometer's pulses cannot be repaired: no {_FEWEST_SOUND} on end of {times.size} are sound. Check "
            "pulses_per_rev and the threshold, or use a sound part of the record."
        )
    return begin, times[begin:end]


def _steadiest(run: Array, stripes: int) -> int:
    """Return the pulse, whole laps into a run, after which the intervals change least: faults may hide in a run."""
    intervals = np.diff(run)
    lap = stripes if intervals.size >= 2 * stripes + _FEWEST_SOUND else 1
    changes = np.abs(np.log(intervals[lap:] / intervals[:-lap]))
    window = min(_FEWEST_SOUND, changes.size)
    change = np.convolve(changes, np.ones(window), "valid")[: run.size - 2 : stripes]
    return int(np.argmin(change)) * stripes


def _off_place(times: Array, counts: Counts, pattern: Array) -> Array:
    """Return how far each pulse lies off the place that the three before it foretell, in intervals."""
    place = counts // pattern.size + pattern[counts % pattern.size]
    if times.size < 4:  # noqa: PLR2004
        return np.full(1, _WIDEST)
    near = [times[i : times.size - 3 + i] for i in range(4)]
    at = [place[i : place.size - 3 + i] for i in range(4)]
    foretold = np.zeros(near[0].size)
    for i in range(3):
        share = near[i] - times[0]
        for j in range(3):
            if j != i:
                share = share * (at[3] - at[j]) / (at[i] - at[j])
        foretold += share
    return np.asarray((near[3] - times[0] - foretold) / (near[3] - near[2]))


def _pattern_of(times: Array, counts: Counts, stripes: int) -> Array:
    """Places of the stripes, (stripes,), as medians over the laps of pulses whose numbers are known."""
    first = counts % stripes == 0
    if np.count_nonzero(first) < 3:  # noqa: PLR2004
        return np.arange(stripes) / stripes
    turns = np.interp(times, times[first], (counts[first] // stripes).astype(np.float64), left=np.nan, right=np.nan)
    share = turns - counts // stripes
    places = np.arange(stripes) / stripes
    for stripe in range(1, stripes):
        mine = share[(counts % stripes == stripe) & np.isfinite(share)]
        if mine.size:
            places[stripe] = np.median(mine)
    return np.maximum.accumulate(places)
