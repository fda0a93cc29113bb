"""The gearbox of a scene as equations of motion: its declared bodies, bearings and meshes assembled."""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from data_synth.assembly import Assembly, Inertia, SupportStiffness, assemble_parts
from data_synth.layout import direction_of
from data_synth.mesh import Constant
from data_synth.meshing import Gears, declared_of
from data_synth.parts import MeshProperties
from data_synth.scene import Scene, SceneError
from data_synth.stage import PreparedScene
from hums.kinematics import Kinematics

_PARALLEL = 1e-9


def assembly_of(
    stage: PreparedScene, gears: Gears, *, levels: Mapping[str, str], springs: Collection[str] = ()
) -> Assembly:
    """Return the gearbox of a scene in the plane, or in space where its axes cross or a mesh has full motion.

    Bodies in mesh with planets have coordinates that rotate with the carrier, with the gyroscopic terms of the mean
    speed; a run-up, which has no mean speed, leaves them out.

    Parameters
    ----------
    stage : PreparedScene
    gears : Gears
    levels : mapping of mesh to "torsional", "lateral" or "full"
    springs : collection of mesh
        Meshes of constant mean stiffness without transmission error.

    Raises
    ------
    SceneError
        If `data_synth.assembly.assemble` raises ValueError.
    """
    scene, kinematics = stage.scene, gears.kinematics
    declared, full = declared_of(scene), "full" in levels.values()
    try:
        return assemble_parts(
            kinematics,
            motions="space" if full or has_crossed_axes(kinematics) else "plane",
            inertias={
                name: Inertia(mass_kg=item.mass_kg, inertia_kgm2=item.inertia_kg_m2)
                for link, item in declared.links
                for name in _copies(scene, link)
            },
            supports=dict(_supports(scene, kinematics)),
            meshes=dict(_meshes(gears, springs)),
            speed_rad_s=_speed_rad_s(stage, kinematics) if full or has_planets(kinematics) else 0.0,
            rotating_frame="carriers",
        )
    except ValueError as caught:
        raise SceneError(f"dynamics: {caught}") from None


def has_crossed_axes(kinematics: Kinematics) -> bool:
    """Return whether some axis is not parallel to the others."""
    first, *others = (direction_of(kinematics, body) for body in kinematics.joints)
    return any(abs(abs(float(first @ other)) - 1) > _PARALLEL for other in others)


def has_planets(kinematics: Kinematics) -> bool:
    """Return whether there is a rotating planet carrier."""
    return any(joint.carried_by != kinematics.mechanism.frame for joint in kinematics.joints.values())


def _speed_rad_s(stage: PreparedScene, kinematics: Kinematics) -> float:
    if stage.scene.speed.run_up is not None and has_planets(kinematics):
        return 0.0
    return 2 * math.pi * float(np.mean(stage.speed_hz))


def _copies(scene: Scene, name: str) -> tuple[str, ...]:
    """Return the links of a declared name with copies, or the name itself."""
    return scene.gearbox.instances(name) if name in scene.gearbox.copied else (name,)


def _supports(scene: Scene, kinematics: Kinematics) -> Iterator[tuple[str, SupportStiffness]]:
    for link, item in declared_of(scene).bearings:
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
        )
        yield from ((name, hold) for name in _copies(scene, link))


def _meshes(gears: Gears, springs: Collection[str]) -> Iterator[tuple[str, MeshProperties]]:
    for name, teeth in gears.teeth.items():
        given = teeth.properties
        if gears.meshes[name] in springs and given.stiffness is not None:
            given = replace(given, stiffness=Constant(mean=given.stiffness.mean), error=None)
        yield name, given
