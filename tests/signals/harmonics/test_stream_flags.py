"""What a stream can tell of its outputs while it goes on, against its definition, sample by sample."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from signals.harmonics import OrderTracker, OutputFlag, track_orders

SAMPLES = 2400
BANDWIDTH = 0.004
STRETCH = 32  # the largest power of two in a quarter of 250 samples
UNCLEAR = OutputFlag.NOT_SEPARABLE | OutputFlag.ONE_QUADRATURE
ENDS = OutputFlag.NEAR_END | OutputFlag.NEAR_GAP
SETTINGS = {"bandwidth_hz": BANDWIDTH, "rate_hz": 1.0, "noise_variance": 1.0}
NOISE = np.random.default_rng(0).standard_normal(SAMPLES)
n = np.arange(SAMPLES)
MOTIONS = {
    "steady": 2 * np.pi * 0.05 * n,
    "runs up": 2 * np.pi * (0.002 * n + 6e-6 * n**2),
    "rests": 2 * np.pi * 0.05 * np.where(n < 900, n, np.maximum(n - 600, 900)),
    "turns round": 2 * np.pi * 0.02 * np.abs(n - 1216),  # where a segment ends
    "reverses": 2 * np.pi * 1e-5 * (n - 1200) ** 2,
}


def tracked(x, phase, sizes, *, orders, lag=None, every=1):
    """Flags of a whole stream, cut into blocks of these sizes, and what its last tracks say."""
    tracker, found, at, number = OrderTracker(orders=orders, lag=lag, output_every=every, **SETTINGS), [], 0, 0
    while at < SAMPLES:
        block = slice(at, at + sizes[number % len(sizes)])
        found.append(tracker.update(x[..., block], phase_rad=phase[block]))
        at, number = block.stop, number + 1
    found.append(tracker.finish())
    return np.concatenate([tracks.flags for tracks in found], axis=-1), found[-1]


def segments(*, lag):
    """Where the segments of a stream end, as the module says: at powers of two, then as far apart as the longest."""
    longest = 16 if lag == 20 else STRETCH  # no longer than the lag
    ends = [0, *(2**k for k in range(12) if 2**k < longest), *range(longest, SAMPLES, longest)]
    return ends if lag is None or ends[-1] == SAMPLES - 1 else [*ends, SAMPLES - 1]


def expected_unclear(phase, orders, *, lag):
    """(order, sample) flags of lines too close and of rest, and the shares of the pairs, by the definition."""
    ends, size = segments(lag=lag), len(orders)
    flags = np.zeros((size, len(ends)), dtype=int)
    parted, together = np.zeros((size, size)), np.zeros((size, size))
    before = None
    for place, end in enumerate(ends):
        length = end - ends[place - 1] if place else 0
        speed = (phase[end] - phase[ends[place - 1]]) / (2 * np.pi * length) if place else 0.0
        for k, order in enumerate(orders):
            twice = 2 * order * speed
            if order and abs(twice - round(twice)) < BANDWIDTH / 2:
                flags[k, place] |= OutputFlag.ONE_QUADRATURE
            for other in range(k + 1, size):
                distance = min(
                    away(now, then) for now, then in zip(apart(order, orders[other], speed),
                    apart(order, orders[other], before) if place > 1 else [None, None], strict=True)
                )  # fmt: skip
                parted[k, other] += distance * length
                if distance < BANDWIDTH / 2 or parted[k, other] < 1:
                    flags[[k, other], place] |= OutputFlag.NOT_SEPARABLE
                together[k, other] += length * (distance < BANDWIDTH / 2)
        before = speed
    last = np.searchsorted(ends, n, side="right") - 1 + (lag is not None)
    never = np.triu(parted < 1, k=1)
    return flags[:, np.minimum(last, len(ends) - 1)], np.where(never, 1.0, together / ends[-1])


def apart(order, other, speed):
    """From one line to the other, and from its image, over the fold at the rate."""
    return [value - round(value) for value in ((other - order) * speed, (other + order) * speed)]


def away(now, then):
    """A line that was on the other side, less than a quarter of the rate off, has been crossed."""
    return 0.0 if then is not None and now * then < 0 and max(abs(now), abs(then)) < 0.25 else abs(now)


# A lag shorter than a segment makes segments shorter, whatever the motion: one that rests and one that turns round.
@pytest.mark.parametrize(
    ("lag", "motion"),
    [*((lag, motion) for lag in (None, 300) for motion in MOTIONS), (20, "rests"), (20, "turns round")],
)
def test_flags_of_speeds_are_those_of_the_last_stretch_or_its_own(lag, motion):
    orders = [0, 1, 1.0001, 2.5, 10]
    phase = MOTIONS[motion]
    expected, shares = expected_unclear(phase, orders, lag=lag)
    for sizes in ([SAMPLES], [1, 7, 64, 333]):
        flags, last = tracked(NOISE, phase, sizes, orders=orders, lag=lag)
        assert_array_equal(flags & UNCLEAR, expected)
        assert {(pair.first, pair.second) for pair in last.unresolved} == set(zip(*np.nonzero(shares), strict=True))
        assert max(abs(pair.share - shares[pair.first, pair.second]) for pair in last.unresolved) < 1e-12


def test_twins_are_never_told_apart_and_others_once_they_have_parted_by_a_turn():
    flags, last = tracked(NOISE, MOTIONS["steady"], [100], orders=[1, 1.0001, 3])
    close = (flags & OutputFlag.NOT_SEPARABLE) > 0
    assert close[:2].all()
    # Order 3 is 0.1 cycles a sample off: a turn in ten samples, known at the next end of a segment, sample 16.
    assert_array_equal(close[2], n < 16)
    assert last.unresolved == ((0, 1, 1.0),)


def test_a_shaft_at_rest_is_flagged_as_long_as_it_rests():
    flags, _ = tracked(NOISE, MOTIONS["rests"], [61], orders=[0, 1])
    # It stops at sample 900 and goes on at 1500. The mean over a segment, 32 samples long, is slower than half a
    # bandwidth, or less than that off the image, where it rests but for a sample or two.
    rests = (flags & UNCLEAR) > 0
    assert_array_equal(rests[0], rests[1])
    assert rests[:, 960:1500].all()
    assert not rests[:, 600:900].any()
    assert not rests[:, 1568:].any()


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("gaps", [[], [(500, 540)], [(0, 300), (700, 701), (900, 1500)], [(0, SAMPLES)]])
def test_ends_and_gaps_are_those_of_the_whole_record(gaps, every):
    x = NOISE.copy()
    for gap in gaps:
        x[slice(*gap)] = np.nan
    settings = {"orders": [1, 2.5], "output_every": every, **SETTINGS}
    settings["bandwidth_hz"] = [BANDWIDTH, BANDWIDTH / 5]
    phase = MOTIONS["steady"]
    whole = track_orders(x, phase_rad=phase, estimator="filter", method="exact", **settings)
    for size in (SAMPLES, 11 if every == 7 else 90):
        tracker = OrderTracker(**settings)
        parts = [tracker.update(x[at : at + size], phase_rad=phase[at : at + size]) for at in range(0, SAMPLES, size)]
        assert_array_equal(np.concatenate([part.flags for part in parts], axis=1) & ENDS, whole.flags & ENDS)
        # Of the missing samples those that tell of outputs to come: of half of 1 / bandwidth at the most.
        assert tracker.state()["flags_missing"].size <= 0.5 / (BANDWIDTH / 5)


def test_a_lag_sees_gaps_to_come_and_takes_what_it_has_waited_for_as_an_end():
    x, phase = NOISE.copy(), MOTIONS["steady"]
    x[1000:1090] = np.nan
    whole = track_orders(x, phase_rad=phase, method="exact", orders=[1], **SETTINGS)
    flags, _ = tracked(x, phase, [130], orders=[1], lag=300)
    # 300 samples are more than half of 1 / bandwidth and the gap together.
    assert_array_equal(flags & ENDS, whole.flags & ENDS)
    short, _ = tracked(x, phase, [130], orders=[1], lag=20)
    assert np.all(short & OutputFlag.NEAR_END)


def test_a_bandwidth_narrower_than_any_stream_is_long():
    settings = {"orders": [1, 2], "bandwidth_hz": 1e-40, "rate_hz": 1.0, "noise_variance": 1.0}
    x = NOISE.copy()
    x[100:200] = np.nan
    for lag in (None, 70):
        tracker = OrderTracker(lag=lag, **settings)
        parts = [tracker.update(x[at : at + 300], phase_rad=0.3 * n[at : at + 300]) for at in range(0, SAMPLES, 300)]
        flags = np.concatenate([part.flags for part in [*parts, tracker.finish()]], axis=1)
        assert np.all(flags & OutputFlag.NEAR_END)
        # 0.05 cycles a sample apart: a turn in twenty samples.
        assert not np.any(flags[:, 64:] & OutputFlag.NOT_SEPARABLE)


def test_channels_have_the_same_flags():
    x = np.stack([NOISE, 2 * NOISE])
    x[:, 700:900] = np.nan
    for lag in (None, 300):
        both, _ = tracked(x, MOTIONS["rests"], [500], orders=[1, 2], lag=lag)
        alone, _ = tracked(x[0], MOTIONS["rests"], [500], orders=[1, 2], lag=lag)
        assert_array_equal(both, np.stack([alone, alone]))


def test_a_single_sample_tells_one_quadrature_of_one_order():
    tracker = OrderTracker(orders=[0, 1], **SETTINGS)
    tracks = tracker.update([1.0], phase_rad=[0.3])
    assert_array_equal(
        tracks.flags[:, 0], [OutputFlag.NEAR_END | OutputFlag.NOT_SEPARABLE, OutputFlag.NEAR_END | UNCLEAR]
    )
    assert tracks.unresolved == ((0, 1, 1.0),)
    assert np.isnan([tracks.whiteness, tracks.innovation_mean_square, tracks.innovation_variance]).all()
