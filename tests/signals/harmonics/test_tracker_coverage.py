"""Envelopes drawn from the model itself: 95 % of either quadrature must lie within 1.96 `std` of the truth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import Bandwidth, track_orders

ORDERS = np.array([1.0, 2.2])
NOISE, INITIAL_STD = 0.25, 1.0


def drawn(rng, *, records, samples, bandwidth, poles):
    """Return independent records (record, sample), their amplitudes (record, order, sample) and the angle.

    Levels and differences start as the tracker's prior says, so that every output is covered, those at ends too.
    """
    q = 2 * NOISE / Bandwidth(width=bandwidth, poles=poles).weight ** 2
    walk = np.sqrt(q) * rng.standard_normal((records, 2, 2, samples))  # record, part, order, sample
    for power in reversed(range(poles)):
        # The first value is that of the `power`-th difference; its own differences lie before the record.
        walk[..., 0] = INITIAL_STD * (2 * np.pi * bandwidth) ** power * rng.standard_normal(walk.shape[:-1])
        walk = np.cumsum(walk, axis=-1)
    amplitude = walk[:, 0] + 1j * walk[:, 1]
    phase = 2 * np.pi * (0.07 * np.arange(samples) + 1e-2 * samples * np.sin(np.pi * np.arange(samples) / samples))
    x = np.einsum("kon,on->kn", amplitude, np.exp(1j * ORDERS[:, None] * phase)).real
    return x + np.sqrt(NOISE) * rng.standard_normal(x.shape), amplitude, phase


@pytest.mark.parametrize("poles", [1, 2, 4])
@pytest.mark.parametrize(
    ("method", "estimator", "bandwidth", "records"),
    [("exact", "smoother", 2e-2, 600), ("exact", "filter", 2e-2, 600), ("fast", "smoother", 2e-3, 300)],
)
def test_95_per_cent_lie_within_1_96_std(method, estimator, bandwidth, records, poles):
    apart = round(2 / bandwidth)
    x, truth, phase = drawn(
        np.random.default_rng([poles, records]),
        records=records,
        samples=4 * apart + 1,
        bandwidth=bandwidth,
        poles=poles,
    )
    tracks = track_orders(
        x, phase_rad=phase, orders=ORDERS, bandwidth_hz=bandwidth, rate_hz=1.0, poles=poles, method=method,
        estimator=estimator, noise_variance=NOISE, initial_std=INITIAL_STD, output_every=apart,
    )  # fmt: skip
    assert tracks.method == method
    # The first sample tells one quadrature and not the other, and `std` is the mean of the two: left out. The last
    # output is the last sample. With four poles amplitudes grow to a million times `std`.
    error = ((tracks.complex_amplitude - truth[:, :, ::apart]) / tracks.std)[:, :, 1:]
    parts = np.stack([error.real, error.imag])
    # 2 / bandwidth apart, a smoother with one pole remembers exp(-9.8) of an output, one with four exp(-2.7): they are
    # as good as independent. 16 numbers a record, 9600 and 4800 in all: one standard deviation is 0.22 % and 0.31 %.
    assert 0.94 < np.mean(np.abs(parts) < 1.96) < 0.96
    assert_allclose(np.mean(parts**2), 1.0, atol=4.5 * np.sqrt(2 / parts.size))
    # The same at each output, the end of the record among them: a quarter of the numbers.
    assert_allclose(np.mean(parts**2, axis=(0, 1, 2)), 1.0, atol=4.5 * np.sqrt(8 / parts.size))


@pytest.mark.parametrize(("limits", "given"), [((-0.95, 0.95), None), ((-np.inf, 0.7), None), ((-0.95, 0.95), 0.04)])
def test_a_clipped_tone_has_its_amplitude_and_is_within_its_std(limits, given):
    """A fifth of the samples lie beyond the limits: left out, they would take a tenth off the amplitude."""
    rng, phase = np.random.default_rng(5), 0.3 * np.arange(10_000)
    truth = np.exp(2j * np.pi * rng.uniform(size=12))[:, None]
    x = np.clip((truth * np.exp(1j * phase)).real + 0.2 * rng.standard_normal((12, phase.size)), *limits)
    tracks = track_orders(
        x, phase_rad=phase, orders=[1], bandwidth_hz=2e-3, rate_hz=1.0, output_every=500, clip_limits=limits,
        noise_variance=given,
    )  # fmt: skip
    error = tracks.complex_amplitude[:, 0, 1:-1] - truth
    parts = np.stack([error.real, error.imag])
    assert np.abs(np.mean(error / truth)) < 5e-3
    # Constant amplitudes, where the prior of a moving one adds to `std`.
    assert np.mean(np.abs(parts) < 1.645 * tracks.std[:, 0, 1:-1]) > 0.85
    assert 0.8 < np.median(tracks.std[:, 0, 1:-1]) / np.sqrt(np.mean(parts**2)) < 1.6
    assert_allclose(tracks.noise_variance, 0.04, rtol=0.06)
    assert_allclose(tracks.clipped_share, np.mean((x <= limits[0]) | (x >= limits[1]), axis=1))
