"""Smoothing of a shaft's angle against pulse jitter: a quintic smoothing spline with its standard deviation.

The state is angle, speed and acceleration, driven by white jerk; each pulse measures the angle, with a jitter of the
same standard deviation in time. The smoother of this model is the quintic smoothing spline with unequal weights (Wahba
1978; Kohn and Ansley 1987). It is computed by a square-root information smoother (Paige and Saunders 1977) with a
diffuse prior. Between pulses the smoothed angle is the quintic Hermite polynomial through the states at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals._validation import Array

# the gain of the smoother is 1 / (1 + (f / f0)^6), which is 1 / sqrt(2) at this multiple of f0
_LEAST_CYCLES = 1e-3  # of the bandwidth in the record: below, the curve is a parabola to rounding
_HALF_POWER = (np.sqrt(2) - 1) ** (1 / 6)
FEWEST_PULSES = 6


@dataclass(frozen=True, kw_only=True)
class PhaseSmoothing:
    """Smoothed speed and acceleration at the knots of a phase, with the covariances of the states.

    The gain for an angle fluctuation of frequency f is ``1 / (1 + 0.414 (f / bandwidth)^6)``, without delay: 0.994 at
    half the bandwidth, 0.707 (-3 dB) at the bandwidth, 0.036 at twice it.

    Attributes
    ----------
    speed_hz, acceleration : (knot,) arrays
        Speed in rev/s and acceleration in rev/s^2.
    covariance : (knot, 3, 3) array
        Covariance of angle, speed and acceleration, in rev^2, rev^2/s ...
    cross_covariance : (interval, 3, 3) array
        Covariance of the state at a knot with that at the next.
    jerk_density : (interval,) array
        Spectral density of the jerk in rev^2/s^5.
    bandwidth_hz : (knot,) array
        One-sided -3 dB bandwidth in Hz.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import shaft_phase
    >>> times = 0.1 * np.arange(100) + 1e-5 * np.random.default_rng(1).standard_normal(100)
    >>> phase = shaft_phase(times, bandwidth_hz=1.0)
    >>> round(float(phase.smoothing.speed_hz[50]), 3), float(phase.smoothing.bandwidth_hz[50])
    (10.0, 1.0)
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
            + self.jerk_density[cell] * (u * (1 - u) * h) ** 5 / 20  # process noise given both end states
        )
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def scaled(self, ratio: float) -> PhaseSmoothing:
        """Return the smoothing of a shaft that turns `ratio` times as fast."""
        return replace(
            self,
            speed_hz=self.speed_hz * ratio,
            acceleration=self.acceleration * ratio,
            covariance=self.covariance * ratio**2,
            cross_covariance=self.cross_covariance * ratio**2,
            jerk_density=self.jerk_density * ratio**2,
        )


def _hermite_weights(u: Array, h: Array) -> Array:
    """Return quintic Hermite weights (m, 3) of angle, speed, acceleration at the left end, at fraction `u` of `h`."""
    v = 1 - u
    return np.stack([v**3 * (1 + 3 * u + 6 * u**2), h * u * v**3 * (1 + 3 * u), h**2 * u**2 * v**3 / 2], axis=1)


def smooth_phase(
    times: Array, revolutions: Array, *, counts: NDArray[np.int64], bandwidth_hz: Array, jitter_s: float
) -> tuple[Array, PhaseSmoothing, float]:
    """Smooth the angle of the pulses between two stops.

    Parameters
    ----------
    times, revolutions : (n,) arrays
        Times in s and measured angles.
    counts : (n,) array
        Number of each pulse, not consecutive where pulses are missing.
    bandwidth_hz : (n,) array
        -3 dB bandwidth at each pulse in Hz.
    jitter_s : float
        Standard deviation of one pulse time in s; if NaN it is estimated from the residuals.

    Returns
    -------
    (n,) array, PhaseSmoothing, float
        Smoothed revolutions, the states, and the jitter in s.

    Raises
    ------
    ValueError
        Too few pulses, or a bandwidth above half their rate.
    """
    from signals.shaft._phase_smoothing_kernels import smooth_states  # noqa: PLC0415 - compiled at need

    if times.size < FEWEST_PULSES:
        raise ValueError(
            f"{times.size} pulses from {times[0]:g} s on are too few to smooth; {FEWEST_PULSES} are needed between "
            "stops. Leave the bandwidth out, or use another part of the record."
        )
    spacing = np.gradient(times, counts)
    if np.min(bandwidth_hz) * (times[-1] - times[0]) < _LEAST_CYCLES:
        raise ValueError(
            f"a bandwidth of {np.min(bandwidth_hz):.4g} Hz is far below what {times[-1] - times[0]:.4g} s of pulses "
            f"can show; give {_LEAST_CYCLES / (times[-1] - times[0]):.3g} Hz or more, or declare a constant speed."
        )
    if np.any(bandwidth_hz * spacing > 0.5):  # noqa: PLR2004 - Nyquist's
        i = int(np.argmax(bandwidth_hz * spacing))
        raise ValueError(
            f"a bandwidth of {bandwidth_hz[i]:.4g} Hz is more than pulses every {spacing[i]:.3g} s at {times[i]:g} s "
            f"can show, {0.5 / spacing[i]:.4g} Hz; give less, or leave it out for the curve through every pulse."
        )
    speed = np.abs(np.gradient(revolutions, times))
    noise = speed**2  # variance of the angle for a jitter of one second
    density = noise * spacing * (2 * np.pi * bandwidth_hz / _HALF_POWER) ** 6
    density = (density[:-1] + density[1:]) / 2
    unit_s = float(np.median(1 / (2 * np.pi * bandwidth_hz)))
    trend = np.polynomial.Polynomial.fit(times, revolutions, 1)  # subtracted to keep digits
    states, covariance, cross, leverage = smooth_states(
        np.diff(times) / unit_s, density * unit_s**5, noise, revolutions - trend(times), _information_root()
    )
    jitter = jitter_s
    if not np.isfinite(jitter):
        residual = revolutions - trend(times) - states[:, 0]
        degrees = max(times.size - float(leverage.sum()), 1.0)
        jitter = float(np.sqrt(np.sum(residual**2 / noise) / degrees))
    units = np.array([1.0, 1 / unit_s, 1 / unit_s**2])
    smoothing = PhaseSmoothing(
        speed_hz=states[:, 1] * units[1] + trend.deriv()(times),
        acceleration=states[:, 2] * units[2],
        covariance=covariance * np.outer(units, units) * jitter**2,
        cross_covariance=cross * np.outer(units, units) * jitter**2,
        jerk_density=density * jitter**2,
        bandwidth_hz=bandwidth_hz,
    )
    return states[:, 0] + trend(times), smoothing, jitter


def joined(parts: list[PhaseSmoothing]) -> PhaseSmoothing:
    """Concatenate smoothings of consecutive stretches, without covariance across the stops between them."""

    def concatenated(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    def with_gaps(name: str) -> Array:
        arrays = [np.asarray(getattr(part, name)) for part in parts]
        gap = np.zeros((1, *arrays[0].shape[1:]))
        return np.concatenate([piece for array in arrays for piece in (array, gap)][:-1])

    return PhaseSmoothing(
        speed_hz=concatenated("speed_hz"),
        acceleration=concatenated("acceleration"),
        covariance=concatenated("covariance"),
        cross_covariance=with_gaps("cross_covariance"),
        jerk_density=with_gaps("jerk_density"),
        bandwidth_hz=concatenated("bandwidth_hz"),
    )


def with_rest(smoothing: PhaseSmoothing, knot: int, half: float) -> PhaseSmoothing:
    """Return the smoothing with a standstill of two knots after `knot`, at an angle uniform within +- `half` rev."""
    at_rest = np.zeros((3, 3))
    at_rest[0, 0] = half**2 / 3  # variance of the uniform distribution
    zero = np.zeros((3, 3))
    return PhaseSmoothing(
        speed_hz=np.insert(smoothing.speed_hz, knot + 1, [0.0, 0.0]),
        acceleration=np.insert(smoothing.acceleration, knot + 1, [0.0, 0.0]),
        covariance=np.insert(smoothing.covariance, knot + 1, [at_rest, at_rest], axis=0),
        cross_covariance=np.insert(smoothing.cross_covariance, knot + 1, [at_rest, zero], axis=0),
        jerk_density=np.insert(smoothing.jerk_density, knot + 1, [0.0, 0.0]),
        bandwidth_hz=np.insert(smoothing.bandwidth_hz, knot + 1, smoothing.bandwidth_hz[[knot, knot + 1]]),
    )


def _information_root() -> Array:
    """Return B with B' B the inverse of the process-noise covariance of unit white jerk over unit time, (3, 3)."""
    unit = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(unit)))
