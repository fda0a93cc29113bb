"""Lines over a whole record in angle, of sinusoids in white noise whose spectra are known in closed form."""

import numpy as np
import pytest

from signals.shaft._angle_spectrum import sharp_lines
from signals.shaft.phase import ShaftPhase

RATE_HZ, SECONDS, SPEED_HZ = 2048.0, 5.0, 24.0  # 120 turns
ORDERS = np.array([1.0, 5.7, 11.4, 16.0, 20.0, 32.0, 40.0])
RANGE_HZ = (15.0, 40.0)


def record(lines, *, noise=1.0, seed=3):
    t = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    x = sum((height * np.cos(2 * np.pi * order * SPEED_HZ * t + order) for order, height in lines), np.zeros(t.size))
    return x + noise * np.random.default_rng(seed).standard_normal(t.size)


def sharp(x, *, orders=ORDERS, ratio=1.0):
    t = np.linspace(0, SECONDS, 51)
    phase = ShaftPhase(times_s=t, revolutions=ratio * SPEED_HZ * t)
    return sharp_lines(x, RATE_HZ, phase, orders, range_hz=RANGE_HZ)


class TestSharpLines:
    @pytest.mark.parametrize("height", [0.2, 0.5])
    def test_level_of_the_second_line(self, height):
        """A sinusoid over white noise in a Hann window: a^2 n / (6 s^2), since (sum w)^2 / sum w^2 is 2 n / 3."""
        found = sharp(record([(20, 1.0), (5.7, height)], noise=0.7))
        expected = 10 * np.log10(height**2 * RATE_HZ * SECONDS / (6 * 0.7**2)) - 10
        # the root of 2 over 139, the lower ratio, is 12 %, 0.5 dB; of a median of 81 bins 1 / sqrt(81) as much: three
        assert found.joint == pytest.approx(expected, abs=2.0)

    def test_noise_has_no_lines(self):
        """Six orders of three bins exceed ten times the noise once in 1200 records; beside it none stands."""
        assert all(sharp(record([], seed=seed)).joint == 0 for seed in range(40))

    def test_another_reading_of_the_strongest_line(self):
        """At 1.25 times the speed 20 and 40 are 16 and 32; 5.7 and 11.4 decide."""
        same = sharp(record([(20, 0.8), (40, 0.5)]))
        assert same.rival == pytest.approx(same.joint, rel=1e-6)
        decided = sharp(record([(20, 0.8), (40, 0.3), (5.7, 0.4), (11.4, 0.4)]))
        assert decided.rival < 0.5 * decided.joint

    def test_a_sideband_is_no_close_mesh(self):
        """A speed 3.1 % slow puts the mesh 16.067 at 16.585, and a sideband near 16.53 three bins beside 17.071."""
        orders, slow = np.array([16.067, 16.585, 17.071]), 16.067 / 16.585
        x = record([(16.067, 1.0), (17.071 * slow - 3 / 120, 0.4)])
        assert sharp(x, orders=orders, ratio=slow).joint == 0
        assert sharp(record([(16.067, 1.0), (16.585, 0.4)]), orders=orders).joint > 5

    def test_one_line_of_two_close_orders(self):
        """Orders within the main lobe of one line, two bins, are not two lines."""
        assert sharp(record([(20, 1.0)]), orders=np.array([5.7, 20.0, 20.005])).joint == 0

    def test_first_harmonics_count_where_no_mesh_stands(self):
        assert sharp(record([(1, 1.0), (2, 0.5)]), orders=np.array([1.0, 2.0, 16.0])).joint > 5
        assert sharp(record([(1, 1.0), (16, 0.5)]), orders=np.array([1.0, 2.0, 16.0])).joint == 0
