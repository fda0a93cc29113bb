"""Tachometer waveform to pulse times, and pulse times to shaft phase."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from signals._checks import Array, positive, real_vector, whole
from signals.phase import ShaftPhase

_HYSTERESIS = 0.25  # of the swing, either side of the middle
_SWING_PERCENTILES = (1.0, 99.0)
_GAP = 1.7  # an interval this many times both its neighbours misses a pulse
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
    a quarter of the swing below it, and is to rise a quarter above, so noise on an edge makes one pulse.

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
    """Position in samples where the wave first rises through `level` between two samples."""
    segment = wave[low : high + 1]
    above = int(np.argmax(segment >= level))
    rise = segment[above] - segment[above - 1]
    return float(low + above - 1 + (level - segment[above - 1]) / rise)


def shaft_phase(times_s: ArrayLike, *, pulses_per_rev: int = 1) -> ShaftPhase:
    """Turn the pulse times of one tachometer into the shaft's phase; revolution zero is the first pulse.

    With several stripes a revolution their positions are found from the data (the median place of each
    between passes of the first), since no stripe sits exactly where it should; below eight revolutions they
    are taken as even.

    Parameters
    ----------
    times_s : (n,) array, s
        Strictly increasing.
    pulses_per_rev : int

    Raises
    ------
    ValueError
        Pulses that run backwards, or an interval that misses a pulse: with its place and size.
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
    _refuse_gaps(times, intervals)
    positions = _stripe_positions(times, stripes)
    count = np.arange(times.size)
    return ShaftPhase(
        times_s=times,
        revolutions=count // stripes + positions[count % stripes],
        stripe_positions_rev=positions,
    )


def _refuse_gaps(times: Array, intervals: Array) -> None:
    if intervals.size < 3:  # noqa: PLR2004
        return
    inner = intervals[1:-1]
    neighbours = np.maximum(intervals[:-2], intervals[2:])
    gaps = np.flatnonzero(inner > _GAP * neighbours)
    if gaps.size:
        i = int(gaps[0]) + 1
        raise ValueError(
            f"a tachometer pulse is missing: the interval after pulse {i} at {times[i]:g} s lasts "
            f"{intervals[i]:.3g} s, {intervals[i] / neighbours[i - 1]:.2f} times its neighbours "
            f"({gaps.size} such gaps). Repair the pulse list, or use the part of the record without the gap."
        )


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
