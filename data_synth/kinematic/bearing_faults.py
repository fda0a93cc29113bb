"""Impacts of a declared bearing fault, and the parameters of a bearing with its own dynamics."""

import math
from dataclasses import replace

import numpy as np

from data_synth.bearings.five_dof import BearingModel, Spall, Support
from data_synth.bearings.impacts import LoadZone, bearing_impacts, passage_revolutions, rests_in_zone
from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.operation.drive import Drive
from data_synth.operation.shaft_angle import Array
from data_synth.scene.machine_faults import FiveDof, Suspended
from data_synth.scene.scene import BearingFault, Scene, SceneError
from hums.gearbox.components import Bearing

_MM, _UM = 1e-3, 1e-6
_SETTLED_FRACTION = 1e-6  # of the start from rest when the record begins


def bearing_impact_trains(
    scene: Scene,
    number: int,
    *,
    drive: Drive,
    span_rev: tuple[float, float],
    since_rev: float,
    rng: np.random.Generator,
) -> list[ImpactTrain]:
    """Return the impacts of bearing fault `number` (from 0), and the entries into its spall where they are declared.

    Parameters
    ----------
    scene : Scene
    number : int
    drive : Drive
    span_rev : (float, float)
        First and last revolution of the reference shaft.
    since_rev : float
        Revolution from which earlier impacts are drawn too; those within the span do not depend on it.
    rng : numpy.random.Generator
    """
    fault = bearing_fault(scene, number)
    if _bearing(scene, fault).element_diameter_mm is not None:
        _radius_of_fault(scene, fault, size_mm=fault.size_mm * float(fault.relative_size(scene.duration_s)))
    rates, turning = scene.bearing(fault.component), zone_order(scene, fault)
    if fault.kind == "inner_race" and fault.place_deg and not rests_in_zone(fault.kind, rates, turning):
        raise SceneError(
            f"fault {number + 1}: place_deg = {fault.place_deg:g} is the place of a ring at rest in its load zone, and "
            f'the inner ring of "{fault.component}" turns in it; leave it out.'
        )
    impacts = bearing_impacts(
        fault.kind,
        rates=rates,
        slip=fault,
        zone=LoadZone.of(distribution=fault.load_distribution, exponent=fault.load_exponent),
        span_rev=span_rev,
        rng=rng,
        place_turns=fault.place_deg / 360,
        inner_share=fault.inner_share,
        zone_order=turning,
        since_rev=since_rev if since_rev < span_rev[0] else None,
    )
    train = ImpactTrain(
        component=fault.component,
        kind=fault.kind,
        source=fault.component,
        revolutions=impacts.revolutions,
        amplitudes=fault.size_mm * fault.impact_per_mm * impacts.weights,
        bearing=impacts,
    )
    if fault.five_dof is not None or not (fault.entry_share or fault.pulse_share):
        return [train]
    sizes_m = _MM * fault.size_mm * fault.relative_size(drive.angle.times(impacts.revolutions))
    passage_rev = _passage_rev(scene, number, sizes_m)
    train = replace(train, duration_rev=fault.pulse_share * passage_rev if fault.pulse_share else None)
    if not fault.entry_share:
        return [train]
    entries = replace(
        train,
        # from the entry to the impact an element that bridges a spall takes half of the time it takes to pass it
        revolutions=impacts.revolutions - passage_rev / 2,
        amplitudes=fault.entry_share * train.amplitudes,
        bearing=None,
        is_entry=True,
    )
    return [train, entries]


def bearing_fault(scene: Scene, number: int) -> BearingFault:
    """Return fault `number` (from 0), a bearing fault."""
    fault = scene.faults[number]
    assert isinstance(fault, BearingFault)  # noqa: S101 - the caller has seen its kind
    return fault


def zone_order(scene: Scene, fault: BearingFault) -> float:
    """Return the order of the load zone's rotation, seen from the carrier of the bearing."""
    if fault.load_turns_with is None:
        return 0.0
    link = fault.load_turns_with
    return float(scene.ratio(link)) - scene.bearing(fault.component).carried


def _passage_rev(scene: Scene, number: int, sizes_m: Array) -> Array:
    """Return the rotation of the reference shaft while spalls of these sizes (n,) are passed, (n,) rev."""
    fault, largest_m = bearing_fault(scene, number), float(np.max(sizes_m, initial=0.0))
    if largest_m == 0:
        return np.zeros_like(sizes_m)
    key = f"fault {number + 1}: {'entry_share' if fault.entry_share else 'pulse_share'}"
    bearing, element_m, pitch_m = _bearing_geometry(scene, fault, key)
    try:
        longest = passage_revolutions(
            fault.kind,
            rates=scene.bearing(fault.component),
            size_m=largest_m,
            pitch_diameter_m=pitch_m,
            element_diameter_m=element_m,
            contact_angle_rad=math.radians(bearing.contact_angle_deg),
        )
    except ValueError as caught:
        raise SceneError(f"fault {number + 1}: {caught}.") from None
    return np.asarray(longest * sizes_m / largest_m)


def _bearing_geometry(scene: Scene, fault: BearingFault, key: str) -> tuple[Bearing, float, float]:
    """Return the declared bearing, its element diameter and its pitch diameter in m; `key` is what needs them."""
    bearing = _bearing(scene, fault)
    if bearing.element_diameter_mm is None or bearing.pitch_diameter_mm is None:
        raise SceneError(
            f'{key} needs the geometry of "{fault.component}", which is declared by multiples; give elements, '
            "element_diameter_mm and pitch_diameter_mm in the gearbox instead."
        )
    return bearing, _MM * bearing.element_diameter_mm, _MM * bearing.pitch_diameter_mm


def _bearing(scene: Scene, fault: BearingFault) -> Bearing:
    return next(declared for declared in scene.gearbox.bearings if fault.component in declared.names)


def _radius_of_fault(scene: Scene, fault: BearingFault, *, size_mm: float) -> float:
    """Return the radius in m on which a fault of `size_mm` is, shorter than from one contact to the next.

    Raises
    ------
    SceneError
        A bearing without diameters, or a fault longer than that.
    """
    bearing, element_m, pitch_m = _bearing_geometry(scene, fault, f"five_dof of {fault.kind}")
    across = element_m * math.cos(math.radians(bearing.contact_angle_deg))
    diameters_m = {"outer_race": pitch_m + across, "inner_race": pitch_m - across, "cage": pitch_m}
    radius_m = diameters_m.get(fault.kind, element_m) / 2
    spacing_rad = math.pi if fault.kind == "rolling_element" else 2 * math.pi / scene.bearing(fault.component).elements
    if _MM * size_mm >= spacing_rad * radius_m:
        raise SceneError(
            f'{fault.kind} of "{fault.component}": {size_mm:g} mm reach from one contact to the next, '
            f"{spacing_rad * radius_m / _MM:.3g} mm on; lower the size."
        )
    return radius_m


# ---- a bearing that moves --------------------------------------------------------------------------------------


def settling_time_s(scene: Scene, fault: BearingFault) -> float:
    """Return the time before the record after which 1e-6 is left of the start from rest; 0 without `five_dof`."""
    if fault.five_dof is None:
        return 0.0
    model = bearing_model(scene, fault, size_mm=fault.size_mm)
    supports = (model.shaft, model.pedestal, model.resonator)
    return math.log(1 / _SETTLED_FRACTION) / min(support.damping_n_s_m / (2 * support.mass_kg) for support in supports)


def bearing_model(scene: Scene, fault: BearingFault, *, size_mm: float) -> BearingModel:
    """Return the parameters of a bearing with its own dynamics and a fault of `size_mm`.

    Raises
    ------
    SceneError
        A bearing without diameters, or a spall longer than the distance of two elements.
    """
    declared = fault.five_dof or FiveDof()
    radius_m = _radius_of_fault(scene, fault, size_mm=size_mm)
    _, element_m, _ = _bearing_geometry(scene, fault, f"five_dof of {fault.kind}")
    elements, width_rad = scene.bearing(fault.component).elements, _MM * size_mm / radius_m
    depth_m = _UM * declared.depth_um if declared.depth_um is not None else (_MM * size_mm) ** 2 / (4 * element_m)
    mode = scene.resonance
    return BearingModel(
        elements=elements,
        contact_n_m=declared.contact_n_m,
        exponent=fault.load_exponent,
        clearance_m=_UM * declared.clearance_um,
        shaft=_support(declared.shaft),
        pedestal=_support(declared.pedestal),
        resonator=Support.resonant(
            mass_kg=declared.resonator_kg, frequency_hz=mode.frequency_hz, damping_ratio=mode.damping_ratio
        ),
        spall=Spall(of="element" if fault.kind == "rolling_element" else "ring", width_rad=width_rad, depth_m=depth_m),
    )


def _support(declared: Suspended) -> Support:
    return Support(mass_kg=declared.mass_kg, damping_n_s_m=declared.damping_n_s_m, stiffness_n_m=declared.stiffness_n_m)


def shaft_load_n(fault: BearingFault, *, load: Array, turns: Array) -> Array:
    """Return the force on the shaft in x and y, (2, n) N, by relative tooth load and direction in turns."""
    size = (fault.five_dof or FiveDof()).load_n * load
    return np.stack([size * np.cos(2 * np.pi * turns), size * np.sin(2 * np.pi * turns)])
