"""Angular resampling: a record over time becomes a record over shaft angle, band-limited in orders, and back.

Where the shaft turns slowly the record holds orders above what the angle grid can carry, and they are filtered out
before they fold (low speed aliases first). The filter is a sinc under a Kaiser window with 32 zero crossings on either
side (`_windowed_sinc`). Of half the coarser rate, it passes all up to 0.88 with an amplitude error below 2e-6; what is
above 1.12, and would fold onto that, it attenuates by more than 100 dB; in between it falls, to one half at half the
rate. Where the angle grid is the coarser, the filter is fixed in orders, however fast the speed changes (`_warp`).

Two cheaper choices filter nothing. For a tone of w rad a sample, w small, the RMS of their error over that of the tone:

    "linear"    w^2 / sqrt(120) = 0.091 w^2         9e-3 at 20 samples a cycle, 9e-5 at 200
    "cubic"     0.0168 w^4                          1.6e-4 at 20 samples a cycle, 1.6e-8 at 200
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from signals._checks import Array, choice, positive, whole
from signals._gaps import Missing, samples
from signals._track import NODE_STEP, Track
from signals._turning import refuse_rest, turning
from signals._warp import FEWEST, METHODS, Flags, Map, Method, Warp

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from signals.phase import ShaftPhase

PASSBAND = 0.88  # of half the coarser rate

_ROUNDING = 1e-9  # revolutions: less is nothing


@dataclass(frozen=True, kw_only=True)
class AngularSignal:
    """A record on an even grid of shaft angle: `samples_per_rev` of them, whole revolutions from `start_rev`.

    ``unsettled`` counts the values at the start and at the end whose filter reaches beyond what is known of the record
    or of the shaft's motion.
    """

    values: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    samples_per_rev: int
    start_rev: float
    passband_orders: float
    unsettled: tuple[int, int] = (0, 0)

    @property
    def revolutions(self) -> int:
        """How many whole revolutions the signal spans."""
        return int(self.values.size // self.samples_per_rev)

    @property
    def angle_rad(self) -> Array:
        """Shaft angle of each sample, (n,), in rad."""
        return 2 * np.pi * (self.start_rev + np.arange(self.values.size) / self.samples_per_rev)


@dataclass(frozen=True, kw_only=True)
class TimeSignal:
    """A record on an even grid of time, from `start_s` on.

    ``unsettled`` counts the values at the start and at the end whose filter reaches beyond what is known of the record
    or of the shaft's motion.
    """

    values: Array = field(metadata={"dims": ("time",), "units": "as the record"})
    rate_hz: float
    start_s: float
    passband_hz: float
    unsettled: tuple[int, int] = (0, 0)

    @property
    def times_s(self) -> Array:
        """Time of each sample, (n,), in s."""
        return self.start_s + np.arange(self.values.size) / self.rate_hz


def angular_resample(
    x: ArrayLike,
    *,
    rate_hz: float,
    phase: ShaftPhase,
    samples_per_rev: int,
    start_s: float = 0.0,
    revolutions: int | None = None,
    method: Method = "sinc",
    missing: Missing = "refuse",
) -> AngularSignal:
    """Resample a record at even steps of shaft angle, all whole revolutions from the first one on.

    Of a shaft whose angle falls, revolutions are counted the way it turns: each angle is minus the phase's, and all
    come in order of time.

    Where the filter reaches beyond the record, only the part of it that lies on the record is used, and made to add
    up to one; how many values that concerns is in ``unsettled``. A constant stays what it is to the very ends.

    Parameters
    ----------
    x : (n,) array, any unit
        Samples over time.
    rate_hz : float
        Samples a second.
    phase : ShaftPhase
        Angle of the shaft over the same clock.
    samples_per_rev : int
        Output samples a revolution; orders up to ``passband_orders`` pass: 0.44 times this or, where that is
        less, 0.44 times the samples a revolution the record itself has at its highest speed.
    start_s : float
        Time of the first sample.
    revolutions : int, optional
        How many revolutions; default all that the record and the phase share.
    method : "sinc", "cubic" or "linear"
        The filter; a cubic through four samples; a straight line. The last two let orders fold and images through.
    missing : "refuse" or "mark"
        What to do about values that are not finite: raise, or make every output NaN whose filter reaches one.

    Returns
    -------
    AngularSignal

    Raises
    ------
    ValueError
        A record shorter than one revolution, values that are not finite, a shaft that rests within the record or
        that turns both ways.
    """
    choice(method, name="method", choices=METHODS)
    rate = positive(rate_hz, name="rate_hz")
    signal = samples(x, missing=missing, minimum=FEWEST[method], rate_hz=rate, start_s=start_s)
    per_rev = whole(samples_per_rev, name="samples_per_rev", least=2)
    stop_s = start_s + (signal.size - 1) / rate
    phase = forwards(phase)
    refuse_rest(phase.times_s, phase.revolutions, start_s=start_s, stop_s=stop_s, rate_hz=rate)
    first, count = whole_revolutions(phase, start_s=start_s, stop_s=stop_s)
    if revolutions is not None:
        count = whole(revolutions, name="revolutions", least=1, most=count)
    grid = angle_map(phase, rate_hz=rate, start_s=start_s, samples_per_rev=per_rev, first=first, revolutions=count)
    values, beyond = Warp(grid, method=method).whole(signal)
    return AngularSignal(
        values=values,
        samples_per_rev=per_rev,
        start_rev=first,
        passband_orders=passband_orders(grid, per_rev),
        unsettled=unsettled(beyond),
    )


def time_resample(
    signal: AngularSignal,
    *,
    phase: ShaftPhase,
    rate_hz: float,
    start_s: float | None = None,
    method: Method = "sinc",
    missing: Missing = "refuse",
) -> TimeSignal:
    """Resample a record over angle at even steps of time: the inverse of `angular_resample`.

    Where the shaft is so fast that the record holds frequencies above what the time grid can carry, they are filtered
    out before they fold. Ends are as in `angular_resample`.

    Parameters
    ----------
    signal : AngularSignal
    phase : ShaftPhase
        Angle of the shaft; must cover the signal's revolutions.
    rate_hz : float
        Output samples a second.
    start_s : float, optional
        Time of the first output, within the signal; default the time of its first sample.
    method, missing
        As in `angular_resample`.

    Returns
    -------
    TimeSignal
        Up to the last time within the signal. Frequencies up to ``passband_hz`` pass throughout: 0.44 times `rate_hz`
        or, where that is less, 0.44 times the samples a second that the signal has at its lowest speed.

    Raises
    ------
    ValueError
        Revolutions that the phase does not know, a start outside them, values that are not finite, a shaft that
        rests among them or turns both ways.
    """
    choice(method, name="method", choices=METHODS)
    rate, per_rev = positive(rate_hz, name="rate_hz"), signal.samples_per_rev
    phase = forwards(phase)
    x = samples(signal.values, missing=missing, minimum=FEWEST[method])
    ends = signal.start_rev, signal.start_rev + (x.size - 1) / per_rev
    begin, end = _departure(phase, ends[0]), _arrival(phase, ends[1])
    refuse_rest(phase.times_s, phase.revolutions, start_s=begin, stop_s=end)
    start = begin if start_s is None else float(start_s)
    if not begin - _ROUNDING <= start <= end:
        raise ValueError(f"start_s={start:g} s lies outside the signal, {begin:g} to {end:g} s; start within it.")
    speeds = _speeds(phase, begin, end, points=x.size // NODE_STEP)
    slowest = max(float(speeds.min()), 1e-9 * float(speeds.max()))  # a shaft at rest gets through no step of angle

    def when(revolutions: Array) -> Array:
        times = phase.times_at(revolutions, at_rest="departure")
        within = revolutions <= ends[1] + _ROUNDING
        return np.where(within, np.minimum(times, end), times)  # the signal is over before a rest at its end

    def pace(revolutions: Array) -> Array:
        return 1 / np.maximum(phase.speed_hz(when(revolutions)), slowest)

    known = phase.revolutions[[0, -1]]
    grid = Map(
        outward=Track(
            value=when,
            slope=pace,
            start=float(known[0]),
            stop=float(known[1]),
            origin=signal.start_rev,
            spacing=1 / per_rev,
            offset=start,
            scale=rate,
        ),
        inward=Track(
            value=phase.revolutions_at,
            slope=phase.speed_hz,
            start=phase.start_s,
            stop=phase.stop_s,
            origin=start,
            spacing=1 / rate,
            offset=signal.start_rev,
            scale=per_rev,
        ),
        outputs=int(np.floor((end - start) * rate + _ROUNDING)) + 1,
        least_slope=rate / (per_rev * float(speeds.max())),
        largest_slope=rate * (end - begin) / x.size,
        known=((phase.start_s - start) * rate, (phase.stop_s - start) * rate),
        slack=_ROUNDING * rate,
    )
    values, beyond = Warp(grid, method=method).whole(x)
    return TimeSignal(
        values=values,
        rate_hz=rate,
        start_s=start,
        passband_hz=float(PASSBAND / 2 * min(rate, per_rev * speeds.min())),
        unsettled=unsettled(beyond),
    )


def forwards(phase: ShaftPhase) -> ShaftPhase:
    """Return the phase counted the way the shaft turns: minus itself where it falls.

    Raises
    ------
    ValueError
        A shaft that turns both ways.
    """
    return phase if turning(phase.times_s, phase.revolutions) > 0 else phase.scaled(-1)


def whole_revolutions(phase: ShaftPhase, *, start_s: float, stop_s: float) -> tuple[float, int]:
    """Return the first whole revolution (counted from the phase's first knot) in a span, and how many follow.

    Raises
    ------
    ValueError
        Where there is not one.
    """
    begin, end = max(start_s, phase.start_s), min(stop_s, phase.stop_s)
    turned = 0.0
    if end > begin:
        at_begin, at_end = phase.revolutions_at(np.array([begin, end]))
        base = float(phase.revolutions[0])
        first = base + np.ceil(at_begin - base - _ROUNDING)
        turned = at_end - first
    if turned < 1 - _ROUNDING:
        raise ValueError(
            f"the record from {start_s:g} to {stop_s:g} s holds no whole revolution of the shaft (its phase is known "
            f"from {phase.start_s:g} to {phase.stop_s:g} s); record longer, or check rate and tachometer."
        )
    return float(first), int(np.floor(turned + _ROUNDING))


def angle_map(
    phase: ShaftPhase, *, rate_hz: float, start_s: float, samples_per_rev: int, first: float, revolutions: int
) -> Map:
    """Lay the samples of a record on the grid of `revolutions` from `first` on."""
    begin, end = _departure(phase, first), _arrival(phase, first + revolutions)
    speeds = _speeds(phase, begin, end, points=int((end - begin) * rate_hz) // NODE_STEP)
    edges = phase.revolutions_at(np.array([phase.start_s, phase.stop_s]))
    return Map(
        outward=Track(
            value=phase.revolutions_at,
            slope=phase.speed_hz,
            start=phase.start_s,
            stop=phase.stop_s,
            origin=start_s,
            spacing=1 / rate_hz,
            offset=first,
            scale=samples_per_rev,
        ),
        outputs=revolutions * samples_per_rev,
        least_slope=samples_per_rev * float(speeds.min()) / rate_hz,
        largest_slope=samples_per_rev * float(speeds.max()) / rate_hz,
        known=(float(edges[0] - first) * samples_per_rev, float(edges[1] - first) * samples_per_rev),
        slack=_ROUNDING * samples_per_rev,
    )


def _departure(phase: ShaftPhase, revolution: float) -> float:
    return float(phase.times_at([revolution], at_rest="departure")[0])


def _arrival(phase: ShaftPhase, revolution: float) -> float:
    return float(phase.times_at([revolution], at_rest="arrival")[0])


def _speeds(phase: ShaftPhase, begin: float, end: float, *, points: int) -> Array:
    return phase.speed_hz(np.clip(np.linspace(begin, end, points + 2), phase.start_s, phase.stop_s))


def passband_orders(grid: Map, samples_per_rev: int) -> float:
    """Return the highest order that passes at every speed."""
    return PASSBAND / 2 * samples_per_rev * min(1.0, 1 / grid.largest_slope)


def unsettled(beyond: Flags) -> tuple[int, int]:
    """Count the flags set at the start and at the end."""
    if beyond.all():
        return beyond.size, beyond.size
    return int(np.argmin(beyond)), int(np.argmin(beyond[::-1]))
