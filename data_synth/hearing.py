"""What the bearings of gears that vibrate do to each sensor: a force in N, from motions and mesh forces.

A bearing feels the springs of a body's motions; along a motion that is held it feels the mesh forces, as in statics.
"""

import numpy as np

from data_synth.integrate import Output
from data_synth.layout import across, direction_of
from data_synth.mechanics import Array, System
from data_synth.meshing import declared_of
from data_synth.modal import places
from data_synth.scene import Scene, SceneError, Sensor
from hums.kinematics import Kinematics

_ALONG = 1e-9


def forces_on_sensors(scene: Scene, kinematics: Kinematics, whole: System, kept: Array) -> Output:
    """Return the maps from motion and mesh forces to the force that each sensor hears.

    Parameters
    ----------
    scene : Scene
    kinematics : Kinematics
    whole : System
        Of all motions.
    kept : (k,) array
        Numbers of those that are not held.
    """
    at = {place: number for number, place in enumerate(places(whole))}
    springs = np.zeros((whole.dof, whole.dof))
    for spring in whole.springs:
        springs += spring.damping * np.outer(spring.direction, spring.direction)
    meshes = np.array([mesh.direction for mesh in whole.meshes])
    damping = np.array([_mesh_damping(scene, mesh.name) for mesh in whole.meshes])
    moving = np.isin(np.arange(whole.dof), kept)
    displacement, velocity = np.zeros((2, len(scene.sensors), whole.dof))
    mesh_force = np.zeros((len(scene.sensors), len(whole.meshes)))
    for row, sensor in enumerate(scene.sensors):
        heard = _looks_along(kinematics, sensor)
        if not any((body, motion) in at for body in kinematics.joints for motion in heard):
            raise SceneError(
                f'sensor "{sensor.name}" looks along the shafts, where gears that move in a plane make no force; turn '
                'its direction, or write fidelity = "full".'
            )
        for body, weight in _weights(scene, kinematics, sensor).items():
            for motion, value in heard.items():
                number = at.get((body, motion))
                if number is None:
                    continue
                if moving[number]:
                    displacement[row] += weight * value * whole.stiffness[number]
                    velocity[row] += weight * value * _of_supports(springs, meshes, damping, number)
                else:
                    mesh_force[row] -= weight * value * meshes[:, number]
                    velocity[row] -= weight * value * (meshes[:, number] * damping) @ meshes
    return Output(
        rate_hz=scene.rate_hz,
        displacement=displacement[:, kept],
        velocity=velocity[:, kept] if velocity.any() else None,
        mesh_force=mesh_force if mesh_force.any() else None,
    )


def _looks_along(kinematics: Kinematics, sensor: Sensor) -> dict[str, float]:
    """Return the shares of x, y and z, those of the assembly, in a sensor's direction."""
    first = direction_of(kinematics, next(iter(kinematics.joints)))
    along = np.stack([*across(first), first]) @ np.asarray(sensor.direction, dtype=np.float64)
    along = along / np.linalg.norm(along)
    return {motion: float(value) for motion, value in zip("xyz", along, strict=True) if abs(value) > _ALONG}


def _of_supports(springs: Array, meshes: Array, damping: Array, number: int) -> Array:
    """Return the row of the dampers of bearings: those of all springs but the dampers of meshes."""
    return np.asarray(springs[number] - (meshes[:, number] * damping) @ meshes)


def _mesh_damping(scene: Scene, name: str) -> float:
    return declared_of(scene).mesh(name).damping_n_s_m


def _weights(scene: Scene, kinematics: Kinematics, sensor: Sensor) -> dict[str, float]:
    """Return how loud a sensor hears the bearings of each body."""
    declared, bodies, gearbox = declared_of(scene), kinematics.bodies, scene.gearbox
    stands = {sensor.on}
    for bearing in gearbox.bearings:
        if sensor.on in bearing.names:
            stands |= {link for ring in (bearing.inner_ring, bearing.outer_ring) for link in gearbox.instances(ring)}
    for mesh in gearbox.meshes:
        if mesh.name == sensor.on:
            stands |= {gear.link for gear in mesh.gears}
    near = {bodies[link] for link in stands if link in bodies}
    weights = {body: 1.0 if body in near else declared.elsewhere for body in kinematics.joints}
    for hearing in declared.hearing:
        if hearing.sensor not in [other.name for other in scene.sensors]:
            raise SceneError(f'dynamics.hearing names "{hearing.sensor}", which is no sensor of this scene.')
        for link, weight in hearing.links:
            if bodies.get(link) not in weights:
                raise SceneError(f'dynamics.hearing names "{link}", which is no link with bearings in this gearbox.')
            if hearing.sensor == sensor.name:
                weights[bodies[link]] = weight
    return weights
