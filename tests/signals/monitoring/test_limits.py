from itertools import pairwise

import numpy as np
import pytest

from hums.fleet.series import limit_table
from signals.monitoring.charts import ChartState
from signals.monitoring.limits import MachineLimits, machine_limits


def limits_of(independent, every, groups=(0,), **more):
    return machine_limits(limit_table(), np.full(len(groups), float(independent)), every, groups, **more)


@pytest.mark.parametrize("group", [0, 1])
def test_healthy_machines_raise_fewer_alarms_than_stated(group):
    # white normal scores, which the table's machines are not: its limits allow for what drifts, too
    rng, machines, records, baseline = np.random.default_rng(group), 2000, 300, 30
    limits = limits_of(baseline, 1000.0, (group,))
    scores = rng.standard_normal((baseline + records, machines))
    learned = scores[:baseline]
    scale = np.sqrt(((baseline - 1) * learned.var(axis=0, ddof=1) + 10) / (baseline - 1 + 10))
    state, index = ChartState.start((machines,)), np.empty((records, machines))
    for number, score in enumerate((scores[baseline:] - learned.mean(axis=0)) / scale):
        state = state.step(score, allowance=limits.allowance)
        index[number] = limits.index(state)
    alarmed = (np.sort(np.stack([index[2:], index[1:-1], index[:-2]]), axis=0)[1] >= 1).any(axis=0)
    assert 0 < alarmed.mean() < 300 / 1000


def test_limits_widen_with_fewer_records_and_seldomer_alarms():
    for below, above in pairwise((2, 2.5, 5, 12, 40, 300)):
        assert (limits_of(below, 1e4).limits > limits_of(above, 1e4).limits).all()
    for often, seldom in pairwise((1e3, 3e3, 1e5, 1e6)):
        assert (limits_of(30, often).limits < limits_of(30, seldom).limits).all()


def test_scores_share_the_rate_and_slopes_cost_records():
    one, three = limits_of(30, 1e4), limits_of(30, 1e4, (0, 0, 1))
    assert three.every_records == 3 * one.every_records
    assert (three.limits[:, 0] > one.limits[:, 0]).all()
    assert (three.limits[:, 2] < three.limits[:, 0]).all()  # evidence of bearing parts drifts less
    assert limits_of(30, 1e4, slopes=2.0).limits == pytest.approx(limits_of(15, 1e4).limits)


def test_the_cumulative_sum_raises_no_alarm():
    state = ChartState(values=np.array([[0.0], [0.0], [0.0], [1e6]]), rising=np.array([300]))
    assert limits_of(30, 1e4).index(state).tolist() == [0.0]


def test_an_alarm_of_the_baseline_is_part_of_what_was_normal():
    limits = limits_of(30, 1e4 / 3, (0, 0, 0))
    baseline = np.zeros((30, 3))
    baseline[[4, 6], 1] = 3 * limits.limits[0, 0], 2 * limits.limits[0, 0]  # two of three
    baseline[[4, 16], 2] = 5 * limits.limits[0, 0]  # each by itself
    none, two, apart = (limits.widened(baseline).limits / limits.limits)[0]
    assert (none, apart) == (1.0, 1.0)
    # a burst is above 1 + x with the share of bursts times (1 + x/3)^-2, and two of three are with 2 p^2
    p = 2.5 / 31 * (1 + (two - 1) / 3) ** -2
    assert 2 * p**2 == pytest.approx(1e-4)
    assert limits.bursts(baseline).tolist() == [False, True, True]


def test_index_is_the_largest_of_the_charts():
    limits = limits_of(30, 1e4, (0, 1))
    values = np.concatenate([limits.limits * [[0.5, 1.0], [2.0, 1.5], [1.0, 3.0]], np.zeros((1, 2))])
    assert isinstance(limits, MachineLimits)
    assert limits.index(ChartState(values=values, rising=np.zeros(2, dtype=np.int64))) == pytest.approx([2.0, 3.0])
