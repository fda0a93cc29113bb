"""Kendall's tau and the Theil-Sen slope of many series, against every pair."""

import itertools

import numpy as np
import pytest

from signals.monitoring.slopes import series_slopes


def test_slope_and_tau_by_every_pair():
    rng = np.random.default_rng(1)
    times, values = rng.uniform(0, 100, 60), rng.standard_normal((60, 2))
    pairs = list(itertools.combinations(range(60), 2))
    found = series_slopes(values, times)
    for number, series in enumerate(values.T):
        slopes = [(series[j] - series[i]) / (times[j] - times[i]) for i, j in pairs]
        assert found.slope[number] == pytest.approx(np.median(slopes), rel=1e-12)
        assert found.tau[number] == pytest.approx(np.mean(np.sign(slopes)), rel=1e-12)
        assert found.slope_low[number] < found.slope[number] < found.slope_high[number]


def test_a_long_straight_line_keeps_its_slope():
    times = np.sort(np.random.default_rng(2).uniform(0, 100, 10_000))
    found = series_slopes((3 - 0.25 * times)[:, None], times)
    assert found.points == 10_000
    # medians of groups of 100 lie on the line; of even groups both medians average the same two
    assert found.slope == pytest.approx([-0.25], rel=1e-11)
    assert found.tau == pytest.approx([-1], rel=1e-12)


def test_gaps_are_left_out_and_too_little_is_no_slope():
    times = np.array([0.0, 1, 2, 3, 4, 5, np.nan])
    values = np.array([[1.0, np.nan, 2, 3, 4, 5, 9], [1, np.nan, 2, 3, 4, np.nan, 9], [1.0] * 7]).T
    found = series_slopes(values, times)
    assert found.points.tolist() == [5, 4, 6]
    assert found.median.tolist() == [3.0, 2.5, 1.0]
    assert (found.first[0], found.last[0]) == (1.0, 5.0)  # a third of five values is one
    assert np.isfinite(found.slope).tolist() == [True, False, False]
    assert np.isnan(series_slopes(values, np.ones(7)).tau).all()
