import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from data_synth.profile import ShaftAngle, load_share
from data_synth.scene import Torque
from data_synth.sensors import pulse_times

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


def test_load_follows_the_torque_whatever_its_sign():
    torque = Torque(link="x", nm=((0.0, -100.0), (1.0, 50.0)), unloaded_share=0.2)
    assert_allclose(load_share(torque, [-1, 0, 2 / 3, 1, 9]), [1, 1, 0.2, 0.6, 0.6], rtol=1e-14, atol=1e-14)
    assert_allclose(load_share(None, [0, 1]), 1)
