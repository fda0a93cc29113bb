"""Stretches of time over which every mesh stiffness is constant: switching instants, power series, force integrals.

A mesh force weighted with a hat is the sum of two integrals over each sample's time, tau from 0 to 1: of
``(1 - tau) f`` in the hat that falls, of ``tau f`` in the one that rises. With z1' = f and z2' = z1, both from zero at
each sample, they are z2 and z1 - z2; so z joins the state, and the exact flow of the longer state holds them exactly.
"""

import math
from dataclasses import dataclass

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, CoupledReference
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid

_ROUNDING = 1e-17  # of the state: terms of the power series below it change no digit
_SHORTEST = 0.5  # of the fastest motion's rad: over so short a stretch the power series is as exact as numbers are


def halvings_and_terms(a: Assembled, unit_s: float) -> tuple[int, int]:
    """Return how often to halve a unit until the power series takes over, and its terms, whatever stiffness holds."""
    fastest = np.sqrt(np.max(a.flow.modes.frequencies, initial=1.0) ** 2 + a.stiffness_variation) + np.linalg.norm(
        a.flow.damping, 2
    )
    halvings = max(0, int(np.ceil(np.log2(fastest * unit_s / _SHORTEST))))
    left, terms = fastest * unit_s / 2**halvings, 1
    while left**terms / math.factorial(terms) > _ROUNDING:
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
    between = reference.revolutions((edges[1:] + edges[:-1]) / 2)
    values = [mesh.stiffness(mesh.cycles_per_rev * between) for mesh in meshes]
    return switches, np.array(values, dtype=np.float64).reshape(len(meshes), between.size).T


def columns(matrices: Array) -> Array:
    """Return the columns of matrices (k, rows, columns) below each other, (columns, k rows)."""
    return np.ascontiguousarray(np.moveaxis(matrices, 2, 0)).reshape(matrices.shape[2], -1)


def series(generator: Array, drive: Array, time_s: float, terms: int) -> tuple[Array, Array]:
    """Return ``(generator time)^k / k!`` for k = 1, 2, ..., and what the drive adds to each term."""
    rate, push = generator * time_s, drive * time_s
    powers, gains = [rate], [push]
    for k in range(2, terms + 1):
        powers.append(rate @ powers[-1] / k)
        gains.append(rate @ gains[-1] / k)
    return np.stack(powers), np.stack(gains)


@dataclass(frozen=True, kw_only=True)
class ForceIntegrals:
    """What exact transitions carry beside x where mesh forces under triangular weights are wanted, and nothing else.

    ``meshes`` is 0 where nobody asks; ``coming`` (meshes,) is what forces add to the next hat, NaN before the start.
    """

    readings: Readings
    meshes: int
    coming: Array

    @classmethod
    def of(cls, readings: Readings) -> "ForceIntegrals":
        """Prepare."""
        meshes = readings.assembled.backlashes.size if readings.output.weighted_mesh_force is not None else 0
        return cls(readings=readings, meshes=meshes, coming=np.full(meshes, np.nan))

    @property
    def seen(self) -> Array:
        """Rows (meshes, 2 n) of the deflections."""
        a = self.readings.assembled
        return a.displacement_rows(a.deflections[: self.meshes])

    @property
    def rows(self) -> tuple[Array, Array]:
        """What is read of the longer state: the readings, the deflections, z1 and z2; and the constants to add."""
        rows, z = self.readings.rows, np.eye(2 * self.meshes)
        read = np.vstack([rows, self.seen])
        constant = np.concatenate([self.readings.constant, np.zeros(3 * self.meshes)])
        return np.block(
            [[read, np.zeros((read.shape[0], z.shape[1]))], [np.zeros((z.shape[0], rows.shape[1])), z]]
        ), constant

    def joined(
        self, generator: Array, drive: Array, stiffnesses: Array, shift: Array, unit_s: float
    ) -> tuple[Array, Array]:
        """Return generator and drive of the longer state; forces are ``stiffnesses (deflections - shift)``."""
        m, size = self.meshes, drive.size
        longer, pushed = np.zeros((size + 2 * m, size + 2 * m)), np.zeros(size + 2 * m)
        longer[:size, :size], pushed[:size] = generator, drive
        longer[size : size + m, :size] = stiffnesses[:m, None] * self.seen / unit_s
        longer[size + m :, size : size + m] = np.eye(m) / unit_s
        pushed[size : size + m] = -stiffnesses[:m] * shift[:m] / unit_s
        return longer, pushed

    def longer(self, x: Array) -> Array:
        """Return x with z beside it."""
        return np.concatenate([x, np.zeros(2 * self.meshes)])

    def begin(self, x: Array, time_s: float) -> None:
        """Take forces to have been the same before the start."""
        if self.meshes and np.isnan(self.coming).any():
            self.coming[:] = self.readings.at(x, time_s)[0, -self.meshes :] / 2

    def read(self, found: Array, grid: Grid, first: int) -> Array:
        """Return readings (samples, readings) of what is read of the longer state, from sample `first` on."""
        m, count = self.meshes, self.readings.rows.shape[0]
        if not m:
            return found
        z1, z2 = found[:, count + m : count + 2 * m], found[:, count + 2 * m :]
        rising = np.vstack([self.coming, z1 - z2])
        self.coming[:] = rising[-1]
        now = self.readings.forces_at(found[:, count : count + m], grid.edges(first, found.shape[0])[1:])
        return np.hstack([found[:, :count], rising[:-1] + z2, now])
