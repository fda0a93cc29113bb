"""Output equation: readings of the state at each sample, and the output channels computed from them."""

from dataclasses import dataclass

import numpy as np

from data_synth.integrators.modal_problem import Assembled
from data_synth.integrators.problem import Array, Output


@dataclass(frozen=True, kw_only=True)
class Readings:
    """Linear readings ``rows @ x + constant`` that a stepper computes, and the output channels that follow from them.

    ``rows`` (readings, 2 n) and ``constant`` (readings,): the linear part of the channels, then, where these contain
    accelerations or mesh forces, the deflections and the velocities with drag.
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
        weighted = _mesh_forces(a, deflections[None], a.revolutions(now), now)
        return np.hstack([read, weighted, weighted])

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
        revolutions = a.revolutions(times_s)
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
