"""Families of lines and impact trains of the healthy components of a scene and of its faults."""

import math
from collections.abc import Sequence

import numpy as np

from data_synth.kinematic.bearing_faults import bearing_impact_trains
from data_synth.kinematic.gear_faults import ImpactTrain, damage_trains, gear_damage_family
from data_synth.kinematic.harmonics import HarmonicFamily, shaft_fault_family
from data_synth.kinematic.imperfect_parts import imbalance_family, imperfect_families
from data_synth.kinematic.planet_pass import with_planet_pass
from data_synth.operation.drive import Drive
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import Chipping, FaultyGear, GearDamage, GearFault, Misalignment
from data_synth.scene.machine_faults import BearingFault, ShaftFault
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError, declared_size_mm
from data_synth.transfer.paths import longest_ringing_s, ringing_time_s
from hums.gearbox.model import GearboxError


def last_s(scene: Scene) -> float:
    """Return the time of the last sample in s."""
    return (scene.samples - 1) / scene.rate_hz


def harmonic_families(
    scene: Scene, drive: Drive, *, offsets: Sequence[float], relative_sizes: Sequence[Array], rng_for: RandomStreams
) -> list[HarmonicFamily]:
    """Return the harmonics of the healthy gearbox, followed by those added by each fault.

    Two faults of one mesh do not modulate each other. `relative_sizes` are the sizes of each fault relative to the
    initial one, (instant,), or (1,) for a fault that does not grow.
    """
    healthy, top_speed_hz = healthy_families(scene, rng_for=rng_for), drive.angle.top_speed_hz(0.0, scene.duration_s)
    meshes = {family.component: family for family in healthy if family.kind == "gear_mesh"}
    teeth = scene.exact_orders("tooth")
    added = []
    for number, (fault, offset, relative_size) in enumerate(zip(scene.faults, offsets, relative_sizes, strict=True)):
        size = fault.initial_mm * relative_size
        if isinstance(fault, GearFault):
            effect = fault.effect_mm(size)
            per_mm, lag_rad_per_mm, _ = fault.factors
            mesh, tooth = meshes[mesh_name(fault.component)], teeth[fault.component]
            gear = faulty_gear(scene, number, teeth=float(mesh.base_order / tooth), rng_for=rng_for)
            if gear.face_width_m is not None or not isinstance(fault, Chipping | Misalignment):
                damage_of(scene, number, gear=gear, relative_size=float(np.max(relative_size)), time_s=scene.duration_s)
            family = gear_damage_family(
                fault,
                gear=gear,
                mesh=mesh,
                tooth=tooth,
                offset=offset,
                rise=effect * per_mm,
                lag_rad=effect * lag_rad_per_mm,
            )
            added.append(family)
        elif isinstance(fault, ShaftFault) and fault.rotor_kg is not None:
            family = imbalance_family(
                scene,
                fault.component,
                mass_kg=fault.rotor_kg,
                eccentricity_m=1e-3 * size,
                top_speed_hz=top_speed_hz,
                offset=offset,
            )
            added.append(family)
        elif isinstance(fault, ShaftFault):
            family = shaft_fault_family(
                fault.kind,
                component=fault.component,
                order=scene.exact_orders("shaft")[fault.component],
                amplitude=size if fault.amplitude_per_mm is None else size * fault.amplitude_per_mm,
                reference_speed_hz=top_speed_hz,
                offset=offset,
            )
            added.append(family)
    imperfect = imperfect_families(scene, healthy, top_speed_hz=top_speed_hz, rng_for=rng_for)
    return with_planet_pass(scene, healthy, rng_for=rng_for) + imperfect + added


def faulty_gear(scene: Scene, number: int, *, teeth: float, rng_for: RandomStreams) -> FaultyGear:
    """Return the properties of the gear of fault `number` (from 0) on which the fault depends."""
    mesh = mesh_name(scene.faults[number].component)
    width_mm, module_mm = (declared_size_mm(scene, mesh, key) for key in ("face_width_mm", "module_mm"))
    return FaultyGear(
        teeth=teeth,
        face_width_m=None if width_mm is None else 1e-3 * width_mm,
        module_m=math.inf if module_mm is None else 1e-3 * module_mm,
        rng=lambda: rng_for("pits", str(number)),
    )


def damage_of(scene: Scene, number: int, *, gear: FaultyGear, relative_size: float, time_s: float = 0.0) -> GearDamage:
    """Return the damage of the teeth of a gear by a fault of a size relative to the initial one.

    Raises
    ------
    SceneError
        A size larger than the gear allows.
    """
    fault = scene.faults[number]
    assert isinstance(fault, GearFault)  # noqa: S101 - the caller has checked it
    try:
        return fault.damage(1e-3 * fault.initial_mm * relative_size, gear)
    except ValueError as caught:
        when = "" if fault.growth is None else f" at {time_s:g} s"
        raise SceneError(f'fault {number + 1}, {fault.kind} of "{fault.component}"{when}: {caught}.') from None


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
    """Return the index of the fault and the impacts of each train whose response extends into the record."""
    bases = {family.component: float(family.base_order) for family in families if family.kind == "gear_mesh"}
    trains: list[tuple[int, ImpactTrain]] = []
    for number, (fault, offset) in enumerate(zip(scene.faults, offsets, strict=True)):
        if isinstance(fault, BearingFault):
            before_s = longest_ringing_s(scene, fault.component)
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
    """Return the revolutions `before_s` before the record, or at the first time known, and at the last sample."""
    stop_s = last_s(scene) + max(0.0, *(sensor.skew_s for sensor in scene.sensors))
    first_rev, last_rev = drive.angle.revolutions([max(-before_s, drive.start_s), stop_s])
    return float(first_rev), float(last_rev)


def healthy_families(scene: Scene, *, rng_for: RandomStreams) -> list[HarmonicFamily]:
    """Return one family for each shaft rotating in the frame and one for each mesh."""
    families = []
    for kind in ("shaft", "gear_mesh"):
        for component, order in scene.exact_orders(kind).items():
            harmonics = np.arange(scene.excitation.harmonics)
            turns = rng_for("phase", kind, component).random(harmonics.size)
            families.append(
                HarmonicFamily(
                    component=component,
                    kind=kind,
                    source=component,
                    base_order=order,
                    coefficients=scene.excitation.amplitude(kind, component)
                    * scene.excitation.decay**harmonics
                    * np.exp(2j * np.pi * turns),
                    load_dependent=kind == "gear_mesh",
                )
            )
    return families


def ratio_of(scene: Scene, link: str) -> float:
    """Return the absolute speed ratio of a link to the reference shaft."""
    return float(abs(scene.ratio(link)))


def turning_ratios(scene: Scene) -> dict[str, float]:
    """Return the signed speed ratio to the reference of each link that rotates relative to the frame.

    A link whose axis is carried in another direction, such as a bevel planet, has no such ratio and is left out.
    """
    found = {}
    for link in scene.gearbox.links:
        try:
            found[link] = float(scene.ratio(link))
        except GearboxError:
            continue
    return {link: ratio for link, ratio in found.items() if ratio != 0}
