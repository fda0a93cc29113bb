"""Exact transition matrices where every mesh stiffness is constant between jumps."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate._modes import Modes, flow_of, modes_of
from data_synth.integrate.assembled import Assembled
from data_synth.integrate.contacts import MOST_GAPS, contact_stepper, gaps_of
from data_synth.integrate.pieces import columns, rungs, series, switching
from data_synth.integrate.problem import Array, TiedTo
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid, Refusal, Stepper

Integers = NDArray[np.int64]

_ALIKE = 1e-12  # of unit vectors' product: less is rounding between rigid modes and others
_MOST_UNITS = 32  # samples read at once
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
        obstacles = _obstacles(readings.assembled)
        if obstacles:
            raise ValueError(f"Transition cannot be exact here: {'; '.join(obstacles)}. Use Splitting.")
        grid = Grid(assembled=readings.assembled, rate_hz=readings.output.rate_hz, per_sample=1)
        return contact_stepper(readings, grid) if gaps_of(readings.assembled).size else _Stepper(readings, grid)


def _obstacles(assembled: Assembled) -> list[str]:
    problem = assembled.problem
    found = []
    if isinstance(problem.turning, TiedTo):
        found.append("the reference is tied to the motion")
    if assembled.drag_factors.size:
        found.append("the load has a quadratic drag")
    if problem.load.varying is not None:
        found.append("the load varies")
    if gaps_of(assembled).size > MOST_GAPS:
        found.append(f"more than {MOST_GAPS} meshes have backlash")
    for mesh in problem.system.meshes:
        if mesh.friction:
            found.append(f"mesh {mesh.name!r} has friction")
        if mesh.error is not None:
            found.append(f"mesh {mesh.name!r} has a transmission error")
        if not mesh.stiffness.constant_between_jumps:
            found.append(f"the stiffness of mesh {mesh.name!r} is not constant between jumps")
    return found


@dataclass(frozen=True)
class _Stepper:
    readings: Readings
    grid: Grid
    known: dict[tuple[float, ...], tuple[Array, ...]] = field(default_factory=dict)

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._transition_kernels import Flows, transition_steps  # noqa: PLC0415

        a, read, unit_s = self.readings.assembled, self.readings, self.grid.step_s
        start_s, stop_s = self.grid.at(first), self.grid.at(first + samples)
        switches, stiffnesses = switching(a, start_s, stop_s)
        used, kinds = np.unique(stiffnesses, axis=0, return_inverse=True)
        rows = [tuple(row) for row in used.tolist()]
        for row in set(rows) - self.known.keys():
            self.known[row] = _flow_under(read, row, unit_s)
        flows = Flows(*(np.stack(parts) for parts in zip(*(self.known[row] for row in rows), strict=True)))
        out = np.empty((samples, read.rows.shape[0]))
        transition_steps(x, out, read.rows, read.constant, start_s, unit_s, switches, kinds.ravel(), flows)
        return out


def _flow_under(read: Readings, stiffnesses: tuple[float, ...], unit_s: float) -> tuple[Array, ...]:
    """Return what `Flows` holds of one kind."""
    a = read.assembled
    system, size = a.problem.system, a.size
    directions = np.array([mesh.direction for mesh in system.meshes], dtype=np.float64).reshape(-1, size)
    matrix = system.stiffness + (directions.T * np.array(stiffnesses)) @ directions
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    flow = flow_of(modes_of(system.mass, matrix), damping, a.problem.load.constant)
    into, back = _between(a.flow.modes, flow.modes, system.mass)
    halvings, terms = rungs(a, unit_s)
    steps = [flow.over(unit_s / 2**rung) for rung in range(halvings + 1)]
    ladder = np.stack([back @ propagator @ into for propagator, _ in steps])
    ladder_gains = np.stack([back @ gain for _, gain in steps])
    powers, gains = _repeated(ladder[0], ladder_gains[0])
    powered, pushed = series(back @ flow.generator @ into, back @ flow.drive, unit_s / 2**halvings, terms)
    return (
        powers.swapaxes(1, 2),
        gains,
        columns(read.rows @ powers),
        (gains @ read.rows.T + read.constant).ravel(),
        ladder[1:].swapaxes(1, 2),
        ladder_gains[1:],
        columns(powered),
        pushed.ravel(),
    )


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
