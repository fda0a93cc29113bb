"""What blocks cost, fast and exact: the noise they leave, lines that are close, many coupled orders."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import track_orders

RATE = 1000.0


def close_lines(*, seed=0, samples=40_000, apart_hz=0.1, gap=False):
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * 25 / RATE * np.arange(samples)
    orders = np.array([3.0, 3.0 + apart_hz / 25])
    x = np.cos(orders[:, None] * phase).sum(axis=0) + rng.standard_normal(samples)
    if gap:
        x[20_000:20_700] = np.nan
        x[rng.uniform(size=samples) < 0.1] = np.nan
    return x, {"phase_rad": phase, "orders": orders, "bandwidth_hz": 2.0, "rate_hz": RATE, "output_every": 100}


# Each number of poles, and each distance, with gaps and without.
@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize(("apart_hz", "odd"), [(0.1, False), (0.5, True), (1.5, False), (6.0, True)])
def test_the_noise_of_close_lines_is_neither_doubled_nor_halved(poles, apart_hz, odd):
    """Within the two per cent that the innovations of the exact filter leave it, and the scatter of 40,000 samples."""
    gap = odd == (poles % 2 == 1)
    x, settings = close_lines(apart_hz=apart_hz, gap=gap)
    fast, exact = (track_orders(x, **settings, poles=poles, method=method) for method in ("fast", "exact"))
    # The same record, but the samples after start-up of one, segments of whole blocks of the other: 0.7 % each.
    assert fast.noise_variance == pytest.approx(exact.noise_variance, rel=0.02)
    assert fast.noise_variance == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("poles", [2, 3, 4])
@pytest.mark.parametrize("method", ["fast", "exact"])
def test_the_noise_of_sixty_samples_is_found_beside_three_orders(poles, method):
    """Mean over records; constants with open priors are walks in which nothing moves. Four standard errors are 10 %."""
    phase = 2 * np.pi * 25 / RATE * np.arange(60)
    orders = np.array([1.0, 2.0, 3.3])
    x = np.cos(orders[:, None] * phase).sum(axis=0) + np.random.default_rng(poles).standard_normal((80, 60))
    settings = {"phase_rad": phase, "orders": orders, "bandwidth_hz": 20.0, "rate_hz": RATE, "poles": poles}
    assert np.mean(track_orders(x, **settings, method=method).noise_variance) == pytest.approx(1.0, abs=0.1)


def eighteen(name):
    """Return a record of 18 lines a bandwidth apart, and how they are tracked, with something about it."""
    rng, n = np.random.default_rng(1), 30_000
    phase = 2 * np.pi / 512 * np.arange(n)
    orders = 20 + 0.05 * np.arange(18)
    x = rng.standard_normal(n) + np.cos(orders[:, None] * phase + orders[:, None]).sum(axis=0)
    settings = {"phase_rad": phase, "orders": orders, "bandwidth_orders": 0.05, "samples_per_rev": 512.0, "poles": 2}
    if name == "gaps":
        x[15_000:17_000] = x[3000:3300] = np.nan
    if name == "channels":
        x = np.stack([x, x[::-1]])
    if name == "loud":
        x *= 1e4
    if name == "bandwidth that varies":
        settings["bandwidth_orders"] = np.linspace(0.02, 0.1, n)[None]
    if name == "one pole":
        settings["poles"] = 1
    return x, settings | {"output_every": 500, "noise_variance": 1e8 if name == "loud" else 1.0}


@pytest.mark.parametrize("name", ["", "gaps", "channels", "loud", "bandwidth that varies", "one pole"])
def test_many_coupled_orders_are_those_of_the_exact_smoother(name):
    x, settings = eighteen(name)
    fast, exact = (track_orders(x, **settings, method=how) for how in ("fast", "exact"))
    off = np.abs(fast.complex_amplitude - exact.complex_amplitude)
    assert np.all(off < fast.error_bound * np.abs(exact.complex_amplitude).max() + 0.03 * exact.std)
    assert_allclose(fast.std, exact.std, rtol=0.01)


@pytest.mark.parametrize("name", ["long gap", "rest", "nearly alike", "a wide prior"])
def test_what_a_record_hardly_determines_is_finite_and_sure_of_little(name):
    x, settings = eighteen("")
    if name == "long gap":
        x[5000:25_000] = np.nan
    if name == "rest":
        settings["phase_rad"] = np.maximum(settings["phase_rad"] - settings["phase_rad"][10_000], 0)
    if name == "nearly alike":
        settings["orders"] = 20 + 0.0025 * np.arange(18)
    if name == "a wide prior":
        settings |= {"noise_variance": 1.0, "initial_std": 1e5}
    tracks = track_orders(x, **settings, method="fast")
    assert np.all(np.isfinite(tracks.complex_amplitude))
    assert np.all(tracks.std > 0)
