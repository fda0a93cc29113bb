from itertools import pairwise

import numpy as np
import pytest

from hums.fleet.series import limit_table
from signals.monitoring.charts import ChartState, MachineLimits, machine_limits


def run_lengths(chart, limit, *, machines=4000, records=1500, seed=1, shift=0.0):
    """Records until one chart of normal scores of mean `shift` reaches its limit; infinite where it does not."""
    rng, state = np.random.default_rng(seed), ChartState.start((machines,))
    found = np.full(machines, np.inf)
    for number in range(1, records + 1):
        state = state.step(shift + rng.standard_normal(machines), allowance=0.5)
        found = np.where(np.isinf(found) & (state.values[chart] >= limit), number, found)
    return found


def mean_run_length(found, records):
    """Maximum-likelihood mean of what is exponential, and cut off."""
    ended = np.isfinite(found)
    return np.where(ended, found, records).sum() / ended.sum()


class TestRunLength:
    def test_cusum_as_published(self):
        # Montgomery, Introduction to Statistical Quality Control, table 9.3: two-sided 168 for k = 1/2, h = 4; one
        # side alarms half as often
        found = run_lengths(-1, 4.0, records=800)
        assert mean_run_length(found, 800) == pytest.approx(2 * 168, rel=4 / np.sqrt(np.isfinite(found).sum()) + 0.01)

    def test_shewhart(self):
        # one in 1 / 0.02275 values exceeds 2 deviations
        found = run_lengths(0, 2.0, machines=2000, records=400)
        assert mean_run_length(found, 400) == pytest.approx(1 / 0.0227501, rel=0.08)  # 2000 run lengths: 2.2 % each

    @pytest.mark.parametrize(("chart", "weight", "width", "records"), [(1, 0.2, 2.962, 10.5), (2, 0.05, 2.615, 11.4)])
    def test_ewma_as_published(self, chart, weight, width, records):
        # Lucas and Saccucci 1990, table 3: schemes of run length 500 in control, a shift of one deviation
        limit = width * np.sqrt(weight / (2 - weight))
        found = run_lengths(chart, limit, machines=3000, records=120, shift=1.0)
        assert found.mean() == pytest.approx(records, abs=0.05 + 4 * found.std() / np.sqrt(3000))

    def test_ewma_has_the_deviation_of_its_filter(self):
        rng, state = np.random.default_rng(2), ChartState.start((20_000,))
        for _ in range(40):  # 0.8^80 of the start is left
            state = state.step(rng.standard_normal(20_000), allowance=0.5)
        assert state.values[1].std() == pytest.approx(np.sqrt(0.2 / 1.8), rel=4 / np.sqrt(2 * 20_000))


def test_a_record_without_a_score_changes_nothing():
    before = ChartState.start((2,)).step(np.array([3.0, 1.0]), allowance=0.5)
    after = before.step(np.array([np.nan, 1.0]), allowance=0.5)
    assert np.array_equal(after.values[:, 0], before.values[:, 0])
    assert after.rising.tolist() == [1, 2]


def test_a_stray_record_counts_little_in_what_remembers_it_and_a_lasting_change_in_full():
    stray = lasting = ChartState.start()
    for first, second in ((20.0, 20.0), (0.0, 20.0)):
        stray, lasting = stray.step(np.asarray(first), allowance=0.5), lasting.step(np.asarray(second), allowance=0.5)
    # the score itself; 0.2 * 3 and its rest; 3 - 0.5 and the allowance once more
    assert stray.values[[0, 1, 3]] == pytest.approx([0.0, 0.6 * 0.8, 2.0])
    # from the second on in full: 0.6 + 0.2 (20 - 0.6), and 2.5 + 19.5
    assert lasting.values[[0, 1, 3]] == pytest.approx([20.0, 0.6 + 0.2 * 19.4, 22.0])


def test_the_cusum_says_since_when():
    state = ChartState.start()
    for score in (0.0, 5.0, -9.0, 0.2, 2.0, 2.0, 2.0):
        state = state.step(np.asarray(score), allowance=0.5)
    assert state.rising == 3


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
