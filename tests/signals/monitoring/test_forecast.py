import numpy as np
import pytest

from signals.monitoring.forecast import local_trend, time_until


class TestTimeUntil:
    TIMES = np.arange(60.0)

    def series(self, seed, slope=0.1, noise=0.2):
        return slope * self.TIMES + noise * np.random.default_rng(seed).standard_normal(60)

    def test_of_a_line(self):
        found = time_until(8.0, local_trend(self.series(1), self.TIMES), span=59)
        assert found.low < 80 - 59 < found.high
        assert found.median == pytest.approx(21, rel=0.3)

    def test_intervals_of_lines_hold_what_is_true(self):
        inside = 0
        for seed in range(12):
            found = time_until(8.0, local_trend(self.series(seed), self.TIMES), span=59)
            inside += found.low <= 21 <= found.high
        assert inside >= 8  # of 12 at 90 %: fewer has a probability of 0.4 %

    def test_intervals_of_several_laws_of_growth_hold_what_is_true(self):
        # linear, quadratic, exponential by 3 e-foldings, and steps, which no clock of the model has; 48 series
        inside = given = 0
        for seed in range(48):
            rng = np.random.default_rng(seed)
            total = int(rng.integers(60, 160))
            share = np.arange(total + 1) / total
            laws = (share, share**2, np.expm1(3 * share) / np.expm1(3), np.floor(6 * share) / 6)
            level, now = 12 * laws[seed % 4], int(total * rng.uniform(0.55, 0.8))
            seen = level[:now] + rng.standard_normal(now)
            found = time_until(12.0, local_trend(seen, np.arange(now, dtype=float)), span=now - 1.0, seed=seed)
            given += not found.reason
            inside += found.low <= total - (now - 1) <= found.high
        assert given >= 30
        assert 0.80 <= inside / given <= 0.97  # of 46 at 90 %: outside has a probability of 6 %

    def test_none_without_a_rise(self):
        found = time_until(8.0, local_trend(self.series(2, slope=0.0), self.TIMES), span=59)
        assert found.reason == "none can be given: it does not rise for certain"

    def test_none_beyond_the_horizon(self):
        found = time_until(100.0, local_trend(self.series(3), self.TIMES), span=59)
        assert found.reason == "none can be given: more than 3 times the time watched"

    def test_none_without_an_upper_end(self):
        trend = local_trend(self.series(3, noise=2.0), self.TIMES)
        found = [time_until(limit, trend, span=59) for limit in (14.0, 24.0)]
        assert np.isfinite(found[0].high)
        assert found[1].reason == "none can be given: it may take more than 3 times the time watched"

    def test_refusals(self):
        with pytest.raises(ValueError, match="7 values are too few for a forecast; it needs 8"):
            local_trend(np.arange(7.0), np.arange(7.0))
        with pytest.raises(ValueError, match="have to rise"):
            local_trend(np.arange(9.0), np.zeros(9))
