"""External torques on gears in motion, against closed forms."""

import numpy as np
from moving_pair import INERTIAS, motion, scene
from numpy.testing import assert_allclose


def torque_on(motion, body, times_s):
    load = motion.drive_load.load
    return (load.constant + load.varying_at(times_s))[:, motion.system.names.index(f"{body} rotation")]


def test_a_run_up_accelerates_the_inertia_of_its_machine():
    gears, machine, drag = INERTIAS[1] + 1.75**2 * INERTIAS[0], 0.5, 0.0075
    ready = motion(
        scene(
            duration_s=2.0,
            speed={"link": "gear", "run_up": {"inertia_kg_m2": gears + machine, "load_nm_s2": drag}},
            torque={"link": "pinion", "nm": 75},
        )
    )
    # J w' = T - c w^2 from rest: w' = T / J / cosh^2(t sqrt(T c) / J); the drag is apart, in load.quadratic_drag
    torque, whole, times_s = 75 * 1.75, gears + machine, np.linspace(0.01, 1.9, 1001)
    acceleration = torque / whole / np.cosh(np.sqrt(torque * drag) / whole * times_s) ** 2
    # the angle of a run-up is a polynomial, exact to 1e-8 of the speed
    assert_allclose(np.abs(torque_on(ready, "gear", times_s)), machine * acceleration, rtol=1e-5)


def test_a_torque_that_steps_is_the_mean_of_both_sides_there_and_exact_elsewhere():
    ready = motion(scene(torque={"link": "gear", "steps": [[0, 100], [0.1, 200]]}))
    # and where a block of times begins or ends with the step
    for times_s in ([0.05, 0.1 - 1e-6, 0.1, 0.1 + 1e-6, 0.2], [0.1, 0.15], [0.05, 0.1], [0.1]):
        expected = np.select([np.array(times_s) < 0.1, np.array(times_s) > 0.1], [100.0, 200.0], 150.0)
        assert_allclose(np.abs(torque_on(ready, "gear", np.array(times_s))), expected, rtol=1e-12)


def test_a_torque_that_rises_is_that_of_the_scene_at_every_time():
    # but for a nanosecond about each knot, whose sides are averaged: a slope of 500 N m/s is 5e-9 of 100 N m there
    ready = motion(scene(torque={"link": "gear", "nm": [[0, 100], [0.1, 140], [0.3, 40]]}))
    times_s = np.linspace(0, 0.3, 3001)
    expected = np.interp(times_s, [0, 0.1, 0.3], [100, 140, 40])
    assert_allclose(np.abs(torque_on(ready, "gear", times_s)), expected, rtol=1e-8)
