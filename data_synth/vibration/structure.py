"""Response of the motions that a fidelity leaves out, as far as the sensors.

Where bodies only turn, their bearings still lie between the teeth and the sensor, and pass a mesh force as oscillators
do: whole far below the mode of the body on its bearing, ever less above. With r the simulated motions, which all others
q follow as ``q = E r + d``, and P the simulated ones among all, the equations of both leave for d

    M d'' + C d' + K d = (P g_r - g) F + (P K_r - K_s E) r + (P C_r - C E) r' + (P M_r - M E) r''

F the simulated mesh forces, K with meshes of mean stiffness, K_s without. So a mesh force reaches a sensor as in the
motions with nothing left out: exactly where stiffness is constant. Else what is missing is the change of stiffness
times the deflection of the meshes by d.

Velocities and accelerations of r have much at high frequencies, which sampling would fold; displacements have not.
With ``c / (s - p)`` the response to one of the terms, that to r' is ``c p / (s - p) + c`` to r, that to r'' is ``c
p^2 / (s - p) + c p`` to r and c to r': so the inputs are F and r alone, and what does not vanish of the sums of c and
c p over the poles is read beside.
"""

from dataclasses import dataclass, field

import numpy as np

from data_synth.dynamics.active_dofs import ActiveDofs, active_dofs_of
from data_synth.dynamics.assembly import Assembly
from data_synth.dynamics.modes import undamped_modes, with_modal_damping
from data_synth.dynamics.system import Array, System
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.transfer.housing import AHEAD, CORRECTION, step_weights

_NEGLIGIBLE = 1e-9  # N per N of mesh force through a pole, and of the terms of a coefficient that cancel


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Frequency responses from what is simulated to readings, ``Re sum_p outputs_p inputs_p / (s - poles_p)``.

    Attributes
    ----------
    poles : (pole,) complex array
        rad/s; one of each conjugate pair.
    inputs : (pole, input) complex array
        Excitation of each pole per unit of an input.
    outputs : (reading, pole) complex array
        N; of a pair twice that of one.
    maps : mapping of "displacement" and "mesh_force" to (input, dof or mesh) arrays
        The inputs, of the simulated motions and mesh forces.
    beside : mapping of "displacement" and "velocity" to (reading, dof) arrays
        What the readings have of the simulated motions at once.
    """

    poles: ComplexArray = field(metadata={"dims": ("pole",), "units": "rad/s"})
    inputs: ComplexArray = field(repr=False, metadata={"dims": ("pole", "input"), "units": "input-1"})
    outputs: ComplexArray = field(repr=False, metadata={"dims": ("reading", "pole"), "units": "N"})
    maps: dict[str, Array] = field(repr=False)
    beside: dict[str, Array] = field(repr=False)

    @property
    def readings(self) -> int:
        """Number of readings; the inputs follow them."""
        return int(self.outputs.shape[0])

    def response(self, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitudes of the readings per unit of an input, (reading, input, line)."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        residues = (self.outputs[:, None] / 2 * self.inputs.T).reshape(-1, self.poles.size)  # a product of matrices
        found = residues @ (1 / (s - self.poles[:, None])) + residues.conj() @ (1 / (s - self.poles.conj()[:, None]))
        return np.asarray(found.reshape(self.readings, -1, s.size))

    def filter_at(self, rate_hz: float) -> "StructureFilter":
        """Return the filter at rest under its first sample, for readings at `rate_hz`."""
        return StructureFilter(self, rate_hz=rate_hz)


class StructureFilter:
    """A `Structure` with its state, block by block."""

    def __init__(self, structure: Structure, *, rate_hz: float) -> None:
        self._of, self._rate_hz = structure, rate_hz
        self._decay = np.exp(structure.poles / rate_hz)
        late, early = step_weights(structure.poles / rate_hz)
        self._new, self._old = late / rate_hz, early / rate_hz
        self._states: ComplexArray | None = None
        self._history = self._smooth = self._points = np.empty((0, 0))

    def push(self, smooth: Array, points: Array) -> tuple[Array, Array]:
        """Return the readings (n, readings), `AHEAD` samples behind the next (n, readings + inputs).

        Parameters
        ----------
        smooth, points : (n, readings + inputs) array
            Readings of the simulated motion, then the inputs: free of aliases, and at the samples.
        """
        from scipy.signal import lfilter  # noqa: PLC0415

        structure, count = self._of, self._of.readings
        forces = smooth[:, count:]
        if self._states is None:
            self._states = np.asarray(-(structure.inputs @ forces[0]) / structure.poles)
            self._history = np.repeat(forces[:1], 2 * AHEAD + 1, axis=0)
            self._smooth, self._points = (np.repeat(part[:1], AHEAD, axis=0) for part in (smooth, points))
        joined = np.concatenate([self._history, forces])
        self._history = joined[-2 * AHEAD - 1 :]
        corrected = np.stack([np.convolve(column, CORRECTION, mode="valid") for column in joined.T], axis=1)
        pressed = np.zeros((forces.shape[0], count))
        for number, decay in enumerate(self._decay):
            drive = corrected @ structure.inputs[number]
            stepped = self._new[number] * drive[1:] + self._old[number] * drive[:-1]
            modal, _ = lfilter([1.0], [1.0, -decay], stepped, zi=np.array([decay * self._states[number]]))
            self._states[number] = modal[-1]
            pressed += np.multiply.outer(modal, structure.outputs[:, number]).real
        now = [np.concatenate(pair) for pair in ((self._smooth, smooth), (self._points, points))]
        self._smooth, self._points = (part[-AHEAD:] for part in now)
        first, second = (part[:-AHEAD, :count] + pressed for part in now)
        return first, second


def structure_of(
    whole: Assembly,
    active: ActiveDofs,
    *,
    displacement: Array,
    velocity: Array,
    damping: Array,
    damping_ratio: float,
) -> Structure | None:
    """Return the response of the motions that are not simulated; None where nothing is left out of the readings.

    Parameters
    ----------
    whole : Assembly
        With all degrees of freedom.
    active : ActiveDofs
        Those that are simulated.
    displacement, velocity : (reading, dof) arrays
        The readings in N per motion along all degrees of freedom.
    damping : (active, active) array
        Damping of the simulated motions, without that of drive and load.
    damping_ratio : float
        Of every mode of all motions, to which the damping of supports and meshes is added.
    """
    every = active_dofs_of(whole, {contact.mesh: "full" for contact in whole.parts.contacts}).system
    if every.dof == active.numbers.size:
        return None
    means = [mesh.stiffness.mean for mesh in every.meshes]
    full = every.damping + with_modal_damping(every, ratio=damping_ratio).damping
    turning = full if every.gyroscopic is None else full + every.gyroscopic
    poles, vectors, shapes = _poles(every, means, turning)
    outputs = np.hstack([displacement @ shapes, velocity @ shapes]) @ vectors

    def excited(forces: Array) -> ComplexArray:
        """Return the excitation of each pole, (pole, input), by forces on all motions, (dof, input)."""
        driven = np.vstack([np.zeros((shapes.shape[1], forces.shape[1])), shapes.T @ forces])
        return np.asarray(np.linalg.solve(vectors, driven.astype(np.complex128)))

    forces = _inputs(every, active, damping=damping, full=turning)
    of_meshes, *of_motion = (excited(forces[name]) for name in _TERMS)
    at, speed, rise = of_motion
    of_displacement = at + poles[:, None] * (speed + poles[:, None] * rise)
    beside = {
        "displacement": (outputs @ (speed + poles[:, None] * rise)).real,
        "velocity": (outputs @ rise).real,
    }
    # mesh forces alone say which poles matter: all inputs follow them
    weight = np.max(np.abs(outputs), axis=0) * np.max(np.abs(of_meshes), axis=1, initial=0.0) / np.abs(poles)
    kept = np.flatnonzero((poles.imag >= 0) & (weight > _NEGLIGIBLE))
    if not kept.size:
        return None
    meshes, moved = (np.flatnonzero(part.any(axis=0)) for part in (of_meshes, of_displacement))
    count = meshes.size + moved.size
    maps = {"mesh_force": np.zeros((count, of_meshes.shape[1])), "displacement": np.zeros((count, at.shape[1]))}
    maps["mesh_force"][np.arange(meshes.size), meshes] = 1.0
    maps["displacement"][np.arange(meshes.size, count), moved] = 1.0
    return Structure(
        poles=poles[kept].astype(np.complex128),
        inputs=np.hstack([of_meshes[:, meshes], of_displacement[:, moved]])[kept],
        outputs=outputs[:, kept] * np.where(poles[kept].imag > 0, 2, 1),
        maps=maps,
        beside=beside,
    )


_TERMS = ("mesh_force", "displacement", "velocity", "acceleration")


def _poles(every: System, means: list[float], damping: Array) -> tuple[ComplexArray, ComplexArray, Array]:
    """Return poles, right vectors, and the shapes of the elastic modes of equations with this damping."""
    angular, shapes = undamped_modes(every, means)
    angular, shapes = angular[angular > 0], shapes[:, angular > 0]
    size = angular.size
    matrix = np.zeros((2 * size, 2 * size))
    matrix[:size, size:] = np.eye(size)
    matrix[size:, :size] = -np.diag(angular**2)
    matrix[size:, size:] = -(shapes.T @ damping @ shapes)
    poles, vectors = np.linalg.eig(matrix)
    return poles, vectors, shapes


def _inputs(every: System, active: ActiveDofs, *, damping: Array, full: Array) -> dict[str, Array]:
    """Return the forces on all motions per unit of each simulated mesh force and motion, (dof, input)."""
    numbers, expansion, system = active.numbers, active.expansion, active.system
    placed = np.eye(every.dof)[:, numbers]
    pairs = {
        "mesh_force": (
            placed @ np.array([mesh.direction for mesh in system.meshes]).T,
            np.array([mesh.direction for mesh in every.meshes]).T,
        ),
        "displacement": (placed @ system.stiffness, every.stiffness @ expansion),
        "velocity": (
            placed @ (damping if system.gyroscopic is None else damping + system.gyroscopic),
            full @ expansion,
        ),
        "acceleration": (placed @ system.mass, every.mass @ expansion),
    }
    forces = {}
    for name, (one, other) in pairs.items():
        forces[name] = one - other
        largest = np.max(np.abs(np.concatenate([one, other])), initial=0.0)
        forces[name][np.abs(forces[name]) < _NEGLIGIBLE * largest] = 0.0
    return forces
