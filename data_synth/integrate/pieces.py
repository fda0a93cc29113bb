"""Intervals of constant mesh stiffness: switching instants, power series, integrals of mesh forces.

A mesh force under a triangular weight is the sum of two integrals over each sample interval, tau from 0 to 1: of
``(1 - tau) f`` where the weight falls, of ``tau f`` where it rises. With z1' = f and z2' = z1, both zero at the
beginning of each interval, they are z2 and z1 - z2; so z is appended to the state, and its exact flow contains them.
"""

import math
from dataclasses import dataclass

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, CoupledReference
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid

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
    """Return matrices (k, rows, columns) as one array of their columns, (columns, k rows)."""
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
