"""Whether gears are integrated or rendered as their linear response: what that is, and that it keeps its floor."""

import numpy as np
import pytest
from declared_pair import PAIR, declared_pair
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from data_synth import Scene, SceneError, explain, load_scene, simulate
from data_synth.scene.gear_dynamics import Dynamics
from data_synth.simulation import noise_free

SIZE = {"face_width_mm": 30, "pressure_angle_deg": 20}
GEOMETRY = {"stage 1": {"module_mm": 3, **SIZE}, "stage 2": {"module_mm": 4, **SIZE}}
EVEN = {"shape": "constant", "error_um": 2.0}


def swinging(share):
    """Return a mesh whose stiffness swings by a share of its mean."""
    size = share * 4e8
    return {
        "shape": "fourier",
        "stiffness_n_m": 4e8,
        "harmonics_n_m": [[size, 0.0], [size / 2, size / 4]],
        "error_um": 2,
    }


def demo(mesh, *, fidelity="auto", floor_db=-40.0, **changes):
    meshes = {name: {**geometry, **mesh} for name, geometry in GEOMETRY.items()}
    dynamics = Dynamics.model_validate({"meshes": meshes, "floor_db": floor_db, "error": 1e-4})
    scene = load_scene("gears-in-motion").changed(faults=(), noise={"rms": 0}, excitation={"shaft_amplitude": 0})
    return scene.changed(fidelity=fidelity, dynamics=dynamics, **{"duration_s": 0.5, **changes})


def apart_db(scene):
    """Return by how much the record of a scene is apart from its motion in time, and its model."""
    record, wanted = simulate(scene, seed=1), noise_free(scene.changed(fidelity="dynamic"), seed=1).signal[0]
    apart = np.std(record[scene.sensors[0].name].values - wanted) / np.std(wanted)
    return 20 * np.log10(max(apart, 1e-15)), record.attrs["truth_fidelity"]


TORQUE_STEP = {"torque": {"link": "output", "steps": [[0, 300], [0.25, 450]]}}
WANDER = {"speed": {"link": "input", "rpm": 1500, "turbulence": {"rms": 45, "time_scale_s": 0.5}}, "duration_s": 1.0}
RAMP = {"speed": {"link": "input", "rpm": [[0, 900], [0.5, 1500]]}}


@pytest.mark.parametrize(
    ("mesh", "floor_db", "changes", "linear"),
    [
        (EVEN, -60.0, {}, True),
        (EVEN, -40.0, TORQUE_STEP, False),
        (EVEN, -25.0, WANDER, True),
        (EVEN, -25.0, RAMP, False),
        (swinging(0.02), -40.0, {}, True),
        (swinging(0.1), -30.0, {}, True),
        (swinging(0.1), -40.0, {}, True),
        (swinging(0.1), -60.0, {}, False),
        ({}, -40.0, {}, False),
    ],
)
def test_the_linear_response_is_taken_where_it_keeps_the_floor(mesh, floor_db, changes, linear):
    decibels, model = apart_db(demo(mesh, floor_db=floor_db, **changes))
    assert model.startswith("linear response" if linear else "dynamic")
    assert decibels < floor_db


def test_a_shipped_scene_with_a_damaged_tooth_is_integrated():
    scene = load_scene("gears-in-motion").changed(duration_s=0.3)
    auto, dynamic = (simulate(scene.changed(fidelity=fidelity), seed=1) for fidelity in ("auto", "dynamic"))
    sensor = scene.sensors[0].name
    assert auto[sensor].values.tobytes() == dynamic[sensor].values.tobytes()


def test_even_teeth_with_errors_are_lines_and_nothing_else():
    scene = demo(EVEN)
    record, integrated = simulate(scene, seed=1, by_source=True), simulate(scene.changed(fidelity="dynamic"), seed=1)
    assert record.attrs["truth_mesh_lines"] == "exact"
    assert list(record["truth_source_name"].values)[-2:] == ["stage 1, gear_mesh", "stage 2, gear_mesh"]
    assert_allclose(record["truth_source"].sum("truth_source_name")[0], record["input vertical"], atol=1e-12)
    orders = record["truth_order"].values[record["truth_kind"].values == "gear_mesh"]
    assert_allclose(orders, [19 * 23 / 67, 23])
    known, measured = (each["truth_amplitude"].sel(truth_order=orders).values[0, :, 0] for each in (record, integrated))
    assert_allclose(known, measured, atol=2e-3 * np.max(np.abs(known)))


def pair(*, mesh, **changes):
    dynamics = {**PAIR["dynamics"], "meshes": {"mesh": mesh}, "floor_db": -0.001}
    return Scene.from_mapping({**PAIR, "fidelity": "auto", "dynamics": dynamics, **changes})


def test_lines_of_a_swinging_stiffness_are_those_of_hills_determinant():
    """Stiffness that swings by a third, near resonance: all harmonics of the six equations in one direct solve."""
    module, teeth, angle = 4e-3, np.array([20, 40]), np.radians(20)
    base, mean, count = module * teeth * np.cos(angle) / 2, 8e7, 16
    g = np.array([np.sin(angle), np.cos(angle), base[0], -np.sin(angle), -np.cos(angle), base[1]])
    mass, spring = np.diag([5, 5, 0.01, 12, 12, 0.06]), np.diag([4e7, 4e7, 0, 6e7, 6e7, 0.0])
    squares, shapes = eigh(spring + mean * np.outer(g, g), mass)
    damping = mass @ (shapes * (2 * 0.05 * np.sqrt(np.maximum(squares, 0)))) @ shapes.T @ mass
    damping += 1e-5 * np.diag([4e7, 4e7, 0, 0, 0, 0])
    rpm = 30 / np.pi * np.sqrt(squares[squares > 1.0][-1]) / 20 * 0.97
    swing = [[0.3 * mean, 0.0], [0.1 * mean, 0.0]]
    mesh = {"shape": "fourier", "stiffness_n_m": mean, "harmonics_n_m": swing, "backlash_um": 0}
    scene = pair(mesh=mesh, rate_hz=100_000, speed={"link": "pinion", "rpm": rpm}, torque={"link": "wheel", "nm": 300})
    record = simulate(scene, seed=3)
    assert record.attrs["truth_fidelity"].startswith("linear response")
    # k = mean (1 + 0.3 cos + 0.1 cos 2): harmonics of the deflection multiply with those of the stiffness
    numbers, w = np.arange(-count, count + 1), 2 * np.pi * rpm / 60 * 20
    swings = {0: mean, 1: 0.15 * mean, -1: 0.15 * mean, 2: 0.05 * mean, -2: 0.05 * mean}
    whole = np.zeros((numbers.size, 6, numbers.size, 6), dtype=complex)
    for row, n in enumerate(numbers):
        whole[row, :, row] = spring + 1j * n * w * damping - (n * w) ** 2 * mass
        for shift, share in swings.items():
            if abs(n - shift) <= count:
                whole[row, :, row - shift] += share * np.outer(g, g)
    load = np.zeros((numbers.size, 6), dtype=complex)
    load[count] = 300 / base[1] * np.array([0, 0, base[0], 0, 0, base[1]])
    size = numbers.size * 6
    motion = np.linalg.lstsq(whole.reshape(size, size), load.ravel())[0].reshape(numbers.size, 6)
    for harmonic in (1, 2, 3):
        q, own_w, mounts = 2 * motion[count + harmonic], harmonic * w, 2 * np.pi * 150
        force = q[1] * (4e7 + 1j * own_w * 400) + 0.25 * q[4] * 6e7
        expected = force * -(own_w**2) / 15 / (mounts**2 - own_w**2 + 2j * 0.4 * mounts * own_w)
        found = record["truth_amplitude"].sel(truth_order=20 * harmonic).values[0]
        assert_allclose(np.abs(found), abs(expected), rtol=2e-3)  # of points to a period of the highest line


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"fault": [{"kind": "tooth_crack", "component": "mesh/pinion", "depth_mm": 1.0,
                     "growth": {"rate_mm_per_s": 1, "largest_mm": 2}}]}, 'the teeth of "mesh" change'),
        ({"gearbox": declared_pair(teeth=(23, 67)), "imperfections": {"gears": {"grade": 6}}},
         'the teeth of "mesh" repeat after 1541 cycles only'),
        ({"torque": {"link": "wheel", "nm": 0.1}}, "teeth lose contact"),
        ({"speed": {"link": "wheel", "run_up": {"inertia_kg_m2": 5, "rpm": 600}},
          "torque": {"link": "pinion", "nm": 10}}, "speed follows from torque"),
    ],
)  # fmt: skip
def test_what_has_no_linear_response_is_integrated(changes, why):
    scene = pair(mesh={"error_um": 3}, **changes)
    part = next(part for part in explain(scene).parts if part.name == "fidelity")
    assert part.why.startswith(f"dynamic: {why}")


def test_parametric_resonance_is_integrated():
    # at twice the highest natural frequency, 6457 rpm, of the equations above
    mesh = {"shape": "fourier", "stiffness_n_m": 8e7, "harmonics_n_m": [[3.2e7, 0.0]], "backlash_um": 0}
    scene = pair(mesh=mesh, rate_hz=100_000, speed={"link": "pinion", "rpm": 6457})
    scene = scene.changed(dynamics=scene.dynamics.changed(damping_ratio=0.001))
    part = next(part for part in explain(scene).parts if part.name == "fidelity")
    assert part.why.startswith('dynamic: the stiffness of "mesh" makes its vibration grow at 6457 rpm')


def test_what_is_inside_gears_of_a_linear_response_is_refused():
    with pytest.raises(SceneError, match=r'mechanics = True .* linear response; set fidelity = "dynamic"'):
        simulate(demo(EVEN, duration_s=0.1), seed=1, mechanics=True)


def test_explain_says_what_is_taken_and_why():
    told = next(part for part in explain(demo({})).parts if part.name == "fidelity")
    assert told.what.startswith("9 degrees of freedom")
    assert "lines of the linear response" in str(explain(demo(EVEN)))
    day = demo(EVEN, duration_s=86400.0, speed={"link": "input", "rpm": [[0, 1400], [86400, 1500]]})
    assert "lines of the linear response" in str(explain(day))  # as quick as ten seconds
