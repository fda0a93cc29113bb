"""The chosen band: on records whose resonance is known, on what must not mislead, and on measured bearings."""

import numpy as np
import pytest
from scipy.io import loadmat

from signals.demodulation.band_selection import choose_band
from signals.demodulation.envelope import envelope_spectrum
from signals.spectra.lines import find_line

RATE_HZ = 20_000.0
COUNT = 100_000
TIMES = np.arange(COUNT) / RATE_HZ
NOISE = np.random.default_rng(7).standard_normal(COUNT)
RING = np.exp(-2 * np.pi * 150 * TIMES[:600]) * np.sin(2 * np.pi * 7300 * TIMES[:600])


def impulses(at):
    """Impulses at some samples, ringing at 7300 Hz."""
    hits = np.zeros(COUNT)
    hits[at] = 1.0
    return np.convolve(hits, RING)[:COUNT]


REGULAR = impulses(np.arange(500, COUNT - 600, 400))  # 50 Hz


def line_at_50(x, band):
    spectrum = envelope_spectrum(x, rate_hz=RATE_HZ, band_hz=band.band_hz, maximum_hz=300)
    return find_line(spectrum, expected=50.0, background_width=30)


class TestChoice:
    def test_finds_the_resonance_and_says_why(self):
        x = 4 * REGULAR + NOISE
        band = choose_band(x, rate_hz=RATE_HZ, modulation_hz=150)
        assert band.low_hz < 7300 < band.high_hz
        assert band.high_hz - band.low_hz >= 150
        assert band.kurtosis > 10 * band.noise_std
        assert f"{band.low_hz:g}-{band.high_hz:g} Hz: its steady kurtosis of" in band.why
        assert line_at_50(x, band).snr > 10
        assert not band.doubts

    def test_one_spike_does_not_choose(self):
        x = 4 * REGULAR + NOISE
        x[77_777:77_779] += [3000.0, 3000.0]  # loudest at the low end
        band = choose_band(x, rate_hz=RATE_HZ, modulation_hz=150)
        assert band.low_hz < 7300 < band.high_hz
        # with the spike cut out, as a single event can be, the band shows the rate
        assert line_at_50(4 * REGULAR + NOISE, band).snr > 10
        # plain kurtosis goes elsewhere, and both the reason and the doubts say so
        assert band.by_kurtosis.band_hz != band.band_hz
        assert f"Plain kurtosis would choose {band.by_kurtosis}" in band.why
        assert any(doubt.startswith("A single event accounts for most of the kurtosis") for doubt in band.doubts)

    def test_a_spike_in_noise_is_nothing(self):
        x = NOISE.copy()
        x[50_000] += 500
        band = choose_band(x, rate_hz=RATE_HZ)
        assert any(doubt.startswith("This may be stationary noise") for doubt in band.doubts)
        assert band.by_kurtosis.kurtosis > 100

    @pytest.mark.parametrize("frequency", [50.0, 7900.0])
    def test_a_tone_does_not_choose(self, frequency):
        x = 4 * REGULAR + NOISE + 30 * np.cos(2 * np.pi * frequency * TIMES)
        band = choose_band(x, rate_hz=RATE_HZ, modulation_hz=150)
        assert not band.low_hz <= frequency <= band.high_hz
        assert line_at_50(x, band).snr > 5
        assert any("A steady tone fills" in doubt for doubt in band.doubts)

    def test_tones_that_beat_do_not_choose(self):
        beating = 10 * (np.cos(2 * np.pi * 2000 * TIMES) + np.cos(2 * np.pi * 2040 * TIMES))
        band = choose_band(4 * REGULAR + NOISE + beating, rate_hz=RATE_HZ, modulation_hz=150)
        assert band.low_hz < 7300 < band.high_hz
        # one line of the squared envelope is not many
        assert band.by_negentropy.low_hz < 7300 < band.by_negentropy.high_hz

    def test_a_quieter_band_that_repeats_more_regularly_is_named(self):
        at_random = np.random.default_rng(3).integers(0, COUNT - 600, 250)
        low = np.cos(2 * np.pi * 4800 * TIMES) * REGULAR  # 7300 Hz down to 2500 (and up to where it folds)
        band = choose_band(8 * impulses(at_random) + 4 * low + NOISE, rate_hz=RATE_HZ)
        assert band.low_hz < 7300 < band.high_hz
        assert band.by_negentropy.low_hz < 2500 < band.by_negentropy.high_hz
        assert any("Another band has a more periodic envelope" in doubt for doubt in band.doubts)

    def test_impulses_at_random_are_said_to_be_such(self):
        at = np.random.default_rng(3).integers(0, COUNT - 600, 250)
        band = choose_band(8 * impulses(at) + NOISE, rate_hz=RATE_HZ)
        assert band.low_hz < 7300 < band.high_hz
        assert any(doubt.startswith("The impulses are not periodic") for doubt in band.doubts)

    @pytest.mark.parametrize("seed", range(2))
    def test_noise_is_said_to_be_noise(self, seed):
        band = choose_band(np.random.default_rng(seed).standard_normal(50_000), rate_hz=RATE_HZ)
        assert [doubt.split(":")[0] for doubt in band.doubts][:2] == [
            "This may be stationary noise",
            "The impulses are not periodic",
        ]


class TestHardCases:
    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"x": np.full(5000, 3.0)}, "the signal is constant"),
            ({"x": NOISE[:500]}, "at least 640"),
            ({"modulation_hz": 20_000.0}, "modulation_hz=20000 is wider than every band"),
        ],
    )
    def test_refusals(self, changes, words):
        arguments = {"x": NOISE[:5000], "rate_hz": RATE_HZ} | changes
        with pytest.raises(ValueError, match=words):
            choose_band(arguments.pop("x"), **arguments)


# Multiples of the shaft's speed by the bearings' geometry: 9 balls of 0.3126 in on 1.537 in; 8 of 0.235 in on 1.245 in
RIG = {"inner": 5.4152, "outer": 3.5848, "ball": 4.7135}
NICE = {"inner": 4.755, "outer": 3.245}


def lines_of(x, rate_hz, shaft_hz, races, tolerance):
    """Each race's false-alarm probability and height over the background, in the band chosen."""
    band = choose_band(x, rate_hz=rate_hz, modulation_hz=3 * shaft_hz * max(races.values()))
    spectrum = envelope_spectrum(x, rate_hz=rate_hz, band_hz=band.band_hz, maximum_hz=1000)
    return band, {
        race: find_line(spectrum, expected=at * shaft_hz, tolerance=tolerance * at * shaft_hz, background_width=30)
        for race, at in races.items()
    }


@pytest.mark.parametrize(
    ("name", "channel", "rpm", "race"),
    [("IR007_0", "X105_DE_time", 1797, "inner"), ("OR007@6_0", "X130_DE_time", 1796, "outer")],
)
def test_rig_shows_the_right_race(real_data, name, channel, rpm, race):
    x = loadmat(real_data / "cwru" / f"{name}.mat")[channel].ravel()
    band, lines = lines_of(x, 12_000, rpm / 60, RIG, 0.01)
    assert lines[race].false_alarm_probability < 1e-100
    assert lines[race].snr > 50
    assert all(lines[race].amplitude > 8 * line.amplitude for other, line in lines.items() if other != race)
    assert band.steady_kurtosis > 50 * band.noise_std


def test_rig_healthy_shows_nothing(real_data):
    x = loadmat(real_data / "cwru" / "normal_0.mat")["X097_DE_time"].ravel()
    _, lines = lines_of(x, 48_000, 1796 / 60, RIG, 0.01)
    for line in lines.values():
        assert line.false_alarm_probability > 0.01
        assert line.snr < 4


@pytest.mark.parametrize(("name", "race"), [("InnerRaceFault_vload_1", "inner"), ("OuterRaceFault_vload_1", "outer")])
def test_other_rig_shows_the_right_race(real_data, name, race):
    x = loadmat(real_data / "mfpt" / f"{name}.mat")["bearing"][0, 0]["gs"].ravel()
    _, lines = lines_of(x, 48_828, 25.0, NICE, 0.015)
    assert lines[race].false_alarm_probability < 1e-12
    assert all(lines[race].amplitude > 2.5 * line.amplitude for other, line in lines.items() if other != race)


def test_turbine_finds_the_band_that_was_published(real_data):
    # Bechhoefer, Van Hecke & He 2013 demodulate this bearing from 9 to 11 kHz
    x = loadmat(real_data / "wt_hss_bearing" / "data-20130425T232202Z.mat")["vibration"].ravel()
    band = choose_band(x, rate_hz=97_656, modulation_hz=1200)
    assert band.low_hz < 9000
    assert 11_000 < band.high_hz < 13_000
    assert not band.doubts
