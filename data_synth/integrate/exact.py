"""Exact transition matrices where every mesh stiffness is constant between jumps."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate._modes import Modes, flow_of, modes_of
from data_synth.integrate.assembled import Assembled, Readings
from data_synth.integrate.problem import Array, TiedTo
from data_synth.integrate.stepping import Grid, Refusal, Stepper

Integers = NDArray[np.int64]

_ALIKE = 1e-12  # of unit vectors' product: less is rounding between rigid modes and others
_SHORTEST = 0.5  # of the norm times the last rung of a ladder: from there on the power series takes over


@dataclass(frozen=True, kw_only=True)
class Transition:
    """Matrix exponentials from one switching instant to the next, and to each sample between: no error of steps.

    For linear systems under constant load, with stiffnesses that are constant between jumps (rectangular ones) and no
    transmission error. Switching instants come from the inverse of the reference's angle, so its speed may vary.
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
        return _Stepper(readings=readings, grid=grid)


def _obstacles(assembled: Assembled) -> list[str]:
    problem = assembled.problem
    found = []
    if isinstance(problem.turning, TiedTo):
        found.append("the reference is tied to the motion")
    if assembled.drag_factors.size:
        found.append("the load has a quadratic drag")
    if problem.load.varying is not None:
        found.append("the load varies")
    for mesh in problem.system.meshes:
        if mesh.backlash_m > 0:
            found.append(f"mesh {mesh.name!r} has backlash")
        if mesh.error is not None:
            found.append(f"mesh {mesh.name!r} has a transmission error")
        if not mesh.stiffness.constant_between_jumps:
            found.append(f"the stiffness of mesh {mesh.name!r} is not constant between jumps")
    return found


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    readings: Readings
    grid: Grid
    ladders: dict[tuple[float, ...], tuple[Array, Array, Array, float]] = field(default_factory=dict)

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._transition_kernels import transition_steps  # noqa: PLC0415

        a, read = self.readings.assembled, self.readings
        times_s = self.grid.edges(first, samples)
        switches, stiffnesses = _switching(a, times_s[0], times_s[-1])
        kinds = np.zeros(switches.size + 1, dtype=np.int64)
        for column in stiffnesses.T:
            levels, level = np.unique(column, return_inverse=True)
            kinds = kinds * levels.size + level
        _, firsts, kinds = np.unique(kinds, return_index=True, return_inverse=True)
        used = [tuple(row) for row in stiffnesses[firsts].tolist()]
        for row in set(used) - self.ladders.keys():
            self.ladders[row] = _ladder(a, row, self.grid.step_s, _rungs(a, self.grid.step_s))
        ladders, gains, generators, norms = zip(*(self.ladders[row] for row in used), strict=True)
        out = np.empty((samples, read.rows.shape[0]))
        transition_steps(
            x,
            out,
            read.rows,
            read.constant,
            times_s,
            switches,
            kinds,
            np.stack(ladders),
            np.stack(gains),
            np.stack(generators),
            a.flow.drive,
            np.array(norms),
            self.grid.step_s,
        )
        return out


def _rungs(a: Assembled, unit_s: float) -> int:
    """Return how often to halve the time until the power series takes over, under whatever stiffness holds."""
    fastest = np.sqrt(np.max(a.flow.modes.frequencies, initial=1.0) ** 2 + a.swing) + np.linalg.norm(a.flow.damping, 2)
    return 1 + max(0, int(np.ceil(np.log2(fastest * unit_s / _SHORTEST))))


def _switching(a: Assembled, start_s: float, stop_s: float) -> tuple[Array, Array]:
    """Return switching instants within (start, stop) and stiffnesses (switches + 1, meshes) between them."""
    turning, meshes = a.problem.turning, a.problem.system.meshes
    assert not isinstance(turning, TiedTo)  # noqa: S101
    begin, end = turning.revolutions(np.array([start_s, stop_s]))
    instants = [np.zeros(0)]
    for mesh in meshes:
        low, high = sorted((begin * mesh.cycles_per_rev, end * mesh.cycles_per_rev))
        period = mesh.stiffness.period
        for jump in mesh.stiffness.jumps:
            phases = jump + period * np.arange(np.floor((low - jump) / period), np.ceil((high - jump) / period) + 1)
            phases = phases[(phases > low) & (phases < high)]
            instants.append(turning.times(phases / mesh.cycles_per_rev))
    switches = np.unique(np.concatenate(instants))
    switches = switches[(switches > start_s) & (switches < stop_s)]
    edges = np.concatenate([[start_s], switches, [stop_s]])
    between = turning.revolutions((edges[1:] + edges[:-1]) / 2)
    values = [mesh.stiffness(mesh.cycles_per_rev * between) for mesh in meshes]
    return switches, np.array(values, dtype=np.float64).reshape(len(meshes), between.size).T


def _ladder(
    a: Assembled, stiffnesses: tuple[float, ...], unit_s: float, rungs: int
) -> tuple[Array, Array, Array, float]:
    """Return propagators over unit, unit / 2, ... as columns, what the drive adds, the generator, and its norm."""
    system, size = a.problem.system, a.size
    directions = np.array([mesh.direction for mesh in system.meshes], dtype=np.float64).reshape(-1, size)
    matrix = system.stiffness + (directions.T * np.array(stiffnesses)) @ directions
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    flow = flow_of(modes_of(system.mass, matrix), damping, a.problem.load.constant)
    into, back = _between(a.flow.modes, flow.modes, system.mass)
    norm = float(np.linalg.norm(flow.generator, 2))
    propagators, gains = zip(*(flow.over(unit_s / 2**rung) for rung in range(rungs)), strict=True)
    return (
        np.stack([(back @ propagator @ into).T for propagator in propagators]),
        np.stack([back @ gain for gain in gains]),
        np.ascontiguousarray((back @ flow.generator @ into).T),
        norm,
    )


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
