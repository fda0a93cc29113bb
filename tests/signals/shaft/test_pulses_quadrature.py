"""Two channels in quadrature on shafts whose angle is known in closed form, turning back included."""

import numpy as np
import pytest

from signals.shaft.pulses import quadrature_direction
from signals.shaft.tachometer import shaft_phase

RATE_HZ = 50_000.0
STRIPES = 16


def channels(turns):
    first = np.sin(2 * np.pi * STRIPES * turns)
    second = np.sin(2 * np.pi * STRIPES * turns - np.pi / 2)
    return first, second


def swing(t):
    """Two turns forward and back, in 4 s; it never rests at an edge."""
    return 2.013 * np.sin(2 * np.pi * t / 4)


def test_reversal_is_followed():
    t = np.arange(200_000) / RATE_HZ
    edges = quadrature_direction(*channels(swing(t)), rate_hz=RATE_HZ, start_s=5.0)
    np.testing.assert_array_equal(edges.direction, np.sign(np.cos(2 * np.pi * (edges.times_s - 5) / 4)))
    phase = shaft_phase(edges.times_s, pulses_per_rev=4 * STRIPES, direction=edges.direction)
    assert not phase.direction_unknown
    at = np.linspace(phase.start_s, phase.stop_s, 5001)
    angle = phase.revolutions_at(at)
    error = angle - swing(at - 5)
    error -= error[0]  # revolution zero is the first edge
    # at an edge it is known to 1e-5; where the shaft turns about between two passes of one edge a parabola goes
    assert np.max(np.abs(error)) < 1e-4
    # the same list of times, told nothing of direction, climbs on and on
    with_no_direction = shaft_phase(edges.times_s, pulses_per_rev=4 * STRIPES)
    assert with_no_direction.revolutions[-1] > 7.9
    assert with_no_direction.direction_unknown


def test_channels_of_unequal_length():
    with pytest.raises(ValueError, match=r"\(100,\) and \(99,\); both must cover the same samples"):
        quadrature_direction(np.zeros(100), np.zeros(99), rate_hz=1.0)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("channel", [0, 1])
def test_a_lost_pulse_leaves_the_angle_right(sense, channel):
    t = np.arange(100_000) / RATE_HZ
    turns = sense * (3 * t + 0.2 * t**2) + 0.003
    waves = channels(turns)
    high = waves[channel] > 0
    begins, ends = (np.flatnonzero(high[1:] & ~high[:-1]), np.flatnonzero(~high[1:] & high[:-1]))
    begin = begins[40]
    waves[channel][begin - 1 : ends[ends > begin][0] + 2] = -0.5
    edges = quadrature_direction(*waves, rate_hz=RATE_HZ)
    np.testing.assert_array_equal(edges.direction, sense)
    assert edges.missing_times_s.size == 2
    phase = shaft_phase(edges.times_s, pulses_per_rev=4 * STRIPES, direction=edges.direction)
    law = np.interp(edges.times_s, t, turns)
    # an edge that is put in is half-way between its neighbours; the others are found to 1e-3 samples
    np.testing.assert_allclose(phase.revolutions, law - law[0], rtol=0, atol=1e-4)


def test_a_channel_that_loses_many_pulses_is_refused():
    t = np.arange(100_000) / RATE_HZ
    first, second = channels(3 * t + 0.003)
    first[(STRIPES * 3 * t) % 8 < 1] = -0.5
    with pytest.raises(ValueError, match=r"channels contradict each other: \d+ edges of \d+ are lost"):
        quadrature_direction(first, second, rate_hz=RATE_HZ)


def test_a_pulse_lost_at_a_reversal_is_said_to_be_possible():
    t = np.arange(200_000) / RATE_HZ
    turns = swing(t)
    first, second = channels(turns)
    first[(t > 0.9) & (t < 1.05)] = -1  # where the shaft turns about, and takes longer for a stripe than before
    with pytest.warns(UserWarning, match="several consecutive edges without one of the other"):
        quadrature_direction(first, second, rate_hz=RATE_HZ)
