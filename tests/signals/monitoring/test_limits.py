from dataclasses import replace

import numpy as np
import pytest

from signals.monitoring.alarm_life import AlarmRule
from signals.monitoring.charts import ChartState
from signals.monitoring.limits import HealthyScores, chart_limits, machine_limits, own_scores, tail_quantiles

CARRIED_OVER = HealthyScores(shares=((0.9, 0.05, 0.05, 0.0), (0.5, 0.2, 0.2, 0.1)), scale_dof=8.0)


def false_alarms(limits, baseline, model, *, machines, seed, records=300):
    """Alarms of fresh healthy machines, each with a baseline of its own, by the chain that watches."""
    scores = model.draw(machines, baseline + records, np.random.default_rng(seed))
    learned = scores[:baseline]
    dof = model.scale_dof  # scaled inverse chi-squared prior about 1
    scale = np.sqrt(((baseline - 1) * learned.var(axis=0, ddof=1) + dof) / (baseline - 1 + dof))
    rule, charts = AlarmRule(), limits.charts.start((machines,))
    alarm, count = rule.start((machines,)), 0
    for score in (scores[baseline:] - learned.mean(axis=0)) / scale:
        charts = limits.charts.step(charts, score)
        alarm, raised = rule.step(alarm, limits.index(charts))
        count += int(raised.sum())
    return count


@pytest.mark.parametrize("baseline", [30, 300])
def test_the_rate_holds_with_the_baselines_own_error(baseline):
    limits = chart_limits(baseline, 3000.0, CARRIED_OVER)
    count = false_alarms(limits, baseline, CARRIED_OVER, machines=3000, seed=7)
    expected = 3000 * 300 / 3000
    # four deviations of a count; the limit has itself the error of the 600 alarms it was made from
    assert count == pytest.approx(expected, abs=4 * np.sqrt(expected + expected**2 / 600))


def test_beyond_the_simulated_it_goes_on_falling():
    thousand, million = (chart_limits(30, every, CARRIED_OVER) for every in (1e3, 1e6))
    assert all(high > low for high, low in zip(million.limits, thousand.limits, strict=True))
    assert million.every_records_at(1.0) == pytest.approx(1e6)
    assert million.every_records_at(1.0 + million.decades) == pytest.approx(1e7)


def test_limits_are_wider_by_what_machines_have_shown():
    rows = ((30.0, 1e3, 1.0, 2.0), (30.0, 1e5, 1.0, 4.0))
    plain, wider = (chart_limits(30, 1e4, replace(CARRIED_OVER, widening=of)) for of in ((), rows))
    # half way between the rates in their logarithms; the simulation takes the factor as it is
    assert np.divide(wider.limits, plain.limits) == pytest.approx(np.full(3, 3.0), rel=1e-12)
    # the distribution is stretched by the factor, so that its fall over the limit is the same
    assert wider.decades == pytest.approx(plain.decades, rel=1e-12)


def test_the_factor_goes_with_the_drift():
    rows = ((30.0, 1e4, 0.0, 1.0), (30.0, 1e4, 1.0, 2.0), (300.0, 1e4, 1.0, 5.0))
    part = replace(CARRIED_OVER, drift=0.4)
    plain, wider = (chart_limits(30, 1e4, replace(part, widening=of)) for of in ((), rows))
    assert np.divide(wider.limits, plain.limits) == pytest.approx(np.full(3, 1.4), rel=1e-12)


def test_what_drifts_less_has_lower_limits_and_holds_the_rate():
    expected = 3000 * 300 / 3000
    for drift, share in ((0.35, 0.4), (0.02, 0.1)):  # the next larger share
        (limits,) = machine_limits(30, 3000.0, (CARRIED_OVER,), (0,), drift=drift).groups
        count = false_alarms(limits, 30, replace(CARRIED_OVER, drift=share), machines=3000, seed=10)
        assert count == pytest.approx(expected, abs=4 * np.sqrt(expected + expected**2 / 600))
        assert limits.limits[2] < chart_limits(30, 3000.0, CARRIED_OVER).limits[2]


WHITE = HealthyScores(scale_dof=8.0)


@pytest.fixture(scope="module")
def limits():
    return machine_limits(30, 1000.0, (CARRIED_OVER, WHITE), (0, 0, 1))


class TestGroups:
    """A machine of two scores that carry over and one that is white."""

    def test_each_score_has_a_third_of_the_alarms_with_the_limits_of_its_group(self, limits):
        expected = 3000 * 300 / 3000
        white = limits.groups[1]  # those of the other group are held above
        count = false_alarms(white, 30, WHITE, machines=3000, seed=8)
        assert count == pytest.approx(expected, abs=4 * np.sqrt(expected + expected**2 / 600))

    def test_what_does_not_drift_has_lower_limits_where_charts_remember(self, limits):
        drifting, white = limits.groups
        assert white.limits[2] < 0.8 * drifting.limits[2]

    def test_index_and_headroom_of_a_score_are_those_of_its_group(self, limits):
        state = ChartState(values=np.ones((4, 3)), rising=np.zeros(3, dtype=np.int64))
        drifting, white = (one.index(state)[0] for one in limits.groups)
        assert limits.index(state).tolist() == [drifting, drifting, white]
        bursts = np.full((30, 3), 10.0)
        first, second = (one.headroom(bursts, AlarmRule())[0] for one in limits.groups)
        assert limits.headroom(bursts, AlarmRule()).tolist() == [first, first, second]

    def test_the_cumulative_sum_raises_no_alarm(self, limits):
        state = ChartState(values=np.array([[0.0], [0.0], [0.0], [1e6]]), rising=np.array([300]))
        assert limits.groups[0].index(state).tolist() == [0.0]


class TestOwnScores:
    """One long-watched machine whose scores are half white and half an AR(1) process of exp(-1/5)."""

    MODEL = HealthyScores(shares=((0.5, 0.5, 0.0, 0.0),))
    SCORES = MODEL.draw(8, 2000, np.random.default_rng(3))

    def test_shares_and_effective_number_of_an_autoregressive_process(self):
        own, effective = own_scores(self.SCORES)
        assert np.mean(own.shares, axis=0) == pytest.approx([0.5, 0.5, 0, 0], abs=0.08)
        decay = np.exp(-1 / 5)  # 1 + 2 * 0.5 * decay / (1 - decay) of an infinite series
        assert effective == pytest.approx(2000 / (1 + decay / (1 - decay)), rel=0.25)

    def test_limits_of_its_own_hold_the_rate_where_those_of_white_scores_do_not(self):
        own, _ = own_scores(self.SCORES)
        expected = 1500 * 300 / 1000
        counts = [
            false_alarms(chart_limits(300, 1000.0, model), 300, self.MODEL, machines=1500, seed=9)
            for model in (own, HealthyScores())
        ]
        # its distribution is known from 8 x 600 effective records: four deviations of a count, and 25 %
        assert counts[0] == pytest.approx(expected, abs=4 * np.sqrt(expected) + 0.25 * expected)
        assert counts[1] > 1.5 * expected

    def test_a_tail_goes_on_beyond_the_sample(self):
        drawn = np.random.default_rng(4).exponential(size=2000)
        # the quantile at 1 - 1e-5 of an exponential distribution, about its mean in its deviation
        assert tail_quantiles(drawn)[-1] == pytest.approx(-np.log(1e-5) - 1, rel=0.2)

    def test_a_tail_known_from_few_is_one_that_the_next_value_exceeds_as_stated(self):
        rng, share = np.random.default_rng(6), 0.05
        above, trials, known = 0, 400, 400  # 20 values in the tail
        for _ in range(trials):
            drawn = rng.exponential(size=known)
            limit = tail_quantiles(drawn, known)[-7] * drawn.std() + drawn.mean()  # at 10^-3.5 above
            above += np.exp(-limit)  # the probability that the next one is above
        assert share / 20 > 10**-3.5  # in the tail
        assert above / trials == pytest.approx(10**-3.5, rel=0.15)

    def test_none_of_what_does_not_vary(self):
        assert own_scores(np.ones((400, 2)))[1] == 0.0


def test_an_alarm_of_the_baseline_is_part_of_what_was_normal():
    limits = chart_limits(30, 1e4, CARRIED_OVER)
    baseline = np.zeros((30, 3))
    baseline[[4, 6], 1] = 3 * limits.limits[0], 2 * limits.limits[0]  # two of three
    baseline[[4, 16], 2] = 5 * limits.limits[0]  # each by itself
    none, two, apart = limits.headroom(baseline, AlarmRule())
    assert (none, apart) == (1.0, 1.0)
    # a burst is above 1 + x with the share of bursts times (1 + x/3)^-2, and two of three are with 2 p^2
    p = 2.5 / 31 * (1 + (two - 1) / 3) ** -2
    assert 2 * p**2 == pytest.approx(1e-4)


def test_bursts_of_a_baseline_give_limits_that_later_ones_exceed_at_the_stated_rate():
    rng, single = np.random.default_rng(5), AlarmRule(of=1, within=1)
    limits = chart_limits(30, 100.0, CARRIED_OVER, rule=single)
    bursts = limits.limits[0] * (1 + 2 * rng.exponential(size=(4, 40_000)))  # of the last, and three of a baseline
    factor = limits.headroom(np.concatenate([bursts[:3], np.zeros((17, 40_000))]), single)
    above = (bursts[3] >= factor * limits.limits[0]).mean() * 3.5 / 21
    assert above == pytest.approx(1 / 100, rel=4 / np.sqrt(40_000 * 0.06))  # four deviations of the count


def test_fewer_records_need_wider_limits():
    assert chart_limits(5, 1e4, CARRIED_OVER).limits[0] > 1.1 * chart_limits(300, 1e4, CARRIED_OVER).limits[0]


def test_refusals():
    with pytest.raises(ValueError, match="a baseline of 1 records has no spread; learn it on 2 or more"):
        chart_limits(1, 1e4, CARRIED_OVER)
    with pytest.raises(ValueError, match="give more"):
        chart_limits(30, 5, CARRIED_OVER)
