"""A problem as every integrator sees it: modal coordinates, meshes as rank-one forces on them, tables of phases."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data_synth.integrate._equations import Equations, Integers
from data_synth.integrate._modes import Flow, flow_of, modes_of
from data_synth.integrate._waves import Wave, Waves, tabulated
from data_synth.integrate.problem import Array, Output, Problem, State, TiedTo


@dataclass(frozen=True, kw_only=True)
class Assembled:
    """The equations over x = (scales * y, y'), y the modal displacements of the system with its mean mesh stiffness.

        y'' + D y' + w^2 y = drive + loads(t) - sum_m G_m (k_m f(G_m y - e_m) - kmean_m G_m y) - drags

    Attributes
    ----------
    problem : Problem
    flow : Flow
        Of everything on the left, and the constant load.
    deflections : (meshes, n) array
        G: also how a mesh force pushes modes, for they are mass-normalised.
    stiffnesses, errors : Waves
        Tables over the phase; `error_of` (meshes,) says which error belongs to a mesh, -1 for none.
    backlashes, cycles : (meshes,) arrays
    drags : (drags, n) array
        Velocity rows of what has a quadratic drag, and `drag_factors` (drags,).
    tied : (n,) array
        Revolutions of the reference per modal displacement; of length zero where it turns as prescribed.
    """

    problem: Problem
    flow: Flow
    deflections: Array
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    backlashes: Array
    cycles: Array
    drags: Array
    drag_factors: Array
    tied: Array

    @property
    def size(self) -> int:
        """Degrees of freedom."""
        return int(self.flow.damping.shape[0])

    @cached_property
    def equations(self) -> Equations:
        """The same for compiled code."""
        scaled = self.tied / self.flow.modes.scales if self.tied.size else self.tied
        return Equations(
            generator=self.flow.generator,
            drive=self.flow.drive,
            pushes=np.ascontiguousarray(self.deflections.T),
            seen=np.ascontiguousarray((self.deflections / self.flow.modes.scales).T),
            coupling=np.ascontiguousarray(self.deflections @ self.deflections.T),
            stiffnesses=self.stiffnesses,
            errors=self.errors,
            error_of=self.error_of,
            backlashes=self.backlashes,
            cycles=self.cycles,
            drags=self.drags,
            drag_factors=self.drag_factors,
            tied=np.concatenate([scaled, self.tied]),
        )

    @cached_property
    def swing(self) -> float:
        """Largest ``abs(k - kmean) g M^-1 g`` of any mesh, rad2/s2: what the constant part leaves over."""
        swings = [0.0]
        for number, mesh in enumerate(self.problem.system.meshes):
            values = mesh.stiffness(np.linspace(0, mesh.stiffness.period, 512 * int(mesh.stiffness.period)))
            least = 0.0 if mesh.backlash_m > 0 else np.min(values)
            mean = self.stiffnesses.means[number]
            swings.append(float(max(np.max(values) - mean, mean - least) * self.equations.coupling[number, number]))
        return max(swings)

    def revolutions(self, times_s: Array) -> Array:
        """Return the reference's angle; nothing where it is tied to the motion."""
        turning = self.problem.turning
        return np.zeros(0) if isinstance(turning, TiedTo) else np.ascontiguousarray(turning.revolutions(times_s))

    def loads(self, times_s: Array) -> Array:
        """Return the varying load on each mode (times, n); (0, n) where there is none."""
        varying = self.problem.load.varying
        if varying is None:
            return np.zeros((0, self.size))
        values = np.asarray(varying(times_s), dtype=np.float64)
        if values.shape != (times_s.size, self.size) or not np.all(np.isfinite(values)):
            raise ValueError(
                f"load.varying must return finite forces ({times_s.size}, {self.size}); it returned {values.shape}."
            )
        return np.ascontiguousarray(values @ self.flow.modes.shapes)

    def modal(self, state: State | None) -> Array:
        """Return x of a state, at rest where it is None."""
        if state is None:
            return np.zeros(2 * self.size)
        into = self.flow.modes.shapes.T @ self.problem.system.mass
        return np.concatenate([self.flow.modes.scales * (into @ state.displacement), into @ state.velocity])

    def physical(self, x: Array) -> State:
        """Return the state of x."""
        shapes = self.flow.modes.shapes
        return State(displacement=shapes @ (x[: self.size] / self.flow.modes.scales), velocity=shapes @ x[self.size :])

    def displacement_rows(self, rows: Array) -> Array:
        """Return rows of modal displacements as rows of x."""
        return np.hstack([rows / self.flow.modes.scales, np.zeros_like(rows)])

    def velocity_rows(self, rows: Array) -> Array:
        """Return rows of modal velocities as rows of x."""
        return np.hstack([np.zeros_like(rows), rows])


def assemble(problem: Problem) -> Assembled:
    """Check the matrices and bring the problem into modal coordinates."""
    system, load = problem.system, problem.load
    dof = len(system.names)
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    for name, matrix in (("mass", system.mass), ("damping", damping), ("stiffness", system.stiffness)):
        if matrix.shape != (dof, dof) or not np.all(np.isfinite(matrix)):
            raise ValueError(f"{name} must be a finite ({dof}, {dof}) matrix; it has shape {matrix.shape}.")
        if name != "damping" and not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0):
            raise ValueError(f"{name} is not symmetric; put what circulates into gyroscopic terms or a load.")
    waves = tabulated([Wave(m.stiffness, m.stiffness.period, m.stiffness.jumps) for m in system.meshes])
    directions = np.array([m.direction for m in system.meshes], dtype=np.float64).reshape(-1, dof)
    modes = modes_of(system.mass, system.stiffness + (directions.T * waves.means) @ directions)
    flow = flow_of(modes, damping, load.constant)
    erring = [m.error for m in system.meshes if m.error is not None]
    dragged = np.flatnonzero(load.quadratic_drag if load.quadratic_drag is not None else np.zeros(dof))
    tied = np.zeros((0, dof))
    if isinstance(problem.turning, TiedTo):
        tied = problem.turning.rev_per_unit * np.eye(dof)[[system.names.index(problem.turning.name)]]
    return Assembled(
        problem=problem,
        flow=flow,
        deflections=modes.rows(directions),
        stiffnesses=waves,
        errors=tabulated([Wave(e, e.period) for e in erring]),
        error_of=_numbers([m.error is not None for m in system.meshes]),
        backlashes=np.array([float(m.backlash_m) for m in system.meshes]),
        cycles=np.array([float(m.cycles_per_rev) for m in system.meshes]),
        drags=np.ascontiguousarray(np.eye(dof)[dragged] @ modes.shapes),
        drag_factors=np.asarray(load.quadratic_drag)[dragged] if dragged.size else np.zeros(0),
        tied=np.ascontiguousarray((tied @ modes.shapes).ravel()),
    )


def _numbers(present: list[bool]) -> Integers:
    there = np.array(present, dtype=bool)
    return np.where(there, np.cumsum(there) - 1, -1).astype(np.int64)


@dataclass(frozen=True, kw_only=True)
class Readings:
    """What a stepper reads from x at each sample, and how readings become the channels asked for.

    ``rows`` (readings, 2 n) and ``constant`` (readings,): the channels' linear part, then, where accelerations or
    mesh forces are asked for, the deflections, the dragged velocities and the tied angle.
    """

    assembled: Assembled
    output: Output
    rows: Array
    constant: Array
    forces: Array
    accelerations: Array

    @classmethod
    def of(cls, assembled: Assembled, output: Output) -> "Readings":
        """Prepare the rows."""
        modes, size, channels = assembled.flow.modes, assembled.size, output.channels
        for name, given in output.maps.items():
            width = assembled.backlashes.size if name == "mesh_force" else size
            if given.shape != (channels, width) or not np.all(np.isfinite(given)):
                raise ValueError(f"output.{name} must be finite ({channels}, {width}); its shape is {given.shape}.")
        rows, constant = np.zeros((channels, 2 * size)), np.zeros(channels)
        accelerations = np.zeros((channels, size))
        if output.displacement is not None:
            rows += assembled.displacement_rows(modes.rows(output.displacement))
        if output.velocity is not None:
            rows += assembled.velocity_rows(output.velocity @ modes.shapes)
        if output.acceleration is not None:
            accelerations = output.acceleration @ modes.shapes
            rows += accelerations @ assembled.flow.generator[size:]
            constant += accelerations @ assembled.flow.drive[size:]
        forces = np.zeros((channels, assembled.backlashes.size)) if output.mesh_force is None else output.mesh_force
        if output.acceleration is not None or output.mesh_force is not None:
            further = [
                assembled.displacement_rows(assembled.deflections),
                assembled.velocity_rows(assembled.drags),
                assembled.displacement_rows(assembled.tied.reshape(-1, size)),
            ]
            rows = np.vstack([rows, *further])
        constant = np.concatenate([constant, np.zeros(rows.shape[0] - channels)])
        return cls(
            assembled=assembled,
            output=output,
            rows=np.ascontiguousarray(rows),
            constant=constant,
            forces=forces,
            accelerations=accelerations,
        )

    def channels(self, readings: Array, times_s: Array) -> Array:
        """Return the channels (times, channels) of readings (times, readings)."""
        count = self.output.channels
        if readings.shape[1] == count:
            return readings
        a = self.assembled
        meshes, drags = a.backlashes.size, a.drag_factors.size
        values, deflections = readings[:, :count].copy(), readings[:, count : count + meshes]
        speeds = readings[:, count + meshes : count + meshes + drags]
        revolutions = readings[:, -1] if a.tied.size else a.revolutions(times_s)
        force = _mesh_forces(a, deflections, revolutions)
        extra = force - a.stiffnesses.means * deflections
        values += force @ self.forces.T - extra @ (self.accelerations @ a.deflections.T).T
        values -= (a.drag_factors * speeds * np.abs(speeds)) @ (self.accelerations @ a.drags.T).T
        loads = a.loads(times_s)
        return np.asarray(values + loads @ self.accelerations.T if loads.size else values)


def _mesh_forces(a: Assembled, deflections: Array, revolutions: Array) -> Array:
    """Return ``k f(delta - e)`` (times, meshes)."""
    forces = np.empty_like(deflections)
    for number, mesh in enumerate(a.problem.system.meshes):
        phase = mesh.cycles_per_rev * revolutions
        pressed = deflections[:, number] - (0.0 if mesh.error is None else mesh.error(phase))
        apart = pressed - np.clip(pressed, -mesh.backlash_m, mesh.backlash_m)
        forces[:, number] = mesh.stiffness(phase) * apart
    return forces
