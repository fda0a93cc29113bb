"""Slopes against the truth: their intervals hold it whatever the errors remember."""

import numpy as np
import pytest
from fleet_forecasts import LAWS, coverage
from scipy.signal import lfilter
from scipy.stats import binom

from signals.monitoring.slopes import series_slopes, time_until

SERIES = 400


def errors(records, decay, seed, *, white=0.0):
    """Stationary AR(1) series of variance 1, and white noise."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((records + 200, SERIES)) * np.sqrt(1 - decay**2)
    return lfilter([1], [1, -decay], noise, axis=0)[200:] + white * rng.standard_normal((records, SERIES))


@pytest.mark.parametrize(
    ("records", "decay", "white"),
    [(20, 0.0, 0), (40, 0.5, 0), (40, 0.9, 0), (100, 0.9, 0), (100, 0.9, 1), (300, 0.9, 0)],
)
def test_intervals_of_95_percent_hold_the_slope(records, decay, white):
    times = np.arange(records, dtype=np.float64)
    found = series_slopes(0.02 * times[:, None] + errors(records, decay, records, white=white), times)
    inside = np.mean((found.slope_low < 0.02) & (found.slope_high > 0.02))
    assert 0.90 <= inside <= 0.995  # of 400 series; the error of a share of 95 % is 1 %


def test_quantised_values_have_an_interval_and_hold_it():
    values = np.round(errors(100, 0.9, 1))
    found = series_slopes(values, np.arange(100.0))
    assert (found.slope_high > found.slope_low).all()
    assert 0.90 <= np.mean((found.slope_low < 0) & (found.slope_high > 0)) <= 0.995


def test_white_errors_have_an_interval_half_as_wide_again_as_least_squares_at_most():
    times, values = np.arange(60.0), errors(60, 0.0, 2)
    found = series_slopes(values, times)
    width = 2 * 2.0 / np.sqrt(((times - times.mean()) ** 2).sum())  # Student's t of 58 degrees of freedom: 2.00
    assert width < np.median(found.slope_high - found.slope_low) < 1.5 * width  # that they are white is not known
    rises = series_slopes(values + 0.1 * times[:, None], times)  # 12 standard errors
    assert np.mean(rises.p_value < 0.01) > 0.95
    assert np.mean(found.p_value < 0.01) < 0.02


def test_a_long_straight_line_keeps_its_slope():
    times = np.sort(np.random.default_rng(2).uniform(0, 100, 10_000))
    found = series_slopes((3 - 0.25 * times)[:, None], times)
    assert found.records == 10_000
    # medians of groups of 100 lie on the line; of even groups both medians average the same two
    assert found.slope_per_day == pytest.approx([-0.25], rel=1e-9)


def test_gaps_are_left_out_and_too_little_is_no_slope():
    times = np.array([0.0, 1, 2, 3, 4, 5, np.nan])
    values = np.array([[1.0, np.nan, 2, 3, 4, 5, 9], [1, np.nan, 2, 3, 4, np.nan, 9], [1.0] * 7]).T
    found = series_slopes(values, times)
    assert found.records.tolist() == [5, 4, 6]
    assert found.median.tolist() == [3.0, 2.5, 1.0]
    assert found.change[0] == 5.0  # a third of five values is one
    assert np.isfinite(found.slope_per_day).tolist() == [True, False, False]
    assert np.isnan(series_slopes(values, np.ones(7)).slope_per_day).all()


class TestDiscovery:
    """Lines and late growth among series that do not change, of which all depend on each other."""

    TIMES = np.arange(40.0)

    @staticmethod
    def logarithms(records, series, seed, *, common=0.0):
        rng = np.random.default_rng(seed)
        return rng.standard_normal((records, series)) + common * rng.standard_normal((records, 1))

    def test_a_rise_a_fall_and_late_growth_are_found_and_no_other(self):
        values = self.logarithms(40, 60, 1)
        values[:, 3] += 0.15 * self.TIMES
        values[:, 7] -= 0.15 * self.TIMES
        values[:, 9] += 6 * np.exp((self.TIMES - 39) / 6)
        found = series_slopes(np.exp(values), self.TIMES)
        assert np.flatnonzero(found.adjusted_p < 0.02).tolist() == [3, 7, 9]
        assert found.trend[[3, 7, 9]].tolist() == ["rising", "falling", "rising"]
        assert found.form[[3, 9]].tolist() == ["line", "growth"]

    def test_many_that_rise_are_found_together(self):
        values = self.logarithms(8, 75, 2, common=0.3) * 0.3
        values[:, :30] += np.linspace(0, np.log(62), 8)[:, None]
        found = series_slopes(np.exp(values), np.arange(8.0))
        assert (found.adjusted_p[:30] < 0.01).mean() > 0.9

    def test_no_more_than_the_stated_share_of_machines_has_one(self):
        # of 20 machines without a trend, at a rate of 5 %: more than 4 have a probability of 0.3 %
        values = [self.logarithms(12, 20, seed, common=1.0) for seed in range(20)]
        found = [series_slopes(np.exp(one), np.arange(12.0)) for one in values]
        assert sum((one.adjusted_p < 0.05).any() for one in found) <= 4


class TestTimeUntil:
    TIMES = np.arange(60.0)

    def series(self, seed, slope=0.12, noise=0.2):
        return slope * self.TIMES + noise * np.random.default_rng(seed).standard_normal(60)

    def test_of_a_line(self):
        found = time_until(8.0, self.series(1), self.TIMES)
        true = 8 / 0.12 - 59
        assert found.low < true < found.high
        assert found.median == pytest.approx(true, rel=0.2)

    def test_time_is_from_the_last_of_many_values(self):
        times = np.arange(6000) / 100
        many = 0.12 * times + 0.2 * np.random.default_rng(2).standard_normal(6000)
        found = time_until(8.0, many, times)
        assert found.median == pytest.approx(8 / 0.12 - times[-1], rel=0.1)

    @pytest.mark.parametrize("law", LAWS)
    def test_intervals_hold_what_is_true(self, law):
        inside, width, _ = coverage(law, 45)
        assert inside.sum() >= binom.ppf(0.001, inside.size, 0.85)
        assert np.isfinite(width).all()

    def test_lines_and_later_onsets_have_forecasts(self):
        assert coverage("line", 45)[0].size >= 12
        assert coverage("line from an onset on", 45)[0].size >= 5

    def test_none_without_a_rise(self):
        found = time_until(8.0, self.series(2, slope=0.0), self.TIMES)
        assert found.reason == "none can be given: it does not rise for certain"

    def test_none_once_it_is_reached(self):
        assert time_until(3.0, self.series(3), self.TIMES).reason == "the limit is reached already"

    def test_none_without_an_upper_end(self):
        found = [time_until(limit, self.series(3), self.TIMES) for limit in (9.0, 100.0)]
        assert np.isfinite(found[0].high)
        assert found[1].reason == "none can be given: it may take more than 3 times the time watched"

    def test_too_few_values_have_a_reason(self):
        known = np.where(np.arange(9) < 7, 1.0, np.nan)
        assert time_until(8.0, known, np.arange(9.0)).reason.startswith("7 values are too few")
        assert time_until(8.0, np.arange(9.0), np.zeros(9)).reason.startswith("1 values are too few")
