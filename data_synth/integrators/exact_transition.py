"""Exact transition matrices where every mesh stiffness is constant between jumps."""

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from data_synth.integrators.method import Grid, Readings, Refusal, Stepper
from data_synth.integrators.modal_problem import Assembled, Modes, flow_of, modes_of
from data_synth.integrators.problem import Array, CoupledReference, Problem

if TYPE_CHECKING:
    from data_synth.integrators._exact_transition_kernels import Propagators


# ---- Intervals of constant mesh stiffness: switching instants, power series, integrals of mesh forces ----------------
# A mesh force under a triangular weight is the sum of two integrals over each sample interval, tau from 0 to 1: of
# ``(1 - tau) f`` where the weight falls, of ``tau f`` where it rises. With z1' = f and z2' = z1, both zero at the
# beginning of each interval, they are z2 and z1 - z2; so z is appended to the state, and its exact flow contains them.


_ROUNDING = 1e-17  # of the state: smaller terms of the power series change no digit
_SERIES_ROTATION = 0.5  # rad of the fastest mode: over a shorter interval the power series is exact to rounding


def halvings_and_terms(a: Assembled, sample_s: float) -> tuple[int, int]:
    """Return the halvings of a sample interval until a power series is exact, and its number of terms."""
    fastest = np.sqrt(np.max(a.flow.modes.frequencies, initial=1.0) ** 2 + a.stiffness_variation) + np.linalg.norm(
        a.flow.damping, 2
    )
    halvings = max(0, int(np.ceil(np.log2(fastest * sample_s / _SERIES_ROTATION))))
    rotation, terms = fastest * sample_s / 2**halvings, 1
    while rotation**terms / math.factorial(terms) > _ROUNDING:
        terms += 1
    return halvings, terms


def switching(a: Assembled, start_s: float, stop_s: float) -> tuple[Array, Array]:
    """Return switching instants within (start, stop) and stiffnesses (switches + 1, meshes) between them."""
    reference, meshes = a.problem.reference, a.problem.system.meshes
    assert not isinstance(reference, CoupledReference)  # noqa: S101
    begin, end = reference.revolutions(np.array([start_s, stop_s]))
    instants = [np.zeros(0)]
    for mesh in meshes:
        low, high = sorted((begin * mesh.cycles_per_rev, end * mesh.cycles_per_rev))
        period = mesh.stiffness.period
        for jump in mesh.stiffness.jumps:
            phases = jump + period * np.arange(np.floor((low - jump) / period), np.ceil((high - jump) / period) + 1)
            phases = phases[(phases > low) & (phases < high)]
            instants.append(reference.times(phases / mesh.cycles_per_rev))
    switches = np.unique(np.concatenate(instants))
    switches = switches[(switches > start_s) & (switches < stop_s)]
    edges = np.concatenate([[start_s], switches, [stop_s]])
    middles = reference.revolutions((edges[1:] + edges[:-1]) / 2)
    values = [mesh.stiffness(mesh.cycles_per_rev * middles) for mesh in meshes]
    return switches, np.array(values, dtype=np.float64).reshape(len(meshes), middles.size).T


def columns(matrices: Array) -> Array:
    """Return matrices (k, rows, columns) as (columns, k rows): row j holds column j of each of them."""
    return np.ascontiguousarray(np.moveaxis(matrices, 2, 0)).reshape(matrices.shape[2], -1)


def series(generator: Array, drive: Array, time_s: float, terms: int) -> tuple[Array, Array]:
    """Return ``(generator time)^k / k!`` for k = 1, 2, ..., and what the constant load adds to each term."""
    rate, load = generator * time_s, drive * time_s
    powers, gains = [rate], [load]
    for k in range(2, terms + 1):
        powers.append(rate @ powers[-1] / k)
        gains.append(rate @ gains[-1] / k)
    return np.stack(powers), np.stack(gains)


@dataclass(frozen=True, kw_only=True)
class ForceIntegrals:
    """Integrals of mesh forces appended to x, where the output has mesh forces under triangular weights.

    ``meshes`` is 0 where it has none; ``next_weighted`` (meshes,) is the known part of the next weighted forces, NaN
    before the start.
    """

    readings: Readings
    meshes: int
    next_weighted: Array

    @classmethod
    def of(cls, readings: Readings) -> "ForceIntegrals":
        """Return those that the output needs."""
        meshes = readings.assembled.backlashes.size if readings.output.weighted_mesh_force is not None else 0
        return cls(readings=readings, meshes=meshes, next_weighted=np.full(meshes, np.nan))

    @property
    def deflection_rows(self) -> Array:
        """Rows (meshes, 2 n) of the deflections."""
        a = self.readings.assembled
        return a.displacement_rows(a.deflections[: self.meshes])

    @property
    def rows(self) -> tuple[Array, Array]:
        """Output rows of the augmented state (readings, deflections, z1 and z2), and the constants to add."""
        rows, z = self.readings.rows, np.eye(2 * self.meshes)
        read = np.vstack([rows, self.deflection_rows])
        constant = np.concatenate([self.readings.constant, np.zeros(3 * self.meshes)])
        return np.block(
            [[read, np.zeros((read.shape[0], z.shape[1]))], [np.zeros((z.shape[0], rows.shape[1])), z]]
        ), constant

    def augmented_equations(
        self, generator: Array, drive: Array, stiffnesses: Array, shift: Array, sample_s: float
    ) -> tuple[Array, Array]:
        """Return generator and load of the augmented state; forces are ``stiffnesses (deflections - shift)``."""
        m, size = self.meshes, drive.size
        matrix, load = np.zeros((size + 2 * m, size + 2 * m)), np.zeros(size + 2 * m)
        matrix[:size, :size], load[:size] = generator, drive
        matrix[size : size + m, :size] = stiffnesses[:m, None] * self.deflection_rows / sample_s
        matrix[size + m :, size : size + m] = np.eye(m) / sample_s
        load[size : size + m] = -stiffnesses[:m] * shift[:m] / sample_s
        return matrix, load

    def augmented(self, x: Array) -> Array:
        """Return the augmented state (x, z), z zero."""
        return np.concatenate([x, np.zeros(2 * self.meshes)])

    def begin(self, x: Array, time_s: float) -> None:
        """Take the mesh forces to have been constant before the start."""
        if self.meshes and np.isnan(self.next_weighted).any():
            self.next_weighted[:] = self.readings.at(x, time_s)[0, -self.meshes :] / 2

    def read(self, outputs: Array, grid: Grid, first: int) -> Array:
        """Return readings (samples, readings) from outputs of the augmented state, from sample `first` on."""
        m, count = self.meshes, self.readings.rows.shape[0]
        if not m:
            return outputs
        z1, z2 = outputs[:, count + m : count + 2 * m], outputs[:, count + 2 * m :]
        rising = np.vstack([self.next_weighted, z1 - z2])
        self.next_weighted[:] = rising[-1]
        now = self.readings.forces_at(outputs[:, count : count + m], grid.edges(first, outputs.shape[0])[1:])
        return np.hstack([outputs[:, :count], rising[:-1] + z2, now])


# ---- Exact steps of meshes with backlash: linear between the instants at which teeth lose or regain contact ----------


Integers = NDArray[np.int64]

MAX_BACKLASHES = 3  # a mesh with backlash has three contact states, and each combination of states its own series
_UNKNOWN = -2


def meshes_with_backlash(a: Assembled) -> Integers:
    """Return the numbers of the meshes with backlash."""
    return np.flatnonzero(a.backlashes > 0)


def contact_stepper(readings: Readings, grid: Grid) -> Stepper:
    """Return a stepper for at most `MAX_BACKLASHES` meshes with backlash."""
    a, integrals = readings.assembled, ForceIntegrals.of(readings)
    meshes = meshes_with_backlash(a)
    deflection_rows = a.displacement_rows(a.deflections[meshes])
    halvings, terms = halvings_and_terms(a, grid.step_s)
    return _ContactStepper(
        readings=readings,
        grid=grid,
        series_fraction=0.5**halvings,
        terms=terms,
        deflection_rows=np.hstack([deflection_rows, np.zeros((meshes.size, 2 * integrals.meshes))]),
        integrals=integrals,
        half_gaps=a.backlashes[meshes],
        contact=np.full(meshes.size, _UNKNOWN),
    )


@dataclass(frozen=True, kw_only=True)
class _ContactStepper:
    readings: Readings
    grid: Grid
    integrals: ForceIntegrals
    series_fraction: float  # of a sample interval: what a power series covers
    terms: int
    deflection_rows: Array
    half_gaps: Array
    contact: Integers  # 1 on the driving flank, -1 on the back flank, 0 without: state of the stepper beside x

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Integrate over samples; see `Stepper.advance`."""
        from data_synth.integrators._exact_transition_kernels import contact_steps  # noqa: PLC0415

        if np.any(self.contact == _UNKNOWN):
            deflections = self.deflection_rows[:, : x.size] @ x
            self.contact[:] = np.sign(deflections) * (np.abs(deflections) > self.half_gaps)
        read, grid = self.readings, self.grid
        start_s = grid.at(first)
        switches, stiffnesses = switching(read.assembled, start_s, grid.at(first + samples))
        used, combinations = np.unique(stiffnesses, axis=0, return_inverse=True)
        series_of = [self._power_series(row) for row in used]
        rows, constant = self.integrals.rows
        self.integrals.begin(x, start_s)
        out, state = np.empty((samples, rows.shape[0])), self.integrals.augmented(x)
        contact_steps(
            state,
            self.contact,
            out,
            rows,
            constant,
            start_s,
            grid.step_s,
            self.series_fraction,
            switches,
            combinations.ravel(),
            np.stack([terms_of_state for terms_of_state, _ in series_of]),
            np.stack([terms_of_load for _, terms_of_load in series_of]),
            self.deflection_rows,
            self.half_gaps,
            x.size,
        )
        x[:] = state[: x.size]
        return self.integrals.read(out, grid, first)

    def _power_series(self, stiffnesses: Array) -> tuple[Array, Array]:
        """Return the power series of every combination of contact states, the last mesh's changing first."""
        a, meshes = self.readings.assembled, meshes_with_backlash(self.readings.assembled)
        found = []
        for contact in product((-1, 0, 1), repeat=meshes.size):
            stiffness_values, shift = stiffnesses.copy(), np.zeros_like(stiffnesses)
            stiffness_values[meshes] *= np.abs(contact)
            shift[meshes] = np.array(contact) * self.half_gaps
            generator, drive = a.flow.generator.copy(), a.flow.drive.copy()
            deflection_rows = a.deflections / a.flow.modes.scales
            generator[a.size :, : a.size] -= (a.deflections.T * (stiffness_values - a.means)) @ deflection_rows
            drive[a.size :] += a.deflections.T @ (stiffness_values * shift)
            generator, drive = self.integrals.augmented_equations(
                generator, drive, stiffness_values, shift, self.grid.step_s
            )
            terms_of_state, terms_of_load = series(
                generator, drive, self.series_fraction * self.grid.step_s, self.terms
            )
            found.append((columns(terms_of_state), terms_of_load.ravel()))
        return np.stack([terms_of_state for terms_of_state, _ in found]), np.stack(
            [terms_of_load for _, terms_of_load in found]
        )


# ---- Exact transition ------------------------------------------------------------------------------------------------


_ORTHOGONAL = 1e-12  # product of unit vectors: less is rounding between rigid-body and other modes
_MAX_SAMPLES = 32  # samples computed at once
_MAX_COMBINATIONS = 256  # of mesh stiffnesses: each has propagators of its own
_CACHE = 1 << 16  # numbers: propagators over several samples have to stay in the processor's cache


@dataclass(frozen=True, kw_only=True)
class Transition:
    """Exact transition matrices between switching instants and samples: no discretisation error.

    For systems under constant load whose mesh stiffness is constant between its jumps (a rectangular one), without
    transmission error. The switching instants come from the inverse of the reference's angle, so the speed may vary.
    Meshes with backlash are linear from one contact event to the next: the instants at which teeth lose and regain
    contact are roots of a power series, found to rounding, so that energy does not drift over any number of contacts.

    Examples
    --------
    An oscillator of 2 rad/s released from 1 m is at ``cos 2 t``, at whatever sampling rate:

    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Output, Problem, ShaftAngle, State, Steps, System, Transition, integrate
    >>> one = np.eye(1)
    >>> system = System(mass=one, damping=0 * one, stiffness=4 * one, meshes=(), names=("mass x",))
    >>> problem = Problem(
    ...     system=system,
    ...     reference=ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1)),
    ...     load=Load(constant=np.zeros(1)),
    ...     duration_s=5.0,
    ...     start=State(displacement=np.ones(1), velocity=np.zeros(1)),
    ... )
    >>> output = Output(rate_hz=1.0, displacement=one)
    >>> found = integrate(problem, method=Transition(), output=output, tolerance=Steps(per_sample=1))
    >>> round(float(found.values[-1, 0] - np.cos(10)), 12) == 0
    True
    """

    @property
    def order(self) -> int | None:
        """None: there is no discretisation error, only rounding."""
        return None

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:  # noqa: ARG002
        """Return None: every step size is exact."""
        return None

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:  # noqa: ARG002
        """Return the stepper; ValueError with every property of the problem that excludes exact transitions."""
        found = obstacles(readings.assembled.problem)
        if found:
            raise ValueError(f"Transition cannot be exact here: {'; '.join(found)}. Use Splitting.")
        grid = Grid(assembled=readings.assembled, rate_hz=readings.output.rate_hz, per_sample=1)
        if meshes_with_backlash(readings.assembled).size:
            return contact_stepper(readings, grid)
        return _Stepper(readings, grid, ForceIntegrals.of(readings))


def obstacles(problem: Problem) -> tuple[str, ...]:
    """Return every property of a problem that excludes exact transition matrices."""
    load, meshes = problem.load, problem.system.meshes
    found = []
    if isinstance(problem.reference, CoupledReference):
        found.append("the reference is coupled to the motion")
    if load.quadratic_drag is not None and np.any(load.quadratic_drag):
        found.append("the load has a quadratic drag")
    if load.varying is not None:
        found.append("the load varies")
    if sum(mesh.backlash_m > 0 for mesh in meshes) > MAX_BACKLASHES:
        found.append(f"more than {MAX_BACKLASHES} meshes have backlash")
    for mesh in meshes:
        name, smooth = repr(mesh.name), not mesh.stiffness.constant_between_jumps
        exclusions = {
            f"the teeth of mesh {name} change in time": mesh.history is not None,
            f"mesh {name} has friction": bool(mesh.friction),
            f"mesh {name} has a transmission error": mesh.error is not None,
            f"the stiffness of mesh {name} is not constant between jumps": smooth,
        }
        found += [reason for reason, applies in exclusions.items() if applies]
    # meshes of one frequency have as many combinations of stiffnesses as jumps, others every pair
    jumps = Counter[float]()
    for mesh in meshes:
        jumps[mesh.cycles_per_rev] += len(mesh.stiffness.jumps)
    combinations = math.prod(max(count, 1) for count in jumps.values())
    if combinations > _MAX_COMBINATIONS:
        found.append(f"the stiffnesses have {combinations} combinations, of which {_MAX_COMBINATIONS} fit in memory")
    return tuple(found)


@dataclass(frozen=True)
class _Stepper:
    readings: Readings
    grid: Grid
    integrals: ForceIntegrals
    known: dict[tuple[float, ...], tuple[Array, ...]] = field(default_factory=dict)
    stacked: list["Propagators"] = field(default_factory=list)  # all that are known, in order

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Integrate over samples; see `Stepper.advance`."""
        from data_synth.integrators._exact_transition_kernels import Propagators, transition_steps  # noqa: PLC0415

        sample_s = self.grid.step_s
        start_s, stop_s = self.grid.at(first), self.grid.at(first + samples)
        switches, stiffnesses = switching(self.readings.assembled, start_s, stop_s)
        used, combinations = np.unique(stiffnesses, axis=0, return_inverse=True)
        rows = [tuple(row) for row in used.tolist()]
        new = [row for row in rows if row not in self.known]
        if new:
            self.known.update((row, _propagators(self.integrals, row, sample_s)) for row in new)
            self.stacked[:] = [Propagators(*(np.stack(parts) for parts in zip(*self.known.values(), strict=True)))]
        numbers = {row: number for number, row in enumerate(self.known)}
        combinations = np.array([numbers[row] for row in rows])[combinations.ravel()]
        read, constant = self.integrals.rows
        self.integrals.begin(x, start_s)
        out, state = np.empty((samples, read.shape[0])), self.integrals.augmented(x)
        transition_steps(state, out, read, constant, start_s, sample_s, switches, combinations, self.stacked[0], x.size)
        x[:] = state[: x.size]
        return self.integrals.read(out, self.grid, first)


def _propagators(integrals: ForceIntegrals, stiffnesses: tuple[float, ...], sample_s: float) -> tuple[Array, ...]:
    """Return the propagators of one combination of stiffnesses, in the order of `Propagators`."""
    a, (rows, constant) = integrals.readings.assembled, integrals.rows
    system, size = a.problem.system, a.size
    stiffness_values = np.array(stiffnesses)
    directions = np.array([mesh.direction for mesh in system.meshes], dtype=np.float64).reshape(-1, size)
    matrix = system.stiffness + (directions.T * stiffness_values) @ directions
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    flow = flow_of(modes_of(system.mass, matrix), damping, a.problem.load.constant)
    into, back = _change_of_modes(a.flow.modes, flow.modes, system.mass)
    generator, drive = integrals.augmented_equations(
        back @ flow.generator @ into, back @ flow.drive, stiffness_values, np.zeros_like(stiffness_values), sample_s
    )
    halvings, terms = halvings_and_terms(a, sample_s)
    steps = []
    for halving in range(halvings + 1):
        propagator, gain = flow.over(sample_s / 2**halving)
        steps.append(_with_integrals(a, generator, drive, back @ propagator @ into, back @ gain, sample_s / 2**halving))
    halved = np.stack([propagator for propagator, _ in steps])
    halved_gains = np.stack([gain for _, gain in steps])
    reset = halved[0].copy()
    reset[:, 2 * size :] = 0.0  # force integrals begin at zero with every sample
    powers, gains = _powers(reset, halved_gains[0])
    terms_of_state, terms_of_load = series(generator, drive, sample_s / 2**halvings, terms)
    return (
        powers.swapaxes(1, 2),
        gains,
        columns(rows @ powers),
        (gains @ rows.T + constant).ravel(),
        halved[1:].swapaxes(1, 2),
        halved_gains[1:],
        columns(terms_of_state),
        terms_of_load.ravel(),
    )


def _with_integrals(
    a: Assembled, generator: Array, drive: Array, propagator: Array, gain: Array, time_s: float
) -> tuple[Array, Array]:
    """Return propagator and gain of the state with force integrals, whose first part is known to full precision."""
    states, size = gain.size, drive.size
    if states == size:
        return propagator, gain
    augmented = np.zeros((size + 1, size + 1))
    augmented[:size, :size], augmented[:size, size] = generator * time_s, drive * time_s
    exponential = linalg.expm(augmented)
    exponential[:states, :states], exponential[:states, size] = propagator, gain
    # displacement of a rigid-body mode causes no mesh force
    exponential[states:size, np.flatnonzero(a.flow.modes.frequencies == 0)] = 0.0
    return exponential[:size, :size], exponential[:size, size]


def _powers(propagator: Array, gain: Array) -> tuple[Array, Array]:
    """Return the propagators over one sample, two, ..., and what the constant load adds, as many as fit in cache."""
    powers, gains = propagator[None], gain[None]
    while powers.shape[0] < _MAX_SAMPLES and 2 * powers.size <= _CACHE:
        powers, gains = (
            np.concatenate([powers, powers[-1] @ powers]),
            np.concatenate([gains, gains @ powers[-1].T + gains[-1]]),
        )
    return powers, gains


def _change_of_modes(base: Modes, other: Modes, mass: Array) -> tuple[Array, Array]:
    """Return the matrices from the coordinates of one set of modes to those of another, and back."""
    rotation = other.shapes.T @ mass @ base.shapes
    # rigid-body modes span the same space in both: rounding between them and others would grow with the angle
    rigid_and_other = (other.frequencies == 0)[:, None] != (base.frequencies == 0)
    rotation[rigid_and_other & (np.abs(rotation) < _ORTHOGONAL)] = 0.0
    zero = np.zeros_like(rotation)
    into = np.block([[other.scales[:, None] * rotation / base.scales, zero], [zero, rotation]])
    back = np.block([[base.scales[:, None] * rotation.T / other.scales, zero], [zero, rotation.T]])
    return into, back
