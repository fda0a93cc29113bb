"""What a user may rely on: amplitudes, their uncertainty, gaps, the mean, noise, memory."""

from dataclasses import fields
from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from signals.harmonics import OrderTracks, process_variance, track_orders

RNG_SEED = 20


AMPLITUDE = 1.5 + 1.3j


def tone(samples, *, order=3):
    phase = 2 * np.pi * 0.021 * np.arange(samples)
    return (AMPLITUDE * np.exp(1j * order * phase)).real, phase


@pytest.mark.parametrize("method", ["exact", "fast"])
@pytest.mark.parametrize("poles", [1, 2, 3, 4])
def test_pure_tone_comes_back(poles, method):
    x, phase = tone(4000)
    tracks = track_orders(x, phase_rad=phase, orders=[3], bandwidth_hz=0.002, rate_hz=1.0, poles=poles, method=method)
    # What is left is the prior: 2 / (1e6 samples) of the amplitude, at the ends and for four poles some ten times it.
    # Fast promises 1e-3 unless asked for less.
    assert_allclose(tracks.complex_amplitude, np.full((1, 4000), AMPLITUDE), rtol=1e-6 if method == "exact" else 1e-3)
    assert tracks.noise_variance < (1e-9 if method == "exact" else 1e-6)


def test_error_of_a_pure_tone_is_the_prior_alone():
    x, phase = tone(2000)
    errors = []
    for std in (10.0, 100.0):
        tracks = track_orders(
            x, phase_rad=phase, orders=[3], bandwidth_hz=0.002, rate_hz=1.0, noise_variance=1.0, initial_std=std
        )
        errors.append(np.abs(tracks.complex_amplitude[0, 0] - AMPLITUDE))
    assert_allclose(errors[0] / errors[1], 100, rtol=0.01)


@pytest.mark.parametrize(("method", "poles"), [("exact", 1), ("exact", 2), ("fast", 1), ("fast", 2)])
def test_std_is_honest(method, poles):
    """Envelopes drawn from the model itself: about 95 % of either part lie within 1.96 std."""
    rng = np.random.default_rng(RNG_SEED + poles)
    n, rate, bandwidth, noise = 60_000, 1.0, 2.5e-3, 0.25
    orders = [1.0, 2.2, 5.0]
    q = process_variance(orders=orders, bandwidth=bandwidth, rate=rate, poles=poles, noise_variance=noise)
    walk = np.sqrt(q)[:, None, None] * rng.standard_normal((3, 2, n))
    for _ in range(poles):
        walk = np.cumsum(walk, axis=-1)
    envelope = walk[:, 0] + 1j * walk[:, 1]
    phase = 2 * np.pi * (0.03 * np.arange(n) + 5 * np.sin(2 * np.pi * np.arange(n) / n))
    x = np.sum(envelope * np.exp(1j * np.array(orders)[:, None] * phase), axis=0).real
    x += np.sqrt(noise) * rng.standard_normal(n)
    tracks = track_orders(
        x, phase_rad=phase, orders=orders, bandwidth_hz=bandwidth, rate_hz=rate, poles=poles, method=method,
        output_every=600, rtol=1e-4,
    )  # fmt: skip
    # Outputs 1.5 / bandwidth apart are nearly independent: 600 trials, so 95 % +- 3 x 0.9 %.
    error = (tracks.complex_amplitude - envelope[:, tracks.sample_index]) / tracks.std
    inside = np.mean(np.abs(np.concatenate([error.real, error.imag])) < 1.96)
    assert 0.923 < inside < 0.977
    # R from some 59,600 innovations: relative standard deviation sqrt(2 / n) = 0.6 %.
    assert_allclose(tracks.noise_variance, noise, rtol=0.02)


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_noise_and_innovations(method):
    x, phase = tone(20_000)
    x += 0.3 * np.random.default_rng(RNG_SEED).standard_normal(20_000)
    settings = {"phase_rad": phase, "orders": [3], "bandwidth_hz": 1e-3, "rate_hz": 1.0, "method": method}
    free = track_orders(x, output_every=100, **settings)
    given = track_orders(x, output_every=100, noise_variance=0.36, **settings)
    assert_allclose(free.noise_variance, 0.09, rtol=0.03)  # sqrt(2 / 19,000) = 1 %
    assert free.innovation_mean_square == 1.0
    # A variance four times too large doubles std and shows in the innovations; the estimates do not change.
    assert_allclose(given.complex_amplitude, free.complex_amplitude, rtol=1e-12)
    assert_allclose(given.std / free.std, 0.6 / np.sqrt(free.noise_density[0, 0]), rtol=1e-12)
    assert_allclose(given.innovation_mean_square, free.noise_variance / 0.36, rtol=1e-12)
    assert given.noise_variance == 0.36
    # The filter is wider than the smoother: its prediction adds about pi / 2 * 1.5 bandwidths of noise.


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_scaling_the_record_scales_everything(method):
    x, phase = tone(6000)
    x += 0.3 * np.random.default_rng(RNG_SEED).standard_normal(6000)
    settings = {"phase_rad": phase, "orders": [3, 1], "bandwidth_hz": 1e-3, "rate_hz": 1.0, "method": method}
    one, thousand = (track_orders(scale * x, **settings) for scale in (1, 1000))
    assert_allclose(thousand.complex_amplitude, 1000 * one.complex_amplitude, rtol=1e-9)
    assert_allclose(thousand.std, 1000 * one.std, rtol=1e-9)


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_gap_leaves_the_rest_alone_and_uncertainty_grows(method):
    x, phase = tone(12_000)
    x += 0.1 * np.random.default_rng(RNG_SEED).standard_normal(12_000)
    settings = {"phase_rad": phase, "orders": [3, 0], "bandwidth_hz": 2e-3, "rate_hz": 1.0, "method": method}
    settings |= {"noise_variance": 0.01}
    whole = track_orders(x, **settings)
    gap = slice(5000, 6000)
    x[gap] = np.nan
    holed = track_orders(x, **settings)
    # The smoother forgets as exp(-2 pi bandwidth n / 1.3): over 4000 samples to 1e-16 (p = 1).
    for far in (slice(0, 1000), slice(10_000, 12_000)):
        assert_allclose(holed.complex_amplitude[:, far], whole.complex_amplitude[:, far], atol=1e-9)
        assert_allclose(holed.std[:, far], whole.std[:, far], rtol=1e-9)
    assert np.all(holed.std[:, gap] > whole.std[:, gap])
    # A random walk pinned on both sides: its variance is a parabola, highest half way.
    variance = holed.std[0, gap] ** 2
    assert 480 < variance.argmax() < 520
    assert_allclose(np.diff(variance, 2).mean(), -2 * process_curvature(0.01, 2e-3), rtol=0.05)
    assert np.all(np.isfinite(holed.complex_amplitude))


def process_curvature(noise, bandwidth):
    """Return q / (length of the gap and of the memory at its ends), per sample squared, for a 1000-sample gap."""
    q = process_variance(orders=[1], bandwidth=bandwidth, rate=1.0, poles=1, noise_variance=noise)[0]
    # At either end the walk is known to sqrt(2 R q) (a one-sided filter), as if pinned sqrt(2 R / q) samples off.
    return q / (1000 + 2 * np.sqrt(2 * noise / q))


def test_filter_in_a_gap_only_loses():
    x, phase = tone(3000)
    x[2000:] = np.nan
    tracks = track_orders(
        x, phase_rad=phase, orders=[3], bandwidth_hz=1e-2, rate_hz=1.0, estimator="filter", noise_variance=0.01
    )
    held = tracks.complex_amplitude[0, 2000:]
    assert_allclose(held, np.full(1000, held[0]), rtol=1e-12)
    q = process_variance(orders=[3], bandwidth=1e-2, rate=1.0, poles=1, noise_variance=0.01)
    # Without data each quadrature's variance grows by q a sample.
    assert_allclose(np.diff(tracks.std[0, 1999:] ** 2), np.full(1000, q), rtol=1e-9)


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_the_mean_is_real(method):
    x, phase = tone(1500)
    x += 5 + 0.1 * np.random.default_rng(RNG_SEED).standard_normal(1500)
    tracks = track_orders(
        x, phase_rad=phase, orders=[0, 3], bandwidth_hz=4e-3, rate_hz=1.0, method=method, output_every=50,
        noise_variance=0.01,
    )  # fmt: skip
    assert_array_equal(tracks.complex_amplitude[0].imag, 0.0)
    assert np.abs((tracks.complex_amplitude[0].real - 5) / tracks.std[0]).max() < 4.5
    # One quadrature that sees R instead of 2 R: std smaller by sqrt(2) at the same bandwidth.
    assert_allclose(tracks.std[1, 10:20] / tracks.std[0, 10:20], np.sqrt(2), rtol=0.01)


def test_crossing_orders_of_two_shafts_share_out():
    n = np.arange(30_000)
    phases = {"input": 2 * np.pi * (0.01 * n + 5e-7 * n**2), "fan": 2 * np.pi * 0.05 * n}
    rng = np.random.default_rng(RNG_SEED)
    orders = [("input", 2), ("fan", 1)]
    amplitude = np.array([1.0, 0.6j])
    x = 0.1 * rng.standard_normal(n.size)
    for (shaft, order), z in zip(orders, amplitude, strict=True):
        x += (z * np.exp(1j * order * phases[shaft])).real
    tracks = track_orders(x, phase_rad=phases, orders=orders, bandwidth_hz=2e-3, rate_hz=1.0, poles=2, output_every=100)
    # The first passes the second at sample 15,000, 2e-6 cycles a sample further every sample.
    assert tracks.shafts == ("input", "fan")
    assert np.abs((tracks.complex_amplitude - amplitude[:, None]) / tracks.std).max() < 5
    # For 1000 samples they are within a bandwidth, longer than the smoother remembers.
    crossing = np.abs(tracks.sample_index - 15_000) < 200
    assert tracks.std[:, crossing].min() > 1.3 * np.median(tracks.std)


def test_orders_may_be_fractions_and_arrays():
    x, phase = tone(500, order=2.5)
    settings = {"phase_rad": phase, "bandwidth_hz": 0.01, "rate_hz": 1.0}
    exact = track_orders(x, orders=[Fraction(5, 2)], **settings)
    array = track_orders(x, orders=np.array([2.5]), **settings)
    assert_array_equal(exact.complex_amplitude, array.complex_amplitude)
    assert exact.shafts == ()


def test_phase_may_run_backwards():
    x, phase = tone(500)
    settings = {"orders": [3], "bandwidth_hz": 0.01, "rate_hz": 1.0}
    ahead = track_orders(x, phase_rad=phase, **settings)
    back = track_orders(x, phase_rad=-phase, **settings)
    assert_allclose(back.complex_amplitude, ahead.complex_amplitude.conj(), rtol=1e-9)


def test_input_is_left_alone_and_may_be_read_only():
    x, phase = tone(800)
    x[10] = np.nan
    x.flags.writeable = phase.flags.writeable = False
    track_orders(x, phase_rad=phase, orders=[3], bandwidth_hz=0.01, rate_hz=1.0)


def test_silence_is_silence():
    _, phase = tone(800)
    for method in ("exact", "fast"):
        tracks = track_orders(np.zeros(800), phase_rad=phase, orders=[3], bandwidth_hz=0.01, rate_hz=1.0, method=method)
        assert_array_equal(tracks.complex_amplitude, 0)
        assert tracks.noise_variance == pytest.approx(0, abs=1e-12)


def test_fields_are_labelled():
    x, phase = tone(900)
    tracks = track_orders(x, phase_rad=phase, orders=[3, 1], bandwidth_hz=0.01, rate_hz=1.0, output_every=100)
    sizes = {"order": 2, "output": 9, "settling": 901, "lag": 20, "interval": 8}
    for field in fields(OrderTracks):
        value = getattr(tracks, field.name)
        if isinstance(value, np.ndarray):
            assert value.shape == tuple(sizes[dim] for dim in field.metadata["dims"] if dim != "channel")
            assert "units" in field.metadata
    assert tracks.sample_index.tolist() == list(range(0, 900, 100))
    assert (tracks.estimator, tracks.method, tracks.poles) == ("smoother", "exact", 1)
