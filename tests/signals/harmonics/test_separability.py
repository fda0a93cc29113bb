"""How long lines stay close, and the flag of a line near its image: against definitions."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from signals.harmonics import OrderTracker, OutputFlag, track_orders
from signals.harmonics.separability import SEGMENTS, Closeness
from signals.harmonics.state_space import HarmonicModel

LENGTH = 20  # samples in a segment of a record of SEGMENTS of them
WIDTH = 0.004  # bandwidth in cycles a sample: lines are close within 0.002, for 250 samples or 12.5 segments


def between(one, other):
    """Least distance to the line, to its image, and to both beyond multiples of the rate."""
    far = np.arange(-2, 3)[:, None, None]
    return np.abs(other + np.array([-1, 1])[:, None] * one + far).min(axis=(0, 1))


def crossed(one, other):
    """(segment - 1,) array, whether a line passed another, or an image of it, from one segment to the next."""
    # A line that moves passes where the difference is a whole number: the integers below it are not the same ones.
    passed = np.zeros(one.size - 1, dtype=bool)
    for apart in (other - one, other + one):
        steps = np.abs(np.diff(apart))
        passed |= (np.floor(apart[1:]) != np.floor(apart[:-1])) & (steps < 0.25)
    return passed


def by_definition(one, other):
    """(segment,) distances, 0 on both sides of a crossing."""
    nearest, passed = between(one, other), crossed(one, other)
    nearest[:-1][passed] = nearest[1:][passed] = 0.0
    return nearest


def model_of(frequency, bandwidth):
    """Return a model of orders 1, each of a shaft of its own, whose frequency is constant in every segment."""
    turns = np.cumsum(np.repeat(frequency, LENGTH, axis=1), axis=1)
    phases = 2 * np.pi * np.pad(turns, ((0, 0), (1, 0)))
    count = len(frequency)
    return HarmonicModel(
        orders=np.ones(count),
        shaft=np.arange(count),
        phases=tuple(phases),
        bandwidth=bandwidth,
        poles=1,
        prior_std=1e3,
    )


def closeness_of(frequency, bandwidth=WIDTH):
    frequency = np.asarray(frequency, dtype=float)
    width = np.broadcast_to(np.reshape(bandwidth, (-1, 1)), (len(frequency), 1))
    return Closeness.of(model_of(frequency, width))


def steady(*frequencies):
    return np.repeat(np.array(frequencies)[:, None], SEGMENTS, axis=1)


class TestDwell:
    """Lines dwell that stay within half a bandwidth for 1 / bandwidth: 13 segments of 20 samples are 260, 12 are 240.

    Where one line moves off, the angle between segments is that of their lengths, so frequencies are exact.
    """

    def apart_but_for(self, *ranges):
        frequency = steady(0.1, 0.2)
        for start, stop in ranges:
            frequency[1, start:stop] = 0.1015
        return frequency

    @pytest.mark.parametrize("start", [0, 200, SEGMENTS - 13])
    def test_wherever_in_the_record_they_stay(self, start):
        assert closeness_of(self.apart_but_for((start, start + 13))).dwell()
        assert not closeness_of(self.apart_but_for((start, start + 12))).dwell()

    def test_short_stays_do_not_add_up(self):
        assert not closeness_of(self.apart_but_for((0, 12), (13, 25), (40, 52), (500, 512))).dwell()
        # And a long one after short ones is found.
        assert closeness_of(self.apart_but_for((0, 12), (13, 25), (400, 413))).dwell()

    def test_a_pair_that_only_meets_does_not_hide_one_that_stays(self):
        # The second line passes the first; only the last one stays, with the third.
        frequency = steady(0.1, 0.2, 0.3, 0.4)
        frequency[1, 50:53] = 0.1
        frequency[3, 300:320] = 0.3
        for order in ([0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1], [1, 3, 0, 2]):
            assert closeness_of(frequency[order]).dwell()
            assert not closeness_of(np.delete(frequency, 3, axis=0)[[0, 2, 1]]).dwell()

    def test_the_wider_band_of_a_pair_counts(self):
        # 0.0015 cycles a sample apart: within half of 0.004 but not of 0.001, for 1000 samples or for 250.
        frequency = steady(0.1, 0.1015)
        assert closeness_of(frequency, [0.001, WIDTH]).dwell()
        assert closeness_of(frequency, [WIDTH, 0.001]).dwell()
        assert not closeness_of(frequency, [0.001, 0.001]).dwell()
        # Of a third line's width they know nothing.
        assert not closeness_of(steady(0.1, 0.1015, 0.3), [0.001, 0.001, WIDTH]).dwell()

    def test_against_brute_force(self):
        """Random walks in steps of a part of the bandwidth, some of which dwell."""
        rng = np.random.default_rng(2)
        answers = []
        for _ in range(60):
            count = int(rng.integers(2, 5))
            walk = rng.choice([0.0003, 0.0006]) * np.cumsum(rng.standard_normal((count, SEGMENTS)), axis=1)
            frequency = 0.2 + rng.uniform(0, 0.02, (count, 1)) + walk
            width = rng.choice([0.001, 0.002, 0.004], count)
            expected = any(
                self.longest_stay(frequency[a], frequency[b], max(width[a], width[b])) >= 1
                for a in range(count) for b in range(a)
            )  # fmt: skip
            assert closeness_of(frequency, width).dwell() == expected
            answers.append(expected)
        assert 10 < sum(answers) < 50

    def longest_stay(self, one, other, width):
        """In memories of 1 / bandwidth: segment by segment, begun anew after each that is too far."""
        longest, stay = 0.0, 0.0
        for distance in by_definition(one, other):
            stay = stay + width * LENGTH if distance < width / 2 else 0.0
            longest = max(longest, stay)
        return longest


class TestImageFlag:
    """A line at f has an image at -f and one at 1 - f: 2 f and 1 - 2 f away, to be half a bandwidth at least."""

    @pytest.mark.parametrize("width", [0.002, 0.02])
    @pytest.mark.parametrize(("part", "flagged"), [(0.0, True), (0.245, True), (0.255, False), (0.6, False)])
    @pytest.mark.parametrize("side", ["rest", "half the rate"])
    def test_is_as_wide_as_half_a_bandwidth(self, width, part, flagged, side):
        frequency = part * width if side == "rest" else 0.5 - part * width
        n = np.arange(3000)
        x = np.random.default_rng(0).standard_normal(n.size)
        settings = {"orders": [0, 1], "bandwidth_hz": width, "rate_hz": 1.0, "noise_variance": 1.0}
        phase = 2 * np.pi * frequency * n
        whole = track_orders(x, phase_rad=phase, **settings)
        stream = OrderTracker(**settings).update(x, phase_rad=phase)
        for flags in (whole.flags, stream.flags[:, 1000:]):
            assert np.all((flags[1] & OutputFlag.ONE_QUADRATURE > 0) == flagged)
            assert not np.any(flags[0] & OutputFlag.ONE_QUADRATURE)

    def test_is_that_of_each_stretch_and_order(self):
        frequency = steady(0.1, 0.1)
        frequency[0, 100:200], frequency[1, 300:] = 0.001, 0.4995
        flags = closeness_of(frequency, [0.005, 0.003]).flag(np.zeros((2, 2)))
        image = flags & OutputFlag.ONE_QUADRATURE > 0
        segment = np.arange(SEGMENTS)
        # 0.002 is within half of 0.005, 0.001 within half of 0.003.
        assert_array_equal(image[0], (segment >= 100) & (segment < 200))
        assert_array_equal(image[1], segment >= 300)
