import numpy as np
import pytest

from signals.monitoring.memory import independent_records

HOUR_S = 3600.0


def process(records, step_s, memory_s, seed, series=200):
    """Stationary Ornstein-Uhlenbeck processes of variance 1; white noise where the memory is zero."""
    rng, decay = np.random.default_rng(seed), np.exp(-step_s / memory_s) if memory_s else 0.0
    found = rng.standard_normal((records, series))
    for number in range(1, records):
        found[number] = decay * found[number - 1] + np.sqrt(1 - decay**2) * found[number]
    return found, step_s * np.arange(records)


def test_records_far_apart_count_fully():
    assert np.median(independent_records(*process(30, 86400.0, HOUR_S, 1)), axis=1).min() > 0.9 * 30


@pytest.mark.parametrize(("records", "step_s", "memory_s"), [(100, 300.0, HOUR_S), (300, 24 * HOUR_S, 240 * HOUR_S)])
def test_a_memory_that_many_records_show_has_the_number_of_its_process(records, step_s, memory_s):
    decay, lags = np.exp(-step_s / memory_s), np.arange(1, records)
    # Bayley and Hammersley 1946, of the mean and of the variance
    expected = [records / (1 + 2 * ((1 - lags / records) * of**lags).sum()) for of in (decay, decay**2)]
    found = np.median(independent_records(*process(records, step_s, memory_s, 2)), axis=1)
    assert found == pytest.approx(expected, rel=0.35)


def test_the_shorter_the_memory_the_more_they_count():
    processes = [process(100, 300.0, hours * HOUR_S, 5) for hours in (0.0, 0.1, 1.0, 10.0)]
    found = [np.median(independent_records(*one)[0]) for one in processes]
    assert found == sorted(found, reverse=True)
    assert found[0] > 3 * found[2]


def test_few_close_records_are_held_between_one_and_all():
    white, slow = (np.median(independent_records(*process(7, 100.0, memory, 3))[0]) for memory in (0.0, 10 * HOUR_S))
    assert 1 < slow < white < 7


def test_without_times_all_count():
    scores, _ = process(12, 1.0, 0.0, 4)
    assert (independent_records(scores, np.full(12, np.nan)) == 12).all()


def test_what_does_not_vary_and_equal_times_have_a_number():
    found = independent_records(np.ones((5, 2)), np.zeros(5))
    assert ((found >= 1) & (found <= 5)).all()
