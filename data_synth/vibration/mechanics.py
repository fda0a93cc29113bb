"""Quantities inside the gearbox at every sample: transmission error, mesh and bearing forces, angular speeds.

They come from a second integration of the same motion with the same steps, so that the channels stay as they are.
"""

import math

import numpy as np
import xarray as xr

from data_synth.dynamics.assembly import excited_dofs_of
from data_synth.integrators.problem import Output
from data_synth.operation.shaft_angle import Array
from data_synth.sources.families import turning_ratios
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.run import Motion, assembly_of
from data_synth.vibration.sensor_forces import support_forces


def link_speeds(prepared: PreparedScene) -> dict[str, Array]:
    """Return the speed of every link that turns in the frame, by kinematics alone: rev s-1 at each sample, signed."""
    scene = prepared.scene
    speed_hz = prepared.drive.angle.speed_hz(np.arange(scene.samples) / scene.rate_hz)
    return {link: ratio * speed_hz for link, ratio in turning_ratios(scene).items()}


def speed_truth(speeds: dict[str, Array]) -> dict[str, xr.DataArray]:
    """Return ``truth_link_speed`` (truth_link, time)."""
    return {"truth_link_speed": _stacked("truth_link", speeds, "rev s-1", "in the frame, signed")}


def mechanics_truth(motion: Motion) -> dict[str, xr.DataArray]:
    """Return the quantities inside a gearbox whose gears all move.

    Of each contact (truth_contact, time), along the line of action from where its driving flanks touch, positive as the
    gears approach: ``truth_transmission_error`` in m, by the rotations of gears on fixed axes, ``r1 theta1 - r2
    theta2``, and the whole motion of planets; ``truth_mesh_deflection`` in m, by all motions; ``truth_tooth_error`` in
    m, of unloaded teeth. ``truth_mesh_stiffness`` in N m-1 and ``truth_mesh_force`` in N, positive where teeth are
    pressed together: the stiffness times the difference of the last two, as long as the teeth do not part.
    ``truth_bearing_force`` (truth_support, time) in N, what the bearings of a link press on the frame along an axis of
    the scene; ``truth_link_speed`` (truth_link, time) in rev s-1, vibration included. All are values at the sampling
    instants, not filtered.

    Raises
    ------
    SceneError
        If the integration fails.
    """
    prepared, scene, system = motion.stage, motion.stage.scene, motion.system
    whole = assembly_of(prepared, motion.gears)
    supports, displacement, velocity = support_forces(whole, excited_dofs_of(whole)[1])
    turning = [link for link in link_speeds(prepared) if _rotation(prepared, link) in system.names]
    rotations = np.eye(system.dof)[[system.names.index(_rotation(prepared, link)) for link in turning]]
    contacts = len(system.meshes)
    by_all = np.array([mesh.direction for mesh in system.meshes])
    joints, frame = motion.gears.kinematics.joints, motion.gears.kinematics.mechanism.frame
    planets = tuple(f"{body} " for body, joint in joints.items() if joint.carried_by != frame)
    by_turning = by_all * [name.endswith(" rotation") or name.startswith(planets) for name in system.names]
    output = Output(
        rate_hz=motion.output.rate_hz,
        displacement=np.vstack([by_turning, by_all, 0 * by_all, 0 * rotations, displacement]),
        velocity=np.vstack([np.zeros((3 * contacts, system.dof)), rotations / (2 * math.pi), velocity]),
        mesh_force=np.eye(3 * contacts + len(turning) + len(supports))[:, 2 * contacts : 3 * contacts],
    )
    values = np.empty((output.channels, scene.samples))
    for block, numbers in motion.blocks(output, samples=scene.samples, steps=motion.steps()):
        kept = (numbers >= 0) & (numbers % motion.oversampling == 0)
        values[:, numbers[kept] // motion.oversampling] = block.values[kept].T
    turned, deflection, mesh_force, vibration, pressed = np.split(
        values, np.cumsum([contacts, contacts, contacts, len(turning)]).tolist()
    )
    held = motion.drive_load.start(system, prepared.drive, 0.0).displacement
    touching = np.array([[mesh.backlash_m * (-1 if mesh.direction @ held < 0 else 1)] for mesh in system.meshes])
    names = [mesh.name for mesh in system.meshes]
    times_s = np.arange(scene.samples) / scene.rate_hz
    revolutions = motion.teeth_angle.revolutions(times_s)
    teeth = [mesh.teeth_at(mesh.cycles_per_rev * revolutions, times_s) for mesh in system.meshes]
    stiffness, error = zip(*teeth, strict=True)
    speeds = link_speeds(prepared)
    for link, row in zip(turning, vibration, strict=True):
        speeds[link] = row if motion.drive_load.full_rotation else speeds[link] + row
    forces = dict(zip(supports, pressed, strict=True))
    of_contacts = {
        "truth_transmission_error": (
            turned - touching,
            "m",
            "dynamic, by rotations and planets, along the line of action, from where driving flanks touch",
        ),
        "truth_mesh_deflection": (deflection - touching, "m", "the same by all motions, positive as gears approach"),
        "truth_tooth_error": (error, "m", "of unloaded teeth, along the line of action, positive as gears approach"),
        "truth_mesh_force": (mesh_force, "N", "along the line of action, positive where teeth are pressed together"),
        "truth_mesh_stiffness": (stiffness, "N m-1", "along the line of action"),
    }
    return {
        **{
            name: _stacked("truth_contact", dict(zip(names, rows, strict=True)), units, about)
            for name, (rows, units, about) in of_contacts.items()
        },
        **({"truth_bearing_force": _stacked("truth_support", forces, "N", "on the frame")} if forces else {}),
        **speed_truth(speeds),
    }


def _rotation(prepared: PreparedScene, link: str) -> str:
    return f"{prepared.scene.kinematics.bodies[link]} rotation"


def _stacked(dim: str, rows: dict[str, Array], units: str, about: str) -> xr.DataArray:
    return xr.DataArray(
        np.stack([*rows.values()]), dims=(dim, "time"), coords={dim: [*rows]}, attrs={"units": units, "about": about}
    )
