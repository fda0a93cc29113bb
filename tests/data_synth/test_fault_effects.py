"""Every kind of fault in every fidelity: it is in the record, grows with its size, and stays under a physical limit.

The limits are those of the table in docs/scenes.md, "What bounds a fault", worked out here by hand.
"""

import math
from functools import cache, partial

import numpy as np
import pytest

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.gears.geometry import GearPair
from data_synth.gears.lost_contact import separation_m
from data_synth.scene.faults import FAULT_KINDS
from data_synth.scene.random_streams import random_stream
from data_synth.simulation import noise_free
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.mechanics import mechanics_truth
from data_synth.vibration.run import motion_of

RATE_HZ, RPM, NOISE_G, HOUSING_KG, G = 12_000, 1200, 1e-3, 20.0, 9.80665
TEETH, MODULE_M, FACE_M, ALPHA = (23, 40), 3e-3, 0.03, math.radians(20)
TORQUE_NM = 200.0
PAIR = GearPair(teeth=TEETH, module_m=MODULE_M, face_width_m=FACE_M, pressure_angle_rad=ALPHA)
FORCE_N = TORQUE_NM / PAIR.base_radii_m[1]
STIFFNESS_N_M = 20e9 * FACE_M  # 20 N/(mm um) of face, for steel gears (ISO 6336-1)
GEARBOX = {
    "name": "pair",
    "frame": "housing",
    "reference": "pinion",
    "axes": {"in": ["housing", "pinion"], "out": ["housing", "wheel"]},
    "mesh": [{"name": "mesh", "teeth": {"pinion": TEETH[0], "wheel": TEETH[1]}}],
    "bearing": [
        {
            "names": ["bearing"],
            "inner_ring": "pinion",
            "outer_ring": "housing",
            "elements": 9,
            "element_diameter_mm": 12.7,
            "pitch_diameter_mm": 60.5,
        }
    ],
}
EXCITATION = {"shaft_amplitude": 0.01, "mesh_amplitude": 0.3, "harmonics": 3, "decay": 0.5}
SCENE = {
    "gearbox": GEARBOX,
    "rate_hz": RATE_HZ,
    "duration_s": 0.15,
    "speed": {"link": "pinion", "rpm": RPM},
    "torque": {"link": "wheel", "nm": TORQUE_NM},
    "tachometer": {"link": "pinion", "pulses_per_rev": 12},
    "excitation": EXCITATION,
    "resonance": {"frequency_hz": 2500, "damping_ratio": 0.05},
    "noise": {"rms": NOISE_G},
    "dynamics": {
        "housing_kg": HOUSING_KG,
        "mounts": {"frequency_hz": 150, "damping_ratio": 0.5},
        "damping_ratio": 0.06,
        "error": 0.02,
        "meshes": {"mesh": {"module_mm": 1e3 * MODULE_M, "face_width_mm": 1e3 * FACE_M, "pressure_angle_deg": 20}},
    },
    "sensor": [{"name": "a", "on": "bearing", "direction": [0, 0, 1], "units": "g"}],
}
GEAR_SIZES = {  # mm
    "tooth_crack": (1.0, 4.0),
    "chipping": (3.0, 29.0),
    "missing_tooth": (1.0, 7.0),
    "spall": (0.001, 2.0),
    "pitting": (0.001, 2.0),
    "eccentricity": (0.15, 0.5),
    "misalignment": (3.0, 29.0),
    "wear": (0.003, 0.2),
}
SHAFT = dict.fromkeys(("imbalance", "bent_shaft", "shaft_misalignment"), (0.02, 0.5))
BEARING = dict.fromkeys(("inner_race", "outer_race", "rolling_element", "cage"), (0.2, 2.0))
SIZES = GEAR_SIZES | SHAFT | BEARING
# what shafts and bearings add goes past the motion of gears: one of each beside it, and all where none moves
GRID = [("dynamic", kind) for kind in (*GEAR_SIZES, "bent_shaft", "outer_race")] + [
    ("kinematic", kind) for kind in SHAFT | BEARING
]


def fault(kind, size_mm, **keys):
    size = {"depth_mm" if kind == "tooth_crack" else "size_mm": size_mm}
    component = "mesh/pinion" if kind in GEAR_SIZES else "pinion" if kind in SHAFT else "bearing"
    return {"kind": kind, "component": component, **size, **keys}


@cache
def record(fidelity, kind=None, size_mm=0.0, rpm=RPM):
    faults = [] if kind is None else [fault(kind, size_mm)]
    turning = {"speed": {"link": "pinion", "rpm": rpm}, "rate_hz": RATE_HZ * rpm / RPM}
    made = Scene.from_mapping({**SCENE, "fidelity": fidelity, "fault": faults, **turning})
    return noise_free(made, seed=1).signal[0]


def added(fidelity, kind, size_mm, rpm=RPM):
    """Faulty minus healthy, in g, before noise."""
    return record(fidelity, kind, size_mm, rpm) - record(fidelity, rpm=rpm)


def sunk_m(kind, size_m):
    """How far the mesh can sink in at most."""
    middle = (PAIR.contact_ratio - 1) / 2
    off = max(float(separation_m(PAIR, 1 - PAIR.contact_ratio / 2, leaving=side)) for side in (True, False))
    assert 1 - PAIR.contact_ratio / 2 < middle
    neighbour = off + FORCE_N / (STIFFNESS_N_M / 2)
    on_path = PAIR.contact_ratio / 2 * PAIR.base_pitch_m + PAIR.path_m[0]
    other = PAIR.centre_distance_m * math.sin(ALPHA) - on_path
    length = 0.3 * PAIR.base_pitch_m * on_path / PAIR.base_radii_m[0]
    sag = length**2 / 8 * (1 / on_path + 1 / other)
    return {"spall": min(size_m, sag, neighbour), "pitting": min(size_m, sag, neighbour)}.get(
        kind, size_m if kind in {"wear", "eccentricity"} else neighbour
    )


def limit_g(kind, size_mm):
    if kind in SHAFT:
        return 1.6 * size_mm  # all its harmonics in phase: 1 + 1/2
    if kind in BEARING:
        return 2 * size_mm  # as declared; two that ring at once
    # a mass under a constant force that falls onto its spring (Timoshenko, Strength of Materials: the impact factor)
    factor = 1 + math.sqrt(1 + 2 * sunk_m(kind, 1e-3 * size_mm) * STIFFNESS_N_M / FORCE_N)
    return factor * FORCE_N / HOUSING_KG / G  # on the rigid housing


def test_the_table_has_every_kind():
    assert set(SIZES) == set(FAULT_KINDS)


@pytest.mark.parametrize(("fidelity", "kind"), GRID)
def test_a_fault_is_in_the_record_grows_and_stays_under_its_limit(fidelity, kind):
    small, large = (added(fidelity, kind, size) for size in SIZES[kind])
    assert np.std(small) > NOISE_G
    assert np.std(large) > 1.5 * np.std(small)
    for part, size in zip((small, large), SIZES[kind], strict=True):
        assert np.max(np.abs(part)) < limit_g(kind, size)


# at 3600 rpm a mode of the mesh takes the teeth apart behind the gap of the missing one
@pytest.mark.parametrize(("kind", "rpm"), [*((kind, RPM) for kind in GEAR_SIZES), ("missing_tooth", 3600)])
def test_a_kinematic_fault_is_as_loud_beside_its_mesh_as_in_motion(kind, rpm):
    for size in GEAR_SIZES[kind]:
        motion, kinematic = (
            np.std(added(each, kind, size, rpm)) / np.std(record(each, rpm=rpm)) for each in ("dynamic", "kinematic")
        )
        assert abs(20 * math.log10(kinematic / motion)) < 1


def test_a_spall_is_louder_the_wider_and_longer_it_is():
    def of(**keys):
        faults = [fault("spall", 0.5, **keys)]
        return noise_free(Scene.from_mapping({**SCENE, "fidelity": "dynamic", "fault": faults}), seed=1).signal[0]

    # 4 % of the flank, or a width of as much; across the face the teeth fall into it
    assert np.array_equal(of(), of(width_mm=0.04 * PAIR.contact_ratio / 0.3 * 1e3 * FACE_M))
    narrow, wide, short, long = (
        np.std(of(**keys) - record("dynamic"))
        for keys in (
            {},
            {"width_mm": 30},
            {"width_mm": 30, "length_pitches": 0.05},
            {"width_mm": 30, "length_pitches": 0.9},
        )
    )
    assert narrow < 0.5 * wide
    assert long > 3 * short


def test_a_tooth_without_its_face_is_a_missing_one():
    gone, faceless = added("dynamic", "missing_tooth", 7.0), added("dynamic", "chipping", 29.9999)
    assert np.std(gone - faceless) < 0.01 * np.std(gone)


@pytest.mark.parametrize("kind", ["chipping", "misalignment"])
@pytest.mark.parametrize("shape", [None, "trapezoid"])
def test_a_face_width_that_nobody_declares_is_asked_for(kind, shape):
    gearbox = {**GEARBOX, "mesh": [{**GEARBOX["mesh"][0], "module_mm": 3, "pressure_angle_deg": 20}]}
    keys = {"stiffness_n_m": 3e8, "shape": shape} if shape else {}
    dynamics = {**SCENE["dynamics"], "meshes": {"mesh": keys}}
    scene = {**SCENE, "gearbox": gearbox, "dynamics": dynamics, "fidelity": "dynamic", "fault": [fault(kind, 1.0)]}
    with pytest.raises(SceneError, match="face_width_mm"):
        simulate(Scene.from_mapping(scene), seed=1)


@pytest.mark.parametrize("fidelity", ["kinematic", "dynamic"])
def test_a_size_that_a_tooth_does_not_have_is_refused(fidelity):
    for kind, size, words in (
        ("spall", 3.0, "half the thickness of its tooth, 2.35619 mm"),
        ("wear", 1.2, "a quarter of the thickness of its tooth, 1.1781 mm"),
        ("eccentricity", 0.8, "the bottom clearance, 0.75 mm"),
        ("chipping", 31.0, "the face width of 30 mm"),
        ("tooth_crack", 12.0, "the root of its tooth, 10.5"),
    ):
        scene = Scene.from_mapping({**SCENE, "fidelity": fidelity, "fault": [fault(kind, size)]})
        with pytest.raises(SceneError, match=f'fault 1, {kind} of "mesh/pinion": {size:g} mm exceeds {words}'):
            simulate(scene, seed=1)


def test_a_crack_through_its_tooth_is_refused_by_its_name():
    scene = Scene.from_mapping({**SCENE, "fidelity": "dynamic", "fault": [fault("tooth_crack", 10.0)]})
    with pytest.raises(
        SceneError, match='fault 1, tooth_crack of mesh "mesh": a crack of 10 mm at 45 degrees leaves nothing of'
    ):
        simulate(scene, seed=1)


@pytest.mark.parametrize(("kind", "most"), [("inner_race", 16.7), ("rolling_element", 19.9), ("cage", 21.1)])
def test_a_bearing_fault_ends_before_the_next_contact(kind, most):
    short, long = (
        Scene.from_mapping({**SCENE, "fidelity": "kinematic", "fault": [fault(kind, most + off)]})
        for off in (-0.1, 0.1)
    )
    assert simulate(short, seed=1)["a"].size
    with pytest.raises(SceneError, match=f'{kind} of "bearing": {most + 0.1:g} mm extends to the next contact'):
        simulate(long, seed=1)


# ---- the scenes that come with the package: mesh forces -----------------------------------------------------------


SHIPPED = {"gears-in-motion": "stage 1/pinion", "planets-in-motion": "sun-planet/sun"}
SCENES_LOAD = {"gears-in-motion": ("output", 450.0), "planets-in-motion": ("carrier", 600.0)}  # N m, theirs
WORST = {  # mm: as far as a tooth of module 3 mm and 30 mm face goes
    "tooth_crack": 8.0,
    "chipping": 29.9,
    "missing_tooth": 7.0,
    "spall": 2.3,
    "pitting": 2.3,
    "eccentricity": 0.3,
    "misalignment": 29.0,
    "wear": 0.5,
}


def damaged(name, kind, *, share_of_load=1.0, **changes):
    """Return a shipped scene with a fault."""
    table = load_scene(name).model_dump(mode="json", by_alias=True, exclude_none=True)
    size = {"depth_mm" if kind == "tooth_crack" else "size_mm": WORST[kind]}
    table |= {"fault": [{"kind": kind, "component": SHIPPED[name], **size}], "duration_s": 0.12, "noise": {"rms": 0}}
    table["torque"] = {"link": SCENES_LOAD[name][0], "nm": SCENES_LOAD[name][1] * share_of_load}
    return Scene.from_mapping(table | changes)


def moved(name, kind, **changes):
    """Return the mesh forces of a damaged shipped scene, the swing of its errors and the mean stiffness."""
    made = damaged(name, kind, **changes)
    stage = prepare_scene(made, rng_for=partial(random_stream, 1))
    found, mesh = mechanics_truth(motion_of(stage)), SHIPPED[name].partition("/")[0]
    forces, errors, stiffness = (
        of_meshes.values[[str(contact).startswith(mesh) for contact in of_meshes["truth_contact"].values]]
        for of_meshes in (found[f"truth_{what}"] for what in ("mesh_force", "tooth_error", "mesh_stiffness"))
    )
    return forces, np.ptp(errors), stiffness.mean()


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("gears-in-motion", kind) for kind in WORST),
        *(("planets-in-motion", kind) for kind in ("missing_tooth", "spall")),
    ],
)
def test_no_fault_lets_teeth_of_a_shipped_scene_pull_or_press_beyond_its_limit(name, kind):
    forces, sunk, stiffness = moved(name, kind)
    static = forces.mean()
    softest = static / (stiffness / 4)  # a tooth whose neighbours carry, at a quarter of the mesh's stiffness
    assert forces.max() < static * (1 + math.sqrt(1 + 2 * (sunk + softest) * stiffness / static))
    # teeth push: what swings through the play may touch the back flanks, and never pulls as hard as it pushes
    assert forces.min() > -0.7 * forces.max()


@pytest.mark.parametrize("kind", ["tooth_crack", "pitting", "misalignment"])
def test_a_fault_of_one_tooth_fades_with_the_load(kind):
    loud, quiet = (moved("gears-in-motion", kind, share_of_load=share)[0].std() for share in (1.0, 0.01))
    assert quiet < 0.25 * loud  # where nothing presses teeth together, nothing falls into the gap


def test_a_deep_crack_tends_to_a_missing_tooth():
    gone, cracked = (
        noise_free(damaged("gears-in-motion", kind), seed=1).signal[0] for kind in ("missing_tooth", "tooth_crack")
    )
    assert np.std(cracked - gone) < 0.05 * np.std(gone)
