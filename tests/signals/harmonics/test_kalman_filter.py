"""The covariance filter against least squares on the samples so far, in fifty digits; the filter with fixed gains."""

from dataclasses import replace

import numpy as np
import pytest
from amplitude_oracle import Case
from jobs import standard_job
from numpy.testing import assert_allclose, assert_array_equal

from signals.harmonics import track_orders
from signals.harmonics.bandwidth import Bandwidth


def record(samples=300, *, phase=None, orders=(1.0, 2.3), **more):
    phase = 0.3 * np.arange(samples) if phase is None else phase
    waves = np.cos(np.array(orders) * phase[:, None] + 1) @ np.resize([1.0, 0.5, -0.7], len(orders))
    x = waves + np.random.default_rng(0).standard_normal(phase.size)
    known = {"bandwidth": 0.01, "poles": 1, "noise": 1.0, "initial_std": 1e3}
    return Case(x=x, phase=phase, orders=orders, **known | more)


def check(case, *, rtol=1e-6, samples=(0, 3, 20, -1)):
    """An amplitude is as good as it is large, or as it is sure."""
    tracks = case.track(estimator="filter")
    for sample in np.arange(case.x.size)[list(samples)]:
        amplitude, std = case.least_squares_on_the_past(sample)
        assert_allclose(tracks.std[:, [sample]], std, rtol=rtol)
        off = np.abs(tracks.complex_amplitude[:, [sample]] - amplitude) / np.maximum(np.abs(amplitude), std)
        assert off.max() < rtol


POLES = pytest.mark.parametrize("poles", [1, 2, 3, 4])


@POLES
@pytest.mark.parametrize("initial_std", [1.0, 1e3, 1e6, 1e8])
def test_wide_priors(poles, initial_std):
    check(record(poles=poles, initial_std=initial_std))


@POLES
@pytest.mark.parametrize("bandwidth", [1e-4, 1e-7, 0.3])
def test_narrow_and_wide_bandwidths(poles, bandwidth):
    check(record(400, poles=poles, bandwidth=bandwidth))


def at_rest():
    n = np.arange(900)
    return 0.3 * np.minimum(n, 200) + 0.3 * np.maximum(n - 700, 0)


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize(
    "hard",
    [
        {"initial_std": 1e5, "orders": (1.0, 1.0, 2.0)},
        {"initial_std": 1e5, "orders": (1.0, 1.0 + 1e-7, 2.0)},
        {"orders": (1.0, 0.2), "phase": np.pi * np.arange(300)},  # half the rate: the sine keeps its prior
        {"phase": at_rest()},
        {"orders": (0.0, 1.0), "bandwidth": 0.01 * np.exp(np.cos(np.arange(300) / 20))[None]},
    ],
    ids=["equal", "nearly equal", "half the rate", "at rest", "mean and varying bandwidth"],
)
def test_orders_that_coincide_rest_and_vary(poles, hard):
    check(record(poles=poles, **hard))


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_a_gap_of_thirty_memories(poles):
    """The covariance grows by 1e13 with four poles: of what was known before no digit is left, nor needed."""
    case = record(900, poles=poles, bandwidth=0.05)
    x = case.x.copy()
    x[100:700] = np.nan
    check(replace(case, x=x), samples=(699, 705))


@pytest.mark.parametrize("initial_std", [1e3, 1e6, 1e8])
def test_a_slow_shaft(initial_std):
    """A seventh of a turn: three orders, nothing resolved but their sum and a slope."""
    phase = 2 * np.pi * 2e-4 * np.arange(700)
    check(record(bandwidth=1e-5, initial_std=initial_std, orders=(1.0, 2.0, 3.0), phase=phase))


# As docs/trackers.md says it: how far the run-up's start is off, of an amplitude or of its std, whichever is larger.
@pytest.mark.parametrize(("initial_std", "rtol"), [(1e3, 1e-10), (1e6, 1e-7)])
def test_the_start_of_a_run_up_is_that_of_fifty_digits(initial_std, rtol):
    job = standard_job("J1 run-up", samples=1000)
    width = float(Bandwidth.from_weight(np.sqrt(2e9), poles=1).width)
    given = {"bandwidth": width, "poles": 1, "noise": 1.0, "initial_std": initial_std}
    check(Case(x=job.x, phase=job.phase_rad, orders=tuple(job.orders), **given), rtol=rtol, samples=(3, 120))


# Fixed gains.


RATE = 5_000.0
N = 60_000
PHASE = 2 * np.pi * 30.0 / RATE * np.arange(N)


SETTINGS = {"phase_rad": PHASE, "orders": [0.0, 1.0, 2.5, 4.0], "rate_hz": RATE, "estimator": "filter"}
U = np.arange(N) / N
TRUTH = np.array([0.5 + 0 * U, *((1 + 0.3 * np.sin(2 * np.pi * k * U)) * np.exp(1j * k) for k in (1, 2, 3))])


def steady_record(*, noise=0.3):
    rng = np.random.default_rng(5)
    waves = TRUTH * np.exp(1j * np.array(SETTINGS["orders"])[:, None] * PHASE)
    return waves.sum(axis=0).real + noise * rng.standard_normal(N)


@pytest.mark.parametrize("poles", [1, 2, 3])
@pytest.mark.parametrize(("every", "gap"), [(1, 0), (7, 0), (7, 300)])
@pytest.mark.compiles
def test_settled_filter_is_close_to_the_exact_one(poles, every, gap):
    x = steady_record()
    x[40_000 : 40_000 + gap] = np.nan
    settings = SETTINGS | {"x": x, "bandwidth_hz": 1.0, "poles": poles, "output_every": every}
    settings["noise_variance"] = 0.09
    exact, fast = (track_orders(**settings, method=method) for method in ("exact", "fast"))
    off = np.abs(fast.complex_amplitude - exact.complex_amplitude)
    assert_array_equal(off[:, :3], 0.0)  # it starts as the exact one
    # What settled gains leave out are ripples at distances of 30 Hz and more.
    assert fast.error_bound < 0.15
    error = np.abs(exact.complex_amplitude - TRUTH[:, ::every])
    settled = slice(N // 10 // every, None)
    assert np.sqrt(np.mean(off[:, settled] ** 2)) < fast.error_bound * np.sqrt(np.mean(error[:, settled] ** 2))
    assert_allclose(fast.std, exact.std, rtol=fast.error_bound)
    assert fast.innovation_mean_square == pytest.approx(exact.innovation_mean_square, rel=0.03)


def test_a_record_that_ends_before_gains_settle_is_filtered_exactly():
    settings = SETTINGS | {"phase_rad": PHASE[:2000], "bandwidth_hz": 1.0}
    exact, fast = (track_orders(steady_record()[:2000], **settings, method=method) for method in ("exact", "fast"))
    for name in ("complex_amplitude", "std", "noise_variance"):
        assert_array_equal(getattr(fast, name), getattr(exact, name))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bandwidth_hz": np.linspace(1, 2, N)[None]}, "the bandwidth varies"),
        ({"orders": [1.0, 1.02]}, "orders come so close"),
        ({"phase_rad": PHASE * 0.001}, "orders come so close, to one another, to zero"),
    ],
)
def test_where_gains_never_settle_it_is_refused(change, message):
    with pytest.raises(ValueError, match=f'method="fast" with estimator="filter": {message}.*use method="exact"'):
        track_orders(**(SETTINGS | {"x": steady_record(), "bandwidth_hz": 1.0, "method": "fast"} | change))


def test_auto_takes_settled_gains_where_the_error_grows_by_less_than_rtol():
    settings = SETTINGS | {"x": steady_record(), "output_every": 100}
    assert track_orders(**settings, bandwidth_hz=3.0).method == "exact"
    assert track_orders(**settings, bandwidth_hz=3.0, rtol=0.01).method == "fast"
    assert track_orders(**settings, bandwidth_hz=0.1).method == "fast"


@pytest.mark.parametrize(("poles", "apart"), [(1, 3), (2, 5), (3, 7), (4, 10)])
def test_settled_gains_add_no_more_than_their_bound_to_the_error(poles, apart):
    width, orders = 3e-3, 6
    rng, n = np.random.default_rng(poles), 50_000
    phase = 2 * np.pi * 0.1 * np.arange(n)
    numbers = 1 + width * apart / 0.1 * np.arange(orders)
    q = 2 / Bandwidth(width=width, poles=poles).weight ** 2
    truth = np.sqrt(q) * (rng.standard_normal((orders, n)) + 1j * rng.standard_normal((orders, n)))
    for _ in range(poles):
        truth = np.cumsum(truth, axis=1)
    x = np.sum(truth * np.exp(1j * numbers[:, None] * phase), axis=0).real + rng.standard_normal(n)
    settings = {"phase_rad": phase, "orders": numbers, "bandwidth_hz": width, "rate_hz": 1.0, "poles": poles}
    exact, fast = (track_orders(x, **settings, estimator="filter", method=how) for how in ("exact", "fast"))
    late = slice(n // 10, None)
    wrong, more, off = (
        np.sqrt(np.mean(np.abs(a - b)[:, late] ** 2))
        for a, b in (
            (exact.complex_amplitude, truth),
            (fast.complex_amplitude, truth),
            (fast.complex_amplitude, exact.complex_amplitude),
        )
    )
    assert 0.4 < fast.error_bound < 0.7
    assert 0.4 * fast.error_bound < off / wrong < 0.75 * fast.error_bound
    assert more / wrong - 1 < 0.3 * fast.error_bound**2
