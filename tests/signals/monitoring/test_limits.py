import numpy as np
import pytest
from scipy import stats

from signals.monitoring.charts import ChartState
from signals.monitoring.limits import machine_limits
from signals.monitoring.location import learn_baseline
from signals.monitoring.memory import learn_memory

DAY_S, MINUTES_S = 86400.0, 300.0
DOF = 20.0  # of machines' variances about the usual one, 1: deviations differ by 16 %
WATCHED = 300


def healthy(records, machines, rng, *, correlation=0.0, a_day=1, of_days=1.0):
    """Scores of machines whose deviations differ, and their times; days have the correlation, records share them."""
    days = rng.standard_normal((-(-records // a_day), machines))
    for number in range(1, len(days)):
        days[number] = correlation * days[number - 1] + np.sqrt(1 - correlation**2) * days[number]
    of_records = np.sqrt(1 - of_days) * rng.standard_normal((records, machines))
    scores = np.sqrt(of_days) * np.repeat(days, a_day, axis=0)[:records] + of_records
    number = np.arange(records)
    return scores * np.sqrt(DOF / rng.chisquare(DOF, machines)), DAY_S * (number // a_day) + MINUTES_S * (
        number % a_day
    )


def learned(scores, times, every, **more):
    """Limits of scores (records, scores), each of which is a machine, and what is normal for them."""
    normal = learn_baseline(scores, np.zeros((len(scores), 0)), prior_scale=1.0, prior_dof=DOF)
    own = (scores - normal.center) / normal.scale
    memory = learn_memory(own, times, prior_scale=1 / normal.scale)
    return machine_limits(memory, every / scores.shape[1], **more), normal


def limits_of(baseline, every, **more):
    scores, times = healthy(baseline, 200, np.random.default_rng(baseline))
    return learned(scores, times, every, **more)[0]


def index_of(limits, scores):
    state, found = limits.charts.start((scores.shape[1],)), []
    for score in scores:
        state = limits.charts.step(state, score)
        found.append(limits.index(state))
    return np.array(found)


def alarmed(index):
    """Whether two of three records reach the limit, or one twice the limit."""
    two_of_three = np.sort(np.stack([index[2:], index[1:-1], index[:-2]]), axis=0)[1]
    return (two_of_three >= 1).any(axis=0) | (index >= 2).any(axis=0)


@pytest.mark.parametrize("every", [1_000.0, 20_000.0])  # 20 components at one in 1,000
@pytest.mark.parametrize("a_day", [1, 5])
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("baseline", [5, 10, 30, 100])
def test_healthy_machines_raise_no_more_alarms_than_stated(baseline, correlation, a_day, every):
    rng, machines = np.random.default_rng([baseline, a_day]), 500
    of_days = 1.0 if a_day == 1 else 0.5
    scores, times = healthy(baseline + WATCHED, machines, rng, correlation=correlation, a_day=a_day, of_days=of_days)
    limits, normal = learned(scores[:baseline], times[:baseline], every)
    alarms = alarmed(index_of(limits, (scores[baseline:] - normal.center) / normal.scale)).sum()
    assert alarms <= stats.poisson.ppf(0.999, machines * WATCHED / every)


def test_eight_deviations_raise_an_alarm_by_the_second_record():
    # ten records, twenty scores, one false alarm of them all in 10,000 records; of a baseline that scatters as usual
    scores = np.random.default_rng(0).standard_normal((12, 1000))
    scores[10:] += 8.0
    limits, normal = learned(scores[:10], DAY_S * np.arange(10), 20 * 10_000.0)
    index = index_of(limits, (scores[10:] - normal.center) / normal.scale)
    assert ((index >= 1).all(axis=0) | (index >= 2).any(axis=0)).mean() > 0.5


def test_limits_widen_with_fewer_records_and_seldomer_alarms():
    medians = [np.median(limits_of(records, 1e4).limits, axis=1) for records in (2, 4, 10, 30, 100)]
    assert (np.diff(medians, axis=0) < 0).all()
    often, seldom = limits_of(30, 1e3), limits_of(30, 1e6)
    assert (often.limits < seldom.limits).all()


def test_limits_widen_with_the_memory():
    rng = np.random.default_rng(3)
    medians = []
    for correlation in (0.0, 0.5, 0.9):
        scores, times = healthy(30, 200, rng, correlation=correlation)
        medians.append(np.median(learned(scores, times, 1e4)[0].limits, axis=1))
    assert (np.diff(medians, axis=0) > 0).all()


def test_scores_share_the_rate_and_slopes_widen():
    scores, times = healthy(30, 3, np.random.default_rng(1))
    one, three = learned(scores[:, :1], times, 1e4)[0], learned(scores, times, 3e4)[0]
    assert three.every_records == one.every_records * 3
    assert (three.limits[:, 0] > one.limits[:, 0]).all()
    assert (limits_of(30, 1e4, slopes=2.0).limits > limits_of(30, 1e4).limits).all()


def test_it_goes_on_falling_beyond_the_limit():
    found = limits_of(30, 1e4)
    assert found.every_records_at(1.0) == pytest.approx(1e4)
    assert found.every_records_at(1.0 + found.decades.max()) == pytest.approx(1e5)
    assert limits_of(30, 1e5).limits[0] == pytest.approx(found.limits[0] * (1 + found.decades), rel=1e-5)


def test_the_cumulative_sum_raises_no_alarm():
    state = ChartState(values=np.zeros((4, 200)), rising=np.full(200, 300))
    state.values[-1] = 1e6
    assert (limits_of(30, 1e4).index(state) == 0).all()


def test_an_alarm_of_the_baseline_is_part_of_what_was_normal():
    scores, times = healthy(30, 3, np.random.default_rng(2))
    limits = learned(scores, times, 1e4)[0]
    baseline = np.zeros((30, 3))
    baseline[[4, 6], 1] = 3 * limits.limits[0, 1], 2 * limits.limits[0, 1]  # two of three
    baseline[[4, 16], 2] = 5 * limits.limits[0, 2]  # each by itself
    none, two, apart = limits.headroom(baseline)
    assert (none, apart) == (1.0, 1.0)
    assert two == pytest.approx(4.0)  # twice what two of three reached
    assert limits.bursts(baseline).tolist() == [False, True, True]


def test_index_is_the_largest_of_the_charts():
    scores, times = healthy(30, 2, np.random.default_rng(4))
    limits = learned(scores, times, 1e4)[0]
    values = np.concatenate([limits.limits * [[0.5, 1.0], [2.0, 1.5], [1.0, 3.0]], np.zeros((1, 2))])
    assert limits.index(ChartState(values=values, rising=np.zeros(2, dtype=np.int64))) == pytest.approx([2.0, 3.0])
