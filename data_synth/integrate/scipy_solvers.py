"""scipy's adaptive solvers on the same equations: slow, general, and written by others, so an oracle."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid, Refusal, Stepper


@dataclass(frozen=True, kw_only=True)
class ScipySolver:
    """`scipy.integrate.solve_ivp` over modal coordinates, from sample to sample of the output.

    It knows nothing of jumps, backlash or mesh cycles, and finds its way by making its steps smaller.
    """

    name: Literal["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"] = "DOP853"
    relative: float = 1e-9
    absolute: float = 1e-12

    @property
    def order(self) -> int | None:
        """None: its steps follow from its tolerances."""
        return None

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:  # noqa: ARG002
        """Refuse nothing: its steps are its own."""
        return None

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:  # noqa: ARG002
        """Prepare."""
        grid = Grid(assembled=readings.assembled, rate_hz=readings.output.rate_hz, per_sample=1)
        return _Stepper(grid=grid, readings=readings, solver=self)


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    grid: Grid
    readings: Readings
    solver: ScipySolver

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from scipy.integrate import solve_ivp  # noqa: PLC0415

        a = self.readings.assembled
        times_s = self.grid.edges(first, samples)
        longest = 0.25 / self._fastest(times_s)
        found = solve_ivp(
            lambda t, y: self._rates(a, t, y),
            (times_s[0], times_s[-1]),
            x,
            method=self.solver.name,
            t_eval=times_s[1:],
            rtol=self.solver.relative,
            atol=self.solver.absolute,
            max_step=longest,
        )
        if not found.success:
            raise ArithmeticError(f"scipy's {self.solver.name} gave up: {found.message}")
        x[:] = found.y[:, -1]
        return np.asarray(found.y.T @ self.readings.rows.T + self.readings.constant)

    def _fastest(self, times_s: Array) -> float:
        """Return mesh cycles per second, at least one to the stretch: no solver may step over a whole cycle unseen."""
        a, stretch = self.readings.assembled, float(times_s[-1] - times_s[0])
        turns = a.revolutions(times_s)
        speed = float(np.max(np.abs(np.diff(turns)), initial=0.0)) * self.readings.output.rate_hz
        return max(speed * float(np.max(a.cycles, initial=0.0)), 1 / stretch)

    @staticmethod
    def _rates(a: Assembled, t: float, x: Array) -> Array:
        size = a.size
        at = np.array([t])
        y = x[:size] / a.flow.modes.scales
        turns = float(a.tied @ y) if a.tied.size else float(a.revolutions(at)[0])
        out = np.asarray(a.flow.generator @ x + a.flow.drive)
        for number, mesh in enumerate(a.problem.system.meshes):
            delta = float(a.deflections[number] @ y)
            phase = mesh.cycles_per_rev * turns
            pressed = delta - (0.0 if mesh.error is None else float(mesh.error(phase)))
            apart = pressed - min(max(pressed, -mesh.backlash_m), mesh.backlash_m)
            force = float(mesh.stiffness(phase)) * apart - a.stiffnesses.means[number] * delta
            out[size:] -= a.deflections[number] * force
            pressing = float(mesh.stiffness(phase)) * (max(apart, 0.0) if mesh.backlash_m > 0 else apart)
            for rub, push in zip(mesh.friction, a.rubbing[a.rubs_in == number], strict=True):
                out[size:] += push * (pressing * float(rub.share(phase)))
        for row, factor in zip(a.drags, a.drag_factors, strict=True):
            speed = row @ x[size:]
            out[size:] -= row * factor * speed * abs(speed)
        if a.problem.load.varying is not None:
            out[size:] += a.loads(at)[0]
        return out
