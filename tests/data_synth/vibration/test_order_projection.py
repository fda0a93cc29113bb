"""Order projection against sums of lines whose amplitudes are written down."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.operation.shaft_angle import ShaftAngle
from data_synth.vibration.order_projection import projection

RATE_HZ = 20_000.0
ORDERS = np.array([1.5, 13.0, 13.7, 19.0, 20.0, 20.5, 160.0, 320.0])
RNG = np.random.default_rng(0)
Z = np.exp(2j * np.pi * RNG.random((2, ORDERS.size))) * np.linspace(0.5, 2, ORDERS.size)


def growth(revolutions):
    return 1 + 0.02 * revolutions + 1e-4 * revolutions**2


def signal_of(turns, amplitudes):
    """Return the sum of lines of amplitudes (channel, order, n)."""
    return np.sum((amplitudes * np.exp(2j * np.pi * np.multiply.outer(ORDERS, turns))).real, axis=1)


@pytest.mark.parametrize("speeds_hz", [(20.0, 20.0), (10.0, 25.0), (1.0, 25.0)])
def test_amplitudes_that_vary_come_back_at_any_speed_with_the_share_of_the_power_that_is_between(speeds_hz):
    angle = ShaftAngle(times_s=np.array([0.0, 4.0]), speeds_hz=np.array(speeds_hz), datum_rev=0.3)
    turns = angle.revolutions(np.arange(80_000) / RATE_HZ)
    expected = Z[:, :, None] * growth(turns)
    signal = signal_of(turns, expected)
    rms = np.sqrt(np.average(signal**2, axis=1, weights=np.gradient(turns)))  # even in angle
    signal += 0.05 * rms[:, None] * np.sqrt(2) * np.cos(2 * np.pi * 51.3 * turns)  # at no order
    unasked = np.array([7.0, 16.3, 250.0])  # at which there is nothing
    every = np.sort(np.concatenate([ORDERS, unasked]))
    instants = np.linspace(0, 79_999, 9).astype(int)
    found = projection(signal, turns, every, at_rev=turns[instants], top_order=330.0, steady=False)
    places = np.searchsorted(every, ORDERS)
    assert set(places) <= set(found.chosen.tolist())
    lines = found.amplitudes[:, np.searchsorted(found.chosen, places)]
    from_end = np.minimum(turns - turns[0], turns[-1] - turns)[instants]
    error = np.abs(lines - expected[:, :, instants])[:, :, from_end > found.interval_rev / 4]
    assert np.max(error) < 5e-3 * np.max(np.abs(expected))
    place = np.interp(turns, turns[instants], np.arange(instants.size))
    between = np.maximum(1 - np.abs(place - np.arange(instants.size)[:, None]), 0)
    waves = np.exp(2j * np.pi * np.multiply.outer(every[found.chosen], turns))
    rest = signal - np.sum((found.amplitudes @ between * waves).real, axis=1)
    assert_allclose(found.left, np.var(rest, axis=1) / np.var(signal, axis=1), rtol=0.01)
    in_angle = [np.average(part**2, axis=1, weights=np.gradient(turns)) for part in (rest, signal)]
    assert_allclose(np.divide(*in_angle), 0.05**2, rtol=0.1)


def test_lines_of_constant_amplitude_come_back_and_nothing_is_left():
    turns = 20.0 * np.arange(80_000) / RATE_HZ
    signal = signal_of(turns, Z[:, :, None] * np.ones(turns.size))
    found = projection(signal, turns, ORDERS, at_rev=turns[[0, -1]], top_order=330.0, steady=True)
    assert_allclose(found.chosen, np.arange(ORDERS.size))
    assert_allclose(found.amplitudes[:, :, 0], Z, atol=2e-4)
    assert np.max(found.left) < 1e-5


def test_the_louder_of_two_lines_that_the_record_does_not_separate_stands_for_both():
    turns = 20.0 * np.arange(20_000) / RATE_HZ  # 20 revolutions
    signal = np.cos(2 * np.pi * 30.0 * turns) + 0.1 * np.cos(2 * np.pi * 30.01 * turns)
    found = projection(signal[None], turns, np.array([30.0, 30.01]), at_rev=turns[[0, -1]], top_order=50.0, steady=True)
    assert found.chosen.tolist() == [0]
    assert found.left[0] < 1e-2


def test_weak_lines_beside_a_strong_one_come_back_through_a_resonance():
    """Speed falls, so that the lines approach each other in Hz, and each passes 1 / (1 - r^2 + 2 j z r), a closed form.

    Every line is known; the sidebands have a tenth of the amplitude of what they are beside.
    """
    angle = ShaftAngle(times_s=np.array([0.0, 8.0]), speeds_hz=np.array([20.0, 14.0]))
    orders, strong = 23.0 + np.arange(-6, 7), 6
    z = np.where(np.arange(13) == strong, 1.0, 0.1) * np.exp(2j * np.pi * RNG.random(13))
    times_s = np.arange(8 * 4000) / 4000.0
    turns = angle.revolutions(times_s)
    ratio = np.multiply.outer(orders, angle.speed_hz(times_s)) / 400.0
    expected = z[:, None] / (1 - ratio**2 + 2j * 0.05 * ratio)
    signal = np.sum((expected * np.exp(2j * np.pi * np.multiply.outer(orders, turns))).real, axis=0)
    found = projection(signal[None], turns, orders, at_rev=turns[::250], top_order=95.0, steady=False)
    error = (found.amplitudes[0] - expected[:, ::250])[:, 4:-4]
    size = np.sqrt(np.mean(np.abs(expected) ** 2, axis=1))
    assert np.max(np.sqrt(np.mean(np.abs(error) ** 2, axis=1)) / size) < 0.01
