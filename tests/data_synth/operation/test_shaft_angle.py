import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from data_synth.operation.shaft_angle import ShaftAngle
from data_synth.operation.tachometer_pulses import pulse_times

ANGLE = ShaftAngle(times_s=np.array([0.5, 2.0, 3.0]), speeds_hz=np.array([10.0, 25.0, 20.0]), datum_rev=0.3)


def test_the_angle_is_the_integral_of_the_speed():
    # by hand: held at 10 to 0.5 s (5 rev), a ramp 10 -> 25 in 1.5 s (26.25), 25 -> 20 in 1 s (22.5), then held
    assert_allclose(ANGLE.revolutions([0.0, 0.5, 2.0, 3.0, 4.0]) + 0.3, [0, 5, 31.25, 53.75, 73.75], rtol=1e-14)
    assert_allclose(ANGLE.revolutions(-1.0) + 0.3, -10, rtol=1e-14)
    # inside of a ramp: 5 + 10 x 0.5 + 10 x 0.5^2 / 2
    assert_allclose(ANGLE.revolutions(1.0) + 0.3, 11.25, rtol=1e-14)
    assert_allclose(ANGLE.speed_hz([0.0, 1.0, 5.0]), [10, 15, 20], rtol=1e-14)


@given(
    st.lists(st.tuples(st.floats(0.01, 3), st.floats(0.1, 400)), min_size=1, max_size=6),
    st.floats(-2, 15),
)
def test_the_inverse_is_exact(pieces, time_s):
    gaps, speeds = np.array(pieces).T
    angle = ShaftAngle(times_s=np.cumsum(gaps), speeds_hz=speeds)
    # an ulp of the revolutions over the slowest speed is what rounding leaves
    slack = 1e-12 * (1 + abs(float(angle.revolutions(time_s))) + abs(time_s) * speeds.max()) / speeds.min()
    assert_allclose(angle.times(angle.revolutions(time_s)), time_s, rtol=0, atol=slack)


def test_pulses_of_a_ramp_are_where_the_quadratic_says():
    start, slope = 10.0, 5.0
    angle = ShaftAngle(times_s=np.array([0.0, 4.0]), speeds_hz=np.array([start, start + 4 * slope]), datum_rev=0.25)
    pulses = pulse_times(angle, turns_per_rev=2.0, pulses_per_rev=3, stop_s=4.0)
    number = np.arange(pulses.size)
    turned = 0.25 + number / 6
    assert_allclose(pulses, (np.sqrt(start**2 + 2 * slope * turned) - start) / slope, rtol=1e-13)
    assert pulses.size == np.floor((4 * start + 8 * slope - 0.25) * 6) + 1


BACK = ShaftAngle(times_s=np.array([0.0, 2.0, 3.0, 5.0, 6.0]), speeds_hz=np.array([4.0, -4.0, -4.0, 0.0, 0.0]))


def test_a_shaft_may_turn_back_and_stand():
    # by hand: up 2 rev in 1 s, back 2 in 1 s, back 4 in 1 s, back 4 in 2 s, then rest
    assert_allclose(BACK.revolutions([0, 1, 2, 3, 5, 6, 9]), [0, 2, 0, -4, -8, -8, -8], atol=1e-14)
    assert BACK.top_speed_hz(0.9, 1.1) == pytest.approx(0.4)
    assert BACK.top_speed_hz(0.0, 9.0) == 4
    with pytest.raises(ValueError, match="reverses, at -4 rev/s"):
        BACK.times(1.0)


def test_two_knots_at_one_time_are_a_jump():
    angle = ShaftAngle(times_s=np.array([0.0, 1.0, 1.0, 2.0]), speeds_hz=np.array([2.0, 2.0, 6.0, 6.0]))
    assert_allclose(angle.revolutions([0.5, 1.0, 1.5]), [1, 2, 5], rtol=1e-15)
    assert_allclose(angle.times([1, 2, 5]), [0.5, 1, 1.5], rtol=1e-15)
    assert_allclose(angle.speed_hz([0.999, 1.0]), [2, 6])
    assert angle.top_speed_hz(0.5, 1.0) == 6


def test_from_rest_and_to_rest():
    angle = ShaftAngle(times_s=np.array([1.0, 3.0, 5.0, 6.0, 8.0]), speeds_hz=np.array([0.0, 4.0, 0.0, 0.0, 2.0]))
    # 2 t^2 / 2 from 1 s; mirrored from 3 s; rest at 8 rev from 5 to 6 s; t^2 / 2 from there
    assert_allclose(angle.times([0, 1, 4, 7, 8, 8.5]), [1, 2, 3, 4, 6, 7], rtol=1e-14)
    with pytest.raises(ValueError, match="revolution -1 is never reached: the shaft stands still"):
        angle.times(-1.0)


@pytest.mark.parametrize(
    ("times", "speeds", "sentence"),
    [
        ([0.0, 1.0], [1.0], "have shapes"),
        ([0.0, np.nan], [1.0, 1.0], "NaN"),
        ([1.0, 0.0], [1.0, 1.0], "times_s decreases from 1 s to 0 s"),
    ],
)
def test_knots_that_are_none_are_refused(times, speeds, sentence):
    with pytest.raises(ValueError, match=sentence):
        ShaftAngle(times_s=np.array(times), speeds_hz=np.array(speeds))
