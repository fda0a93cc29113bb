"""Jitter of pulses smoothed out of a shaft's angle: a quintic smoothing spline, with its bandwidth and its own error.

The angle is a process of three states, angle, speed and acceleration, whose jerk is white noise; pulses observe its
angle, each with an error of the same standard deviation in time. Its smoother is the quintic smoothing spline of
unequal weights (Wahba 1978; Kohn and Ansley 1987), solved by orthogonal steps from pulse to pulse (Paige and Saunders
1977), which needs no guess of the beginning. Between pulses the smoothed angle is the quintic through the states at
both ends, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals._checks import Array

# the gain of the smoother is 1 / (1 + (f / f0)^6); at this multiple of f0 it is 1 / sqrt(2)
_HALF_POWER = (np.sqrt(2) - 1) ** (1 / 6)
FEWEST_PULSES = 6


@dataclass(frozen=True, kw_only=True)
class PhaseSmoothing:
    """Speed, acceleration and covariances at the knots of a smoothed phase.

    A swing of the angle at frequency f passes with the gain 1 / (1 + 0.414 (f / bandwidth)^6), and without delay:
    at the bandwidth 0.707 (-3 dB), at half of it 0.994, at twice 0.036. One sided: from zero to the bandwidth.
    """

    speed_hz: Array = field(metadata={"dims": ("knot",), "units": "rev s-1"})
    acceleration: Array = field(metadata={"dims": ("knot",), "units": "rev s-2"})
    covariance: Array = field(
        metadata={"dims": ("knot", "state", "state_"), "units": "rev2, with s-1 and s-2 for speed and acceleration"}
    )
    cross_covariance: Array = field(
        metadata={"dims": ("interval", "state", "state_"), "units": "as covariance; of a knot with the next"}
    )
    jerk_density: Array = field(metadata={"dims": ("interval",), "units": "rev2 s-5"})
    bandwidth_hz: Array = field(metadata={"dims": ("knot",), "units": "Hz"})

    def std_rev(self, times_s: Array, *, knots_s: Array) -> Array:
        """Return the standard deviation of the angle in revolutions at `times_s` (m,)."""
        cell = np.clip(np.searchsorted(knots_s, times_s, side="right") - 1, 0, knots_s.size - 2)
        h = knots_s[cell + 1] - knots_s[cell]
        u = (times_s - knots_s[cell]) / h
        left, right = _hermite_weights(u, h), _hermite_weights(1 - u, h)
        right[:, 1] *= -1
        variance = (
            np.einsum("mi,mij,mj->m", left, self.covariance[cell], left)
            + np.einsum("mi,mij,mj->m", right, self.covariance[cell + 1], right)
            + 2 * np.einsum("mi,mij,mj->m", left, self.cross_covariance[cell], right)
            + self.jerk_density[cell] * (u * (1 - u) * h) ** 5 / 20  # of a bridge whose ends are known
        )
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def scaled(self, ratio: float) -> PhaseSmoothing:
        """Return the same of a shaft that turns `ratio` times as fast."""
        return replace(
            self,
            speed_hz=self.speed_hz * ratio,
            acceleration=self.acceleration * ratio,
            covariance=self.covariance * ratio**2,
            cross_covariance=self.cross_covariance * ratio**2,
            jerk_density=self.jerk_density * ratio**2,
        )


def _hermite_weights(u: Array, h: Array) -> Array:
    """Weights (m, 3) of angle, speed and acceleration at the left end, at the fraction `u` of a step `h`."""
    v = 1 - u
    return np.stack([v**3 * (1 + 3 * u + 6 * u**2), h * u * v**3 * (1 + 3 * u), h**2 * u**2 * v**3 / 2], axis=1)


def smooth_phase(
    times: Array, revolutions: Array, *, counts: NDArray[np.int64], bandwidth_hz: Array, jitter_s: float
) -> tuple[Array, PhaseSmoothing, float]:
    """Smooth the angle of one stretch of pulses.

    Parameters
    ----------
    times, revolutions : (n,) arrays
    counts : (n,) array
        Number of each pulse; missing ones leave gaps.
    bandwidth_hz : (n,) array
        Frequency of a swing of the angle that passes at -3 dB, at each pulse.
    jitter_s : float
        Standard deviation of one pulse's time; where it is NaN the residuals tell it.

    Returns
    -------
    (n,) array, PhaseSmoothing, float
        Smoothed revolutions, the states, and the jitter in s.

    Raises
    ------
    ValueError
        Too few pulses, or a bandwidth that their rate cannot show.
    """
    from signals._smoothing_kernels import smooth_states  # noqa: PLC0415 - compiled at need

    if times.size < FEWEST_PULSES:
        raise ValueError(
            f"{times.size} pulses from {times[0]:g} s on are too few to smooth; {FEWEST_PULSES} are needed between "
            "stops. Leave the bandwidth out, or use another part of the record."
        )
    spacing = np.gradient(times, counts)
    if np.any(bandwidth_hz * spacing > 0.5):  # noqa: PLR2004 - Nyquist's
        i = int(np.argmax(bandwidth_hz * spacing))
        raise ValueError(
            f"a bandwidth of {bandwidth_hz[i]:.4g} Hz is more than pulses every {spacing[i]:.3g} s at {times[i]:g} s "
            f"can show, {0.5 / spacing[i]:.4g} Hz; give less, or leave it out for the curve through every pulse."
        )
    speed = np.abs(np.gradient(revolutions, times))
    noise = speed**2  # of a jitter of one second
    density = noise * spacing * (2 * np.pi * bandwidth_hz / _HALF_POWER) ** 6
    density = (density[:-1] + density[1:]) / 2
    unit_s = float(np.median(1 / (2 * np.pi * bandwidth_hz)))
    drift = np.polynomial.Polynomial.fit(times, revolutions, 1)  # kept apart: digits for what is left
    states, covariance, cross, leverage = smooth_states(
        np.diff(times) / unit_s, density * unit_s**5, noise, revolutions - drift(times), _root_of_inverse()
    )
    jitter = jitter_s
    if not np.isfinite(jitter):
        residual = revolutions - drift(times) - states[:, 0]
        freedom = max(times.size - float(leverage.sum()), 1.0)
        jitter = float(np.sqrt(np.sum(residual**2 / noise) / freedom))
    units = np.array([1.0, 1 / unit_s, 1 / unit_s**2])
    smoothing = PhaseSmoothing(
        speed_hz=states[:, 1] * units[1] + drift.deriv()(times),
        acceleration=states[:, 2] * units[2],
        covariance=covariance * np.outer(units, units) * jitter**2,
        cross_covariance=cross * np.outer(units, units) * jitter**2,
        jerk_density=density * jitter**2,
        bandwidth_hz=bandwidth_hz,
    )
    return states[:, 0] + drift(times), smoothing, jitter


def joined(parts: list[PhaseSmoothing]) -> PhaseSmoothing:
    """Return the smoothings of stretches with stops between them as one, nothing known to tie them."""

    def together(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    def with_gaps(name: str) -> Array:
        arrays = [np.asarray(getattr(part, name)) for part in parts]
        gap = np.zeros((1, *arrays[0].shape[1:]))
        return np.concatenate([piece for array in arrays for piece in (array, gap)][:-1])

    return PhaseSmoothing(
        speed_hz=together("speed_hz"),
        acceleration=together("acceleration"),
        covariance=together("covariance"),
        cross_covariance=with_gaps("cross_covariance"),
        jerk_density=with_gaps("jerk_density"),
        bandwidth_hz=together("bandwidth_hz"),
    )


def with_rest(smoothing: PhaseSmoothing, knot: int, half: float) -> PhaseSmoothing:
    """Return the smoothing with two knots of a standstill after `knot`, anywhere within `half` revolutions."""
    place = np.zeros((3, 3))
    place[0, 0] = half**2 / 3
    nothing = np.zeros((3, 3))
    return PhaseSmoothing(
        speed_hz=np.insert(smoothing.speed_hz, knot + 1, [0.0, 0.0]),
        acceleration=np.insert(smoothing.acceleration, knot + 1, [0.0, 0.0]),
        covariance=np.insert(smoothing.covariance, knot + 1, [place, place], axis=0),
        cross_covariance=np.insert(smoothing.cross_covariance, knot + 1, [place, nothing], axis=0),
        jerk_density=np.insert(smoothing.jerk_density, knot + 1, [0.0, 0.0]),
        bandwidth_hz=np.insert(smoothing.bandwidth_hz, knot + 1, smoothing.bandwidth_hz[[knot, knot + 1]]),
    )


def _root_of_inverse() -> Array:
    """B with B' B the inverse of the covariance that unit white jerk leaves after unit time, (3, 3)."""
    unit = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(unit)))
