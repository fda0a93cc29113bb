"""Refinement of a declared speed by the lines of shafts and meshes, within its tolerance.

The candidates are the courses within the tolerance; the evidence ratio of `signals.shaft.tacholess` decides between
them and the declared speed (`signals.shaft._speed_evidence`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from signals._validation import Array, checked, positive, real_vector
from signals.shaft._angle_following import SHOWS
from signals.shaft._speed_evidence import along, judged, likeliest_constant
from signals.shaft._speed_search import CERTAIN, courses, search_speeds
from signals.shaft.phase import constant_speed
from signals.shaft.phase_demodulation import listed_orders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

_FRAMES, _LONGEST_FRAME_S = 8, 2.0
_WANDER_PER_S = 0.005  # relative change of a steady speed (our choice)
_AS_DECLARED = 1e-3  # of the speed: a motor's slip changes by as much
_FEWEST_REVOLUTIONS = 20.0


@dataclass(frozen=True, kw_only=True)
class DeclaredSpeed:
    """A declared speed, and that which the lines show.

    Attributes
    ----------
    declared_hz, speed_hz : float
        The declared and the refined speed in Hz; equal where the lines do not clearly show another.
    gain : float
        Logarithm of the evidence for the refined speed against the declared one.
    orders : (line,) array
        Orders that show at `speed_hz`, refined or as declared; empty where they do not clearly show either.

    Examples
    --------
    >>> from signals import DeclaredSpeed
    >>> DeclaredSpeed(declared_hz=25.0, speed_hz=25.0).refined
    False
    """

    declared_hz: float
    speed_hz: float
    gain: float = 0.0
    orders: Array = field(default_factory=lambda: np.zeros(0), metadata={"dims": ("line",), "units": "1"})

    @property
    def refined(self) -> bool:
        """Whether the lines show another speed than the declared one."""
        return self.speed_hz != self.declared_hz


@checked
def refine_declared_speed(
    x: ArrayLike, *, rate_hz: float, speed_hz: float, orders: Sequence[float], tolerance: float
) -> DeclaredSpeed:
    """Refine a declared constant speed by the lines of a record, where they clearly show another within its tolerance.

    The speed stays as declared unless the evidence of another, beside its strongest line, exceeds that of the declared
    speed, of every other one and of chance by a factor of a thousand. It may wander by 0.5 % per second; its mean is
    returned. Of a speed that is as declared, within a thousandth, the lines are given.

    Parameters
    ----------
    x : (n,) array
        Vibration, any unit; finite.
    rate_hz : float
        Sampling rate in Hz.
    speed_hz : float
        Declared speed in Hz.
    orders : sequence of float
        Orders per revolution of that shaft: shafts, and harmonics of meshes. Those above half the sampling rate are
        left out.
    tolerance : float
        Largest relative error of the declared speed.

    Returns
    -------
    DeclaredSpeed

    Examples
    --------
    A shaft at 24.8 Hz, declared as 25 Hz:

    >>> import numpy as np
    >>> from signals import refine_declared_speed
    >>> t = np.arange(8000) / 1000
    >>> x = sum(np.sin(2 * np.pi * order * 24.8 * t) for order in (1, 7, 14))
    >>> x = x + np.random.default_rng(1).standard_normal(t.size)
    >>> found = refine_declared_speed(x, rate_hz=1000, speed_hz=25.0, orders=[1, 7, 14], tolerance=0.02)
    >>> found.refined, round(found.speed_hz, 1)
    (True, 24.8)
    """
    signal = real_vector(x, name="the signal", minimum=64)
    rate = positive(rate_hz, name="rate_hz")
    declared, tolerance = positive(speed_hz, name="speed_hz"), positive(tolerance, name="tolerance")
    if tolerance >= 1:
        raise ValueError(f"tolerance={tolerance:g} lets the shaft stand still; give a relative error below 1.")
    listed = listed_orders(orders)
    listed = listed[listed * declared * (1 + tolerance) < rate / 2]
    duration, unchanged = signal.size / rate, DeclaredSpeed(declared_hz=declared, speed_hz=declared)
    if duration * declared < _FEWEST_REVOLUTIONS or not listed.size:
        return unchanged
    low, high = declared * (1 - tolerance), declared * (1 + tolerance)
    stop_s = (signal.size - 1) / rate
    as_declared = constant_speed(declared, start_s=0.0, stop_s=stop_s)
    steady = likeliest_constant(signal, rate, as_declared, listed, (low, high))
    frame_s = min(_LONGEST_FRAME_S, duration / _FRAMES)
    search = search_speeds(signal, rate, listed, low, high, _WANDER_PER_S * declared, frame_s)
    rough = [one.phase(stop_s) for one in courses(search)]
    verdict = judged(signal, rate, rough, listed, (low, high), steady=steady)
    phase = verdict.best.phase
    speed_hz = float(np.ptp(phase.revolutions) / np.ptp(phase.times_s))
    sure = min(verdict.beyond_chance, verdict.against_others) >= CERTAIN
    if not sure or not low < speed_hz < high:
        return unchanged
    shown = listed[verdict.shown > SHOWS]
    gain = verdict.best.evidence[0] - along(signal, rate, as_declared, listed).evidence[0]
    if abs(speed_hz / declared - 1) < _AS_DECLARED or gain < CERTAIN:
        return DeclaredSpeed(declared_hz=declared, speed_hz=declared, orders=shown)
    return DeclaredSpeed(declared_hz=declared, speed_hz=speed_hz, gain=gain, orders=shown)
