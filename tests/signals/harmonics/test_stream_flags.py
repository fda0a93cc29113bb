"""What a stream tells of its outputs while it goes on."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from signals.harmonics import OrderTracker, OutputFlag, track_orders

SAMPLES = 2400
BANDWIDTH = 0.004
UNCLEAR = OutputFlag.NOT_SEPARABLE | OutputFlag.ONE_QUADRATURE
ENDS = OutputFlag.NEAR_END | OutputFlag.NEAR_GAP
SETTINGS = {"bandwidth_hz": BANDWIDTH, "rate_hz": 1.0, "noise_variance": 1.0}
NOISE = np.random.default_rng(0).standard_normal(SAMPLES)
n = np.arange(SAMPLES)
STEADY = 2 * np.pi * 0.05 * n
RESTS = 2 * np.pi * 0.05 * np.where(n < 900, n, np.maximum(n - 600, 900))


def tracked(x, phase, size, *, orders):
    """Flags of a whole stream, cut into blocks of this size."""
    tracker, blocks = OrderTracker(orders=orders, **SETTINGS), [slice(at, at + size) for at in range(0, SAMPLES, size)]
    found = [tracker.update(x[..., block], phase_rad=phase[block]) for block in blocks]
    return np.concatenate([tracks.flags for tracks in found], axis=-1)


@pytest.mark.parametrize("size", [1, 61, SAMPLES])
def test_close_orders_are_never_separable_and_others_once_they_are_a_turn_apart(size):
    flags = tracked(NOISE, STEADY, size, orders=[1, 1.0001, 3])
    close = (flags & OutputFlag.NOT_SEPARABLE) > 0
    assert close[:2].all()
    # Order 3 is 0.1 cycles a sample off: a turn in ten samples, or in a block that is longer.
    assert not close[2, 11:].any()  # the first sample has no speed
    assert close[2, :9].all() == (size == 1)


@pytest.mark.parametrize("size", [1, 61, SAMPLES])
def test_a_shaft_at_rest_is_flagged_as_long_as_it_rests(size):
    flags = tracked(NOISE, RESTS, size, orders=[0, 1])
    # It stops at sample 900 and goes on at 1500; speeds are means over 62 samples at most, a quarter of 1 / bandwidth.
    rests = (flags & UNCLEAR) > 0
    assert_array_equal(rests[0], rests[1])
    assert rests[:, 962:1438].all()
    assert not rests[:, 124:838].any()
    assert not rests[:, 1624:].any()


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("gaps", [[], [(500, 540)], [(0, 300), (700, 701), (900, 1500)], [(0, SAMPLES)]])
def test_ends_and_gaps_are_those_of_the_whole_record(gaps, every):
    x = NOISE.copy()
    for gap in gaps:
        x[slice(*gap)] = np.nan
    settings = {"orders": [1, 2.5], "output_every": every, **SETTINGS}
    settings["bandwidth_hz"] = [BANDWIDTH, BANDWIDTH / 5]
    whole = track_orders(x, phase_rad=STEADY, estimator="filter", method="exact", **settings)
    for size in (SAMPLES, 11 if every == 7 else 90):
        tracker = OrderTracker(**settings)
        parts = [tracker.update(x[at : at + size], phase_rad=STEADY[at : at + size]) for at in range(0, SAMPLES, size)]
        assert_array_equal(np.concatenate([part.flags for part in parts], axis=1) & ENDS, whole.flags & ENDS)
        # Of the missing samples those that tell of outputs to come: of half of 1 / bandwidth at the most.
        assert len(pickle.dumps(tracker)) < 10_000


def test_a_bandwidth_narrower_than_any_stream_is_long():
    settings = {"orders": [1, 2], "bandwidth_hz": 1e-40, "rate_hz": 1.0, "noise_variance": 1.0}
    x = NOISE.copy()
    x[100:200] = np.nan
    tracker = OrderTracker(**settings)
    parts = [tracker.update(x[at : at + 300], phase_rad=0.3 * n[at : at + 300]) for at in range(0, SAMPLES, 300)]
    flags = np.concatenate([part.flags for part in parts], axis=1)
    assert np.all(flags & OutputFlag.NEAR_END)
    # 0.05 cycles a sample apart: a turn in twenty samples.
    assert not np.any(flags[:, 64:] & OutputFlag.NOT_SEPARABLE)


def test_a_single_sample_tells_one_quadrature_of_one_order():
    tracks = OrderTracker(orders=[0, 1], **SETTINGS).update([1.0], phase_rad=[0.3])
    assert_array_equal(
        tracks.flags[:, 0], [OutputFlag.NEAR_END | OutputFlag.NOT_SEPARABLE, OutputFlag.NEAR_END | UNCLEAR]
    )
    assert np.isnan(tracks.innovation_mean_square)
