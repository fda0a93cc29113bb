"""Spectral correlation of modulated noise, known in closed form, and against definitions written out."""

import numpy as np
import pytest
from scipy.io import loadmat

from signals.demodulation.band_selection import choose_band
from signals.spectra.cyclostationary import enhanced_envelope_spectrum, improved_envelope_spectrum, spectral_correlation

RATE_HZ = 10_000.0
COUNT = 200_000
TIMES = np.arange(COUNT) / RATE_HZ
NOISE = 2 * np.random.default_rng(1).standard_normal(COUNT)
DEPTH, ALPHA_HZ, PHASE = 0.6, 125.0, 0.5
MODULATED = (1 + DEPTH * np.cos(2 * np.pi * ALPHA_HZ * TIMES + PHASE)) * NOISE


def brute_force(x, *, window, hop, frames, scanned, cyclic_hz):
    """The definition of Antoni, Xin & Hamzaoui word by word: one sum over frames for each line scanned."""
    length, middle = window.size, window.size // 2
    lines = np.fft.fft([x[i * hop : i * hop + length] * window for i in range(frames)], axis=1)
    place = np.arange(length)
    top, bottom = 0.0, 0.0
    for p in range(scanned + 1):
        shifted = np.roll(lines, p, axis=1)  # line k - p, those below zero from the end
        turn = np.exp(2j * np.pi * p / length * middle)
        for_alpha = np.exp(-2j * np.pi * cyclic_hz * (np.arange(frames) * hop + middle) / RATE_HZ)
        top = top + np.mean(lines * shifted.conj() * for_alpha[:, None], axis=0) * turn
        bottom += np.sum(window**2 * np.cos(2 * np.pi * (cyclic_hz / RATE_HZ - p / length) * (place - middle)))
    return top[: middle + 1] / bottom / RATE_HZ


@pytest.fixture(scope="module")
def modulated():
    return spectral_correlation(MODULATED, rate_hz=RATE_HZ, max_cyclic_hz=400.0, window_length=128)


def at(correlation, alpha_hz):
    """Correlation averaged over the white spectrum at the cyclic line nearest to alpha, its phase set to that line."""
    k = int(np.argmin(np.abs(correlation.cyclic_hz - alpha_hz)))
    # half a bin off, the sum over frames has turned by its middle and lost to sinc
    off = (alpha_hz - correlation.cyclic_hz[k]) / correlation.cyclic_bin_hz
    mean = correlation.correlation[6:-6, k].mean() * RATE_HZ
    return mean / (np.sinc(off) * np.exp(1j * np.pi * off))


class TestClosedForm:
    """(1 + m cos)^2 = 1 + m^2/2 + 2 m cos + m^2/2 cos 2: halves of these are S at 0, alpha, 2 alpha, times 4 / rate."""

    # 2e5 samples, of relative variance 2 in their square: 0.5 % of the power, one to two times that in a line
    def test_power(self, modulated):
        assert modulated.power_density[6:-6].mean() * RATE_HZ == pytest.approx(4 * (1 + DEPTH**2 / 2), rel=0.02)

    @pytest.mark.parametrize(("line", "power", "tolerance"), [(1, 4 * DEPTH, 0.04), (2, DEPTH**2, 0.15)])
    def test_lines(self, modulated, line, power, tolerance):
        found = at(modulated, line * ALPHA_HZ)
        assert abs(found) == pytest.approx(power, rel=tolerance)
        assert np.angle(found) == pytest.approx(line * PHASE, abs=tolerance)

    def test_coherence_is_free_of_colour(self):
        taps = np.convolve([1, -0.9], np.hanning(7))
        coloured = np.convolve(MODULATED, taps, mode="same")
        found = spectral_correlation(coloured, rate_hz=RATE_HZ, max_cyclic_hz=200.0, window_length=128)
        k = int(np.argmin(np.abs(found.cyclic_hz - ALPHA_HZ)))
        inside = slice(10, 40)  # where the filter leaves power
        mean = np.abs(found.coherence()[inside, k]).mean()
        # m / (1 + m^2/2); the bins beside the line take up to 1 - sinc(1/2) where it falls between
        off = (ALPHA_HZ - found.cyclic_hz[k]) / found.cyclic_bin_hz
        assert mean == pytest.approx(DEPTH / (1 + DEPTH**2 / 2) * np.sinc(off), rel=0.08)
        # the power itself varies over these lines by far more
        assert found.power_density[inside].max() > 3 * found.power_density[inside].min()


class TestDefinitions:
    SHORT = MODULATED[:4000]

    @pytest.mark.parametrize("length", [32, 64])
    def test_is_the_papers_sum(self, length):
        found = spectral_correlation(self.SHORT, rate_hz=RATE_HZ, max_cyclic_hz=600.0, window_length=length)
        window = np.hanning(length + 1)[:-1]
        centred = self.SHORT - self.SHORT.mean()
        for k in (0, 1, 7, found.cyclic_hz.size // 2, found.cyclic_hz.size - 1):
            expected = brute_force(
                centred,
                window=window,
                hop=found.hop,
                frames=found.frames,
                scanned=int(np.ceil(600.0 * length / RATE_HZ)),
                cyclic_hz=found.cyclic_hz[k],
            )
            # sums of some thousand terms
            np.testing.assert_allclose(found.correlation[:, k], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


class TestEnvelopeSpectra:
    def test_lines_of_the_modulation_and_no_others(self, modulated):
        found = enhanced_envelope_spectrum(modulated)
        beyond = found.cyclic_hz > 20
        top = found.cyclic_hz[beyond][np.argsort(found.value[beyond])[-1]]
        assert top == pytest.approx(ALPHA_HZ, abs=found.cyclic_bin_hz)
        away = beyond & (np.abs(found.cyclic_hz - ALPHA_HZ) > 1) & (np.abs(found.cyclic_hz - 2 * ALPHA_HZ) > 1)
        # mean magnitudes of 65 lines of noise: six of their scatter of a tenth
        assert found.value[away].max() < 1.8 * found.floor
        assert found.value.max() <= 1.2

    @pytest.mark.parametrize("length", [64, 256])
    def test_noise_leaves_what_the_docstring_says(self, length):
        found = spectral_correlation(NOISE, rate_hz=RATE_HZ, max_cyclic_hz=400.0, window_length=length)
        left = np.sqrt(np.mean(np.abs(found.coherence()[4:-4, 1:]) ** 2))
        assert left == pytest.approx(0.65 * np.sqrt(length / (found.frames * found.hop)), rel=0.1)

    def test_a_band_without_lines_is_refused(self, modulated):
        with pytest.raises(ValueError, match=r"band_hz = \(100, 110\) holds no spectral line"):
            improved_envelope_spectrum(modulated, band_hz=(100.0, 110.0))


class TestHardCases:
    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"x": NOISE[:300]}, "the record holds .* frames of 256 samples"),
            ({"window_length": 255}, "window_length=255 must be even"),
            ({"max_cyclic_hz": 2000.0}, "max_cyclic_hz=2000 must be at most 1250 Hz"),
        ],
    )
    def test_refusals(self, changes, words):
        arguments = {"x": NOISE[:5000], "rate_hz": RATE_HZ, "max_cyclic_hz": 100.0} | changes
        with pytest.raises(ValueError, match=words):
            spectral_correlation(arguments.pop("x"), **arguments)


def test_measured_inner_race(real_data):
    x = loadmat(real_data / "cwru" / "IR007_0.mat")["X105_DE_time"].ravel()
    correlation = spectral_correlation(x, rate_hz=12_000, max_cyclic_hz=400.0, window_length=128)
    race = 5.4152 * 1797 / 60
    band = choose_band(x, rate_hz=12_000, modulation_hz=3 * race).band_hz
    for found in (enhanced_envelope_spectrum(correlation), improved_envelope_spectrum(correlation, band_hz=band)):
        beyond = np.flatnonzero(found.cyclic_hz > 100)
        top = beyond[np.argmax(found.value[beyond])]
        multiple = found.cyclic_hz[top] / race
        assert multiple == pytest.approx(round(multiple), abs=0.01)
        assert found.value[top] > 4 * found.floor
