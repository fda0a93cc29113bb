"""A run-up under torque: the equation of motion of the rigid drive train, integrated to rounding.

The right-hand side is a polynomial in time and speed, so that the Taylor coefficients of the speed follow by recursion
(Jorba and Zou 2005, Exp. Math. 14, 99-117), and the series of each step is the solution, without interpolation.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from data_synth.operation.piecewise import PiecewiseLinear
from data_synth.operation.shaft_angle import Array
from data_synth.scene.operation import RunUp

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

_DEGREE = 24  # of the speed in each piece
_STEP_FRACTION = np.exp(-2.0)  # of the radius of convergence; the last term is then 1e-21 of the first
_STEADY = 4 * np.finfo(float).eps
_MAX_ITERATIONS = 120  # of Newton's method or bisection, more than the bits of a double


@dataclass(frozen=True, kw_only=True)
class PolynomialAngle:
    """Angle of a shaft as a polynomial between knots, with constant speed outside them.

    Attributes
    ----------
    times_s : (m + 1,) array
        Ends of the pieces in s, rising.
    coefficients : (degree + 1, m) array
        Coefficients in rev of each piece, in falling powers of the time since its start.
    datum_rev : float
        Revolutions from time zero to revolution zero.
    """

    times_s: Array = field(metadata={"dims": ("knot",), "units": "s"})
    coefficients: Array = field(metadata={"dims": ("power", "piece"), "units": "rev s-power"})
    datum_rev: float = 0.0

    @cached_property
    def _angle(self) -> "PPoly":
        from scipy.interpolate import PPoly  # noqa: PLC0415

        return PPoly(self.coefficients, self.times_s)

    @cached_property
    def _speed(self) -> "PPoly":
        return self._angle.derivative()

    @cached_property
    def _acceleration(self) -> "PPoly":
        return self._speed.derivative()

    def revolutions(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at `times_s` (n,)."""
        times = np.asarray(times_s, dtype=np.float64)
        inside = np.clip(times, self.times_s[0], self.times_s[-1])
        return np.asarray(self._angle(inside) + self._speed(inside) * (times - inside) - self.datum_rev)

    def speed_hz(self, times_s: ArrayLike) -> Array:
        """Return the speed in rev s-1 at `times_s` (n,)."""
        return np.asarray(self._speed(np.clip(times_s, self.times_s[0], self.times_s[-1])))

    def acceleration_hz_s(self, times_s: ArrayLike) -> Array:
        """Return the acceleration in rev s-2 at `times_s` (n,)."""
        times = np.asarray(times_s, dtype=np.float64)
        within = (times >= self.times_s[0]) & (times <= self.times_s[-1])
        return np.where(within, self._acceleration(np.where(within, times, self.times_s[0])), 0.0)

    def top_speed_hz(self, start_s: float, stop_s: float) -> float:
        """Return the largest absolute speed from `start_s` to `stop_s`, in rev s-1."""
        extremes = self._acceleration.roots(extrapolate=False)
        inside = extremes[(extremes > start_s) & (extremes < stop_s)]
        return float(np.max(np.abs(self.speed_hz([start_s, *inside, stop_s]))))

    def times(self, revolutions: ArrayLike) -> Array:
        """Return the times in s at which the shaft passes `revolutions` (n,), to rounding, by bracketed Newton steps.

        Raises
        ------
        ValueError
            A shaft that reverses, or revolutions outside the knots.
        """
        targets, ends_s = np.asarray(revolutions, dtype=np.float64), self.times_s[[0, -1]]
        zeros = self._speed.roots(extrapolate=False)
        edges = np.unique(np.concatenate([self.times_s, zeros[np.isfinite(zeros)]]))
        if np.any(self._speed((edges[1:] + edges[:-1]) / 2) < 0):
            raise ValueError("the shaft reverses, so that an angle has no unique time; raise the torque")
        first, last = self.revolutions(ends_s)
        if np.any((targets < first) | (targets > last)):
            raise ValueError(
                f"revolutions {np.min(targets):g} to {np.max(targets):g} are outside the run-up, which covers "
                f"{first:g} to {last:g}; lengthen it"
            )
        low, high = (np.full(targets.shape, end_s) for end_s in ends_s)
        share = (targets - first) / (last - first) if last != first else np.zeros(targets.shape)
        times, before = low + (high - low) * share, high - low
        for _ in range(_MAX_ITERATIONS):
            ahead, speed = self.revolutions(times) - targets, self.speed_hz(times)
            low, high = np.where(ahead <= 0, times, low), np.where(ahead >= 0, times, high)
            quick = (speed > 0) & (np.abs(ahead) <= speed * before / 2)  # steps that do not halve may cycle
            newton = times - np.divide(ahead, speed, out=np.zeros(times.shape), where=quick)
            better = np.where(quick & (newton >= low) & (newton <= high), newton, (low + high) / 2)
            times, before = better, np.abs(better - times)
            if np.all(before <= 2 * np.spacing(np.abs(times))):
                break
        return np.asarray(times)

    def scaled(self, ratio: float) -> "PolynomialAngle":
        """Return the angle of a shaft with the signed speed ratio `ratio` to this one."""
        return replace(self, coefficients=self.coefficients * ratio, datum_rev=self.datum_rev * ratio)


def run_up(torque_nm: PiecewiseLinear, law: RunUp, *, duration_s: float) -> PolynomialAngle:
    """Integrate ``J w' = T(t) - load(w)`` and the angle from time zero, to rounding.

    Parameters
    ----------
    torque_nm : PiecewiseLinear
        Driving torque in N m, referred to the shaft of the law.
    law : RunUp
        Inertia and load.
    duration_s : float
        Duration in s, above zero.
    """
    corners = torque_nm.times_s[(torque_nm.times_s > 0) & (torque_nm.times_s < duration_s)]
    edges = np.unique(np.concatenate([[0.0], corners, [duration_s]]))
    times_s, pieces, angle_rad, speed = [0.0], [], 0.0, 2 * np.pi * (law.rpm / 60)
    for start_s, stop_s in pairwise(edges):
        begin, slope = _linear_torque(torque_nm, start_s, stop_s)
        while (now_s := times_s[-1]) < stop_s:
            drive = (begin + slope * (now_s - start_s), slope)
            series = _taylor_series(speed, law, drive=drive)
            decay_rate = (law.load_nm_s + 2 * law.load_nm_s2 * abs(speed)) / law.inertia_kg_m2
            if slope == 0 and decay_rate > 0 and abs(series[1]) <= _STEADY * decay_rate * abs(speed):
                series[1:] = 0.0  # it has reached its final speed, to rounding
            step, speed = _step(series, longest=stop_s - now_s, bends=law.load_nm_s2 != 0)
            angle = np.concatenate([[angle_rad], series / np.arange(1, series.size + 1)])
            pieces.append(angle[::-1])
            angle_rad = float(np.polyval(angle[::-1], step))
            times_s.append(min(stop_s, now_s + step))
    return PolynomialAngle(times_s=np.array(times_s), coefficients=np.array(pieces).T / (2 * np.pi))


def _linear_torque(torque: PiecewiseLinear, start_s: float, stop_s: float) -> tuple[float, float]:
    """Return the torque just after the first of two knots, and its slope up to the other."""
    low, high = torque.at(start_s + (stop_s - start_s) * np.array([1, 2]) / 3)  # away from the jumps
    return 2 * low - high, 3 * (high - low) / (stop_s - start_s)


def _taylor_series(speed: float, law: RunUp, *, drive: tuple[float, float]) -> Array:
    """Return the Taylor coefficients (degree + 1,) of the speed in rad s-1 about now."""
    forcing = [*drive, *np.zeros(_DEGREE)]
    forcing[0] -= law.load_nm
    sense = np.sign(speed or forcing[0] or forcing[1])
    series = np.zeros(_DEGREE + 1)
    series[0] = speed
    for power in range(_DEGREE):
        square = sense * np.dot(series[: power + 1], series[power::-1])
        slowed = law.load_nm_s * series[power] + law.load_nm_s2 * square
        series[power + 1] = (forcing[power] - slowed) / (law.inertia_kg_m2 * (power + 1))
    return series


def _step(series: Array, *, longest: float, bends: bool) -> tuple[float, float]:
    """Return the step over which a series converges, at most up to a reversal, and the speed at its end."""
    powers = np.arange(series.size)
    scale = float(np.max(np.abs(series[:3]) * longest ** powers[:3])) or 1.0
    last = powers[-2:]
    inverse_radius = float(np.max((np.abs(series[last]) / scale) ** (1 / last)))
    step = min(longest, _STEP_FRACTION / inverse_radius) if inverse_radius > 0 else longest
    if bends:  # the load is not analytic where the speed changes sign
        forcing = np.polyval(series[::-1], step * np.arange(1, 65) / 64)
        sense = np.sign(forcing[0])
        across = np.flatnonzero(forcing * sense < 0)
        if sense != 0 and across.size:
            return _sign_change(series, step * across[0] / 64, step * (across[0] + 1) / 64), 0.0
    return step, float(np.polyval(series[::-1], step))


def _sign_change(series: Array, low: float, high: float) -> float:
    from scipy.optimize import brentq  # noqa: PLC0415

    return float(brentq(lambda t: float(np.polyval(series[::-1], t)), low, high, xtol=1e-300, rtol=1e-15))
