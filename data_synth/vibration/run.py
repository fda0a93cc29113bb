"""Vibration of a scene's gears: equations of motion, external torques, and forces at the sensors.

The gearbox is assembled in the plane, or in space if axes cross or teeth are helical, without degrees of freedom that
nothing excites. Bearing forces are those of their springs.
"""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.assembly import Assembly, assemble, excited_dofs_of
from data_synth.dynamics.elements import BearingShaft
from data_synth.dynamics.modes import undamped_modes, with_modal_damping
from data_synth.dynamics.parts import Inertia, SupportStiffness
from data_synth.dynamics.placement import crossed_bodies
from data_synth.dynamics.system import Array, System, errors_at
from data_synth.integrators.problem import Integration, IntegrationError, Output, Problem, State
from data_synth.operation.drive import ReferenceAngle
from data_synth.operation.shaft_angle import ShaftAngle
from data_synth.scene.faults import LOSING_CONTACT, GearFault
from data_synth.scene.gear_dynamics import SupportDynamics
from data_synth.scene.random_streams import random_stream
from data_synth.scene.scene import Scene, SceneError
from data_synth.sources.families import last_s
from data_synth.sources.prepared import PreparedScene, prepare_scene
from data_synth.transfer.housing import sinc_correction
from data_synth.vibration.gear_torques import (
    DriveLoad,
    drive_load_of,
    mean_error_m,
    static_deflection,
)
from data_synth.vibration.meshes import Gears, gears_of, kinematics_of
from data_synth.vibration.sensor_forces import SensorForces, sensor_forces_of
from hums.gearbox.kinematics import Kinematics

# ---- The gearbox of a scene as equations of motion: its declared bodies, bearings and meshes assembled ---------------


def assembly_of(stage: PreparedScene, gears: Gears, *, speed_rad_s: float | None = None) -> Assembly:
    """Return the gearbox of a scene in the plane, or in space if axes cross or teeth are helical.

    Bodies in mesh with planets have coordinates that rotate with the carrier, with the gyroscopic terms of the mean
    speed; a run-up, which has no mean speed, omits them.

    Parameters
    ----------
    stage : PreparedScene
    gears : Gears
    speed_rad_s : float, optional
        Speed of the reference in rad/s for the gyroscopic terms; default the scene's mean.

    Raises
    ------
    SceneError
        If `data_synth.dynamics.assembly.assemble` raises ValueError.
    """
    scene, kinematics = stage.scene, gears.kinematics
    declared = scene.dynamics_or_default
    has_helix = any(mesh.helix_angle_deg for mesh in scene.gearbox.meshes)
    if speed_rad_s is None:
        speed_rad_s = 2 * math.pi * float(np.mean(stage.speed_hz)) if scene.speed.run_up is None else 0.0
    try:
        return assemble(
            kinematics,
            motions="space" if has_helix or declared.shafts or crossed_bodies(kinematics) else "plane",
            inertias={
                name: Inertia(mass_kg=item.mass_kg, inertia_kgm2=item.inertia_kg_m2)
                for link, item in declared.links
                for name in scene.gearbox.instances(link)
            },
            supports=dict(_supports(scene, kinematics)),
            meshes={name: teeth.properties for name, teeth in gears.teeth.items()},
            speed_rad_s=speed_rad_s,
        )
    except ValueError as caught:
        words = str(caught)
        for link, _ in declared.shafts:
            words = words.replace(f'supports names "{link}"', f'shafts names "{link}"')
        for ours, declared_as in (("inertias", "links"), ("supports", "bearings")):
            words = words.replace(f'{ours} names "', f'{declared_as} names "')
        raise SceneError(f"dynamics: {words}") from None


def _supports(scene: Scene, kinematics: Kinematics) -> Iterator[tuple[str, SupportStiffness]]:
    """Yield the links with declared bearings, and the stiffness of these."""
    declared = scene.dynamics_or_default
    shafts = {
        link: BearingShaft(
            diameter_m=item.diameter_mm / 1e3,
            bore_m=item.bore_mm / 1e3,
            to_bearings_m=(item.to_bearings_mm[0] / 1e3, item.to_bearings_mm[1] / 1e3),
        )
        for link, item in declared.shafts
    }
    for link, item in (dict.fromkeys(shafts, SupportDynamics()) | dict(declared.bearings)).items():
        if kinematics.bodies.get(link) == kinematics.mechanism.frame and not item.torsion_nm_rad:
            raise SceneError(
                f'dynamics.bearings makes "{link}", else rigid with "{scene.gearbox.frame}", a body that '
                "rotates freely; give torsion_nm_rad, or leave it out."
            )
        hold = SupportStiffness(
            radial=item.radial_n_m,
            axial=item.axial_n_m,
            tilt=item.tilt_nm_rad,
            torsion=item.torsion_nm_rad,
            damping_s=item.damping_s,
            shaft=shafts.get(link),
        )
        yield from ((name, hold) for name in scene.gearbox.instances(link))


# ---- Anti-aliasing of mesh forces that jump --------------------------------------------------------------------------
# A triangle over two sample intervals (a linear B-spline) has the spectrum sinc^2, which attenuates aliases. The
# passband is corrected to 1e-6 up to a tenth of the rate, and to 2e-4 up to a fifth.


_TERMS = 6
_LAG = _TERMS + 1  # samples


class _WeightedForces:
    """Sums channels of motion and channels of weighted mesh forces, block by block.

    Parameters
    ----------
    output, mesh_force : Output, (channels, meshes) array
        Output that is replaced, and its map of mesh forces.

    Attributes
    ----------
    output : Output
        Output to integrate: the channels of motion, of weighted mesh forces, and of mesh forces at samples.
    """

    def __init__(self, output: Output, mesh_force: Array) -> None:
        maps = {
            name: np.vstack([value, np.zeros((2 * output.channels, value.shape[1]))])
            for name, value in output.maps.items()
            if name != "mesh_force"
        }
        zero = np.zeros_like(mesh_force)
        weighted, points = np.vstack([zero, mesh_force, zero]), np.vstack([zero, zero, mesh_force])
        self.output = Output(rate_hz=output.rate_hz, **maps, weighted_mesh_force=weighted, mesh_force=points)
        self._buffer = np.empty((0, 0))

    def push(self, values: Array) -> tuple[Array, Array]:
        """Return the channels (n, channels), `_LAG` samples behind the next values (n, 3 channels).

        First the alias-free values, for a filter, then samples. Before the first values they are taken to be constant.
        """
        if not self._buffer.size:
            self._buffer = np.repeat(values[:1], _LAG + _TERMS, axis=0)
        joined = np.concatenate([self._buffer, values])
        self._buffer = joined[-_LAG - _TERMS :]
        count, channels = values.shape[0], values.shape[1] // 3
        # a triangle is centred one sample back, and the filter is symmetric
        now = joined[_TERMS : _TERMS + count]
        motion, points = now[:, :channels], now[:, 2 * channels :]
        taps = sinc_correction(_TERMS)
        weighted = [np.convolve(joined[1:, channels + c], taps, mode="valid") for c in range(channels)]
        return np.asarray(motion + np.stack(weighted, axis=1)), np.asarray(motion + points)


# ---- Run -------------------------------------------------------------------------------------------------------------


_TRIAL = 4096
_DAMPING = 0.02  # damping ratio of undamped gears, for their forced vibration
_TOP = 1 - 1e-9  # of the top speed: smaller changes are rounding
_MOST_DENSE = 64
_FEWEST_DENSE = 2  # if a channel has a filter, which acts before decimation


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Gears of a scene, ready to be integrated.

    Attributes
    ----------
    gears : Gears
    system : System
    drive_load : DriveLoad
        External torques and rigid-body rotation.
    sensor_forces : SensorForces
        Forces towards the sensors.
    output : Output
        Output maps from which `sensor_forces` computes a force in N for each route.
    oversampling : int
        Rate of the forces over that of the channels, before path and chain: fast modes would alias otherwise.
    settling_time_s : float
        Duration before time zero in which the transient of the start decays below the error; zero for a run-up.
    error : float
        Tolerated relative RMS error of the forces.
    eased : bool
        Whether the start and jumps of the load set off no free vibration: displacements jump as the static ones do.
    """

    stage: PreparedScene
    gears: Gears = field(repr=False)
    system: System
    drive_load: DriveLoad
    sensor_forces: SensorForces = field(repr=False)
    output: Output
    oversampling: int
    settling_time_s: float
    error: float
    eased: bool = False

    @cached_property
    def jumps(self) -> tuple[tuple[float, State], ...]:
        """Times in s at which the load jumps, and the jumps of the static deflection."""
        return self.drive_load.jumps(self.system, self.stage.drive)

    def without_free_vibration(self) -> "Motion | None":
        """Return the same motion if the start and jumps of the load set off no free vibration; None if they do not.

        Undamped gears are given damping for this: without it their forced vibration would be undefined.
        """
        if not self.drive_load.at_rest and not self.jumps:
            return None
        ratio = 0.0 if self.stage.scene.dynamics_or_default.damping_ratio else _DAMPING
        added = with_modal_damping(self.system, ratio=ratio).damping
        return replace(self, eased=True, system=replace(self.system, damping=self.system.damping + added))

    @property
    def teeth_angle(self) -> ReferenceAngle:
        """Angle of the reference shaft that determines the mesh phases."""
        rpm = self.stage.scene.dynamics_or_default.mesh_rpm
        return (
            self.stage.drive.angle if rpm is None else ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([rpm / 60]))
        )

    @property
    def static_n(self) -> Array:
        """Static force of each mesh at the instants of the truth, (mesh, instant) N."""
        return np.array([*self.sensor_forces.static_n.values()])

    def channels(self, *, samples: int, steps: int) -> Iterator[Array]:
        """Yield the channels (sensor, n) from time zero in blocks, after the linear part of their chains.

        `steps` are those of the integration per sample.

        Raises
        ------
        SceneError
            If the integration fails.
        """
        scene = self.stage.scene
        sensor_forces = replace(self.sensor_forces, late_s=self.eased / (2 * self.output.rate_hz))
        filters = [route.filter_at(scene, rate_hz=self.output.rate_hz) for route in sensor_forces.routes]
        lag = max(filter_.lag for filter_ in filters)
        weighted, output, delay = None, self.output, lag
        if output.mesh_force is not None:
            weighted = _WeightedForces(output, output.mesh_force)
            output, delay = weighted.output, lag + _LAG
        for block, numbers in self.blocks(output, samples=samples, steps=steps, delay=delay):
            times_s = block.times_s - (delay - lag) / self.output.rate_hz
            smooth, at_once = (block.values, block.values) if weighted is None else weighted.push(block.values)
            forces = points = sensor_forces.forces(smooth, times_s=times_s).T
            if at_once is not smooth:
                points = sensor_forces.forces(at_once, times_s=times_s).T
            outputs = np.zeros((len(scene.sensors), block.values.shape[0]))
            for route, filter_, force, point in zip(sensor_forces.routes, filters, forces, points, strict=True):
                outputs[route.number] += filter_.filtered(force, at_once=point, lag=lag)
            yield outputs[:, (numbers >= 0) & (numbers % self.oversampling == 0)]

    def blocks(
        self, output: Output, *, samples: int, steps: int, delay: int = 0
    ) -> Iterator[tuple[Integration, NDArray[np.int64]]]:
        """Yield an output at its rate in blocks, with the index of each value from time zero, less the delay.

        It starts before time zero, while the initial transient decays; SceneError if the integration fails.
        """
        from data_synth.integrators.driver import integrate_blocks  # noqa: PLC0415

        rate_hz = self.stage.scene.rate_hz
        settling = math.ceil(self.settling_time_s * rate_hz)
        last = (settling + samples - 1) * self.oversampling + delay
        problem, first = self.problem(-settling / rate_hz, last / output.rate_hz), -settling * self.oversampling - delay
        try:
            for block in integrate_blocks(problem, output=output, steps=steps):
                yield block, first + np.arange(block.times_s.size)
                first += block.times_s.size
        except IntegrationError as caught:
            raise not_followed(caught) from None

    def steps(self) -> int:
        """Return the steps per sample for the error tolerance, from a trial of 4096 samples at the critical time."""
        from data_synth.integrators.driver import steps_for_error  # noqa: PLC0415

        scene, output = self.stage.scene, self.output
        if self.sensor_forces.rotate:  # forces of planets may cancel
            trial_output = Output(rate_hz=output.rate_hz, mesh_force=np.eye(len(self.system.meshes)))
        else:  # forces on a rigid housing nearly cancel too, but not those transmitted above its first mode
            felt = np.array([route.number for route in self.sensor_forces.routes])
            to_sensors = (felt == np.arange(len(scene.sensors))[:, None]).astype(np.float64)
            trial_output = Output(
                rate_hz=output.rate_hz, **{name: to_sensors @ values for name, values in output.maps.items()}
            )
        if trial_output.mesh_force is not None:  # forces at samples would alias
            weighted = _WeightedForces(trial_output, trial_output.mesh_force)
            trial_output = replace(weighted.output, mesh_force=None)
        long_s = max(1, min(scene.samples - 1, _TRIAL)) / scene.rate_hz
        critical_s, reverses = self.critical_time_s()
        # a torque that rises from zero separates the teeth before time zero
        first_s = -min(self.settling_time_s, long_s / 2) if reverses else 0.0
        start_s = min(max(first_s, critical_s - long_s / 2), max(0.0, scene.duration_s - long_s))
        try:
            return steps_for_error(
                self.problem(start_s, long_s),
                output=trial_output,
                relative=self.error,
                trial=_TRIAL * self.oversampling,
            )
        except IntegrationError as caught:
            raise not_followed(caught) from None

    def critical_time_s(self) -> tuple[float, bool]:
        """Return the time that needs the most steps, and whether torque reverses with backlash there."""
        drive, torque = self.stage.drive, self.stage.drive.torque
        times_s = self.stage.instants_s
        if torque is not None and any(mesh.backlash_m > 0 for mesh in self.system.meshes):
            reversals = np.flatnonzero(np.diff(np.sign(torque.at(times_s))))
            if reversals.size:
                return float(times_s[reversals[0]]), True
        speeds_hz = drive.angle.speed_hz(times_s)
        return float(times_s[np.argmax(speeds_hz >= _TOP * np.max(speeds_hz))]), False

    def problem(self, start_s: float, duration_s: float) -> Problem:
        """Return the initial value problem from a time on, starting at rest or in static equilibrium.

        Transmission errors act from the start: an equilibrium without them would begin with a shock several times the
        forces of the record, which costs steps.
        """
        turned = float(self.teeth_angle.revolutions([start_s])[0])
        errors_m = errors_at(self.system.meshes, revolutions=turned, time_s=start_s)
        return Problem(
            system=self.system,
            reference=self.teeth_angle,
            load=self.drive_load.load,
            duration_s=duration_s,
            start=self.drive_load.start(self.system, self.stage.drive, start_s, errors_m=errors_m, eased=self.eased),
            start_s=start_s,
            shifts=self.jumps if self.eased else (),
        )


def scene_system(scene: Scene) -> Callable[[float], System]:
    """Return the equations of motion of a scene's gears as a function of speed, for modes and stability.

    Parameters
    ----------
    scene : Scene
        Scene whose bodies have the degrees of freedom excited by teeth and torques, as with `fidelity = "dynamic"`.

    Returns
    -------
    callable
        From the speed of the reference in rad/s, for the gyroscopic terms, to the system with its modal damping.

    Raises
    ------
    SceneError
        If the gearbox cannot be assembled.
    """
    stage = prepare_scene(scene, rng_for=partial(random_stream, 0))
    gears = prepare_gears(stage)

    def system_at(speed_rad_s: float) -> System:
        system, _ = excited_dofs_of(assembly_of(stage, gears, speed_rad_s=speed_rad_s))
        return with_modal_damping(system, ratio=scene.dynamics_or_default.damping_ratio)

    return system_at


def prepare_gears(stage: PreparedScene) -> Gears:
    """Return the gears of a scene with their teeth.

    Raises
    ------
    SceneError
        If the scene cannot be integrated, or geometry is missing.
    """
    kinematics = kinematics_of(stage.scene)
    check_supported(stage.scene)
    modified = any(mesh.modification is not None for _, mesh in stage.scene.dynamics_or_default.meshes)
    if not modified and not any(isinstance(fault, LOSING_CONTACT) for fault in stage.scene.faults):
        return gears_of(stage, kinematics)
    healthy = stage.without_faults()
    gears = gears_of(healthy, kinematics)
    system, _ = excited_dofs_of(assembly_of(healthy, gears))
    load = drive_load_of(healthy, kinematics, system)
    _, forces = static_deflection(system, load.forces(healthy.speed_hz, healthy.instants_s).T)
    named = zip(system.meshes, forces, strict=True)
    return gears_of(stage, kinematics, static_n={mesh.name: float(np.mean(np.abs(each))) for mesh, each in named})


def motion_of(stage: PreparedScene) -> Motion:
    """Return the motion of a scene's gears.

    Parameters
    ----------
    stage : PreparedScene

    Raises
    ------
    SceneError
        If the scene cannot be integrated, geometry is missing, or a torque or sensor does not fit the gearbox.
    """
    gears = prepare_gears(stage)
    scene, kinematics, teeth = stage.scene, gears.kinematics, gears.teeth
    declared = scene.dynamics_or_default
    whole = assembly_of(stage, gears)
    excited, numbers = excited_dofs_of(whole)
    system = replace(excited, meshes=tuple(replace(mesh, history=teeth[mesh.name].history) for mesh in excited.meshes))
    damped = with_modal_damping(system, ratio=declared.damping_ratio)
    angular, _ = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
    slowest = min(
        declared.damping_ratio * float(np.min(angular[angular > 0], initial=np.inf)),
        2 * math.pi * declared.mounts.frequency_hz * declared.mounts.damping_ratio,
    )
    acting = drive_load_of(stage, kinematics, system)
    fastest = float(np.max(angular))
    oversampling = _FEWEST_DENSE if any(sensor.anti_alias != "none" for sensor in scene.sensors) else 1
    while oversampling < _MOST_DENSE and fastest / (2 * math.pi) > oversampling * scene.rate_hz / 4:
        oversampling *= 2
    errors_m = [mean_error_m(mesh) for mesh in system.meshes]
    displacements, static_n = static_deflection(
        system, acting.forces(stage.speed_hz, stage.instants_s).T, errors_m=errors_m
    )
    sensor_forces = sensor_forces_of(stage, whole, numbers, displacements=displacements, static_n=static_n)
    return Motion(
        stage=stage,
        system=replace(damped, damping=damped.damping + system.damping + acting.damping),
        drive_load=acting,
        sensor_forces=sensor_forces,
        output=replace(sensor_forces.output, rate_hz=oversampling * scene.rate_hz),
        gears=gears,
        oversampling=oversampling,
        settling_time_s=0.0 if acting.full_rotation else math.log(1 / declared.error) / slowest,
        error=declared.error,
    )


def check_supported(scene: Scene) -> None:
    """Raise SceneError, with a remedy, for a scene whose gears cannot be integrated."""
    what = f'fidelity = "{scene.fidelity}"'
    if scene.torque is None:
        raise SceneError(f"{what}: without load there is no mesh force; add torque = {{ link = ..., nm = ... }}.")
    dynamics = scene.dynamics_or_default
    if dynamics.mesh_rpm is not None and any(isinstance(fault, GearFault) for fault in scene.faults):
        raise SceneError(
            "dynamics.mesh_rpm: teeth that follow no shaft have no place for a fault; leave one of them out."
        )
    if not dynamics.damping_ratio and scene.speed.run_up is None:
        raise SceneError(
            "dynamics.damping_ratio = 0: vibration from before the record would never decay; give a ratio above 0, or "
            "start the gears by speed.run_up."
        )
    for sensor in scene.sensors:
        if sensor.direction is None:
            raise SceneError(f'{what}: sensor "{sensor.name}" needs a direction, as [x, y, z] across the shafts.')


def not_followed(caught: IntegrationError) -> SceneError:
    """Return the error of a scene whose integration failed, with remedies."""
    return SceneError(
        f"the gears cannot be followed in time: {caught.detail} Raise dynamics.error or rate_hz; or check torque, "
        "damping_ratio and backlash_um, if teeth should not part."
    )


def fault_passes(motion: Motion) -> dict[int, tuple[Array, float]]:
    """Return, for each tooth fault, the times in s of its passes through a mesh, and half a pass in revolutions.

    A tooth of a sun or ring passes one planet after the other.
    """
    angle, found = motion.stage.drive.angle, dict[int, tuple[Array, float]]()
    ends_rev = angle.revolutions([0.0, last_s(motion.stage.scene)])
    for mesh in motion.system.meshes:
        begin, end = ends_rev * mesh.cycles_per_rev
        for number, first, every, ratio in motion.gears.teeth[mesh.name].passes:
            turns = np.arange(math.ceil((begin - first) / every), math.floor((end - first) / every) + 1)
            times_s = angle.times((first + every * turns) / mesh.cycles_per_rev)
            before_s, _ = found.get(number, (np.empty(0), 0.0))
            found[number] = np.sort(np.concatenate([before_s, times_s])), ratio / 2 / mesh.cycles_per_rev
    return found


def contacts_in(system: System, mesh: str) -> list[int]:
    """Return the indices of the contacts of a mesh in a system, one per planet."""
    name = re.compile(rf"{re.escape(mesh)}( \d+)?")
    return [number for number, other in enumerate(system.meshes) if name.fullmatch(other.name)]
