"""Amplitude spectra against tones of known height and the published figures of the windows."""

import numpy as np
import pytest
from scipy.signal import welch

from signals.resampling.resampling import AngularSignal
from signals.spectra.spectra import (
    PADDING,
    amplitude_spectrum,
    averaged_spectrum,
    order_spectra,
    order_spectrum,
)

COUNT = 4096
RATE = 1000.0
# Harris 1978, table 1: -3 dB width and equivalent noise bandwidth in bins, two decimals
HARRIS = {"boxcar": (0.89, 1.00), "hann": (1.44, 1.50), "hamming": (1.30, 1.36), "blackman": (1.68, 1.73)}


def tone(bins, amplitude=1.0, start=0.4, count=COUNT):
    """`bins` cycles in the record."""
    return amplitude * np.cos(2 * np.pi * bins * np.arange(count) / count + start)


class TestAmplitude:
    @pytest.mark.parametrize("offset", [1 / 16, 0.3, 0.5])
    def test_a_tone_between_bins(self, offset):
        spectrum = amplitude_spectrum(tone(400 + offset), rate=RATE)
        # at most a sixteenth of a bin from the grid; Hann's lobe sinc(x) / (1 - x^2) has lost 0.252 % there
        worst = np.sinc(1 / 16) / (1 - 1 / 256)
        assert worst - 1e-6 <= spectrum.amplitude.max() <= 1 + 1e-6
        assert spectrum.axis[np.argmax(spectrum.amplitude)] == pytest.approx(
            (400 + offset) * RATE / COUNT, abs=0.51 * RATE / COUNT / PADDING
        )


class TestResolution:
    @pytest.mark.parametrize("window", HARRIS)
    def test_published_widths(self, window):
        width, bandwidth = HARRIS[window]
        spectrum = amplitude_spectrum(tone(400), rate=RATE, window=window)
        assert spectrum.bin_width == RATE / COUNT
        # one unit of the second decimal: Blackman's exact width is 1.64, and Harris has the truncated coefficients
        assert spectrum.resolution / spectrum.bin_width == pytest.approx(
            width, abs=0.05 if window == "blackman" else 0.01
        )
        assert spectrum.noise_bandwidth_bins == pytest.approx(bandwidth, abs=5e-3)

    @pytest.mark.parametrize("padding", [1, 8])
    def test_a_length_with_a_large_prime_factor(self, padding):
        # the windowed sum itself at the positions of the axis, whatever their step
        count = 4 * 79
        values = np.random.default_rng(1).standard_normal(count)
        spectrum = amplitude_spectrum(values, rate=1.0, padding=padding)
        weights = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count)
        sums = np.exp(-2j * np.pi * np.outer(spectrum.axis, np.arange(count))) @ (weights * (values - values.mean()))
        np.testing.assert_allclose(spectrum.complex_amplitude, 2 * sums / weights.sum(), atol=1e-12)
        assert spectrum.bin_width == 1 / count
        assert 1 <= spectrum.bin_width / spectrum.axis[1] / padding < 1.05


class TestOrders:
    @pytest.mark.parametrize(("max_order", "last"), [(None, 28.16), (10.0, 10.0), (99.0, 28.16)])
    def test_up_to_the_passband(self, max_order, last):
        signal = AngularSignal(
            values=2 * np.cos(3.5 * 2 * np.pi * np.arange(6400) / 64),
            samples_per_rev=64,
            start_rev=5.0,
            passband_orders=28.16,
        )
        spectrum = order_spectrum(signal, max_order=max_order)
        assert last - 0.01 / PADDING < spectrum.axis[-1] <= last
        assert spectrum.bin_width == 0.01  # one over 100 revolutions
        assert spectrum.axis[np.argmax(spectrum.amplitude)] == pytest.approx(3.5, rel=1e-12)
        assert spectrum.amplitude.max() == pytest.approx(2, rel=1e-6)


class TestRefusals:
    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"values": [1.0, np.nan, 0, 0, 0]}, "the signal has 1 values that are not finite"),
            ({"values": [1.0, 2, 3]}, "at least 4"),
            ({"values": np.ones((4, 4))}, "real array"),
            ({"maximum": -1.0}, "maximum=-1.0 must be above zero"),
            ({"padding": 0}, "padding=0 must be a whole number"),
            ({"window": "hahn"}, "window"),
        ],
    )
    def test_inputs(self, changes, words):
        arguments = {"values": tone(4, count=64), "rate": RATE} | changes
        with pytest.raises(ValueError, match=words):
            amplitude_spectrum(arguments.pop("values"), **arguments)


class TestPhase:
    @pytest.mark.parametrize("window", HARRIS)
    @pytest.mark.parametrize("start", [0.0, 2.75])
    def test_of_a_tone(self, window, start):
        frequency, phase = 400 * RATE / COUNT, 0.7
        times = start + np.arange(COUNT) / RATE
        spectrum = amplitude_spectrum(
            3 * np.cos(2 * np.pi * frequency * times + phase), rate=RATE, window=window, start=start
        )
        # the leakage of the negative frequency, 800 bins away, is 4e-4 of a box and far less of the others
        assert spectrum.phase_rad[400 * PADDING] == pytest.approx(phase, abs=5e-4 if window == "boxcar" else 1e-6)
        assert spectrum.complex_amplitude[400 * PADDING] == pytest.approx(
            3 * np.exp(1j * phase), rel=7e-4 if window == "boxcar" else 1e-6
        )


class TestAveraged:
    NOISE = np.random.default_rng(11).standard_normal(200_000)

    @pytest.mark.parametrize(
        ("segment", "window", "overlap", "noverlap"),
        [(256, "boxcar", 0.0, 0), (255, "boxcar", 0.0, 0), (256, "hann", 0.5, 128), (256, "blackman", 0.75, 192)],
    )
    def test_density_is_that_of_scipy(self, segment, window, overlap, noverlap):
        x = self.NOISE[:10_000] + 5
        found = averaged_spectrum(x, rate=RATE, segment=segment, overlap=overlap, window=window)
        axis, density = welch(x - x.mean(), RATE, window=window, nperseg=segment, noverlap=noverlap, detrend=False)
        np.testing.assert_allclose(found.axis, axis, rtol=1e-14)
        np.testing.assert_allclose(found.value, density, rtol=1e-9)  # rounding of sums of 1e4 terms

    @pytest.mark.parametrize("window", HARRIS)
    def test_a_tone_reads_its_height(self, window):
        x = tone(256, 3.0)
        peak, rms, density = (
            averaged_spectrum(x, rate=RATE, segment=512, window=window, scaling=scaling)
            for scaling in ("peak", "rms", "density")
        )
        # 32 cycles a segment; the image 64 bins away is 1/200 of a box, which the average over phases squares
        tolerance = 1e-2 if window == "boxcar" else 1e-4
        assert peak.value[32] == pytest.approx(3, rel=tolerance)
        assert rms.value[32] == pytest.approx(3 / np.sqrt(2), rel=tolerance)
        # power over the published equivalent noise bandwidth
        bandwidth = HARRIS[window][1] * RATE / 512
        assert density.value[32] == pytest.approx(4.5 / bandwidth, rel=5e-3 + tolerance)
        assert density.noise_bandwidth == pytest.approx(bandwidth, rel=5e-3)
        assert peak.resolution == pytest.approx(
            HARRIS[window][0] * RATE / 512, abs=0.05 * RATE / 512 if window == "blackman" else 0.01 * RATE / 512
        )

    @pytest.mark.parametrize(("overlap", "window"), [(0.0, "boxcar"), (0.5, "hann"), (0.75, "boxcar")])
    def test_the_interval_holds_the_truth_as_often_as_it_says(self, overlap, window):
        hits, lines = 0, 0
        for part in self.NOISE.reshape(50, -1):
            found = averaged_spectrum(part, rate=2.0, segment=128, overlap=overlap, window=window)
            inside = (found.low < 1) & (found.high > 1)  # white, of variance 1 and rate 2: density 1
            hits, lines = hits + int(inside[3:-3].sum()), lines + inside[3:-3].size
        # 50 x 59 lines, a good third of them independent: 0.95 +- 0.007, times three; a sum of correlated exponentials
        # is a chi-square to about a hundredth
        assert hits / lines == pytest.approx(0.95, abs=0.03)

    def test_published_degrees_of_freedom(self):
        # Welch 1967: Hann at half overlap, rho = 1/6: 2 K / (1 + 2 (1 - 1/K) / 36), about 1.89 K
        found = averaged_spectrum(self.NOISE, rate=1.0, segment=2000)
        count = found.averages
        assert count == 199
        assert found.degrees_of_freedom == pytest.approx(2 * count / (1 + 2 * (1 - 1 / count) / 36), rel=1e-5)

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"segment": 65}, "segment=65 must be a whole number from 4 to 64"),
            ({"overlap": 1.0}, "overlap=1.0 must be at least 0 and below 1"),
            ({"scaling": "power"}, "scaling='power' is unknown"),
        ],
    )
    def test_refusals(self, changes, words):
        arguments = {"values": tone(4, count=64), "rate": RATE, "segment": 16} | changes
        with pytest.raises(ValueError, match=words):
            averaged_spectrum(arguments.pop("values"), **arguments)


@pytest.mark.parametrize("unit", [1.0, 1e100, 1e-100])
def test_spectra_in_single_precision_err_by_a_millionth_of_the_largest_sample(unit):
    turns = np.arange(64 * 1000) / 64
    noise = np.random.default_rng(1).standard_normal(turns.size)
    rows = [unit * (100 + noise), unit * (100 + 5 * np.cos(2 * np.pi * 7 * turns) + 1e-3 * noise)]
    signals = [AngularSignal(values=row, samples_per_rev=64, start_rev=0.5, passband_orders=28.0) for row in rows]
    for one, exact, row in zip(order_spectra(signals, single=True), order_spectra(signals), rows, strict=True):
        assert one.amplitude.dtype == exact.amplitude.dtype
        error = np.abs(one.complex_amplitude - exact.complex_amplitude).max()
        assert error < 1e-6 * np.abs(row - row.mean()).max()
