"""Order projection against sums of lines whose amplitudes are written down."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.operation.shaft_angle import ShaftAngle
from data_synth.vibration.order_projection import AngleSamples, Projection, Window

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
    # -71 dB (2.8e-4) between lines, times the gain of a second degree at half a window from its middle, about 25
    assert np.max(np.abs(found - expected) / np.abs(expected).max()) < 7e-3
    within = (instants_rev > instants_rev[0] + length_rev / 2) & (instants_rev < instants_rev[-1] - length_rev / 2)
    assert np.max(np.abs(found - expected)[:, :, within]) < 6e-4 * np.abs(expected).max()  # -71 dB of two lines


@pytest.mark.parametrize(("apart", "determined"), [(3.0, True), (2.0, False)])
def test_lines_three_periods_of_the_window_apart_are_determined_and_two_are_not(apart, determined):
    window = Window(length_rev=10.0, degree=2)
    lower = window.normal_matrix(100 + apart / 10 * np.arange(9))
    size = lower.shape[1]
    matrix = sum(np.diag(lower[below, : size - below], -below) for below in range(min(lower.shape[0], size)))
    matrix = matrix + np.tril(matrix, -1).conj().T
    scale = 1 / np.sqrt(np.diag(matrix).real)
    # 1 over the square of the condition of the columns w^(1/2) u^d exp(2 pi j c k u), by singular values 8 and 6e5
    assert (np.min(np.linalg.eigvalsh(matrix * scale * scale[:, None])) > 1e-3) == determined


def test_lines_of_constant_amplitude_come_back_from_one_window():
    angle = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([20.0]))
    samples = samples_of(angle, Z, growth=np.ones_like)
    projection = Projection(samples=samples, orders=ORDERS, window=Window(length_rev=80.0, degree=0))
    assert_allclose(projection.mean(np.array([40.0])), Z, atol=1e-4)  # -98 dB from each of the others


def test_lines_three_periods_of_the_window_apart_are_fitted_together():
    angle = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([20.0]))
    samples = samples_of(angle, Z, growth=np.ones_like)
    short = Projection(samples=samples, orders=ORDERS, window=Window(length_rev=6.0, degree=2))  # 0.5 is 3 periods
    assert_allclose(short.amplitudes(np.array([40.0]))[:, :, 0], Z, atol=1e-2)


def test_blocks_do_not_show(monkeypatch):
    angle = ShaftAngle(times_s=np.array([0.0, 4.0]), speeds_hz=np.array([10.0, 25.0]))
    instants_rev = angle.revolutions(np.linspace(0, 4, 81))
    projection = Projection(samples=samples_of(angle, Z), orders=ORDERS, window=Window(length_rev=8.0, degree=2))
    whole = projection.amplitudes(instants_rev)
    monkeypatch.setattr("data_synth.vibration.order_projection._BLOCK", 1000)
    monkeypatch.setattr("data_synth.vibration.order_projection._CELLS", 1)
    assert_allclose(projection.amplitudes(instants_rev), whole, atol=1e-12)


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
    # and -71 dB (2.8e-4) of other lines, 9 times: the gain of a quadratic at the end of a uniform weight
    assert np.max(error) < 1.6e-3 + 9 * 2.8e-4
