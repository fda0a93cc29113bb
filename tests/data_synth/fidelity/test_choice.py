"""Which motions are simulated, per stage and chosen."""

from functools import cache, partial

import numpy as np
import pytest
from declared_pair import declared_pair
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from data_synth import Scene, SceneError, explain, load_scene, simulate
from data_synth.fidelity.choice import chosen, decided, forget, simulated_motion
from data_synth.scene.gear_dynamics import Dynamics
from data_synth.scene.random_streams import random_stream
from data_synth.simulation import noise_free
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.run import prepare_gears

GEOMETRY = {
    "stage 1": {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20},
    "stage 2": {"module_mm": 4, "face_width_mm": 40, "pressure_angle_deg": 20},
}
# stiff to what gears do, 170 times a mesh; so heavily damped that it matters little how far resonances still move
HELD = {"radial_n_m": 1e11, "axial_n_m": 1e11, "tilt_nm_rad": 1e8}
STIFF = {"input bearing": HELD, "intermediate bearing": HELD, "output": HELD}
SMOOTH = {"stage 1": {"shape": "trapezoid"}, "stage 2": {"shape": "trapezoid"}}
EVEN = {name: {"shape": "constant", "error_um": 2.0} for name in GEOMETRY}
QUIET = {"stage 2": {"shape": "constant", "error_um": 1e-6}}
DEMO = load_scene("gears-in-motion").changed(duration_s=0.5, faults=())


def demo(fidelity="auto", *, meshes=None, **dynamics):
    geometry = {name: {**GEOMETRY[name], **(meshes or {}).get(name, {})} for name in GEOMETRY}
    table = Dynamics.model_validate({"meshes": geometry, "decide_s": 0.1, **dynamics})
    return DEMO.changed(fidelity=fidelity, dynamics=table)


def ready(scene):
    stage = prepare_scene(scene, rng_for=partial(random_stream, 1))
    return stage, prepare_gears(stage)


@cache
def choice_of(scene):
    stage, gears = ready(scene)
    choice = chosen(stage, gears)
    return choice, simulated_motion(stage, gears, choice.levels)


def record_of(scene, **also):
    return simulate(scene.changed(noise=scene.noise.changed(rms=0.0)), seed=1, **also)


@cache
def channel(scene):
    """Samples of the one channel of a scene, to be read only."""
    return noise_free(scene, seed=1).signal[0]


def apart_db(found, wanted):
    return 20 * np.log10(np.std(found - wanted) / np.std(wanted))


def heard_low(scene):
    return scene.changed(path={"frequency_hz": 1500, "damping_ratio": 0.7})


# ---- what is chosen -----------------------------------------------------------------------------------------


def test_bearings_that_give_need_motions_in_the_plane():
    choice, motion = choice_of(demo())
    assert set(choice.levels.values()) == {"lateral"}
    assert motion.system.dof == 9
    kinematic, lateral = choice.tried
    assert kinematic.decibels > -40
    # spur gears between their bearings neither tilt nor move along: there is nothing to run
    assert lateral.decibels < -150
    assert not kinematic.run
    assert not lateral.run


def test_what_is_chosen_is_within_the_floor_of_the_full_motion():
    wanted = channel(demo("full"))
    # the piece that decides is the first fifth; the rest of a steady scene is like it
    assert apart_db(channel(demo()), wanted) < -40
    assert apart_db(channel(demo("torsional")), wanted) > -40


@pytest.mark.slow
def test_what_linear_responses_tell_without_a_run_is_so():
    # kinematic lines are 10 dB beyond the floor for sure, for they are in a run as well
    choice, _ = choice_of(demo())
    kinematic = {"stage 1": {"fidelity": "kinematic"}, "stage 2": {"fidelity": "kinematic"}}
    assert choice.tried[0].decibels > -30
    assert apart_db(channel(demo("full", meshes=kinematic)), channel(demo("full"))) > -30


@pytest.mark.parametrize(
    ("changes", "floor_db", "low"),
    [
        ({"meshes": QUIET}, -12.0, False),
        ({"meshes": {"stage 2": {"shape": "constant", "error_um": 5.0}}}, -25.0, True),
        ({"meshes": SMOOTH, "bearings": STIFF, "damping_ratio": 0.3}, -20.0, True),
        ({"meshes": {"stage 1": {"backlash_um": 40}}}, -40.0, False),
    ],
)
@pytest.mark.slow
def test_every_choice_is_within_its_floor(changes, floor_db, low):
    place = heard_low if low else lambda scene: scene
    auto, full = (place(demo(fidelity, floor_db=floor_db, **changes)) for fidelity in ("auto", "full"))
    # 1 dB: the floor holds on the first fifth, and errors of steps, -60 dB, come on top
    assert apart_db(channel(auto), channel(full)) < floor_db + 1


def test_a_shipped_scene_with_a_damaged_tooth_is_within_its_floor():
    scene = load_scene("gears-in-motion").changed(duration_s=0.3)
    assert apart_db(channel(scene.changed(fidelity="auto")), channel(scene.changed(fidelity="full"))) < -40


def test_what_was_found_before_changes_no_byte():
    scene = demo(meshes=EVEN).changed(duration_s=0.1)
    forget()
    one = simulate(scene, seed=5)
    simulate(demo(meshes=QUIET).changed(duration_s=0.1), seed=6)
    assert simulate(scene, seed=5).identical(one)
    forget()
    simulate(scene, seed=7)  # what is found has nothing to do with the seed
    assert simulate(scene, seed=5).identical(one)
    louder = scene.changed(noise=scene.noise.changed(rms=3.0))
    assert decided(louder) is decided(scene)
    assert decided(scene.changed(speed={"link": "input", "rpm": 1400})) is not decided(scene)


# ---- kinematic stages ---------------------------------------------------------------------------------------


def test_even_teeth_with_errors_are_lines_and_nothing_else():
    choice, motion = choice_of(demo(meshes=EVEN))
    assert (choice.name, motion) == ("kinematic", None)
    assert choice.decibels < -150
    record, full = record_of(demo(meshes=EVEN), by_source=True), record_of(demo("full", meshes=EVEN))
    # steps of the full motion may err by 1e-3
    assert apart_db(record["input vertical"].values, full["input vertical"].values) < -57
    assert record.attrs["truth_mesh_lines"] == "exact"
    assert list(record["truth_source_name"].values)[-2:] == ["stage 1, gear_mesh", "stage 2, gear_mesh"]
    assert_allclose(record["truth_source"].sum("truth_source_name")[0], record["input vertical"], atol=1e-12)
    orders = record["truth_order"].values[record["truth_kind"].values == "gear_mesh"]
    assert_allclose(orders, [19 * 23 / 67, 23])
    known, measured = (r["truth_amplitude"].sel(truth_order=orders).values[0, :, 0] for r in (record, full))
    assert_allclose(known, measured, atol=2e-3 * np.max(np.abs(known)))


def test_lines_of_a_pair_are_those_of_its_receptance():
    """One error harmonic on springs: the bearing's force from a direct solve of all six equations."""
    module, teeth, angle = 4e-3, np.array([20, 40]), np.radians(20)
    base = module * teeth * np.cos(angle) / 2
    g = np.array([np.sin(angle), np.cos(angle), base[0], -np.sin(angle), -np.cos(angle), base[1]])
    mass, spring = np.diag([5, 5, 0.01, 12, 12, 0.06]), np.diag([4e7, 4e7, 0, 6e7, 6e7, 0.0])
    stiffness = spring + 8e7 * np.outer(g, g)
    squares, shapes = eigh(stiffness, mass)
    damping = mass @ (shapes * (2 * 0.05 * np.sqrt(np.maximum(squares, 0)))) @ shapes.T @ mass
    damping += 1e-5 * np.diag([4e7, 4e7, 0, 0, 0, 0])
    scene = pair("lateral", meshes={"mesh": {**PAIR_MESH, "fidelity": "kinematic"}})
    record = simulate(scene, seed=3)
    w = 2 * np.pi * 10 * 20
    q = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, g * 8e7 * 3e-6)
    force = q[1] * (4e7 + 1j * w * 400) + 0.25 * q[4] * 6e7
    mounts = 2 * np.pi * 150
    expected = force * -(w**2) / 15 / (mounts**2 - w**2 + 2j * 0.4 * mounts * w)
    found = record["truth_amplitude"].sel(truth_order=20).values[0]
    assert_allclose(np.abs(found), abs(expected), rtol=1e-9)
    spectrum = np.fft.rfft(record["a"].values) * 2 / 4000
    assert_allclose(np.abs(spectrum[40]), abs(expected), rtol=1e-9)
    assert np.max(np.abs(np.delete(spectrum, 40))) < 1e-9 * abs(expected)


PAIR_MESH = {"shape": "constant", "stiffness_n_m": 8e7, "error_um": 3}


def pair(fidelity, *, meshes, **changes):
    table = {
        "gearbox": declared_pair(),
        "rate_hz": 20_000,
        "duration_s": 0.2,
        "fidelity": fidelity,
        "speed": {"link": "pinion", "rpm": 600},
        "torque": {"link": "wheel", "nm": 300},
        "tachometer": {"link": "pinion", "pulses_per_rev": 12},
        "excitation": {"shaft_amplitude": 0},
        "noise": {"rms": 0},
        "dynamics": {
            "links": {
                "pinion": {"mass_kg": 5, "inertia_kg_m2": 0.01},
                "wheel": {"mass_kg": 12, "inertia_kg_m2": 0.06},
            },
            "meshes": meshes,
            "bearings": {"pinion": {"radial_n_m": 4e7, "damping_s": 1e-5}, "wheel": {"radial_n_m": 6e7}},
            "damping_ratio": 0.05,
            "housing_kg": 15,
            "mounts": {"frequency_hz": 150, "damping_ratio": 0.4},
            "elsewhere": 0.25,
            "rigid_below_hz": 1e-6,  # weights act at every frequency
        },
        "sensor": [{"name": "a", "on": "pinion", "direction": [0, 0, 1], "units": "m s-2"}],
    }
    return Scene.from_mapping(table | changes)


def test_lines_follow_speed_and_torque():
    meshes = {"mesh": {**PAIR_MESH, "shape": "trapezoid", "error_um": 0, "fidelity": "kinematic"}}
    low, high = (
        simulate(pair("lateral", meshes=meshes, torque={"link": "wheel", "nm": nm}), seed=3) for nm in (100, 200)
    )
    # without errors all of it goes with the torque
    assert_allclose(high["a"], 2 * low["a"], rtol=1e-9, atol=1e-12)
    slow, fast, both = (
        simulate(pair("lateral", meshes=meshes, speed={"link": "pinion", "rpm": rpm}), seed=3)["truth_amplitude"]
        for rpm in (600, 900, [[0, 600], [0.01, 600], [0.19, 900], [0.2, 900]])
    )
    assert_allclose(both.sel(truth_order=40).values[0, 0], slow.sel(truth_order=40).values[0, 0], rtol=1e-9)
    assert_allclose(both.sel(truth_order=40).values[0, -1], fast.sel(truth_order=40).values[0, -1], rtol=1e-9)


def test_a_damaged_tooth_puts_lines_a_turn_apart():
    crack = {"kind": "tooth_crack", "component": "mesh/pinion", "depth_mm": 2.0}
    record = simulate(pair("lateral", meshes={"mesh": {"fidelity": "kinematic"}}, fault=[crack]), seed=3)
    kinds, orders = record["truth_kind"].values, record["truth_order"].values
    assert set(orders[kinds == "gear_mesh"] % 20) == {0.0}
    between = set(range(100, 300)) - set(range(100, 300, 20))
    assert len(between - set(orders[kinds == "tooth"])) < 0.05 * len(between)  # some are 100 dB below the largest
    assert set(record["truth_component"].values[kinds == "tooth"]) == {"mesh/pinion"}
    assert "truth_tooth_passes_1" in record


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (
            {"kind": "tooth_crack", "depth_mm": 1.0, "growth": {"law": "linear", "rate_mm_per_s": 1, "largest_mm": 2}},
            "its teeth change with time, so it has no linear response",
        ),
    ],
)
def test_what_has_no_lines_is_refused_and_never_chosen(fault, sentence):
    faults = [{"component": "mesh/pinion", **fault}]
    with pytest.raises(SceneError, match=sentence):
        simulate(pair("lateral", meshes={"mesh": {"fidelity": "kinematic"}}, fault=faults), seed=3)
    choice, _ = choice_of(pair("auto", meshes={"mesh": {}}, fault=faults))
    assert choice.tried[0].decibels == np.inf
    assert "kinematic" not in choice.levels.values()


def test_a_kinematic_stage_beside_one_in_motion():
    mixed = demo("lateral", meshes={**QUIET, "stage 1": {}, "stage 2": {**EVEN["stage 2"], "fidelity": "kinematic"}})
    choice, motion = choice_of(mixed)
    assert choice.name == "stage 1 lateral, stage 2 kinematic"
    assert [mesh.error for mesh in motion.system.meshes] == [None, None]
    assert "output x" not in motion.system.names
    record = record_of(mixed, by_source=True)
    assert list(record["truth_source_name"].values)[-2:] == ["stage 2, gear_mesh", "gears, motion"]
    assert_allclose(record["truth_source"].sum("truth_source_name")[0], record["input vertical"], atol=1e-12)


# ---- stages apart ----------------------------------------------------------------------------------------------------


def test_each_stage_may_have_its_own_fidelity():
    choice, motion = choice_of(demo("lateral", meshes={"stage 2": {"fidelity": "torsional"}}))
    assert choice.name == "stage 1 lateral, stage 2 torsional"
    moving = [name for name in motion.system.names if not name.endswith("rotation")]
    assert moving == ["input x", "input y", "intermediate x", "intermediate y"]
    mixed, lateral, torsional = (
        channel(
            heard_low(
                demo(
                    fidelity,
                    meshes={name: {**SMOOTH[name], **(own or {}).get(name, {})} for name in SMOOTH},
                    bearings={**STIFF, "input bearing": {"radial_n_m": 3e8}},
                    damping_ratio=0.3,
                    # forces of the second stage would cancel out, and leave only what differs
                    sensor_weights=({"sensor": "input vertical", "links": {"intermediate": 0.3, "output": 0}},),
                ).changed(duration_s=0.1)
            )
        )
        for fidelity, own in (
            ("lateral", {"stage 2": {"fidelity": "torsional"}}),
            ("lateral", None),
            ("torsional", None),
        )
    )
    # what is not simulated follows by linear equations: only the change of stiffness times its motion is missing
    assert np.std(mixed - lateral) < 0.04 * np.std(lateral)
    assert np.std(torsional - lateral) < 0.04 * np.std(lateral)


def test_a_stage_has_no_more_than_its_scene():
    with pytest.raises(SceneError, match='"stage 1" has fidelity = "full", more than the scene\'s "lateral"'):
        choice_of(demo("lateral", meshes={"stage 1": {"fidelity": "full"}}))


@pytest.mark.slow
def test_explain_and_the_record_say_what_was_chosen_and_why():
    told = explain(demo())
    part = next(part for part in told.parts if part.name == "fidelity")
    assert part.what.startswith("9 degrees of freedom")
    assert part.why.startswith("lateral: within -40 dB of full, nothing is lost (from full: kinematic about ")
    assert "lateral, as declared" in str(explain(demo("lateral")))
    assert "lines of the linear response" in str(explain(demo(meshes=EVEN)))


def test_explaining_a_day_is_as_quick_as_ten_seconds():
    day = demo(meshes=EVEN).changed(duration_s=86400.0, speed={"link": "input", "rpm": [[0, 1400], [86400, 1500]]})
    part = next(part for part in explain(day).parts if part.name == "stage 1" and part.what == "lines")
    assert part.why == "amplitudes of the linear response at each speed"
