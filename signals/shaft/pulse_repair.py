"""Missing, double and spurious tachometer pulses: numbering, repair, and intervals in which a shaft may have stopped.

Pulses are numbered by multiple-hypothesis tracking (`signals.shaft._kernels`), forwards and backwards from
the middle of the steadiest part of the list.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from signals._validation import Array

Counts = NDArray[np.int64]

# ---- Pulse repair ----------------------------------------------------------------------------------------------------


_DOUBLE = 0.1  # of the interval: an extra pulse this soon after a true one is its double
_CALIBRATION_REVS = 3  # steady revolutions that suffice to estimate the angles of the stripes


def _no_times() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class PulseRepairs:
    """Missing, double and spurious pulses of a tachometer.

    A double pulse follows a true one within a tenth of the interval; any other extra pulse is spurious. Both are left
    out of the phase.

    Attributes
    ----------
    missing, double, spurious : int
        Number of pulses of each kind.
    missing_times_s : (missing,) array
        Approximate times of the missing pulses in s.
    double_times_s, spurious_times_s : (double,) and (spurious,) arrays
        Times of the double and of the spurious pulses in s.

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
    double_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("double",), "units": "s"})
    spurious_times_s: Array = field(default_factory=_no_times, metadata={"dims": ("spurious",), "units": "s"})

    @property
    def total(self) -> int:
        """Number of missing and extra pulses."""
        return self.missing + self.double + self.spurious


def number_pulses(times: Array, *, stripes: int) -> tuple[Counts, Counts]:
    """Return the indices of the true pulses, and their numbers from zero with missing pulses counted, (kept,) each.

    Raise ValueError for more faults than can be distinguished from a change of speed.
    """
    if times.size <= 3:  # noqa: PLR2004 - too few to compare
        return np.arange(times.size), np.arange(times.size)
    begin, end = _steadiest(times, stripes)
    if end - begin == times.size > 2 * stripes:
        return np.arange(times.size), np.arange(times.size)
    if end - begin > _CALIBRATION_REVS * stripes or stripes == 1:
        positions = stripe_positions(times[begin:end], np.arange(end - begin), stripes)
        kept, counts = _numbered(times, positions, anchor=begin + (end - begin) // (2 * stripes) * stripes)
    else:
        kept, counts = _numbered_by_turns(times, stripes)
    _refuse_too_many(times, kept, counts)
    return kept, counts - counts[0]


def _numbered_by_turns(times: Array, stripes: int) -> tuple[Counts, Counts]:
    """Return a numbering and its pulses, estimated in alternation with the stripe positions, evenly spaced at first."""
    anchor = sum(_steadiest(times, 1)) // 2
    kept, counts = _numbered(times, np.arange(stripes) / stripes, anchor)
    for _ in range(10):
        last = kept, counts
        kept, counts = _numbered(times, stripe_positions(times[kept], counts, stripes), anchor)
        if np.array_equal(last[0], kept) and np.array_equal(last[1], counts):
            return kept, counts
    raise ValueError(
        f"the tachometer's pulses cannot be repaired: {_CALIBRATION_REVS} consecutive revolutions without a fault are "
        f"needed to estimate the angles of {stripes} stripes. Check pulses_per_rev and the threshold, or use a sound "
        "part of the record."
    )


def _steadiest(times: Array, stripes: int) -> tuple[int, int]:
    """Return the first pulse of the longest steady run, and the one after its last.

    In a steady run intervals repeat after one revolution, apart from the change of speed, the median of nearby changes.
    """
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    lengths = np.log(np.diff(times))
    change = lengths[stripes:] - lengths[:-stripes]
    steady = 0.5  # change of the log interval since the last of the same stripe; a fault changes it by 0.69 or more
    unsteady = np.abs(change - median_filter(change, size=9)) > steady  # a fault affects two or three of nine
    edges = np.flatnonzero(np.diff(np.concatenate([[True], unsteady, [True]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    if not begins.size:
        return 0, 2
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest]) + stripes + 1


def _numbered(times: Array, positions: Array, anchor: int) -> tuple[Counts, Counts]:
    """Return the indices of the pulses kept and their numbers, (kept,) each, zero at the anchor, which is stripe 0.

    Before the anchor, time and stripes are reversed.
    """
    from signals.shaft._kernels import best_numbering  # noqa: PLC0415 - compiled at need

    since = np.diff(times, prepend=-np.inf)
    after, numbers = best_numbering(times[anchor:], since[anchor:], positions, _DOUBLE)
    if anchor == 0:
        return after, numbers
    backwards = np.concatenate([[0.0], 1 - positions[:0:-1]])
    reverse = slice(anchor, None, -1)
    ahead = np.negative(times[reverse], order="C")
    before, earlier = best_numbering(ahead, since[reverse].copy(), backwards, _DOUBLE)
    return np.concatenate([anchor - before[:0:-1], anchor + after]), np.concatenate([-earlier[:0:-1], numbers])


def _refuse_too_many(times: Array, kept: Counts, counts: Counts) -> None:
    """Raise where a gap is too long to count, or too many of the pulses are missing or extra."""
    steps = np.diff(counts)
    missing, extra = int(np.sum(steps - 1)), times.size - kept.size
    if steps.size and steps.max() > 8 + 1:  # 8 consecutive pulses; a longer gap cannot be counted with certainty
        i = int(np.argmax(steps))
        raise ValueError(
            f"the tachometer has no pulse from {times[kept[i]]:g} to {times[kept[i + 1]]:g} s: about {steps[i] - 1} "
            "are missing in a row, too many to count reliably. Use the parts of the record before and after."
        )
    most_wrong = 0.3
    if missing + extra > most_wrong * times.size:
        raise ValueError(
            f"the tachometer's pulses cannot be repaired: {missing} would be missing and {extra} extra, of "
            f"{times.size}. Check pulses_per_rev and the threshold, or use a sound part of the record."
        )


def repairs_of(times: Array, kept: Counts, counts: Counts) -> PulseRepairs:
    """Return the missing and extra pulses of a numbering."""
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
        double_times_s=times[extra[double]],
        spurious_times_s=times[extra[~double]],
    )


def possible_stops(times: Array, *, stripes: int) -> Counts:
    """Return the intervals in which the shaft may have stopped: it decelerates before them and accelerates after them.

    The angle is extrapolated from either side at constant acceleration, from all pulses, else from those of one
    stripe; where both parabolas come to rest between the two pulses, the shaft may have stopped, and reversed.
    """
    found = _stops_by(times, 1)
    return found if found.size or stripes == 1 else _stops_by(times, stripes)


def _stops_by(times: Array, stride: int) -> Counts:
    """Return the intervals with a possible stop, by every `stride`-th pulse on either side."""
    stop_intervals = 4  # fitted on either side
    reach = stop_intervals * stride
    at = np.arange(reach, times.size - 1 - reach)
    before = times[at[:, None] - stride * np.arange(stop_intervals + 1)] - times[at, None]
    after = times[at[:, None] + 1 + stride * np.arange(stop_intervals + 1)] - times[at + 1, None]
    sides = [np.abs(np.diff(side, axis=1)) for side in (before, after)]
    # 1.4 is the smallest ratio of the longest interval to the shortest
    slowing = [np.all(np.diff(side, axis=1) < 0, axis=1) & (side[:, 0] > 1.4 * side[:, -1]) for side in sides]
    rows = np.flatnonzero(slowing[0] & slowing[1])
    gap = times[at + 1] - times[at]
    return np.array(
        [at[row] for row in rows if all(_rests(np.abs(side[row]), gap[row]) for side in (before, after))],
        dtype=np.int64,
    )


def _rests(distances: Array, gap: float) -> bool:
    """Return whether pulses, given by their time from the nearest one, extrapolate to rest within the adjacent gap."""
    near, angle = distances[1], np.arange(distances.size)
    bend, speed, level = np.polyfit(distances / near, angle, 2)
    if bend <= 0:
        return False
    rest, turned = speed / (2 * bend), speed**2 / (4 * bend)  # time and angle from the nearest pulse, in its intervals
    stop_residual = 0.25  # largest residual of the fit, in intervals
    fits = np.max(np.abs(np.polyval((bend, speed, level), distances / near) - angle)) < stop_residual
    stop_reach = 1.5  # intervals within which a constant deceleration must end for a stop
    stop_early = 0.25  # of the nearest interval, by which it may end outside the two pulses
    return bool(fits and -stop_early <= rest <= gap / near + stop_early and turned <= stop_reach)


def stripe_positions(times: Array, counts: Counts, stripes: int) -> Array:
    """Return the angles of the stripes in revolutions, (stripes,), as medians over the revolutions.

    The angle between passes of the first stripe is a quintic spline of time: with linear interpolation, acceleration
    would displace evenly spaced stripes.
    """
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - at need

    positions = np.arange(stripes) / stripes
    first = counts % stripes == 0
    passes = np.count_nonzero(first)
    if stripes == 1 or passes < 3:  # noqa: PLR2004
        return positions
    degree = 5 if passes > 5 else (3 if passes > 3 else 1)  # noqa: PLR2004
    turns = make_interp_spline(times[first], counts[first] // stripes, k=degree)
    inside = (times >= times[first][0]) & (times <= times[first][-1])
    fraction = turns(times[inside]) - counts[inside] // stripes
    stripe = counts[inside] % stripes
    for each in range(1, stripes):
        found = fraction[stripe == each]
        if found.size:
            positions[each] = np.median(found)
    return np.maximum.accumulate(positions)
