"""A problem as every integrator sees it: modal coordinates, meshes as rank-one forces on them, tables of phases."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from data_synth.integrate._equations import Equations, Integers
from data_synth.integrate._modes import Flow, flow_of, modes_of
from data_synth.integrate._waves import Wave, Waves, tabulated
from data_synth.integrate.problem import Array, CoupledReference, Problem, State
from data_synth.mechanics import Mesh, PhaseFunction
from data_synth.mesh import Stiffness


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
    rubbing : (rubbing, n) array
        How what rubs pushes modes; `rubs_in` (rubbing,) says in which mesh.
    stiffnesses, errors : Waves
        Tables over the phase, of one stiffness for each mesh, of stiffness times share for each force that rubs, then
        further ones of what changes in time; `error_of` (meshes,) says which error belongs to a mesh, `stiffness_later`
        (meshes and rubbing,) and `error_later` (meshes,) which is the second of its course, -1 for none.
    backlashes, cycles : (meshes,) arrays
    drags : (drags, n) array
        Velocity rows of what has a quadratic drag, and `drag_factors` (drags,).
    tied : (n,) array
        Revolutions of the reference per modal displacement; of length zero where it turns as prescribed.
    """

    problem: Problem
    flow: Flow
    deflections: Array
    rubbing: Array
    rubs_in: Integers
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    stiffness_later: Integers
    error_later: Integers
    backlashes: Array
    cycles: Array
    drags: Array
    drag_factors: Array
    tied: Array

    @property
    def means(self) -> Array:
        """Mean stiffnesses (meshes,) of the constant part, N/m."""
        return self.stiffnesses.means[: self.backlashes.size]

    @property
    def size(self) -> int:
        """Degrees of freedom."""
        return int(self.flow.damping.shape[0])

    @cached_property
    def equations(self) -> Equations:
        """The same for compiled code."""
        scaled = self.tied / self.flow.modes.scales if self.tied.size else self.tied
        of, none = self.forces_of, np.zeros(self.rubs_in.size)
        seen, pushes = self.deflections[of], np.vstack([self.deflections, -self.rubbing])
        return Equations(
            pushes=np.ascontiguousarray(pushes.T),
            seen=np.ascontiguousarray((seen / self.flow.modes.scales).T),
            coupling=np.ascontiguousarray(seen @ pushes.T),
            stiffnesses=self.stiffnesses,
            errors=self.errors,
            error_of=self.error_of[of],
            held=np.concatenate([self.means, none]),
            backlashes=self.backlashes[of],
            backs=np.concatenate([self.backlashes, none + np.inf]),
            cycles=self.cycles[of],
            drags=self.drags,
            drag_factors=self.drag_factors,
            tied=np.concatenate([scaled, self.tied]),
            stiffness_later=self.stiffness_later,
            error_later=self.error_later[of],
        )

    @property
    def forces_of(self) -> Integers:
        """The mesh of each force: of every mesh its own, then of what rubs."""
        return np.concatenate([np.arange(self.backlashes.size), self.rubs_in])

    @cached_property
    def stiffness_variation(self) -> float:
        """Largest ``abs(k - kmean) g M^-1 g`` of any mesh, rad2/s2: what the constant part leaves over."""
        swings, across = [0.0], np.abs(np.diag(self.equations.coupling))
        for number, mesh in enumerate(self.problem.system.meshes):
            phases = np.linspace(0, mesh.stiffness.period, 512 * int(mesh.stiffness.period))
            ends = (
                (mesh.stiffness,)
                if mesh.history is None
                else mesh.history.stiffnesses[:: len(mesh.history.times_s) - 1]
            )
            values = np.concatenate([stiffness(phases) for stiffness in ends])
            least = 0.0 if mesh.backlash_m > 0 else np.min(values)
            mean = self.means[number]
            rubs = np.flatnonzero(self.forces_of == number)[1:]
            most = [np.max(np.abs(rub.factor(phases))) for rub in mesh.friction]
            rubbed = float(np.max(values) * (across[rubs] @ most)) if most else 0.0
            swings.append(rubbed + float(max(np.max(values) - mean, mean - least) * across[number]))
        return max(swings)

    def revolutions(self, times_s: Array) -> Array:
        """Return the reference's angle; nothing where it is tied to the motion."""
        reference = self.problem.reference
        return (
            np.zeros(0)
            if isinstance(reference, CoupledReference)
            else np.ascontiguousarray(reference.revolutions(times_s))
        )

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

    def stages(self, times_s: Array) -> Array:
        """Return where in its course the mesh of each force is, (times, forces); (0, forces) where none has one."""
        meshes = self.problem.system.meshes
        if all(mesh.history is None for mesh in meshes):
            return np.zeros((0, self.forces_of.size))
        found = [mesh.history.position(times_s) if mesh.history else np.zeros(times_s.size) for mesh in meshes]
        return np.ascontiguousarray(np.stack(found, axis=1)[:, self.forces_of])

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
    waves, stiffness_later = _stiffnesses(system.meshes)
    directions = np.array([m.direction for m in system.meshes], dtype=np.float64).reshape(-1, dof)
    modes = modes_of(system.mass, system.stiffness + (directions.T * waves.means[: directions.shape[0]]) @ directions)
    flow = flow_of(modes, damping, load.constant)
    rubs = [rub for m in system.meshes for rub in m.friction]
    erring = [m for m in system.meshes if m.error is not None]
    errors = [m.error for m in erring if m.error is not None]
    more, error_later = _further(errors, [m.history.errors if m.history else () for m in erring])
    error_of = _numbers([m.error is not None for m in system.meshes])
    dragged = np.flatnonzero(load.quadratic_drag if load.quadratic_drag is not None else np.zeros(dof))
    tied = np.zeros((0, dof))
    if isinstance(problem.reference, CoupledReference):
        tied = problem.reference.rev_per_unit * np.eye(dof)[[system.names.index(problem.reference.name)]]
    return Assembled(
        problem=problem,
        flow=flow,
        deflections=modes.rows(directions),
        rubbing=modes.rows(np.array([rub.direction for rub in rubs], dtype=np.float64).reshape(-1, dof)),
        rubs_in=np.repeat(np.arange(len(system.meshes)), [len(m.friction) for m in system.meshes]),
        stiffnesses=waves,
        errors=tabulated([Wave(e, e.period) for e in [*errors, *more]]),
        error_of=error_of,
        stiffness_later=stiffness_later,
        error_later=np.array([error_later[of] if of >= 0 else -1 for of in error_of], dtype=np.int64),
        backlashes=np.array([float(m.backlash_m) for m in system.meshes]),
        cycles=np.array([float(m.cycles_per_rev) for m in system.meshes]),
        drags=np.ascontiguousarray(np.eye(dof)[dragged] @ modes.shapes),
        drag_factors=np.asarray(load.quadratic_drag)[dragged] if dragged.size else np.zeros(0),
        tied=np.ascontiguousarray((tied @ modes.shapes).ravel()),
    )


@dataclass(frozen=True)
class Rubbed:
    """Stiffness times what friction makes of the mesh force, over the phase."""

    stiffness: Stiffness
    factor: PhaseFunction

    @property
    def period(self) -> int:
        """Mesh cycles after which both repeat."""
        return self.stiffness.period

    @property
    def jumps(self) -> tuple[float, ...]:
        """Those of both."""
        cycles = range(self.period)
        return tuple(sorted({*self.stiffness.jumps, *(cycle + jump for cycle in cycles for jump in self.factor.jumps)}))

    def __call__(self, phase_cycles: Array) -> Array:
        """Return N/m times the unit of the share."""
        return np.asarray(self.stiffness(phase_cycles) * self.factor(phase_cycles))


def _stiffnesses(meshes: Sequence[Mesh]) -> tuple[Waves, Integers]:
    """Return the tables of stiffnesses and of what rubs, and where those of what changes in time begin."""
    first: list[Stiffness | Rubbed] = [m.stiffness for m in meshes]
    courses: list[tuple[Stiffness | Rubbed, ...]] = [m.history.stiffnesses if m.history else () for m in meshes]
    for mesh in meshes:
        for rub in mesh.friction:
            first.append(Rubbed(mesh.stiffness, rub.factor))
            courses.append(tuple(Rubbed(k, rub.factor) for k in mesh.history.stiffnesses) if mesh.history else ())
    further, later = _further(first, courses)
    return tabulated([Wave(k, k.period, k.jumps) for k in [*first, *further]]), later


Periodic = TypeVar("Periodic")


def _further(first: Sequence[Periodic], stages: Sequence[Sequence[Periodic | None]]) -> tuple[list[Periodic], Integers]:
    """Return what follows the first of each that changes, and its number in the list of all, -1 where nothing does."""
    further: list[Periodic] = []
    later = []
    for own, course in zip(first, stages, strict=True):
        changes = any(stage is not own for stage in course)
        later.append(len(first) + len(further) if changes else -1)
        further += [stage for stage in course[1:] if changes and stage is not None]
    return further, np.array(later, dtype=np.int64)


def _numbers(present: list[bool]) -> Integers:
    there = np.array(present, dtype=bool)
    return np.where(there, np.cumsum(there) - 1, -1).astype(np.int64)
