import numpy as np
import pytest

from signals.monitoring.memory import learn_memory

HOUR_S = 3600.0


def process(records, step_s, memory_s, seed, series=200):
    """Stationary Ornstein-Uhlenbeck processes of variance 1; white noise where the memory is zero."""
    rng, decay = np.random.default_rng(seed), np.exp(-step_s / memory_s) if memory_s else 0.0
    found = rng.standard_normal((records, series))
    for number in range(1, records):
        found[number] = decay * found[number - 1] + np.sqrt(1 - decay**2) * found[number]
    return found, step_s * np.arange(records)


def learned(scores, times):
    return learn_memory(scores, times, prior_scale=1.0)


def of_mean(memory):
    return np.median(memory.of_mean @ memory.weight)


@pytest.mark.parametrize(("records", "step_s", "memory_s"), [(30, 86400.0, 0.0), (100, 86400.0, 10 * 86400.0)])
def test_the_uncertainty_of_the_mean_is_at_least_that_of_its_process(records, step_s, memory_s):
    decay, lags = np.exp(-step_s / memory_s) if memory_s else 0.0, np.arange(1, records)
    expected = (1 + 2 * ((1 - lags / records) * decay**lags).sum()) / records  # Bayley and Hammersley 1946
    assert 0.9 * expected < of_mean(learned(*process(records, step_s, memory_s, 2))) < 6 * expected


def test_close_records_leave_the_mean_uncertain_and_hide_a_part_of_the_variance():
    apart, close = (learned(*process(30, step, HOUR_S, 1)) for step in (86400.0, 100.0))
    assert of_mean(close) > 2 * of_mean(apart)
    assert np.median(close.shown) < 0.7 * np.median(apart.shown)


def test_the_longer_the_memory_the_less_certain_the_mean():
    found = [of_mean(learned(*process(100, 3600.0, hours * HOUR_S, 5))) for hours in (0.0, 3.0, 30.0)]
    assert found[0] < found[1] < found[2]


def test_a_moving_average_of_white_scores_has_the_variance_of_its_weights():
    memory = learned(*process(30, 86400.0, 0.0, 6))
    white = memory.drift == 0
    assert memory.filtered(np.full(4, 0.25))[white] == pytest.approx(memory.white[white] / 4)


def test_a_moving_average_of_what_stays_is_what_stays():
    memory = learned(*process(10, 1.0, 0.0, 6))  # a second apart: within half an hour nothing changes
    variance = memory.filtered(np.full(4, 0.25)) - memory.white / 4
    assert variance == pytest.approx(memory.drift, rel=0.01)


def test_without_times_records_are_a_day_apart():
    scores, _ = process(12, 1.0, 0.0, 4)
    assert of_mean(learned(scores, np.full(12, np.nan))) == of_mean(learned(scores, 86400.0 * np.arange(12)))


def test_what_does_not_vary_and_equal_times_have_a_number():
    found = learned(np.zeros((5, 2)), np.zeros(5))
    assert np.isfinite(found.weight).all()
    assert found.weight.sum(axis=0) == pytest.approx(1)
