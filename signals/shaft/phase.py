"""Shaft angle as a function of time: interpolated through tachometer pulses, differentiable, and invertible."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import factorial
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly, make_interp_spline

from signals._validation import Array, checked, choice, number, positive, real_vector
from signals.shaft.pulse_repair import PulseRepairs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


# ---- Interpolation of a shaft's angle: a quintic spline, with monotone pieces where it would reverse -----------------


_DEGREE = 5


def build_curve(times: Array, revolutions: Array, *, breaks: NDArray[np.bool_]) -> PPoly:
    """Return the curve of splines through the knots, with monotone pieces in "broken" cells.

    Each run of cells between broken ones has its own spline. Cells in which a spline reverses are broken and the
    splines are fitted again, until none reverses. `breaks` (n - 1,) are the cells broken from the start, in which the
    shaft may stand.
    """
    broken = breaks.copy()
    rises = np.diff(revolutions)
    steps = np.diff(times)
    fewest = 4  # knots between two broken cells for a spline
    while True:
        for first, last in _spline_runs(broken):
            if last - first + 1 < fewest and last - first + 1 < times.size:
                broken[first:last] = True
        coefficients = np.zeros((_DEGREE + 1, steps.size))
        for first, last in _spline_runs(broken):
            part = slice(first, last + 1)
            coefficients[:, first:last] = _spline(times[part], revolutions[part])
        reversed_ = _reverses(coefficients, steps, rises) & ~broken
        if not reversed_.any():
            break
        broken |= reversed_
    return _joined(times, revolutions, coefficients, broken)


def _spline_runs(broken: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last knot of each run of cells that are not broken."""
    edges = np.diff(np.concatenate([[True], broken, [True]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges < 0).tolist(), np.flatnonzero(edges > 0).tolist(), strict=True))


def _spline(times: Array, revolutions: Array) -> Array:
    """Return the spline coefficients about the left knot of each cell, highest power first, (6, cells)."""
    degree = 5 if times.size > 5 else (3 if times.size > 3 else 1)  # noqa: PLR2004
    spline = make_interp_spline(times, revolutions, k=degree)
    coefficients = np.zeros((_DEGREE + 1, times.size - 1))
    for power in range(degree + 1):
        coefficients[_DEGREE - power] = spline(times[:-1], nu=power) / factorial(power)
    coefficients[_DEGREE] = revolutions[:-1]
    return coefficients


def _reverses(coefficients: Array, steps: Array, rises: Array) -> NDArray[np.bool_]:
    """Return, per cell, whether the slope may oppose the rise or there is no rise.

    A polynomial lies between the extremes of its Bernstein coefficients.
    """
    sign = np.sign(rises)
    powers = np.arange(_DEGREE, 0, -1)
    slope = (powers[:, None] * coefficients[:-1] * steps ** powers[:, None])[::-1] * sign  # of u in 0..1, rising powers
    degree = _DEGREE - 1
    to_bernstein = np.array(
        [
            [factorial(i) / factorial(i - j) * factorial(degree - j) / factorial(degree) if j <= i else 0.0
             for j in range(degree + 1)]
            for i in range(degree + 1)
        ]
    )  # fmt: skip
    bounds = to_bernstein @ slope
    rounding = 1e-12
    limit = -rounding * np.abs(bounds).max(axis=0)
    found: NDArray[np.bool_] = bounds.min(axis=0) < limit
    # a cell without a rise is a standstill, except between opposite directions, where the shaft reverses
    before, after = np.concatenate([[0], sign[:-1]]), np.concatenate([sign[1:], [0]])
    found[(sign == 0) & (before * after >= 0)] = True
    return found


def _joined(times: Array, revolutions: Array, coefficients: Array, broken: NDArray[np.bool_]) -> PPoly:
    """Return the curve of the splines, with monotone cubics in the broken cells (Fritsch and Carlson 1980).

    Their slopes are those of the adjacent splines, limited to three times the mean slope of the cell.
    """
    steps, rises = np.diff(times), np.diff(revolutions)
    slopes, mean = _knot_slopes(times, revolutions, coefficients, broken), rises / steps
    before, after = (np.sign(rises) * np.clip(np.sign(rises) * s, 0, 3 * abs(mean)) for s in (slopes[:-1], slopes[1:]))
    cubics = np.zeros_like(coefficients)
    cubics[2] = (before + after - 2 * mean) / steps**2
    cubics[3] = (3 * mean - 2 * before - after) / steps
    cubics[4], cubics[5] = before, revolutions[:-1]
    return PPoly(np.where(broken, cubics, coefficients), times, extrapolate=True)


def _knot_slopes(times: Array, revolutions: Array, coefficients: Array, broken: NDArray[np.bool_]) -> Array:
    """Return the slope at each knot: that of the adjacent spline, zero at a standstill, else by Fritsch and Butland."""
    steps, rises = np.diff(times), np.diff(revolutions)
    slopes = np.asarray(PchipInterpolator(times, revolutions).derivative()(times), dtype=np.float64)
    powers = np.arange(_DEGREE, 0, -1)[:, None]
    ends = (powers * coefficients[:-1] * steps ** (powers - 1)).sum(axis=0)
    whole = np.flatnonzero(~broken)
    slopes[whole + 1] = ends[whole]
    slopes[whole] = coefficients[_DEGREE - 1, whole]
    standstill = np.flatnonzero(broken & (rises == 0))
    slopes[standstill] = slopes[standstill + 1] = 0.0
    return slopes


# ---- Standstills of a shaft, from the knots of its phase -------------------------------------------------------------


def refuse_rest(
    times_s: Array, revolutions: Array, *, start_s: float, stop_s: float, rate_hz: float | None = None
) -> None:
    """Raise ValueError if the shaft stands still within a span; with `rate_hz`, name the samples to use instead."""
    still = np.concatenate([[False], np.diff(revolutions) == 0, [False]])
    edges = np.flatnonzero(np.diff(still))
    begins, ends = times_s[edges[::2]], times_s[edges[1::2]]
    within = np.flatnonzero((begins > max(start_s, times_s[0])) & (ends < min(stop_s, times_s[-1])))
    if not within.size:
        return
    begin, end = float(begins[within[0]]), float(ends[within[0]])
    remedy = "use the parts before and after separately."
    if rate_hz is not None:
        # the last sample before the standstill and the first after it
        stop, start = math.floor((begin - start_s) * rate_hz) + 1, math.ceil((end - start_s) * rate_hz)
        remedy = f"resample x[:{stop}] and, with start_s={start_s + start / rate_hz:.9g}, x[{start}:] separately."
    raise ValueError(
        f"the shaft stands still from {begin:g} to {end:g} s, within the record, so that its angle there has no unique "
        f"time ({within.size} standstills in all); {remedy}"
    )


# ---- Phase -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ShaftPhase:
    """Angle of a shaft against time, interpolated between known angles at known times.

    The interpolant is a quintic spline through the knots (of lower degree for fewer than six), whose error falls with
    the sixth power of the knot spacing. Where the spline would reverse between two knots, as in a sudden stop, that
    interval alone becomes a monotone cubic (Fritsch and Carlson 1980), at whose ends the speed may jump, and a separate
    spline is fitted on either side.

    Attributes
    ----------
    times_s, revolutions : (knot,) arrays
        Times in s, strictly increasing, and angles in revolutions, which may also stay constant (standstill) or
        decrease (reverse rotation).
    stripe_positions_rev : (stripe,) array
        Angles of the tachometer's stripes within the revolution, in revolutions.
    nominal : bool
        Whether the speed was declared rather than measured.
    jitter_s : float
        Standard deviation of a pulse time in s; NaN where there are too few pulses to estimate it.
    repairs : PulseRepairs
        Missing and extra pulses found.
    stops_s : (stop, 2) array
        Start and end in s of the intervals between two pulses in which the shaft stood, or may have stood, still.
    direction_declared : bool
        Whether the direction of rotation is known, from a sign or a second channel. If not, it is unknown after each
        of `stops_s`.

    Examples
    --------
    A shaft whose speed rises from 10 Hz by 4 Hz in one second:

    >>> import numpy as np
    >>> from signals import ShaftPhase
    >>> t = np.linspace(0.0, 1.0, 13)
    >>> phase = ShaftPhase(times_s=t, revolutions=10 * t + 2 * t**2)
    >>> float(phase.revolutions_at([0.7])[0].round(6)), float(phase.speed_hz([0.7])[0].round(6))
    (7.98, 12.8)
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
        """Whether the shaft may have reversed at a stop, so that the direction after it is unknown."""
        return bool(self.stops_s.size) and not self.direction_declared

    @cached_property
    def _curve(self) -> PPoly:
        middles = (self.times_s[:-1] + self.times_s[1:]) / 2
        breaks = np.zeros(middles.size, dtype=np.bool_)
        for begin, end in self.stops_s:
            breaks |= (middles > begin) & (middles < end)
        return build_curve(self.times_s, self.revolutions, breaks=breaks)

    @cached_property
    def _slope(self) -> PPoly:
        return self._curve.derivative()

    def revolutions_at(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at `times_s` (m,); raise ValueError outside the knots."""
        return np.asarray(self._curve(self._checked_times(times_s)), dtype=np.float64)

    def _checked_times(self, times_s: ArrayLike) -> Array:
        times = real_vector(times_s, name="times_s")
        slack = 1e-9 * max(1.0, abs(self.stop_s))
        if times.min() < self.start_s - slack or times.max() > self.stop_s + slack:
            raise ValueError(
                f"times_s from {times.min():g} to {times.max():g} s are outside the known motion of the shaft, "
                f"{self.start_s:g} to {self.stop_s:g} s; give times within it."
            )
        return times

    def angle_rad(self, times_s: ArrayLike) -> Array:
        """Return the angle in rad at `times_s` (m,), zero at revolution zero; raise ValueError outside the knots."""
        return 2 * np.pi * self.revolutions_at(times_s)

    def speed_hz(self, times_s: ArrayLike) -> Array:
        """Return the speed in revolutions per second at `times_s` (m,); raise ValueError outside the knots."""
        return np.asarray(self._slope(self._checked_times(times_s)), dtype=np.float64)

    def std_rad(self, times_s: ArrayLike) -> Array:
        """Return the standard deviation of the angle in rad at `times_s` (m,).

        It is the jitter of a pulse times the speed: exact at the pulses, approximate between them. Neither the
        interpolation error of the spline nor the unknown angle within a standstill is included.

        Raises
        ------
        ValueError
            Times outside the knots; a phase of unknown jitter, because it is nominal or has too few pulses.
        """
        times = self._checked_times(times_s)
        if not math.isfinite(self.jitter_s):
            why = (
                "its speed is declared, not measured"
                if self.nominal
                else f"{self.times_s.size} knots are too few to estimate it"
            )
            raise ValueError(f"the jitter of this phase is unknown: {why}. Use more pulses, or set jitter_s.")
        return 2 * np.pi * self.jitter_s * np.abs(self.speed_hz(times))

    def times_at(
        self, revolutions: ArrayLike, *, at_rest: Literal["refuse", "arrival", "departure"] = "refuse"
    ) -> Array:
        """Return the times in s at which the shaft reaches `revolutions` (m,).

        Found by Newton's method between adjacent knots, or by bisection where that does not converge, as near a
        standstill.

        Parameters
        ----------
        revolutions : (m,) array
            Angles in revolutions, in any order.
        at_rest : {"refuse", "arrival", "departure"}
            Time returned for an angle at which the shaft stands still: when it comes to rest, or when it moves on.
            "refuse" raises if it stands still anywhere between the smallest and the largest angle.

        Raises
        ------
        ValueError
            Revolutions outside the knots, a standstill between them, or a shaft that reverses.
        """
        choice(at_rest, name="at_rest", choices=("refuse", "arrival", "departure"))
        targets = self.direction * real_vector(revolutions, name="revolutions")
        knots = self.direction * self.revolutions
        if targets.min() < knots[0] - 1e-9 or targets.max() > knots[-1] + 1e-9:
            low, high = sorted((float(self.revolutions[0]), float(self.revolutions[-1])))
            given = np.sort(self.direction * targets)
            raise ValueError(
                f"revolutions {given[0]:g} to {given[-1]:g} are outside the known {low:g} to {high:g}; give angles "
                "within that range."
            )
        arrival = np.searchsorted(knots, targets, side="left")
        departure = np.searchsorted(knots, targets, side="right") - 1
        resting = departure > arrival
        if at_rest == "refuse":
            self._refuse_rest(float(targets.min()), float(targets.max()))
        times = self._inverse(targets, np.clip(departure, 0, self.times_s.size - 2))
        rest = arrival if at_rest == "arrival" else departure
        times[resting] = self.times_s[rest[resting]]
        return times

    def _refuse_rest(self, low: float, high: float) -> None:
        """Raise where the shaft stands at an angle from `low` to `high`, both times the sign of rotation."""
        rest = np.flatnonzero(np.diff(self.revolutions) == 0)
        angles = self.direction * self.revolutions[rest]
        hit = rest[(angles >= low) & (angles <= high)]
        if hit.size:
            i = int(hit[0])
            raise ValueError(
                f"the shaft stands still from {self.times_s[i]:g} s onwards ({hit.size} standstills in all), so the "
                f'angle {self.revolutions[i]:g} rev has no unique time; give at_rest="arrival" or "departure", or '
                "treat the parts of the record before and after separately."
            )

    @cached_property
    def direction(self) -> float:
        """Direction of rotation, +1 or -1, standstills permitted; raise ValueError if the shaft reverses."""
        steps = np.diff(self.revolutions)
        moving = np.flatnonzero(steps)
        signs = np.sign(steps[moving])
        reversals = np.flatnonzero(np.diff(signs))
        if reversals.size:
            raise ValueError(
                f"the shaft reverses at {self.times_s[moving[reversals[0] + 1]]:g} s, so an angle has several times; "
                "use the parts of the record before and after separately, each with a phase from its own pulses."
            )
        return -1.0 if np.any(signs < 0) else 1.0

    def _inverse(self, targets: Array, cell: NDArray[np.int64]) -> Array:
        """Return the times at which sign times angle equals `targets`, each between the knots of its cell."""
        low, high = self.times_s[cell], self.times_s[cell + 1]
        times = np.clip(np.interp(targets, self.direction * self.revolutions, self.times_s), low, high)
        step = high - low
        for _ in range(8):
            with np.errstate(all="ignore"):  # where the slope is zero there is no step: bisected below
                step = (self._curve(times) - self.direction * targets) / self._slope(times)
            times = np.clip(times - step, low, high)
            converged = np.abs(step) < 1e-13 * max(1.0, abs(self.stop_s))
            if converged.all():
                return times
        rest = np.flatnonzero(~converged)
        low, high, target = low[rest], high[rest], targets[rest]
        for _ in range(60):  # down to rounding
            middle = low + (high - low) / 2
            late = self.direction * self._curve(middle) > target
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        times[rest] = high
        return times

    def mean_speed_per_revolution_hz(self) -> Array:
        """Return the mean speed in Hz over each whole revolution after the first knot, (whole revolutions,)."""
        first, last = float(self.revolutions[0]), float(self.revolutions[-1])
        span = abs(last - first)
        whole_turns = np.minimum(np.arange(np.floor(span + 1e-9) + 1), span)
        return self.direction / np.diff(self.times_at(first + self.direction * whole_turns, at_rest="departure"))

    def scaled(self, ratio: float) -> ShaftPhase:
        """Return the phase of a shaft that turns `ratio` times as fast, in the opposite direction for `ratio` < 0.

        The standard deviation of its angle is ``abs(ratio)`` times as large; the jitter in time is the same. A ratio of
        zero raises ValueError.
        """
        factor = number(ratio, name="ratio")
        if factor == 0:
            raise ValueError("ratio=0 describes a shaft that does not turn; give a ratio other than zero.")
        return replace(self, revolutions=self.revolutions * factor, stripe_positions_rev=np.zeros(1))


@checked
def constant_speed(speed_hz: float, *, start_s: float, stop_s: float) -> ShaftPhase:
    """Return the phase of a shaft at a declared constant speed, marked as nominal.

    Parameters
    ----------
    speed_hz : float
        Speed in revolutions per second, above zero.
    start_s, stop_s : float
        First and last time in s; the angle is zero at `start_s`.

    Returns
    -------
    ShaftPhase

    Raises
    ------
    ValueError
        A speed that is not positive, times that are not finite, or `stop_s` not after `start_s`.

    Examples
    --------
    >>> from signals import constant_speed
    >>> phase = constant_speed(25.0, start_s=0.0, stop_s=2.0)
    >>> float(phase.revolutions_at([0.5])[0]), phase.nominal
    (12.5, True)
    """
    speed = positive(speed_hz, name="speed_hz")
    if not number(stop_s, name="stop_s") > number(start_s, name="start_s"):
        raise ValueError(f"stop_s={stop_s:g} is not after start_s={start_s:g}; give a later one.")
    return ShaftPhase(
        times_s=np.array([start_s, stop_s], dtype=np.float64),
        revolutions=np.array([0.0, speed * (stop_s - start_s)]),
        nominal=True,
    )
