"""Deterministic and random parts of made records, whose parts are known."""

import numpy as np
import pytest
from scipy import signal as sp

from signals.demodulation.separation import (
    cepstrum_prewhitening,
    discrete_random_separation,
    linear_prediction,
)

TWO_POLES = np.array([1.6, -0.81])  # poles at 0.9 exp(+-0.475j)


def autoregressive(rng, samples):
    return sp.lfilter([1], [1, *-TWO_POLES], rng.standard_normal(samples + 500))[500:]


def separations(x):
    return [
        linear_prediction(x, order=8),
        discrete_random_separation(x, window_length=64, delay=64),
        cepstrum_prewhitening(x),
    ]


class TestBothParts:
    @pytest.mark.parametrize("size", [2000, 2001])
    @pytest.mark.parametrize("which", range(3))
    def test_add_up_to_the_record(self, which, size):
        x = 3 + np.cos(np.arange(size)) + np.random.default_rng(1).standard_normal(size)
        found = separations(x)[which]
        part = x[found.start : found.start + found.random.size]
        np.testing.assert_allclose(found.deterministic + found.random, part, rtol=0, atol=1e-14)
        assert part.size >= size - 64

    @pytest.mark.parametrize("which", range(3))
    @pytest.mark.parametrize("level", [0.0, 0.1, -3e9])
    def test_a_constant_is_deterministic(self, which, level):
        found = separations(np.full(1000, level))[which]
        np.testing.assert_array_equal(found.random, 0)
        # the mean of a thousand numbers alike: in pairs, as numpy adds, twenty roundings of 1e-16
        np.testing.assert_allclose(found.deterministic, level, rtol=1e-14)


class TestLinearPrediction:
    def test_solves_the_yule_walker_equations(self):
        x = autoregressive(np.random.default_rng(3), 400)
        x -= x.mean()
        lags = np.array([x[k:] @ x[: x.size - k] for k in range(7)])
        dense = np.linalg.solve([[lags[abs(i - j)] for j in range(6)] for i in range(6)], lags[1:])
        found = linear_prediction(x, order=6)
        np.testing.assert_allclose(found.coefficients, dense, rtol=1e-9)  # cond about 1e3
        by_hand = np.array([dense @ x[n - 6 : n][::-1] for n in range(6, 400)])
        np.testing.assert_allclose(found.deterministic[6:], by_hand, rtol=0, atol=1e-9)
        backwards = np.array([dense @ x[n + 1 : n + 7] for n in range(6)])
        np.testing.assert_allclose(found.deterministic[:6], backwards, rtol=0, atol=1e-9)
        assert (found.start, found.order) == (0, 6)


class TestDiscreteRandom:
    SAMPLES = 60_000
    TIME = np.arange(SAMPLES)

    @pytest.mark.parametrize("bins", [40.0, 40.25, 40.5])
    def test_a_tone_in_noise(self, bins):
        length, sigma = 512, 0.5
        tone = np.cos(2 * np.pi * bins / length * self.TIME + 1)
        noise = sigma * np.random.default_rng(8).standard_normal(self.SAMPLES)
        found = discrete_random_separation(tone + noise, window_length=length, delay=length)
        middle = slice(found.start, found.start + found.random.size)
        # the gain at the tone, q / (q + 1) of Antoni & Randall: q = (A^2 / 4) (sum w)^2 / (sigma^2 sum w^2), the Hann
        # window's sums N / 2 and 3 N / 8; off a bin the tapered response ripples by a percent
        q = length / 6 / sigma**2
        line = 2 * np.mean(found.deterministic * np.exp(-2j * np.pi * bins / length * self.TIME[middle]))
        assert abs(line) == pytest.approx(q / (q + 1), abs=0.015)
        assert found.gain[round(2 * bins)] == pytest.approx(q / (q + 1), abs=0.003)
        # noise: gain 1 / sqrt(K) of K independent blocks, about two of Hann windows to a length of the record
        assert np.median(found.gain) < 1 / np.sqrt(self.SAMPLES / length)
        # eight of 512 bins full of noise pass beside the tone, the rest at that gain
        bound = sigma * np.sqrt(8 / 512 + length / self.SAMPLES)
        assert np.std(found.deterministic - tone[middle]) < bound
        assert np.std(found.random - noise[middle]) < bound

    def test_a_record_that_swells_is_not_amplified(self):
        x = np.cos(0.4 * np.arange(4000)) * np.exp(np.arange(4000) / 400)
        found = discrete_random_separation(x, window_length=128, delay=128)
        assert found.gain.max() <= 1


class TestCepstrumPrewhitening:
    @pytest.mark.parametrize("size", [4096, 4095, 4001])
    def test_every_line_has_one_height_and_its_phase(self, size):
        rng = np.random.default_rng(11)
        x = 5 + 20 * np.cos(0.1 * np.arange(size)) + autoregressive(rng, size)
        found = cepstrum_prewhitening(x)
        before, after = np.fft.rfft(x)[1:], np.fft.rfft(found.random)
        assert abs(after[0]) < 1e-9
        np.testing.assert_allclose(np.abs(after[1:]), found.level, rtol=1e-9)
        np.testing.assert_allclose(np.angle(after[1:] / before), 0, rtol=0, atol=1e-9)
        assert found.level == pytest.approx(np.exp(np.mean(np.log(np.abs(before)))), rel=1e-12)
        assert found.silent_lines == 0

    def test_rounding_is_not_raised_to_a_line(self):
        x = np.cos(2 * np.pi * 8 * np.arange(64) / 64) + 2 * np.cos(2 * np.pi * 20 * np.arange(64) / 64 + 1)
        found = cepstrum_prewhitening(x)
        assert found.silent_lines == 30
        # two lines of 32 and 64 become two of their geometric mean
        assert found.level == pytest.approx(32 * np.sqrt(2), rel=1e-12)
        assert found.random.std() == pytest.approx(np.sqrt(2), rel=1e-12)


@pytest.mark.parametrize(
    ("separate", "settings", "words"),
    [
        (linear_prediction, {"order": 8}, "16 samples are too few for a prediction of order=8"),
        (discrete_random_separation, {"window_length": 8, "delay": 7}, "delay=7 must be a whole number of at least 8"),
        (
            discrete_random_separation,
            {"window_length": 8, "delay": 8},
            "16 samples are too few for window_length=8",
        ),
    ],
)
def test_refused(separate, settings, words):
    with pytest.raises(ValueError, match=words):
        separate(np.arange(16.0), **settings)
