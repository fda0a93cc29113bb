import numpy as np
import pytest
from fleet_forecasts import LAWS, coverage
from scipy.stats import binom

from signals.monitoring.forecast import time_until


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
