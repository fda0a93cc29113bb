"""Shaft angle as a function of time: smooth, monotone, and invertible where the shaft turns."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator, PPoly, make_interp_spline

from signals._checks import Array, positive, real_vector

_NEWTON_STEPS = 8
_HALVINGS = 60  # down to rounding


@dataclass(frozen=True, kw_only=True)
class ShaftPhase:
    """Angle of a shaft against time, through known revolutions at known times.

    A quintic spline through the knots (lower degree for fewer than six). Where it would turn back between
    two knots, as after a sudden stop, the monotone cubic of Fritsch and Carlson (1980) takes its place.
    The error of a quintic spline falls with the sixth power of the time between knots.
    """

    times_s: Array = field(metadata={"dims": ("knot",), "units": "s"})
    revolutions: Array = field(metadata={"dims": ("knot",), "units": "rev"})
    stripe_positions_rev: Array = field(
        default_factory=lambda: np.zeros(1), metadata={"dims": ("stripe",), "units": "rev"}
    )
    nominal: bool = False

    @property
    def start_s(self) -> float:
        """Time of the first knot."""
        return float(self.times_s[0])

    @property
    def stop_s(self) -> float:
        """Time of the last knot."""
        return float(self.times_s[-1])

    @cached_property
    def monotone_cubic(self) -> bool:
        """Whether the monotone cubic had to replace the smoother spline."""
        slope = self._smooth.derivative()
        stationary = slope.derivative().roots(discontinuity=False, extrapolate=False)
        places = np.concatenate([self.times_s, stationary[np.isfinite(stationary)]])
        return bool(np.any(slope(places) <= 0))

    @cached_property
    def _smooth(self) -> PPoly:
        degree = 5 if self.times_s.size > 5 else (3 if self.times_s.size > 3 else 1)  # noqa: PLR2004
        spline = make_interp_spline(self.times_s, self.revolutions, k=degree)
        return PPoly.from_spline((spline.t, spline.c, spline.k))

    @cached_property
    def _curve(self) -> PPoly:
        return PchipInterpolator(self.times_s, self.revolutions) if self.monotone_cubic else self._smooth

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

    def times_at(self, revolutions: ArrayLike) -> Array:
        """Return the times in s at which the shaft reaches `revolutions` (m,).

        Newton's method between the knots on either side; where it does not settle, as where the shaft almost
        stands, that interval is halved.

        Raises
        ------
        ValueError
            Revolutions outside the known part, or a shaft that stands still somewhere.
        """
        wanted = real_vector(revolutions, name="revolutions")
        first, last = float(self.revolutions[0]), float(self.revolutions[-1])
        if wanted.min() < first - 1e-9 or wanted.max() > last + 1e-9:
            raise ValueError(
                f"revolutions {wanted.min():g} to {wanted.max():g} are outside the known {first:g} to {last:g}."
            )
        if np.any(np.diff(self.revolutions) <= 0):
            raise ValueError("the shaft stands still for part of the record, so angle cannot be turned into time.")
        cell = np.clip(np.searchsorted(self.revolutions, wanted, side="right") - 1, 0, self.times_s.size - 2)
        low, high = self.times_s[cell], self.times_s[cell + 1]
        times = np.interp(wanted, self.revolutions, self.times_s)
        step = high - low
        for _ in range(_NEWTON_STEPS):
            with np.errstate(all="ignore"):  # no slope, no step: those points are halved below
                step = (self._curve(times) - wanted) / self._slope(times)
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
            late = self._curve(middle) > wanted
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        return np.asarray(high, dtype=np.float64)

    def mean_speed_per_revolution_hz(self) -> Array:
        """Return the mean speed over each whole revolution after the first knot, (whole revolutions,)."""
        first = float(self.revolutions[0])
        marks = first + np.arange(np.floor(float(self.revolutions[-1]) - first + 1e-9) + 1)
        return 1.0 / np.diff(self.times_at(np.minimum(marks, self.revolutions[-1])))

    def scaled(self, ratio: float) -> "ShaftPhase":
        """Return the phase of a shaft that turns `ratio` times as fast."""
        positive(ratio, name="ratio")
        return ShaftPhase(times_s=self.times_s, revolutions=self.revolutions * float(ratio), nominal=self.nominal)


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
