"""Every refusal names what was given, what was needed and what to do."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import track_orders

PHASE = 0.3 * np.arange(100)
X = np.cos(PHASE)
HOLED = np.where(np.arange(100) < 97, np.nan, X)
GOOD = {"x": X, "phase_rad": PHASE, "orders": [1], "bandwidth_hz": 0.02, "rate_hz": 1.0}
SHAFTS = {"sun": PHASE, "planet": 0.5 * PHASE}

REFUSED = [
    ({"x": np.full(100, np.nan)}, "x has 0 observed samples of 100; to estimate the noise"),
    ({"x": np.where(np.arange(100) == 7, -np.inf, X)}, r"x\[7\]=-inf \(and 0 more\) is infinite.*mark bad samples"),
    (
        {"x": [X, np.full(100, np.nan), X]},
        r"x\[1\] has 0 observed samples of 100; .* pass noise_variance, or more samples, or leave this channel out",
    ),
    ({"x": 1e160 * X}, r"x reaches 1e\+160, whose square is lost .*; scale the record .* between 1e-120 and 1e\+120"),
    ({"x": np.where(np.arange(100) == 7, -1e130, X)}, r"x reaches 1e\+130, .* or mark bad samples as NaN"),
    ({"noise_variance": 1e-300}, "noise_variance=1e-300 must lie between 1e-250 and 1e.250; give it in another unit"),
    ({"noise_variance": 1.0, "initial_std": 1e200}, r"initial_std=1e\+200 is 1e\+200 standard deviations of the noise"),
    ({"noise_variance": 1e200, "initial_std": 1e-50}, "initial_std=1e-50 is 1e-150 standard deviations of the noise"),
    (
        {"bandwidth_hz": 1e-200},
        "bandwidth_hz is 1e-200 cycles a sample at most for order number 0; it must reach 1e-100",
    ),
    ({"x": HOLED}, "x has 3 observed samples of 100; to estimate the noise beside 1 orders with poles=1, 4 are needed"),
    ({"phase_rad": PHASE[1:]}, "phase_rad has 99 values for 100 samples of x; give one angle per sample"),
    ({"phase_rad": np.where(np.arange(100) > 90, np.nan, PHASE)}, r"phase_rad\[91\]=nan \(and 8 more\).*interpolate"),
    ({"phase_rad": SHAFTS | {"sun": PHASE[:5]}, "orders": [("sun", 1)]}, r"phase_rad\['sun'\] has 5 values for 100"),
    ({"orders": []}, "orders is empty; name at least one"),
    ({"orders": [-2]}, "order=-2 is negative; a real record has the same line at 2, conjugated: track that one"),
    ({"orders": [("sun", 1)]}, r"order \('sun', 1\) names a shaft, but phase_rad is one array; pass a mapping"),
    (
        {"orders": [1], "phase_rad": SHAFTS},
        r"order 1 names no shaft.*give \(shaft, order\) pairs, such as \('sun', 1\)",
    ),
    (
        {"orders": [("son", 1)], "phase_rad": SHAFTS},
        "no phase for shaft 'son'; phase_rad has sun, planet. Did you mean 'sun'",
    ),
    (
        {"orders": [1, 11]},
        "order 11 turns by 3.3 rad between samples .* and .*; more than pi is above half of the rate",
    ),
    ({"bandwidth_hz": None}, "bandwidth and rate: rate_hz given; needed bandwidth_hz with rate_hz, or"),
    (
        {"rate_hz": None, "samples_per_rev": 64},
        "bandwidth_hz with samples_per_rev: a record over angle does not tell its speed",
    ),
    (
        {"bandwidth_orders": 0.1},
        "bandwidth and rate: bandwidth_hz, bandwidth_orders, rate_hz given.*leave the others out",
    ),
    ({"bandwidth_hz": 0}, "bandwidth_hz=0 must be above 0 and below 0.5, half of rate_hz=1; choose one in between"),
    ({"bandwidth_hz": np.nan}, "bandwidth_hz has values that are not finite; give bandwidths below half of the rate"),
    ({"bandwidth_hz": [0.1, 0.2]}, "bandwidth_hz has 2 values for 1 orders; pass one number for all, or one each"),
    ({"bandwidth_hz": [[0.1]]}, r"bandwidth_hz has shape \(1, 1\) .* needs the shape \(1, 100\)"),
    (
        {"bandwidth_hz": np.zeros((1, 100))},
        "bandwidth_hz is 0 cycles a sample at most for order number 0; it must reach",
    ),
    ({"rtol": 0.5}, "rtol=0.5 is above 0.1"),
    ({"poles": 5}, "poles=5 must be a whole number from 1 to 4"),
    (
        {"estimator": "smother"},
        "estimator='smother' is unknown; it must be one of smoother, filter. Did you mean 'smoother'",
    ),
    ({"initial_std": 1.0}, "initial_std=1 weighs against the noise.*pass noise_variance too, or neither"),
    ({"clip_limits": [1.0, -1.0]}, "clip_limits=.* must be two numbers, the smaller first"),
    ({"clip_limits": [-1.0, 1.0], "estimator": "filter"}, "only the smoother fits them"),
]


@pytest.mark.parametrize(("change", "sentence"), REFUSED)
def test_refusal(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        track_orders(**GOOD | change)


@pytest.mark.parametrize("scale", [1e-118, 1e118])
@pytest.mark.parametrize("method", ["exact", "fast"])
@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_units_within_bounds_scale_the_answer_alone(scale, method, estimator):
    rng = np.random.default_rng(0)
    phase = 0.3 * np.arange(5000)
    x = np.cos(phase) + 0.1 * rng.standard_normal(5000)
    settings = {"phase_rad": phase, "orders": [1, 2], "bandwidth_hz": 0.002, "rate_hz": 1.0, "output_every": 50}
    settings |= {"method": method, "estimator": estimator}
    one, other = track_orders(x, **settings), track_orders(scale * x, **settings)
    for name in ("complex_amplitude", "std"):
        assert_allclose(getattr(other, name) / scale, getattr(one, name), rtol=1e-9)
    assert other.innovation_mean_square == pytest.approx(one.innovation_mean_square, rel=1e-9)


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize(("method", "estimator"), [("fast", "smoother"), ("fast", "filter"), ("exact", "smoother")])
def test_an_amplitude_that_may_not_change_at_all_is_regression(poles, method, estimator):
    rng = np.random.default_rng(0)
    phase = 0.3 * np.arange(2000)
    x = np.cos(phase + 0.5) + 0.1 * rng.standard_normal(2000)
    tracks = track_orders(
        x, phase_rad=phase, orders=[1], bandwidth_hz=1e-40, rate_hz=1.0, poles=poles, method=method, estimator=estimator
    )
    rows = np.stack([np.cos(phase), -np.sin(phase)], axis=1)
    real, imaginary = np.linalg.lstsq(rows, x)[0]
    # The prior pulls by some 1e-9; fast's triangular weights, at the ends, leave some 1e-3 of std 3e-3.
    assert abs(tracks.complex_amplitude[0, -1] - complex(real, imaginary)) < (1e-8 if method == "exact" else 1e-3)


def test_a_few_samples_do_with_the_noise_given():
    tracks = track_orders(**GOOD | {"x": HOLED, "noise_variance": 0.1})
    assert np.all(np.isfinite(tracks.complex_amplitude))
    assert np.all(tracks.std[:, 0] > tracks.std[:, 98])


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_a_single_sample_is_a_record(method):
    settings = {"phase_rad": [0.0], "orders": [1], "bandwidth_hz": 0.1, "rate_hz": 1.0, "method": method}
    tracks = track_orders([2.0], noise_variance=1.0, initial_std=3.0, **settings)
    # One equation, x = a + v: the posterior mean is 9 / 10 of it; the other quadrature keeps its prior.
    assert tracks.complex_amplitude[0, 0] == pytest.approx(1.8)
    assert tracks.std[0, 0] == pytest.approx(np.sqrt((0.9 + 9) / 2))


def test_lost_digits_are_an_error_with_numbers():
    with pytest.raises(FloatingPointError, match=r"poles=4, a narrowest bandwidth of 0.02 .* prior of 1e\+14"):
        track_orders(**GOOD | {"orders": [0, 0.01, 0.02], "poles": 4, "noise_variance": 1.0, "initial_std": 1e14})
