"""Exponential splitting: the general integrator, with or without backlash."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from data_synth.integrators.method import Grid, Readings, Refusal, Stepper
from data_synth.integrators.problem import Array, Outcome

if TYPE_CHECKING:
    from data_synth.integrators._splitting_kernels import StepFlow
    from data_synth.integrators.modal_problem import Assembled

_MAX_IMPULSE = 4.0  # rad2: of variation * step^2; impulses on a harmonic oscillator are unstable beyond
_MAX_CYCLES = 1.0  # mesh cycles to a step
_WIDTH = 8  # numbers that processors take at once, at most


@dataclass(frozen=True, kw_only=True)
class Splitting:
    """Exponential splitting: exact flow with mean mesh stiffness, and impulses by the variation of the meshes.

    Fourth order where motion is smooth: impulses by Simpson's rule, the middle one with the commutator of Chin (1997,
    Phys. Lett. A 226, 344, scheme A), here for a stiffness that varies within the step, with its moments in place of
    its samples. So jumps and high harmonics of the stiffness need no small steps, and a step has to resolve the modes
    that meshes excite, not the stiffest ones. Transmission errors of teeth in contact and loads that vary act in the
    exact flow, a parabola over each step: however large, they need no finer steps. Over a step in which an error jumps
    the parabola has its moments, and impulses have those of stiffness times error. Without damping and load it is
    symplectic: energy does not drift.

    Where teeth lose contact the force has kinks: the order falls to two, and each contact changes the energy a little,
    up or down: over 10,000 oscillations of 100 steps each it stayed within 1.2e-3, without a trend. A quadratic drag
    brings a small error of second order. Modes that rotate by more than a radian in a step leave the slow ones right
    (tried with bearings up to 1e16 N/m), but their own share of a velocity or an acceleration is not resolved:
    `integrate` refuses where a channel shows it.

    Examples
    --------
    An oscillator of 2 rad/s released from 1 m is at ``cos 2 t``, here with an error bound of 1e-6:

    >>> import numpy as np
    >>> from data_synth.dynamics import Accuracy, Load, Output, Problem, ShaftAngle, Splitting, State, System, integrate
    >>> one = np.eye(1)
    >>> system = System(mass=one, damping=0 * one, stiffness=4 * one, meshes=(), names=("mass x",))
    >>> problem = Problem(
    ...     system=system,
    ...     reference=ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1)),
    ...     load=Load(constant=np.zeros(1)),
    ...     duration_s=5.0,
    ...     start=State(displacement=np.ones(1), velocity=np.zeros(1)),
    ... )
    >>> output = Output(rate_hz=10.0, displacement=one)
    >>> found = integrate(problem, method=Splitting(), output=output, tolerance=Accuracy(relative=1e-6))
    >>> bool(np.allclose(found.values[:, 0], np.cos(2 * found.times_s), atol=1e-6))
    True
    """

    @property
    def order(self) -> int:
        """Order of the global error in the step size."""
        return 4

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Return why a step size is unstable or too coarse for the meshes; None where it is neither."""
        variation = assembled.stiffness_variation
        impulse = variation * step_s**2
        if impulse >= _MAX_IMPULSE:
            return Refusal(
                outcome=Outcome.UNSTABLE_STEP,
                detail=(
                    f"A step of {step_s:.3g} s is unstable: the variation of the mesh stiffness over the mass, "
                    f"{variation:.4g} rad2/s2, times its square is {impulse:.3g}, and must stay below "
                    f"{_MAX_IMPULSE:g}; steps up to {np.sqrt(_MAX_IMPULSE / variation):.3g} s are stable."
                ),
            )
        return too_many_cycles(assembled, step_s, max_cycles=_MAX_CYCLES)

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Return the stepper, with the exact flow over a step."""
        assembled = readings.assembled
        grid = Grid(assembled=assembled, rate_hz=readings.output.rate_hz, per_sample=per_sample)
        return _Stepper(
            readings=readings,
            grid=grid,
            flow=_flow_over(assembled, grid.step_s),
            coupled_speed=np.full(1, np.nan),
            next_weighted=np.full(assembled.backlashes.size, np.nan),
        )


def _flow_over(assembled: Assembled, step_s: float) -> StepFlow:
    """Return the flow over a step."""
    from data_synth.integrators._splitting_kernels import StepFlow  # noqa: PLC0415

    n, equations, drags = assembled.size, assembled.equations, assembled.drags
    flow = assembled.flow_from_contact
    (middle, in_middle), (whole, at_end) = flow.over(step_s / 2), flow.over(step_s)
    deflections = assembled.displacement_rows(assembled.deflections[assembled.mesh_of_force])
    read = np.vstack([deflections, assembled.velocity_rows(drags)])
    directions = np.vstack([equations.force_columns.T, drags])
    matrix = np.vstack([whole, deflections @ whole, read @ middle])
    input_at_end, input_in_middle = _input_columns(assembled, step_s)
    by_input = np.vstack([input_at_end, deflections @ input_at_end, read @ input_in_middle])
    matrix = np.hstack([matrix, matrix[:, n:] @ directions.T, by_input])
    from_middle = directions @ np.vstack([middle, deflections @ middle])[:, n:].T
    added = np.concatenate([at_end, deflections @ at_end, read @ in_middle])
    width, columns = matrix.shape
    return StepFlow(
        columns=np.ascontiguousarray(np.pad(matrix, ((0, -width % _WIDTH), (0, columns % 2))).T),
        added=np.pad(added, (0, -width % _WIDTH)),
        directions=np.ascontiguousarray(directions),
        from_middle=np.pad(from_middle, ((0, -directions.shape[0] % 4), (0, 0))),
        speed_changes=np.ascontiguousarray(drags @ directions.T),
    )


def _input_columns(assembled: Assembled, step_s: float) -> tuple[Array, Array]:
    """Return what inputs add to x at the end and in the middle of a step, each (2 n, 3 inputs).

    Inputs are the transmission error of each force, zero for friction, then the varying loads. One is the parabola
    through its values at beginning, middle and end, ``q0 + q1 t + q2 t^2 / 2`` with t from 0 to 1: by the exponential
    of x' with q0, q1 and q2 as further states, q0' = q1 and q1' = q2.
    """
    x, frictions = 2 * assembled.size, assembled.friction_rows.shape[0]
    following = assembled.deflections.T * (assembled.means * assembled.following)
    forces = np.hstack([following, np.zeros((x // 2, frictions)), assembled.load_rows.T])
    each = np.eye(forces.shape[1])
    generator = np.zeros((x + 3 * each.shape[0], x + 3 * each.shape[0]))
    generator[:x, :x] = assembled.flow.generator
    generator[x // 2 : x, x::3] = forces
    generator[x:, x:] = np.kron(each, np.eye(3, k=1)) / step_s
    from_nodes = np.kron(each, [[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [4.0, -8.0, 4.0]])
    half = linalg.expm(generator * (step_s / 2))
    return (half @ half)[:x, x:] @ from_nodes, half[:x, x:] @ from_nodes


def too_many_cycles(assembled: Assembled, step_s: float, *, max_cycles: float) -> Refusal | None:
    """Return why a step spans too many mesh cycles at the top speed; None for a reference coupled to the motion."""
    problem = assembled.problem
    revolutions = assembled.revolutions(problem.start_s + np.linspace(0, problem.duration_s, 257))
    if not revolutions.size or not assembled.cycles.size:
        return None
    per_step = float(
        np.max(np.abs(np.diff(revolutions))) * 256 / problem.duration_s * np.max(assembled.cycles) * step_s
    )
    if per_step <= max_cycles:
        return None
    return Refusal(
        outcome=Outcome.UNRESOLVED_STEP,
        detail=f"A step of {step_s:.3g} s spans {per_step:.3g} mesh cycles, and must not exceed {max_cycles:g}.",
    )


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    readings: Readings
    grid: Grid
    flow: StepFlow
    coupled_speed: Array  # of the reference one step ago, and ...
    next_weighted: Array  # ... the part of the next weighted mesh forces that is known: state of the stepper beside x

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Integrate over samples; see `Stepper.advance`."""
        from data_synth.integrators._splitting_kernels import split_steps  # noqa: PLC0415

        a, read = self.readings.assembled, self.readings
        if a.reference_row.size and np.isnan(self.coupled_speed[0]):
            self.coupled_speed[0] = a.reference_row @ x[a.size :]
        out = np.empty((samples, read.rows.shape[0]))
        weighted = read.output.weighted_mesh_force is not None
        forces = np.zeros((samples if weighted else 0, 2 * a.backlashes.size))
        edges = self.grid.edges(first, samples)
        if weighted and np.isnan(self.next_weighted).any():
            self.next_weighted[:] = read.at(x, float(edges[0]))[0, -a.backlashes.size :] / 2
        loads = np.zeros((0, a.load_rows.shape[0]))
        if a.problem.load.varying is not None:
            loads = a.loads(np.linspace(edges[0], edges[-1], 2 * edges.size - 1))
        split_steps(
            x,
            out,
            read.rows,
            read.constant,
            self.grid.per_sample,
            self.grid.step_s,
            self.flow,
            a.equations,
            self.coupled_speed,
            a.revolutions(edges),
            loads,
            a.history_positions(edges[:-1] + self.grid.step_s / 2),
            forces,
            self.next_weighted,
        )
        return np.hstack([out, forces]) if weighted else out
