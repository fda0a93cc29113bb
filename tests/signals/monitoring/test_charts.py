import numpy as np
import pytest

from signals.monitoring.charts import ChartState


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
