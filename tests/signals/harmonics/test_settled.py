"""The causal filter with settled gains: against the exact filter, and where it is refused."""

from dataclasses import replace

import numpy as np
import pytest
from jobs import standard_job
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import solve_discrete_are

from signals.harmonics import track_orders
from signals.harmonics._tally import Tally
from signals.harmonics.bandwidth import Bandwidth, isolated_std, process_variance
from signals.harmonics.exact import filter_on, start
from signals.harmonics.model import HarmonicModel
from signals.harmonics.settled import settled, startup_samples

RATE = 5_000.0
N = 60_000
PHASE = 2 * np.pi * 30.0 / RATE * np.arange(N)


SETTINGS = {"phase_rad": PHASE, "orders": [0.0, 1.0, 2.5, 4.0], "rate_hz": RATE, "estimator": "filter"}
U = np.arange(N) / N
TRUTH = np.array([0.5 + 0 * U, *((1 + 0.3 * np.sin(2 * np.pi * k * U)) * np.exp(1j * k) for k in (1, 2, 3))])


def record(*, noise=0.3):
    rng = np.random.default_rng(5)
    waves = TRUTH * np.exp(1j * np.array(SETTINGS["orders"])[:, None] * PHASE)
    return waves.sum(axis=0).real + noise * rng.standard_normal(N)


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
def test_shares_solve_the_riccati_equation(poles):
    width = 0.02
    q = process_variance(orders=[1.0], bandwidth=[width], rate=1.0, poles=poles, noise_variance=0.5)[0]  # N = 1
    transition = np.triu(np.ones((poles, poles)))
    drive = transition[:, -1:]  # the increment joins the highest difference, then all are summed up
    see = np.eye(1, poles)
    predicted = solve_discrete_are(transition.T, see.T, q * drive @ drive.T, np.eye(1))
    gain = (predicted @ see.T / (see @ predicted @ see.T + 1)).ravel()
    assert_allclose(Bandwidth(width=width, poles=poles).filter_shares, gain, rtol=1e-6)  # the solver's own


@pytest.mark.parametrize("poles", [1, 2, 3])
@pytest.mark.parametrize("every", [1, 7])
def test_settled_filter_is_close_to_the_exact_one(poles, every):
    settings = SETTINGS | {"x": record(), "bandwidth_hz": 1.0, "poles": poles, "output_every": every}
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
    assert fast.innovation_variance == pytest.approx(exact.innovation_variance, rel=1e-3)
    assert fast.innovation_mean_square == pytest.approx(exact.innovation_mean_square, rel=0.03)


def turning(kind, n):
    """Angles of a shaft at 17 samples a turn: even, jumping in speed, wandering, or known to a microradian."""
    at, rng = np.arange(n), np.random.default_rng(3)
    steps = np.full(n, 2 * np.pi / 17.3)
    steps[2500:] *= 1.1 if kind == "jump" else 1.0
    steps *= 1 + 0.02 * np.sin(2e-3 * at) if kind == "wander" else 1.0
    return np.cumsum(steps) + (1e-6 * rng.standard_normal(n) if kind == "jitter" else 0.0)


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", ["even", "jump", "wander", "jitter"])
def test_amplitudes_follow_the_recursion_sample_by_sample(poles, kind):
    n, width = 4003, 0.004
    phases = turning(kind, n), 3.1 * turning("even", n) + 0.3
    orders, shaft = np.array([0.0, 1.0, 2.1, 1.0, 1.7]), np.array([0, 0, 0, 1, 1])
    x = np.random.default_rng(4).standard_normal((2, n)) + np.cos(phases[0]) + 2 * np.cos(1.7 * phases[1] + 1)
    model = HarmonicModel(
        orders=orders, shaft=shaft, phases=phases, bandwidth=np.full((5, 1), width), poles=poles, prior_std=1e3
    )
    begin = startup_samples(model)
    state, head = start(model, channels=2), replace(model, phases=tuple(phase[:begin] for phase in phases))
    filter_on(head, x[:, :begin], state, Tally.empty(channels=2), first=0, output_every=1, startup=0)
    parts = state.vector.sum(axis=0).reshape(2, poles, -1)[..., :9]
    differences = parts[..., :5].astype(complex)
    differences[..., 1:] += 1j * parts[..., 5:]
    phasors = np.exp(1j * orders[:, None] * np.stack(phases)[shaft])
    gains = Bandwidth(width=width, poles=poles).filter_shares[:, None] * np.array([1.0, 2.0, 2.0, 2.0, 2.0])
    expected = np.empty((2, 5, n - begin), dtype=complex)
    for i in range(begin, n):
        turned = phasors[:, i]
        rest = x[:, i] - (differences[:, 0] * turned).real.sum(axis=1)
        differences = differences + gains * (rest[:, None] * turned.conj())[:, None]
        expected[..., i - begin] = differences[:, 0]
        differences = np.cumsum(differences[:, ::-1], axis=1)[:, ::-1]
    for every in (1, 7):
        found = settled(model, x, output_every=every, startup=0, error_bound=0.0).amplitude
        first = -(-begin // every)
        # rounding errors of 4,000 samples in states that hold what they learn for 250
        assert_allclose(found[..., first:], expected[..., first * every - begin :: every], rtol=0, atol=1e-10)


def test_amplitudes_do_not_depend_on_what_follows():
    settings = SETTINGS | {"bandwidth_hz": 1.0, "method": "fast", "noise_variance": 0.09}
    whole = track_orders(record(), **settings).complex_amplitude
    for n in (20_000, 20_001, 33_333):
        part = track_orders(record()[:n], **settings | {"phase_rad": PHASE[:n]}).complex_amplitude
        # Angles are taken for even where they are so to 1e-9; even steps are found anew in what is left of a piece.
        assert_allclose(part, whole[:, :n], rtol=0, atol=1e-9)


@pytest.mark.parametrize("poles", [1, 2])
def test_std_is_that_of_the_exact_filter_and_then_settles(poles):
    settings = SETTINGS | {"x": record(), "bandwidth_hz": 1.0, "poles": poles, "noise_variance": 0.09}
    exact, fast = (track_orders(**settings, method=method) for method in ("exact", "fast"))
    known = fast.settling_variance.shape[1]
    assert 100 < known < N // 5  # compact
    assert fast.std.shape == (4, N)
    assert fast.std is fast.std
    assert_array_equal(fast.std[:, : known - 1], exact.std[:, : known - 1])
    alone = isolated_std(
        orders=SETTINGS["orders"], bandwidth=1.0, rate=RATE, poles=poles, noise_variance=0.09, estimator="filter"
    )
    assert_allclose(fast.std[:, known - 1 :], np.broadcast_to(alone[:, None], (4, N - known + 1)), rtol=1e-12)
    assert_allclose(exact.std, np.sqrt(0.09 * exact.settling_variance), rtol=1e-15)


def test_std_takes_in_the_angle_at_every_output():
    settings = SETTINGS | {"x": record(), "bandwidth_hz": 1.0, "method": "fast", "output_every": 10}
    plain, unsure = track_orders(**settings), track_orders(**settings, phase_std_rad=0.01)
    turn = 0.01 * np.array(SETTINGS["orders"])[:, None] * np.abs(plain.complex_amplitude)
    assert_allclose(unsure.std, np.sqrt(plain.std**2 + turn**2 / 2), rtol=1e-12)


def test_a_record_that_ends_before_gains_settle_is_filtered_exactly():
    settings = SETTINGS | {"phase_rad": PHASE[:2000], "bandwidth_hz": 1.0}
    exact, fast = (track_orders(record()[:2000], **settings, method=method) for method in ("exact", "fast"))
    for name in ("complex_amplitude", "std", "noise_variance", "innovation_autocorrelation"):
        assert_array_equal(getattr(fast, name), getattr(exact, name))


def test_auto_filters_gaps_exactly():
    x = record()
    x[40_000:40_010] = np.nan
    assert track_orders(x, **SETTINGS, bandwidth_hz=0.01, rtol=0.01, output_every=100).method == "exact"


def test_settled_filter_shares_channels():
    x = np.stack([record(noise=0.1), record(noise=0.4)])
    both = track_orders(**SETTINGS, x=x, bandwidth_hz=1.0, method="fast", output_every=50)
    assert both.settling_variance.shape[1] < both.std.shape[2] == N // 50
    for channel, values in enumerate(x):
        alone = track_orders(**SETTINGS, x=values, bandwidth_hz=1.0, method="fast", output_every=50)
        assert_array_equal(both.complex_amplitude[channel], alone.complex_amplitude)
        assert_allclose(both.std[channel], alone.std, rtol=1e-12)


@pytest.mark.slow
def test_settled_filter_keeps_the_error_of_the_exact_one_on_the_standard_job():
    job = standard_job("J3 angle")
    errors = []
    for method in ("exact", "fast"):
        tracks = track_orders(**job.tracking(0.033), estimator="filter", method=method, output_every=64)
        errors.append(job.error(tracks.complex_amplitude, tracks.sample_index))
    assert errors[1] == pytest.approx(errors[0], rel=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.where(np.arange(N) == 700, np.nan, record())}, "samples are missing"),
        ({"bandwidth_hz": np.linspace(1, 2, N)[None]}, "the bandwidth varies"),
        ({"orders": [1.0, 1.02]}, "orders come so close"),
        ({"phase_rad": PHASE * 0.001}, "orders come so close, to one another, to zero"),
    ],
)
def test_where_gains_never_settle_it_is_refused(change, message):
    with pytest.raises(ValueError, match=f'method="fast" with estimator="filter": {message}.*use method="exact"'):
        track_orders(**(SETTINGS | {"x": record(), "bandwidth_hz": 1.0, "method": "fast"} | change))


def test_auto_takes_settled_gains_where_the_error_grows_by_less_than_rtol():
    settings = SETTINGS | {"x": record(), "output_every": 100}
    assert track_orders(**settings, bandwidth_hz=3.0).method == "exact"
    assert track_orders(**settings, bandwidth_hz=3.0, rtol=0.01).method == "fast"
    assert track_orders(**settings, bandwidth_hz=0.1).method == "fast"


@pytest.mark.parametrize(("poles", "apart"), [(1, 3), (2, 5), (3, 7), (4, 10)])
def test_settled_gains_add_no_more_than_their_bound_to_the_error(poles, apart):
    width, orders = 3e-3, 6
    rng, n = np.random.default_rng(poles), 50_000
    phase = 2 * np.pi * 0.1 * np.arange(n)
    numbers = 1 + width * apart / 0.1 * np.arange(orders)
    q = process_variance(orders=[1.0], bandwidth=[width], rate=1.0, poles=poles, noise_variance=1.0)[0]
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
