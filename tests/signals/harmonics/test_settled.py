"""The causal filter with settled gains: against the exact filter, and where it is refused."""

import numpy as np
import pytest
from jobs import standard_job
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import solve_discrete_are

from signals.harmonics import track_orders
from signals.harmonics.bandwidth import Bandwidth, process_variance

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


def test_settled_filter_shares_channels():
    x = np.stack([record(noise=0.1), record(noise=0.4)])
    both = track_orders(**SETTINGS, x=x, bandwidth_hz=1.0, method="fast", output_every=50)
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


def test_auto_takes_settled_gains_where_their_ripple_is_below_rtol():
    settings = SETTINGS | {"x": record(), "output_every": 100}
    assert track_orders(**settings, bandwidth_hz=1.0).method == "exact"
    assert track_orders(**settings, bandwidth_hz=0.01, rtol=0.01).method == "fast"
