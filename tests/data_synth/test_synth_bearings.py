import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import load_scene
from data_synth.bearings import impact_revolutions, impact_weights, load_zone_order, stribeck_load
from data_synth.scene import BearingFault


def fault(**changes):
    return BearingFault(**{"kind": "inner_race", "component": "input bearing", "size_mm": 1.0, **changes})


def test_without_slip_impacts_are_evenly_spaced():
    struck = impact_revolutions(order=5.5, fault=fault(slip_std=0.0), span_rev=(-1, 99), rng=np.random.default_rng(0))
    assert_allclose(np.diff(struck), 1 / 5.5, rtol=1e-10)
    assert struck[0] + 1 < 1 / 5.5
    assert 99 - struck[-1] < 1 / 5.5


def test_slip_accumulates_as_a_random_walk():
    # the n-th impact after the first scatters by sigma sqrt(n) intervals: variance grows in proportion to n
    sigma, order, trains = 0.02, 4.0, 600
    rng = np.random.default_rng(1)
    lags = np.array([1, 16, 256])
    late = []
    for _ in range(trains):
        struck = impact_revolutions(order=order, fault=fault(slip_std=sigma), span_rev=(0, 80), rng=rng)
        late.append((struck[lags] - struck[0]) * order - lags)
    variance = np.mean(np.square(late), axis=0)
    # a variance of 600 normal errors is known to sqrt(2 / 600) = 6 %; 4 of that
    assert_allclose(variance, sigma**2 * lags, rtol=0.24)


@pytest.mark.parametrize("mean_slip", [0.0, 0.05])
def test_the_mean_rate_is_that_of_rolling_less_the_slip(mean_slip):
    given = fault(mean_slip=mean_slip, slip_std=0.01)
    struck = impact_revolutions(order=3.6, fault=given, span_rev=(0, 5000), rng=np.random.default_rng(2))
    # 18000 intervals of 1 %: their mean is known to 0.01 / sqrt(18000) = 7.5e-5; 4 of that
    assert_allclose(1 / np.mean(np.diff(struck)), 3.6 * (1 - mean_slip), rtol=3e-4)


def test_the_load_zone_is_as_wide_as_its_factor_says():
    angle = np.radians([0, 60, 90, 180])
    assert_allclose(stribeck_load(angle, distribution=0.5), [1, 0.5**1.5, 0, 0], atol=1e-12)
    assert_allclose(stribeck_load(angle, distribution=1.0), [1, 0.75**1.5, 0.5**1.5, 0], atol=1e-12)


def test_only_a_part_that_turns_passes_the_load_zone():
    rates = load_scene("demo").bearing("intermediate bearing")
    assert load_zone_order("inner_race", rates) == pytest.approx(23 / 67)
    assert load_zone_order("rolling_element", rates) == rates.cage
    assert load_zone_order("outer_race", rates) == 0
    assert load_zone_order("cage", rates) == 0
    rev = np.linspace(0, 3, 50)
    assert_allclose(impact_weights(rev, order=0.0, fault=fault(), rng=np.random.default_rng(3)), 1)
    weights = impact_weights(rev, order=1.0, fault=fault(), rng=np.random.default_rng(3))
    assert weights.max() <= 1
    assert 0.3 < np.mean(weights == 0) < 0.7  # half of the turn is outside of the zone
