"""Exact transition matrices where every mesh stiffness is constant between jumps."""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from data_synth.integrate._modes import Modes, flow_of, modes_of
from data_synth.integrate.assembled import Assembled
from data_synth.integrate.contacts import MAX_BACKLASHES, contact_stepper, meshes_with_backlash
from data_synth.integrate.pieces import ForceIntegrals, columns, halvings_and_terms, series, switching
from data_synth.integrate.problem import Array, CoupledReference, Problem
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid, Refusal, Stepper

if TYPE_CHECKING:
    from data_synth.integrate._transition_kernels import Propagators

Integers = NDArray[np.int64]

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
    >>> from data_synth.integrate import Load, Output, Problem, State, Steps, Transition, integrate
    >>> from data_synth.mechanics import System
    >>> from data_synth.profile import ShaftAngle
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
        from data_synth.integrate._transition_kernels import Propagators, transition_steps  # noqa: PLC0415

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
