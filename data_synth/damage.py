"""From the faults a scene declares to the lines they add and the impacts they strike."""

import math
from collections.abc import Callable, Sequence

from data_synth.bearing_faults import bearing_trains, settle_s
from data_synth.combs import Comb, Draws, healthy_combs
from data_synth.drive import Drive
from data_synth.faults import ImpactTrain, damage_comb, damage_trains
from data_synth.gear_faults import FaultyGear, GearFault
from data_synth.passing import as_they_pass
from data_synth.path import ring_seconds
from data_synth.profile import Array
from data_synth.scene import BearingFault, Scene, ShaftFault
from data_synth.shaft_faults import ShaftExcitation, bent_shaft, imbalance, shaft_comb, shaft_misalignment
from data_synth.ways import followed_s


def last_s(scene: Scene) -> float:
    """Return the time of the last sample."""
    return (scene.samples - 1) / scene.rate_hz


def combs_of(
    scene: Scene, drive: Drive, *, offsets: Sequence[float], courses: Sequence[Array], draws: Draws
) -> list[Comb]:
    """Return the healthy gearbox, then what each fault adds; two faults of one mesh do not modulate each other.

    `courses` (fault) (instant,) are the sizes of the faults relative to their first, of length one where they stay.
    """
    healthy = healthy_combs(scene, draws=draws)
    meshes = {comb.component: comb for comb in healthy if comb.kind == "gear_mesh"}
    teeth = scene.exact_orders("tooth")
    added = []
    for number, (fault, offset, course) in enumerate(zip(scene.faults, offsets, courses, strict=True)):
        size = fault.initial_mm * course
        if isinstance(fault, GearFault):
            mesh, tooth = meshes[mesh_name(fault.component)], teeth[fault.component]
            comb = damage_comb(
                fault,
                gear=faulty_gear(scene, number, teeth=float(mesh.base / tooth), draws=draws),
                mesh=mesh,
                tooth=tooth,
                offset=offset,
                rise=size * fault.amplitude_per_mm,
                lag_rad=size * fault.phase_rad_per_mm,
            )
            added.append(comb)
        elif isinstance(fault, ShaftFault):
            comb = shaft_comb(
                _EXCITATIONS[fault.kind](),
                component=fault.component,
                order=scene.exact_orders("shaft")[fault.component],
                amplitude=size * fault.amplitude_per_mm,
                at_speed_hz=drive.angle.top_speed_hz(0.0, scene.duration_s),
                offset=offset,
            )
            added.append(comb)
    return as_they_pass(scene, healthy, draws=draws) + added


_EXCITATIONS: dict[str, Callable[[], ShaftExcitation]] = {
    "imbalance": imbalance,
    "bent_shaft": bent_shaft,
    "shaft_misalignment": shaft_misalignment,
}


def faulty_gear(scene: Scene, number: int, *, teeth: float, draws: Draws) -> FaultyGear:
    """Return the gear that fault `number` (from 0) is on, as far as the fault depends on it."""
    width_m = face_width_m(scene, scene.faults[number].component)
    return FaultyGear(teeth=teeth, face_width_m=width_m, rng=lambda: draws("pits", str(number)))


def face_width_m(scene: Scene, component: str) -> float:
    """Return the face width of the mesh of a gear such as ``stage 1/pinion``; infinite where it is not declared."""
    declared = {mesh.name: mesh.face_width_mm for mesh in scene.gearbox.meshes}[mesh_name(component)]
    return declared / 1000 if declared is not None else math.inf


def mesh_name(component: str) -> str:
    """Return the mesh of a gear such as ``stage 1/pinion``."""
    return component.rpartition("/")[0]


def trains_of(
    scene: Scene,
    drive: Drive,
    combs: Sequence[Comb],
    *,
    offsets: Sequence[float],
    draws: Draws,
) -> list[tuple[int, ImpactTrain]]:
    """Return the impacts whose response lies in the record, some just before it, with the number of their fault."""
    bases = {comb.component: float(comb.base) for comb in combs if comb.kind == "gear_mesh"}
    trains: list[tuple[int, ImpactTrain]] = []
    for number, (fault, offset) in enumerate(zip(scene.faults, offsets, strict=True)):
        if isinstance(fault, BearingFault):
            before_s = max(followed_s(scene, fault.component), settle_s(scene, fault))
            struck = bearing_trains(
                scene,
                number,
                drive=drive,
                span_rev=_heard_rev(scene, drive, ring_seconds(scene.resonance)),
                since_rev=_heard_rev(scene, drive, before_s)[0],
                rng=draws("impacts", str(number)),
            )
        elif isinstance(fault, ShaftFault):
            continue
        else:
            mesh, tooth = mesh_name(fault.component), scene.exact_orders("tooth")[fault.component]
            struck = damage_trains(
                fault,
                gear=faulty_gear(scene, number, teeth=bases[mesh] / float(tooth), draws=draws),
                source=mesh,
                tooth=tooth,
                offset=offset,
                span_rev=_heard_rev(scene, drive, followed_s(scene, mesh)),
            )
        trains += [(number, train) for train in struck]
    return trains


def _heard_rev(scene: Scene, drive: Drive, before_s: float) -> tuple[float, float]:
    """Return the revolutions from some time before the record, as far as there is one, to its last sample."""
    first_rev, last_rev = drive.angle.revolutions([max(-before_s, drive.start_s), last_s(scene)])
    return float(first_rev), float(last_rev)
