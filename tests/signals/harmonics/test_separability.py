"""How long lines stay close: against definitions."""

import numpy as np

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


class TestDwell:
    """Lines dwell that stay within half a bandwidth for 1 / bandwidth."""

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
