import numpy as np
import pytest

from signals.monitoring.trends import trend_tests


def noise(records, series, seed, *, common=0.0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((records, series)) + common * rng.standard_normal((records, 1))


class TestFound:
    TIMES = np.arange(40.0)

    def test_a_rise_a_step_and_a_growth_among_noise(self):
        values = noise(40, 60, 1)
        values[:, 3] += 0.15 * self.TIMES
        values[25:, 7] -= 4
        values[:, 9] += 6 * np.exp((self.TIMES - 39) / 6)
        found = trend_tests(values, self.TIMES)
        assert np.flatnonzero(found.discovery_rate < 0.02).tolist() == [3, 7, 9]
        assert found.form[7] == "step"
        assert found.rises[[3, 7, 9]].tolist() == [True, False, True]

    def test_many_that_rise_a_little_are_found_together(self):
        # 62-fold growth over eight records with tau 0.93: one pair out of order
        values = noise(8, 75, 2, common=0.3) * 0.3
        values[:, :30] += np.linspace(0, np.log(62), 8)[:, None]
        found = trend_tests(values, np.arange(8.0))
        assert (found.discovery_rate[:30] < 0.01).mean() > 0.9

    def test_the_order_of_the_records_does_not_matter(self):
        values, shuffled = noise(30, 5, 3), np.random.default_rng(4).permutation(30)
        there, here = trend_tests(values, np.arange(30.0)), trend_tests(values[shuffled], np.arange(30.0)[shuffled])
        assert np.array_equal(there.discovery_rate, here.discovery_rate)


class TestNothing:
    def test_no_more_than_the_stated_share_of_fleets_has_one(self):
        # of 20 machines without a trend, at a rate of 5 %: more than 4 have a probability of 0.3 %
        found = [trend_tests(noise(12, 20, seed, common=1.0), np.arange(12.0)) for seed in range(20)]
        assert sum((one.discovery_rate < 0.05).any() for one in found) <= 4

    def test_constants_and_gaps(self):
        values = noise(10, 3, 6)
        values[:, 1], values[:4, 2] = 2.0, np.nan
        found = trend_tests(values, np.arange(10.0))
        assert np.isnan(found.discovery_rate).tolist() == [False, True, False]

    def test_too_few(self):
        with pytest.raises(ValueError, match="4 records are too few to test; a trend needs 5"):
            trend_tests(noise(4, 2, 1), np.arange(4.0))
