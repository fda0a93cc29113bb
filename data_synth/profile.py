"""Speed and load against time: the exact angle of the reference shaft, its exact inverse, the share of full load.

Speed is linear between knots, so the angle is quadratic there and both directions have a closed form.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.scene import Torque

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ShaftAngle:
    """Revolutions of a shaft whose speed is linear between knots and held before the first and after the last.

    Attributes
    ----------
    times_s : (m,) array
        Rising times of the knots in s.
    speeds_hz : (m,) array
        Speeds at the knots in rev s-1, all above zero.
    datum_rev : float
        Revolutions from time zero to revolution zero.
    """

    times_s: Array
    speeds_hz: Array
    datum_rev: float = 0.0

    @cached_property
    def _starts_s(self) -> Array:
        """Where each quadratic piece counts from: the first knot for the piece before it, too."""
        return np.concatenate([self.times_s[:1], self.times_s])

    @cached_property
    def _start_speeds_hz(self) -> Array:
        return np.concatenate([self.speeds_hz[:1], self.speeds_hz])

    @cached_property
    def _accelerations(self) -> Array:
        """Slope of the speed in each piece in rev s-2; zero outside of the knots."""
        return np.concatenate([[0.0], np.diff(self.speeds_hz) / np.diff(self.times_s), [0.0]])

    @cached_property
    def _knots_rev(self) -> Array:
        """Revolutions at the knots, counted from time zero."""
        mean_speeds = (self.speeds_hz[1:] + self.speeds_hz[:-1]) / 2
        knots = np.concatenate([[0.0], np.cumsum(mean_speeds * np.diff(self.times_s))])
        return np.asarray(knots - self._since_first_knot(np.zeros(1), knots)[0])

    def _since_first_knot(self, times_s: Array, knots_rev: Array) -> Array:
        piece = np.searchsorted(self.times_s, times_s, side="right")
        since = times_s - self._starts_s[piece]
        starts_rev = np.concatenate([knots_rev[:1], knots_rev])[piece]
        slope = self._start_speeds_hz[piece] + self._accelerations[piece] * since / 2
        return np.asarray(starts_rev + slope * since)

    def revolutions(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at `times_s` (n,)."""
        times = np.asarray(times_s, dtype=np.float64)
        return self._since_first_knot(times, self._knots_rev) - self.datum_rev

    def times(self, revolutions: ArrayLike) -> Array:
        """Return the times in s at which the shaft reaches `revolutions` (n,), exactly."""
        from_zero = np.asarray(revolutions, dtype=np.float64) + self.datum_rev
        piece = np.searchsorted(self._knots_rev, from_zero, side="right")
        turn = from_zero - np.concatenate([self._knots_rev[:1], self._knots_rev])[piece]
        speed = self._start_speeds_hz[piece]
        # the root of a t^2 / 2 + v t = turn in the form that loses no digits where a is small
        root = np.sqrt(speed**2 + 2 * self._accelerations[piece] * turn)
        return np.asarray(self._starts_s[piece] + 2 * turn / (speed + root))

    def speed_hz(self, times_s: ArrayLike) -> Array:
        """Return the speed in rev s-1 at `times_s` (n,)."""
        return np.interp(np.asarray(times_s, dtype=np.float64), self.times_s, self.speeds_hz)


def load_share(torque: Torque | None, times_s: ArrayLike) -> Array:
    """Return what teeth carry at `times_s` (n,), relative to full load: ``u + (1 - u) abs(T) / max abs(T)``.

    T is the torque, linear between its knots and held outside, u its `unloaded_share`. Without torque: 1.
    """
    times = np.asarray(times_s, dtype=np.float64)
    if torque is None:
        return np.ones_like(times)
    at_s, torque_nm = np.array(torque.nm).T
    relative = np.abs(np.interp(times, at_s, torque_nm)) / np.max(np.abs(torque_nm))
    return np.asarray(torque.unloaded_share + (1 - torque.unloaded_share) * relative)
