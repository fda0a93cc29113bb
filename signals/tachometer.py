"""Pulse times of a tachometer to the phase of its shaft, with a count of every repair."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from signals._checks import Array, choice, number, positive, real_vector, whole
from signals.phase import ShaftPhase
from signals.pulses import PulseTrain, pulse_times
from signals.repairs import Counts, PulseRepairs, all_repairs, number_pulses, possible_stops, refuse_faults, repairs_of
from signals.smoothing import PhaseSmoothing, joined, smooth_phase, with_rest

if TYPE_CHECKING:
    from fractions import Fraction

    from numpy.typing import ArrayLike, NDArray

__all__ = ["PulseTrain", "pulse_times", "shaft_phase"]

_CALIBRATION_REVOLUTIONS = 8
_WAVEFORM = 16  # values that a waveform has at least, and
_WAVEFORM_STEPS = 0.1  # how many of its steps do not rise
_JITTER_ORDER = 6  # differences of this order leave nothing of a motion that pulses show well
_JITTER_FEWEST = 6  # of such differences


@dataclass(frozen=True, kw_only=True)
class _Stretch:
    """Pulses between two stops: those kept, and their numbers."""

    times: Array
    counts: Counts
    repairs: PulseRepairs


def shaft_phase(
    times_s: ArrayLike,
    *,
    pulses_per_rev: float | Fraction = 1,
    on_fault: Literal["repair", "refuse"] = "repair",
    direction: int | ArrayLike | None = None,
    delay_s: float = 0.0,
    bandwidth_hz: float | None = None,
    bandwidth_orders: float | None = None,
    standstill_s: float | None = None,
) -> ShaftPhase:
    """Turn the pulse times of one tachometer into the shaft's phase; revolution zero is the first pulse.

    Stripes. With several a revolution (a whole number) their positions are found from the data (the median place
    of each between passes of the first), since no stripe sits exactly where it should; below eight revolutions they
    are taken as even. A swing of the speed that repeats every revolution cannot be told from uneven stripes, and is
    taken for them. Pulses of another shaft through gears (a `Fraction` or float) are even.

    Faults. Each interval is held against those of the same stripe in the five revolutions before and the five after
    (below five revolutions, against its neighbours). What shows a missing or extra pulse is refused, or repaired:
    extra pulses left out, missing ones counted, and all of it told in `ShaftPhase.repairs`. No pulse is made up:
    the curve passes on between the true ones. In the first and last revolution the one side is carried on at its
    acceleration; among very unequal stripes a wrong pulse may pass there.

    Stops. Where pulses slow down into an interval and gather speed after it the shaft may have stopped, and may have
    turned back: that interval stands in `stops_s` and the phase says `direction_unknown` unless the direction is
    declared. `standstill_s` declares that in any longer interval the shaft stood, half-way between two stripes.

    Smoothing. Without a bandwidth the curve passes through every pulse. With one, jitter is smoothed out; the gain
    is 0.707 at the bandwidth (see `PhaseSmoothing`).

    Parameters
    ----------
    times_s : (n,) array, s
        Strictly increasing.
    pulses_per_rev : int, Fraction or float
    on_fault : {"repair", "refuse"}
    direction : +1, -1 or (n,) array of them, optional
        The way the shaft turns, or turned at each pulse, as `quadrature_direction` tells. With an array every pulse is
        counted as it is, nothing is repaired, and angles may fall.
    delay_s : float
        How much later the tachometer's chain shows an event than the accelerometer's; taken off the times.
    bandwidth_hz, bandwidth_orders : float, optional
        Fastest swing of the angle that smoothing is to leave, in Hz or in cycles a revolution. At most one of them.
    standstill_s : float, optional

    Raises
    ------
    ValueError
        Pulses that run backwards or are a waveform; missing or extra ones that are to be refused, or too many to
        repair: with place, size and number.
    """
    choice(on_fault, name="on_fault", choices=("repair", "refuse"))
    times = _pulse_list(times_s) - number(delay_s, name="delay_s")
    per_rev = _per_rev(pulses_per_rev)
    smoothing = _Bandwidth.of(bandwidth_hz, bandwidth_orders)
    ways = _ways(direction, times.size)
    if ways is not None and ways.size > 1:
        return _counted(times, ways, per_rev, smoothing)
    stripes = per_rev if isinstance(per_rev, int) else 1
    stops, declared = _stops(times, stripes, standstill_s)
    stretches = _stretches(times, stops, stripes, repair=on_fault == "repair")
    kept = np.concatenate([stretch.times for stretch in stretches])
    counts = np.concatenate([stretch.counts for stretch in stretches])
    positions = _stripe_positions(kept, counts, stripes)
    whole_stripes = counts // stripes + positions[counts % stripes]
    phase = ShaftPhase(
        times_s=kept,
        revolutions=whole_stripes if isinstance(per_rev, int) else counts / float(per_rev),
        stripe_positions_rev=positions,
        jitter_s=_jitter(stretches, stripes),
        repairs=all_repairs([stretch.repairs for stretch in stretches]),
        stops_s=np.stack([times[stops], times[stops + 1]], axis=1),
        direction_declared=ways is not None,
    )
    if smoothing is not None:
        phase = _smoothed(phase, stretches, smoothing)
    for begin, end in phase.stops_s[declared]:
        phase = _at_rest(phase, begin, end)
    return phase.scaled(-1) if ways is not None and ways[0] < 0 else phase


def _pulse_list(times_s: ArrayLike) -> Array:
    times = real_vector(times_s, name="pulse times", minimum=2)
    back = np.flatnonzero(np.diff(times) <= 0)
    if times.size >= _WAVEFORM and back.size > _WAVEFORM_STEPS * times.size:
        raise ValueError(
            f"these {times.size} values are no pulse times: {back.size} of them do not rise above the one before. They "
            "look like a waveform; find its pulses with pulse_times(waveform, rate_hz=...) first (on the command line: "
            "--tach-waveform)."
        )
    if back.size:
        i = int(back[0])
        raise ValueError(
            f"pulse times run backwards: pulse {i + 1} at {times[i + 1]:g} s is not after pulse {i} at {times[i]:g} s "
            f"({back.size} such places). Sort out the tachometer, or hand a waveform over as a waveform."
        )
    return times


def _per_rev(pulses_per_rev: float | Fraction) -> int | Fraction | float:
    """Return the stripes of this shaft as an int, the pulses of another one as a fraction."""
    positive(pulses_per_rev, name="pulses_per_rev")
    if isinstance(pulses_per_rev, int | np.integer):
        return whole(pulses_per_rev, name="pulses_per_rev", least=1)
    return pulses_per_rev


def _ways(direction: int | ArrayLike | None, pulses: int) -> NDArray[np.int64] | None:
    if direction is None:
        return None
    ways = np.atleast_1d(np.asarray(direction))
    fits = ways.ndim == 1 and ways.size in (1, pulses) and ways.dtype.kind in "if"
    if not fits or not np.all(np.abs(ways) == 1):
        raise ValueError(
            f"direction={direction!r} must be +1, -1, or one of them for each of the {pulses} pulses "
            "(see quadrature_direction)."
        )
    return ways.astype(np.int64)


def _stops(times: Array, stripes: int, standstill_s: float | None) -> tuple[Counts, NDArray[np.bool_]]:
    """Return the intervals in which the shaft stood or may have, and whether that was declared."""
    found = possible_stops(times, stripes=stripes)
    if standstill_s is None:
        return found, np.zeros(found.size, dtype=np.bool_)
    longest = positive(standstill_s, name="standstill_s")
    stood = np.flatnonzero(np.diff(times) > longest)
    stops = np.union1d(found, stood)
    return stops, np.isin(stops, stood)


def _stretches(times: Array, stops: Counts, stripes: int, *, repair: bool) -> list[_Stretch]:
    """Return the pulses between stops with their numbers; across a stop the count goes on by one."""
    stretches, number_of_next = [], 0
    bounds = [0, *(stops + 1).tolist(), times.size]
    for begin, end in pairwise(bounds):
        part = times[begin:end]
        if repair:
            kept, counts = number_pulses(part, stripes=stripes)
        else:
            refuse_faults(part, stripes=stripes, offset=begin)
            kept = counts = np.arange(part.size)
        stretches.append(
            _Stretch(
                times=part[kept],
                counts=counts + number_of_next,
                repairs=repairs_of(part, kept, counts, offset=begin),
            )
        )
        number_of_next += int(counts[-1]) + 1
    return stretches


def _stripe_positions(times: Array, counts: Counts, stripes: int) -> Array:
    """Place of each stripe in its revolution, (stripes,), the first at zero."""
    even = np.arange(stripes) / stripes
    if stripes == 1 or times.size < _CALIBRATION_REVOLUTIONS * stripes:
        return even
    first = counts % stripes == 0
    reference = ShaftPhase(times_s=times[first], revolutions=(counts[first] // stripes).astype(np.float64))
    inside = (times >= reference.start_s) & (times <= reference.stop_s)
    fraction = reference.revolutions_at(times[inside]) - counts[inside] // stripes
    stripe = counts[inside] % stripes
    found = np.array([np.median(fraction[stripe == s]) if np.any(stripe == s) else even[s] for s in range(stripes)])
    found[0] = 0.0
    return found


def _jitter(stretches: list[_Stretch], stripes: int) -> float:
    """Return the standard deviation of pulse times about a smooth motion, from sixth differences of each stripe.

    Independent errors of variance s^2 give sixth differences of variance 924 s^2; a quintic in time gives none.
    Windows with a missing pulse are left out. Noted as the variate difference method (Anderson 1971, section 3.4).
    """
    found = []
    for stretch in stretches:
        full = np.full(int(stretch.counts[-1] - stretch.counts[0]) + 1, np.nan)
        full[stretch.counts - stretch.counts[0]] = stretch.times
        for _ in range(_JITTER_ORDER):
            full = full[stripes:] - full[:-stripes]
        found.append(full[np.isfinite(full)])
    differences = np.concatenate(found)
    if differences.size < _JITTER_FEWEST:
        return math.nan
    return float(np.sqrt(np.mean(differences**2) / math.comb(2 * _JITTER_ORDER, _JITTER_ORDER)))


@dataclass(frozen=True, kw_only=True)
class _Bandwidth:
    """What smoothing is to leave: so many Hz, or so many cycles a revolution."""

    value: float
    in_orders: bool

    @classmethod
    def of(cls, hertz: float | None, orders: float | None) -> _Bandwidth | None:
        """Check the two ways to state it."""
        if hertz is not None and orders is not None:
            raise ValueError(f"bandwidth_hz={hertz} and bandwidth_orders={orders} are both given; state one of them.")
        if hertz is None and orders is None:
            return None
        in_orders = hertz is None
        name = "bandwidth_orders" if in_orders else "bandwidth_hz"
        return cls(value=positive(orders if in_orders else hertz, name=name), in_orders=in_orders)

    def at(self, times: Array, revolutions: Array) -> Array:
        """Bandwidth in Hz at each knot."""
        speed = np.abs(np.gradient(revolutions, times)) if self.in_orders else np.ones(times.size)
        return self.value * speed


def _smoothed(phase: ShaftPhase, stretches: list[_Stretch], bandwidth: _Bandwidth) -> ShaftPhase:
    """Smooth every stretch by itself."""
    angles: list[Array] = []
    parts: list[PhaseSmoothing] = []
    squares = weight = 0.0
    begin = 0
    for stretch in stretches:
        part = slice(begin, begin + stretch.times.size)
        revolutions = phase.revolutions[part]
        angle, smoothing, jitter = smooth_phase(
            stretch.times,
            revolutions,
            counts=stretch.counts,
            bandwidth_hz=bandwidth.at(stretch.times, revolutions),
            jitter_s=phase.jitter_s,
        )
        angles.append(angle)
        parts.append(smoothing)
        squares, weight = squares + jitter**2 * angle.size, weight + angle.size
        begin = part.stop
    return replace(
        phase, revolutions=np.concatenate(angles), smoothing=joined(parts), jitter_s=math.sqrt(squares / weight)
    )


def _at_rest(phase: ShaftPhase, begin: float, end: float) -> ShaftPhase:
    """Let the shaft stand, from braking evenly after the pulse at `begin` to gathering speed before that at `end`.

    It stands half-way between the two stripes; it may stand anywhere, so that the angle is sure to half a stripe.
    """
    times, turns = phase.times_s, phase.revolutions
    here = int(np.searchsorted(times, begin))
    half = (turns[here + 1] - turns[here]) / 2
    span = end - begin
    before = span / 3 if here == 0 else 2 * half / abs(turns[here] - turns[here - 1]) * (begin - times[here - 1])
    last = here + 2 >= times.size
    after = span / 3 if last else 2 * half / abs(turns[here + 2] - turns[here + 1]) * (times[here + 2] - end)
    marks = [begin + min(before, span / 3), end - min(after, span / 3)]
    return replace(
        phase,
        times_s=np.insert(times, here + 1, marks),
        revolutions=np.insert(turns, here + 1, [turns[here] + half] * 2),
        smoothing=None if phase.smoothing is None else with_rest(phase.smoothing, here, float(half)),
    )


def _counted(
    times: Array, ways: NDArray[np.int64], per_rev: float | Fraction, smoothing: _Bandwidth | None
) -> ShaftPhase:
    """Count pulses up and down: one that comes back after a reversal is the same place as the one before it."""
    if smoothing is not None:
        raise ValueError(
            "smoothing needs a shaft that keeps its direction; leave out the bandwidth, or take the parts apart."
        )
    after = np.cumsum(ways)
    place = np.maximum(after, after - ways)
    return ShaftPhase(
        times_s=times,
        revolutions=(place - place[0]) / float(per_rev),
        direction_declared=True,
    )
