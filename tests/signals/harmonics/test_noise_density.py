"""The density of noise about each order, against closed forms, and the intervals that `std` gives in coloured noise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from signals import likely_bandwidth, track_orders

RATE, TURN_HZ, SAMPLES = 5000.0, 20.0, 60_000
ORDERS = np.array([3.0, 7.3, 19.0])
STEADY = 2 * np.pi * TURN_HZ / RATE * np.arange(SAMPLES)
RUN_UP = STEADY * (0.6 + 0.4 * np.arange(SAMPLES) / SAMPLES)  # from 12 to 28 revolutions in a second
SETTINGS = {"orders": ORDERS, "rate_hz": RATE, "output_every": 2000}
POLE = 0.97 * np.exp(2j * np.pi * 380 / RATE)  # a mode at 380 Hz with 5 % of damping, where order 19 is
MODE, LOW_PASS = [1.0, -2 * POLE.real, abs(POLE) ** 2], [1.0, -0.7, 0.0]


def lines(phase):
    return sum(np.cos(order * phase) for order in ORDERS)


def resonant(rng):
    return lfilter([1.0], MODE, rng.standard_normal(SAMPLES))


@pytest.mark.parametrize(("phase", "model"), [(STEADY, MODE), (RUN_UP, LOW_PASS)], ids=["steady", "run-up"])
def test_follows_the_spectrum_of_the_noise(phase, model):
    found = []
    for seed in range(30):
        x = lines(phase) + lfilter([1.0], model, np.random.default_rng(seed).standard_normal(SAMPLES))
        found.append(track_orders(x, phase_rad=phase, bandwidth_hz=2.0, **SETTINGS).noise_density)
    speed = np.interp((np.arange(8) + 0.5) / 8, np.arange(SAMPLES) / SAMPLES, np.gradient(phase) * RATE / (2 * np.pi))
    z = np.exp(-2j * np.pi * ORDERS[:, None] * speed / RATE)
    density = 1 / np.abs(model[0] + model[1] * z + model[2] * z**2) ** 2  # of an autoregressive process
    # By chance 3 %, by curvature between the two sides 5 %; what chance may explain is left at the mean density.
    assert_allclose(np.sqrt(np.mean(found, axis=0) / density), 1.0, atol=0.12)


def test_neither_lines_nor_an_offset_nor_gaps_are_noise():
    rng, phase = np.random.default_rng(4), STEADY
    x = 0.1 * rng.standard_normal(SAMPLES) + 30 * np.cos(7.3 * phase) + 5 * np.cos(19.3 * phase) + 10
    x[20_000:22_000] = np.nan
    tracks = track_orders(x, phase_rad=phase, bandwidth_hz=1.0, **SETTINGS)
    assert tracks.noise_variance > 1  # the line at order 19.3 and the offset are in the innovations
    assert_allclose(tracks.noise_density, 0.01, rtol=0.5)


@pytest.mark.parametrize("samples", [50, 3000])
def test_what_is_too_short_has_the_mean_density(samples):
    x = lines(STEADY[:samples]) + np.random.default_rng(1).standard_normal(samples)
    x[::20] = np.nan
    tracks = track_orders(x, phase_rad=STEADY[:samples], bandwidth_hz=2.0, **SETTINGS)
    assert np.all(tracks.noise_density == tracks.noise_variance)


@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_ninety_per_cent_intervals_hold_under_a_resonance(estimator):
    inside = []
    for seed in range(20):
        x = lines(STEADY) + resonant(np.random.default_rng([7, seed]))
        bandwidth = likely_bandwidth(x, phase_rad=STEADY, orders=ORDERS, rate_hz=RATE, largest_bandwidth_hz=2.0)
        tracks = track_orders(x, phase_rad=STEADY, bandwidth_hz=bandwidth + 1.0, estimator=estimator, **SETTINGS)
        error = ((tracks.complex_amplitude - 1) / tracks.std)[:, 3:-3]
        inside.append(np.abs([error.real, error.imag]) < 1.645)
    # 1,000 quadratures of each order, a fifth of them independent; of constants `std` is up to 1.6 times too wide
    assert np.all(np.mean(inside, axis=(0, 1, 3)) > 0.85)


@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_half_widths_are_those_of_a_regression_where_amplitudes_stand_still(estimator):
    """Two quadratures from ten samples: 8 degrees of freedom, with which a normal distribution would hold 86 %."""
    phase = 0.9 * np.arange(10)
    x = np.cos(phase + 0.4) + np.random.default_rng(8).standard_normal((4000, 10))
    tracks = track_orders(x, phase_rad=phase, orders=[1], bandwidth_hz=1e-6, rate_hz=1.0, estimator=estimator)
    error = tracks.complex_amplitude[:, 0, -1] - np.exp(0.4j)
    inside = np.abs([error.real, error.imag]) < tracks.half_width(0.9)[:, 0, -1]
    assert_allclose(inside.mean(), 0.9, atol=0.01)  # 3 standard deviations of 8,000
