"""Leave stages out: what lies behind teeth that do not give turns along, and the rest feels its inertia and torque."""

import re
from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate import Load, Output
from data_synth.mechanics import Array, System
from data_synth.motion import Motion

Integers = NDArray[np.intp]

_NONE = 1e-12


def contacts_in(system: System, mesh: str) -> list[int]:
    """Return the numbers of a mesh in a system: several where it has copies, called like it and numbered."""
    name = re.compile(rf"{re.escape(mesh)}( \d+)?")
    return [number for number, other in enumerate(system.meshes) if name.fullmatch(other.name)]


def without(motion: Motion, meshes: Collection[str]) -> Motion:
    """Return a motion in which these meshes neither give nor err.

    With ``g . q = 0`` for each of them a rotation follows from the others: ``q = T r``, and ``T' M T`` takes the place
    of M, and likewise for damping, springs and loads. Bearings of motions that are held no longer feel these meshes.
    """
    if not meshes:
        return motion
    system = motion.system
    left = [number for name in meshes for number in contacts_in(system, name)]
    ties, free = _ties(motion, np.array([system.meshes[number].direction for number in left]))
    kept = [number for number in range(len(system.meshes)) if number not in left]
    turned, varying = motion.turned, motion.load.varying
    drag = motion.load.quadratic_drag
    load = Load(
        constant=motion.load.constant @ ties,
        quadratic_drag=None if drag is None else drag[free],
        varying=None if varying is None else lambda times_s: varying(times_s) @ ties,
    )
    return replace(
        motion,
        system=_tied(system, ties, free, kept),
        turned=replace(turned, load=load, damping=ties.T @ turned.damping @ ties, rigid=turned.rigid[free]),
        output=_heard(motion.output, ties, kept),
        teeth={mesh.name: motion.teeth[mesh.name] for number, mesh in enumerate(system.meshes) if number in kept},
    )


def _ties(motion: Motion, rows: Array) -> tuple[Array, Integers]:
    """Return T (dof, left) and the numbers of the degrees of freedom that are left."""
    system, drag = motion.system, motion.load.quadratic_drag
    scene = motion.stage.scene
    reference = scene.kinematics.bodies[str(scene.gearbox.reference)]
    may_follow = np.array([name.endswith(" rotation") and name != f"{reference} rotation" for name in system.names])
    if drag is not None:
        may_follow &= drag == 0
    ties, left = np.eye(system.dof), np.ones(system.dof, dtype=bool)
    for row in rows:
        reach = row @ ties
        weight = np.where(may_follow & left, np.abs(reach), 0.0)
        follower = int(np.argmax(weight))
        if weight[follower] <= _NONE * np.max(np.abs(row)):
            continue
        left[follower] = False
        others = -reach / reach[follower]
        others[follower] = 0.0
        ties = ties + np.outer(ties[:, follower], others)
        ties[:, follower] = 0.0
    free = np.flatnonzero(left)
    return ties[:, free], free


def _tied(system: System, ties: Array, free: Integers, kept: list[int]) -> System:
    gyroscopic = None if system.gyroscopic is None else ties.T @ system.gyroscopic @ ties
    return System(
        mass=_even(ties.T @ system.mass @ ties),
        damping=ties.T @ system.damping @ ties,
        stiffness=_even(ties.T @ system.stiffness @ ties),
        gyroscopic=gyroscopic,
        meshes=tuple(replace(mesh, direction=mesh.direction @ ties) for mesh in map(system.meshes.__getitem__, kept)),
        names=tuple(system.names[number] for number in free),
        springs=tuple(
            replace(spring, direction=spring.direction @ ties)
            for spring in system.springs
            if (spring.direction @ ties).any()
        ),
    )


def _even(matrix: Array) -> Array:
    """Return a symmetric matrix without the rounding that makes it otherwise."""
    return np.asarray((matrix + matrix.T) / 2)


def _heard(output: Output, ties: Array, kept: list[int]) -> Output:
    maps = {
        name: given[:, kept] if name == "mesh_force" else given @ ties
        for name, given in output.maps.items()
        if name != "mesh_force" or kept
    }
    return Output(rate_hz=output.rate_hz, **maps)
