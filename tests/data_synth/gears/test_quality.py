"""Tolerances of ISO 1328-1:2013, and gears that have them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.gears.quality import (
    cumulative_pitch_m,
    cumulative_pitch_tolerance_m,
    runout_tolerance_m,
    single_pitch_tolerance_m,
)


@pytest.mark.parametrize(
    ("diameter_mm", "module_mm", "grade", "single", "cumulative"),
    [
        # equations 5 and 6 by hand, in um: 0.1 + 1.6 + 5; 0.2 + 5.5 + 2.8 + 12
        (100, 4, 5, 6.7, 20.5),
        (100, 4, 7, 13.4, 41.0),  # two grades are twice the tolerance
        (400, 10, 5, 9.4, 30.8),  # 0.4 + 4 + 5; 0.8 + 11 + 7 + 12
        (900, 0.5, 1, 1.525, 7.6625),  # (0.9 + 0.2 + 5) / 4; (1.8 + 16.5 + 0.35 + 12) / 4
    ],
)
def test_tolerances_by_the_formulas(diameter_mm, module_mm, grade, single, cumulative):
    size = {"diameter_m": 1e-3 * diameter_mm, "module_m": 1e-3 * module_mm, "grade": grade}
    assert_allclose(1e6 * single_pitch_tolerance_m(**size), single, rtol=1e-12)
    assert_allclose(1e6 * cumulative_pitch_tolerance_m(**size), cumulative, rtol=1e-12)
    assert_allclose(1e6 * runout_tolerance_m(**size), 0.9 * cumulative, rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"grade": 12}, "grade = 12: ISO 1328-1:2013 covers 1 to 11"),
        ({"diameter_m": 4e-3}, "diameter = 4 mm: ISO 1328-1:2013 covers 5 to 15000 mm"),
        ({"module_m": 0.08}, "module = 80 mm: ISO 1328-1:2013 covers 0.5 to 70 mm"),
    ],
)
def test_what_the_standard_lacks_is_refused(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        single_pitch_tolerance_m(**{"diameter_m": 0.1, "module_m": 4e-3, "grade": 6, **changes})


@pytest.mark.parametrize("teeth", [23, 24, 67])
def test_a_gear_has_its_run_out_and_single_pitch_deviation(teeth):
    deviation = cumulative_pitch_m(teeth=teeth, runout_m=30e-6, single_pitch_m=8e-6, rng=np.random.default_rng(teeth))
    # measured as a pitch gauge and an eccentricity by least squares do
    assert_allclose(np.max(np.abs(np.diff(deviation, append=deviation[0]))), 8e-6, rtol=1e-9)
    turn = 2 * np.pi * np.arange(teeth) / teeth
    waves = np.stack([np.ones(teeth), np.cos(turn), np.sin(turn)], axis=1)
    mean, cosine, sine = np.linalg.lstsq(waves, deviation, rcond=None)[0]
    assert_allclose([2 * np.hypot(cosine, sine), mean], [30e-6, 0], atol=1e-15)


def test_an_eccentric_gear_may_have_no_scatter_left():
    rng = np.random.default_rng(1)
    deviation = cumulative_pitch_m(teeth=20, runout_m=100e-6, single_pitch_m=1e-6, rng=rng)
    assert np.max(np.abs(np.fft.rfft(deviation)[2:])) < 1e-18
    assert not cumulative_pitch_m(teeth=20, runout_m=0, single_pitch_m=0, rng=rng).any()
