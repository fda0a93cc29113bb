"""Amplitude spectra against tones of known height and the published figures of the windows."""

import numpy as np
import pytest

from signals.resampling import AngularSignal
from signals.spectra import PADDING, amplitude_spectrum, order_spectrum

COUNT = 4096
RATE = 1000.0
# Harris 1978, table 1: -3 dB width and equivalent noise bandwidth in bins, two decimals
HARRIS = {"boxcar": (0.89, 1.00), "hann": (1.44, 1.50), "hamming": (1.30, 1.36), "blackman": (1.68, 1.73)}


def tone(bins, amplitude=1.0, start=0.4, count=COUNT):
    """`bins` cycles in the record."""
    return amplitude * np.cos(2 * np.pi * bins * np.arange(count) / count + start)


class TestAmplitude:
    @pytest.mark.parametrize("window", HARRIS)
    @pytest.mark.parametrize("amplitude", [1.0, 1e-6, 350.0])
    def test_a_tone_on_the_grid(self, window, amplitude):
        spectrum = amplitude_spectrum(tone(400, amplitude), rate=RATE, window=window)
        top = np.argmax(spectrum.amplitude)
        assert spectrum.axis[top] == pytest.approx(400 * RATE / COUNT, rel=1e-14)
        # the leakage of the negative frequency, 800 bins away: 4e-4 of a box, far less of the others
        assert spectrum.amplitude[top] == pytest.approx(amplitude, rel=5e-4 if window == "boxcar" else 1e-6)

    @pytest.mark.parametrize("offset", [1 / 16, 0.3, 0.5, -0.21])
    def test_a_tone_between_bins(self, offset):
        spectrum = amplitude_spectrum(tone(400 + offset), rate=RATE)
        # at most a sixteenth of a bin from the grid; Hann's lobe sinc(x) / (1 - x^2) has lost 0.252 % there
        worst = np.sinc(1 / 16) / (1 - 1 / 256)
        assert worst - 1e-6 <= spectrum.amplitude.max() <= 1 + 1e-6
        assert spectrum.axis[np.argmax(spectrum.amplitude)] == pytest.approx(
            (400 + offset) * RATE / COUNT, abs=0.51 * RATE / COUNT / PADDING
        )

    def test_the_mean_is_removed(self):
        raised = amplitude_spectrum(tone(400) + 1e3, rate=RATE)
        # 1e3 is rounded to 1e-13, and so is its difference
        np.testing.assert_allclose(raised.amplitude, amplitude_spectrum(tone(400), rate=RATE).amplitude, atol=1e-12)

    def test_two_tones_keep_their_own_heights(self):
        spectrum = amplitude_spectrum(tone(400) + tone(420, 1e-3), rate=RATE)
        # Hann's sidelobes fall with the third power: below 1e-4 after twenty bins
        assert spectrum.amplitude[420 * PADDING] == pytest.approx(1e-3, rel=0.1)

    def test_noise_power_spreads_over_the_noise_bandwidth(self):
        rng = np.random.default_rng(3)
        powers = []
        for _ in range(50):
            spectrum = amplitude_spectrum(2 * rng.standard_normal(COUNT), rate=RATE)
            powers.append(np.mean(spectrum.amplitude[8 * PADDING : -8 * PADDING] ** 2))
        # E A^2 = 4 sigma^2 ENBW / n; 50 x 2048 bins of which two thirds are independent know it to 0.4 %, times 4
        assert np.mean(powers) == pytest.approx(4 * 2**2 * 1.5 / COUNT, rel=0.016)


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

    @pytest.mark.parametrize("window", HARRIS)
    def test_measured_on_a_tone(self, window):
        spectrum = amplitude_spectrum(tone(400), rate=RATE, window=window, padding=200)
        above = np.flatnonzero(spectrum.amplitude >= spectrum.amplitude.max() / np.sqrt(2))
        # counted on a grid of a two-hundredth of a bin: within one step
        measured = (above[-1] - above[0] + 1) * spectrum.bin_width / 200
        assert spectrum.resolution == pytest.approx(measured, abs=spectrum.bin_width / 200)

    def test_spread_of_the_squared_window(self):
        # integrals over x in (-1/2, 1/2): 1/12 of a box; of cos^4(pi x) by its three cosines
        cosine = {k: (-1) ** k / (2 * np.pi**2 * k**2) for k in (1, 2)}
        hann = (3 / 8 / 12 + cosine[1] / 2 + cosine[2] / 8) / (3 / 8)
        for window, expected in (("boxcar", 1 / 12), ("hann", hann)):
            # a sum for an integral, over a periodic window half a sample off its middle: some 1/n^2
            assert amplitude_spectrum(tone(9), rate=RATE, window=window).spread == pytest.approx(expected, rel=1e-6)

    @pytest.mark.parametrize("padding", [1, 3, 8])
    def test_grid(self, padding):
        spectrum = amplitude_spectrum(tone(400), rate=RATE, padding=padding)
        np.testing.assert_allclose(np.diff(spectrum.axis), spectrum.bin_width / padding, rtol=1e-9)
        assert spectrum.axis[0] == 0
        assert spectrum.axis[-1] == pytest.approx(RATE / 2, abs=RATE / COUNT / padding)

    def test_maximum(self):
        spectrum = amplitude_spectrum(tone(400), rate=RATE, maximum=100.0)
        assert 100.0 - spectrum.bin_width / PADDING < spectrum.axis[-1] <= 100.0
        assert spectrum.axis.size == spectrum.amplitude.size


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
            ({"values": np.ones((4, 4))}, "one real"),
            ({"rate": 0.0}, "rate"),
            ({"rate": float("nan")}, "rate"),
            ({"padding": 0}, "padding=0 must be a whole number"),
            ({"padding": 1.5}, "padding"),
            ({"window": "hahn"}, "window"),
        ],
    )
    def test_inputs(self, changes, words):
        arguments = {"values": tone(4, count=64), "rate": RATE} | changes
        with pytest.raises(ValueError, match=words):
            amplitude_spectrum(arguments.pop("values"), **arguments)
