"""Impacts of a declared bearing fault."""

import math
from dataclasses import replace

import numpy as np

from data_synth.bearings.impacts import LoadZone, bearing_impacts, passage_revolutions, rests_in_zone
from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.operation.drive import Drive
from data_synth.operation.shaft_angle import Array
from data_synth.scene.machine_faults import BearingFault
from data_synth.scene.scene import Scene, SceneError
from hums.gearbox.components import Bearing

_MM = 1e-3


def bearing_impact_trains(
    scene: Scene,
    number: int,
    *,
    drive: Drive,
    span_rev: tuple[float, float],
    since_rev: float,
    rng: np.random.Generator,
) -> list[ImpactTrain]:
    """Return the impacts of bearing fault `number` (from 0), and the entries into its spall if declared.

    Parameters
    ----------
    scene : Scene
    number : int
    drive : Drive
    span_rev : (float, float)
        First and last revolution of the reference shaft.
    since_rev : float
        Revolution from which earlier impacts are also drawn; those within the span do not depend on it.
    rng : numpy.random.Generator

    Raises
    ------
    SceneError
        A size beyond the spacing of contacts, or a missing bearing geometry.
    """
    fault = bearing_fault(scene, number)
    if _bearing(scene, fault).element_diameter_mm is not None:
        _check_size(scene, fault, size_mm=fault.size_mm * float(fault.relative_size(scene.duration_s)))
    rates, turning = scene.bearing(fault.component), zone_order(scene, fault)
    if fault.kind == "inner_race" and fault.place_deg and not rests_in_zone(fault.kind, rates, turning):
        raise SceneError(
            f"fault {number + 1}: place_deg = {fault.place_deg:g} applies to a ring at rest in its load zone, but the "
            f'inner ring of "{fault.component}" turns in it; leave it out.'
        )
    impacts = bearing_impacts(
        fault.kind,
        rates=rates,
        slip=fault,
        zone=LoadZone(distribution=fault.load_distribution, exponent=fault.load_exponent),
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
    if not (fault.entry_share or fault.pulse_share):
        return [train]
    sizes_m = _MM * fault.size_mm * fault.relative_size(drive.angle.times(impacts.revolutions))
    passage_rev = _passage_rev(scene, number, sizes_m)
    train = replace(train, duration_rev=fault.pulse_share * passage_rev if fault.pulse_share else None)
    if not fault.entry_share:
        return [train]
    entries = replace(
        train,
        # an element bridging a spall takes half the passage time from the entry to the impact
        revolutions=impacts.revolutions - passage_rev / 2,
        amplitudes=fault.entry_share * train.amplitudes,
        bearing=None,
        is_entry=True,
    )
    return [train, entries]


def bearing_fault(scene: Scene, number: int) -> BearingFault:
    """Return fault `number` (from 0), a bearing fault."""
    fault = scene.faults[number]
    assert isinstance(fault, BearingFault)  # noqa: S101 - the caller has checked its kind
    return fault


def zone_order(scene: Scene, fault: BearingFault) -> float:
    """Return the order of rotation of the load zone relative to the carrier of the bearing."""
    if fault.load_turns_with is None:
        return 0.0
    link = fault.load_turns_with
    return float(scene.ratio(link)) - scene.bearing(fault.component).carried


def _passage_rev(scene: Scene, number: int, sizes_m: Array) -> Array:
    """Return the rotation of the reference shaft during the passage of spalls of these sizes, (n,), in rev."""
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
    """Return the declared bearing, its element diameter and its pitch diameter in m, which `key` needs."""
    bearing = _bearing(scene, fault)
    if bearing.element_diameter_mm is None or bearing.pitch_diameter_mm is None:
        raise SceneError(
            f'{key} needs the geometry of "{fault.component}", which is declared by multiples; give elements, '
            "element_diameter_mm and pitch_diameter_mm in the gearbox instead."
        )
    return bearing, _MM * bearing.element_diameter_mm, _MM * bearing.pitch_diameter_mm


def _bearing(scene: Scene, fault: BearingFault) -> Bearing:
    return next(declared for declared in scene.gearbox.bearings if fault.component in declared.names)


def _check_size(scene: Scene, fault: BearingFault, *, size_mm: float) -> None:
    """Raise SceneError for a fault longer than the spacing of contacts."""
    bearing, element_m, pitch_m = _bearing_geometry(scene, fault, f"size_mm of {fault.kind}")
    across = element_m * math.cos(math.radians(bearing.contact_angle_deg))
    diameters_m = {"outer_race": pitch_m + across, "inner_race": pitch_m - across, "cage": pitch_m}
    radius_m = diameters_m.get(fault.kind, element_m) / 2
    spacing_rad = math.pi if fault.kind == "rolling_element" else 2 * math.pi / scene.bearing(fault.component).elements
    if _MM * size_mm >= spacing_rad * radius_m:
        raise SceneError(
            f'{fault.kind} of "{fault.component}": {size_mm:g} mm extends to the next contact, '
            f"{spacing_rad * radius_m / _MM:.3g} mm away; reduce the size."
        )
