"""A record that comes in block by block: the same tracks, however it is cut, and no more memory however long."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from signals.harmonics import Bandwidth, track_orders
from signals.harmonics.stream import OrderTracker

SAMPLES = 3000
COMMON = {"orders": [0, 1, 2.5], "bandwidth_hz": 0.004, "rate_hz": 1.0, "noise_variance": 0.09}


def record(channels=None):
    n = np.arange(SAMPLES)
    phase = 2 * np.pi * (0.02 * n + 1e-6 * n**2)
    shape = (SAMPLES,) if channels is None else (channels, SAMPLES)
    x = 0.3 + np.cos(phase) + 0.4 * np.sin(2.5 * phase) + 0.3 * np.random.default_rng(0).standard_normal(shape)
    x[..., 1000:1100] = np.nan
    return x, phase


def stream(tracker, x, phase, sizes, *, between=lambda tracker: tracker):
    """Feed the record in blocks of these sizes, the last again and again."""
    tracks, at, number = [], 0, 0
    while at < SAMPLES:
        stop = at + sizes[min(number, len(sizes) - 1)]
        tracks.append(tracker.update(x[..., at:stop], phase_rad=phase[at:stop]))
        tracker, at, number = between(tracker), stop, number + 1
    return tracks


def joined(tracks, name):
    return np.concatenate([getattr(part, name) for part in tracks], axis=-1)


CUTS = st.lists(st.integers(1, 900), min_size=1, max_size=12).map(lambda sizes: [*sizes, 700])


@settings(deadline=None, max_examples=20)
@given(sizes=CUTS, poles=st.integers(1, 4), method=st.sampled_from(["exact", "fast"]))
def test_however_it_is_cut_the_filter_is_that_of_the_whole_record(sizes, poles, method):
    x, phase = record()
    orders = (
        {"orders": [1, 2.5], "bandwidth_hz": 0.002} if method == "fast" else {}
    )  # with poles=4 the mean is too near
    tracks = stream(OrderTracker(poles=poles, method=method, **COMMON | orders), x, phase, sizes)
    whole = track_orders(x, phase_rad=phase, estimator="filter", method=method, poles=poles, **COMMON | orders)
    assert_same(tracks, [whole])


def assert_same(tracks, others):
    """Sines may differ in their last digits where a block begins, and the first turns magnify that some 1e4 times."""
    assert_allclose(joined(tracks, "complex_amplitude"), joined(others, "complex_amplitude"), rtol=0, atol=1e-10)
    assert_allclose(joined(tracks, "std"), joined(others, "std"), rtol=1e-10)
    assert_array_equal(joined(tracks, "sample_index"), joined(others, "sample_index"))
    # Sums of some thousand squares, added up in another order.
    assert_allclose(tracks[-1].innovation_mean_square, others[-1].innovation_mean_square, rtol=1e-10)


@pytest.mark.parametrize("method", ["exact", "fast"])
@pytest.mark.parametrize("channels", [None, 2])
def test_a_tracker_goes_on_from_its_state(method, channels, tmp_path):
    x, phase = record(channels)

    def kept(tracker):
        (tmp_path / "tracker").write_bytes(pickle.dumps(tracker))
        return pickle.loads((tmp_path / "tracker").read_bytes())  # noqa: S301

    settings = COMMON | {"method": method, "output_every": 3, "poles": 2}
    straight = stream(OrderTracker(**settings), x, phase, [700])
    stopped = stream(OrderTracker(**settings), x, phase, [700], between=kept)
    for name in ("complex_amplitude", "std", "sample_index"):
        assert_array_equal(joined(stopped, name), joined(straight, name))
    assert_array_equal(stopped[-1].innovation_mean_square, straight[-1].innovation_mean_square)


def test_shafts_by_name_and_channels():
    x, phase = record(2)
    settings = COMMON | {"orders": [("fan", 0), ("sun", 1), ("fan", 1.25)]}
    phases = {"unused": phase, "fan": 2 * phase, "sun": phase}
    tracker = OrderTracker(**settings)
    tracks = [
        tracker.update(x[:, at : at + 500], phase_rad={name: angle[at : at + 500] for name, angle in phases.items()})
        for at in range(0, SAMPLES, 500)
    ]
    whole = track_orders(x, phase_rad=phases, estimator="filter", method="exact", **settings)
    assert_allclose(joined(tracks, "complex_amplitude"), whole.complex_amplitude, rtol=0, atol=1e-12)
    assert tracks[-1].shafts == ("fan", "sun", "fan")
    assert tracks[-1].innovation_mean_square.shape == (2,)


@pytest.mark.parametrize("method", ["exact", "fast"])
def test_what_a_tracker_keeps_does_not_grow(method):
    tracker = OrderTracker(method=method, output_every=100, **COMMON)

    def feed(first):
        for at in range(first, first + SAMPLES, 500):
            phase = 0.2 * np.arange(at, at + 500)
            tracker.update(np.cos(phase), phase_rad=phase)
        return len(pickle.dumps(tracker))

    assert feed(0) == feed(SAMPLES) == feed(2 * SAMPLES)


def refused(sentence, **change):
    with pytest.raises(ValueError, match=sentence):
        OrderTracker(**{key: value for key, value in (COMMON | change).items() if value is not None})


def test_refusals():
    refused("noise_variance=0 must be above zero", noise_variance=0)
    refused("method='quick' is unknown; it must be one of exact, fast", method="quick")
    refused("bandwidth_orders with rate_hz: the speed of samples to come", bandwidth_hz=None, bandwidth_orders=0.1)
    refused(r"bandwidth of shape \(1, 2\): a stream's does not vary", bandwidth_hz=[[0.1, 0.2]])


def test_refused_blocks():
    x, phase = record()
    tracker = OrderTracker(**COMMON)
    tracker.update(x[:100], phase_rad=phase[:100])
    with pytest.raises(ValueError, match=r"x has shape \(2, 10\), but the stream began with one plain channel"):
        tracker.update(np.zeros((2, 10)), phase_rad=phase[100:110])
    with pytest.raises(ValueError, match=r"phase_rad jumps by .* from the last block to this one, order 2\.5 by more"):
        tracker.update(x[100:110], phase_rad=phase[:10])
    with pytest.raises(ValueError, match="phase_rad has 9 values for 10 samples"):
        tracker.update(x[100:110], phase_rad=phase[100:109])
    with pytest.raises(ValueError, match=r"x\[3\]=inf"):
        tracker.update(np.where(np.arange(10) == 3, np.inf, 0.0), phase_rad=phase[100:110])
    with pytest.raises(ValueError, match="x misses different samples in different channels"):
        OrderTracker(**COMMON).update([[1.0, np.nan], [1.0, 2.0]], phase_rad=[0.0, 0.1])
    # A refused block leaves the tracker as it was.
    tracker.update(x[100:110], phase_rad=phase[100:110])


@pytest.mark.parametrize(("fan", "sun", "refused"), [(0.99, 0.99, ""), (1.01, 0.99, "fan"), (0.99, 1.01, "sun")])
def test_each_shaft_turns_between_blocks_as_far_as_its_own_highest_order_allows(fan, sun, refused):
    tracker = OrderTracker(**COMMON | {"orders": [("fan", 0.5), ("sun", 4), ("fan", 0.2), ("sun", 1)]})
    tracker.update([1.0], phase_rad={"sun": [3.0], "fan": [1.0]})
    jumped = {"fan": [1.0 + fan * np.pi / 0.5], "sun": [3.0 - sun * np.pi / 4]}
    if refused:
        with pytest.raises(ValueError, match=rf"phase_rad\['{refused}'\] jumps by"):
            tracker.update([1.0], phase_rad=jumped)
    else:
        tracker.update([1.0], phase_rad=jumped)


@pytest.mark.parametrize("every", [1, 1000])
def test_lost_digits_are_an_error_with_numbers(every):
    """Whether it is an output that shows it or the state alone."""
    phase = 0.3 * np.arange(400)
    tracker = OrderTracker(
        orders=[0, 0.01, 0.02], bandwidth_hz=0.02, rate_hz=1.0, noise_variance=1.0, initial_std=1e60, poles=4,
        output_every=every,
    )  # fmt: skip
    with pytest.raises(FloatingPointError, match=r"poles=4, a narrowest bandwidth of 0.02 .* prior of 1e\+60"):
        tracker.update(np.cos(phase), phase_rad=phase)


@pytest.mark.slow
def test_two_hundred_memories_do_not_drift():
    """One order at a twentieth of the rate, constant: the last 10 of 90 million samples, at their angles."""
    block, blocks, turned = 1_000_000, 10, 80 * 50_000
    noise, bandwidth = 0.25, 2e-5
    n = np.arange(block)
    # A block is a whole number of turns.
    phase = 2 * np.pi * n / 20
    clean = (0.8 * np.exp(1j * (phase + 0.5))).real
    rng = np.random.default_rng(0)
    noises = np.sqrt(noise) * rng.standard_normal(3 * block)
    tracker = OrderTracker(orders=[1], bandwidth_hz=bandwidth, rate_hz=1.0, noise_variance=noise, output_every=1000)
    for number in range(blocks):
        start = int(rng.integers(0, 2 * block))
        tracks = tracker.update(
            clean + noises[start : start + block], phase_rad=phase + 2 * np.pi * (turned + block // 20 * number)
        )
    # Each quadrature sees noise 2 R: steady state P^2 / (P + 2 R) = q of the prediction, P - q of the filter.
    q = 2 * noise / Bandwidth(width=bandwidth, poles=1).weight ** 2
    predicted = (q + np.sqrt(q**2 + 8 * q * noise)) / 2
    # The formula averages over a turn; within it the variance moves by the gain, 4e-4 of itself.
    assert_allclose(tracks.std[0] ** 2, predicted - q, rtol=1e-3)
    error = (tracks.complex_amplitude[0] - 0.8 * np.exp(0.5j)) / tracks.std[0]
    assert np.abs(error).max() < 5
    assert_allclose(tracks.innovation_mean_square, 1.0, rtol=2e-3)
    assert tracks.sample_index[-1] == blocks * block - 1000
