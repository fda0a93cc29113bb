"""Explicit Runge-Kutta methods with fixed steps."""

from dataclasses import dataclass

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, Outcome
from data_synth.integrate.readings import Readings
from data_synth.integrate.splitting import too_many_cycles
from data_synth.integrate.stepping import Grid, Refusal, Stepper

_MOST_CYCLES = 0.25  # of the mesh to a step: its stiffness is taken at points


@dataclass(frozen=True, kw_only=True)
class RungeKutta4:
    """The classical method of Kutta (1901): four stages, fourth order."""

    @property
    def order(self) -> int:
        """Of its global error."""
        return 4

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Refuse steps beyond ``2 sqrt(2)`` rad of the fastest mode, where oscillations grow."""
        return _explicit_refusal(assembled, step_s, limit=2 * np.sqrt(2))

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Prepare."""
        matrix = np.zeros((4, 4))
        matrix[1, 0] = matrix[2, 1] = 0.5
        matrix[3, 2] = 1.0
        return _Stepper(
            grid=Grid(assembled=readings.assembled, rate_hz=readings.output.rate_hz, per_sample=per_sample),
            readings=readings,
            matrix=matrix,
            weights=np.array([1.0, 2.0, 2.0, 1.0]) / 6,
            nodes=np.array([0.0, 0.5, 0.5, 1.0]),
        )


@dataclass(frozen=True, kw_only=True)
class DormandPrince8:
    """The eighth-order method of Prince and Dormand (1981), as in DOP853: twelve stages."""

    @property
    def order(self) -> int:
        """Of its global error."""
        return 8

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Refuse steps beyond 3 rad of the fastest mode: its real stability limit on oscillations lies near there."""
        return _explicit_refusal(assembled, step_s, limit=3.0)

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Prepare, with the coefficients scipy holds."""
        from scipy.integrate import DOP853  # noqa: PLC0415

        return _Stepper(
            grid=Grid(assembled=readings.assembled, rate_hz=readings.output.rate_hz, per_sample=per_sample),
            readings=readings,
            matrix=np.array(DOP853.A, dtype=np.float64),
            weights=np.array(DOP853.B, dtype=np.float64),
            nodes=np.array(DOP853.C, dtype=np.float64),
        )


def _explicit_refusal(assembled: Assembled, step_s: float, *, limit: float) -> Refusal | None:
    fastest = float(np.sqrt(np.max(assembled.flow.modes.frequencies, initial=0.0) ** 2 + assembled.swing))
    if fastest * step_s > limit:
        return Refusal(
            outcome=Outcome.UNSTABLE_STEP,
            detail=(
                f"A step of {step_s:.3g} s is {fastest * step_s:.3g} rad of the fastest mode, {fastest:.4g} rad/s; "
                f"beyond {limit:.3g} rad an explicit method lets it grow. {limit / fastest:.3g} s would be stable."
            ),
        )
    return too_many_cycles(assembled, step_s, most=_MOST_CYCLES)


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    grid: Grid
    readings: Readings
    matrix: Array
    weights: Array
    nodes: Array

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._march_kernels import runge_kutta_steps  # noqa: PLC0415

        a, read = self.readings.assembled, self.readings
        times_s = self.grid.times(first, samples, stages=self.nodes)
        out = np.empty((samples, read.rows.shape[0]))
        runge_kutta_steps(
            x,
            out,
            read.rows,
            read.constant,
            self.grid.per_sample,
            self.grid.step_s,
            self.matrix,
            self.weights,
            a.equations,
            a.revolutions(times_s),
            a.loads(times_s),
        )
        return out
