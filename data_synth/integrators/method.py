"""Protocols of an integrator: a method makes a stepper, which integrates over a block of samples."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from data_synth.integrators.modal_problem import Assembled
from data_synth.integrators.problem import Array, Outcome, Output

# ---- Output equation: readings of the state at each sample, and the output channels computed from them ---------------


@dataclass(frozen=True, kw_only=True)
class Readings:
    """Linear readings ``rows @ x + constant`` that a stepper computes, and the output channels that follow from them.

    ``rows`` (readings, 2 n) and ``constant`` (readings,): the linear part of the channels, then, where these contain
    accelerations or mesh forces, the deflections, the velocities with drag and the angle of a coupled reference.
    """

    assembled: Assembled
    output: Output
    rows: Array
    constant: Array
    forces: Array
    accelerations: Array

    @classmethod
    def of(cls, assembled: Assembled, output: Output) -> "Readings":
        """Return the readings for an output; ValueError for maps of the wrong shape."""
        modes, size, channels = assembled.flow.modes, assembled.size, output.channels
        for name, given in output.maps.items():
            width = assembled.backlashes.size if name.endswith("mesh_force") else size
            if given.shape != (channels, width) or not np.all(np.isfinite(given)):
                raise ValueError(f"output.{name} must be finite ({channels}, {width}); its shape is {given.shape}.")
        rows, constant = np.zeros((channels, 2 * size)), np.zeros(channels)
        accelerations = np.zeros((channels, size))
        if output.displacement is not None:
            rows += assembled.displacement_rows(modes.rows(output.displacement))
        if output.velocity is not None:
            rows += assembled.velocity_rows(output.velocity @ modes.shapes)
        if output.acceleration is not None:
            accelerations = output.acceleration @ modes.shapes
            rows += accelerations @ assembled.flow.generator[size:]
            constant += accelerations @ assembled.flow.drive[size:]
        weights, forces = output.weighted_mesh_force is not None, np.zeros((channels, assembled.backlashes.size))
        if output.mesh_force is not None and not weights:  # else a stepper returns forces at samples as well
            forces = output.mesh_force
        if output.acceleration is not None or forces.any():
            further = [
                assembled.displacement_rows(assembled.deflections),
                assembled.velocity_rows(assembled.drags),
                assembled.displacement_rows(assembled.reference_row.reshape(-1, size)),
            ]
            rows = np.vstack([rows, *further])
        constant = np.concatenate([constant, np.zeros(rows.shape[0] - channels)])
        return cls(
            assembled=assembled,
            output=output,
            rows=np.ascontiguousarray(rows),
            constant=constant,
            forces=forces,
            accelerations=accelerations,
        )

    def shares(self) -> Array:
        """Return the share of each mode in each reading (readings, modes) after a jump of force; norms are one."""
        a = self.assembled
        force_column = np.max(np.abs(a.equations.force_columns), axis=1, initial=0.0)
        # after a jump of force a mode has the same amplitude in w y and in y'
        amplitude = np.where(a.flow.modes.frequencies > 0, force_column / a.flow.modes.scales, 0.0)
        sensitivity = np.hypot(self.rows[:, : a.size], self.rows[:, a.size :]) * amplitude
        whole = np.linalg.norm(sensitivity, axis=1, keepdims=True)
        return np.asarray(sensitivity / np.where(whole > 0, whole, 1.0))

    def at(self, x: Array, time_s: float) -> Array:
        """Return the readings (1, readings) of a state."""
        read = (self.rows @ x + self.constant)[None]
        if self.output.weighted_mesh_force is None:
            return np.asarray(read)
        a = self.assembled
        deflections = x[: a.size] @ a.equations.deflection_rows[:, : a.backlashes.size]
        now = np.array([time_s])
        revolutions = (
            a.reference_row @ (x[: a.size] / a.flow.modes.scales) if a.reference_row.size else a.revolutions(now)
        )
        weighted = _mesh_forces(a, deflections[None], np.atleast_1d(revolutions), now)
        return np.hstack([read, weighted, weighted])

    def forces_at(self, deflections: Array, times_s: Array) -> Array:
        """Return mesh forces (times, meshes) at deflections, for a prescribed angle of the reference."""
        return _mesh_forces(self.assembled, deflections, self.assembled.revolutions(times_s), times_s)

    def channels(self, readings: Array, times_s: Array) -> Array:
        """Return the channels (times, channels) from readings (times, readings)."""
        weights, forces = self.output.weighted_mesh_force, self.output.mesh_force
        if weights is None:
            return self._values(readings, times_s)
        count, meshes = self.rows.shape[0], self.assembled.backlashes.size
        values = self._values(readings[:, :count], times_s) + readings[:, count : count + meshes] @ weights.T
        return np.asarray(values if forces is None else values + readings[:, count + meshes :] @ forces.T)

    def _values(self, readings: Array, times_s: Array) -> Array:
        """Return the channels without the mesh forces that a stepper returns."""
        count = self.output.channels
        if readings.shape[1] == count:
            return readings
        a = self.assembled
        meshes, drags = a.backlashes.size, a.drag_factors.size
        values, deflections = readings[:, :count].copy(), readings[:, count : count + meshes]
        speeds = readings[:, count + meshes : count + meshes + drags]
        revolutions = readings[:, -1] if a.reference_row.size else a.revolutions(times_s)
        force = _mesh_forces(a, deflections, revolutions, times_s)
        nonlinear = force - a.means * deflections
        values += force @ self.forces.T - nonlinear @ (self.accelerations @ a.deflections.T).T
        if a.friction_mesh.size:
            values += _friction_forces(a, force, revolutions) @ (self.accelerations @ a.friction_rows.T).T
        values -= (a.drag_factors * speeds * np.abs(speeds)) @ (self.accelerations @ a.drags.T).T
        loads = a.loads(times_s)
        return np.asarray(values + loads @ (self.accelerations @ a.load_rows.T).T if loads.size else values)


def _mesh_forces(a: Assembled, deflections: Array, revolutions: Array, times_s: Array) -> Array:
    """Return ``k f(delta - e)`` (times, meshes)."""
    forces = np.empty_like(deflections)
    for number, mesh in enumerate(a.problem.system.meshes):
        phase = mesh.cycles_per_rev * revolutions
        stiffness, error = mesh.teeth_at(phase, times_s)
        deflection = deflections[:, number] - error
        compression = deflection - np.clip(deflection, -mesh.backlash_m, mesh.backlash_m)
        forces[:, number] = stiffness * compression
    return forces


def _friction_forces(a: Assembled, forces: Array, revolutions: Array) -> Array:
    """Return friction forces (times, friction) from mesh forces (times, meshes)."""
    columns = []
    for number, mesh in enumerate(a.problem.system.meshes):
        driving = np.maximum(forces[:, number], 0.0) if mesh.backlash_m > 0 else forces[:, number]
        columns += [driving * force.factor(mesh.cycles_per_rev * revolutions) for force in mesh.friction]
    return np.stack(columns, axis=1)


# ---- Method ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Why a step size is refused: outcome, and the numbers behind it."""

    outcome: Outcome
    detail: str


class Stepper(Protocol):
    """Integrates from sample to sample, and may keep a state of its own beside x."""

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Return readings (samples, readings) at the samples after number `first`; x is updated in place."""


class Method(Protocol):
    """An integrator and its settings: `Splitting`, `Transition`, or one with the same members."""

    @property
    def order(self) -> int | None:
        """Order of the global error in the step size for smooth motion; None without discretisation error."""

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Return why a step size is refused; None where it is not."""

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Return a stepper for a number of steps to each sample."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Times of samples and steps."""

    assembled: Assembled
    rate_hz: float
    per_sample: int

    @property
    def step_s(self) -> float:
        """Length of a step."""
        return 1.0 / (self.rate_hz * self.per_sample)

    def at(self, sample: int) -> float:
        """Return the time of a sample."""
        return self.assembled.problem.start_s + sample * self.per_sample * self.step_s

    def edges(self, first: int, samples: int) -> Array:
        """Return the times (steps + 1,) at which steps begin, and the last ends."""
        steps = first * self.per_sample + np.arange(samples * self.per_sample + 1)
        return np.asarray(self.assembled.problem.start_s + steps * self.step_s)
