"""Exponential splitting: the general engine, linear or with backlash."""

from dataclasses import dataclass

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, Outcome
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid, Refusal, Stepper

_LARGEST_KICK = 4.0  # rad2: of swing * step^2; the kicks of a harmonic oscillator are unstable beyond
_MOST_CYCLES = 1.0  # mesh cycles to a step


@dataclass(frozen=True, kw_only=True)
class Splitting:
    """Exact flow of the constant part with the mean mesh stiffnesses; what is left of the meshes kicks velocities.

    Fourth order where motion is smooth: kicks by Simpson's rule, the middle one with the commutator of Chin (1997,
    Phys. Lett. A 226, 344, scheme A), here for a stiffness that varies within the step, with its moments in place of
    its samples. So jumps and high harmonics of the stiffness cost nothing, and a step has to resolve the modes that
    meshes swing, not the stiffest ones. With nothing but meshes acting it is symplectic: energy does not drift.

    Where teeth part and meet the force has kinks: the order falls to two, and each contact changes the energy a little,
    up or down: over 10,000 oscillations of 100 steps each it stayed within 1.1e-3, without a trend. A quadratic load
    brings a small error of second order. Modes that turn by more than a radian a step leave the slow ones right (tried
    with bearings up to 1e16 N/m), but their own share of a velocity or an acceleration is not resolved: `integrate`
    refuses where a channel shows it.
    """

    @property
    def order(self) -> int:
        """Of its global error."""
        return 4

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Refuse kicks that would be unstable."""
        kick = assembled.swing * step_s**2
        if kick >= _LARGEST_KICK:
            return Refusal(
                outcome=Outcome.UNSTABLE_STEP,
                detail=(
                    f"A step of {step_s:.3g} s kicks too hard: the swing of the mesh stiffness, "
                    f"{assembled.swing:.4g} rad2/s2, times its square is {kick:.3g}, and must stay below "
                    f"{_LARGEST_KICK:g}; steps up to {np.sqrt(_LARGEST_KICK / assembled.swing):.3g} s are stable."
                ),
            )
        return too_many_cycles(assembled, step_s, most=_MOST_CYCLES)

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Prepare the flow over half a step."""
        assembled = readings.assembled
        grid = Grid(assembled=assembled, rate_hz=readings.output.rate_hz, per_sample=per_sample)
        propagator, added = assembled.flow.over(grid.step_s / 2)
        half = np.vstack([propagator.T, added])
        if assembled.flow.classical:
            i, v = np.arange(assembled.size), np.arange(assembled.size) + assembled.size
            blocks = (propagator[i, i], propagator[i, v], propagator[v, i], propagator[v, v])
            half = np.column_stack([*blocks, added[i], added[v]])
        return _Stepper(
            readings=readings,
            grid=grid,
            half=np.ascontiguousarray(half),
            tied_speed=np.full(1, np.nan),
            coming=np.full(assembled.backlashes.size, np.nan),
        )


def too_many_cycles(assembled: Assembled, step_s: float, *, most: float) -> Refusal | None:
    """Refuse steps over more than `most` mesh cycles, at the fastest the reference turns; what is tied is not known."""
    problem = assembled.problem
    turns = assembled.revolutions(problem.start_s + np.linspace(0, problem.duration_s, 257))
    if not turns.size or not assembled.cycles.size:
        return None
    per_step = float(np.max(np.abs(np.diff(turns))) * 256 / problem.duration_s * np.max(assembled.cycles) * step_s)
    if per_step <= most:
        return None
    return Refusal(
        outcome=Outcome.UNRESOLVED_STEP,
        detail=f"A step of {step_s:.3g} s spans {per_step:.3g} mesh cycles, and must not exceed {most:g}.",
    )


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    readings: Readings
    grid: Grid
    half: Array
    tied_speed: Array  # of the reference one step ago: what a stepper remembers beside x, and ...
    coming: Array  # ... what mesh forces add to the next hat

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._splitting_kernels import split_steps  # noqa: PLC0415

        a, read = self.readings.assembled, self.readings
        if a.tied.size and np.isnan(self.tied_speed[0]):
            self.tied_speed[0] = a.tied @ x[a.size :]
        out = np.empty((samples, read.rows.shape[0]))
        listening = read.output.hat_mesh_force is not None
        felt = np.zeros((samples if listening else 0, 2 * a.backlashes.size))
        edges = self.grid.edges(first, samples)
        if listening and np.isnan(self.coming).any():
            self.coming[:] = read.at(x, float(edges[0]))[0, -a.backlashes.size :] / 2
        loads = np.zeros((0, a.size))
        if a.problem.load.varying is not None:
            loads = a.loads(np.linspace(edges[0], edges[-1], 2 * edges.size - 1))
        split_steps(
            x,
            out,
            read.rows,
            read.constant,
            self.grid.per_sample,
            self.grid.step_s,
            a.flow.classical,
            self.half,
            a.equations,
            self.tied_speed,
            a.revolutions(edges),
            loads,
            a.stages(edges[:-1] + self.grid.step_s / 2),
            felt,
            self.coming,
        )
        return np.hstack([out, felt]) if listening else out
