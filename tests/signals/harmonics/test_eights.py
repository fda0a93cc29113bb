"""The filter with one pole, which takes eight samples at once, against Gaussian conditioning on all samples so far."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import OrderTracker, process_variance, track_orders

ORDERS = (0.0, 1.0, 2.3, 5.0, 7.1)
SAMPLES = 203
PHASE = 0.21 * np.arange(SAMPLES) * (1 + 4e-4 * np.arange(SAMPLES))


def record(channels=1):
    rng = np.random.default_rng(3)
    angle = np.asarray(ORDERS)[:, None] * PHASE
    wave = np.sum(np.cos(angle + np.arange(5)[:, None]), axis=0)
    return np.array([1, -2, 5])[:channels, None] * wave + rng.standard_normal((channels, SAMPLES))


def conditioned(x, bandwidth, prior, at):
    """Amplitudes (channel, order, output) and variances at some samples, each from those up to it."""
    angle = np.asarray(ORDERS) * PHASE[:, None]
    rows = np.concatenate([np.cos(angle), -np.sin(angle[:, 1:])], axis=1)
    q = process_variance(orders=np.asarray(ORDERS)[:, None], bandwidth=bandwidth, rate=1.0, poles=1, noise_variance=1.0)
    q = np.broadcast_to(q, (5, SAMPLES))
    walked = np.cumsum(np.concatenate([q, q[1:]]), axis=1) - np.concatenate([q, q[1:]])  # (column, sample), before it
    amplitude, variance = np.empty((len(x), 5, len(at)), complex), np.empty((5, len(at)))
    for output, t in enumerate(at):
        seen = np.flatnonzero(~np.isnan(x[0, : t + 1]))
        # Column c of the state at s and at t share its prior and what it has walked to the earlier of them.
        open_ = prior + walked[:, np.minimum.outer(seen, seen)]
        joint = np.einsum("ic,cij,jc->ij", rows[seen], open_, rows[seen]) + np.eye(seen.size)
        cross = (prior + walked[:, seen]) * rows[seen].T
        found = np.linalg.solve(joint, x[:, seen].T).T @ cross.T
        left = prior + walked[:, t] - np.sum(cross * np.linalg.solve(joint, cross.T).T, axis=1)
        amplitude[:, :, output] = found[:, :5]
        amplitude[:, 1:, output] += 1j * found[:, 5:]
        variance[:, output] = np.concatenate([left[:1], (left[1:5] + left[5:]) / 2])
    return amplitude, variance


GAPS = {"none": [], "one": [50], "an octet and more": [*range(64, 75), 80], "the first and the last": [0, 1, 201, 202]}


@pytest.mark.parametrize("every", [1, 3, 16])
@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("varies", [False, True])
def test_means_and_variances(every, gap, varies):
    x = record(channels=3)
    x[:, GAPS[gap]] = np.nan
    swell = np.exp(np.sin(np.arange(SAMPLES) / 9)) if varies else np.ones(1)
    bandwidth = np.array([0.004, 0.01, 0.01, 0.02, 0.03])[:, None] * swell
    setting = {"bandwidth_hz": bandwidth if varies else bandwidth[:, 0], "rate_hz": 1.0, "noise_variance": 1.0}
    found = track_orders(
        x, phase_rad=PHASE, orders=ORDERS, estimator="filter", method="exact", output_every=every, initial_std=30.0,
        **setting,
    )  # fmt: skip
    # Some outputs in every place of an octet, and the last.
    some = np.unique(np.append(np.arange(0, found.sample_index.size, 5), found.sample_index.size - 1))
    amplitude, variance = conditioned(x, bandwidth, 900.0, found.sample_index[some])
    # The joint covariance has a condition of about 1e5, 1e-11 of rounding, against amplitudes of up to 30.
    assert_allclose(found.complex_amplitude[:, :, some], amplitude, atol=1e-9)
    assert_allclose(found.std[:, :, some], np.broadcast_to(np.sqrt(variance), (3, *variance.shape)), rtol=1e-9)


@pytest.mark.parametrize("size", [1, 5, 8, 61])
def test_streams_cut_anywhere(size):
    x = record()
    stream = OrderTracker(
        orders=ORDERS, bandwidth_hz=0.01, rate_hz=1.0, noise_variance=1.0, initial_std=30.0, output_every=2
    )
    parts = [stream.update(x[:, a : a + size], phase_rad=PHASE[a : a + size]) for a in range(0, SAMPLES, size)]
    at = np.concatenate([part.sample_index for part in parts])
    amplitude, variance = conditioned(x, np.full((5, 1), 0.01), 900.0, at)
    assert_allclose(at, np.arange(0, SAMPLES, 2))
    # As above.
    assert_allclose(np.concatenate([part.complex_amplitude for part in parts], axis=-1), amplitude, atol=1e-9)
    assert_allclose(np.concatenate([part.std for part in parts], axis=-1)[0], np.sqrt(variance), rtol=1e-9)
