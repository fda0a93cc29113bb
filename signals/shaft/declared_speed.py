"""Refinement of a declared constant speed by the lines of shafts and meshes, within its tolerance.

The evidence of a speed is the sum over all orders of the logarithm of their likelihood ratio, a line at order times
speed against noise (`signals.shaft._line_likelihood`), in long frames. It is scanned over the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from signals._validation import Array, checked, positive, real_vector
from signals.shaft._speed_search import CERTAIN, SHOWS, Search, leakage_bins, search_speeds, single_line
from signals.shaft.phase_demodulation import listed_orders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

_LONGEST_FRAME_S = 4.0  # lines of a speed that is constant within a thousandth keep together up to order 100 at 2 Hz
_STILL_HZ_S = 1e-6  # the search does without changes of speed
_RIVAL = 0.5  # of the evidence at the best speed, which a speed beyond its wander must not reach by lines of its own
_WANDER = 0.005  # relative change of a steady speed (our choice); lines of high orders smear over so many speeds
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

    The speed stays as declared unless at least two lines show the other one; its evidence exceeds that of the declared
    speed by a factor of a thousand for each speed tried; no speed farther from it than a steady one wanders has half of
    it; and it lies within the tolerance, not at its edge. Of a speed that is as declared the lines are given where the
    best one is as near as a motor's speed changes, and its evidence exceeds that of the median speed so.

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
    >>> x = np.sin(2 * np.pi * 24.8 * t) + np.sin(2 * np.pi * 7 * 24.8 * t)
    >>> x = x + np.random.default_rng(1).standard_normal(t.size)
    >>> found = refine_declared_speed(x, rate_hz=1000, speed_hz=25.0, orders=[1, 7], tolerance=0.02)
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
    frame_s = min(_LONGEST_FRAME_S, duration / 2)
    low, high = declared * (1 - tolerance), declared * (1 + tolerance)
    search = search_speeds(signal, rate, listed, low, high, _STILL_HZ_S, frame_s)
    speeds = search.speeds[search.speeds <= high]
    scores = np.array([_scores(search, speed) for speed in speeds])
    evidence = scores.sum(axis=1)
    best = int(np.argmax(evidence))
    if best in (0, speeds.size - 1):
        return unchanged
    shown = scores[best]
    gain = float(evidence[best] - _scores(search, declared).sum())
    # orders whose line at another speed is neither the line that the best one has nor its leakage
    own = np.abs(np.outer(speeds - speeds[best], listed)) * frame_s > leakage_bins(search, float(speeds[best]))
    rival = (scores * own).sum(axis=1) > _RIVAL * np.maximum((shown * own).sum(axis=1), CERTAIN)
    # within the wander of a steady speed the evidence is of the same lines, smeared
    contested = rival[np.abs(speeds / speeds[best] - 1) > _WANDER].any()
    if contested or single_line(search, float(speeds[best]), shown):
        return unchanged
    needed = CERTAIN + np.log(speeds.size)
    if gain < needed:
        as_declared = abs(speeds[best] / declared - 1) <= _WANDER / 2 and evidence[best] - np.median(evidence) >= needed
        return replace(unchanged, orders=listed[shown > SHOWS]) if as_declared else unchanged
    before, at, after = evidence[best - 1 : best + 2]
    bend = before - 2 * at + after
    peak = speeds[best] + (search.spacing * 0.5 * (before - after) / bend if bend < 0 else 0.0)
    return DeclaredSpeed(declared_hz=declared, speed_hz=float(peak), gain=gain, orders=listed[shown > SHOWS])


def _scores(search: Search, speed_hz: float) -> Array:
    """Return the logarithm of the evidence for each order at a constant speed."""
    frames = search.evidence.times_s.size
    return search.score(np.full(frames, speed_hz), np.ones(frames, dtype=np.bool_))
