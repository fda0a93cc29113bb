"""Newmark's method and its generalisation with damping of what steps cannot resolve."""

from dataclasses import dataclass

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array
from data_synth.integrate.readings import Readings
from data_synth.integrate.splitting import too_many_cycles
from data_synth.integrate.stepping import Grid, Refusal, Stepper

_MOST_CYCLES = 0.25


@dataclass(frozen=True, kw_only=True)
class GeneralisedAlpha:
    """Implicit, second order, stable at any step (Chung and Hulbert 1993, J. Appl. Mech. 60, 371).

    ``spectral_radius`` is what is left per step of what is far too fast for it: 1 damps nothing, 0 removes it. `None`
    is Newmark's method of constant average acceleration, ``beta = 1/4, gamma = 1/2``.
    """

    spectral_radius: float | None = None

    def __post_init__(self) -> None:
        if self.spectral_radius is not None and not 0 <= self.spectral_radius <= 1:
            raise ValueError(f"spectral_radius={self.spectral_radius} must lie between 0 and 1.")

    @property
    def order(self) -> int:
        """Of its global error."""
        return 2

    @property
    def coefficients(self) -> tuple[float, float, float, float]:
        """alpha_m, alpha_f, beta, gamma: eqs 17, 20 and 25 of the paper."""
        if self.spectral_radius is None:
            return 0.0, 0.0, 0.25, 0.5
        rho = self.spectral_radius
        alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        return alpha_m, alpha_f, (1 - alpha_m + alpha_f) ** 2 / 4, 0.5 - alpha_m + alpha_f

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Refuse steps that jump over mesh cycles."""
        return too_many_cycles(assembled, step_s, most=_MOST_CYCLES)

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Invert the matrix of a step."""
        a = readings.assembled
        if a.tied.size:
            raise ValueError("GeneralisedAlpha takes no reference that is tied to the motion; use Splitting.")
        grid = Grid(assembled=a, rate_hz=readings.output.rate_hz, per_sample=per_sample)
        alpha_m, alpha_f, beta, gamma = self.coefficients
        squares, h = a.flow.modes.frequencies**2, grid.step_s
        matrix = (1 - alpha_m) * np.eye(a.size) + (1 - alpha_f) * (
            gamma * h * a.flow.damping + beta * h * h * np.diag(squares)
        )
        return _Stepper(
            grid=grid,
            readings=readings,
            coefficients=self.coefficients,
            inverse=np.ascontiguousarray(np.linalg.inv(matrix)),
            acceleration=np.full(a.size, np.nan),
        )


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    grid: Grid
    readings: Readings
    coefficients: tuple[float, float, float, float]
    inverse: Array
    acceleration: Array

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._march_kernels import alpha_steps  # noqa: PLC0415

        a, read = self.readings.assembled, self.readings
        times_s = self.grid.edges(first, samples)
        turns, loads = a.revolutions(times_s), a.loads(times_s)
        if np.isnan(self.acceleration[0]):
            self.acceleration[:] = _initial(a, x, turns[0], loads)
        out = np.empty((samples, read.rows.shape[0]))
        alpha_steps(
            x,
            self.acceleration,
            out,
            read.rows,
            read.constant,
            self.grid.per_sample,
            self.grid.step_s,
            self.coefficients,
            self.inverse,
            a.flow.damping,
            a.flow.modes.scales,
            a.flow.modes.frequencies**2,
            a.equations,
            turns,
            loads,
        )
        return out


def _initial(a: Assembled, x: Array, turns: float, loads: Array) -> Array:
    """Return the acceleration the equations ask for at the start."""
    from data_synth.integrate._march_kernels import rates  # noqa: PLC0415

    out = np.empty_like(x)
    rates(x, out, a.equations, turns, loads[0] if loads.size else np.zeros(0))
    return out[a.size :]
