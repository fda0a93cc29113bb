"""The sample-by-sample filter and smoother where doubles alone would lose their digits, against 60-digit arithmetic."""

import timeit
from dataclasses import dataclass
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jobs import standard_job
from numpy.testing import assert_allclose

from signals.harmonics import process_variance, smoother_bandwidth, track_orders
from signals.harmonics._chain import Chain, Tally, filter_chain, smooth_chain, survey

exact_number = np.vectorize(Decimal, otypes=[object])


@dataclass
class Problem:
    """Noise of unit variance; rows (sample, column), x and q (sample,) or (1, column), prior (pole, column)."""

    rows: np.ndarray
    x: np.ndarray
    q: np.ndarray
    prior: np.ndarray

    def chain(self, every=1, memory=1e4):
        wanted = np.zeros(self.x.size, dtype=bool)
        wanted[::every] = True
        return Chain(
            measurements=lambda span: (self.rows[span, None, :], self.x[span, None, None]),
            walk_variance=lambda span: self.q[span] if len(self.q) > 1 else self.q,
            prior_variance=self.prior,
            wanted=wanted,
            memory=memory,
        )

    def oracle(self, outputs):
        """Filtered and smoothed levels and standard deviations at the outputs, by textbook recursions."""
        with localcontext() as context:
            context.prec = 60
            return self._oracle(set(outputs))

    def _oracle(self, outputs):
        poles, columns = self.prior.shape
        size = poles * columns
        rows, q = exact_number(self.rows), exact_number(self.q)
        mean = exact_number(np.zeros(size))
        covariance = exact_number(np.diag(self.prior.ravel()))
        history, filtered = [], {}
        for n, x in enumerate(self.x):
            h = rows[n]
            predicted = (mean, covariance) if n in outputs else None
            gain, innovation = None, None
            if not np.isnan(x):
                gain = covariance[:, :columns] @ h
                variance = 1 + h @ gain[:columns]
                innovation = (Decimal(x) - h @ mean[:columns]) / variance
                mean = mean + gain * innovation
                covariance = covariance - gain[:, None] * (gain / variance)
                gain = gain / variance
                history.append((h, gain, innovation, variance, predicted))
            else:
                history.append((h, None, None, None, predicted))
            if n in outputs:
                filtered[n] = mean[:columns], np.diagonal(covariance)[:columns]
            mean, covariance = mean.copy(), covariance.copy()
            for top in range((poles - 2) * columns, -1, -columns):
                to, by = slice(top, top + columns), slice(top + columns, top + 2 * columns)
                mean[to] = mean[to] + mean[by]
                covariance[to] = covariance[to] + covariance[by]
                covariance[:, to] = covariance[:, to] + covariance[:, by]
            for c in range(columns):
                covariance[c::columns, c::columns] += q[n if len(q) > 1 else 0, c]
        # Backward (de Jong): smoothed = predicted + P r, P - P N P. 60 digits bear the subtraction.
        r, information, smoothed = exact_number(np.zeros(size)), exact_number(np.zeros((size, size))), {}
        for n in range(self.x.size - 1, -1, -1):
            for top in range(0, (poles - 1) * columns, columns):
                to, by = slice(top + columns, top + 2 * columns), slice(top, top + columns)
                r[to] = r[to] + r[by]
                information[to] = information[to] + information[by]
                information[:, to] = information[:, to] + information[:, by]
            h, gain, innovation, variance, predicted = history[n]
            if gain is not None:
                back = information @ gain
                r[:columns] += h * (innovation - gain @ r)
                own = gain @ back + 1 / variance
                information[:columns] = information[:columns] - h[:, None] * back
                information[:, :columns] = information[:, :columns] - back[:, None] * h
                information[:columns, :columns] = information[:columns, :columns] + own * h[:, None] * h
            if predicted is not None:
                mean, covariance = predicted
                part = covariance[:columns]
                smoothed[n] = (
                    mean[:columns] + part @ r,
                    np.diagonal(covariance)[:columns] - np.array([row @ information @ row for row in part]),
                )
        return (
            [np.array([f[n][i] for n in sorted(outputs)], dtype=float) for i in (0, 1)] for f in (filtered, smoothed)
        )


def harmonics(phase, orders):
    angle = np.asarray(orders) * np.asarray(phase)[:, None]
    return np.concatenate([np.cos(angle), -np.sin(angle)], axis=1)


def check(problem, *, every, rtol=1e-6, memory=1e4, smoother=True):
    outputs = range(0, problem.x.size, every)
    filtered, smoothed = problem.oracle(outputs)
    for track, (levels, variances) in ((filter_chain, filtered), (smooth_chain, smoothed)):
        if track is smooth_chain and not smoother:
            continue
        found, found_variances, _ = track(problem.chain(every, memory), 0)
        assert np.all(found_variances > 0)
        assert_allclose(np.sqrt(found_variances), np.sqrt(variances), rtol=rtol)
        # A level is as good as it is large, or as it is sure.
        error = np.abs(found[0] - levels) / np.maximum(np.abs(levels), np.sqrt(variances))
        assert error.max() < rtol


AMPLITUDES = [1.0, 0.5, -0.7, 0.2]


def problem(*, poles, bandwidth, prior=1e6, samples=300, orders=(1.0, 2.3), phase=None):
    phase = 0.3 * np.arange(samples) if phase is None else phase
    rows = harmonics(phase, orders)
    x = rows @ np.resize(AMPLITUDES, rows.shape[1]) + np.random.default_rng(0).standard_normal(samples)
    q = process_variance(orders=orders, bandwidth=bandwidth, rate=1.0, poles=poles, noise_variance=1.0)
    differences = (2 * np.pi * bandwidth) ** (2 * np.arange(poles)[:, None])
    return Problem(rows, x, np.concatenate([q, q])[None], prior * differences * np.ones(rows.shape[1]))


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("prior", [1.0, 1e6, 1e12])
def test_wide_priors(poles, prior):
    check(problem(poles=poles, bandwidth=0.01, prior=prior), every=7)


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("bandwidth", [1e-4, 1e-7])
def test_narrow_bandwidths(poles, bandwidth):
    check(problem(poles=poles, bandwidth=bandwidth, samples=1500), every=50, memory=1 / bandwidth)


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("other", [1.0, 1.0 + 1e-7])
def test_orders_that_coincide(poles, other):
    case = problem(poles=poles, bandwidth=0.01, prior=1e12, orders=(1.0, other, 2.0))
    check(case, every=7)


def test_of_an_order_listed_twice_the_sum_is_known_and_the_difference_keeps_its_prior():
    case = problem(poles=1, bandwidth=0.01, prior=1e12, orders=(1.0, 1.0, 2.0))
    levels, variances, _ = smooth_chain(case.chain(), 0)
    # Drawn with 1.0 + 0.5, and known to a few tenths.
    assert abs(np.mean(levels[0, :, 0] + levels[0, :, 1]) - 1.5) < 0.5
    # Of (a + b, a - b) / sqrt(2) one is known; the other keeps 1e12, half of which each shows; its walk adds 1e-3.
    assert_allclose(variances[:, :2], 0.5e12, rtol=1e-9)


@pytest.mark.parametrize("poles", [1, 2])
def test_an_order_at_half_the_rate_keeps_the_prior_of_its_sine(poles):
    case = problem(poles=poles, bandwidth=0.01, orders=(1.0, 0.2), phase=np.pi * np.arange(300))
    check(case, every=7)
    assert np.all(filter_chain(case.chain(), 0)[1][:, 2] >= 1e6)


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_a_shaft_at_rest(poles):
    n = np.arange(900)
    phase = 0.3 * np.minimum(n, 200) + 0.3 * np.maximum(n - 700, 0)
    check(problem(poles=poles, bandwidth=0.01, samples=900, phase=phase), every=7, memory=100)


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_a_gap_of_thirty_memories(poles):
    case = problem(poles=poles, bandwidth=0.05, samples=900)
    case.x[100:700] = np.nan
    check(case, every=7, memory=20)


@pytest.mark.parametrize("prior", [1e6, 1e12])
def test_a_slow_shaft(prior):
    """A seventh of a turn: three orders, nothing resolved but their sum and a slope."""
    phase = 2 * np.pi * 2e-4 * np.arange(700)
    check(problem(poles=1, bandwidth=1e-5, prior=prior, samples=700, orders=(1, 2, 3.0), phase=phase), every=10)


def test_an_impulse():
    case = problem(poles=2, bandwidth=0.01)
    case.x[:] = 0.0
    case.x[150] = 1e6
    check(case, every=7)


@pytest.mark.parametrize("poles", [1, 3])
def test_nothing_but_missing_samples(poles):
    case = problem(poles=poles, bandwidth=0.01)
    case.x[:] = np.nan
    check(case, every=7)


def test_a_walk_far_below_the_noise():
    """q = 1e-12, R = 1e-8, P0 = 1, in units of the noise."""
    case = problem(poles=1, bandwidth=0.01, prior=1e8)
    case.q[:] = 1e-4
    check(case, every=7)


def test_a_bandwidth_that_varies():
    case = problem(poles=2, bandwidth=0.01)
    case.q = case.q * np.exp(3 * np.sin(np.arange(300) / 20))[:, None]
    check(case, every=7)


def test_ten_orders_from_a_prior_of_a_million_noises():
    """The start of the run-up, at half its rate: one turn and a fifth of a shaft with 20 quadratures."""
    t = np.arange(3000) / 25_000
    rows = harmonics(2 * np.pi * (10 * t + 0.75 * t**2), [1, 2, 3, 4.6, 7.1, 12.3, 20, 27, 36, 54])
    x = rows @ np.resize(AMPLITUDES, 20) + np.random.default_rng(1).standard_normal(3000)
    case = Problem(rows, x, np.full((1, 20), 2e-9), np.full((1, 20), 1e12))
    check(case, every=500, memory=1e5)


def sixty_digits(rows, x, q, prior):
    """(sample, column) filtered levels and standard deviations, of one pole in unit noise, by the textbook."""
    levels, deviations = np.empty(rows.shape), np.empty(rows.shape)
    with localcontext() as context:
        context.prec = 60
        count, walk = rows.shape[1], Decimal(q)
        mean, covariance = exact_number(np.zeros(count)), exact_number(prior * np.eye(count))
        for n, h in enumerate(exact_number(rows)):
            gain = covariance @ h
            variance = 1 + h @ gain
            mean = mean + gain * ((Decimal(x[n]) - h @ mean) / variance)
            covariance = covariance - gain[:, None] * (gain / variance)
            levels[n], deviations[n] = mean, np.sqrt(np.diagonal(covariance).astype(float))
            covariance[np.diag_indices(count)] += walk
    return levels, deviations


# As docs/trackers.md says it: how far the run-up's start is off, of an amplitude or of its std, whichever is larger.
@pytest.mark.parametrize(("initial_std", "rtol"), [(1e3, 1e-11), (1e6, 2e-8)])
def test_the_start_of_a_run_up_is_that_of_sixty_digits(initial_std, rtol):
    job = standard_job("J1 run-up", samples=3000)
    bandwidth = smoother_bandwidth(orders=[1.0], process_variance=[1e-9], rate=50_000, poles=1, noise_variance=1.0)[0]
    tracks = track_orders(
        **job.tracking(bandwidth), noise_variance=1.0, initial_std=initial_std, estimator="filter", method="exact"
    )
    levels, deviations = sixty_digits(harmonics(job.phase_rad, job.orders), job.x, 1e-9, initial_std**2)
    amplitude, std = levels[:, :10] + 1j * levels[:, 10:], np.hypot(deviations[:, :10], deviations[:, 10:]) / np.sqrt(2)
    assert_allclose(tracks.std, std.T, rtol=rtol)
    off = np.abs(tracks.complex_amplitude - amplitude.T) / np.maximum(np.abs(amplitude), std).T
    assert off.max() < rtol


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    poles=st.integers(1, 4),
    columns=st.integers(1, 5),
    bandwidth=st.floats(1e-7, 0.4),
    prior=st.floats(1e-3, 1e12),
    equal=st.booleans(),
)
def test_covariances_are_symmetric_and_positive(seed, poles, columns, bandwidth, prior, equal):
    rng = np.random.default_rng(seed)
    samples = 150
    rows = np.cos(rng.uniform(0, 3, columns) * np.arange(samples)[:, None])
    if equal:
        rows[:, -1] = rows[:, 0]
    x = np.where(rng.uniform(size=samples) < 0.2, np.nan, rng.standard_normal(samples))
    q = process_variance(orders=np.ones(columns), bandwidth=bandwidth, rate=1.0, poles=poles, noise_variance=1.0)
    differences = (2 * np.pi * bandwidth) ** (2 * np.arange(poles)[:, None])
    case = Problem(rows, x, q[None], prior * differences * np.ones(columns))
    chain = case.chain(memory=1 / bandwidth)
    state = chain.prior()
    for stop in range(10, samples, 10):
        part = Problem(rows[stop - 10 : stop], x[stop - 10 : stop], q[None], case.prior)
        survey(part.chain(memory=1 / bandwidth), state, Tally.empty(channels=1), 0)
        covariance = state.matrix.sum(axis=0)
        assert_allclose(covariance, covariance.T, rtol=1e-14, atol=0)
        seen = np.diagonal(covariance) > 0
        scale = np.sqrt(np.diagonal(covariance)[seen])
        eigenvalues = np.linalg.eigvalsh(covariance[np.ix_(seen, seen)] / np.outer(scale, scale))
        assert eigenvalues[0] >= -1e-12 * eigenvalues[-1]
    for track in (filter_chain, smooth_chain):
        assert np.all(track(chain, 0)[1] > 0)


def test_channels_share_a_covariance():
    case = problem(poles=2, bandwidth=0.01)
    x = np.stack([case.x, 3 * case.x, case.x[::-1]])
    x[:, 40:50] = np.nan
    wanted = np.ones(300, dtype=bool)
    chains = [
        Chain(
            measurements=lambda span, own=own: (case.rows[span, None, :], own[:, span].T[:, None, :]),
            walk_variance=case.q,
            prior_variance=case.prior,
            wanted=wanted,
            channels=len(own),
        )
        for own in (x, *x[:, None])
    ]
    for track in (filter_chain, smooth_chain):
        (together, variances, tally), *alone = (track(chain, 20) for chain in chains)
        for k, (levels, own_variances, own_tally) in enumerate(alone):
            # The same operations, channel by channel.
            assert_allclose(together[k], levels[0], rtol=1e-13, atol=1e-15)
            assert_allclose(variances, own_variances, rtol=1e-13)
            assert_allclose(tally.mean_square[k], own_tally.mean_square[0], rtol=1e-13)
            assert_allclose(tally.autocorrelation[k], own_tally.autocorrelation[0], rtol=1e-12, atol=1e-15)


def test_innovations_are_kept_and_correlated():
    """Against plain sums over the innovations that were kept."""
    case = problem(poles=1, bandwidth=0.01, samples=700)
    case.x[[30, 31, 400]] = np.nan
    _, _, tally = filter_chain(case.chain(), 100, keep=True)
    kept = np.concatenate(tally.kept)[:, 0, 0]
    assert kept.size == 700
    counted, seen = kept[100:], ~np.isnan(case.x[100:])
    assert tally.count == seen.sum()
    assert_allclose(tally.square[0], np.sum(counted**2), rtol=1e-12)
    for lag in (1, 2, 20):
        pairs = seen[lag:] & seen[:-lag]
        expected = np.sum(counted[lag:] * counted[:-lag]) / pairs.sum() / np.mean(counted[seen] ** 2)
        assert_allclose(tally.autocorrelation[0, lag - 1], expected, rtol=1e-10)


def test_several_rows_a_step_are_as_many_measurements():
    """Two samples measured in one step are two measurements of one amplitude: half the noise of one."""
    rng = np.random.default_rng(0)
    rows, data = np.ones((50, 2, 1)), rng.standard_normal((50, 2, 1))
    settings = {"walk_variance": np.array([0.01]), "prior_variance": np.array([[1e6]]), "wanted": np.ones(50, bool)}
    two = Chain(measurements=lambda span: (rows[span], data[span]), reach=1.0, **settings)
    mean, root = data.mean(axis=1, keepdims=True) * np.sqrt(2), np.full((50, 1, 1), np.sqrt(2))
    one = Chain(measurements=lambda span: (root[span], mean[span]), reach=2.0, **settings)
    for track in (filter_chain, smooth_chain):
        for found, expected in zip(track(two, 0)[:2], track(one, 0)[:2], strict=True):
            assert_allclose(found, expected, rtol=1e-11)


def test_a_step_costs_no_more_than_the_square_of_the_columns():
    """Sixteen times as many cost 256 times as much, not 4096."""
    times = []
    for columns in (8, 128):
        rng = np.random.default_rng(0)
        rows, x = rng.standard_normal((1000, columns)) / np.sqrt(columns), rng.standard_normal(1000)
        chain = Problem(rows, x, np.full((1, columns), 1e-3), np.ones((1, columns))).chain(every=500)
        smooth_chain(chain, 0)
        times.append(min(timeit.repeat(lambda chain=chain: smooth_chain(chain, 0), number=1, repeat=5)))
    # Measured: 73, since a call has costs of its own; a backward filter that took the cube had 1100.
    assert times[1] < 300 * times[0]
