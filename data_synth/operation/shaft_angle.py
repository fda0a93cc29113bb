"""The exact angle of a shaft against time, and its exact inverse.

Speed is linear between knots, so that the angle is quadratic and both directions have a closed form. A shaft may stand
still and reverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ShaftAngle:
    """Angle of a shaft whose speed is linear between knots and constant before the first and after the last.

    Attributes
    ----------
    times_s : (m,) array
        Times of the knots in s, rising; two equal ones are a jump in speed.
    speeds_hz : (m,) array
        Speeds at the knots in rev s-1; zero at standstill, negative in reverse.
    datum_rev : float
        Revolutions from time zero to revolution zero.

    Raises
    ------
    ValueError
        Knots that are not two finite vectors of equal length, or times that decrease.

    Examples
    --------
    In a run-up from standstill to 10 rev/s in 2 s the angle is ``10 t^2 / 4`` revolutions:

    >>> import numpy as np
    >>> from data_synth.dynamics import ShaftAngle
    >>> shaft = ShaftAngle(times_s=np.array([0.0, 2.0]), speeds_hz=np.array([0.0, 10.0]))
    >>> shaft.revolutions([1.0, 2.0]).tolist(), shaft.times([10.0]).tolist()
    ([2.5, 10.0], [2.0])
    """

    times_s: Array
    speeds_hz: Array
    datum_rev: float = 0.0

    def __post_init__(self) -> None:
        shapes = np.shape(self.times_s), np.shape(self.speeds_hz)
        if len(shapes[0]) != 1 or shapes[0] != shapes[1] or not shapes[0][0]:
            raise ValueError(
                f"times_s and speeds_hz have shapes {shapes[0]} and {shapes[1]}; give two vectors of equal length"
            )
        if not (np.all(np.isfinite(self.times_s)) and np.all(np.isfinite(self.speeds_hz))):
            raise ValueError("times_s or speeds_hz holds NaN or infinity; give finite knots")
        back = np.flatnonzero(np.diff(self.times_s) < 0)
        if back.size:
            raise ValueError(
                f"times_s decreases from {self.times_s[back[0]]:g} s to {self.times_s[back[0] + 1]:g} s; sort the knots"
            )

    @cached_property
    def _starts_s(self) -> Array:
        """Start time of each quadratic piece; for the piece before the first knot, that knot."""
        return np.concatenate([self.times_s[:1], self.times_s])

    @cached_property
    def _start_speeds_hz(self) -> Array:
        """Speed at those times in rev s-1."""
        return np.concatenate([self.speeds_hz[:1], self.speeds_hz])

    @cached_property
    def _slopes(self) -> Array:
        """Acceleration in each piece in rev s-2; zero outside the knots and in jumps, which have no duration."""
        gaps = np.diff(self.times_s)
        slopes = np.divide(np.diff(self.speeds_hz), gaps, out=np.zeros(gaps.size), where=gaps > 0)
        return np.concatenate([[0.0], slopes, [0.0]])

    @cached_property
    def _knots_rev(self) -> Array:
        """Revolutions at the knots, counted from time zero."""
        mean_speeds = (self.speeds_hz[1:] + self.speeds_hz[:-1]) / 2
        knots = np.concatenate([[0.0], np.cumsum(mean_speeds * np.diff(self.times_s))])
        return np.asarray(knots - self._since_first_knot(np.zeros(1), knots)[0])

    def _since_first_knot(self, times_s: Array, knots_rev: Array) -> Array:
        """Return the revolutions at times (n,), given those at the knots."""
        if self.times_s.size == 1:
            return np.asarray(knots_rev[0] + self.speeds_hz[0] * (times_s - self.times_s[0]))
        piece = np.searchsorted(self.times_s, times_s, side="right")
        since = times_s - self._starts_s[piece]
        starts_rev = np.concatenate([knots_rev[:1], knots_rev])[piece]
        slope = self._start_speeds_hz[piece] + self._slopes[piece] * since / 2
        return np.asarray(starts_rev + slope * since)

    def revolutions(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at `times_s` (n,)."""
        times = np.asarray(times_s, dtype=np.float64)
        return self._since_first_knot(times, self._knots_rev) - self.datum_rev

    def times(self, revolutions: ArrayLike) -> Array:
        """Return the times in s at which the shaft passes `revolutions` (n,), exactly.

        For an angle at which it stands still, that is the time at which it moves on.

        Raises
        ------
        ValueError
            A shaft that reverses, so that an angle has several times, or that stops before reaching an angle.
        """
        if np.any(self.speeds_hz < 0):
            raise ValueError(
                f"the shaft reverses, at {np.min(self.speeds_hz):g} rev/s, so that an angle has no unique time; keep "
                "its speeds at 0 or above"
            )
        from_zero = np.asarray(revolutions, dtype=np.float64) + self.datum_rev
        piece = np.searchsorted(self._knots_rev, from_zero, side="right")
        turn = from_zero - np.concatenate([self._knots_rev[:1], self._knots_rev])[piece]
        speed = self._start_speeds_hz[piece]
        # the root of a t^2 / 2 + v t = turn in the form without cancellation for small a; rounding may make the
        # discriminant negative where the shaft comes to rest
        twice_mean = speed + np.sqrt(np.maximum(speed**2 + 2 * self._slopes[piece] * turn, 0.0))
        never = (twice_mean == 0) & (turn != 0)
        if np.any(never):
            raise ValueError(
                f"revolution {np.asarray(revolutions)[never].flat[0]:g} is never reached: the shaft stands still; "
                "give revolutions within its profile"
            )
        since = np.divide(2 * turn, twice_mean, out=np.zeros(np.shape(turn)), where=twice_mean != 0)
        return np.asarray(self._starts_s[piece] + since)

    def speed_hz(self, times_s: ArrayLike) -> Array:
        """Return the speed in rev s-1 at `times_s` (n,); at a jump, the one after it."""
        times = np.asarray(times_s, dtype=np.float64)
        piece = np.searchsorted(self.times_s, times, side="right")
        since = times - self._starts_s[piece]
        return np.asarray(self._start_speeds_hz[piece] + self._slopes[piece] * since)

    def acceleration_hz_s(self, times_s: ArrayLike) -> Array:
        """Return the acceleration in rev s-2 at `times_s` (n,); at a knot, the one after it."""
        piece = np.searchsorted(self.times_s, np.asarray(times_s, dtype=np.float64), side="right")
        return np.asarray(self._slopes[piece])

    def top_speed_hz(self, start_s: float, stop_s: float) -> float:
        """Return the largest absolute speed from `start_s` to `stop_s`, in rev s-1."""
        inside = (self.times_s >= start_s) & (self.times_s <= stop_s)  # both knots of a jump count
        return float(np.max(np.abs([*self.speed_hz([start_s, stop_s]), *self.speeds_hz[inside]])))
