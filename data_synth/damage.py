"""Harmonics and impacts of the faults that a scene declares."""

import math
from collections.abc import Callable, Sequence

from data_synth.bearing_faults import bearing_impact_trains, settling_time_s
from data_synth.combs import HarmonicFamily, RandomStreams, healthy_families
from data_synth.drive import Drive
from data_synth.faults import ImpactTrain, damage_trains, gear_damage_family
from data_synth.gear_faults import FaultyGear, GearFault
from data_synth.passing import with_planet_pass
from data_synth.path import ringing_time_s
from data_synth.profile import Array
from data_synth.scene import BearingFault, Scene, ShaftFault
from data_synth.shaft_faults import ShaftExcitation, bent_shaft, imbalance, shaft_fault_family, shaft_misalignment
from data_synth.ways import longest_ringing_s


def last_s(scene: Scene) -> float:
    """Return the time of the last sample."""
    return (scene.samples - 1) / scene.rate_hz


def harmonic_families(
    scene: Scene, drive: Drive, *, offsets: Sequence[float], relative_sizes: Sequence[Array], rng_for: RandomStreams
) -> list[HarmonicFamily]:
    """Return the harmonics of the healthy gearbox, then those that each fault adds.

    Two faults of one mesh do not modulate each other. `relative_sizes` has, for each fault, its size over the initial
    one: (instant,), or (1,) for a fault that does not grow.
    """
    healthy = healthy_families(scene, rng_for=rng_for)
    meshes = {family.component: family for family in healthy if family.kind == "gear_mesh"}
    teeth = scene.exact_orders("tooth")
    added = []
    for number, (fault, offset, relative_size) in enumerate(zip(scene.faults, offsets, relative_sizes, strict=True)):
        size = fault.initial_mm * relative_size
        if isinstance(fault, GearFault):
            mesh, tooth = meshes[mesh_name(fault.component)], teeth[fault.component]
            family = gear_damage_family(
                fault,
                gear=faulty_gear(scene, number, teeth=float(mesh.base_order / tooth), rng_for=rng_for),
                mesh=mesh,
                tooth=tooth,
                offset=offset,
                rise=size * fault.amplitude_per_mm,
                lag_rad=size * fault.phase_rad_per_mm,
            )
            added.append(family)
        elif isinstance(fault, ShaftFault):
            family = shaft_fault_family(
                _EXCITATIONS[fault.kind](),
                component=fault.component,
                order=scene.exact_orders("shaft")[fault.component],
                amplitude=size * fault.amplitude_per_mm,
                reference_speed_hz=drive.angle.top_speed_hz(0.0, scene.duration_s),
                offset=offset,
            )
            added.append(family)
    return with_planet_pass(scene, healthy, rng_for=rng_for) + added


_EXCITATIONS: dict[str, Callable[[], ShaftExcitation]] = {
    "imbalance": imbalance,
    "bent_shaft": bent_shaft,
    "shaft_misalignment": shaft_misalignment,
}


def faulty_gear(scene: Scene, number: int, *, teeth: float, rng_for: RandomStreams) -> FaultyGear:
    """Return the properties of the gear of fault `number` (from 0) on which the fault depends."""
    width_m = face_width_m(scene, scene.faults[number].component)
    return FaultyGear(teeth=teeth, face_width_m=width_m, rng=lambda: rng_for("pits", str(number)))


def face_width_m(scene: Scene, component: str) -> float:
    """Return the face width of the mesh of a gear such as ``stage 1/pinion``; infinite where it is not declared."""
    declared = {mesh.name: mesh.face_width_mm for mesh in scene.gearbox.meshes}[mesh_name(component)]
    return declared / 1000 if declared is not None else math.inf


def mesh_name(component: str) -> str:
    """Return the mesh of a gear such as ``stage 1/pinion``."""
    return component.rpartition("/")[0]


def impact_trains(
    scene: Scene,
    drive: Drive,
    families: Sequence[HarmonicFamily],
    *,
    offsets: Sequence[float],
    rng_for: RandomStreams,
) -> list[tuple[int, ImpactTrain]]:
    """Return the number of the fault and the impacts of each train whose response reaches into the record."""
    bases = {family.component: float(family.base_order) for family in families if family.kind == "gear_mesh"}
    trains: list[tuple[int, ImpactTrain]] = []
    for number, (fault, offset) in enumerate(zip(scene.faults, offsets, strict=True)):
        if isinstance(fault, BearingFault):
            before_s = max(longest_ringing_s(scene, fault.component), settling_time_s(scene, fault))
            found = bearing_impact_trains(
                scene,
                number,
                drive=drive,
                span_rev=_span_rev(scene, drive, ringing_time_s(scene.resonance)),
                since_rev=_span_rev(scene, drive, before_s)[0],
                rng=rng_for("impacts", str(number)),
            )
        elif isinstance(fault, ShaftFault):
            continue
        else:
            mesh, tooth = mesh_name(fault.component), scene.exact_orders("tooth")[fault.component]
            found = damage_trains(
                fault,
                gear=faulty_gear(scene, number, teeth=bases[mesh] / float(tooth), rng_for=rng_for),
                source=mesh,
                tooth=tooth,
                offset=offset,
                span_rev=_span_rev(scene, drive, longest_ringing_s(scene, mesh)),
            )
        trains += [(number, train) for train in found]
    return trains


def _span_rev(scene: Scene, drive: Drive, before_s: float) -> tuple[float, float]:
    """Return the revolutions at `before_s` before the record, or the first known, and at its last sample."""
    first_rev, last_rev = drive.angle.revolutions([max(-before_s, drive.start_s), last_s(scene)])
    return float(first_rev), float(last_rev)
