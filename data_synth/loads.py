"""The torques on gears that vibrate, and how their bodies turn meanwhile, whatever the course of speed and torque.

Where a scene declares the speed, gears vibrate about shafts that turn as declared. What speeds them up comes from the
drive, and each body takes its share of it on the way: ``J w'`` at the drive, ``-I w'`` at each body, nothing in sum.

Where a run-up leaves the speed to the torque, bodies turn all the way: the torque drives them, the load law brakes the
loaded body at the speed it truly has, and what the declared inertia has beyond that of the gears belongs to the driven
machine, behind a soft coupling: it asks for its share of the torque, and its mass shakes with nothing. Teeth meet at
the phase of the rigid law, the one that the tachometer sees; vibration turns a shaft by microns of its teeth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from data_synth.drive import Drive
from data_synth.driving import RunUp
from data_synth.integrate import Load, State
from data_synth.mechanics import Array, System
from data_synth.meshing import declared_of
from data_synth.modal import undamped_modes
from data_synth.scene import Scene, SceneError
from data_synth.stage import Stage
from hums.kinematics import Kinematics

_INSTANT_S = 1e-9  # about a jump, of which the mean counts: then a jump between steps costs no accuracy
_HEAVIER = 1e-6  # of the declared inertia: less is rounding


@dataclass(frozen=True, kw_only=True)
class Turned:
    """What acts on a system, and how it turns.

    Attributes
    ----------
    load : Load
        `varying` holds all of it but what drags.
    damping : (dof, dof) array
        Of a load that is linear in speed, N m s/rad.
    rigid : (dof,) array
        Motion of each degree of freedom for a radian of the reference, teeth and bearings not strained.
    turns : bool
        Whether bodies turn all the way, as in a run-up; else they move about the angles of their shafts.
    at_rest : bool
        Whether the gears stand still, unloaded, at time zero.
    """

    load: Load
    damping: Array = field(repr=False)
    rigid: Array = field(repr=False)
    turns: bool = False
    at_rest: bool = False

    def start(self, system: System, drive: Drive, time_s: float) -> State:
        """Return the state at a time: at rest, or under what acts then, teeth at their mean stiffness and closed."""
        if self.at_rest and time_s == 0:
            return State(displacement=np.zeros(system.dof), velocity=np.zeros(system.dof))
        speed = 2 * np.pi * float(drive.angle.speed_hz(time_s)) * self.rigid * self.turns
        force = self.load.constant.copy()
        if self.load.varying is not None:
            force += self.load.varying(np.array([time_s]))[0]
        if self.load.quadratic_drag is not None:
            force -= self.load.quadratic_drag * speed * np.abs(speed)
        return State(displacement=strained(system, force - self.damping @ speed), velocity=speed)


def turned(stage: Stage, kinematics: Kinematics, system: System) -> Turned:
    """Return what the torques of a scene do to its gears.

    Raises
    ------
    SceneError
        A torque without a way through the gears, a speed that jumps, or a run-up lighter than its gears.
    """
    scene, bodies = stage.scene, kinematics.bodies
    drives = bodies[str(scene.gearbox.reference)]
    loaded = _loaded(scene, kinematics, drives)
    place = system.names.index(f"{drives} rotation")
    rigid = _rigid(system, place)
    if scene.speed.run_up is not None:
        return _running_up(stage, scene.speed.run_up, system, rigid=rigid, drives=place, loaded=loaded)
    _refuse_jumps(stage.drive)
    torque, angle = stage.drive.torque, stage.drive.angle
    assert torque is not None and scene.torque is not None  # noqa: S101, PT018 - refuse_unfit
    # the same power, wherever a torque is counted
    share = abs(float(scene.ratio(scene.torque.link) / scene.ratio(loaded)))
    unit = np.zeros(system.dof)
    unit[system.names.index(f"{bodies[loaded]} rotation")] = -math.copysign(share, scene.ratio(loaded))
    unit[place] = share * abs(float(scene.ratio(loaded)))
    speeding = -system.mass @ rigid
    speeding[place] += rigid @ system.mass @ rigid

    def acting(times_s: Array) -> Array:
        speeds_up = 2 * np.pi * angle.acceleration_hz_s(times_s)
        return np.multiply.outer(torque.at(times_s), unit) + np.multiply.outer(speeds_up, speeding)

    steady = np.ptp(torque.values) == 0 and np.ptp(stage.speed_hz) == 0
    load = Load(constant=acting(np.zeros(1))[0]) if steady else _varying(acting)
    return Turned(load=load, damping=np.zeros((system.dof, system.dof)), rigid=rigid)


def strained(system: System, force: Array) -> Array:
    """Return how far a force (dof,) strains a system that otherwise moves freely, (dof,), gaps closed.

    Teeth have their mean stiffness; what the force speeds up as one body is left out.
    """
    means = np.array([mesh.stiffness.mean for mesh in system.meshes])
    angular, shapes = undamped_modes(system, means)
    elastic = shapes[:, angular > 0]
    give = (elastic / angular[angular > 0] ** 2) @ elastic.T
    moved = give @ force
    rows = np.array([mesh.direction for mesh in system.meshes])
    gaps = np.array([mesh.backlash_m for mesh in system.meshes]) * np.sign(rows @ moved)
    # contact begins where the gap is closed: the same forces at a larger deflection
    return np.asarray(moved + give @ (rows.T @ (means * gaps)))


def _loaded(scene: Scene, kinematics: Kinematics, drives: str) -> str:
    """Return the link that takes the power out."""
    bodies, frame = kinematics.bodies, kinematics.mechanism.frame
    assert scene.torque is not None  # noqa: S101 - refuse_unfit
    named = [scene.torque.link] if scene.speed.run_up is None else [scene.speed.link, scene.torque.link]
    load_on = declared_of(scene).load_on
    for link in named if load_on is None else [load_on]:
        if link in bodies and bodies[link] not in (drives, frame):
            return link
    raise SceneError(
        f'torque acts on "{scene.torque.link}", and the reference "{scene.gearbox.reference}" drives; name the '
        "link that takes the power out as dynamics.load_on."
    )


def _rigid(system: System, drives: int) -> Array:
    """Return the motion that strains nothing, for a radian of the degree of freedom that drives, (dof,)."""
    angular, shapes = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
    free = shapes[:, angular == 0]
    return np.asarray(free @ free[drives] / (free[drives] @ free[drives]))


def _refuse_jumps(drive: Drive) -> None:
    times_s, speeds_hz = getattr(drive.angle, "times_s", np.zeros(1)), getattr(drive.angle, "speeds_hz", np.zeros(1))
    jumps = np.flatnonzero((np.diff(times_s) == 0) & (np.diff(speeds_hz) != 0))
    if jumps.size:
        raise SceneError(
            f"speed jumps at {times_s[jumps[0]]:g} s, and no torque takes gears that have a mass along; give "
            "speed.rise_s, the time that a step takes."
        )


def _varying(acting: Callable[[Array], Array]) -> Load:
    def between(times_s: Array) -> Array:
        return (acting(times_s - _INSTANT_S) + acting(times_s + _INSTANT_S)) / 2

    # what is constant passes without an error of steps
    first = acting(np.zeros(1))[0]
    return Load(constant=first, varying=lambda times_s: between(times_s) - first)


def _running_up(stage: Stage, law: RunUp, system: System, *, rigid: Array, drives: int, loaded: str) -> Turned:
    """Return a torque that drives the reference, and a load law, felt at the link of the speed, on a link it loads."""
    scene, torque, angle = stage.scene, stage.drive.torque, stage.drive.angle
    assert torque is not None and scene.torque is not None  # noqa: S101, PT018 - the scene's own check
    felt = abs(float(scene.ratio(scene.speed.link)))
    own = float(rigid @ system.mass @ rigid) / felt**2
    beyond = law.inertia_kg_m2 - own
    if beyond < -_HEAVIER * law.inertia_kg_m2:
        raise SceneError(
            f'speed.run_up.inertia_kg_m2 = {law.inertia_kg_m2:g}, but the gears alone have {own:.4g} at "'
            f'{scene.speed.link}"; raise it, or declare lighter links in dynamics.links.'
        )
    turns = abs(float(scene.ratio(loaded))) / felt
    brake = system.names.index(f"{scene.kinematics.bodies[loaded]} rotation")
    unit, brought = np.zeros((2, system.dof))
    unit[brake] = -math.copysign(1 / turns, scene.ratio(loaded))
    brought[drives] = abs(float(scene.ratio(scene.torque.link)))
    damping, drag = np.zeros((system.dof, system.dof)), np.zeros(system.dof)
    damping[brake, brake] = law.load_nm_s / turns**2
    drag[brake] = law.load_nm_s2 / turns**3

    def acting(times_s: Array) -> Array:
        within = np.clip(times_s, 0.0, scene.duration_s)
        asked = law.load_nm + max(beyond, 0.0) * 2 * np.pi * felt * angle.acceleration_hz_s(within)
        return np.multiply.outer(torque.at(times_s), brought) + np.multiply.outer(asked, unit)

    varying = _varying(acting)
    return Turned(
        load=Load(constant=varying.constant, varying=varying.varying, quadratic_drag=drag if law.load_nm_s2 else None),
        damping=damping,
        rigid=rigid,
        turns=True,
        at_rest=law.rpm == 0,
    )
