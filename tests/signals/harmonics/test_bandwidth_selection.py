"""The most likely bandwidth: the density itself, and what it finds in records whose bandwidth is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics.bandwidth import quadrature_noise, variance_ratio
from signals.harmonics.bandwidth_selection import likely_bandwidth

POLES = [1, 2, 3, 4]


def drawn(rng, *, orders, phase, bandwidth, poles, noise=0.25):
    """Return a record whose amplitudes are the model's integrated walks, sample by sample."""
    orders = np.asarray(orders)
    q = quadrature_noise(orders, noise) * variance_ratio(bandwidth, poles)
    walk = np.sqrt(q)[:, None, None] * rng.standard_normal((orders.size, 2, phase.size))
    for _ in range(poles):
        walk = np.cumsum(walk, axis=-1)
    turning = np.exp(1j * orders[:, None] * phase)
    return np.sum(walk[:, 0] * turning.real - walk[:, 1] * turning.imag, axis=0) + np.sqrt(noise) * (
        rng.standard_normal(phase.size)
    )


def scatter_of_log(bandwidth, poles, samples):
    """Standard deviation of log bandwidth: Fisher's information for the spectrum N + q / x^poles, seen twice (Whittle).

    `d log(spectrum) / d log q` is H, `d log q / d log bandwidth` 2 poles; each frequency counts 1 / 2 a quadrature.
    """
    w = np.pi * (np.arange(200_000) + 0.5) / 200_000
    ratio = (np.sin(w / 2) / np.sin(np.pi * bandwidth / 2)) ** (2 * poles)
    H = 1 / (1 + (np.sqrt(2) - 1) * ratio)
    return 1 / (2 * poles * np.sqrt(samples * np.mean(H**2)))


@pytest.mark.parametrize(("poles", "bandwidth"), [(1, 2e-3), (1, 8e-3), (2, 8e-3), (3, 2e-3)])
def test_known_bandwidth_comes_back_without_bias(poles, bandwidth):
    samples, repeats = 5000, 30
    n = np.arange(samples)
    phase = 2 * np.pi * (0.02 * n + 5 * np.sin(2 * np.pi * n / samples))
    found = [
        likely_bandwidth(
            drawn(np.random.default_rng([poles, k]), orders=[1.0], phase=phase, bandwidth=bandwidth, poles=poles),
            phase_rad=phase, orders=[1], rate_hz=1.0, largest_bandwidth_hz=0.012, poles=poles, noise_variance=0.25,
        )[0]
        for k in range(repeats)
    ]  # fmt: skip
    scatter = scatter_of_log(bandwidth, poles, samples)
    error = np.log(np.array(found) / bandwidth)
    # A maximum of likelihood is unbiased up to the square of its scatter.
    assert abs(error.mean()) < 3 * scatter / np.sqrt(repeats) + scatter**2
    # 30 values tell their own standard deviation to 13 %.
    assert 0.6 < error.std() / scatter < 1.4


@pytest.mark.parametrize("poles", [1, 2])
def test_close_orders_and_the_mean_are_weighed_together(poles):
    n = np.arange(4000)
    phase = 2 * np.pi * 0.05 * n
    orders, bandwidth, repeats = [0.0, 1.0, 1.3, 4.0], np.array([4e-3, 2e-3, 6e-3, 4e-3]), 8
    # orders 1 and 1.3 are 0.015 apart, one and a half of the largest bandwidth
    found = [
        likely_bandwidth(
            drawn(np.random.default_rng([poles, k]), orders=orders, phase=phase, bandwidth=bandwidth, poles=poles),
            phase_rad=phase, orders=orders, rate_hz=1.0, largest_bandwidth_hz=0.01, poles=poles, noise_variance=0.25,
        )
        for k in range(repeats)
    ]  # fmt: skip
    error = np.log(np.array(found) / bandwidth)
    scatter = np.array([scatter_of_log(b, poles, n.size) for b in bandwidth])
    scatter[0] *= np.sqrt(2)  # one quadrature
    # A neighbour at this distance costs up to a third of what an order tells alone.
    assert np.all(np.abs(error.mean(axis=0)) < 3 * 1.2 * scatter / np.sqrt(repeats) + scatter**2)


@pytest.mark.parametrize("poles", POLES)
def test_steady_amplitudes_have_the_smallest_bandwidth(poles):
    phase = 2 * np.pi * 0.021 * np.arange(5000)
    x = 3 * np.cos(phase) + np.cos(2.5 * phase + 1) + 2
    found = likely_bandwidth(
        x, phase_rad=phase, orders=[0, 1, 2.5], rate_hz=1e4, largest_bandwidth_hz=20, poles=poles, noise_variance=0.01
    )
    assert_allclose(found, 0.1 / 0.5, rtol=1e-9)  # a tenth of one over half a second


def test_faster_than_allowed_is_the_largest_bandwidth():
    phase = 2 * np.pi * 0.021 * np.arange(5000)
    x = drawn(np.random.default_rng(0), orders=[1.0], phase=phase, bandwidth=0.02, poles=1)
    found = likely_bandwidth(
        x, phase_rad=phase, orders=[1], rate_hz=1.0, largest_bandwidth_hz=1e-3, noise_variance=0.25
    )
    assert_allclose(found, 1e-3, rtol=0.02)  # the search stops within 2 % of a bound


def record(poles=2, seed=0):
    n = np.arange(8000)
    phase = 2 * np.pi * n / 40
    x = drawn(np.random.default_rng(seed), orders=[1.0, 3.0], phase=phase, bandwidth=3e-3, poles=poles)
    return x, phase


def test_orders_of_several_shafts():
    x, phase = record()
    settings = {"rate_hz": 1.0, "largest_bandwidth_hz": 0.01, "poles": 2, "noise_variance": 0.25}
    one = likely_bandwidth(x, phase_rad=phase, orders=[1, 3], **settings)
    two = likely_bandwidth(
        x, phase_rad={"slow": phase, "fast": 3 * phase}, orders=[("slow", 1), ("fast", 1)], **settings
    )
    assert_allclose(two, one, rtol=1e-5)  # rounded angles, and a search that ends within 2 %


def test_missing_samples_and_unknown_noise():
    x, phase = record()
    settings = {"phase_rad": phase, "orders": [1, 3], "rate_hz": 1.0, "largest_bandwidth_hz": 0.01, "poles": 2}
    whole = likely_bandwidth(x, noise_variance=0.25, **settings)
    # With 8000 samples the noise comes out to sqrt(2 / 8000) = 1.6 %, and 2 poles make a quarter of that of it.
    assert_allclose(likely_bandwidth(x, **settings), whole, rtol=0.05)
    x[::5] = np.nan
    x[4000:4200] = np.nan
    scatter = scatter_of_log(3e-3, 2, 6000)
    holed = likely_bandwidth(x, noise_variance=0.25, **settings)
    # Fewer samples see the same walk: noise a sample up by a quarter changes what they tell little.
    assert np.all(np.abs(np.log(holed / 3e-3)) < 3 * scatter)


def test_scaling_the_record_changes_nothing():
    x, phase = record()
    settings = {"phase_rad": phase, "orders": [1, 3], "rate_hz": 1.0, "largest_bandwidth_hz": 0.01, "poles": 2}
    one = likely_bandwidth(x, noise_variance=[0.25, 0.3], **settings)
    thousand = likely_bandwidth(1000 * x, noise_variance=[0.25e6, 0.3e6], **settings)
    assert_allclose(thousand, one, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"rate_hz": None}, r"largest_bandwidth_hz given; needed largest_bandwidth_hz with rate_hz, or"),
        ({"samples_per_rev": 40}, r"largest_bandwidth_hz, rate_hz, samples_per_rev given"),
        ({"largest_bandwidth_hz": 0.5}, r"largest_bandwidth_hz=0.5 must be above 0 and below 0.5, half of rate_hz=1"),
        (
            {"largest_bandwidth_hz": None, "largest_bandwidth_orders": 0.01},
            r"follows the speed.*pass largest_bandwidth",
        ),
        (
            {"noise_variance": [1, 2, 3]},
            "noise_variance has 3 values for 2 orders; pass one number for all, or one each",
        ),
        ({"x": np.zeros((2, 8000))}, r"x has 2 channels; each has estimates of its own"),
        ({"x": np.full(8000, np.nan)}, r"x has 8000 samples, all of them missing"),
    ],
)
def test_what_makes_no_sense_is_refused(change, sentence):
    x, phase = record()
    settings = {"x": x, "phase_rad": phase, "orders": [1, 3], "rate_hz": 1.0, "largest_bandwidth_hz": 0.01}
    with pytest.raises(ValueError, match=sentence):
        likely_bandwidth(**(settings | change))
