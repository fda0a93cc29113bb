import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import airy

from data_synth.operation.piecewise import PiecewiseLinear
from data_synth.operation.run_up import run_up
from data_synth.scene.operation import RunUp

# a gear pair: 75 N m on the pinion, 0.0075 w |w| on the gear, all taken to the gear's shaft (36 / 63 teeth)
RATIO = 1.75
INERTIA = 0.10547808100593123 + 0.011246309345072218 * RATIO**2
FAN = RunUp(inertia_kg_m2=INERTIA, load_nm_s2=0.0075)


def constant(value):
    return PiecewiseLinear(times_s=np.zeros(1), values=np.array([value]))


def test_the_angle_comes_back_as_time():
    angle = run_up(constant(75 * RATIO), FAN, duration_s=2.0)
    times = np.linspace(0.001, 2, 100)
    assert_allclose(angle.times(angle.revolutions(times)), times, rtol=1e-12)
    assert angle.top_speed_hz(0, 2) == pytest.approx(132.28756555 / 2 / np.pi * np.tanh(2 / 0.141026))
    assert_allclose(angle.scaled(RATIO).speed_hz(1.0), RATIO * angle.speed_hz(1.0), rtol=1e-14)
    with pytest.raises(ValueError, match="lengthen it"):
        angle.times(1e3)


def test_a_linear_load_lags():
    # J w' + c w = T: tau = J / c
    angle = run_up(constant(6.0), RunUp(inertia_kg_m2=0.5, load_nm_s=2.0, rpm=60.0), duration_s=3.0)
    times = np.linspace(0, 3, 50)
    decay = np.exp(-4 * times)
    speed = 3 + (2 * np.pi - 3) * decay
    turned = 3 * times + (2 * np.pi - 3) * (1 - decay) / 4
    assert_allclose(2 * np.pi * angle.speed_hz(times), speed, rtol=1e-12)
    assert_allclose(2 * np.pi * angle.revolutions(times), turned, rtol=1e-12, atol=1e-13)


def test_a_rising_torque_against_a_quadratic_load_is_airy():
    # w' = t - w^2 with w(0) = 0 is the logarithmic slope of u'' = t u, u'(0) = 0
    torque = PiecewiseLinear(times_s=np.array([0.0, 4.0]), values=np.array([0.0, 4.0]))
    angle = run_up(torque, RunUp(inertia_kg_m2=1.0, load_nm_s2=1.0), duration_s=4.0)
    times = np.linspace(0, 4, 30)
    ai, ai_slope, bi, bi_slope = airy(times)
    a, b = airy(0.0)[3], -airy(0.0)[1]
    u, u_slope = a * ai + b * bi, a * ai_slope + b * bi_slope
    assert_allclose(2 * np.pi * angle.speed_hz(times), u_slope / u, rtol=1e-11, atol=1e-13)
    assert_allclose(2 * np.pi * angle.revolutions(times), np.log(u / u[0]), rtol=1e-11, atol=1e-13)


def test_a_torque_in_steps_stops_and_turns_the_shaft():
    # no load but the inertia: 2 rad/s^2 for 1 s, -1 for 4 s; at rest after 3 s, then back
    jump = PiecewiseLinear(times_s=np.array([1.0, 1.0]), values=np.array([2.0, -1.0]))
    angle = run_up(jump, RunUp(inertia_kg_m2=1.0), duration_s=5.0)
    turned = 2 * np.pi * angle.revolutions([0.5, 1, 3, 5, 6])
    assert_allclose(turned, [0.25, 1, 3, 1, -1], rtol=1e-12)  # beyond the end the speed is held
    with pytest.raises(ValueError, match="reverses"):
        angle.times(0.1)


def test_a_weight_keeps_its_sign():
    angle = run_up(constant(0.0), RunUp(inertia_kg_m2=1.0, load_nm=1.0), duration_s=2.0)
    assert 2 * np.pi * angle.revolutions(2.0) == pytest.approx(-2.0, rel=1e-12)


def test_a_load_that_changes_sides_bends_where_the_shaft_turns_back():
    # -c w|w| with a steady pull back: w' = -(1 + w^2) from tan(a) to rest, then w' = -1 + w^2
    angle = run_up(constant(-1.0), RunUp(inertia_kg_m2=1.0, load_nm_s2=1.0, rpm=30 / np.pi), duration_s=3.0)
    times = np.linspace(0, 3, 40)
    rest = np.pi / 4
    expected = np.where(times < rest, np.tan(rest - np.minimum(times, rest)), -np.tanh(np.maximum(times - rest, 0)))
    assert_allclose(2 * np.pi * angle.speed_hz(times), expected, atol=1e-13)


def test_a_day_at_top_speed_is_one_piece():
    angle = run_up(constant(75.0), RunUp(inertia_kg_m2=0.04, load_nm_s2=0.0075), duration_s=86_400.0)
    assert angle.times_s.size < 100
    # the square root of 1e4 in rad/s, and the turns of the hyperbolic tangent: tau ln(2) less than at top speed
    tau = 0.04 / 0.0075 / 100
    assert float(angle.speed_hz(86_400.0)) * 2 * np.pi == pytest.approx(100, rel=1e-14)
    assert float(angle.revolutions(86_400.0)) * 2 * np.pi == pytest.approx(100 * (86_400 - tau * np.log(2)), rel=1e-14)
