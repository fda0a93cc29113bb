"""Phase of a shaft from the pulse times of its tachometer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from signals._validation import Array, brief, checked, number, positive, real_vector, whole
from signals.shaft.phase import ShaftPhase
from signals.shaft.pulse_repair import (
    Counts,
    number_pulses,
    possible_stops,
    repairs_of,
    stripe_positions,
)
from signals.shaft.pulses import PulseTrain, pulse_times

if TYPE_CHECKING:
    from fractions import Fraction

    from numpy.typing import ArrayLike, NDArray

__all__ = ["PulseTrain", "pulse_times", "shaft_phase"]


@dataclass(frozen=True, kw_only=True)
class _Segment:
    """Pulses between two stops: indices, times and numbers of those retained."""

    kept: Counts
    times: Array
    counts: Counts


@checked
def shaft_phase(
    times_s: ArrayLike,
    *,
    pulses_per_rev: float | Fraction = 1,
    direction: int | ArrayLike | None = None,
    delay_s: float = 0.0,
) -> ShaftPhase:
    """Return the phase of a shaft from the pulse times of its tachometer; the angle is zero at the first pulse.

    Parameters
    ----------
    times_s : (n,) array
        Times of the pulses in s, strictly increasing; `pulse_times` finds them in a waveform.
    pulses_per_rev : int, Fraction or float
        Pulses per revolution: an int for the stripes of this shaft, a Fraction or float for pulses of another shaft
        geared to it.
    direction : +1, -1 or (n,) array of them, optional
        Direction of rotation, for all pulses or for each, as from `quadrature_direction`. With an array the pulses are
        counted up and down without repair, and angles may decrease.
    delay_s : float
        Delay in s of the tachometer channel relative to the vibration channel; it is subtracted from the times.

    Returns
    -------
    ShaftPhase

    Raises
    ------
    ValueError
        Times that do not increase or look like a waveform; too many missing or extra pulses to repair.

    Notes
    -----
    Stripes: the positions of several stripes are estimated from the data (the median angle of each between passes of
    the first); below eight revolutions they are taken as evenly spaced. A speed fluctuation that repeats every
    revolution cannot be distinguished from uneven stripes, and is attributed to them.

    Faults: pulses are numbered by multiple-hypothesis tracking. Each hypothesis is a Kalman filter of angle, speed and
    acceleration, for which a pulse is the next one, follows missing ones, or is extra; the likeliest hypothesis is
    taken, forwards and backwards from the steadiest part. Extra pulses are left out, missing ones are counted, and
    `ShaftPhase.repairs` lists both; no pulse is inserted. A spurious pulse next to a missing one may be mistaken for
    it. Where no interval differs by a factor of 1.65 (``exp(0.5)``) or more from that of the same stripe one revolution
    earlier, no pulse is questioned.

    Stops: where the shaft decelerates into an interval and accelerates after it, so that parabolas through the pulses
    before and after come to rest within it, it may have stopped and reversed, however short the interval. The interval
    is listed in `stops_s`, and `direction_unknown` is true unless the direction is declared.

    Examples
    --------
    One pulse every 40 ms is a speed of 25 Hz; the missing pulse at 0.4 s is bridged:

    >>> import numpy as np
    >>> from signals import shaft_phase
    >>> phase = shaft_phase(0.04 * np.delete(np.arange(51), 10))
    >>> float(phase.speed_hz([0.4])[0].round(6)), phase.repairs.missing
    (25.0, 1)
    """
    times = _pulse_list(times_s) - number(delay_s, name="delay_s")
    if not np.all(np.diff(times) > 0):
        raise ValueError(
            f"delay_s={delay_s:g} is so large that pulse times become equal when it is subtracted; give it in seconds."
        )
    per_rev = _per_rev(pulses_per_rev)
    signs = _signs(direction, times.size)
    if signs is not None and signs.size > 1:
        return _counted_phase(times, signs, per_rev)
    stripes = per_rev if isinstance(per_rev, int) else 1
    stops = possible_stops(times, stripes=stripes)
    segments = _segments(times, stops, stripes)
    true = np.concatenate([segment.kept for segment in segments])
    kept, counts = times[true], np.concatenate([segment.counts for segment in segments])
    calibration_revolutions = 8
    few = kept.size < calibration_revolutions * stripes
    positions = np.arange(stripes) / stripes if few else stripe_positions(kept, counts, stripes)
    whole_stripes = counts // stripes + positions[counts % stripes]
    phase = ShaftPhase(
        times_s=kept,
        revolutions=whole_stripes if isinstance(per_rev, int) else counts / float(per_rev),
        stripe_positions_rev=positions,
        jitter_s=_jitter(segments, stripes),
        repairs=repairs_of(times, true, counts),
        stops_s=np.stack([times[stops], times[stops + 1]], axis=1),
        direction_declared=signs is not None,
    )
    return phase.scaled(-1) if signs is not None and signs[0] < 0 else phase


def _pulse_list(times_s: ArrayLike) -> Array:
    """Return pulse times as an array, or raise where they do not increase or look like a waveform."""
    times = real_vector(times_s, name="pulse times", minimum=2)
    back = np.flatnonzero(np.diff(times) <= 0)
    waveform_size, waveform_falls = 16, 0.1  # values, and the fraction that does not rise, of a waveform
    if times.size >= waveform_size and back.size > waveform_falls * times.size:
        raise ValueError(
            f"these {times.size} values are not pulse times: {back.size} of them do not exceed the one before. They "
            "look like a waveform; find its pulses with pulse_times(waveform, rate_hz=...) first (on the command line: "
            "--tach-waveform)."
        )
    if back.size:
        i = int(back[0])
        raise ValueError(
            f"pulse times do not increase: pulse {i + 1} at {times[i + 1]:g} s is not after pulse {i} at "
            f"{times[i]:g} s ({back.size} such places). Sort the times or correct the tachometer's clock; find the "
            "pulses of a waveform with pulse_times."
        )
    return times


def _per_rev(pulses_per_rev: float | Fraction) -> int | Fraction | float:
    """Return pulses per revolution: an int for stripes of this shaft, else as given."""
    positive(pulses_per_rev, name="pulses_per_rev")
    if isinstance(pulses_per_rev, int | np.integer):
        return whole(pulses_per_rev, name="pulses_per_rev", least=1)
    return pulses_per_rev


def _signs(direction: int | ArrayLike | None, pulses: int) -> NDArray[np.int64] | None:
    """Return the direction of rotation, (1,) or (pulses,), each +1 or -1; None where it is not declared."""
    if direction is None:
        return None
    signs = np.atleast_1d(np.asarray(direction))
    fits = signs.ndim == 1 and signs.size in (1, pulses) and signs.dtype.kind in "if"
    if not fits or not np.all(np.abs(signs) == 1):
        raise ValueError(
            f"direction={brief(direction)} must be +1, -1, or one of these for each of the {pulses} pulses "
            "(see quadrature_direction)."
        )
    return signs.astype(np.int64)


def _segments(times: Array, stops: Counts, stripes: int) -> list[_Segment]:
    """Return the numbered pulses between stops, repaired; across a stop the number rises by one."""
    segments, number_of_next = [], 0
    bounds = [0, *(stops + 1).tolist(), times.size]
    for begin, end in pairwise(bounds):
        part = times[begin:end]
        kept, counts = number_pulses(part, stripes=stripes)
        segments.append(_Segment(kept=begin + kept, times=part[kept], counts=counts + number_of_next))
        number_of_next += int(counts[-1]) + 1
    return segments


def _jitter(segments: list[_Segment], stripes: int) -> float:
    """Return the standard deviation of pulse times about a smooth motion, from sixth differences of each stripe.

    Independent errors of variance s^2 give sixth differences of variance 924 s^2, a quintic motion none: the variate
    difference method (Anderson 1971, "The statistical analysis of time series", section 3.4). Differences across a
    missing pulse are left out.
    """
    found = []
    jitter_order = 6  # of the differences, which remove any motion that is a quintic over seven pulses
    for segment in segments:
        full = np.full(int(segment.counts[-1] - segment.counts[0]) + 1, np.nan)
        full[segment.counts - segment.counts[0]] = segment.times
        for _ in range(jitter_order):
            full = full[stripes:] - full[:-stripes]
        found.append(full[np.isfinite(full)])
    differences = np.concatenate(found)
    jitter_fewest = 6  # differences
    if differences.size < jitter_fewest:
        return math.nan
    return float(np.sqrt(np.mean(differences**2) / math.comb(2 * jitter_order, jitter_order)))


def _counted_phase(times: Array, signs: NDArray[np.int64], per_rev: float | Fraction) -> ShaftPhase:
    """Return the phase from an up-down count of pulses; after a reversal the same stripe passes again."""
    after = np.cumsum(signs)
    count = np.maximum(after, after - signs)
    return ShaftPhase(
        times_s=times,
        revolutions=(count - count[0]) / float(per_rev),
        direction_declared=True,
    )
