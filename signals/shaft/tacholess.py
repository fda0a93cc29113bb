"""Speed without a tachometer: candidates from short frames, and the evidence for each in the angle domain.

In each short frame, each listed order gives a likelihood of each speed, depending on whether there is a line at order
times speed (Leclere, Andre & Antoni 2016, "A multi-order probabilistic approach for instantaneous angular speed
tracking"). The frames form a hidden Markov model (`signals.shaft._speed_search`), whose most likely speed profiles are
the candidates. Several frame lengths are searched, since each mixes the lines of the shaft with those of other machines
differently and smears high orders more or less. If no candidate is certain, the search is repeated without lines that
stay in one bin for half the record, such as hum and machines at constant speed.

Each candidate is tracked in the angle domain, where a single evidence ratio decides (`signals.shaft._speed_evidence`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from signals._validation import Array, checked, positive, real_vector
from signals.shaft._speed_evidence import SHOWS, Verdict, along, judged, likeliest_constant
from signals.shaft._speed_search import CERTAIN, Course, courses, search_speeds
from signals.shaft.phase import constant_speed
from signals.shaft.phase_demodulation import listed_orders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from signals.shaft.phase import ShaftPhase

_FEWEST_FRAMES, _FEWEST_REVOLUTIONS = 8, 10.0
_LONGEST_FRAME_S = 2.0


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Another speed that explains the record about as well.

    Attributes
    ----------
    speed_hz : (frame,) array
        That speed in Hz; NaN in frames without the shaft.
    ratio : float
        Its median ratio to the speed of the estimate.
    probability : float
        Its probability.
    """

    speed_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    ratio: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class SpeedEstimate:
    """Speed of a shaft against time, estimated from vibration.

    Attributes
    ----------
    status : {"ok", "ambiguous", "not found"}
        Ambiguous for the `reason` given: the lines are no more than chance would place at the orders of some speed, are
        missing in a sixth of the record, or may be one tone with harmonics; `alternatives` are nearly as likely; or the
        phase of the harmonics cannot be tracked.
    times_s : (frame,) array
        Times in s of the middles of the frames.
    speed_hz, std_hz : (frame,) arrays
        Speed in Hz and its standard deviation; NaN in frames without the shaft, and everywhere if it is not found.
    confidence : (frame,) array
        Probability that the orders of the shaft are present and its speed is `speed_hz` rather than an alternative; at
        most 0.5 if ambiguous.
    alternatives : tuple of Alternative
        Other speeds that explain the record, with their probabilities.
    orders, shown : (order,) arrays
        Orders searched for, and the log likelihood ratio of a line at each in the order spectrum.
    evidence : float
        Log evidence of the speed, apart from its strongest line and beyond what chance finds among as many speeds.
    phase : ShaftPhase or None
        Phase refined from the harmonics; None unless the status is "ok".
    phase_std_rev : float
        Median standard deviation of the phase in revolutions; NaN without a phase.
    reason : str
        Why the status is not "ok", as a clause; empty if it is.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import estimate_speed
    >>> noise = np.random.default_rng(1).standard_normal(10_000)
    >>> found = estimate_speed(noise, rate_hz=1000, orders=[3, 7], speed_range_hz=(10, 30), max_acceleration_hz_s=2)
    >>> found.status
    'not found'
    """

    status: Literal["ok", "ambiguous", "not found"]
    times_s: Array = field(metadata={"dims": ("frame",), "units": "s"})
    speed_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    std_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    confidence: Array = field(metadata={"dims": ("frame",), "units": "1"})
    alternatives: tuple[Alternative, ...]
    orders: Array = field(metadata={"dims": ("order",), "units": "1"})
    shown: Array = field(metadata={"dims": ("order",), "units": "1"})
    evidence: float
    phase: ShaftPhase | None
    phase_std_rev: float
    reason: str = ""


@checked
def estimate_speed(
    x: ArrayLike,
    *,
    rate_hz: float,
    orders: Sequence[float],
    speed_range_hz: tuple[float, float],
    max_acceleration_hz_s: float,
    start_s: float = 0.0,
) -> SpeedEstimate:
    """Estimate the speed of a shaft from a vibration record and the orders of the gearbox.

    Parameters
    ----------
    x : (n,) array
        Vibration, any unit; finite.
    rate_hz : float
        Sampling rate in Hz.
    orders : sequence of float
        Orders of the shaft that the vibration may contain: mesh orders, their multiples, and 1. Absent orders cost
        little evidence; closely spaced orders add least.
    speed_range_hz : (low, high)
        Range of possible speeds in Hz.
    max_acceleration_hz_s : float
        Largest rate of change of the speed in Hz/s.
    start_s : float
        Time of the first sample in s.

    Returns
    -------
    SpeedEstimate

    Raises
    ------
    ValueError
        A record of too few revolutions, orders beyond half the sampling rate, an empty range, a search that is too
        large, or values that are not finite.

    Examples
    --------
    A shaft that accelerates from 20 to 25 rev/s, with lines at orders 12 and 17:

    >>> import numpy as np
    >>> from signals import estimate_speed
    >>> t = np.arange(10_000) / 1000
    >>> angle = 2 * np.pi * (20 * t + t**2 / 4)
    >>> x = np.sin(12 * angle) + np.sin(17 * angle) + np.random.default_rng(1).standard_normal(t.size)
    >>> found = estimate_speed(x, rate_hz=1000, orders=[12, 17], speed_range_hz=(10, 30), max_acceleration_hz_s=2)
    >>> found.status, round(float(np.median(found.speed_hz)), 1)
    ('ok', 22.5)
    """
    signal = real_vector(x, name="the signal", minimum=64)
    rate = positive(rate_hz, name="rate_hz")
    listed = listed_orders(orders)
    low, high = _checked_range(speed_range_hz)
    acceleration = positive(max_acceleration_hz_s, name="max_acceleration_hz_s")
    duration = signal.size / rate
    if duration * high < _FEWEST_REVOLUTIONS:
        raise ValueError(
            f"the record lasts {duration:.3g} s, {duration * high:.3g} revolutions at {high:g} Hz, the top of "
            f"speed_range_hz; at least {_FEWEST_REVOLUTIONS:g} are needed. Record longer."
        )
    if listed[0] * low > rate / 2:
        raise ValueError(
            f"the lowest order, {listed[0]:g}, lies at {listed[0] * low:.4g} Hz or higher, beyond half of "
            f"rate_hz={rate:g}; list lower orders, or sample faster."
        )
    fewest_samples = 64  # per frame
    most = min(duration / _FEWEST_FRAMES, max(_LONGEST_FRAME_S, fewest_samples / rate))
    # the median order may move by 4.0 bins within a frame at the largest acceleration
    frame = min(max(np.sqrt(4.0 / (acceleration * np.median(listed))), fewest_samples / rate), most)
    if frame * rate < fewest_samples:
        raise ValueError(
            f"frames of {frame:.3g} s hold {frame * rate:.3g} samples at rate_hz={rate:g}; at least {fewest_samples} "
            "are needed. Record longer."
        )

    lengths = [part * frame for part in (1.0, 0.5, 0.25) if part * frame * rate >= fewest_samples]
    stop_s = (signal.size - 1) / rate
    first: SpeedEstimate | None = None
    for moving in (False, True):
        found: list[Course] = []
        for length in lengths:
            search = search_speeds(signal, rate, listed, low, high, acceleration, float(length), moving=moving)
            found += [one for one in courses(search) if not any(one.is_of(other) for other in found)]
        if found:
            verdict = judged(signal, rate, [one.phase(stop_s) for one in found], listed, (low, high))
            estimate = _estimate(found[verdict.best.place], verdict, listed, start_s)
            if estimate.status == "ok":
                return estimate
            first = first or estimate
    return first or _not_found(search.evidence.times_s + start_s, listed)


def _checked_range(speed_range_hz: tuple[float, float]) -> tuple[float, float]:
    """Return the ends of the range, or raise ValueError if it is empty."""
    low, high = speed_range_hz
    low, high = positive(low, name="the lower end of speed_range_hz"), positive(high, name="its upper end")
    if low >= high:
        raise ValueError(f"speed_range_hz={speed_range_hz!r} is empty; give a lower end below the upper one.")
    return low, high


def _estimate(course: Course, verdict: Verdict, orders: Array, start_s: float) -> SpeedEstimate:
    """Return the estimate at the frames of a course, with the phase if there is no doubt."""
    phase, refined = verdict.best.phase, verdict.best.refined
    times = course.times_s
    seen = np.isfinite(course.speed_hz)
    speed = phase.speed_hz(np.clip(times, phase.start_s, phase.stop_s))
    std = np.nan_to_num(course.std_hz, nan=float(np.nanmedian(course.std_hz)))
    if refined is not None:
        inside = (times >= refined.times_s[0]) & (times <= refined.times_s[-1])
        std = np.where(inside, np.interp(times, refined.times_s, refined.std_hz), std)
    odds = [float(np.exp(-max(one.log_odds, -300.0))) for one in verdict.rivals]
    sure = not verdict.doubt
    share = 1.0 if sure else min(0.5, 1 / (1 + sum(odds)))
    at = np.linspace(phase.start_s, phase.stop_s, verdict.rivals[0].ratio.size) if verdict.rivals else times
    return SpeedEstimate(
        status="ok" if sure else "ambiguous",
        times_s=times + start_s,
        speed_hz=np.where(seen, speed, np.nan),
        std_hz=np.where(seen, std, np.nan),
        confidence=np.where(seen, share * course.probability, 0.0),
        alternatives=tuple(
            Alternative(
                speed_hz=np.where(seen, np.interp(times, at, rival.ratio) * speed, np.nan),
                ratio=float(np.nanmedian(rival.ratio)),
                probability=one / (1 + sum(odds)),
            )
            for rival, one in zip(verdict.rivals, odds, strict=True)
        ),
        orders=orders,
        shown=verdict.shown,
        evidence=verdict.beyond_chance,
        phase=replace(phase, times_s=phase.times_s + start_s) if sure else None,
        phase_std_rev=float(np.median(refined.phase_std_rev)) if refined is not None and sure else np.nan,
        reason=verdict.doubt,
    )


def _not_found(times: Array, orders: Array) -> SpeedEstimate:
    """Return the estimate of a record without a shaft."""
    none = np.full(times.size, np.nan)
    return SpeedEstimate(
        status="not found",
        times_s=times,
        speed_hz=none,
        std_hz=none,
        confidence=np.zeros(none.size),
        alternatives=(),
        orders=orders,
        shown=np.zeros(orders.size),
        evidence=0.0,
        phase=None,
        phase_std_rev=np.nan,
        reason="no shaft rises above the noise",
    )


# ---- Refinement of a declared speed by the lines of shafts and meshes, within its tolerance --------------------------
# The candidates are the speed profiles within the tolerance; the same evidence ratio decides between them and the
# declared speed.


@dataclass(frozen=True, kw_only=True)
class DeclaredSpeed:
    """A declared speed and the speed found from the lines.

    Attributes
    ----------
    declared_hz, speed_hz : float
        The declared and the refined speed in Hz; equal unless the lines clearly indicate another speed.
    gain : float
        Log evidence for the refined speed against the declared one.
    orders : (line,) array
        Orders with significant lines at `speed_hz`, refined or as declared; empty if neither speed is clearly
        indicated.

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
        """Whether the lines indicate another speed than the declared one."""
        return self.speed_hz != self.declared_hz


@checked
def refine_declared_speed(
    x: ArrayLike, *, rate_hz: float, speed_hz: float, orders: Sequence[float], tolerance: float
) -> DeclaredSpeed:
    """Refine a declared constant speed from the lines of a record, if they clearly indicate another within tolerance.

    The declared speed is retained unless the evidence for another speed, apart from its strongest line, exceeds that
    for the declared one, for every other speed and for chance by a factor of a thousand. The speed may vary by 0.5 %
    per second; its median is returned. A speed within 0.1 % of the declared one confirms it; its lines are returned.

    Parameters
    ----------
    x : (n,) array
        Vibration, any unit; finite.
    rate_hz : float
        Sampling rate in Hz.
    speed_hz : float
        Declared speed in Hz.
    orders : sequence of float
        Orders of that shaft that the vibration may contain: of shafts and mesh harmonics. Those above half the sampling
        rate are left out.
    tolerance : float
        Largest relative error of the declared speed, below 1.

    Returns
    -------
    DeclaredSpeed
        With the declared speed for records of fewer than 20 revolutions.

    Raises
    ------
    ValueError
        A rate, speed, order or tolerance that is not positive, a tolerance of 1 or more, or values that are not finite.

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
        raise ValueError(f"tolerance={tolerance:g} would allow a standstill; give a relative error below 1.")
    listed = listed_orders(orders)
    listed = listed[listed * declared * (1 + tolerance) < rate / 2]
    duration, unchanged = signal.size / rate, DeclaredSpeed(declared_hz=declared, speed_hz=declared)
    if duration * declared < 2 * _FEWEST_REVOLUTIONS or not listed.size:
        return unchanged
    low, high = declared * (1 - tolerance), declared * (1 + tolerance)
    stop_s = (signal.size - 1) / rate
    as_declared = constant_speed(declared, start_s=0.0, stop_s=stop_s)
    steady = likeliest_constant(signal, rate, as_declared, listed, (low, high))
    frame_s = min(_LONGEST_FRAME_S, duration / _FEWEST_FRAMES)
    search = search_speeds(signal, rate, listed, low, high, 0.005 * declared, frame_s)  # 0.5 % per second
    rough = [one.phase(stop_s) for one in courses(search)]
    verdict = judged(signal, rate, rough, listed, (low, high), steady=steady)
    phase = verdict.best.phase
    speed_hz = float(np.median(np.diff(phase.revolutions) / np.diff(phase.times_s)))  # a course may end beside its line
    sure = min(verdict.beyond_chance, verdict.against_others) >= CERTAIN
    if not sure or not low < speed_hz < high:
        return unchanged
    shown = listed[verdict.shown > SHOWS]
    gain = verdict.best.evidence[0] - along(signal, rate, as_declared, listed).evidence[0]
    if abs(speed_hz - declared) < 1e-3 * declared or gain < CERTAIN:  # the slip of a motor varies by as much
        return DeclaredSpeed(declared_hz=declared, speed_hz=declared, orders=shown)
    return DeclaredSpeed(declared_hz=declared, speed_hz=speed_hz, gain=gain, orders=shown)
