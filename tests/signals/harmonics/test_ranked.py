"""Many coupled orders: the smoother that takes in few numbers a knot, against least squares over all knots at once."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from signals.harmonics import _ranked, smoothing, track_orders
from signals.harmonics._information import KnotChain, Knowledge, shapes, smooth_knots
from signals.harmonics._rank_kernels import condense
from signals.harmonics._ranked import smooth_ranked

LINES, KNOTS, BLOCK, LANES = 17, 64, 8, 2


def scene(poles, knots=KNOTS, prior=100.0):
    """Return a chain of close lines, and what it sums up: regressors, (knot, sample, state), and data, (.., lane)."""
    rng = np.random.default_rng(0)
    angle = 2 * np.pi * (0.05 + 5e-3 * np.arange(LINES))[:, None] * np.arange(knots * BLOCK)
    columns = np.concatenate([np.cos(angle), np.sin(angle)]).T.reshape(knots, BLOCK, -1)
    y = 5 * rng.standard_normal((knots, BLOCK, LANES))
    u = np.arange(BLOCK) / BLOCK
    powers = u[:, None] ** np.arange(2 * poles - 1)
    differences = [
        np.prod([(u + k - 2 - i) / (i + 1) for i in range(k)], axis=0) * np.ones(BLOCK) for k in range(poles)
    ]
    regressors = np.concatenate([rise[:, None] * columns for rise in differences], axis=2)
    width = columns.shape[2]
    variance = prior * 0.1 ** (2 * np.arange(poles))[:, None] * np.ones(width)
    before = Knowledge.prior(variance, LANES)
    chain = KnotChain(
        gram=np.einsum("nm,kna,knb->kmab", powers, columns, columns),
        data=np.einsum("nm,kna,knl->kmal", powers[:, :poles], columns, y),
        walk_variance=1e-3 * 0.1 ** (2 * poles - 2) * rng.uniform(0.5, 2, (knots, width)),
        before=before,
        after=before.nothing(),
    )
    return chain, regressors, y


def least_squares(chain, regressors, y, first=0):
    """Levels, (knot, width, lane), and their variances, (knot, width), and the log variance of the innovations."""
    knots, poles, width, _ = chain.data.shape
    size, steps = poles * width, (knots - 1) * width
    turn = np.kron(np.triu(np.ones((poles, poles))), np.eye(width))
    path = np.zeros((knots, size, size + steps))  # of a first state and all increments
    path[0, :, :size] = np.eye(size)
    for k in range(1, knots):
        path[k] = path[k - 1]
        path[k, size - width :, size + (k - 1) * width : size + k * width] += np.eye(width)
        path[k] = turn @ path[k]
    information = np.diag(np.concatenate([np.diag(chain.before.matrix), 1 / chain.walk_variance[:-1].ravel()]))
    told = np.zeros((size + steps, y.shape[2]))
    for k in range(knots):
        if k == first:
            log_before = np.linalg.slogdet(information)[1]
        rows = regressors[k] @ path[k]
        information += rows.T @ rows
        told += rows.T @ y[k]
    covariance = np.linalg.inv(information)
    levels = path[:, :width]
    variances = np.sum(levels @ covariance * levels, axis=2)
    return levels @ (covariance @ told), variances, np.linalg.slogdet(information)[1] - log_before


@pytest.mark.parametrize("poles", [1, 2])
def test_smoothers_agree_with_least_squares(poles):
    first = 7
    chain, regressors, y = scene(poles)
    levels, variances, log_variance = least_squares(chain, regressors, y, first)
    for smooth in (smooth_knots, smooth_ranked):
        found, of_found, log_found = smooth(chain, first=first)
        assert np.max(np.abs(found - levels) / np.sqrt(variances)[..., None]) < 1e-4
        assert log_found == pytest.approx(log_variance, abs=1e-4)
        right = np.isclose(of_found, variances, rtol=1e-7)
        assert np.mean(right.all(axis=1)) >= (1 if smooth is smooth_knots else 0.25)
        assert_allclose(of_found, variances, rtol=0.1)  # cubics in between


def test_rows_say_what_the_information_says():
    chain, regressors, y = scene(2)
    rows, values = np.empty((KNOTS, 32, 4 * LINES)), np.empty((KNOTS, 32, LANES))
    ranks = np.empty(KNOTS, dtype=np.int64)
    condense(chain.gram, chain.data, shapes(2), rows, values, ranks)
    assert ranks.max() <= BLOCK
    for k in range(KNOTS):
        assert_allclose(rows[k].T @ rows[k], regressors[k].T @ regressors[k], atol=1e-7)
        assert_allclose(rows[k].T @ values[k], regressors[k].T @ y[k], atol=1e-3)
    condense(chain.gram, chain.data, shapes(2), rows[:, :5], values[:, :5], ranks)
    assert_array_equal(ranks, 6)


def test_stretches_change_nothing(monkeypatch):
    chain, _, _ = scene(2)
    whole = smooth_ranked(chain, first=0)
    monkeypatch.setattr(_ranked, "STRETCH_NUMBERS", 30_000)
    parts = smooth_ranked(chain, first=0)
    assert_allclose(parts[0], whole[0], rtol=1e-9, atol=1e-9)
    assert_allclose(parts[1], whole[1], rtol=0.1)  # other knots are interpolated
    assert parts[2] == pytest.approx(whole[2], rel=1e-12)


def test_what_begins_open_is_smoothed_in_reversed_time_or_left(monkeypatch):
    chain, _, _ = scene(2, knots=300, prior=1e6)
    levels, variances, log_variance = smooth_knots(chain, first=0)
    found, of_found, log_found = smooth_ranked(chain, first=0)
    assert np.max(np.abs(found - levels) / np.sqrt(variances)[..., None]) < 1e-3
    assert_allclose(of_found, variances, rtol=0.1)
    assert log_found == pytest.approx(log_variance, abs=0.01)
    monkeypatch.setattr(_ranked, "STRETCH_NUMBERS", 1)  # a knot at a time, where more begin open
    assert smooth_ranked(chain, first=0) is None


def scene_of(name):
    """Return a record of 18 lines a bandwidth apart, and how they are tracked, with something about it."""
    rng, n = np.random.default_rng(1), 100_000 if name == "four poles" else 60_000
    phase = 2 * np.pi / 512 * np.arange(n)
    orders = 20 + 0.05 * np.arange(18)
    x = rng.standard_normal(n) + np.cos(orders[:, None] * phase + orders[:, None]).sum(axis=0)
    settings = {"phase_rad": phase, "orders": orders, "bandwidth_orders": 0.05, "samples_per_rev": 512.0}
    settings |= {"poles": 2, "output_every": 50, "method": "fast"}
    if name == "gaps":
        x[30_000:34_000] = x[3000:3300] = np.nan
    if name == "long gap":
        x[10_000:50_000] = np.nan
    if name == "channels":
        x = np.stack([x, x[::-1]])
    if name == "loud":
        x *= 1e4
    if name == "rest":
        settings["phase_rad"] = np.maximum(phase - phase[20_000], 0)
    if name == "twins, nearly":
        settings["orders"] = 20 + 0.0025 * np.arange(18)
    if name == "bandwidth that varies":
        settings["bandwidth_orders"] = np.linspace(0.02, 0.1, n)[None]
    if "pole" in name:
        settings["poles"] = {"one": 1, "three": 3, "four": 4}[name.split()[0]]
    if name == "a wide prior":
        settings |= {"noise_variance": 1.0, "initial_std": 1e5}
    return x, settings


@pytest.mark.parametrize(
    "name", ["gaps", "channels", "loud", "bandwidth that varies", "one pole", "three poles", "four poles"]
)
def test_many_orders_are_smoothed_as_few_are(name, monkeypatch):
    x, settings = scene_of(name)
    ranked = track_orders(x, **settings)
    monkeypatch.setattr(smoothing, "smooth_ranked", lambda *_, **__: None)
    plain = track_orders(x, **settings)
    assert 0 < np.max(np.abs(ranked.complex_amplitude - plain.complex_amplitude) / plain.std) < 1e-4
    assert_allclose(ranked.std, plain.std, rtol=6e-3)
    assert_allclose(ranked.noise_variance, plain.noise_variance, rtol=1e-5)


@pytest.mark.parametrize("name", ["long gap", "rest", "twins, nearly", "a wide prior"])
def test_where_the_past_stays_open_knowledge_is_added_up(name, monkeypatch):
    x, settings = scene_of(name)
    found = []

    def spy(chain, first):
        found.append(smooth_ranked(chain, first=first))
        return found[-1]

    monkeypatch.setattr(smoothing, "smooth_ranked", spy)
    tracks = track_orders(x, **settings)
    assert found
    assert all(one is None for one in found)
    assert np.all(np.isfinite(tracks.complex_amplitude))


@pytest.mark.parametrize("poles", [1, 2])
def test_many_orders_are_close_to_the_exact_smoother(poles):
    x, settings = scene_of("one pole" if poles == 1 else "")
    settings |= {"orders": settings["orders"][:16], "output_every": 500, "noise_variance": 1.0}
    fast, exact = (track_orders(x, **(settings | {"method": how})) for how in ("fast", "exact"))
    off = np.abs(fast.complex_amplitude - exact.complex_amplitude)
    assert np.all(off < fast.error_bound * np.abs(exact.complex_amplitude).max() + 0.03 * exact.std)
    assert_allclose(fast.std, exact.std, rtol=0.01)
