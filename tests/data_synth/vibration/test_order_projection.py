"""Order projection against sums of lines whose amplitudes are written down."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.operation.shaft_angle import ShaftAngle
from data_synth.vibration.order_projection import AngleSamples, Projection, Window, sum_of_lines

RATE_HZ = 20_000.0
ORDERS = np.array([0.6, 13.0, 13.7, 19.0, 20.0, 20.5, 160.0, 321.0])
RNG = np.random.default_rng(0)
Z = np.exp(2j * np.pi * RNG.random((2, ORDERS.size))) * np.linspace(0.5, 2, ORDERS.size)


def growth(revolutions):
    return 1 + 0.02 * revolutions + 1e-4 * revolutions**2


def samples_of(angle, z, *, duration_s=4.0, growth=growth):
    times_s = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    turns = angle.revolutions(times_s)
    waves = np.exp(2j * np.pi * np.multiply.outer(ORDERS, turns))
    signal = (z @ (waves * growth(turns))).real
    return AngleSamples(
        signal=signal, rate_hz=RATE_HZ, revolutions=angle.revolutions, speed_hz=angle.speed_hz, top_order=321.0
    )


@pytest.mark.parametrize("speeds_hz", [(20.0, 20.0), (10.0, 25.0), (0.0, 25.0)])
@pytest.mark.parametrize("length_rev", [8.0, 16.0])
def test_amplitudes_of_second_degree_in_angle_come_back_at_any_speed_and_at_both_ends(speeds_hz, length_rev):
    angle = ShaftAngle(times_s=np.array([0.0, 4.0]), speeds_hz=np.array(speeds_hz), datum_rev=0.3)
    samples = samples_of(angle, Z)
    instants_rev = angle.revolutions(np.linspace(0, 4, 81))
    projection = Projection(samples=samples, orders=ORDERS, window=Window(length_rev=length_rev, degree=2))
    expected = Z[:, :, None] * growth(instants_rev)
    found = projection.amplitudes(instants_rev)
    # -90 dB (3e-5) between lines, times the gain of a second degree at half a window from its middle, about 25
    assert np.max(np.abs(found - expected) / np.abs(expected).max()) < 8e-4
    within = (instants_rev > instants_rev[0] + length_rev / 2) & (instants_rev < instants_rev[-1] - length_rev / 2)
    assert np.max(np.abs(found - expected)[:, :, within]) < 4e-5 * np.abs(expected).max()  # -98 dB of three lines


def test_lines_of_constant_amplitude_come_back_from_one_window():
    angle = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([20.0]))
    samples = samples_of(angle, Z, growth=np.ones_like)
    projection = Projection(samples=samples, orders=ORDERS, window=Window(length_rev=80.0, degree=0))
    assert_allclose(projection.mean(np.array([40.0])), Z, atol=1e-4)  # -98 dB from each of the others


def test_lines_three_and_a_half_periods_of_the_window_apart_are_fitted_together():
    angle = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([20.0]))
    samples = samples_of(angle, Z, growth=np.ones_like)
    short = Projection(samples=samples, orders=ORDERS, window=Window(length_rev=7.0, degree=2))  # 0.5 is 3.5 periods
    assert_allclose(short.amplitudes(np.array([40.0]))[:, :, 0], Z, atol=1e-3)


def test_lines_that_the_window_does_not_separate_add_up_to_the_signal_at_its_ends_and_between():
    """Chirps at orders 20 and 20.5, one period of the window apart, of amplitudes that are written down."""
    angle = ShaftAngle(times_s=np.array([0.0, 4.0]), speeds_hz=np.array([10.0, 25.0]))
    samples, instants_rev = samples_of(angle, Z), angle.revolutions(np.linspace(0, 4, 401))
    waves = np.exp(2j * np.pi * np.multiply.outer(ORDERS, instants_rev))
    expected = np.einsum("ck,ki->ci", Z, waves * growth(instants_rev)).real
    window = Window(length_rev=2.0, degree=2, ridge=0.003)
    found = Projection(samples=samples, orders=ORDERS, window=window).amplitudes(instants_rev)
    error = np.einsum("cki,ki->ci", found, waves).real - expected
    for here in (slice(0, 10), slice(10, -10), slice(-10, None)):
        assert np.mean(error[:, here] ** 2) < 0.05 * np.mean(expected[:, here] ** 2)  # 95 % of the power
    # the signal bounds what they share: without the ridge, two that nearly cancel are as good
    assert np.max(np.abs(found)) < 2 * np.max(np.abs(Z)) * growth(instants_rev[-1])


def test_a_record_s_ends_are_fitted_with_weight_on_their_last_samples():
    """Amplitudes through a resonance, cut off on its flank, as 1 / (1 + j (angle - a) / b), a closed form."""
    angle = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([20.0]))

    def resonance(turns, middle=75.0, half_width=25.0):
        return 1 / (1 + 1j * (np.asarray(turns) - middle) / half_width)

    times_s = np.arange(int(4 * RATE_HZ)) / RATE_HZ
    turns = angle.revolutions(times_s)
    waves = np.exp(2j * np.pi * np.multiply.outer(ORDERS, turns))
    samples = AngleSamples(
        signal=(Z @ (waves * resonance(turns))).real,
        rate_hz=RATE_HZ,
        revolutions=angle.revolutions,
        speed_hz=angle.speed_hz,
        top_order=321.0,
    )
    instants_rev = angle.revolutions(np.linspace(0, 4, 81))
    projection = Projection(samples=samples, orders=ORDERS, window=Window(length_rev=8.0, degree=2))
    expected = Z[:, :, None] * resonance(instants_rev)
    error = np.abs(projection.amplitudes(instants_rev) - expected) / np.abs(expected).max()
    # of a cubic term c u^3 a quadratic over a window misses c L^3 / 20 at its end (Legendre), c = 1 / 25^3: 1.6e-3;
    # and -90 dB (3e-5) of other lines, 9 times: the gain of a quadratic at the end of a uniform weight
    assert np.max(error) < 1.6e-3 + 9 * 3e-5


def test_weak_lines_beside_a_strong_one_come_back_through_a_resonance_and_half_the_window_agrees():
    """Speed falls, so that the lines approach each other in Hz, and each passes 1 / (1 - r^2 + 2 j z r), a closed form.

    Every line is known; the sidebands have a hundredth of the amplitude of what they are beside.
    """
    angle = ShaftAngle(times_s=np.array([0.0, 8.0]), speeds_hz=np.array([20.0, 14.0]))
    orders, strong = 23.0 + np.arange(-6, 7), 6
    z = np.where(np.arange(13) == strong, 1.0, 0.01) * np.exp(2j * np.pi * RNG.random(13))

    def resonance(frequency_hz):
        r = frequency_hz / 400.0
        return 1 / (1 - r**2 + 2j * 0.05 * r)

    times_s = np.arange(8 * 4000) / 4000.0
    turns = angle.revolutions(times_s)
    signal = np.zeros(times_s.size)
    for order, amplitude in zip(orders, z, strict=True):
        response = resonance(order * angle.speed_hz(times_s))
        signal += (amplitude * response * np.exp(2j * np.pi * order * turns)).real
    samples = AngleSamples(
        signal=signal[None], rate_hz=4000.0, revolutions=angle.revolutions, speed_hz=angle.speed_hz, top_order=100.0
    )
    instants_s = np.linspace(0, 8, 161)
    expected = z[:, None] * resonance(np.multiply.outer(orders, angle.speed_hz(instants_s)))
    whole, half = (
        Projection(samples=samples, orders=orders, window=Window(length_rev=length_rev, degree=2)).amplitudes(
            angle.revolutions(instants_s)
        )[0]
        for length_rev in (12.0, 6.0)
    )
    size = np.sqrt(np.mean(np.abs(expected) ** 2, axis=1))

    def largest(error):  # between the ends of the record, where no window is one-sided
        return np.max(np.sqrt(np.mean(np.abs(error[:, 20:-20]) ** 2, axis=1)) / size)

    # -98 dB of the strong line (1.3e-5) a hundred times, and as much for what a quadratic misses of it; a window of
    # -71 dB at any distance leaves 0.03
    assert largest(whole - expected) < 2.6e-3
    assert largest(half - expected) < 2.6e-3
    assert largest(whole - half) < 0.01


def test_a_sum_of_lines_is_that_of_its_terms():
    angle = ShaftAngle(times_s=np.array([0.0, 2.0]), speeds_hz=np.array([10.0, 25.0]), datum_rev=0.3)
    times_s, instants_s = np.arange(40_000) / RATE_HZ, np.linspace(0, 2, 41)
    orders = np.concatenate([[0.01, 0.2], ORDERS])
    amplitudes = RNG.standard_normal((2, orders.size, 41)) + 1j * RNG.standard_normal((2, orders.size, 41))
    turns = angle.revolutions(times_s)
    expected = np.zeros((2, times_s.size))
    for row, order in enumerate(orders):
        for channel in range(2):
            z = np.interp(times_s, instants_s, amplitudes[channel, row])
            expected[channel] += (z * np.exp(2j * np.pi * order * turns)).real
    found = sum_of_lines(orders, amplitudes, instants_s=instants_s, revolutions=angle.revolutions, times_s=times_s)
    assert_allclose(found, expected, atol=1e-5)  # the kernels' aliases: 1e-6 of each line
