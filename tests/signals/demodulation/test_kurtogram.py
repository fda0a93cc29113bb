"""Kurtoses that are known in closed form, and the tree of filters against plain convolution."""

import numpy as np
import pytest
from scipy.fft import next_fast_len
from scipy.signal import hilbert

from signals.demodulation.kurtogram import fast_kurtogram

RATE_HZ = 20_000.0
COUNT = 200_000
RNG = np.random.default_rng(20)
NOISE = RNG.standard_normal(COUNT)
TIMES = np.arange(COUNT) / RATE_HZ


def gated(duty, period=4000):
    """Noise that is on for a part of each period, long beside every window and filter used here."""
    return NOISE * (np.arange(COUNT) % period < duty * period)


def resonance(frequency_hz, decay_hz, every):
    """Return impulses `every` so many samples, each ringing at one frequency."""
    hits = np.zeros(COUNT)
    hits[500::every] = 1.0
    ring = np.exp(-2 * np.pi * decay_hz * TIMES[:600]) * np.sin(2 * np.pi * frequency_hz * TIMES[:600])
    return np.convolve(hits, ring)[:COUNT]


class TestTree:
    @pytest.mark.parametrize("tone", [0.0, 300.0])
    @pytest.mark.parametrize("factor", [2, 3])
    def test_single_precision_costs_what_the_docstring_says(self, factor, tone):
        """Kurtoses by plain convolution in double precision, also beside a tone 50 dB above the noise."""
        x = resonance(7000, 300, every=900) + 0.1 * NOISE + tone / 10 * np.sin(2 * np.pi * 1234.5 * TIMES)
        gram = fast_kurtogram(x, rate_hz=RATE_HZ, levels=7)
        c = hilbert(x - x.mean(), next_fast_len(x.size))[: x.size]
        count = np.arange(24 * factor) - (24 * factor - 1) / 2
        taps = np.sinc(0.6 / factor * count) * np.kaiser(count.size, 8.0)
        kurtoses = []
        for b in range(factor):
            modulated = taps / taps.sum() * np.exp(1j * np.pi * np.arange(taps.size) * (2 * b + 1) / (2 * factor))
            power = np.abs(np.convolve(c, modulated, mode="valid")[::factor]) ** 2
            kurtoses.append(np.mean(power**2) / np.mean(power) ** 2 - 2)
        row = gram.kurtosis[np.isclose(gram.level, np.log2(factor))]
        np.testing.assert_allclose(row, kurtoses, atol=1e-4)

    @pytest.mark.parametrize("length", [200_000, 199_999, 100_003])  # the last is prime
    def test_bands(self, length):
        gram = fast_kurtogram(NOISE[:length], rate_hz=RATE_HZ, levels=7)
        levels, counts = np.unique(gram.level, return_counts=True)
        # halves, and thirds of halves (Antoni 2007): 1, 2, 3, 4, 6, 8, 12, ... bands
        np.testing.assert_array_equal(counts, [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128])
        np.testing.assert_allclose(levels, np.log2(counts), rtol=1e-12)
        np.testing.assert_allclose(gram.high_hz - gram.low_hz, RATE_HZ / 2 / 2**gram.level, rtol=1e-9)
        for level in levels:
            row = gram.level == level
            np.testing.assert_allclose(gram.low_hz[row][1:], gram.high_hz[row][:-1], rtol=1e-12)
            assert gram.high_hz[row][-1] == pytest.approx(RATE_HZ / 2, rel=1e-12)
        # white: equal shares, 1.117 of the nominal width by the filter's noise bandwidth; the narrowest rest on some
        # 700 independent values, so their sums of 128 scatter by 0.4 %
        share = [gram.power_share[gram.level == level].sum() for level in levels[1:]]
        np.testing.assert_allclose(share, 1.117, rtol=0.09)  # an end of the spectrum loses its overlap: 1/2 of 0.117

    @pytest.mark.parametrize("frequency", [100.0, 6867.0, 9940.0])
    def test_a_tone_is_in_its_bands(self, frequency):
        gram = fast_kurtogram(np.cos(2 * np.pi * frequency * TIMES) + 1e-3 * NOISE, rate_hz=RATE_HZ)
        for level in np.unique(gram.level):
            row = np.flatnonzero(gram.level == level)
            top = row[np.argmax(gram.power_share[row])]
            assert gram.low_hz[top] <= frequency <= gram.high_hz[top]
            assert gram.kurtosis[top] == pytest.approx(-1, abs=0.01)  # |c|^2 is constant: 1 - 2; noise at -60 dB


class TestKurtosis:
    @pytest.mark.parametrize("duty", [0.1, 0.5])
    def test_of_gated_noise(self, duty):
        gram = fast_kurtogram(gated(duty), rate_hz=RATE_HZ, levels=4)
        # on for a part d: <p^2>/<p>^2 = 2/d. Filters smear a gate by at most 48 of its 400 samples at level 3
        wide = gram.level <= 2
        np.testing.assert_allclose(gram.kurtosis[wide], 2 / duty - 2, rtol=0.06, atol=0.05)
        # fifty periods: an eighth less of them changes little
        np.testing.assert_allclose(gram.steady_kurtosis[wide], 2 / duty - 2, rtol=0.12, atol=0.05)

    def test_of_noise_scatters_as_stated(self):
        scores = []
        for seed in range(6):
            x = np.random.default_rng(seed).standard_normal(COUNT)
            gram = fast_kurtogram(x, rate_hz=RATE_HZ)
            scores.append(gram.kurtosis / gram.noise_std)
        scores = np.array(scores)
        # 2664 scores, overlapping: some 600 independent, so 0.04 in the mean and 3 % in the scatter, times three;
        # a kurtosis leans to the right, more so in the narrow bands
        assert np.mean(scores) == pytest.approx(0, abs=0.15)
        assert np.std(scores) == pytest.approx(1, abs=0.12)

    def test_the_scatter_of_the_whole_band_is_that_of_an_analytic_signal(self):
        """White noise made analytic correlates with itself odd lags k off by 2 / (pi k), with even ones not at all.

        The kurtosis of n such values has variance 4 / n times the sum over all lags of the fourth power of that.
        """
        odd = np.arange(1, 2001, 2)
        shared = 1 + 2 * np.sum((2 / (np.pi * odd)) ** 4)
        for count in (5000, 4999, 100_003):
            gram = fast_kurtogram(NOISE[:count], rate_hz=RATE_HZ, levels=1)
            # the series is cut off at 1e-12 of its sum
            assert gram.noise_std[0] == pytest.approx(2 * np.sqrt(shared / count), rel=1e-9)

    def test_a_spike_does_not_survive_in_the_steady_kurtosis(self):
        x = NOISE.copy()
        x[COUNT // 16 * 5] += 2000  # on a seam of the sixteen parts
        gram = fast_kurtogram(x, rate_hz=RATE_HZ)
        assert gram.kurtosis.min() > 100
        # gone but for what steady noise scatters; leaving the loudest parts out takes more than it adds
        assert (gram.steady_kurtosis / gram.noise_std).max() < 5

    def test_negentropy(self):
        plain = fast_kurtogram(NOISE, rate_hz=RATE_HZ, levels=3)
        assert plain.envelope_negentropy is None
        noise = fast_kurtogram(NOISE, rate_hz=RATE_HZ, levels=3, with_negentropy=True)
        # exponential powers: integral of p ln p exp(-p) = 1 - gamma; 1e4 and more lines, 0.53 / 100, times three
        np.testing.assert_allclose(noise.envelope_negentropy, 1 - 0.5772157, atol=0.02)
        tied = fast_kurtogram(resonance(7300.0, 150.0, every=400) + 0.05 * NOISE, rate_hz=RATE_HZ, with_negentropy=True)
        inside = (tied.low_hz < 7000) & (tied.high_hz > 7600) & (tied.level < 4)
        assert tied.envelope_negentropy[inside].min() > 1.5


class TestHardCases:
    @pytest.mark.parametrize(
        ("x", "words"),
        [
            (np.full(5000, 0.1), r"the signal is constant \(0\.1\)"),
            (np.full(5000, 1e9 + 0.1), "the signal is constant"),
            (np.where(np.arange(5000) == 41, np.nan, 1.0), "index 41"),
        ],
    )
    def test_refused(self, x, words):
        with pytest.raises(ValueError, match=words):
            fast_kurtogram(x, rate_hz=RATE_HZ)

    def test_short_records(self):
        with pytest.raises(ValueError, match="639 values; at least 640"):
            fast_kurtogram(NOISE[:639], rate_hz=RATE_HZ)
        assert fast_kurtogram(NOISE[:640], rate_hz=RATE_HZ).level.max() == 1
        with pytest.raises(ValueError, match="levels=7 must be a whole number from 1 to 2"):
            fast_kurtogram(NOISE[:1500], rate_hz=RATE_HZ, levels=7)
