"""What comes with the amplitudes: channels, bandwidths that vary, pairs too close, phase errors, waveforms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import OrderTracker, order_waveform, track_orders

RATE = 1000.0
N = 20_000
PHASE = 2 * np.pi * (0.02 * np.arange(N) + 5e-7 * np.arange(N) ** 2)
SETTINGS = {"phase_rad": PHASE, "orders": [1, 2.3, 4], "bandwidth_hz": 1.0, "rate_hz": RATE, "poles": 2}
METHODS = pytest.mark.parametrize("method", ["exact", "fast"])


def record(seed, *, noise=0.1):
    rng = np.random.default_rng(seed)
    amplitude = rng.standard_normal(3) + 1j * rng.standard_normal(3)
    waves = (amplitude[:, None] * np.exp(1j * np.array([1, 2.3, 4])[:, None] * PHASE)).real
    return waves.sum(axis=0) + noise * rng.standard_normal(N), amplitude, waves


@pytest.mark.parametrize(
    ("method", "estimator"), [("exact", "smoother"), ("fast", "smoother"), ("exact", "filter"), ("fast", "filter")]
)
@pytest.mark.parametrize("dead", [False, True])
def test_channels_are_those_tracked_one_by_one(method, estimator, dead):
    x = np.stack([record(seed)[0] for seed in range(3)])
    x[1, 5000:5400] = np.nan  # another pattern of missing samples
    settings = SETTINGS | {"method": method, "estimator": estimator, "output_every": 100}
    if dead:
        x[2], settings["noise_variance"] = np.nan, 0.01
    together = track_orders(x, **settings)
    assert together.complex_amplitude.shape == (3, 3, 200)
    for channel in range(3):
        alone = track_orders(x[channel], **settings)
        # Which orders disturb one another, and so are smoothed together, is judged from all channels at once: within
        # the error that "fast" owns up to, which for "exact" is none.
        atol = 1e-6 + alone.error_bound * np.abs(alone.complex_amplitude).max()
        assert_allclose(together.complex_amplitude[channel], alone.complex_amplitude, rtol=0, atol=atol)
        # `std` near the ends differs by what the cut through the record leaves of it three memories on, exp(-6).
        assert_allclose(together.std[channel], alone.std, rtol=1e-6 if method == "exact" else np.exp(-6) * 2)
        for name in ("noise_variance", "innovation_mean_square"):
            found, expected = np.broadcast_to(getattr(together, name), 3)[channel], getattr(alone, name)
            assert_allclose(found, expected, rtol=0.01 if dead else 1e-6 + alone.error_bound)


@METHODS
def test_a_bandwidth_that_varies_is_each_of_its_values_where_it_lasts(method):
    x, _, _ = record(0)
    varying = np.where(np.arange(N) < N // 2, 0.5, 2.0)[None]
    settings = SETTINGS | {"method": method, "output_every": 100, "noise_variance": 0.01}
    both = track_orders(x, **settings | {"bandwidth_hz": varying})
    for bandwidth, part in ((0.5, slice(40, 60)), (2.0, slice(140, 160))):
        # 4 s from the step and 4 s from the end: 2 and 8 times 1 / bandwidth.
        alone = track_orders(x, **settings | {"bandwidth_hz": bandwidth})
        assert_allclose(both.std[:, part], alone.std[:, part], rtol=0.03)
    assert_allclose(both.bandwidth, 1.25)


@METHODS
def test_bandwidth_in_orders_follows_the_speed_of_a_record_in_time(method):
    x, _, _ = record(0)
    settings = {key: value for key, value in SETTINGS.items() if key != "bandwidth_hz"}
    settings |= {"method": method, "output_every": 50}
    by_orders = track_orders(x, bandwidth_orders=0.05, **settings)
    speed = np.gradient(PHASE) / (2 * np.pi) * RATE
    by_hz = track_orders(x, bandwidth_hz=0.05 * speed[None], **settings)
    assert_allclose(by_orders.complex_amplitude, by_hz.complex_amplitude, rtol=1e-9)


@pytest.mark.parametrize("units", ["hz", "orders", "by speed"])
def test_bandwidths_are_told_as_given(units):
    n = 4000
    bandwidth = {"bandwidth_hz": [0.02, 0.04, 0.02], "rate_hz": 1000.0}
    if units == "orders":
        bandwidth = {"bandwidth_orders": [0.01, 0.02, 0.01], "samples_per_rev": 512}
    if units == "by speed":
        bandwidth = {"bandwidth_orders": [1e-3, 2e-3, 1e-3], "rate_hz": 1000.0}
    for estimator in ("smoother", "filter"):
        tracks = track_orders(
            record(0)[0][:n], phase_rad=PHASE[:n], orders=[1, 2.3, 4], estimator=estimator,
            output_every=100, **bandwidth,
        )  # fmt: skip
    assert_allclose(tracks.bandwidth, bandwidth.get("bandwidth_hz", bandwidth.get("bandwidth_orders")))


def test_half_the_rate_and_rest_leave_one_quadrature():
    phase = np.concatenate([np.zeros(3000), np.pi * np.arange(3000)])
    tracks = track_orders(
        np.cos(phase), phase_rad=phase, orders=[1], bandwidth_hz=0.01, rate_hz=1.0, output_every=100, noise_variance=1.0
    )
    assert_allclose(tracks.complex_amplitude[0, 5:-5].real, 1.0, atol=1e-3)
    # The other quadrature keeps its prior of 1000; the mean of the two squares is half of that.
    assert np.all(tracks.std > 600)


@METHODS
def test_waveforms_add_up_to_the_record(method):
    x, _, waves = record(3)
    x[4000:4100] = np.nan
    tracks = track_orders(x, output_every=50, method=method, **SETTINGS)
    clean = slice(2000, N - 2000)
    for place in range(3):
        wave = order_waveform(tracks, phase_rad=PHASE, places=[place])
        # std of an amplitude is 0.005 and less; over 16,000 samples 5 of it.
        assert np.abs(wave - waves[place])[clean].max() < 5 * tracks.std[place].max()
    assert_allclose(np.nanstd(x - order_waveform(tracks, phase_rad=PHASE)), 0.1, rtol=0.03)
    with pytest.raises(ValueError, match=r"places=\[3\] must lie between 0 and 2"):
        order_waveform(tracks, phase_rad=PHASE, places=[3])


def test_waveforms_are_those_of_whole_records():
    x, _, _ = record(3)
    tracker = OrderTracker(orders=[1], noise_variance=0.01, bandwidth_hz=1.0, rate_hz=RATE)
    _, late = (tracker.update(x[at : at + 1000], phase_rad=PHASE[at : at + 1000]) for at in (0, 1000))
    with pytest.raises(ValueError, match=r"tracks have 1000 outputs from sample 1000 on.*take those of"):
        order_waveform(late, phase_rad=PHASE[: late.samples])
