"""Lines in noise: is the stated chance the true one, the stated deviation the true one, and the line where it is?"""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from signals.spectra.lines import (
    Line,
    false_alarm_probability,
    find_line,
    find_lines,
    has_background,
    record_probability,
)
from signals.spectra.spectra import amplitude_spectrum

PER_REV = 32
REVOLUTIONS = 128
COUNT = PER_REV * REVOLUTIONS
HANN_SPREAD = 0.0200077  # second moment of cos^4 over its square: see the test of the spectrum
ORDER = 7.1234


def spectrum(values, window="hann"):
    return amplitude_spectrum(values, rate=PER_REV, window=window, maximum=9.0)


def tone(order=ORDER, amplitude=1.0, start=0.3):
    return amplitude * np.cos(2 * np.pi * order * np.arange(COUNT) / PER_REV + start)


@pytest.fixture(scope="module")
def noise_probabilities():
    """Probabilities stated for 1,200 records of noise alone, by tolerance."""
    rng = np.random.default_rng(2026)
    stated = {0.0: [], 0.2: []}
    for _ in range(1200):
        lines = spectrum(rng.standard_normal(COUNT))
        for tolerance, probabilities in stated.items():
            line = find_line(lines, expected=ORDER, tolerance=tolerance)
            probabilities.append(line.false_alarm_probability)
    return {tolerance: np.array(probabilities) for tolerance, probabilities in stated.items()}


class TestChance:
    @pytest.mark.parametrize("tolerance", [0.0, 0.2])
    @pytest.mark.parametrize("level", [0.1, 0.01])
    def test_noise_alone_is_as_rare_as_stated(self, noise_probabilities, tolerance, level):
        probabilities = noise_probabilities[tolerance]
        alarms = int(np.count_nonzero(probabilities < level))
        # the count is binomial; 99.9 % of it, so that one such test in a thousand fails for no reason
        low, high = stats.binom.interval(0.999, probabilities.size, level)
        assert low <= alarms <= high

    @pytest.mark.parametrize(
        ("degrees", "ratio", "width"), [(4.0, 0.5, 50.0), (4.0, 20.0, 1.0), (30.0, 5.0, 50.0), (300.0, 20.0, 50.0)]
    )
    def test_averaged_over_what_the_mean_may_be(self, degrees, ratio, width):
        # the estimated mean is the true one times a Gamma variable of mean one: Rice's terms averaged by quadrature
        def terms(g):
            u = ratio * g
            return (1 + width * 2 * np.pi * np.sqrt(HANN_SPREAD * u / np.pi)) * np.exp(-u)

        gamma = stats.gamma(degrees, scale=1 / degrees)
        expected, _ = integrate.quad(lambda g: terms(g) * gamma.pdf(g), 0, 1 + 40 / np.sqrt(degrees), limit=400)
        found = false_alarm_probability(ratio, width_bins=width, spread=HANN_SPREAD, background_degrees=degrees)
        assert found == pytest.approx(-math.expm1(-expected), rel=1e-6)  # quadrature

    @pytest.mark.parametrize(("single", "searches"), [(0.05, 20), (1.0, 4), (0.0, 9)])
    def test_of_many_searches(self, single, searches):
        assert record_probability(single, searches=searches) == pytest.approx(1 - (1 - single) ** searches, rel=1e-14)


class TestAmplitudeAt:
    @pytest.mark.parametrize("revolutions", [8, REVOLUTIONS])
    def test_a_line_of_that_amplitude_has_that_probability(self, revolutions):
        values = np.random.default_rng(3).normal(size=PER_REV * revolutions)
        line = find_line(amplitude_spectrum(values, rate=PER_REV, maximum=9.0), expected=ORDER, tolerance=0.1)
        found = line.amplitude_at(1e-4)
        stated = false_alarm_probability(
            (found / line.noise) ** 2 * math.log(2),
            width_bins=line.width_bins,
            spread=line.spread,
            background_degrees=line.noise_degrees,
        )
        with pytest.raises(ValueError, match="probability=0"):
            line.amplitude_at(0)
        assert stated == pytest.approx(1e-4, rel=1e-6)


class TestFoundLine:
    @pytest.mark.parametrize("order", [7.1234, 3.0])
    def test_where_it_is(self, order):
        rng = np.random.default_rng(11)
        values = tone(order) + 0.1 * rng.standard_normal(COUNT)
        line = find_line(spectrum(values), expected=order + 0.05, tolerance=0.1)
        # noise moves a tone by at least sqrt(6 / n) sigma / (pi A) bins (Rife and Boorstyn 1974), 1.2e-3 here, and
        # with a Hann window by half as much again; four of these, and a parabola's 1e-4
        assert abs(line.found - order) * REVOLUTIONS < 7.5e-3
        assert abs(line.amplitude - 1) < 4 * line.amplitude_std
        assert line.false_alarm_probability < 1e-100
        assert line.expected == order + 0.05

    def test_the_stated_deviation_is_the_true_one(self):
        rng = np.random.default_rng(12)
        noise = 0.5
        found = [find_line(spectrum(tone() + noise * rng.standard_normal(COUNT)), expected=ORDER) for _ in range(600)]
        amplitudes = np.array([line.amplitude for line in found])
        stated = np.array([line.amplitude_std for line in found])
        # real part of white noise through a window: sigma sqrt(2 ENBW / n)
        assert np.median(stated) == pytest.approx(noise * math.sqrt(2 * 1.5 / COUNT), rel=0.02)
        # a deviation from 600 is known to 1 / sqrt(1200); four of these
        assert amplitudes.std() == pytest.approx(float(np.mean(stated)), rel=4 / math.sqrt(1200))
        assert amplitudes.mean() == pytest.approx(1, abs=0.01)

    def test_only_within_the_tolerance(self):
        rng = np.random.default_rng(13)
        lines = spectrum(tone(7.0) + 0.05 * rng.standard_normal(COUNT))
        assert find_line(lines, expected=7.19, tolerance=0.2).found == pytest.approx(7.0, abs=1e-3)
        missed = find_line(lines, expected=7.35, tolerance=0.2)
        assert abs(missed.found - 7.35) <= 0.2 + lines.bin_width / 8
        assert missed.amplitude < 0.05

    def test_silence_holds_no_line(self):
        line = find_line(spectrum(np.zeros(COUNT)), expected=ORDER)
        assert isinstance(line, Line)
        assert (line.amplitude, line.background, line.snr) == (0, 0, 0)
        assert line.false_alarm_probability == 1


class TestRefusals:
    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ({"expected": 9.1}, "a line at 9.1 .* lies beyond the end of the spectrum at 9"),
            ({"expected": 8.9, "tolerance": 0.2}, "beyond the end"),
            ({"expected": 5.0, "tolerance": -0.1}, "tolerance=-0.1"),
            ({"expected": 5.0, "background_width": 0.05}, "bins of background surround the line at 5, where 8"),
        ],
    )
    def test_arguments(self, arguments, words):
        with pytest.raises(ValueError, match=words):
            find_line(spectrum(tone()), **arguments)

    def test_a_short_record(self):
        short = amplitude_spectrum(tone()[: 5 * PER_REV], rate=PER_REV)
        with pytest.raises(ValueError, match="the record is too short"):
            find_line(short, expected=ORDER)


class TestTogether:
    @pytest.mark.parametrize("revolutions", [2, 6, 7, 8, 9])
    def test_without_background_every_line_is_refused(self, revolutions):
        values = np.random.default_rng(revolutions).standard_normal(PER_REV * revolutions)
        lines = amplitude_spectrum(values, rate=PER_REV)
        orders = np.arange(0.1, 15, 0.1)
        found = find_lines(lines, expected=orders, tolerance=0.02 * orders, closer=np.full(orders.size, math.nan))
        measured = any(isinstance(one, Line) for one in found)
        assert has_background(lines.bin_width) or not measured
        assert measured or revolutions < 9  # of 8 bins beside a lobe of 3 on either side 7 turns are the fewest
