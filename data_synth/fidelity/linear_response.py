"""Linear response of gears to their mesh excitation: the spectral lines of each mesh in the channels.

Under the static force F, teeth of stiffness k and transmission error e, which follow the mesh phase, deflect by
F / k + e.
On a spring of the mean stiffness, the same deflection is caused by a force

    p = F (1 - k_mean / k) - k_mean e

along the line of action: the loaded static transmission error as excitation (Ozguven and Houser 1988, J. Sound
Vib. 125, 71). It leaves out the parametric excitation by k times the vibration, whose first term is
`ToothForces.parametric_force`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property

import numpy as np

from data_synth.dynamics.modes import undamped_modes
from data_synth.dynamics.system import Mesh
from data_synth.fidelity.excitation import spectral_lines
from data_synth.kinematic.harmonics import ComplexArray, HarmonicFamily
from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import SceneError
from data_synth.sources.families import mesh_name
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.gear_torques import static_tooth_forces
from data_synth.vibration.run import Motion, contacts_in

_POINTS = 64  # to a period of the highest line, which is then right to half a percent for a stiffness that jumps
_MIN_POINTS = 512  # points to a mesh cycle
MIN_STIFFNESS = 0.25  # of the mean stiffness: softer teeth are losing contact
_LONGEST = 256  # mesh cycles of a period: each is a line apart
_NEGLIGIBLE = 1e-5  # of the largest line of a mesh: -100 dB


@dataclass(frozen=True, kw_only=True)
class ToothForces:
    """The exciting force p of one mesh, as spectral lines at the multiples of `base`.

    Attributes
    ----------
    mesh : str
    base_order : Fraction
        Order of the first line: that of the mesh over the cycles after which it repeats.
    loaded : (line,) complex array
        Per N of static force; phase zero is that of the reference's angle.
    unloaded : (line,) complex array
        From the transmission error, in N.
    static_n : (instant,) array
        Static force at the instants of the truth.
    stiffness, error : (point,) arrays
        k in N/m and e in m at equidistant phases of a period.
    """

    mesh: str
    base_order: Fraction
    loaded: ComplexArray = field(metadata={"dims": ("line",), "units": "1"})
    unloaded: ComplexArray = field(metadata={"dims": ("line",), "units": "N"})
    static_n: Array = field(metadata={"dims": ("instant",), "units": "N"})
    stiffness: Array = field(repr=False, metadata={"dims": ("point",), "units": "N/m"})
    error: Array = field(repr=False, metadata={"dims": ("point",), "units": "m"})

    @property
    def orders(self) -> Array:
        """Orders of all lines, (line,)."""
        return np.asarray(float(self.base_order) * np.arange(1, self.loaded.size + 1))

    def at(self, instant: int) -> ComplexArray:
        """Return the complex amplitudes of p at an instant in N, (line,)."""
        return np.asarray(self.static_n[instant] * self.loaded + self.unloaded)

    def parametric_force(self, deflection: ComplexArray, instant: int, *, mean: float) -> ComplexArray:
        """Return the lines (line,) in N of the parametric force by dynamic deflections with lines (line,) in m."""
        static = self.static_n[instant]
        p = static * (1 - mean / self.stiffness) - mean * self.error
        deflection_values = _waveform(deflection, self.stiffness.size) + (static - np.mean(p)) / mean
        return spectral_lines(
            self.stiffness * (deflection_values - self.error) - mean * deflection_values - p, deflection.size
        )


@dataclass(frozen=True, kw_only=True)
class Response:
    """Linear response of gears at mean mesh stiffness to a force p in a mesh, as a sum over poles.

    Attributes
    ----------
    motion : Motion
    poles : (pole,) complex array
        rad/s; rigid-body modes are left out: no mesh force excites them.
    outputs : (reading, pole) complex array
        Contribution of each pole to the readings, without planets the forces on the routes.
    deflections : (mesh, pole) complex array
        Contribution to the deflections of meshes.
    inputs : (pole, mesh) complex array
        Excitation of each pole per N of p.
    direct : (reading, mesh) array
        The readings per N of p: forces of gears of the frame, and of meshes that are read.
    absent : (input, pole) complex array
        Contribution of each pole to the inputs of the response of motions that are not simulated.
    absent_direct : (input, mesh) array
        The same inputs per N of p.
    means : (mesh,) array
        Mean mesh stiffness in N/m.
    """

    motion: Motion
    poles: ComplexArray = field(metadata={"dims": ("pole",), "units": "rad/s"})
    outputs: ComplexArray = field(repr=False, metadata={"dims": ("listener", "pole"), "units": "N"})
    deflections: ComplexArray = field(repr=False, metadata={"dims": ("mesh", "pole"), "units": "m"})
    inputs: ComplexArray = field(repr=False, metadata={"dims": ("pole", "mesh"), "units": "N-1"})
    direct: Array = field(repr=False, metadata={"dims": ("listener", "mesh"), "units": "1"})
    absent: ComplexArray = field(repr=False, metadata={"dims": ("input", "pole"), "units": "input"})
    absent_direct: Array = field(repr=False, metadata={"dims": ("input", "mesh"), "units": "input N-1"})
    means: Array = field(repr=False, metadata={"dims": ("mesh",), "units": "N/m"})

    def number(self, name: str) -> int:
        """Return the number of a mesh."""
        return [mesh.name for mesh in self.motion.system.meshes].index(name)

    def channels(self, mesh: int, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitudes in the channels for 1 N of p at frequencies (line,), (sensor, line)."""
        return self._channels(mesh, frequency_hz, self._resolvent(frequency_hz))

    def between(self, frequency_hz: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return for 1 N of p in a mesh at frequencies (line,) the deflections in m and the readings in N.

        (deflection, mesh, line) and (mesh, reading, line).
        """
        resolvent = self._resolvent(frequency_hz)
        readings = [self._readings(mesh, frequency_hz, resolvent).T for mesh in range(self.means.size)]
        return self._deflections(resolvent), np.stack(readings)

    def _channels(self, mesh: int, frequency_hz: Array, resolvent: ComplexArray) -> ComplexArray:
        scene, routes = self.motion.stage.scene, self.motion.sensor_forces.routes
        force = self._readings(mesh, frequency_hz, resolvent)
        outputs = np.zeros((len(scene.sensors), *np.shape(frequency_hz)), dtype=np.complex128)
        for route, deflections in zip(routes, force.T, strict=True):
            outputs[route.number] += deflections * route.response(scene, frequency_hz)
        return outputs

    def _readings(self, mesh: int, frequency_hz: Array, resolvent: ComplexArray) -> ComplexArray:
        """Return the complex amplitudes of the readings in N for 1 N of p, (line, reading)."""
        force = resolvent @ (self.outputs * self.inputs[:, mesh]).T + self.direct[:, mesh]
        structure = self.motion.sensor_forces.structure
        if structure is not None:
            inputs = resolvent @ (self.absent * self.inputs[:, mesh]).T + self.absent_direct[:, mesh]
            by_input = structure.response(frequency_hz).transpose(2, 0, 1)
            force = force + np.matmul(by_input, inputs[:, :, None])[..., 0]
        return np.asarray(force)

    def deflection(self, mesh: int, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitudes of the mesh's own deflection in m for 1 N of p, (line,)."""
        return np.asarray(self._resolvent(frequency_hz) @ (self.deflections[mesh] * self.inputs[:, mesh]))

    def deflections_by(self, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitudes of the deflections in m for 1 N of p in a mesh, (deflection, mesh, line)."""
        return self._deflections(self._resolvent(frequency_hz))

    def _deflections(self, resolvent: ComplexArray) -> ComplexArray:
        return np.stack([(self.deflections * each) @ resolvent.T for each in self.inputs.T], axis=1)

    def _resolvent(self, frequency_hz: Array) -> ComplexArray:
        """Return the response (line, pole) of each pole to a unit of its excitation."""
        return np.asarray(1 / (2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)[:, None] - self.poles))


def response_of(motion: Motion) -> Response:
    """Return the linear response of gears from their equations of motion in elastic modes.

    Of planets, whose routes to a sensor rotate with their carrier, that of the readings and not of the channels.
    """
    system, output = motion.system, motion.output
    means = np.array([mesh.stiffness.mean for mesh in system.meshes])
    angular, shapes = undamped_modes(system, means)
    angular, shapes = angular[angular > 0], shapes[:, angular > 0]
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    count = angular.size
    matrix = np.zeros((2 * count, 2 * count))
    matrix[:count, count:] = np.eye(count)
    matrix[count:, :count] = -np.diag(angular**2)
    matrix[count:, count:] = -(shapes.T @ damping @ shapes)
    poles, vectors = np.linalg.eig(matrix)
    directions = np.array([mesh.direction for mesh in system.meshes])
    every = np.zeros((output.channels, means.size)) if output.mesh_force is None else output.mesh_force
    rows = (every * means) @ directions
    rows = rows if output.displacement is None else rows + output.displacement
    velocity_rows = np.zeros_like(rows) if output.velocity is None else output.velocity
    structure = motion.sensor_forces.structure
    count_readings = output.channels if structure is None else structure.readings
    readings = np.hstack([rows @ shapes, velocity_rows @ shapes]) @ vectors
    pushes = np.vstack([np.zeros((count, means.size)), -(shapes.T @ directions.T)])
    return Response(
        motion=motion,
        poles=poles.astype(np.complex128),
        outputs=readings[:count_readings],
        deflections=(directions @ shapes) @ vectors[:count],
        inputs=np.linalg.solve(vectors, pushes.astype(np.complex128)),
        direct=every[:count_readings],
        absent=readings[count_readings:],
        absent_direct=every[count_readings:],
        means=means,
    )


def check_lines_possible(motion: Motion, name: str) -> None:
    """Raise SceneError, with a remedy, for a mesh that is not periodic with linear response."""
    mesh = motion.system.meshes[contacts_in(motion.system, name)[0]]
    if motion.sensor_forces.rotate:
        why = "planets rotate with their carrier"
    elif mesh.history is not None:
        why = "its teeth change with time"
    elif _has_pitch_deviations(motion) and mesh.error is not None and mesh.error.period > _LONGEST:
        why = f"its pitch deviations repeat after {mesh.error.period} cycles only"
    elif mesh.friction:
        why = "friction follows the force of its teeth"
    elif not np.min(mesh.stiffness(_phases(mesh, _MIN_POINTS * int(mesh.stiffness.period)))) > 0:
        why = "its teeth lose contact"
    else:
        return
    raise SceneError(
        f'mesh "{name}": {why}, so it has no linear response; write fidelity = "torsional" or more for it.'
    )


def _has_pitch_deviations(motion: Motion) -> bool:
    return imperfections_of(motion.stage.scene).gears is not None


def tooth_forces(motion: Motion, name: str, *, points: int = _POINTS) -> ToothForces:
    """Return the exciting force p of a mesh, with all lines below half the sampling rate at top speed.

    Teeth that change in time are taken as they are at first, a stiffness below a quarter of the mean as a quarter.

    Parameters
    ----------
    motion : Motion
        Without planets.
    name : str
    points : int
        Values of the stiffness to a period of the highest line.
    """
    stage = motion.stage
    number = contacts_in(motion.system, name)[0]
    mesh = motion.system.meshes[number]
    period = math.lcm(int(mesh.stiffness.period), int(mesh.error.period) if mesh.error is not None else 1)
    base_order = stage.scene.exact_orders("gear_mesh")[name] / period
    top_hz = stage.drive.angle.top_speed_hz(0.0, stage.scene.duration_s)
    lines = max(0, math.ceil(stage.scene.rate_hz / 2 / (float(base_order) * top_hz)) - 1)
    phases = _phases(mesh, max(_MIN_POINTS * period, 1 << (points * max(lines, 1) - 1).bit_length()))
    mean = mesh.stiffness.mean
    stiffness = np.maximum(mesh.stiffness(phases), MIN_STIFFNESS * mean)
    error = mesh.error(phases) if mesh.error is not None else np.zeros(phases.size)
    return ToothForces(
        mesh=name,
        base_order=base_order,
        loaded=spectral_lines(1 - mean / stiffness, lines),
        unloaded=spectral_lines(-mean * error, lines),
        static_n=static_tooth_forces(stage, motion.system, motion.drive_load)[number],
        stiffness=stiffness,
        error=error,
    )


def _phases(mesh: Mesh, points: int) -> Array:
    """Return equidistant phases of a period of a mesh, in cycles, half a step from its ends."""
    period = math.lcm(int(mesh.stiffness.period), int(mesh.error.period) if mesh.error is not None else 1)
    return np.asarray((np.arange(points) + 0.5) * period / points)


def lines_of(response: Response, forces: ToothForces) -> tuple[list[HarmonicFamily], list[ComplexArray]]:
    """Return the lines of a mesh in the channels, as harmonic families and their amplitudes (sensor, line, instant).

    The lines at multiples of the mesh order are its own; those between them belong to its damaged gears.
    """
    stage = response.motion.stage
    number = response.number(forces.mesh)
    steady = bool(np.ptp(stage.speed_hz) == 0)
    outputs = np.empty((len(stage.scene.sensors), forces.orders.size, stage.instants_s.size), dtype=np.complex128)
    transfer = response.channels(number, forces.orders * stage.speed_hz[0])
    for instant, speed_hz in enumerate(stage.speed_hz):
        if not steady:
            transfer = response.channels(number, forces.orders * speed_hz)
        outputs[:, :, instant] = transfer * forces.at(instant)
    size = np.max(np.abs(outputs), axis=(0, 2), initial=0.0)
    outputs[:, size < _NEGLIGIBLE * np.max(size, initial=0.0)] = 0.0
    every = round(stage.scene.exact_orders("gear_mesh")[forces.mesh] / forces.base_order)
    own = np.arange(1, size.size + 1) % every == 0
    damaged = [fault.component for fault in stage.scene.faults if mesh_name(fault.component) == forces.mesh]
    families, amplitudes = [], []
    between = (" + ".join(damaged), "tooth") if damaged else (forces.mesh, "pitch_deviation")
    for component, kind, kept in ((forces.mesh, "gear_mesh", own), (*between, ~own)):
        values = outputs * kept[:, None]
        present = np.flatnonzero(np.any(values != 0, axis=(0, 2)))
        if present.size:
            values = values[:, : present[-1] + 1]
            families.append(
                HarmonicFamily(
                    component=component,
                    kind=kind,
                    source=forces.mesh,
                    base_order=forces.base_order,
                    coefficients=values[0],
                    load_dependent=True,
                )
            )
            amplitudes.append(values)
    return families, amplitudes


def with_lines(stage: PreparedScene, response: Response, meshes: list[str]) -> PreparedScene:
    """Return a stage with the lines of these meshes added."""
    families, amplitudes = [*stage.families], [*stage.amplitudes]
    for mesh in meshes:
        check_lines_possible(response.motion, mesh)
        more, outputs = lines_of(response, tooth_forces(response.motion, mesh))
        families += more
        amplitudes += outputs
    return replace(stage, families=families, amplitudes=amplitudes)


def _waveform(lines: ComplexArray, points: int) -> Array:
    """Return the values at the phases of `_phases` of a function with these lines."""
    cycles = np.arange(1, lines.size + 1) / points
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    spectrum[1 : lines.size + 1] = lines * np.exp(1j * np.pi * cycles) * points / 2
    return np.asarray(np.fft.irfft(spectrum, n=points))


# ---- Error of reduced models against the full motion, predicted from their linear responses without integration ------


@dataclass(frozen=True, kw_only=True)
class LinearPrediction:
    """Powers in the channels, (sensor,) in squares of their units, means over some instants of the scene.

    Attributes
    ----------
    whole : Response
        Linear response of the full motion.
    forces : mapping of mesh to ToothForces
        Exciting force of each mesh.
    instants : tuple of int
        Numbers of the instants of the truth.
    """

    whole: Response
    forces: Mapping[str, ToothForces] = field(repr=False)
    instants: tuple[int, ...]

    @cached_property
    def line_power(self) -> dict[str, Array]:
        """Power of the lines of each mesh."""
        return {name: self._power(name, lambda lines_of_mesh, _force, _instant: lines_of_mesh) for name in self.forces}

    @cached_property
    def parametric_error(self) -> dict[str, Array]:
        """Power of the parametric excitation, which the linear response lacks: deflection times varying stiffness."""
        return {name: self._power(name, self._parametric_lines) for name in self.forces}

    @property
    def total_power(self) -> Array:
        """Power of the lines of all meshes."""
        return np.asarray(np.sum([*self.line_power.values()], axis=0))

    @property
    def linear(self) -> bool:
        """Whether every stiffness is constant, and teeth with backlash stay in contact."""
        constant = all(np.ptp(force.stiffness) <= 1e-12 * np.max(force.stiffness) for force in self.forces.values())
        glued = all(mesh.backlash_m == 0 for mesh in self.whole.motion.system.meshes)
        return constant and (glued or all(self._in_contact(instant) for instant in self.instants))

    def _in_contact(self, instant: int) -> bool:
        """Whether static forces are larger than all lines of the mesh forces of constant stiffness together."""
        total, static = np.zeros(self.whole.means.size), np.zeros(self.whole.means.size)
        for name, force in self.forces.items():
            number, p = self.whole.number(name), force.at(instant)
            deflections = self.whole.deflections_by(self._frequencies_hz(force, instant))[:, number]
            lines = self.whole.means[:, None] * deflections * p
            lines[number] += p  # k (delta - e), and p is -k e
            total += np.sum(np.abs(lines), axis=1)
            static[number] = abs(force.static_n[instant])
        return bool(np.all(total < static))

    def motion_error(self, name: str, other: Response) -> Array:
        """Return the power of the difference between the lines of a mesh in this motion and in another."""
        number = other.number(name)

        def difference(lines_of_mesh: ComplexArray, force: ToothForces, instant: int) -> ComplexArray:
            return np.asarray(
                other.channels(number, self._frequencies_hz(force, instant)) * force.at(instant) - lines_of_mesh
            )

        return self._power(name, difference)

    def _parametric_lines(self, _lines_of_mesh: ComplexArray, force: ToothForces, instant: int) -> ComplexArray:
        number, frequencies = self.whole.number(force.mesh), self._frequencies_hz(force, instant)
        deflection = self.whole.deflection(number, frequencies) * force.at(instant)
        remainder = force.parametric_force(deflection, instant, mean=float(self.whole.means[number]))
        return np.asarray(self.whole.channels(number, frequencies) * remainder)

    def _power(self, name: str, lines: Callable[[ComplexArray, ToothForces, int], ComplexArray]) -> Array:
        force = self.forces[name]
        powers = [
            np.sum(np.abs(lines(lines_of_mesh, force, instant)) ** 2, axis=1) / 2
            for instant, lines_of_mesh in zip(self.instants, self._lines[name], strict=True)
        ]
        return np.asarray(np.mean(powers, axis=0))

    @cached_property
    def _lines(self) -> dict[str, list[ComplexArray]]:
        """Lines of each mesh in the channels at each instant: every reduced model is compared with them."""
        return {
            name: [
                self.whole.channels(self.whole.number(name), self._frequencies_hz(force, instant)) * force.at(instant)
                for instant in self.instants
            ]
            for name, force in self.forces.items()
        }

    def _frequencies_hz(self, force: ToothForces, instant: int) -> Array:
        return np.asarray(force.orders * self.whole.motion.stage.speed_hz[instant])
