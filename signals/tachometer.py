"""Tachometer waveform to pulse times, and pulse times to shaft phase."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from signals._checks import Array, positive, real_vector, whole
from signals.phase import ShaftPhase

_HYSTERESIS = 0.25  # of the swing, either side of the middle
_SWING_PERCENTILES = (1.0, 99.0)
_LAPS = 5  # intervals on either side that an interval is judged by, each a revolution further
_GAP = 1.7  # a missing pulse makes one interval of two: this many times those around it,
_GAP_BESIDE = 1.2  # and longer than either side alone, which slowing down is not
_PAIR = 1.4  # an extra pulse makes two intervals of one: together below this, where two sound ones are about 2
_SHORT = 0.6
_CALIBRATION_REVOLUTIONS = 8


@dataclass(frozen=True, kw_only=True)
class PulseTrain:
    """Times at which a tachometer waveform rises through its threshold."""

    times_s: Array = field(metadata={"dims": ("pulse",), "units": "s"})
    threshold: float
    hysteresis: float


def pulse_times(waveform: ArrayLike, *, rate_hz: float, start_s: float = 0.0) -> PulseTrain:
    """Find the rising edges of a tachometer waveform, between samples by linear interpolation.

    The threshold is half-way between the 1st and 99th percentile; an edge counts once the waveform has been
    a quarter of the swing below it, and is to rise a quarter above, so noise on an edge makes one pulse. Where
    noise carries an edge through the threshold several times, its place is the sum of the rises less the sum of
    the falls: that of one clean rise with as much time below. Measured on a sine of
    20 Hz at 51.2 kHz with noise of 5 % of its amplitude: bias 0.1 samples and standard deviation 3.2, where the
    first rise comes 31 samples early, with 11.

    Parameters
    ----------
    waveform : (n,) array, any unit
    rate_hz : float
    start_s : float
        Time of the first sample.

    Raises
    ------
    ValueError
        Fewer than two edges, or a waveform that looks like a list of times.
    """
    wave = real_vector(waveform, name="the tachometer waveform", minimum=3)
    rate = positive(rate_hz, name="rate_hz")
    if np.all(np.diff(wave) > 0):
        raise ValueError(
            "the tachometer waveform only ever rises: it looks like a list of pulse times, not a waveform; "
            "hand it over as pulse times (on the command line: --tach-times)."
        )
    low, high = np.percentile(wave, _SWING_PERCENTILES)
    if high <= low:  # narrow pulses can hide from the percentiles
        low, high = float(wave.min()), float(wave.max())
    middle, margin = (low + high) / 2, _HYSTERESIS * (high - low)
    state = np.where(wave > middle + margin, 1, np.where(wave < middle - margin, -1, 0))
    decided = np.flatnonzero(state)
    rises = np.flatnonzero((state[decided][:-1] == -1) & (state[decided][1:] == 1))
    last_low, first_high = decided[rises], decided[rises + 1]
    times = np.array([_crossing(wave, a, b, middle) for a, b in zip(last_low, first_high, strict=True)])
    if times.size < 2:  # noqa: PLR2004
        raise ValueError(
            f"the tachometer waveform crosses {middle:.4g} upwards {times.size} times; at least 2 pulses are needed. "
            "Check the channel."
        )
    return PulseTrain(times_s=start_s + times / rate, threshold=float(middle), hysteresis=float(margin))


def _crossing(wave: Array, low: int, high: int, level: float) -> float:
    """Position in samples of the one rise through `level` that leaves as much time below it as there is."""
    height = wave[low : high + 1] - level
    above = height >= 0
    before = np.flatnonzero(above[1:] != above[:-1])
    crossings = before + height[before] / (height[before] - height[before + 1])  # a rise, a fall, ... a rise
    return float(low + crossings[::2].sum() - crossings[1::2].sum())


def shaft_phase(times_s: ArrayLike, *, pulses_per_rev: int = 1) -> ShaftPhase:
    """Turn the pulse times of one tachometer into the shaft's phase; revolution zero is the first pulse.

    With several stripes a revolution their positions are found from the data (the median place of each
    between passes of the first), since no stripe sits exactly where it should; below eight revolutions they
    are taken as even.

    Pulses are refused, not repaired. Each interval is held against those of the same stripe in the five
    revolutions before and the five after (below five revolutions, against its neighbours). In the first and last
    revolution the one side is carried on at its acceleration; among very unequal stripes a wrong pulse may pass
    there. More than five wrong intervals on end cannot be told from a change of speed.

    Parameters
    ----------
    times_s : (n,) array, s
        Strictly increasing.
    pulses_per_rev : int

    Raises
    ------
    ValueError
        Pulses that run backwards, that are missing or that are extra: with place, size and number.
    """
    times = real_vector(times_s, name="pulse times", minimum=2)
    stripes = whole(pulses_per_rev, name="pulses_per_rev", least=1)
    intervals = np.diff(times)
    back = np.flatnonzero(intervals <= 0)
    if back.size:
        i = int(back[0])
        raise ValueError(
            f"pulse times run backwards: pulse {i + 1} at {times[i + 1]:g} s is not after pulse {i} at {times[i]:g} s "
            f"({back.size} such places). Sort out the tachometer, or hand a waveform over as a waveform."
        )
    _refuse_missing_and_extra(times, intervals, lap=stripes if intervals.size >= _LAPS * stripes else 1)
    positions = _stripe_positions(times, stripes)
    count = np.arange(times.size)
    return ShaftPhase(
        times_s=times,
        revolutions=count // stripes + positions[count % stripes],
        stripe_positions_rev=positions,
    )


def _refuse_missing_and_extra(times: Array, intervals: Array, *, lap: int) -> None:
    """Refuse pulses that the intervals, each against those whole laps before and after it, show to be wrong.

    A wrong pulse moves every later one on by a stripe. So a gap is the stripe's interval as it was before plus
    the one that stands in its place after, however uneven the stripes; and two parts of one interval add up to
    what stood in place of the first part before, and of the second after.
    """
    least, most = _usual_intervals(intervals, lap=lap)
    gaps = np.flatnonzero((intervals > _GAP * most.mean(axis=0)) & (intervals > _GAP_BESIDE * most.max(axis=0)))
    if gaps.size:
        i = int(gaps[0])
        raise ValueError(
            f"a tachometer pulse is missing: the interval after pulse {i} at {times[i]:g} s lasts "
            f"{intervals[i]:.3g} s, {intervals[i] / most[:, i].mean():.2f} times its neighbours "
            f"({gaps.size} such gaps). Repair the pulse list, or use the part of the record without the gap."
        )
    short = intervals < _SHORT * least.min(axis=0)
    halves = np.flatnonzero(intervals[:-1] + intervals[1:] < _PAIR * np.minimum(least[0, :-1], least[1, 1:]))
    short[np.where(intervals[halves] <= intervals[halves + 1], halves, halves + 1)] = True
    if short.any():
        i = int(np.argmax(short))
        places = np.count_nonzero(np.diff(short, prepend=False) & short)  # a run is one place
        raise ValueError(
            f"there is an extra tachometer pulse: pulse {i + 1} at {times[i + 1]:g} s follows pulse {i} after "
            f"{intervals[i]:.3g} s, {intervals[i] / least[:, i].max():.2f} of the usual time "
            f"({places} such places). Take false and double pulses out of the "
            "list, or use the part of the record without them."
        )


def _usual_intervals(intervals: Array, *, lap: int) -> tuple[Array, Array]:
    """Least and most that each interval is to be by those before (row 0) and after it (row 1), (2, n) each.

    The two differ where only one side is there, which then stands for both: its median, and its value carried on.
    """
    n = intervals.size
    sides = [_laps_away(intervals, lap=-lap), _laps_away(intervals, lap=lap)]
    usual = np.stack([_median(side) for side in sides])
    least, most = usual.copy(), usual.copy()
    for here, bare in ((1, slice(0, lap)), (0, slice(n - lap, n))):
        carried = _carried_on(sides[here][bare])
        least[:, bare] = np.minimum(usual[here, bare], carried)
        most[:, bare] = np.maximum(usual[here, bare], carried)
    return least, most


def _laps_away(intervals: Array, *, lap: int) -> Array:
    """Return the intervals 1, 2, ... laps away from each, (n, _LAPS), NaN beyond the ends."""
    places = np.arange(intervals.size)[:, None] + lap * np.arange(1, _LAPS + 1)
    inside = (places >= 0) & (places < intervals.size)
    return np.where(inside, intervals[np.where(inside, places, 0)], np.nan)


def _carried_on(away: Array) -> Array:
    """Length of the intervals (m,) from those 1, 2, ... laps away (m, _LAPS), NaN for fewer than three.

    At a constant acceleration the square of the speed changes evenly with the angle; where it would fall below
    zero the shaft may stop, and no interval is too long.
    """
    squared_speed = away**-2
    change = _median(np.diff(squared_speed, axis=1))
    laps = np.count_nonzero(np.isfinite(away), axis=1)
    carried = _median(squared_speed) - change * (1 + laps) / 2
    with np.errstate(divide="ignore"):
        length = np.maximum(carried, 0.0) ** -0.5
    return np.where(laps >= 3, length, np.nan)  # noqa: PLR2004


def _median(rows: Array) -> Array:
    """Median of each row without its NaN; NaN for a row of nothing else."""
    ordered = np.sort(rows, axis=1)  # NaN last
    filled = np.count_nonzero(np.isfinite(rows), axis=1)
    middle = np.stack([(filled - 1) // 2, filled // 2], axis=1)
    return np.asarray(np.take_along_axis(ordered, middle, axis=1).mean(axis=1))


def _stripe_positions(times: Array, stripes: int) -> Array:
    """Place of each stripe in its revolution, (stripes,), the first at zero."""
    even = np.arange(stripes) / stripes
    if stripes == 1 or times.size < _CALIBRATION_REVOLUTIONS * stripes:
        return even
    first = times[::stripes]
    reference = ShaftPhase(times_s=first, revolutions=np.arange(first.size, dtype=np.float64))
    inside = times[times <= first[-1]]
    fraction = reference.revolutions_at(inside) - np.arange(inside.size) // stripes
    found = np.array([np.median(fraction[stripe::stripes]) for stripe in range(stripes)])
    found[0] = 0.0
    return found
