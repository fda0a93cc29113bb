"""Envelopes of signals whose analytic form is known, over time and over the angle of a swinging shaft."""

import numpy as np
import pytest

from signals.demodulation.envelope import envelope, envelope_order_spectrum, envelope_spectrum
from signals.shaft.phase import ShaftPhase
from signals.spectra.spectra import amplitude_spectrum

RATE_HZ = 10_000.0
TIMES = np.arange(10_000) / RATE_HZ  # one second: whole frequencies in hertz are periodic in it
ROUNDING = 1e-10  # angles up to 1.6e4 rad are rounded to 2e-12, under amplitudes that add up to 22


def cosine(frequency_hz, start=0.0):
    return np.cos(2 * np.pi * frequency_hz * TIMES + start)


class TestEnvelope:
    @pytest.mark.parametrize("depth", [0.0, 0.9])
    def test_amplitude_modulation(self, depth):
        modulation = 1 + depth * cosine(37, 0.8)
        signal = 2.5 * modulation * cosine(2000, 1.1)
        # carrier and both sidebands fill whole bins within the band
        np.testing.assert_allclose(
            envelope(signal, rate_hz=RATE_HZ, band_hz=(1500, 2500)), 2.5 * modulation, rtol=0, atol=ROUNDING
        )

    def test_what_lies_outside_the_band_is_gone(self):
        signal = cosine(2000) + 5 * cosine(1400, 0.3) + 7 * cosine(2600) + 9
        np.testing.assert_allclose(envelope(signal, rate_hz=RATE_HZ, band_hz=(1401, 2599)), 1, rtol=0, atol=ROUNDING)

    @pytest.mark.parametrize(
        ("band", "words"),
        [
            ((3000, 2000), "must rise"),
            ((1000, 5001), "between 0 and 5000 Hz"),
        ],
    )
    def test_bands(self, band, words):
        with pytest.raises(ValueError, match=words):
            envelope(cosine(2000), rate_hz=RATE_HZ, band_hz=band)


class TestOverAngle:
    def test_a_modulation_tied_to_the_shaft_is_sharp_in_orders(self, swinging):
        """A 9 kHz resonance modulated 3.5848 times a revolution, as by a bearing, at 45 to 55 Hz."""
        rate_hz, order, depth = 51_200.0, 3.5848, 0.4
        times = np.arange(300_000) / rate_hz
        turned = swinging.revolutions(times).astype(float)
        signal = (1 + depth * np.cos(2 * np.pi * order * turned)) * np.cos(2 * np.pi * 9000 * times)
        phase = ShaftPhase(times_s=swinging.times_at(np.arange(320)), revolutions=np.arange(320.0))
        spectrum = envelope_order_spectrum(
            signal, rate_hz=rate_hz, band_hz=(8000, 10_000), phase=phase, samples_per_rev=128, max_order=20
        )
        top = np.argmax(spectrum.amplitude)
        assert spectrum.axis[-1] <= 20
        # between two points of the grid, an eighth of a bin apart
        assert abs(spectrum.axis[top] - order) < spectrum.bin_width / 8
        # at worst 0.25 % below its height; the record's ends, where the band's sharp edges ring, weigh little
        assert spectrum.amplitude[top] == pytest.approx(depth, rel=4e-3)
        # nothing else: neither harmonics nor smear
        far = np.abs(spectrum.axis - order) > 5 * spectrum.bin_width
        assert spectrum.amplitude[far].max() < 0.01 * depth
        # over frequency the same line is smeared over 45 to 55 Hz times 3.58
        smeared = amplitude_spectrum(
            envelope(signal, rate_hz=rate_hz, band_hz=(8000, 10_000)), rate=rate_hz, maximum=1000
        )
        assert smeared.amplitude.max() < 0.4 * depth


class TestSpectrum:
    M = 0.6

    def height(self, spectrum, frequency):
        return spectrum.amplitude[np.argmin(np.abs(spectrum.axis - frequency))]

    def test_of_a_modulated_tone(self):
        x = 2.5 * (1 + self.M * cosine(40)) * cosine(2000)
        settings = {"rate_hz": RATE_HZ, "band_hz": (1500.0, 2500.0), "maximum_hz": 500.0}
        squared = envelope_spectrum(x, **settings)
        # (1 + m cos)^2 = 1 + m^2/2 + 2 m cos + m^2/2 cos 2; lines on the grid, 40 bins apart
        assert self.height(squared, 40) == pytest.approx(2.5**2 * 2 * self.M, rel=1e-6)
        assert self.height(squared, 80) == pytest.approx(2.5**2 * self.M**2 / 2, rel=1e-6)
        relative = envelope_spectrum(x, relative=True, **settings)
        assert self.height(relative, 40) == pytest.approx(2 * self.M / (1 + self.M**2 / 2), rel=1e-6)
        assert self.height(envelope_spectrum(x, squared=False, **settings), 40) == pytest.approx(2.5 * self.M, rel=1e-6)
        plain = envelope_spectrum(x, squared=False, relative=True, **settings)
        assert self.height(plain, 40) == pytest.approx(self.M, rel=1e-6)
        assert squared.axis[-1] <= 500

    def test_an_empty_band_is_refused_where_it_would_divide(self):
        with pytest.raises(ValueError, match="the envelope of the band is zero"):
            envelope_spectrum(np.full(1000, 3.0), rate_hz=RATE_HZ, band_hz=(1000.0, 2000.0), relative=True)


class TestHardCases:
    def test_half_the_sampling_rate_has_no_mirror_image(self):
        alternating = 3 * (-1.0) ** np.arange(1000)
        np.testing.assert_allclose(envelope(alternating, rate_hz=RATE_HZ, band_hz=(4000, 5000)), 3, rtol=1e-12)


def test_the_envelope_of_single_precision_samples():
    rng = np.random.default_rng(8)
    x = rng.standard_normal(100_003).astype(np.float32) + np.float32(20)  # prime, and on an offset
    single = envelope(x, rate_hz=1000.0, band_hz=(100.0, 200.0))
    assert single.dtype == np.float32
    exact = envelope(x.astype(np.float64), rate_hz=1000.0, band_hz=(100.0, 200.0))
    np.testing.assert_allclose(single, exact, rtol=0, atol=1e-6 * float(x.std()))
