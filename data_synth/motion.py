"""Vibration of a scene's gears: equations of motion, external torques, and forces towards the sensors.

At every fidelity the gearbox is assembled in the plane or in space, and degrees of freedom that a fidelity lacks are
constrained. Bearing forces are those of the springs along active degrees of freedom, and follow from the mesh forces by
statics along constrained ones: so the force of a stiff bearing is the same at every fidelity.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from data_synth.hats import LAG, WeightedForces
from data_synth.hearing import SensorForces, sensor_forces_of
from data_synth.integrate import Accuracy, IntegrationError, Load, MethodChoice, Output, Problem, Steps, method_for
from data_synth.keeping import active_dofs_of
from data_synth.loads import DriveLoad, drive_load_of
from data_synth.machine import assembly_of
from data_synth.mechanics import Array, System
from data_synth.meshing import Gears, Teeth, declared_of, gears_of, kinematics_of, tooth_passes
from data_synth.modal import undamped_modes, with_modal_damping
from data_synth.scene import Scene, SceneError
from data_synth.stage import PreparedScene

_BLOCK = 8192
_TRIAL = 4096
_MOST_DENSE = 8


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Gears of a scene, ready to be integrated.

    Attributes
    ----------
    system : System
    drive_load : DriveLoad
        External torques and rigid-body rotation.
    sensor_forces : SensorForces
        Forces towards the sensors.
    output : Output
        Output maps from which `sensor_forces` computes a force in N for each route.
    teeth : mapping of contact to Teeth
    oversampling : int
        Rate of the forces over that of the channels, before path and chain: fast modes would alias otherwise.
    settling_time_s : float
        Duration before time zero in which the transient of the start decays below the error; zero for a run-up.
    error : float
        Tolerated relative RMS error of the forces.
    """

    stage: PreparedScene
    system: System
    drive_load: DriveLoad
    sensor_forces: SensorForces = field(repr=False)
    output: Output
    teeth: Mapping[str, Teeth] = field(repr=False)
    oversampling: int
    settling_time_s: float
    error: float

    @property
    def load(self) -> Load:
        """External load on the system."""
        return self.drive_load.load

    @cached_property
    def method(self) -> MethodChoice:
        """The integrator, and the reason of its choice."""
        return method_for(self.problem(0.0, self.stage.scene.duration_s))

    def channels(self, *, samples: int) -> Iterator[Array]:
        """Yield the channels (sensor, n) from time zero in blocks, after the linear part of their chains.

        Raises
        ------
        SceneError
            If the integration fails.
        """
        from data_synth.integrate import integrate_blocks  # noqa: PLC0415

        scene = self.stage.scene
        settling_samples = math.ceil(self.settling_time_s * scene.rate_hz)
        routes = self.sensor_forces.routes
        filters = [route.filter_at(scene, rate_hz=self.output.rate_hz) for route in routes]
        weighted, delay = WeightedForces.of(self.output), (lag := max(filter_.lag for filter_ in filters))
        if weighted is not None:
            delay += LAG
        last = (settling_samples + samples - 1) * self.oversampling + delay
        problem = self.problem(-settling_samples / scene.rate_hz, last / self.output.rate_hz)
        steps = Steps(per_sample=self.steps())
        output = self.output if weighted is None else weighted.output
        dropped = settling_samples * self.oversampling + delay
        method = self.method.method
        try:
            for block in integrate_blocks(problem, method=method, output=output, tolerance=steps, block=_BLOCK):
                times_s = block.times_s - (delay - lag) / self.output.rate_hz
                readings = (block.values, block.values) if weighted is None else weighted.push(block.values)
                forces, points = (self.sensor_forces.forces(each, times_s=times_s).T for each in readings)
                outputs = np.zeros((len(scene.sensors), block.values.shape[0]))
                for route, filter_, force, point in zip(routes, filters, forces, points, strict=True):
                    outputs[route.number] += filter_.filtered(force, at_once=point, lag=lag)
                count = outputs.shape[1]
                if dropped < count:
                    yield outputs[:, dropped :: self.oversampling]
                dropped = dropped - count if dropped >= count else (dropped - count) % self.oversampling
        except IntegrationError as caught:
            raise SceneError(f"the gears cannot be followed in time: {caught}") from None

    def steps(self) -> int:
        """Return the steps to a sample that keep the error, from a trial of 4096 samples at the critical time."""
        from data_synth.integrate import integrate  # noqa: PLC0415

        if self.method.method.order is None:
            return 1
        scene, trial_output = self.stage.scene, self.output
        if self.sensor_forces.rotate:  # forces of planets may cancel in the sum
            trial_output = Output(rate_hz=trial_output.rate_hz, mesh_force=np.eye(len(self.system.meshes)))
        weighted = WeightedForces.of(trial_output)
        long_s = max(1, min(scene.samples - 1, _TRIAL)) / scene.rate_hz
        start_s = min(max(0.0, self.critical_time_s() - long_s / 2), max(0.0, scene.duration_s - long_s))
        try:
            return (
                integrate(
                    self.problem(start_s, long_s),
                    method=self.method.method,
                    output=trial_output if weighted is None else weighted.trial_output,
                    tolerance=Accuracy(relative=self.error, trial=1.0, about_mean=True),
                )
                .checked()
                .steps_per_sample
            )
        except IntegrationError as caught:
            raise SceneError(f"the gears cannot be followed in time: {caught}") from None

    def critical_time_s(self) -> float:
        """Return the time that needs most steps: a torque reversal with backlash, or the top speed."""
        drive, torque = self.stage.drive, self.stage.drive.torque
        times_s = self.stage.instants_s
        if torque is not None and any(mesh.backlash_m > 0 for mesh in self.system.meshes):
            reversals = np.flatnonzero(np.diff(np.sign(torque.at(times_s))))
            if reversals.size:
                return float(times_s[reversals[0]])
        return float(times_s[np.argmax(drive.angle.speed_hz(times_s))])

    def problem(self, start_s: float, duration_s: float) -> Problem:
        """Return the initial value problem from a time on, starting at rest or in static equilibrium."""
        drive = self.stage.drive
        return Problem(
            system=self.system,
            reference=drive.angle,
            load=self.load,
            duration_s=duration_s,
            start=self.drive_load.start(self.system, drive, start_s),
            start_s=start_s,
        )


def prepare_gears(stage: PreparedScene) -> Gears:
    """Return the gears of a scene with their teeth, for `motion_of`.

    Raises
    ------
    SceneError
        If the scene cannot be integrated, or geometry is missing.
    """
    kinematics = kinematics_of(stage.scene)
    check_supported(stage.scene)
    return gears_of(stage, kinematics)


def motion_of(
    stage: PreparedScene, gears: Gears, *, levels: Mapping[str, str], springs: Collection[str] = ()
) -> Motion:
    """Return the motion of a scene's gears.

    Parameters
    ----------
    stage : PreparedScene
    gears : Gears
    levels : mapping of mesh to "torsional", "lateral" or "full"
        A body has the motions of the highest level of its meshes.
    springs : collection of mesh
        Meshes of constant mean stiffness without transmission error.

    Raises
    ------
    SceneError
        If the gearbox cannot be assembled, or a torque or sensor does not fit it.
    """
    scene, kinematics, teeth = stage.scene, gears.kinematics, gears.teeth
    declared = declared_of(scene)
    whole = assembly_of(stage, gears, levels=levels, springs=springs)
    active = active_dofs_of(whole, levels)
    system = replace(
        active.system,
        meshes=tuple(
            mesh if gears.meshes[mesh.name] in springs else replace(mesh, history=teeth[mesh.name].history_of(mesh))
            for mesh in active.system.meshes
        ),
    )
    damped = with_modal_damping(system, ratio=declared.damping_ratio)
    angular, _ = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
    slowest = min(
        declared.damping_ratio * float(np.min(angular[angular > 0], initial=np.inf)),
        2 * math.pi * declared.mounts.frequency_hz * declared.mounts.damping_ratio,
    )
    sensor_forces = sensor_forces_of(stage, gears, whole, active)
    oversampling = 1
    while oversampling < _MOST_DENSE and np.max(angular) / (2 * math.pi) > oversampling * scene.rate_hz / 4:
        oversampling *= 2
    acting = drive_load_of(stage, kinematics, system)
    return Motion(
        stage=stage,
        system=replace(damped, damping=damped.damping + system.damping + acting.damping),
        drive_load=acting,
        sensor_forces=sensor_forces,
        output=replace(sensor_forces.output, rate_hz=oversampling * scene.rate_hz),
        teeth=teeth,
        oversampling=oversampling,
        settling_time_s=0.0 if acting.full_rotation else math.log(1 / declared.error) / slowest,
        error=declared.error,
    )


def check_supported(scene: Scene) -> None:
    """Raise SceneError, with a remedy, for a scene whose gears cannot be integrated."""
    what = f'fidelity = "{scene.fidelity}"'
    kinematic = 'write fidelity = "kinematic"'
    if scene.torque is None:
        raise SceneError(f"{what}: without load there is no mesh force; add torque = {{ link = ..., nm = ... }}.")
    if scene.sampling_jitter is not None:
        raise SceneError(f"{what} has no sampling_jitter; leave it out, or {kinematic}.")
    for sensor in scene.sensors:
        if sensor.direction is None:
            raise SceneError(f'{what}: sensor "{sensor.name}" needs a direction, as [x, y, z] across the shafts.')


def fault_passes(motion: Motion) -> dict[int, tuple[Array, float]]:
    """Return, for each tooth fault, the times in s of its passes through a mesh, and half a pass in revolutions.

    A tooth of a sun or of a ring passes one planet after the other.
    """
    scene = motion.stage.scene
    last_s = (scene.samples - 1) / scene.rate_hz
    cycles = {mesh.name: mesh.cycles_per_rev for mesh in motion.system.meshes}
    found: dict[int, tuple[Array, float]] = {}
    for name, teeth in motion.teeth.items():
        for number, times_s, half_rev in tooth_passes(motion.stage, teeth, cycles_per_rev=cycles[name], stop_s=last_s):
            before = found.get(number, (np.empty(0), half_rev))[0]
            found[number] = np.sort(np.concatenate([before, times_s])), half_rev
    return found
