import numpy as np
import pytest

from signals.monitoring.scores import fused_scores, kinds_of, out_of_sample


def test_the_mean_of_the_largest_third():
    departures = np.array([[1.0, 5, 2, 4, 0, -9], [np.nan, np.nan, 3, 1, 2, np.nan]])
    found = fused_scores(departures, kinds_of([[np.arange(6)], [np.arange(2)]]))
    assert found[0] == pytest.approx([4.5, 5.0])  # 5 and 4 of six; 5 of two
    assert found[1, 0] == 3.0  # one of three known
    assert np.isnan(found[1, 1])  # none of two known


def test_a_kind_is_not_diluted_by_the_others():
    departures = np.zeros(40)
    departures[:10] = 3.0
    ten = [np.arange(10 * kind, 10 * (kind + 1)) for kind in range(4)]
    assert fused_scores(departures, kinds_of([ten])) == pytest.approx([3.0])
    assert fused_scores(departures, kinds_of([[np.arange(40)]]))[0] == pytest.approx(30 / 14)  # of the largest 14
    departures[:6] = np.nan  # more than half of the kind
    assert fused_scores(departures, kinds_of([ten])) == pytest.approx([0.0])


def test_departures_of_a_baseline_from_its_own_mean():
    drawn = np.random.default_rng(1).standard_normal((40_000, 4))
    own = (drawn - drawn.mean(axis=1, keepdims=True)).std()
    new = (np.random.default_rng(2).standard_normal(40_000) - drawn.mean(axis=1)).std()
    assert out_of_sample(4, np.zeros(1)) == pytest.approx(new / own, rel=0.02)
