import numpy as np
import pytest

from signals.monitoring.autocorrelation import Correlation, effective_records, slow_variance, variance_shares
from signals.monitoring.limits import HealthyScores


def test_white_records_count_one_each():
    assert effective_records(np.array([1.0, 0, 0, 0]), 40, Correlation()) == pytest.approx(40)


def test_a_sum_over_all_pairs():
    # variance of a mean from the covariance matrix itself
    shares, lengths = np.array([0.5, 0.2, 0.2, 0.1]), Correlation()
    lags = np.abs(np.subtract.outer(np.arange(30), np.arange(30)))
    covariance = np.einsum("k,kij->ij", shares, lengths.of_lags(lags.ravel()).reshape(4, 30, 30))
    assert effective_records(shares, 30, lengths) == pytest.approx(1 / covariance.mean(), rel=1e-12)


def test_shares_of_drawn_series():
    true = (0.5, 0.3, 0.2, 0.0)
    drawn = HealthyScores(shares=(true,)).draw(20, 3000, np.random.default_rng(1))
    found = np.mean([variance_shares(series, Correlation()) for series in drawn.T], axis=0)
    assert found == pytest.approx(true, abs=0.08)  # 20 series of 60 long correlation lengths each


def test_what_does_not_vary_is_white():
    assert variance_shares(np.ones(50), Correlation()).tolist() == [1, 0, 0, 0]


def test_slow_variance_is_that_of_the_correlated_part():
    scores = HealthyScores(shares=((0.6, 0.4, 0.0, 0.0),)).draw(20, 4000, np.random.default_rng(2))
    found, error = slow_variance(scores)
    expected = 20 * 0.4 * np.exp(-np.arange(1, 6) / 5).mean()
    assert found == pytest.approx(expected, abs=6 * error)  # a correlated series has more error than a white one
    scores[::7] = np.nan
    assert slow_variance(scores)[0] == pytest.approx(found, rel=0.1)


def test_slow_variance_of_white_series_is_within_its_error():
    found, error = slow_variance(np.random.default_rng(3).standard_normal((500, 100, 10)))
    assert found.std() == pytest.approx(error.mean(), rel=0.15)  # 500 of them
    assert found.mean() == pytest.approx(-10 / 100, rel=0.3)  # autocovariances about the sample's own mean
