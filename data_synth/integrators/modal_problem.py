"""A problem in modal coordinates: constant part, rank-one mesh forces, and their tables over the mesh phase.

A gearbox that rotates freely has a rigid-body mode whose angle grows without bound while meshes deflect by micrometres,
and bearings may be 1e10 times as stiff as teeth. Modal coordinates separate these scales: a mesh force has no component
in a rigid-body mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.modes import undamped_modes
from data_synth.dynamics.system import FrictionForce, Mesh, errors_at
from data_synth.gears.friction import FrictionShare
from data_synth.gears.mesh_stiffness import Stiffness
from data_synth.gears.transmission_error import ProfileError
from data_synth.integrators.periodic_tables import FIT_ERROR, Integers, Periodic, Waves, tabulated
from data_synth.integrators.problem import Array, Problem, State

_ROUNDING = 1e-12  # of the length of a modal vector, and of the largest damping
_NO_ERROR = ProfileError(harmonics_m=np.zeros(1, dtype=np.complex128))


class Equations(NamedTuple):
    """Mesh, friction and drag forces on ``x' = generator x + drive``, x = modal (scaled displacements, velocities).

    Mesh forces come first, then friction forces: the mesh force times a factor that depends on the phase, in another
    direction; their tables in `stiffnesses` hold stiffness times factor.

    ``force_columns`` (n, forces): change of the modal velocities per impulse. ``deflection_rows`` (n, forces):
    deflection of the mesh per scaled displacement. ``coupling`` (forces, forces): ``g_i M^-1 g_j``.
    ``mean_stiffnesses`` (forces,): those in the generator, zero for friction. ``backlashes`` and ``back_half_gaps``
    (forces,): half the backlash towards the driving and the back flank, the latter infinite for friction. ``offsets``
    (forces,): deflections in m from which the mean stiffness is measured, at which the flanks loaded at the start
    touch, so that only the force of teeth in contact varies about it; zero if the start is at rest. ``following``
    (forces,): 1 if the mean stiffness follows the transmission error, 0 if teeth are apart at the start and for
    friction. ``jumping`` (forces,): whether the error jumps. ``first_stiffness`` and ``first_error`` (forces,): numbers
    of the tables in `stiffnesses` and `errors`; those of the further instants of a history follow. ``cycles``
    (forces,): mesh cycles per revolution of the reference. ``drags`` (drags, n): rows of the velocities with drag, with
    factors ``drag_factors`` (drags,).
    """

    force_columns: Array
    deflection_rows: Array
    coupling: Array
    stiffnesses: Waves
    errors: Waves
    first_stiffness: Integers
    first_error: Integers
    mean_stiffnesses: Array
    backlashes: Array
    back_half_gaps: Array
    offsets: Array
    following: Array
    jumping: NDArray[np.bool_]
    cycles: Array
    drags: Array
    drag_factors: Array


class StepFlow(NamedTuple):
    """Exact flow over a step, and the effect of impulses at its beginning and in its middle.

    Impulses are those of forces, then of drags, k in total. ``columns`` (c, width) are the columns of the matrix from x
    and impulses at the beginning, and the transmission errors of each force and varying loads at beginning, middle and
    end, to x and deflections (forces,) at the end, then deflections (forces,) and speeds with drag (drags,) in the
    middle; ``added`` (width,) is the contribution of the constant load. ``directions`` (k, n): change of the modal
    velocities per impulse. ``from_middle`` (k, 2 n + forces): change of x and deflections at the end per impulse in the
    middle. ``speed_changes`` (drags, k): change of the speeds with drag per impulse.
    """

    columns: Array
    added: Array
    directions: Array
    from_middle: Array
    speed_changes: Array


@dataclass(frozen=True, kw_only=True)
class Assembled:
    """The equations of motion in x = (scales * y, y'), with modal displacements y at mean mesh stiffness.

        y'' + D y' + w^2 y = drive + loads(t) - sum_m G_m (k_m f(G_m y - e_m) - kmean_m G_m y) - drags

    Attributes
    ----------
    problem : Problem
    frequencies : (n,) array
        w in rad/s, ascending, exactly zero for rigid-body modes.
    shapes : (dof, n) array
        Mass-normalised modes, one per column.
    damping : (n, n) array
        D in 1/s, including the gyroscopic part.
    drive : (n,) array
        Modal force of the constant load.
    deflections : (meshes, n) array
        G: deflection per modal displacement, and modal force per mesh force.
    mesh_of : (forces,) array
        Number of the mesh of each force.
    equations : Equations
    """

    problem: Problem
    frequencies: Array
    shapes: Array
    damping: Array
    drive: Array
    deflections: Array
    mesh_of: Integers
    equations: Equations

    @property
    def means(self) -> Array:
        """Mean stiffnesses (meshes,) of the constant part, N/m."""
        return self.equations.mean_stiffnesses[: self.deflections.shape[0]]

    @property
    def backlashes(self) -> Array:
        """Half the backlash (meshes,) in m."""
        return self.equations.backlashes[: self.deflections.shape[0]]

    @property
    def size(self) -> int:
        """Degrees of freedom."""
        return int(self.frequencies.size)

    @property
    def scales(self) -> Array:
        """Factors that scale modal displacements like velocities: the frequency, or 1 for rigid-body modes."""
        return np.where(self.frequencies > 0, self.frequencies, 1.0)

    @property
    def generator(self) -> Array:
        """The matrix of ``x' = generator x``, (2 n, 2 n): skew-symmetric without damping and rigid-body modes."""
        return np.block([[0 * self.damping, np.diag(self.scales)], [-np.diag(self.frequencies), -self.damping]])

    @property
    def stiffness_variation(self) -> float:
        """Largest ``abs(k - kmean) g M^-1 g`` of any mesh in rad2/s2: what is not in the constant part."""
        e, swings = self.equations, np.zeros(self.mesh_of.size)
        segments = e.stiffnesses.segments[[*e.first_stiffness, -2]]
        for force, (first, last) in enumerate(pairwise(e.stiffnesses.firsts[segments])):
            values = e.stiffnesses.rows[first:last, 0]  # at the beginnings of cells
            least = 0.0 if e.backlashes[force] > 0 else np.min(values)
            mean = e.mean_stiffnesses[force]
            swings[force] = max(np.max(values) - mean, mean - least) * abs(e.coupling[force, force])
        return float(np.max(np.bincount(self.mesh_of, weights=swings), initial=0.0))

    def revolutions(self, times_s: Array) -> Array:
        """Return the angle (times,) of the reference in rev."""
        return np.ascontiguousarray(self.problem.reference.revolutions(times_s))

    @property
    def load_rows(self) -> Array:
        """Modal forces (loads, n) of the varying loads; (0, n) if there are none."""
        load = self.problem.load
        if load.varying is None:
            return np.zeros((0, self.size))
        return self.shapes if load.directions is None else np.asarray(load.directions @ self.shapes)

    def loads(self, times_s: Array) -> Array:
        """Return the varying loads (times, loads); (0, loads) if there are none."""
        varying, count = self.problem.load.varying, self.load_rows.shape[0]
        if varying is None:
            return np.zeros((0, count))
        values = np.asarray(varying(times_s), dtype=np.float64)
        if values.shape != (times_s.size, count) or not np.all(np.isfinite(values)):
            raise ValueError(
                f"load.varying must return finite forces ({times_s.size}, {count}); it returned {values.shape}."
            )
        return np.ascontiguousarray(values)

    def history_positions(self, times_s: Array) -> Array:
        """Return the positions in the histories (times, forces); zero for a mesh without one."""
        meshes = self.problem.system.meshes
        found = [mesh.history.position(times_s) if mesh.history else np.zeros(times_s.size) for mesh in meshes]
        return np.ascontiguousarray(np.reshape(found, (len(meshes), times_s.size)).T[:, self.mesh_of])

    def modal(self, state: State | None) -> Array:
        """Return x of a state; None is at rest."""
        if state is None:
            return np.zeros(2 * self.size)
        into = self.shapes.T @ self.problem.system.mass
        return np.concatenate([self.scales * (into @ state.displacement), into @ state.velocity])

    def physical(self, x: Array) -> State:
        """Return displacements and velocities of x."""
        return State(displacement=self.shapes @ (x[: self.size] / self.scales), velocity=self.shapes @ x[self.size :])

    def displacement_rows(self, rows: Array) -> Array:
        """Return rows over modal displacements as rows over x."""
        return np.hstack([rows / self.scales, np.zeros_like(rows)])

    def velocity_rows(self, rows: Array) -> Array:
        """Return rows over modal velocities as rows over x."""
        return np.hstack([np.zeros_like(rows), rows])


def assemble(problem: Problem) -> Assembled:
    """Return a problem in modal coordinates; raise ValueError if matrices have the wrong shape or are asymmetric."""
    system, load, meshes = problem.system, problem.load, problem.system.meshes
    dof = len(system.names)
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    for name, matrix in (("mass", system.mass), ("damping", damping), ("stiffness", system.stiffness)):
        if matrix.shape != (dof, dof) or not np.all(np.isfinite(matrix)):
            raise ValueError(f"{name} must be a finite ({dof}, {dof}) matrix; it has shape {matrix.shape}.")
        if name != "damping" and not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0):
            raise ValueError(f"{name} must be a symmetric matrix; put skew-symmetric terms into gyroscopic.")
    forces: list[tuple[int, FrictionForce | None]] = [(number, None) for number in range(len(meshes))]
    forces += [(number, friction) for number, mesh in enumerate(meshes) for friction in mesh.friction]
    of = np.array([number for number, _ in forces], dtype=np.int64)
    stiffnesses, first_stiffness = _tables([_stiffnesses(meshes[number], friction) for number, friction in forces])
    errors, first_error = _tables([_errors(mesh) for mesh in meshes], misfit=FIT_ERROR, integrals=False)
    rubbing = np.arange(of.size) >= len(meshes)
    means = np.where(rubbing, 0.0, stiffnesses.means[first_stiffness[:-1]])
    angular, shapes = undamped_modes(system, means[: len(meshes)])
    modal_damping = shapes.T @ damping @ shapes

    deflections = modal_rows([mesh.direction for mesh in meshes], angular, shapes)
    rubs = modal_rows([friction.direction for _, friction in forces if friction is not None], angular, shapes)
    columns = np.vstack([deflections, -rubs])
    backlashes = np.array([float(mesh.backlash_m) for mesh in meshes])
    offsets = _offsets(problem, backlashes)
    dragged = np.flatnonzero(load.quadratic_drag if load.quadratic_drag is not None else np.zeros(dof))
    jumping = [np.any(errors.jumps[first:last]) for first, last in pairwise(errors.segments[first_error])]
    return Assembled(
        problem=problem,
        frequencies=angular,
        shapes=shapes,
        damping=np.where(np.abs(modal_damping) > _ROUNDING * np.max(np.abs(modal_damping)), modal_damping, 0.0),
        drive=shapes.T @ load.constant + deflections.T @ (means[: len(meshes)] * offsets),
        deflections=deflections,
        mesh_of=of,
        equations=Equations(
            force_columns=np.ascontiguousarray(columns.T),
            deflection_rows=np.ascontiguousarray((deflections[of] / np.where(angular > 0, angular, 1.0)).T),
            coupling=np.ascontiguousarray(deflections[of] @ columns.T),
            stiffnesses=stiffnesses,
            errors=errors,
            first_stiffness=first_stiffness[:-1],
            first_error=first_error[of],
            mean_stiffnesses=means,
            backlashes=backlashes[of],
            back_half_gaps=np.where(rubbing, np.inf, backlashes[of]),
            offsets=np.where(rubbing, 0.0, offsets[of]),
            following=np.where(~rubbing & ((offsets != 0) | (backlashes == 0))[of], 1.0, 0.0),
            jumping=np.array(jumping, dtype=np.bool_)[of],
            cycles=np.array([float(mesh.cycles_per_rev) for mesh in meshes])[of],
            drags=np.ascontiguousarray(np.eye(dof)[dragged] @ shapes),
            drag_factors=np.asarray(load.quadratic_drag)[dragged] if dragged.size else np.zeros(0),
        ),
    )


def modal_rows(physical: Array | Sequence[Array], frequencies: Array, shapes: Array) -> Array:
    """Return rows over displacements as rows over modes, with rounding errors in rigid-body modes set to zero."""
    modal = np.reshape(np.asarray(physical, dtype=np.float64), (-1, shapes.shape[0])) @ shapes
    sizes = np.linalg.norm(modal, axis=1, keepdims=True)
    return np.where((frequencies == 0) & (np.abs(modal) <= _ROUNDING * sizes), 0.0, modal)


def _offsets(problem: Problem, backlashes: Array) -> Array:
    """Return the deflection (mesh,) in m at which the flanks loaded at the start touch; zero if none are."""
    start, time_s, meshes = problem.start, problem.start_s, problem.system.meshes
    if start is None:
        return np.zeros(backlashes.size)
    revolutions = float(problem.reference.revolutions([time_s])[0])
    gaps = np.array([mesh.direction @ start.displacement for mesh in meshes])
    gaps -= errors_at(meshes, revolutions=revolutions, time_s=time_s)
    return np.where(2 * np.abs(gaps) > backlashes, backlashes * np.sign(gaps), 0.0)


@dataclass(frozen=True)
class FrictionStiffness:
    """Mesh stiffness times friction factor as a function of mesh phase."""

    stiffness: Stiffness
    factor: FrictionShare

    @property
    def period(self) -> int:
        """Mesh cycles after which both repeat."""
        return self.stiffness.period

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which either jumps."""
        cycles = range(self.period)
        return tuple(sorted({*self.stiffness.jumps, *(cycle + jump for cycle in cycles for jump in self.factor.jumps)}))

    def __call__(self, phase_cycles: Array) -> Array:
        """Return the product in N/m times the unit of the factor."""
        return np.asarray(self.stiffness(phase_cycles) * self.factor(phase_cycles))


def _stiffnesses(mesh: Mesh, friction: FrictionForce | None) -> Sequence[Periodic]:
    """Return the stiffness of a force at each instant of the history of its mesh."""
    instants = mesh.history.stiffnesses if mesh.history else (mesh.stiffness,)
    return instants if friction is None else [FrictionStiffness(each, friction.factor) for each in instants]


def _errors(mesh: Mesh) -> Sequence[Periodic]:
    """Return the transmission error of a mesh at each instant of its history."""
    return [each or _NO_ERROR for each in (mesh.history.errors if mesh.history else (mesh.error,))]


def _tables(functions: Sequence[Sequence[Periodic]], **fit: float) -> tuple[Waves, Integers]:
    """Return the tables of the functions of each force or mesh one after the other, and the numbers of the first ones.

    The last number is that of all tables.
    """
    waves = tabulated([each for instants in functions for each in instants], **fit)  # type: ignore[arg-type]
    return waves, np.cumsum([0, *map(len, functions)])
