import numpy as np
import pytest

from signals.monitoring.alarm_life import AlarmRule
from signals.monitoring.limits import HealthyScores, chart_limits

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


def test_fewer_records_need_wider_limits():
    assert chart_limits(5, 1e4, CARRIED_OVER).limits[0] > 1.1 * chart_limits(300, 1e4, CARRIED_OVER).limits[0]


def test_refusals():
    with pytest.raises(ValueError, match="a baseline of 1 records has no spread; learn it on 2 or more"):
        chart_limits(1, 1e4, CARRIED_OVER)
    with pytest.raises(ValueError, match="give more"):
        chart_limits(30, 5, CARRIED_OVER)
