"""Envelopes of signals whose analytic form is known, over time and over the angle of a swinging shaft."""

import numpy as np
import pytest

from signals.envelope import envelope, envelope_order_spectrum
from signals.phase import ShaftPhase
from signals.spectra import amplitude_spectrum

RATE_HZ = 10_000.0
TIMES = np.arange(10_000) / RATE_HZ  # one second: whole frequencies in hertz are periodic in it
ROUNDING = 2e-11  # angles up to 1.6e4 rad are rounded to 2e-12, under amplitudes up to 9


def cosine(frequency_hz, start=0.0):
    return np.cos(2 * np.pi * frequency_hz * TIMES + start)


class TestEnvelope:
    @pytest.mark.parametrize("depth", [0.0, 0.3, 0.9])
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

    def test_edges_belong_to_the_band(self):
        signal = cosine(1500) + cosine(2500)
        beat = np.abs(1 + np.exp(2j * np.pi * 1000 * TIMES))
        np.testing.assert_allclose(envelope(signal, rate_hz=RATE_HZ, band_hz=(1500, 2500)), beat, rtol=0, atol=ROUNDING)

    def test_two_tones_beat(self):
        beat = np.abs(1 + 0.4 * np.exp(1j * (2 * np.pi * 55 * TIMES + 0.2)))
        signal = cosine(2000) + 0.4 * cosine(2055, 0.2)
        np.testing.assert_allclose(envelope(signal, rate_hz=RATE_HZ, band_hz=(1900, 2100)), beat, rtol=0, atol=ROUNDING)

    def test_phase_modulation_leaves_the_envelope_flat(self):
        signal = np.cos(2 * np.pi * 2000 * TIMES + 2.0 * np.sin(2 * np.pi * 30 * TIMES))
        # sidebands beyond the thirtieth, 900 Hz away: J_30(2) is below 1e-30
        np.testing.assert_allclose(envelope(signal, rate_hz=RATE_HZ, band_hz=(1000, 3000)), 1, rtol=0, atol=ROUNDING)

    @pytest.mark.parametrize(
        ("band", "words"),
        [
            ((2000, 2000), "must rise"),
            ((3000, 2000), "must rise"),
            ((-1, 2000), "between 0 and 5000 Hz"),
            ((1000, 5001), "between 0 and 5000 Hz"),
            ((float("nan"), 2000), "must rise"),
        ],
    )
    def test_bands(self, band, words):
        with pytest.raises(ValueError, match=words):
            envelope(cosine(2000), rate_hz=RATE_HZ, band_hz=band)

    def test_no_number_passes_silently(self):
        with pytest.raises(ValueError, match="index 3"):
            envelope([0.0, 1, 2, np.nan, 4], rate_hz=RATE_HZ, band_hz=(1, 2))


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
