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
from data_synth.integrate.contacts import MOST_GAPS, contact_stepper, gaps_of
from data_synth.integrate.pieces import ForceIntegrals, columns, rungs, series, switching
from data_synth.integrate.problem import Array, Problem, TiedTo
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid, Refusal, Stepper

if TYPE_CHECKING:
    from data_synth.integrate._transition_kernels import Flows

Integers = NDArray[np.int64]

_ALIKE = 1e-12  # of unit vectors' product: less is rounding between rigid modes and others
_MOST_UNITS = 32  # samples read at once
_MOST_KINDS = 256  # combinations of stiffnesses: each has propagators of its own
_ROOM = 1 << 16  # numbers: propagators over that many units have to stay near the processor


@dataclass(frozen=True, kw_only=True)
class Transition:
    """Matrix exponentials from one switching instant to the next, and to each sample between: no error of steps.

    For systems under constant load, with stiffnesses that are constant between jumps (rectangular ones) and no
    transmission error. Switching instants come from the inverse of the reference's angle, so its speed may vary.
    Backlash keeps them linear from one contact to the next: the instants at which teeth part or meet are roots of a
    power series, found to rounding, so that energy does not drift over any number of contacts.
    """

    @property
    def order(self) -> int | None:
        """None: what is left is rounding."""
        return None

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:  # noqa: ARG002
        """Refuse nothing: any step is exact."""
        return None

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:  # noqa: ARG002
        """Prepare; ValueError with all that stands in the way of exactness."""
        found = obstacles(readings.assembled.problem)
        if found:
            raise ValueError(f"Transition cannot be exact here: {'; '.join(found)}. Use Splitting.")
        grid = Grid(assembled=readings.assembled, rate_hz=readings.output.rate_hz, per_sample=1)
        if gaps_of(readings.assembled).size:
            return contact_stepper(readings, grid)
        return _Stepper(readings, grid, ForceIntegrals.of(readings))


def obstacles(problem: Problem) -> tuple[str, ...]:
    """Return all that keeps transitions from being exact; nothing where they are."""
    load, meshes = problem.load, problem.system.meshes
    found = []
    if isinstance(problem.turning, TiedTo):
        found.append("the reference is tied to the motion")
    if load.quadratic_drag is not None and np.any(load.quadratic_drag):
        found.append("the load has a quadratic drag")
    if load.varying is not None:
        found.append("the load varies")
    if sum(mesh.backlash_m > 0 for mesh in meshes) > MOST_GAPS:
        found.append(f"more than {MOST_GAPS} meshes have backlash")
    for mesh in meshes:
        name, smooth = repr(mesh.name), not mesh.stiffness.constant_between_jumps
        stands = {
            f"the teeth of mesh {name} change in time": mesh.history is not None,
            f"mesh {name} has friction": bool(mesh.friction),
            f"mesh {name} has a transmission error": mesh.error is not None,
            f"the stiffness of mesh {name} is not constant between jumps": smooth,
        }
        found += [what for what, there in stands.items() if there]
    # meshes in step with each other have as many combinations as jumps, others any of theirs with any
    jumps = Counter[float]()
    for mesh in meshes:
        jumps[mesh.cycles_per_rev] += len(mesh.stiffness.jumps)
    kinds = math.prod(max(count, 1) for count in jumps.values())
    if kinds > _MOST_KINDS:
        found.append(f"the stiffnesses may come in {kinds} combinations, of which {_MOST_KINDS} fit in memory")
    return tuple(found)


@dataclass(frozen=True)
class _Stepper:
    readings: Readings
    grid: Grid
    integrals: ForceIntegrals
    known: dict[tuple[float, ...], tuple[Array, ...]] = field(default_factory=dict)
    stacked: list["Flows"] = field(default_factory=list)  # all that are known, in order

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._transition_kernels import Flows, transition_steps  # noqa: PLC0415

        unit_s = self.grid.step_s
        start_s, stop_s = self.grid.at(first), self.grid.at(first + samples)
        switches, stiffnesses = switching(self.readings.assembled, start_s, stop_s)
        used, kinds = np.unique(stiffnesses, axis=0, return_inverse=True)
        rows = [tuple(row) for row in used.tolist()]
        new = [row for row in rows if row not in self.known]
        if new:
            self.known.update((row, _flow_under(self.integrals, row, unit_s)) for row in new)
            self.stacked[:] = [Flows(*(np.stack(parts) for parts in zip(*self.known.values(), strict=True)))]
        numbers = {row: number for number, row in enumerate(self.known)}
        kinds = np.array([numbers[row] for row in rows])[kinds.ravel()]
        read, constant = self.integrals.rows
        self.integrals.begin(x, start_s)
        out, state = np.empty((samples, read.shape[0])), self.integrals.longer(x)
        transition_steps(state, out, read, constant, start_s, unit_s, switches, kinds, self.stacked[0], x.size)
        x[:] = state[: x.size]
        return self.integrals.read(out, self.grid, first)


def _flow_under(integrals: ForceIntegrals, stiffnesses: tuple[float, ...], unit_s: float) -> tuple[Array, ...]:
    """Return what `Flows` holds of one kind."""
    a, (rows, constant) = integrals.readings.assembled, integrals.rows
    system, size = a.problem.system, a.size
    held = np.array(stiffnesses)
    directions = np.array([mesh.direction for mesh in system.meshes], dtype=np.float64).reshape(-1, size)
    matrix = system.stiffness + (directions.T * held) @ directions
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    flow = flow_of(modes_of(system.mass, matrix), damping, a.problem.load.constant)
    into, back = _between(a.flow.modes, flow.modes, system.mass)
    generator, drive = integrals.joined(
        back @ flow.generator @ into, back @ flow.drive, held, np.zeros_like(held), unit_s
    )
    halvings, terms = rungs(a, unit_s)
    steps = []
    for rung in range(halvings + 1):
        propagator, gain = flow.over(unit_s / 2**rung)
        steps.append(_beside(a, generator, drive, back @ propagator @ into, back @ gain, unit_s / 2**rung))
    ladder = np.stack([propagator for propagator, _ in steps])
    ladder_gains = np.stack([gain for _, gain in steps])
    afresh = ladder[0].copy()
    afresh[:, 2 * size :] = 0.0  # integrals begin at zero with every sample
    powers, gains = _repeated(afresh, ladder_gains[0])
    powered, pushed = series(generator, drive, unit_s / 2**halvings, terms)
    return (
        powers.swapaxes(1, 2),
        gains,
        columns(rows @ powers),
        (gains @ rows.T + constant).ravel(),
        ladder[1:].swapaxes(1, 2),
        ladder_gains[1:],
        columns(powered),
        pushed.ravel(),
    )


def _beside(
    a: Assembled, generator: Array, drive: Array, propagator: Array, gain: Array, time_s: float
) -> tuple[Array, Array]:
    """Return propagator and gain of the longer state, whose first part is known with every digit."""
    inner, size = gain.size, drive.size
    if inner == size:
        return propagator, gain
    augmented = np.zeros((size + 1, size + 1))
    augmented[:size, :size], augmented[:size, size] = generator * time_s, drive * time_s
    whole = linalg.expm(augmented)
    longer, gains = whole[:size, :size], whole[:size, size]
    longer[:inner, :inner], gains[:inner] = propagator, gain
    longer[inner:, np.flatnonzero(a.flow.modes.frequencies == 0)] = 0.0  # no angle of a rigid mode presses teeth
    return longer, gains


def _repeated(propagator: Array, gain: Array) -> tuple[Array, Array]:
    """Return propagators over one unit, two, ... as many as are worth their room, and what the drive adds."""
    powers, gains = propagator[None], gain[None]
    while powers.shape[0] < _MOST_UNITS and 2 * powers.size <= _ROOM:
        powers, gains = (
            np.concatenate([powers, powers[-1] @ powers]),
            np.concatenate([gains, gains @ powers[-1].T + gains[-1]]),
        )
    return powers, gains


def _between(base: Modes, other: Modes, mass: Array) -> tuple[Array, Array]:
    """Return the matrices from coordinates of one set of modes to those of another, and back."""
    turn = other.shapes.T @ mass @ base.shapes
    # rigid modes are the same space in both: what rounding mixes in would grow with the angle turned
    apart = (other.frequencies == 0)[:, None] != (base.frequencies == 0)
    turn[apart & (np.abs(turn) < _ALIKE)] = 0.0
    zero = np.zeros_like(turn)
    into = np.block([[other.scales[:, None] * turn / base.scales, zero], [zero, turn]])
    back = np.block([[base.scales[:, None] * turn.T / other.scales, zero], [zero, turn.T]])
    return into, back
