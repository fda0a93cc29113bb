"""Quantities inside a gearbox against statics, kinematics and the elastic law of a mesh."""

import numpy as np
import pytest
from moving_pair import ALPHA, BASE, SCENE, SEED, scene
from numpy.testing import assert_allclose

from data_synth import Scene, load_scene, simulate
from hums.records.validation import check_record

FORCE_N = 130 / BASE[1]  # the torque of the gear over its base radius


@pytest.fixture(scope="module")
def inside():
    declared = scene(mesh={"shape": "teeth", "error_um": 0})
    return simulate(declared, seed=SEED, mechanics=True)


def test_mean_forces_are_those_of_statics(inside):
    check_record(inside)
    # 0.3 s are 3 turns of the pinion; what drifts is the soft start, which has died to 1e-5
    assert_allclose(inside["truth_mesh_force"].values.mean(axis=1), FORCE_N, rtol=2e-3)
    pressed = inside["truth_bearing_force"]
    across = [-FORCE_N * np.sin(ALPHA), -FORCE_N * np.cos(ALPHA)]
    assert pressed["truth_support"].values.tolist() == ["pinion, y", "pinion, z", "gear, y", "gear, z"]
    assert_allclose(pressed.values.mean(axis=1), [*across, -across[0], -across[1]], rtol=2e-3)


@pytest.mark.parametrize("error_um", [0, 5])
def test_the_force_is_stiffness_times_what_teeth_deflect(inside, error_um):
    if error_um:
        declared = scene(mesh={"shape": "teeth", "error_um": error_um})
        inside = simulate(declared, seed=SEED, mechanics=True)
        assert inside["truth_tooth_error"].values.std() == pytest.approx(5e-6 / np.sqrt(2), rel=0.01)
    deflection = inside["truth_mesh_deflection"] - inside["truth_tooth_error"]
    expected = inside["truth_mesh_stiffness"] * deflection
    assert_allclose(inside["truth_mesh_force"].values, expected.values, rtol=1e-9, atol=1e-6)
    assert inside["truth_mesh_force"].attrs["units"] == "N"


def test_the_transmission_error_is_that_of_the_rotations(inside):
    # statics: both bearings of 1e8 N/m give way along the line of action by F / k
    further = inside["truth_transmission_error"] - inside["truth_mesh_deflection"]
    assert float(further.mean()) == pytest.approx(2 * FORCE_N / 1e8, rel=2e-3)


def test_planets_have_them_too():
    # a record of 0.1 s on supports that damp its start
    record = simulate(load_scene("planets-in-motion").changed(duration_s=0.1), seed=1, mechanics=True)
    forces = record["truth_mesh_force"]
    assert forces["truth_contact"].size == 6
    turned = {str(name): speed for name, speed in record["truth_link_speed"].mean("time").groupby("truth_link")}
    assert float(turned["carrier"].item() / turned["sun"].item()) == pytest.approx(20 / 102, rel=1e-3)
    # three planets share the torque of the carrier
    sun, ring = (forces.values.mean(axis=1)[part].sum() for part in (slice(3), slice(3, 6)))
    assert sun == pytest.approx(ring, rel=1e-3)


def test_links_turn_by_their_ratio_and_swing_about_it(inside):
    speeds = inside["truth_link_speed"]
    assert speeds.attrs["units"] == "rev s-1"
    assert_allclose(speeds.values.mean(axis=1), [10, -10 * 36 / 63], rtol=1e-6)
    assert np.all(speeds.values.std(axis=1) > 1e-4)


def test_the_record_itself_stays_as_it_is(inside):
    bare = simulate(Scene.from_mapping(inside_scene(inside)), seed=SEED)
    assert bare["a"].values.tobytes() == inside["a"].values.tobytes()


def inside_scene(record):
    import tomllib  # noqa: PLC0415

    return tomllib.loads(record.attrs["truth_scene"])


def test_a_run_up_turns_from_rest_with_the_rigid_law():
    run_up = {"link": "gear", "run_up": {"inertia_kg_m2": 0.4, "load_nm": 5.0}}
    made = simulate(scene(speed=run_up, torque={"link": "pinion", "nm": 40}), seed=SEED, mechanics=True)
    pinion = made["truth_link_speed"].sel(truth_link="pinion").values
    assert pinion[0] == 0
    rigid = np.interp(made["time"].values, made["truth_time"].values, made["truth_speed"].values)
    assert_allclose(pinion, rigid, atol=0.05 * rigid[-1])


def test_a_kinematic_scene_has_speeds_alone():
    table = {**SCENE, "fidelity": "kinematic", "speed": {"link": "pinion", "rpm": [[0, 600], [0.3, 1200]]}}
    made = simulate(Scene.from_mapping(table), seed=SEED, mechanics=True)
    speeds = made["truth_link_speed"].sel(truth_link="gear").values
    assert_allclose(speeds, -36 / 63 * (10 + 10 * made["time"].values / 0.3), rtol=1e-12)
    assert "truth_mesh_force" not in made
