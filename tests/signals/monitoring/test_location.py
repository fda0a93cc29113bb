import numpy as np
import pytest
from scipy import stats

from signals.monitoring.location import learn_baseline


def none(*shape):
    return np.zeros((*shape, 0))


class TestRobust:
    def test_of_normal_values_it_is_mean_and_deviation(self):
        values = np.random.default_rng(1).normal(3.0, 2.0, (20_000, 2))
        found = learn_baseline(values, none(20_000))
        # 95 % efficient mean, deviation of 1 / sqrt(2 n)
        assert found.center == pytest.approx([3, 3], abs=4 * 2 / np.sqrt(0.95 * 20_000))
        assert found.scale == pytest.approx([2, 2], rel=4 / np.sqrt(0.6 * 2 * 20_000))

    def test_bad_records_move_neither(self):
        values = np.random.default_rng(2).standard_normal((60, 1))
        bad = values.copy()
        bad[:3] = 1000.0
        clean, found = learn_baseline(values, none(60)), learn_baseline(bad, none(60))
        assert abs(found.center - clean.center) < 0.2  # bias of Huber's estimate at 5 %: below 0.12
        assert found.scale < 1.5 * clean.scale

    def test_a_series_that_is_missing_is_not_watched(self):
        values = np.random.default_rng(3).standard_normal((10, 2))
        values[:6, 1] = np.nan
        found = learn_baseline(values, none(10))
        assert np.isfinite(found.scale).tolist() == [True, False]


class TestPrior:
    def test_variances_are_averaged_by_their_records(self):
        values = np.random.default_rng(4).standard_normal((30, 1))
        own = learn_baseline(values, none(30)).scale
        found = learn_baseline(values, none(30), prior_scale=3.0, prior_dof=8.0).scale
        assert found == pytest.approx(np.sqrt((29 * own**2 + 8 * 9) / 37), rel=1e-12)

    def test_a_long_quiet_baseline_leaves_the_least_deviation(self):
        values = 0.01 * np.random.default_rng(6).standard_normal((300, 2))
        found = learn_baseline(values, none(300), least_scale=np.array([0.1, 0.0]))
        assert found.scale == pytest.approx([0.1, 0.01], rel=4 / np.sqrt(0.6 * 2 * 300))

    def test_two_records_have_it_for_the_most(self):
        found = learn_baseline(np.array([[1.0], [1.0]]), none(2), prior_scale=0.3, prior_dof=8.0)
        assert found.scale == pytest.approx(0.3 * np.sqrt(8 / 9), rel=1e-12)


class TestRegression:
    def test_slopes_on_speed_and_torque(self):
        rng = np.random.default_rng(5)
        at = rng.normal(size=(300, 2))
        values = 1 + at @ np.array([[2.0], [-1.0]]) + 0.1 * rng.standard_normal((300, 1))
        values[:10] += 50  # bad records
        found = learn_baseline(values, at)
        assert found.slopes[:, 0] == pytest.approx([2, -1], abs=0.05)
        assert found.standardised(values[10:], at[10:]).std() == pytest.approx(1, rel=0.2)

    def test_what_does_not_vary_and_too_few_records_have_none(self):
        rng = np.random.default_rng(6)
        at = np.stack([rng.normal(size=40), np.full(40, 7.0)], axis=1)
        values = at[:, :1] * 3 + rng.standard_normal((40, 1)) * 0.01
        assert learn_baseline(values, at).slopes[:, 0] == pytest.approx([3, 0], abs=0.01)
        assert not learn_baseline(values[:9], at[:9, :1]).slopes.any()


class TestForetold:
    """Machines whose 20 series have known slopes on two covariates, learned on 30 records; far: three deviations."""

    RECORDS, COVARIATES, SERIES = 30, 2, 20

    def drawn(self, slope, machines=400):
        rng = np.random.default_rng(8)
        at = rng.normal(size=(machines, self.RECORDS, self.COVARIATES))
        far = 3 * rng.normal(size=(machines, self.COVARIATES))
        slopes = slope * rng.normal(size=(machines, self.COVARIATES, self.SERIES))
        values = at @ slopes + rng.normal(size=(machines, self.RECORDS, self.SERIES))
        new = np.einsum("mc,mcs->ms", far, slopes) + rng.normal(size=(machines, self.SERIES))
        found = learn_baseline(values, at)
        return found, found.standardised(new, far), found.leverage(far)

    def test_departures_far_away_have_the_prediction_interval_of_a_regression(self):
        found, away, leverage = self.drawn(0.5)
        limit = stats.t.ppf(0.95, self.RECORDS - 1 - self.COVARIATES)
        wider = np.sqrt(1 + 1 / self.RECORDS + leverage)[:, None]
        # of 400 machines, each with one error of its slopes: a standard error of 0.0025; Huber's mean costs some 4 %
        assert np.mean(away / wider > limit) == pytest.approx(0.05, abs=0.008)
        assert np.mean(away > limit) > 0.08  # what a regression taken at its word raises
        assert found.regressors.mean() > 1.5

    def test_of_slopes_that_matter_the_leverage_is_that_of_least_squares(self):
        rng = np.random.default_rng(9)
        at, far = rng.normal(size=(40, 2)), np.array([[2.0, -1.0]])
        found = learn_baseline(at @ np.full((2, 5), 1e4) + rng.normal(size=(40, 5)), at)
        design = at - np.median(at, axis=0)
        away = far - np.median(at, axis=0)
        assert found.leverage(far) == pytest.approx((away @ np.linalg.inv(design.T @ design) @ away.T)[0], rel=1e-5)
        assert found.regressors == pytest.approx(2, rel=1e-5)

    def test_covariates_on_which_nothing_depends_have_no_slope(self):
        found, away, leverage = self.drawn(0.0, machines=200)
        assert np.mean(found.regressors > 0) < 0.2
        assert np.median(leverage) == 0
        assert away.std() == pytest.approx(1.05, abs=0.03)  # 1.05 without a regression: 30 records' mean and deviation


def test_many_machines_at_once_are_each_alone():
    rng = np.random.default_rng(7)
    values, at = rng.standard_normal((3, 50, 4)), rng.standard_normal((3, 50, 1))
    together = learn_baseline(values, at)
    for number in range(3):
        alone = learn_baseline(values[number], at[number])
        assert together.center[number] == pytest.approx(alone.center, rel=1e-12)
        assert together.slopes[number] == pytest.approx(alone.slopes, rel=1e-9)
