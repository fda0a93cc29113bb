"""The blockwise smoother against the exact one, and what "auto" picks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import track_orders

RATE = 10_000.0


def troubled(seed, *, size):
    """Three orders and a mean of some size in noise 1, on a run-up with a jump of the speed; two gaps."""
    rng = np.random.default_rng(seed)
    n = np.arange(20_000)
    phase = 2 * np.pi * (0.03 * n + 0.004 * n**2 / n.size) + 0.11 * np.maximum(n - rng.integers(11_000, 13_000), 0)
    orders = np.array([0, 1, 2.3, 4])
    envelopes = size * np.array([0.3, 1, 0.5j, 0.2])[:, None]
    envelopes = envelopes * (1 + 0.3 * np.sin(4 * np.pi * n / n.size + orders[:, None]))
    x = np.sum(envelopes * np.exp(1j * orders[:, None] * phase), axis=0).real + rng.standard_normal(n.size)
    gap = rng.integers(4000, 6000)
    x[gap : gap + 500] = x[15_000:15_007] = np.nan
    return x, {"phase_rad": phase, "orders": orders, "bandwidth_hz": 1e-3, "rate_hz": 1.0, "noise_variance": 1.0}


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("size", [0, 1e4])
def test_error_bound_holds_everywhere_but_for_a_small_part_of_std(poles, size):
    """At all outputs: ends, gaps and the jump among them. Of signals it is the bound that holds, of noise the part."""
    x, settings = troubled(poles, size=size)
    exact, fast = (track_orders(x, poles=poles, method=m, output_every=7, **settings) for m in ("exact", "fast"))
    largest = np.abs(exact.complex_amplitude).max()
    difference = np.abs(fast.complex_amplitude - exact.complex_amplitude)
    assert np.all(difference < fast.error_bound * largest + 0.02 * exact.std)
    assert fast.error_bound < 2e-3
    assert_allclose(fast.std, exact.std, rtol=6e-3)


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("samples", [1, 2, 5, 30, 70, 600])
def test_a_short_record_is_that_of_the_exact_smoother(samples, poles):
    """Shorter than a turn, or than the memory: there is nothing that orders could be told apart by beforehand."""
    n = np.arange(samples)
    x = 2 * np.cos(0.3 * n) + 0.1 * np.random.default_rng(samples).standard_normal(samples)
    settings = {"phase_rad": 0.3 * n, "orders": [1, 1.8], "bandwidth_hz": 1e-3, "rate_hz": 1.0, "poles": poles}
    exact, fast = (track_orders(x, noise_variance=0.01, method=m, **settings) for m in ("exact", "fast"))
    # A block is a sample up to 128 of these.
    difference = np.abs(fast.complex_amplitude - exact.complex_amplitude)
    assert np.all(difference < (1e-6 if samples < 128 else 0.02) * exact.std)
    assert_allclose(fast.std, exact.std, rtol=1e-6 if samples < 128 else 6e-3)


@pytest.mark.parametrize(("poles", "bandwidth"), [(1, 1e-6), (1, 1e-7), (2, 1e-7), (3, 1e-7), (4, 1e-6), (4, 1e-7)])
def test_a_memory_of_a_million_samples_and_more(poles, bandwidth):
    n = np.arange(1_000_000)
    phase = 2 * np.pi * 0.05 * n
    x = np.cos(phase + 0.5) + 0.4 * np.cos(2.3 * phase) + 0.5 * np.random.default_rng(poles).standard_normal(n.size)
    settings = {"rate_hz": 1.0, "poles": poles}
    tracks = track_orders(
        x, phase_rad=phase, orders=[1, 2.3], bandwidth_hz=bandwidth, noise_variance=0.25, output_every=1000,
        method="fast", **settings,
    )  # fmt: skip
    error = np.abs(tracks.complex_amplitude - np.array([[np.exp(0.5j)], [0.4]])) / tracks.std
    assert error.max() < 4.5  # a few independent numbers, all in all
    # A thousand samples tell as much as one of a thousandth of the noise; their middle is half of a thousandth off.
    few = track_orders(
        np.zeros(1000), phase_rad=0.4 * np.arange(1000), orders=[1], bandwidth_hz=1000 * bandwidth,
        noise_variance=0.25e-3, initial_std=500.0, method="exact", **settings,
    )  # fmt: skip
    assert_allclose(tracks.std, np.repeat(few.std, 2, axis=0), rtol=0.01)


def test_auto_is_fast_on_a_long_record():
    x = np.random.default_rng(3).standard_normal(400_000)
    settings = {"phase_rad": 0.2 * np.arange(x.size), "rate_hz": RATE, "output_every": 1000}
    settings |= {"orders": np.arange(1, 11), "bandwidth_hz": 2.0}
    assert track_orders(x, **settings).method == "fast"


def test_gaps_in_step_with_a_shaft_are_owned_up_to():
    rng = np.random.default_rng(8)
    phase = 2 * np.pi * 25 / RATE * np.arange(60_000)
    x = 1.2 * np.cos(3 * phase) + 0.5 * np.cos(23 * phase) + rng.normal(0, 0.02, phase.size)
    x[np.abs(x) > 1.5] = np.nan  # clipped: 9 % of the samples, on the crests
    settings = {
        "phase_rad": phase,
        "orders": [3, 19, 23, 27],
        "bandwidth_hz": 0.05,
        "rate_hz": RATE,
        "output_every": 500,
    }
    truth = np.array([1.2, 0.0, 0.5, 0.0])[:, None]
    fast = track_orders(x, **settings, method="fast")
    assert fast.error_bound > 0.05  # the share of samples that are missing; what others leave there is taken out
    assert np.abs(np.abs(fast.complex_amplitude) - truth).max() < 2e-3 < fast.error_bound * 1.2
    auto = track_orders(x, **settings)
    assert auto.method == "exact"
    # The noise decides with the waveform what is clipped, which biases amplitudes by a part of its 0.02.
    assert np.abs(np.abs(auto.complex_amplitude) - truth).max() < 2e-3


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("seed", [0, 3])
def test_lines_that_leak_at_ends_and_at_a_step_of_the_speed_stay_within_the_bound(poles, seed):
    """Ten slow lines within a few bandwidths of one another, each too weak a leak to be coupled, all together not."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(0.005, 0.02)
    step = rng.choice([-0.6, -0.3, 0.3, 0.6, 1.0, 1.8]) * speed
    at = int(rng.uniform(40_000, 60_000))
    bandwidth = 10 ** rng.uniform(-3.9, -3.5)
    n = np.arange(100_000)
    phase = speed * n + step * np.maximum(n - at, 0)
    orders = np.array([1, 2, 3, 4.6, 7.1, 12.3, 20, 27, 36, 54])
    size = rng.uniform(0.3, 1, 10)
    x = np.sum(size[:, None] * np.cos(orders[:, None] * phase + rng.uniform(0, 6, (10, 1))), axis=0)
    settings = {"phase_rad": phase, "orders": orders, "bandwidth_hz": bandwidth, "rate_hz": 1.0, "poles": poles}
    tracks = track_orders(x, **settings, method="fast", noise_variance=0.01, output_every=100)
    off = np.abs(np.abs(tracks.complex_amplitude) - size[:, None])
    # Amplitudes that stand still are found by the exact smoother to the part of its prior, 1e-6.
    assert off.max() < tracks.error_bound * size.max() < 5e-3


def test_orders_that_are_one_and_the_same_share_their_sum():
    orders = [0, 1, 0, 1, 1]
    n = np.arange(30_000)
    phase = 0.3 * n
    x = 0.4 + np.cos(phase + 1) + 0.7 * np.cos(2.3 * phase) + 0.1 * np.random.default_rng(0).standard_normal(n.size)
    settings = {"phase_rad": phase, "bandwidth_hz": 4e-4, "rate_hz": 1.0, "noise_variance": 0.01}
    exact, fast = (track_orders(x, orders=orders, method=m, output_every=50, **settings) for m in ("exact", "fast"))
    sums = [[np.sum(t.complex_amplitude[np.equal(orders, o)], axis=0) for o in set(orders)] for t in (exact, fast)]
    # The sum is as sure as if it were alone: to some hundredths of 0.003; of its parts nothing is known but a prior.
    assert np.abs(np.subtract(*sums)).max() < 2e-3
    assert_allclose(fast.std, exact.std, rtol=1e-3)
    assert track_orders(x, orders=orders, **settings | {"poles": 2}).method == "exact"


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_lines_within_half_a_bandwidth_of_each_other_are_told_apart_by_both_methods(poles):
    n = np.arange(30_000)
    phase, bandwidth = 0.3 * n, 3e-4
    orders = [1, 1 + 0.2 * bandwidth * 2 * np.pi / 0.3]
    x = np.cos(phase + 1) + 0.1 * np.random.default_rng(0).standard_normal(n.size)
    settings = {"phase_rad": phase, "orders": orders, "bandwidth_hz": bandwidth, "rate_hz": 1.0, "poles": poles}
    # With the noise given, so that both know it; slopes, too, are told apart.
    exact, fast = (
        track_orders(x, method=m, noise_variance=0.01, output_every=50, **settings) for m in ("exact", "fast")
    )
    assert np.all(np.abs(fast.complex_amplitude - exact.complex_amplitude) < 0.02 * exact.std)
    assert_allclose(fast.std, exact.std, rtol=6e-3)


def many_orders(phase, **settings):
    """Return a record of orders 1 to 12, twenty bandwidths apart, and how they are tracked."""
    orders = np.arange(1.0, 13.0)
    x = np.cos(orders[:, None] * phase + orders[:, None]).sum(axis=0)
    x += np.random.default_rng(5).standard_normal(phase.size)
    given = {"phase_rad": phase, "orders": orders, "bandwidth_orders": 0.05, "samples_per_rev": 512.0}
    return x, given | {"output_every": 100, "noise_variance": 1.0} | settings


@pytest.mark.parametrize("trouble", ["", "gap", "louder", "speed that varies", "jump of the speed", "mean"])
def test_orders_far_apart_with_one_pole_are_those_of_the_exact_smoother(trouble):
    n = np.arange(160_000)
    phase = 2 * np.pi / 512 * (n - (n**2 / 4 / n.size if trouble == "speed that varies" else 0))
    if trouble == "jump of the speed":
        phase -= 2 * np.pi / 2000 * np.maximum(n - 90_000, 0)
    x, settings = many_orders(phase)
    if trouble == "mean":
        x, settings["orders"] = x + 0.5, np.append(0.0, settings["orders"])
    if trouble == "gap":
        x[65_000:69_000] = np.nan
    if trouble == "louder":
        x, settings["noise_variance"] = 1e3 * x, 1e6
    fast, exact = (track_orders(x, **settings, method=how) for how in ("fast", "exact"))
    off = np.abs(fast.complex_amplitude - exact.complex_amplitude)
    assert fast.error_bound <= 1e-3
    assert np.all(off < fast.error_bound * np.abs(exact.complex_amplitude).max() + 0.01 * exact.std)
    # What the joint covariance has more is half of what an order's passband lets through of all the others.
    assert_allclose(fast.std, exact.std, rtol=0.01)
