"""Shaft angle as a function of time: smooth, true to the pulses, and invertible where the shaft turns one way."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from signals._checks import Array, choice, number, positive, real_vector
from signals._phase_curve import build_curve
from signals.repairs import PulseRepairs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from scipy.interpolate import PPoly

    from signals.smoothing import PhaseSmoothing

_NEWTON_STEPS = 8
_HALVINGS = 60  # down to rounding


@dataclass(frozen=True, kw_only=True)
class ShaftPhase:
    """Angle of a shaft against time, through known revolutions at known times.

    A quintic spline through the knots (lower degree for fewer than six); with `smoothing`, the smoothed angle. Where
    the spline would turn back between two knots, as in a sudden stop, that interval alone becomes a monotone cubic
    (Fritsch and Carlson 1980), or brakes and picks up evenly, and the spline is laid anew on either side of it. The
    error of a quintic spline falls with the sixth power of the time between knots.

    Attributes
    ----------
    times_s, revolutions : (knot,) arrays
        Times rise. Revolutions may stay (the shaft stands), fall (it turns the other way) or do both.
    stripe_positions_rev : (stripe,) array
        Places of the tachometer's stripes in the revolution.
    nominal : bool
        Whether the speed was declared, not measured.
    jitter_s : float
        Standard deviation of one pulse's time; NaN where there are too few pulses to tell.
    repairs : PulseRepairs
        What was wrong with the pulses.
    stops_s : (stop, 2) array
        Intervals between two pulses in which the shaft stood, or may have.
    direction_declared : bool
        Whether a sign or a second channel tells which way the shaft turns. Without, `stops_s` leave it open.
    smoothing : PhaseSmoothing, optional
    """

    times_s: Array = field(metadata={"dims": ("knot",), "units": "s"})
    revolutions: Array = field(metadata={"dims": ("knot",), "units": "rev"})
    stripe_positions_rev: Array = field(
        default_factory=lambda: np.zeros(1), metadata={"dims": ("stripe",), "units": "rev"}
    )
    nominal: bool = False
    jitter_s: float = math.nan
    repairs: PulseRepairs = field(default_factory=PulseRepairs)
    stops_s: Array = field(default_factory=lambda: np.zeros((0, 2)), metadata={"dims": ("stop", "side"), "units": "s"})
    direction_declared: bool = False
    smoothing: PhaseSmoothing | None = None

    @property
    def start_s(self) -> float:
        """Time of the first knot."""
        return float(self.times_s[0])

    @property
    def stop_s(self) -> float:
        """Time of the last knot."""
        return float(self.times_s[-1])

    @property
    def direction_unknown(self) -> bool:
        """Whether the shaft may have come back from a stop the other way, and nothing tells."""
        return bool(self.stops_s.size) and not self.direction_declared

    @property
    def monotone_spans_s(self) -> Array:
        """Begin and end, (span, 2), of the intervals in which a monotone piece replaces the spline."""
        cells = np.flatnonzero(self._built[1])
        return np.stack([self.times_s[cells], self.times_s[cells + 1]], axis=1)

    @cached_property
    def _built(self) -> tuple[PPoly, NDArray[np.bool_]]:
        middles = (self.times_s[:-1] + self.times_s[1:]) / 2
        breaks = np.zeros(middles.size, dtype=np.bool_)
        for begin, end in self.stops_s:
            breaks |= (middles > begin) & (middles < end)
        smooth = self.smoothing
        states = None if smooth is None else (smooth.speed_hz, smooth.acceleration)
        return build_curve(self.times_s, self.revolutions, breaks=breaks, states=states)

    @cached_property
    def _curve(self) -> PPoly:
        return self._built[0]

    @cached_property
    def _slope(self) -> PPoly:
        return self._curve.derivative()

    def revolutions_at(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at `times_s` (m,), which must lie between first and last knot."""
        return np.asarray(self._curve(self._known(times_s)), dtype=np.float64)

    def _known(self, times_s: ArrayLike) -> Array:
        times = real_vector(times_s, name="times_s")
        slack = 1e-9 * max(1.0, abs(self.stop_s))
        if times.min() < self.start_s - slack or times.max() > self.stop_s + slack:
            raise ValueError(
                f"times from {times.min():g} to {times.max():g} s leave the known part of the shaft's motion, "
                f"{self.start_s:g} to {self.stop_s:g} s; ask for less."
            )
        return times

    def angle_rad(self, times_s: ArrayLike) -> Array:
        """Return the angle in rad at `times_s` (m,); zero at revolution zero."""
        return 2 * np.pi * self.revolutions_at(times_s)

    def speed_hz(self, times_s: ArrayLike) -> Array:
        """Return the speed in revolutions per second at `times_s` (m,), between first and last knot."""
        return np.asarray(self._slope(self._known(times_s)), dtype=np.float64)

    def std_rad(self, times_s: ArrayLike) -> Array:
        """Return the standard deviation of the angle in rad at `times_s` (m,).

        With smoothing: that of the smoother, which counts both jitter and what the shaft may do between pulses.
        Without: the jitter of one pulse times the speed, which holds at the pulses and is about right between them.
        What a spline misses between pulses is not in it, nor where in a standstill the shaft stands.

        Raises
        ------
        ValueError
            A phase whose jitter is not known: nominal, or of too few pulses.
        """
        times = self._known(times_s)
        if self.smoothing is not None:
            return 2 * np.pi * self.smoothing.std_rev(times, knots_s=self.times_s)
        if not math.isfinite(self.jitter_s):
            why = "its speed is declared, not measured" if self.nominal else f"{self.times_s.size} knots tell none"
            raise ValueError(f"the jitter of this phase is unknown: {why}. Use more pulses, or state jitter_s.")
        return 2 * np.pi * self.jitter_s * np.abs(self.speed_hz(times))

    def times_at(
        self, revolutions: ArrayLike, *, at_rest: Literal["refuse", "arrival", "departure"] = "refuse"
    ) -> Array:
        """Return the times in s at which the shaft reaches `revolutions` (m,).

        Newton's method between the knots on either side; where it does not settle, as where the shaft almost
        stands, that interval is halved.

        Parameters
        ----------
        revolutions : (m,) array
        at_rest : {"refuse", "arrival", "departure"}
            What to return for an angle at which the shaft stands: no single time is right. "refuse" also raises
            where it stands anywhere between the least and the greatest angle asked for.

        Raises
        ------
        ValueError
            Revolutions outside the known part, a shaft that stands among them, or one that turns back.
        """
        choice(at_rest, name="at_rest", choices=("refuse", "arrival", "departure"))
        wanted = self._sign * real_vector(revolutions, name="revolutions")
        knots = self._sign * self.revolutions
        if wanted.min() < knots[0] - 1e-9 or wanted.max() > knots[-1] + 1e-9:
            low, high = sorted((float(self.revolutions[0]), float(self.revolutions[-1])))
            given = np.sort(self._sign * wanted)
            raise ValueError(f"revolutions {given[0]:g} to {given[-1]:g} are outside the known {low:g} to {high:g}.")
        arrival = np.searchsorted(knots, wanted, side="left")
        departure = np.searchsorted(knots, wanted, side="right") - 1
        resting = departure > arrival
        if at_rest == "refuse":
            self._refuse_rest(float(wanted.min()), float(wanted.max()))
        times = self._inverse(wanted, np.clip(departure, 0, self.times_s.size - 2))
        rest = arrival if at_rest == "arrival" else departure
        times[resting] = self.times_s[rest[resting]]
        return times

    def _refuse_rest(self, low: float, high: float) -> None:
        """Raise where the shaft stands at an angle from `low` to `high`, counted the way it turns."""
        rest = np.flatnonzero(np.diff(self.revolutions) == 0)
        places = self._sign * self.revolutions[rest]
        hit = rest[(places >= low) & (places <= high)]
        if hit.size:
            i = int(hit[0])
            raise ValueError(
                f"the shaft stands still from {self.times_s[i]:g} s on ({hit.size} such places), so the angle "
                f"{self.revolutions[i]:g} rev has no single time; ask for parts of the record, or name the arrival or "
                "the departure with at_rest."
            )

    @cached_property
    def _sign(self) -> float:
        """Which way the shaft turns, or raise."""
        steps = np.diff(self.revolutions)
        if np.any(steps > 0) and np.any(steps < 0):
            back = int(np.flatnonzero(np.sign(steps) == -np.sign(steps[steps != 0][0]))[0])
            raise ValueError(
                f"the shaft turns back at {self.times_s[back]:g} s, so an angle has several times; use the part of the "
                "record before or after."
            )
        return -1.0 if np.any(steps < 0) else 1.0

    def _inverse(self, wanted: Array, cell: NDArray[np.int64]) -> Array:
        """Return when the angle, counted the way the shaft turns, is `wanted` within the cells given."""
        low, high = self.times_s[cell], self.times_s[cell + 1]
        times = np.clip(np.interp(wanted, self._sign * self.revolutions, self.times_s), low, high)
        step = high - low
        for _ in range(_NEWTON_STEPS):
            with np.errstate(all="ignore"):  # no slope, no step: those points are halved below
                step = (self._curve(times) - self._sign * wanted) / self._slope(times)
            times = np.clip(times - step, low, high)
            settled = np.abs(step) < 1e-13 * max(1.0, abs(self.stop_s))
            if settled.all():
                return times
        stray = np.flatnonzero(~settled)
        times[stray] = self._halved(wanted[stray], low[stray], high[stray])
        return times

    def _halved(self, wanted: Array, low: Array, high: Array) -> Array:
        """Find each wanted revolution between two knots by halving, for places where the shaft almost stands."""
        for _ in range(_HALVINGS):
            middle = low + (high - low) / 2
            late = self._sign * self._curve(middle) > wanted
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        return np.asarray(high, dtype=np.float64)

    def mean_speed_per_revolution_hz(self) -> Array:
        """Return the mean speed over each whole revolution after the first knot, (whole revolutions,)."""
        first, last = float(self.revolutions[0]), float(self.revolutions[-1])
        turned = abs(last - first)
        marks = np.minimum(np.arange(np.floor(turned + 1e-9) + 1), turned)
        return self._sign / np.diff(self.times_at(first + self._sign * marks, at_rest="departure"))

    def scaled(self, ratio: float) -> ShaftPhase:
        """Return the phase of a shaft that turns `ratio` times as fast, the other way where that is below zero.

        Its standard deviation in angle is `ratio` times this one's; the jitter in time stays.
        """
        factor = number(ratio, name="ratio")
        if factor == 0:
            raise ValueError("ratio=0 is the ratio of a shaft that does not turn; it has no phase to follow.")
        return replace(
            self,
            revolutions=self.revolutions * factor,
            stripe_positions_rev=np.zeros(1),
            smoothing=None if self.smoothing is None else self.smoothing.scaled(factor),
        )


def constant_speed(speed_hz: float, *, start_s: float, stop_s: float) -> ShaftPhase:
    """Return the phase of a shaft declared to turn at a constant speed, marked nominal.

    Parameters
    ----------
    speed_hz : float
        Revolutions per second.
    start_s, stop_s : float
        The span, in s; revolution zero is at `start_s`.
    """
    speed = positive(speed_hz, name="speed_hz")
    if not stop_s > start_s:
        raise ValueError(f"stop_s = {stop_s:g} is not after start_s = {start_s:g}.")
    return ShaftPhase(
        times_s=np.array([start_s, stop_s], dtype=np.float64),
        revolutions=np.array([0.0, speed * (stop_s - start_s)]),
        nominal=True,
    )
