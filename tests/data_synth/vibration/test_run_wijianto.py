"""The scene of Wijianto's gear pair: the paper's frequencies and start-up, and with play teeth that part."""

from dataclasses import replace

import numpy as np
import pytest
from moving_pair import BASE, motion
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.dynamics.modes import solve_modes
from data_synth.integrators.driver import integrate
from data_synth.integrators.problem import Output

SCENE = load_scene("wijianto")


def with_mesh(mesh, **changes):
    meshes = (("mesh", SCENE.dynamics.mesh("mesh").changed(**mesh)),)
    return SCENE.changed(dynamics=SCENE.dynamics.changed(meshes=meshes, **changes))


def in_motion(scene, seed=1):
    """Return times, q = r1 theta1 - r2 theta2 and the gear's speed over the whole scene."""
    rows, speeds = np.zeros((2, 2, 6))
    rows[0, [2, 5]], speeds[1, 5] = BASE, -1.0
    found = integrate(
        motion(scene, seed).problem(0.0, scene.duration_s),
        output=Output(rate_hz=20_000, displacement=rows, velocity=speeds),
        steps=2,
    )
    return found.times_s, *found.values.T


def test_its_frequencies_are_the_paper_s():
    modes = solve_modes(motion(SCENE).system)
    # two of the six modes are across the line of action, and no torque moves them
    pressed = np.abs(np.array([mesh.direction for mesh in motion(SCENE).system.meshes]) @ modes.shapes)[0]
    along = (pressed > 1e-6 * pressed.max()) | (modes.angular == 0)
    assert_allclose(modes.frequencies_hz[along], [0, 110.17, 392.65, 687.01], atol=5.1e-3)
    # the scene's nine digits, half of them in a frequency
    assert_allclose(modes.angular[along], [0, 692.22774872, 2467.11467008, 4316.6385243], rtol=2e-9)


def test_it_starts_as_published():
    constant = with_mesh({"shape": "constant", "step_n_m": None, "contact_ratio": None})
    times_s, q, speed = in_motion(constant)
    # digits as known; of second order in steps of 25 us
    assert speed[-1] == pytest.approx(132.272702, abs=1e-5)
    assert np.max(q) == pytest.approx(1.8422e-3, abs=5e-8)
    assert times_s[np.argmax(q)] == pytest.approx(0.1407, abs=5e-5)
    # the record says the same: its error is that of the rotations
    stated = simulate(constant, seed=2, mechanics=True)["truth_transmission_error"].values[0]
    assert_allclose(stated, q[: stated.size], atol=1e-7)


def test_its_teeth_follow_the_time():
    # exact, by matrix exponentials: with a load 131.25 / w_inf w, after 100 periods of 8334 rad/s
    q, velocity, speed = 1.311545438764e-3, -2.275943771227e-3, 53.56034784742
    problem = motion(SCENE).problem(0.0, 100 * 2 * np.pi / 8334)
    system, load = problem.system, replace(problem.load, quadratic_drag=None)
    damping = system.damping.copy()
    damping[5, 5] += 131.25 / 132.28756555
    rows, velocities = np.zeros((2, 3, 6))
    rows[0, [2, 5]] = BASE
    velocities[1, 3:5], velocities[2, 5] = [-0.342020143, -0.939692621], -1.0  # along the paper's x
    output = Output(rate_hz=15 * 8334 / (2 * np.pi), displacement=rows, velocity=velocities)
    damped = replace(problem, system=replace(system, damping=damping), load=load)
    found = integrate(damped, output=output, steps=20).values[-1]
    assert_allclose(found, [q, velocity, speed], rtol=1e-6)  # the scene has nine digits


def test_with_play_it_starts_through_the_tongue_and_settles():
    tied = with_mesh({"backlash_um": 100.0}, mesh_rpm=None, damping_ratio=1e-3)
    times_s, q, speed = in_motion(tied)
    # the rigid law of the start: w_inf tanh(t / tau), about which the teeth ripple
    rigid = 132.28756555 * np.tanh(times_s / 0.141026)
    assert_allclose(speed[times_s > 1.5], rigid[times_s > 1.5], rtol=2e-3)
    # at the end: the periodic state's mean, and half the backlash; the ripple left over averages out
    last = times_s > 1.9
    assert np.mean(q[last]) == pytest.approx(1.1868201e-3 + 50e-6, rel=2e-3)
    # the mesh passes 2 x 692 rad/s, 22 rad/s of the gear, at 0.024 s: where teeth stand then decides whether they part
    assert np.interp(2 * 692.2277 / 63, speed, times_s) == pytest.approx(0.024, abs=0.003)
    crossing = (times_s > 0.01) & (times_s < 0.04)
    other = in_motion(tied.changed(duration_s=0.1), seed=3)[1]
    assert np.min(q[crossing]) < -50e-6  # on their back flanks
    assert np.min(other[crossing[: other.size]]) > 50e-6  # in contact throughout


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fault": [{"kind": "wear", "component": "mesh/gear", "size_mm": 0.1}]}, "mesh_rpm: .* leave one of them out"),
        ({"speed": {"link": "gear", "rpm": 100}, "load_on": "gear"}, "damping_ratio = 0: .* start the gears"),
    ],
)
def test_what_it_cannot_have_is_refused(changes, words):
    table = SCENE.model_dump(mode="json", by_alias=True, exclude_none=True)
    if load_on := changes.pop("load_on", None):
        table["dynamics"]["load_on"] = load_on
    with pytest.raises(SceneError, match=words):
        simulate(Scene.from_mapping(table | changes), seed=1)
