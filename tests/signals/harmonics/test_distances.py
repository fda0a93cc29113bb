"""Distances between lines, against their definition line by line."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from signals.harmonics import _distance_kernels
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.model import HarmonicModel
from signals.harmonics.separability import Closeness, leaks, left_over

STRETCHES = 50


def between(one, other):
    """Least distance to the line, to its image, and to both beyond multiples of the rate."""
    far = np.arange(-2, 3)[:, None, None]
    return np.abs(other + np.array([-1, 1])[:, None] * one + far).min(axis=(0, 1))


def found(one, other):
    nearest = np.empty(STRETCHES)
    _distance_kernels.distances(one, other, np.empty(STRETCHES), nearest)
    return nearest


def test_distances_fold_at_the_rate_and_at_zero():
    rng = np.random.default_rng(0)
    for _ in range(50):
        one, other = rng.uniform(-0.5, 0.5, (2, 1)) + rng.uniform(0, 1e-3, (2, STRETCHES))
        expected = between(one, other)
        if expected.min() > 2e-3:  # no crossing
            assert_allclose(found(one, other), expected, rtol=0, atol=1e-15)


def test_lines_that_cross_between_stretches_touch_in_both():
    one, other = np.full(STRETCHES, 0.1), 0.1 + 0.004 * (np.arange(STRETCHES) - 20.5)
    nearest = found(one, other)
    assert_array_equal(np.flatnonzero(nearest == 0), [20, 21])
    assert nearest[10] == np.abs(other[10] - 0.1)
    # At half the rate the nearest image changes its side; the lines are as far apart as can be.
    assert found(np.full(STRETCHES, 0.3), 0.79 + 0.001 * np.arange(STRETCHES)).min() > 0.05


def test_leaks_are_gains_at_the_least_distance_and_add_up_to_what_is_left_over():
    samples = 10_000
    phase = 2 * np.pi * 0.01 * np.arange(samples)
    orders, bandwidth = np.array([1.0, 3.0, 7.0]), np.array([[2e-3], [2e-3], [4e-3]])
    model = HarmonicModel(
        orders=orders, shaft=np.zeros(3, dtype=int), phases=(phase,), bandwidth=bandwidth, poles=2, prior_std=1e3
    )
    closeness, size = Closeness(model, samples), np.array([1.0, 0.5, 2.0])

    def gain(width, distance):
        return width.smoother_gain(distance)

    distance = 0.01 * np.array([[2, 2, 6], [2, 6, 4], [6, 4, 14]])
    each = [Bandwidth(width=float(width), poles=2) for width in bandwidth[:, 0]]
    got = np.stack([own.smoother_gain(row) for own, row in zip(each, distance, strict=True)]) * size
    assert_allclose(closeness.received(gain, size), got, rtol=1e-9)
    assert_allclose(leaks(got, size), got / size[:, None], rtol=1e-15)
    # The first two are smoothed together; a line counts twice, for its image.
    apart = max(got[0, 2], got[1, 2], got[2].sum())
    assert_allclose(left_over(got, size, [np.array([0, 1])]), 2 * apart / 2.0, rtol=1e-15)


def test_lines_dwell_that_stay_together_for_a_memory():
    lengths, bandwidth = np.full(STRETCHES, 100.0), np.full((2, STRETCHES), 1e-3)
    crossing = np.stack([np.full(STRETCHES, 0.1), 0.1 + 1e-4 * (np.arange(STRETCHES) - 20.5)])
    assert not _distance_kernels.dwell(crossing, bandwidth, lengths / 2)
    assert _distance_kernels.dwell(crossing, bandwidth, lengths * 2)
    assert not _distance_kernels.dwell(crossing + np.array([[0], [0.1]]), bandwidth, lengths * 2)
