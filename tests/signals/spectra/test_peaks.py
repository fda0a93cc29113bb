"""Peaks of a spectrum against known lines and the distribution of noise."""

import numpy as np
import pytest

from signals import amplitude_spectrum
from signals.spectra.peaks import spectral_peaks


def spectrum_of(x, rate=64.0):
    return amplitude_spectrum(x, rate=rate)


def test_every_line_is_found_where_it_is():
    turns = np.arange(2**14) / 64
    orders, sizes = np.array([3.0, 7.25, 20.1]), np.array([1.0, 0.5, 2.0])
    x = (sizes[:, None] * np.cos(2 * np.pi * orders[:, None] * turns)).sum(axis=0)
    x += 0.01 * np.random.default_rng(0).standard_normal(turns.size)
    found = spectral_peaks(spectrum_of(x), ratio=30)
    large = found.amplitude > 0.1  # side lobes lie 31 dB below
    np.testing.assert_allclose(found.position[large], orders, atol=1 / 256 / 8)  # the grid is an eighth of a bin
    np.testing.assert_allclose(found.amplitude[large], sizes, rtol=3e-3)  # scalloping of that grid
    assert np.all(found.background > 0)


def test_noise_alone_has_few_peaks():
    # the amplitude of Gaussian noise exceeds 4 times its median at a share 2^-16 of all points
    found = spectral_peaks(spectrum_of(np.random.default_rng(1).standard_normal(2**17)), ratio=4)
    assert found.position.size <= 10  # of 65,000 independent bins


def test_the_background_follows_the_noise_and_not_the_lines():
    turns = np.arange(2**15) / 64
    x = np.random.default_rng(2).standard_normal(turns.size)
    family = sum(5 * np.cos(2 * np.pi * (10 + 0.02 * k) * turns) for k in range(-5, 6))  # fills a block
    found = spectral_peaks(spectrum_of(x + family), ratio=4)
    plain = np.median(spectrum_of(x).amplitude)
    near = np.abs(found.position - 10) < 0.15
    assert near.sum() >= 11
    assert np.all(found.background[near] < 2 * plain)


def test_a_ratio_is_a_positive_number():
    with pytest.raises(ValueError, match="ratio"):
        spectral_peaks(spectrum_of(np.ones(256)), ratio=0)
