"""The label is the energy of what is added over the noise, by its definition."""

import numpy as np
import pytest

from data_synth.benchmark.detectability import energy_over_noise_db


@pytest.fixture(scope="module")
def noise():
    return 0.5 * np.random.default_rng(3).standard_normal(40000)


@pytest.mark.parametrize("amplitude", [0.01, 2.0])
def test_of_a_tone_in_white_noise(noise, amplitude):
    added = amplitude * np.sin(0.7 * np.arange(noise.size))
    exact = 10 * np.log10(np.sum(added**2) / 0.5**2)
    # 0.5 dB: a median over 65 lines of 38 averaged spectra is biased by 3 % and scatters by 3 %
    assert energy_over_noise_db(added, noise) == pytest.approx(exact, abs=0.5)
    assert energy_over_noise_db(added, noise, times=5) == pytest.approx(exact + 10 * np.log10(5), abs=0.5)


def test_lines_of_the_healthy_gears_are_no_noise(noise):
    added = 0.1 * np.sin(0.7 * np.arange(noise.size))
    lines = sum(30 * np.sin(2 * np.pi * k * 0.03 * np.arange(noise.size)) for k in range(1, 4))
    # a Hann window spreads a line over three of the 65 that the median is of
    assert energy_over_noise_db(added, noise + lines) == pytest.approx(energy_over_noise_db(added, noise), abs=1)


def test_nothing_added_is_not_detectable(noise):
    assert energy_over_noise_db(np.zeros_like(noise), noise) == -np.inf
