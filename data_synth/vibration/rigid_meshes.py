"""Rigid meshes: gear stages whose teeth do not deflect, reduced to inertia and torque on the others."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.system import Array, System
from data_synth.integrators.problem import Load, Output
from data_synth.vibration.run import Motion, contacts_in

Integers = NDArray[np.intp]

_NEGLIGIBLE = 1e-12


def without_meshes(motion: Motion, meshes: Collection[str]) -> Motion:
    """Return a motion in which these meshes are rigid and without transmission error.

    With ``g . q = 0`` for each of them a rotation follows from the others: ``q = T r``, and ``T' M T`` replaces M,
    likewise for damping, springs and loads. The statics of motions that are not simulated lose these mesh forces.
    """
    if not meshes:
        return motion
    system = motion.system
    removed = [number for name in meshes for number in contacts_in(system, name)]
    elimination, free = _elimination(motion, np.array([system.meshes[number].direction for number in removed]))
    kept = [number for number in range(len(system.meshes)) if number not in removed]
    drive_load = motion.drive_load
    drag = motion.load.quadratic_drag
    forces = motion.sensor_forces
    names = {system.meshes[number].name for number in kept}
    load = Load(
        constant=motion.load.constant @ elimination,
        quadratic_drag=None if drag is None else drag[free],
        varying=motion.load.varying,
        directions=None if motion.load.directions is None else motion.load.directions @ elimination,
    )
    return replace(
        motion,
        system=_reduced_system(system, elimination, free, kept),
        drive_load=replace(
            drive_load,
            load=load,
            damping=elimination.T @ drive_load.damping @ elimination,
            rigid_motion=drive_load.rigid_motion[free],
        ),
        sensor_forces=replace(
            forces, static_n={name: force for name, force in forces.static_n.items() if name in names}
        ),
        output=_reduced_output(motion.output, elimination, kept),
        teeth={mesh.name: motion.teeth[mesh.name] for number, mesh in enumerate(system.meshes) if number in kept},
    )


def _elimination(motion: Motion, rows: Array) -> tuple[Array, Integers]:
    """Return T (dof, remaining) and the numbers of the remaining degrees of freedom, by Gaussian elimination."""
    system, drag = motion.system, motion.load.quadratic_drag
    scene = motion.stage.scene
    reference = scene.kinematics.bodies[str(scene.gearbox.reference)]
    may_be_eliminated = np.array(
        [name.endswith(" rotation") and name != f"{reference} rotation" for name in system.names]
    )
    if drag is not None:
        may_be_eliminated &= drag == 0
    elimination, remaining = np.eye(system.dof), np.ones(system.dof, dtype=bool)
    for row in rows:
        coefficients = row @ elimination
        weight = np.where(may_be_eliminated & remaining, np.abs(coefficients), 0.0)
        eliminated = int(np.argmax(weight))
        if weight[eliminated] <= _NEGLIGIBLE * np.max(np.abs(row)):
            continue
        remaining[eliminated] = False
        others = -coefficients / coefficients[eliminated]
        others[eliminated] = 0.0
        elimination = elimination + np.outer(elimination[:, eliminated], others)
        elimination[:, eliminated] = 0.0
    free = np.flatnonzero(remaining)
    return elimination[:, free], free


def _reduced_system(system: System, elimination: Array, free: Integers, kept: list[int]) -> System:
    """Return a system in fewer degrees of freedom, ``T' M T`` and so on, T being `elimination`."""
    gyroscopic = None if system.gyroscopic is None else elimination.T @ system.gyroscopic @ elimination
    return System(
        mass=_symmetric(elimination.T @ system.mass @ elimination),
        damping=elimination.T @ system.damping @ elimination,
        stiffness=_symmetric(elimination.T @ system.stiffness @ elimination),
        gyroscopic=gyroscopic,
        meshes=tuple(
            system.meshes[number].in_coordinates(lambda direction: np.asarray(direction @ elimination))
            for number in kept
        ),
        names=tuple(system.names[number] for number in free),
        springs=tuple(
            replace(spring, direction=spring.direction @ elimination)
            for spring in system.springs
            if (spring.direction @ elimination).any()
        ),
    )


def _symmetric(matrix: Array) -> Array:
    """Return a matrix made symmetric to the last digit."""
    return np.asarray((matrix + matrix.T) / 2)


def _reduced_output(output: Output, elimination: Array, kept: list[int]) -> Output:
    """Return the output maps over the remaining degrees of freedom and meshes."""
    maps = {
        name: given[:, kept] if name == "mesh_force" else given @ elimination
        for name, given in output.maps.items()
        if name != "mesh_force" or kept
    }
    return Output(rate_hz=output.rate_hz, **maps)
