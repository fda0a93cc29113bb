"""Torques on vibrating gears, and their rigid-body rotation, for any time history of speed and torque.

If a scene declares the speed, gears vibrate about shafts of prescribed angle. The accelerating torque is supplied by
the drive and balanced by the inertia of each body: ``J w'`` at the drive, ``-I w'`` at each body, zero in sum.

In a run-up, where the torque determines the speed, the rotations are full angles: the torque drives them, the load law
acts on the loaded body at its actual speed, and the declared inertia beyond that of the gears belongs to the driven
machine behind a soft coupling: it takes its share of the torque but does not vibrate. The mesh phase follows the rigid
rotation, as does the tachometer; vibration changes a shaft's angle by microns at the teeth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from data_synth.dynamics.modes import undamped_modes
from data_synth.dynamics.system import Array, Mesh, System
from data_synth.integrators.problem import Load, State
from data_synth.operation.drive import Drive
from data_synth.scene.operation import RunUp
from data_synth.scene.scene import Scene, SceneError
from data_synth.sources.prepared import PreparedScene
from hums.gearbox.kinematics import Kinematics

_INSTANT_S = 1e-9  # to both sides, whose mean is taken: then a jump between steps costs no accuracy
_NEGLIGIBLE = 1e-6  # of the declared inertia: less is rounding
_NO_LOAD = 1e-9  # of the largest static mesh force: less is rounding
_JUMP = 0.01  # of the load: less sets off no vibration to speak of
_VALUES = 8  # of a transmission error to a mesh cycle, for its mean
_DIGITS = 7  # that a message needs, so that what it prints is accepted: rounded by less than the above


@dataclass(frozen=True, kw_only=True)
class DriveLoad:
    """External torques of a scene on its gears, and their rigid-body rotation.

    Attributes
    ----------
    load : Load
        All torques, with quadratic drag separate from `varying`.
    damping : (dof, dof) array
        Damping of a load that is linear in speed, N m s/rad.
    rigid_motion : (dof,) array
        Rigid-body mode: displacement of each degree of freedom per radian of the reference.
    full_rotation : bool
        Whether rotations are full angles, as in a run-up, or relative to the prescribed shaft angles.
    at_rest : bool
        Whether the gears are at rest and unloaded at time zero.
    """

    load: Load
    damping: Array = field(repr=False)
    rigid_motion: Array = field(repr=False)
    full_rotation: bool = False
    at_rest: bool = False

    def start(
        self, system: System, drive: Drive, time_s: float, *, errors_m: ArrayLike = 0.0, eased: bool = False
    ) -> State:
        """Return the state at a time: at rest, or in static equilibrium with teeth in contact at mean stiffness.

        `errors_m` (mesh,) are the transmission errors that closed teeth follow. `eased`: never at rest.
        """
        if self.at_rest and time_s == 0 and not eased:
            return State(displacement=np.zeros(system.dof), velocity=np.zeros(system.dof))
        speed_hz = drive.angle.speed_hz(np.array([time_s]))
        force = self.forces(speed_hz, np.array([time_s])).T
        displacement, _ = static_deflection(system, force, errors_m=errors_m)
        return State(displacement=displacement[:, 0], velocity=self.velocities(speed_hz)[0])

    def jumps(self, system: System, drive: Drive) -> tuple[tuple[float, State], ...]:
        """Return the times in s, after time zero, at which the load jumps, and how far the static deflection does."""
        found, knots_s = [], knots_of(drive)
        for time_s in knots_s[knots_s > 0].tolist():
            sides_s = np.array([time_s - 2 * _INSTANT_S, time_s + 2 * _INSTANT_S])
            forces = np.vstack([self.forces(drive.angle.speed_hz(side), side) for side in np.split(sides_s, 2)])
            if np.max(np.abs(forces[1] - forces[0])) > _JUMP * np.max(np.abs(forces)):
                change = np.diff(static_deflection(system, forces.T)[0])[:, 0]
                found.append((time_s, State(displacement=change, velocity=0 * change)))
        return tuple(found)

    def velocities(self, speed_hz: Array) -> Array:
        """Return the velocities (n, dof) of the rigid motion at speeds of the reference (n,)."""
        return 2 * np.pi * np.multiply.outer(speed_hz, self.rigid_motion * self.full_rotation)

    def forces(self, speed_hz: Array, times_s: Array) -> Array:
        """Return the external forces (n, dof) on gears without vibration at speeds (n,) and times (n,)."""
        speeds, drag = self.velocities(speed_hz), self.load.quadratic_drag
        force = self.load.constant + self.load.varying_at(times_s) - speeds @ self.damping
        return np.asarray(force if drag is None else force - drag * speeds * np.abs(speeds))


def drive_load_of(stage: PreparedScene, kinematics: Kinematics, system: System) -> DriveLoad:
    """Return the external torques of a scene on its gears.

    Raises
    ------
    SceneError
        If no link is loaded, the speed jumps, or a run-up has less inertia than its gears.
    """
    scene, bodies = stage.scene, kinematics.bodies
    driving = bodies[str(scene.gearbox.reference)]
    loaded = _loaded(scene, kinematics, driving)
    place = system.names.index(f"{driving} rotation")
    rigid_motion = _rigid(system, place)
    if scene.speed.run_up is not None:
        return _running_up(stage, scene.speed.run_up, system, rigid_motion=rigid_motion, driving=place, loaded=loaded)
    _check_speed_continuous(stage.drive)
    torque, angle = stage.drive.torque, stage.drive.angle
    assert torque is not None and scene.torque is not None  # noqa: S101, PT018 - refuse_unfit
    # the same power, whichever shaft the torque is given for
    power_ratio = abs(float(scene.ratio(scene.torque.link) / scene.ratio(loaded)))
    unit = np.zeros(system.dof)
    unit[system.names.index(f"{bodies[loaded]} rotation")] = -math.copysign(power_ratio, scene.ratio(loaded))
    unit[place] = power_ratio * abs(float(scene.ratio(loaded)))
    inertia_torque = -system.mass @ rigid_motion
    inertia_torque[place] += rigid_motion @ system.mass @ rigid_motion

    def factors(times_s: Array) -> Array:
        return np.stack([torque.at(times_s), 2 * np.pi * angle.acceleration_hz_s(times_s)], axis=1)

    load = _varying(factors, np.stack([unit, inertia_torque]), drive=stage.drive, linear=True)
    if np.ptp(torque.values) == 0 and np.ptp(stage.speed_hz) == 0:
        load = Load(constant=load.constant)
    return DriveLoad(load=load, damping=np.zeros((system.dof, system.dof)), rigid_motion=rigid_motion)


def knots_of(drive: Drive) -> Array:
    """Return the increasing times in s of the knots of torque and speed."""
    torque_s = drive.torque.times_s if drive.torque is not None else np.zeros(0)
    return np.unique(np.concatenate([torque_s, getattr(drive.angle, "times_s", np.zeros(0))]))


def static_deflection(system: System, force: Array, *, errors_m: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Return the elastic displacements (dof, n) and mesh forces (mesh, n) under forces (dof, n), at mean stiffness.

    `errors_m` (mesh,) are the transmission errors that closed teeth follow. Their forces are not zero where meshes
    close a loop: a planet ahead of its position takes load from the others. With ``a = Phi (Phi' F / omega^2)`` over
    the elastic modes, forces that accelerate the rigid motion are balanced by the inertias.
    """
    means = np.array([mesh.stiffness.mean for mesh in system.meshes])
    angular, shapes = undamped_modes(system, means)
    elastic = shapes[:, angular > 0] / angular[angular > 0]
    compliance = elastic @ elastic.T
    deflection = compliance @ force
    rows, means = np.array([mesh.direction for mesh in system.meshes]), means[:, None]
    pressed = means * (rows @ deflection)
    pressed[np.abs(pressed) < _NO_LOAD * np.max(np.abs(pressed), axis=0)] = 0.0  # they hang between their flanks
    # contact begins at half the backlash and an error further: the same forces at another deflection
    gaps = np.array([[mesh.backlash_m] for mesh in system.meshes])
    errors = np.broadcast_to(errors_m, gaps.size)[:, None]
    shifts = gaps * np.sign(pressed) + np.where((pressed != 0) | (gaps == 0), errors, 0.0)
    displacement = deflection + compliance @ (rows.T @ (means * shifts))
    return displacement, means * (rows @ displacement - shifts)


def mean_error_m(mesh: Mesh) -> float:
    """Return the mean of the transmission error of a mesh over its period, from eight values per cycle."""
    if mesh.error is None:
        return 0.0
    return float(np.mean(mesh.error(np.arange(_VALUES * mesh.error.period) / _VALUES)))


def _loaded(scene: Scene, kinematics: Kinematics, driving: str) -> str:
    """Return the link at which power leaves the gearbox."""
    bodies, frame = kinematics.bodies, kinematics.mechanism.frame
    assert scene.torque is not None  # noqa: S101 - refuse_unfit
    named = [scene.torque.link] if scene.speed.run_up is None else [scene.speed.link, scene.torque.link]
    load_on = scene.dynamics_or_default.load_on
    for link in named if load_on is None else [load_on]:
        if link in bodies and bodies[link] not in (driving, frame):
            return link
    if load_on is not None:
        raise SceneError(
            f'dynamics.load_on = "{load_on}" is at rest or is the reference, which drives; name the link that takes '
            "the power out, or leave it out where that is the torque's."
        )
    raise SceneError(
        f'torque acts on "{scene.torque.link}", and the reference "{scene.gearbox.reference}" drives; name the '
        "link that takes the power out as dynamics.load_on."
    )


def _rigid(system: System, driving: int) -> Array:
    """Return the rigid-body mode per radian of the driving degree of freedom, (dof,)."""
    angular, shapes = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
    free = shapes[:, angular == 0]
    return np.asarray(free @ free[driving] / (free[driving] @ free[driving]))


def _check_speed_continuous(drive: Drive) -> None:
    """Raise SceneError if the prescribed speed jumps."""
    times_s, speeds_hz = getattr(drive.angle, "times_s", np.zeros(1)), getattr(drive.angle, "speeds_hz", np.zeros(1))
    jumps = np.flatnonzero((np.diff(times_s) == 0) & (np.diff(speeds_hz) != 0))
    if jumps.size:
        raise SceneError(
            f"speed jumps at {times_s[jumps[0]]:g} s, which gears with inertia cannot follow; give "
            "speed.rise_s, the time that a step takes."
        )


def _varying(factors: Callable[[Array], Array], directions: Array, *, drive: Drive, linear: bool) -> Load:
    """Return forces (k, dof) times factors (n, k) of rising times as a load, at a knot the mean of both sides.

    `linear`: between the knots of torque and speed the factors are.
    """
    knots_s = knots_of(drive)

    def mean_about(times_s: Array, *, less: Array) -> Array:
        inside = knots_s[(knots_s > times_s[0] - _INSTANT_S) & (knots_s < times_s[-1] + _INSTANT_S)]
        known_s = times_s[[0, -1]] if linear else times_s
        apart = np.min(np.abs(known_s[:, None] - inside), axis=1, initial=np.inf) >= _INSTANT_S
        known_s = np.unique(np.concatenate([known_s[apart], inside - _INSTANT_S, inside + _INSTANT_S]))
        values = (factors(known_s) - less).T
        return np.stack([np.interp(times_s, known_s, factor) for factor in values], axis=1)

    # the constant part has no discretisation error
    at_zero = mean_about(np.zeros(1), less=np.zeros(1))[0]
    constant = np.asarray(at_zero @ directions)
    return Load(constant=constant, varying=partial(mean_about, less=at_zero), directions=directions)


def _running_up(
    stage: PreparedScene, law: RunUp, system: System, *, rigid_motion: Array, driving: int, loaded: str
) -> DriveLoad:
    """Return the load of a run-up: a torque on the reference, and the load law on the loaded link."""
    scene, torque, angle = stage.scene, stage.drive.torque, stage.drive.angle
    assert torque is not None and scene.torque is not None  # noqa: S101, PT018 - the scene's own check
    speed_ratio = abs(float(scene.ratio(scene.speed.link)))
    gears_kg_m2 = float(rigid_motion @ system.mass @ rigid_motion) / speed_ratio**2
    machine_kg_m2 = law.inertia_kg_m2 - gears_kg_m2
    if machine_kg_m2 < -_NEGLIGIBLE * law.inertia_kg_m2:
        raise SceneError(
            f"speed.run_up.inertia_kg_m2 = {law.inertia_kg_m2:.{_DIGITS}g}, but the gears alone have "
            f'{gears_kg_m2:.{_DIGITS}g} at "{scene.speed.link}"; raise it to that, '
            "or declare lighter links in dynamics.links."
        )
    ratio = abs(float(scene.ratio(loaded))) / speed_ratio
    brake = system.names.index(f"{scene.kinematics.bodies[loaded]} rotation")
    unit, driving_torque = np.zeros((2, system.dof))
    unit[brake] = -math.copysign(1 / ratio, scene.ratio(loaded))
    driving_torque[driving] = abs(float(scene.ratio(scene.torque.link)))
    damping, drag = np.zeros((system.dof, system.dof)), np.zeros(system.dof)
    damping[brake, brake] = law.load_nm_s / ratio**2
    drag[brake] = law.load_nm_s2 / ratio**3

    def factors(times_s: Array) -> Array:
        within = np.clip(times_s, 0.0, scene.duration_s)
        load_torque = law.load_nm + max(machine_kg_m2, 0.0) * 2 * np.pi * speed_ratio * angle.acceleration_hz_s(within)
        return np.stack([torque.at(times_s), load_torque], axis=1)

    return DriveLoad(
        load=replace(
            _varying(factors, np.stack([driving_torque, unit]), drive=stage.drive, linear=False),
            quadratic_drag=drag if law.load_nm_s2 else None,
        ),
        damping=damping,
        rigid_motion=rigid_motion,
        full_rotation=True,
        at_rest=law.rpm == 0,
    )
