"""From a bearing fault that a scene declares to its impacts, and to the bearing that moves where it asks for one."""

import math
from dataclasses import replace

import numpy as np

from data_synth.bearing_dynamics import BearingModel, Spall, Support
from data_synth.bearings import bearing_impacts, passage_revolutions
from data_synth.defects import FiveDof, Suspended
from data_synth.drive import Drive
from data_synth.faults import ImpactTrain
from data_synth.load_zone import LoadZone
from data_synth.profile import Array
from data_synth.scene import BearingFault, Scene, SceneError
from hums.gearbox import Bearing

_MM, _UM = 1e-3, 1e-6
_LEFT = 1e-6  # of the start from rest when the record begins


def bearing_impact_trains(
    scene: Scene,
    number: int,
    *,
    drive: Drive,
    span_rev: tuple[float, float],
    since_rev: float,
    rng: np.random.Generator,
) -> list[ImpactTrain]:
    """Return the impacts of fault `number` (from 0), a bearing's, and its drops into a spall where there are such.

    Parameters
    ----------
    scene : Scene
    number : int
    drive : Drive
    span_rev : (float, float)
        First and last revolution of the reference shaft.
    since_rev : float
        From where on it is struck before, which leaves the strikes within the span as they are.
    rng : numpy.random.Generator
    """
    fault = bearing_fault(scene, number)
    impacts = bearing_impacts(
        fault.kind,
        rates=scene.bearing(fault.component),
        slip=fault,
        zone=LoadZone.of(distribution=fault.load_distribution, exponent=fault.load_exponent),
        span_rev=span_rev,
        rng=rng,
        place_turns=fault.place_deg / 360,
        inner_share=fault.inner_share,
        zone_order=zone_order(scene, fault),
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
    passed_rev = _passed_rev(scene, number, sizes_m)
    train = replace(train, duration_rev=fault.pulse_share * passed_rev if fault.pulse_share else None)
    if not fault.entry_share:
        return [train]
    entries = replace(
        train,
        # from the entry to the impact an element that bridges a spall takes half of the time it takes to pass it
        revolutions=impacts.revolutions - passed_rev / 2,
        amplitudes=fault.entry_share * train.amplitudes,
        bearing=None,
        is_entry=True,
    )
    return [train, entries]


def bearing_fault(scene: Scene, number: int) -> BearingFault:
    """Return fault `number` (from 0), which is a bearing's."""
    fault = scene.faults[number]
    assert isinstance(fault, BearingFault)  # noqa: S101 - the caller has seen its kind
    return fault


def zone_order(scene: Scene, fault: BearingFault) -> float:
    """Return the turns of the load zone for one of the reference shaft, as who carries the bearing sees it."""
    if fault.load_turns_with is None:
        return 0.0
    link = fault.load_turns_with
    return float(scene.ratio(link)) - scene.bearing(fault.component).carried


def _passed_rev(scene: Scene, number: int, sizes_m: Array) -> Array:
    """Return how far the reference shaft turns while spalls of these sizes (n,) are passed, (n,)."""
    fault, largest_m = bearing_fault(scene, number), float(np.max(sizes_m, initial=0.0))
    if largest_m == 0:
        return np.zeros_like(sizes_m)
    who = f"fault {number + 1}: {'entry_share' if fault.entry_share else 'pulse_share'}"
    bearing, element_m, pitch_m = _geometry(scene, fault, who)
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


def _geometry(scene: Scene, fault: BearingFault, who: str) -> tuple[Bearing, float, float]:
    bearing = next(declared for declared in scene.gearbox.bearings if fault.component in declared.names)
    if bearing.element_diameter_mm is None or bearing.pitch_diameter_mm is None:
        raise SceneError(
            f'{who} needs the geometry of "{fault.component}", which is declared by multiples; give elements, '
            "element_diameter_mm and pitch_diameter_mm in the gearbox instead."
        )
    return bearing, _MM * bearing.element_diameter_mm, _MM * bearing.pitch_diameter_mm


# ---- a bearing that moves --------------------------------------------------------------------------------------


def settling_time_s(scene: Scene, fault: BearingFault) -> float:
    """Return how long a bearing has to move before the record, so that a millionth is left of its start; else 0."""
    if fault.five_dof is None:
        return 0.0
    model = bearing_model(scene, fault, size_mm=fault.size_mm)
    supports = (model.shaft, model.pedestal, model.resonator)
    return math.log(1 / _LEFT) / min(support.damping_n_s_m / (2 * support.mass_kg) for support in supports)


def bearing_model(scene: Scene, fault: BearingFault, *, size_mm: float) -> BearingModel:
    """Return the bearing of a fault of `size_mm` that moves.

    Raises
    ------
    SceneError
        A bearing without diameters, or a spall longer than from element to element.
    """
    declared = fault.five_dof or FiveDof()
    bearing, element_m, pitch_m = _geometry(scene, fault, f"five_dof of {fault.kind}")
    across = element_m * math.cos(math.radians(bearing.contact_angle_deg))
    radius_m = {"outer_race": pitch_m + across, "inner_race": pitch_m - across}.get(fault.kind, element_m) / 2
    elements = scene.bearing(fault.component).elements
    width_rad = _MM * size_mm / radius_m
    room_rad = math.pi if fault.kind == "rolling_element" else 2 * math.pi / elements
    if width_rad >= room_rad:
        raise SceneError(
            f'{fault.kind} of "{fault.component}": a spall of {size_mm:g} mm reaches from one contact to the next, '
            f"{room_rad * radius_m / _MM:.3g} mm on; lower its size."
        )
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
    """Return the force on the shaft across and up, (2, n), by the share of full load and the turn of its direction."""
    size = (fault.five_dof or FiveDof()).load_n * load
    return np.stack([size * np.cos(2 * np.pi * turns), size * np.sin(2 * np.pi * turns)])
