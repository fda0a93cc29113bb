"""What a user may rely on: amplitudes, their uncertainty, gaps, the mean, noise, memory."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from signals.harmonics import track_orders

RNG_SEED = 20


AMPLITUDE = 1.5 + 1.3j


def tone(samples, *, order=3):
    phase = 2 * np.pi * 0.021 * np.arange(samples)
    return (AMPLITUDE * np.exp(1j * order * phase)).real, phase


@pytest.mark.parametrize("method", ["exact", "fast"])
@pytest.mark.parametrize("poles", [1, 2, 3, 4])
def test_pure_tone_comes_back(poles, method):
    x, phase = tone(4000)
    tracks = track_orders(x, phase_rad=phase, orders=[3], bandwidth_hz=0.002, rate_hz=1.0, poles=poles, method=method)
    # What is left is the prior: 2 / (1e6 samples) of the amplitude, at the ends and for four poles some ten times it.
    # Fast promises 1e-3 unless asked for less.
    assert_allclose(tracks.complex_amplitude, np.full((1, 4000), AMPLITUDE), rtol=1e-6 if method == "exact" else 1e-3)
    assert tracks.noise_variance < (1e-9 if method == "exact" else 1e-6)


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_noise_and_innovations(method):
    x, phase = tone(20_000)
    x += 0.3 * np.random.default_rng(RNG_SEED).standard_normal(20_000)
    settings = {"phase_rad": phase, "orders": [3], "bandwidth_hz": 1e-3, "rate_hz": 1.0, "method": method}
    free = track_orders(x, output_every=100, **settings)
    given = track_orders(x, output_every=100, noise_variance=0.36, **settings)
    assert_allclose(free.noise_variance, 0.09, rtol=0.03)  # sqrt(2 / 19,000) = 1 %
    assert free.innovation_mean_square == 1.0
    # A variance four times too large doubles std and shows in the innovations; the estimates do not change.
    assert_allclose(given.complex_amplitude, free.complex_amplitude, rtol=1e-12)
    assert_allclose(given.std / free.std, 0.6 / np.sqrt(free.noise_density[0, 0]), rtol=1e-12)
    assert_allclose(given.innovation_mean_square, free.noise_variance / 0.36, rtol=1e-12)
    assert given.noise_variance == 0.36
    # The filter is wider than the smoother: its prediction adds about pi / 2 * 1.5 bandwidths of noise.


def test_phase_may_run_backwards():
    x, phase = tone(500)
    settings = {"orders": [3], "bandwidth_hz": 0.01, "rate_hz": 1.0}
    ahead = track_orders(x, phase_rad=phase, **settings)
    back = track_orders(x, phase_rad=-phase, **settings)
    assert_allclose(back.complex_amplitude, ahead.complex_amplitude.conj(), rtol=1e-9)


def test_silence_is_silence():
    _, phase = tone(800)
    for method in ("exact", "fast"):
        tracks = track_orders(np.zeros(800), phase_rad=phase, orders=[3], bandwidth_hz=0.01, rate_hz=1.0, method=method)
        assert_array_equal(tracks.complex_amplitude, 0)
        assert tracks.noise_variance == pytest.approx(0, abs=1e-12)
