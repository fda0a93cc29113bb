"""A problem in modal coordinates: constant part, rank-one mesh forces, and their tables over the mesh phase."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from data_synth.dynamics.system import Mesh, PhaseFunction, errors_at
from data_synth.gears.mesh_stiffness import Stiffness
from data_synth.integrators.periodic_tables import FIT_ERROR, Integers, Wave, Waves, tabulated
from data_synth.integrators.problem import Problem, State

# Modes to the relative precision of the stiffnesses, and the exact flow of constant matrices in modal coordinates.
# A gearbox that rotates freely has a rigid-body mode, whose angle grows without bound while meshes deflect by microns;
# and bearings may be 1e10 times as stiff as teeth. Modal coordinates separate both: a mesh force has no component on a
# rigid-body mode, and the flow of each mode is as exact for the fastest as for the slowest.


Array = NDArray[np.float64]

_PIVOT = 64 * np.finfo(float).eps  # of a stiffness scaled to a unit diagonal: less than this is rounding, so rigid
_ORTHOGONAL = 1e-12  # of the lengths of both vectors: less than this is rounding
_CLASSICAL = 1e-12


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Mass-normalised modes, rigid ones first.

    ``frequencies`` (n,) in rad/s, exactly zero where rigid; ``shapes`` (dof, n), one column each.
    """

    frequencies: Array
    shapes: Array

    def rows(self, physical: Array) -> Array:
        """Return rows (r, dof) over displacements as rows over modes, with rounding on rigid-body modes set to zero."""
        modal = physical @ self.shapes
        sizes = np.linalg.norm(modal, axis=-1, keepdims=True)
        rigid = self.frequencies == 0
        modal[..., rigid] = np.where(np.abs(modal[..., rigid]) <= _ORTHOGONAL * sizes, 0.0, modal[..., rigid])
        return np.ascontiguousarray(modal)

    @property
    def scales(self) -> Array:
        """Factors that make modal displacements as large as velocities: the frequency, 1 for rigid-body modes."""
        return np.where(self.frequencies > 0, self.frequencies, 1.0)


def modes_of(mass: Array, stiffness: Array) -> Modes:
    """Return the modes of two symmetric matrices, frequencies exact relative to themselves.

    The stiffness, scaled to a unit diagonal, is factorised with pivoting, and the factor's singular values are
    found by Jacobi rotations (Demmel and Veselic 1992, SIAM J. Matrix Anal. Appl. 13, 1204): unlike those of a
    tridiagonal reduction they keep their digits where stiffnesses differ by many powers of ten.
    """
    size = mass.shape[0]
    root = linalg.cholesky(mass, lower=True)
    diagonal = np.diag(stiffness)
    unit = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    factor, pivots, rank, _ = linalg.lapack.dpstrf(stiffness * unit * unit[:, None], tol=_PIVOT * size)
    if rank == 0:
        return Modes(frequencies=np.zeros(size), shapes=linalg.solve_triangular(root.T, np.eye(size)))
    columns = np.zeros((size, rank))
    columns[pivots - 1] = np.triu(factor)[:rank].T
    graded = linalg.solve_triangular(root, columns / unit[:, None], lower=True)
    values, left, _, work, _, info = linalg.lapack.dgejsv(graded, joba=2, jobu=0, jobv=3)
    if info != 0:
        raise ArithmeticError(f"Jacobi rotations did not converge on {size} degrees of freedom (dgejsv: {info}).")
    rigid = linalg.qr(left)[0][:, rank:]
    rising = np.argsort(values)
    frequencies = np.concatenate([np.zeros(size - rank), values[rising] * (work[0] / work[1])])
    vectors = np.hstack([rigid, left[:, rising]])
    return Modes(frequencies=frequencies, shapes=linalg.solve_triangular(root.T, vectors))


@dataclass(frozen=True, kw_only=True)
class Flow:
    """``x' = generator x + drive`` with x = (scales y, y'), y modal; `classical` where the damping is diagonal.

    `damping` (n, n) is the modal one, 1/s, gyroscopic part included.
    """

    modes: Modes
    damping: Array
    drive: Array
    classical: bool

    @property
    def generator(self) -> Array:
        """The matrix, (2 n, 2 n): skew-symmetric without damping and rigid-body modes."""
        size = self.damping.shape[0]
        matrix = np.zeros((2 * size, 2 * size))
        matrix[:size, size:] = np.diag(self.modes.scales)
        matrix[size:, :size] = -np.diag(self.modes.frequencies)
        matrix[size:, size:] = -self.damping
        return matrix

    def over(self, time_s: float) -> tuple[Array, Array]:
        """Return propagator and part of the constant load over a time, ``x(t + time) = P x(t) + d``."""
        if self.classical:
            return self._mode_by_mode(time_s)
        size = self.drive.size
        augmented = np.zeros((size + 1, size + 1))
        augmented[:size, :size], augmented[:size, size] = self.generator, self.drive
        exponential = linalg.expm(augmented * time_s)
        return exponential[:size, :size], exponential[:size, size]

    def _mode_by_mode(self, t: float) -> tuple[Array, Array]:
        """Return the same from the closed form of each mode, without the rounding of repeated squaring."""
        size = self.damping.shape[0]
        propagator, added = np.zeros((2 * size, 2 * size)), np.zeros(2 * size)
        for i, (w, c) in enumerate(zip(self.modes.frequencies, np.diag(self.damping), strict=True)):
            force = self.drive[size + i]
            if w == 0:
                slow = -np.expm1(-c * t) / c if c else t
                square = (t - slow) / c if abs(c * t) > _CLASSICAL else t * t / 2
                block, gain = np.array([[1.0, slow], [0.0, np.exp(-c * t)]]), np.array([square, slow])
            else:
                block = _oscillator_propagator(w, c / 2, t)
                gain = np.array([_step_response(w, c / 2, t, block[0, 0]), block[0, 1]]) / w
            propagator[np.ix_([i, size + i], [i, size + i])] = block
            added[[i, size + i]] = gain * force
        return propagator, added


def _oscillator_propagator(w: float, decay: float, t: float) -> Array:
    """Return the propagator of (w y, y') where ``y'' + 2 decay y' + w^2 y = 0``."""
    inner = np.sqrt(complex(w * w - decay * decay))
    swing = np.cos(inner * t).real
    sine = (np.sin(inner * t) / inner).real if abs(inner) * t > _CLASSICAL else t
    fading = np.exp(-decay * t)
    return np.asarray(fading * np.array([[swing + decay * sine, w * sine], [-w * sine, swing - decay * sine]]))


def _step_response(w: float, decay: float, t: float, p11: float) -> float:
    """Return ``1 - p11``, the step response w y / load, to full relative precision for short times as well."""
    if decay == 0:
        return float(2 * np.sin(w * t / 2) ** 2)
    if (w + 2 * decay) * t > 1:
        return 1 - p11
    # the power series of u'' + 2 decay u' + w^2 u = w^2 from rest
    before, term, power = 0.0, (w * t) ** 2 / 2, 2
    total = term
    while abs(term) > np.finfo(float).eps * total / 4:
        before, term = term, -(2 * decay * t * power * term + (w * t) ** 2 * before) / (power * (power + 1))
        total, power = total + term, power + 1
    return total


def flow_of(modes: Modes, damping: Array, force: Array) -> Flow:
    """Return the flow under physical damping (dof, dof) and a constant force (dof,)."""
    modal = modes.shapes.T @ damping @ modes.shapes
    off_diagonal = np.abs(modal - np.diag(np.diag(modal))).max()
    classical = bool(off_diagonal <= _CLASSICAL * np.abs(modal).max())
    return Flow(
        modes=modes,
        damping=np.diag(np.diag(modal)) if classical else modal,
        drive=np.concatenate([np.zeros(modal.shape[0]), modes.shapes.T @ force]),
        classical=classical,
    )


# ---- The equations of motion in the form that compiled code takes ----------------------------------------------------


class Equations(NamedTuple):
    """Mesh, friction and drag forces on ``x' = generator x + drive``, x = (scaled displacements, velocities) of modes.

    Mesh forces come first, then friction forces: the mesh force times a factor that follows the phase, in a direction
    of its own; their tables in `stiffnesses` hold stiffness times factor.

    ``force_columns`` (n, forces): change of the modal velocities per impulse. ``deflection_rows`` (n, forces):
    deflection of the mesh per scaled displacement. ``coupling`` (forces, forces): ``g_i M^-1 g_j``.
    ``mean_stiffnesses`` (forces,): those in the generator, zero for friction. ``backlashes`` and ``back_half_gaps``
    (forces,): half the backlash towards the driving and the back flank, the latter infinite for friction. ``offsets``
    (forces,): the deflections from which mean stiffness counts (`Assembled.offsets`); ``following`` (forces,): 1 where
    it follows the transmission error (`Assembled.following`), else 0; ``jumping`` (forces,): whether the error jumps.
    ``error_of`` (forces,): number of the transmission error in `errors`, -1 for none. ``later_stiffnesses`` and
    ``later_errors`` (forces,): number of the second table of a mesh with a history, -1 for none; the first is at its
    own number, or at ``error_of``. ``drags`` (drags, n): rows of the velocities with drag, and ``drag_factors``
    (drags,).
    """

    force_columns: Array
    deflection_rows: Array
    coupling: Array
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    mean_stiffnesses: Array
    backlashes: Array
    back_half_gaps: Array
    offsets: Array
    following: Array
    jumping: NDArray[np.bool_]
    cycles: Array
    drags: Array
    drag_factors: Array
    later_stiffnesses: Integers
    later_errors: Integers


# ---- Modal problem ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Assembled:
    """The equations of motion in x = (scales * y, y'), y the modal displacements at mean mesh stiffness.

        y'' + D y' + w^2 y = drive + loads(t) - sum_m G_m (k_m f(G_m y - e_m) - kmean_m G_m y) - drags

    Attributes
    ----------
    problem : Problem
    flow : Flow
        Left-hand side and constant load.
    deflections : (meshes, n) array
        G: deflections per modal displacement, and generalised forces per mesh force.
    friction_rows : (friction, n) array
        Generalised forces per friction force; `friction_mesh` (friction,) has the number of its mesh.
    stiffnesses, errors : Waves
        Tables over the phase: the stiffness of each mesh, stiffness times factor of each friction force, then the later
        ones of histories. `error_of` (meshes,) has the number of the error of a mesh, `later_stiffnesses` (meshes and
        friction,) and `later_errors` (meshes,) that of the second table of its history; -1 for none.
    backlashes, cycles : (meshes,) arrays
        Half the backlash in m, and mesh cycles per revolution of the reference.
    drags : (drags, n) array
        Rows of the velocities with quadratic drag; `drag_factors` (drags,).
    """

    problem: Problem
    flow: Flow
    deflections: Array
    friction_rows: Array
    friction_mesh: Integers
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    later_stiffnesses: Integers
    later_errors: Integers
    backlashes: Array
    cycles: Array
    drags: Array
    drag_factors: Array

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
        """The same equations for compiled code."""
        of, none = self.mesh_of_force, np.zeros(self.friction_mesh.size)
        deflection_rows, force_columns = self.deflections[of], np.vstack([self.deflections, -self.friction_rows])
        return Equations(
            force_columns=np.ascontiguousarray(force_columns.T),
            deflection_rows=np.ascontiguousarray((deflection_rows / self.flow.modes.scales).T),
            coupling=np.ascontiguousarray(deflection_rows @ force_columns.T),
            stiffnesses=self.stiffnesses,
            errors=self.errors,
            error_of=self.error_of[of],
            mean_stiffnesses=np.concatenate([self.means, none]),
            backlashes=self.backlashes[of],
            back_half_gaps=np.concatenate([self.backlashes, none + np.inf]),
            offsets=np.concatenate([self.offsets, none]),
            following=np.concatenate([self.following, none]),
            jumping=self.jumping[of],
            cycles=self.cycles[of],
            drags=self.drags,
            drag_factors=self.drag_factors,
            later_stiffnesses=self.later_stiffnesses,
            later_errors=self.later_errors[of],
        )

    @cached_property
    def offsets(self) -> Array:
        """Deflections (meshes,) in m at which teeth touch on the flanks that bear at the start; zero from rest.

        Half the backlash, so that what varies about the mean stiffness is the force of teeth in contact alone.
        """
        start, reference = self.problem.start, self.problem.reference
        meshes, time_s = self.problem.system.meshes, self.problem.start_s
        if start is None:
            return np.zeros(self.backlashes.size)
        gaps = np.array([mesh.direction @ start.displacement for mesh in meshes])
        gaps -= errors_at(meshes, revolutions=float(reference.revolutions([time_s])[0]), time_s=time_s)
        return np.where(2 * np.abs(gaps) > self.backlashes, self.backlashes * np.sign(gaps), 0.0)

    @cached_property
    def following(self) -> Array:
        """Whether mean stiffness follows the transmission error of a mesh: 1, or 0 where teeth hang at the start."""
        return np.where((self.offsets != 0) | (self.backlashes == 0), 1.0, 0.0)

    @property
    def jumping(self) -> NDArray[np.bool_]:
        """Whether the transmission error of a mesh (meshes,), or of its history, jumps anywhere."""
        errors, meshes = self.errors, self.problem.system.meshes
        jump = [bool(np.any(errors.jumps[a:b])) for a, b in pairwise(errors.segments)]
        found = np.zeros(len(meshes), dtype=np.bool_)
        for number, (mesh, first, later) in enumerate(zip(meshes, self.error_of, self.later_errors, strict=True)):
            tables = [] if first < 0 else [first]
            if later >= 0 and mesh.history is not None:
                tables += range(later, later + len(mesh.history.errors) - 1)
            found[number] = any(jump[table] for table in tables)
        return found

    @cached_property
    def flow_from_contact(self) -> Flow:
        """The flow with mean stiffness counted from `offsets`."""
        drive = self.flow.drive.copy()
        drive[self.size :] += self.deflections.T @ (self.means * self.offsets)
        return replace(self.flow, drive=drive)

    @property
    def mesh_of_force(self) -> Integers:
        """Number of the mesh of each force: the mesh forces, then the friction forces."""
        return np.concatenate([np.arange(self.backlashes.size), self.friction_mesh])

    @cached_property
    def stiffness_variation(self) -> float:
        """Largest ``abs(k - kmean) g M^-1 g`` of any mesh in rad2/s2: what the constant part lacks."""
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
            frictions = np.flatnonzero(self.mesh_of_force == number)[1:]
            most = [np.max(np.abs(force.factor(phases))) for force in mesh.friction]
            friction = float(np.max(values) * (across[frictions] @ most)) if most else 0.0
            swings.append(friction + float(max(np.max(values) - mean, mean - least) * across[number]))
        return max(swings)

    def revolutions(self, times_s: Array) -> Array:
        """Return the angle of the reference in revolutions (times,)."""
        return np.ascontiguousarray(self.problem.reference.revolutions(times_s))

    @cached_property
    def load_rows(self) -> Array:
        """Generalised forces (loads, n) of the loads that vary; (0, n) where none does."""
        load, shapes = self.problem.load, self.flow.modes.shapes
        if load.varying is None:
            return np.zeros((0, self.size))
        return shapes if load.directions is None else np.asarray(load.directions @ shapes)

    def loads(self, times_s: Array) -> Array:
        """Return the varying loads (times, loads); (0, loads) where there is none."""
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
        """Return the positions in the histories, (times, forces); (0, forces) where no mesh has a history."""
        meshes = self.problem.system.meshes
        if all(mesh.history is None for mesh in meshes):
            return np.zeros((0, self.mesh_of_force.size))
        found = [mesh.history.position(times_s) if mesh.history else np.zeros(times_s.size) for mesh in meshes]
        return np.ascontiguousarray(np.stack(found, axis=1)[:, self.mesh_of_force])

    def modal(self, state: State | None) -> Array:
        """Return x of a state, at rest where it is None."""
        if state is None:
            return np.zeros(2 * self.size)
        into = self.flow.modes.shapes.T @ self.problem.system.mass
        return np.concatenate([self.flow.modes.scales * (into @ state.displacement), into @ state.velocity])

    def physical(self, x: Array) -> State:
        """Return displacements and velocities of x."""
        shapes = self.flow.modes.shapes
        return State(displacement=shapes @ (x[: self.size] / self.flow.modes.scales), velocity=shapes @ x[self.size :])

    def displacement_rows(self, rows: Array) -> Array:
        """Return rows over modal displacements as rows over x."""
        return np.hstack([rows / self.flow.modes.scales, np.zeros_like(rows)])

    def velocity_rows(self, rows: Array) -> Array:
        """Return rows over modal velocities as rows over x."""
        return np.hstack([np.zeros_like(rows), rows])


def assemble(problem: Problem) -> Assembled:
    """Return a problem in modal coordinates; ValueError for matrices of the wrong shape or without symmetry."""
    system, load = problem.system, problem.load
    dof = len(system.names)
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    for name, matrix in (("mass", system.mass), ("damping", damping), ("stiffness", system.stiffness)):
        if matrix.shape != (dof, dof) or not np.all(np.isfinite(matrix)):
            raise ValueError(f"{name} must be a finite ({dof}, {dof}) matrix; it has shape {matrix.shape}.")
        if name != "damping" and not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0):
            raise ValueError(f"{name} is not symmetric; put skew-symmetric terms into gyroscopic or a load.")
    waves, later_stiffnesses = _stiffnesses(system.meshes)
    directions = np.array([m.direction for m in system.meshes], dtype=np.float64).reshape(-1, dof)
    modes = modes_of(system.mass, system.stiffness + (directions.T * waves.means[: directions.shape[0]]) @ directions)
    flow = flow_of(modes, damping, load.constant)
    frictions = [force for m in system.meshes for force in m.friction]
    erring = [m for m in system.meshes if m.error is not None]
    errors = [m.error for m in erring if m.error is not None]
    more, later_errors = _later_tables(errors, [m.history.errors if m.history else () for m in erring])
    error_of = _running_numbers([m.error is not None for m in system.meshes])
    dragged = np.flatnonzero(load.quadratic_drag if load.quadratic_drag is not None else np.zeros(dof))
    return Assembled(
        problem=problem,
        flow=flow,
        deflections=modes.rows(directions),
        friction_rows=modes.rows(np.array([force.direction for force in frictions], dtype=np.float64).reshape(-1, dof)),
        friction_mesh=np.repeat(np.arange(len(system.meshes)), [len(m.friction) for m in system.meshes]),
        stiffnesses=waves,
        errors=tabulated(
            [Wave(e, e.period, getattr(e, "jumps", ()), FIT_ERROR) for e in [*errors, *more]], integrals=False
        ),
        error_of=error_of,
        later_stiffnesses=later_stiffnesses,
        later_errors=np.array([later_errors[of] if of >= 0 else -1 for of in error_of], dtype=np.int64),
        backlashes=np.array([float(m.backlash_m) for m in system.meshes]),
        cycles=np.array([float(m.cycles_per_rev) for m in system.meshes]),
        drags=np.ascontiguousarray(np.eye(dof)[dragged] @ modes.shapes),
        drag_factors=np.asarray(load.quadratic_drag)[dragged] if dragged.size else np.zeros(0),
    )


@dataclass(frozen=True)
class FrictionStiffness:
    """Mesh stiffness times friction factor over the phase."""

    stiffness: Stiffness
    factor: PhaseFunction

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
        """Return N/m times the unit of the factor."""
        return np.asarray(self.stiffness(phase_cycles) * self.factor(phase_cycles))


def _stiffnesses(meshes: Sequence[Mesh]) -> tuple[Waves, Integers]:
    """Return the tables of mesh stiffness and friction, and the number of the second table of each history."""
    first: list[Stiffness | FrictionStiffness] = [m.stiffness for m in meshes]
    histories: list[tuple[Stiffness | FrictionStiffness, ...]] = [
        m.history.stiffnesses if m.history else () for m in meshes
    ]
    for mesh in meshes:
        for force in mesh.friction:
            first.append(FrictionStiffness(mesh.stiffness, force.factor))
            histories.append(
                tuple(FrictionStiffness(k, force.factor) for k in mesh.history.stiffnesses) if mesh.history else ()
            )
    later_functions, later = _later_tables(first, histories)
    return tabulated([Wave(k, k.period, k.jumps) for k in [*first, *later_functions]]), later


Periodic = TypeVar("Periodic")


def _later_tables(
    first: Sequence[Periodic], history_positions: Sequence[Sequence[Periodic | None]]
) -> tuple[list[Periodic], Integers]:
    """Return the later functions of each history, and the number of its second one in the list of all, -1 for none."""
    later_functions: list[Periodic] = []
    later = []
    for own, history in zip(first, history_positions, strict=True):
        changes = any(stage is not own for stage in history)
        later.append(len(first) + len(later_functions) if changes else -1)
        later_functions += [stage for stage in history[1:] if changes and stage is not None]
    return later_functions, np.array(later, dtype=np.int64)


def _running_numbers(present: list[bool]) -> Integers:
    """Return 0, 1, ... for those that are present, -1 for the others."""
    there = np.array(present, dtype=bool)
    return np.where(there, np.cumsum(there) - 1, -1).astype(np.int64)
