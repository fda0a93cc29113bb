"""The compiled tracker against the same model on filterpy, and against least squares on all unknowns at once."""

from math import comb

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import harmonic_model, process_variance, track_orders

# Samples, orders, poles: ten problems, many small ones for the corners and one as large as filterpy allows.
PROBLEMS = [
    (300, 1, 1),
    (400, 1, 2),
    (600, 2, 1),
    (500, 2, 2),
    (900, 3, 1),
    (700, 4, 2),
    (1200, 5, 1),
    (600, 6, 2),
    (1500, 8, 1),
    (2500, 10, 1),
]


def problem(samples, orders, poles, *, two_shafts=False):
    """Return a record with gaps, and settings: lines at least five bandwidths apart on a speed that drifts."""
    rng = np.random.default_rng([samples, orders, poles])
    n = np.arange(samples)
    phase = 2 * np.pi * (0.02 * n + 0.002 * samples / np.pi * np.sin(np.pi * n / samples))
    ratios = np.sort(rng.choice(np.arange(2, 40), size=orders, replace=False)) / 2
    amplitude = rng.uniform(0.3, 1, orders)[:, None] * np.exp(2j * np.pi * rng.uniform(size=(orders, 1)))
    amplitude = amplitude * (1 + 0.3 * np.sin(2 * np.pi * n / samples * rng.uniform(1, 4, (orders, 1))))
    x = np.sum(amplitude * np.exp(1j * ratios[:, None] * phase), axis=0).real + 0.1 * rng.standard_normal(samples)
    x[rng.choice(samples, size=samples // 20, replace=False)] = np.nan
    x[samples // 2 : samples // 2 + 40] = np.nan
    names = rng.choice(["sun", "planet"], size=orders)
    settings = {
        "phase_rad": {"sun": phase, "planet": phase / 2} if two_shafts else phase,
        "orders": [(str(s), o if s == "sun" else 2 * o) for s, o in zip(names, ratios, strict=True)]
        if two_shafts
        else list(ratios),
        "bandwidth_hz": rng.uniform(1, 2, orders),
        "rate_hz": 1000.0,
        "poles": poles,
        "noise_variance": 0.01,
        "initial_std": 1.0,
    }
    return x, settings


def by_filterpy(x, settings, estimator):
    """Return the amplitudes, their std, and the innovations with their variances, of filterpy step by step."""
    model, samples = harmonic_model(**settings), x.size
    kalman, levels = model.as_filterpy(), len(model.F) // settings["poles"]
    rows = np.stack([model.H(n) for n in range(samples)])
    # batch_filter predicts before each update: the first transition is the identity without process noise
    steps = {
        "Fs": [np.eye(len(model.F))] + [model.F] * (samples - 1),
        "Qs": [0 * model.F] + [model.Q(n) for n in range(samples - 1)],
    }
    data = [None if np.isnan(value) else np.array([[value]]) for value in x]
    mean, covariance, _, _ = kalman.batch_filter(data, Hs=list(rows), **steps)
    if estimator == "smoother":
        mean, covariance, _, _ = kalman.rts_smoother(mean, covariance, **steps)
    squares, turning = np.diagonal(covariance, axis1=1, axis2=2)[:, :levels].T, levels // 2
    std = np.sqrt(0.5 * (squares[:turning] + squares[-turning:]))  # of the orders above 0
    return model.amplitude(mean[:, :, 0])[:turning], std


def with_mean(settings):
    """The filter has the mean as an order of its own, as slow as the slowest one."""
    width, first = np.asarray(settings["bandwidth_hz"]), settings["orders"][0]
    mean = 0.0 if isinstance(first, float) else (first[0], 0.0)
    more = {} if width.ndim == 2 else {"bandwidth_hz": np.append(width, width.min())}
    return settings | {"orders": [*settings["orders"], mean]} | more


@pytest.mark.parametrize(("samples", "orders", "poles"), PROBLEMS)
@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_exact_is_the_reference(samples, orders, poles, estimator):
    x, settings = problem(samples, orders, poles, two_shafts=orders % 2 == 0)
    exact = track_orders(x, method="exact", estimator=estimator, **settings)
    amplitude, std = by_filterpy(x, settings if estimator == "smoother" else with_mean(settings), estimator)
    off = np.abs(exact.complex_amplitude - amplitude)
    if estimator == "smoother":
        # What short blocks may cost.
        assert np.sqrt(np.mean((off / std) ** 2)) < 3e-3
        assert_allclose(exact.std, std, rtol=2e-3)
    else:
        # Rounding: the prior is 100 times the noise and the smoothed variance 1e-3 of it, so filterpy's smoother,
        # which subtracts one from the other, keeps ten digits of it; of the amplitudes fewer are lost.
        assert np.max(off) < 1e-10 * np.abs(amplitude).max()
        assert_allclose(exact.std, std, rtol=1e-8)


def stacked(x, phases, orders, q, prior_variance, poles, noise_variance):
    """Return the posterior mean and covariance of all levels, (sample * column,), by least squares.

    The unknowns are the initial differences and every increment; level n is their sum with binomial weights
    (Newton's backward formula), so no recursion is shared with the tracker.
    """
    n = x.size
    columns = [np.cos(o * p) for o, p in zip(orders, phases, strict=True)]
    columns += [-np.sin(o * p) for o, p in zip(orders, phases, strict=True) if o]
    q = np.concatenate([q, [v for v, o in zip(q, orders, strict=True) if o]])
    prior = np.concatenate([prior_variance, [v for v, o in zip(prior_variance, orders, strict=True) if o]])
    start = np.array([[comb(i + k - 1, k) if i + k else 1 for k in range(poles)] for i in range(n)])
    later = np.array([[comb(i - j + poles - 1, poles - 1) if j <= i else 0 for j in range(1, n)] for i in range(n)])
    levels = np.zeros((n, len(columns), len(columns), poles + n - 1))
    for c in range(len(columns)):
        levels[:, c, c] = np.hstack([start * np.sqrt(prior[c]), later * np.sqrt(q[c])])
    levels = levels.reshape(n * len(columns), -1)
    seen = np.einsum("cn,ncu->nu", columns, levels.reshape(n, len(columns), -1))
    observed = ~np.isnan(x)
    design = np.vstack([np.eye(levels.shape[1]), seen[observed] / np.sqrt(noise_variance)])
    data = np.concatenate([np.zeros(levels.shape[1]), x[observed] / np.sqrt(noise_variance)])
    unknowns = np.linalg.lstsq(design, data)[0]
    triangle = np.linalg.qr(design, mode="r")
    return levels @ unknowns, np.sum(np.linalg.solve(triangle.T, levels.T) ** 2, axis=0)


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("orders", [[1.0], [0.0, 1.0, 2.5]])
def test_exact_is_least_squares(poles, orders):
    rng = np.random.default_rng(poles)
    n = 60
    phase = 2 * np.pi * 0.11 * np.arange(n) + 0.3
    x = np.cos(phase + 0.5) + 0.3 + 0.2 * rng.standard_normal(n)
    x[[0, 7, 8, 30, 31, 32, 59]] = np.nan
    bandwidth, noise, std = 0.02, 0.04, 5.0
    tracks = track_orders(
        x,
        phase_rad=phase,
        orders=orders,
        bandwidth_hz=bandwidth,
        rate_hz=1.0,
        poles=poles,
        noise_variance=noise,
        initial_std=std,
    )
    q = process_variance(orders=orders, bandwidth=bandwidth, rate=1.0, poles=poles, noise_variance=noise)
    prior = std**2 * (2 * np.pi * bandwidth) ** (2 * np.arange(poles)) * np.ones((len(orders), poles))
    levels, variances = stacked(x, [phase] * len(orders), orders, q, prior, poles, noise)
    levels, variances = levels.reshape(n, -1), variances.reshape(n, -1)
    turning = [k for k, o in enumerate(orders) if o]
    amplitude = levels[:, : len(orders)].T.astype(complex)
    amplitude[turning] += 1j * levels[:, len(orders) :].T
    variance = variances[:, : len(orders)].T.copy()
    variance[turning] = (variance[turning] + variances[:, len(orders) :].T) / 2
    # The stacked matrix has condition numbers up to 1e5 (four poles).
    assert_allclose(tracks.complex_amplitude, amplitude, atol=1e-9)
    assert_allclose(tracks.std, np.sqrt(variance), rtol=1e-8)


@pytest.mark.parametrize("poles", [1, 3])
def test_filter_is_least_squares_on_the_past(poles):
    rng = np.random.default_rng(0)
    phase = 2 * np.pi * 0.17 * np.arange(50)
    x = np.cos(phase) + 0.1 * rng.standard_normal(50)
    x[20] = np.nan
    settings = {"orders": [1, 0], "bandwidth_hz": 0.05, "rate_hz": 1.0, "poles": poles, "noise_variance": 0.01}
    filtered = track_orders(x, phase_rad=phase, estimator="filter", **settings)
    for n in (1, 2, 20, 21, 49):
        past = track_orders(x[: n + 1], phase_rad=phase[: n + 1], **settings)
        # The smoother's last output knows what the filter knows there, and was checked above; prior 1e6.
        assert_allclose(filtered.complex_amplitude[:, n], past.complex_amplitude[:, n], atol=1e-8)
        assert_allclose(filtered.std[:, n], past.std[:, n], rtol=1e-7)


def test_unresolved_orders_of_a_slow_shaft_keep_their_digits():
    """Over a seventh of a turn orders 1 to 3 and the mean are open: where smoothers that subtract go negative."""
    n = 700
    phase = 2 * np.pi * 2e-4 * np.arange(n)
    rng = np.random.default_rng(0)
    x = 10 * np.cos(phase) + rng.standard_normal(n)
    settings = {"orders": [0, 1, 2, 3], "bandwidth_hz": 1e-5, "rate_hz": 1.0, "noise_variance": 1.0}
    tracks = track_orders(x, phase_rad=phase, initial_std=1e3, **settings)
    design = np.column_stack([np.cos(k * phase) for k in range(4)] + [-np.sin(k * phase) for k in range(1, 4)])
    # So narrow a bandwidth makes the amplitudes constants: ridge regression with the prior.
    root = np.linalg.qr(np.vstack([design, 1e-3 * np.eye(7)]), mode="r")
    covariance = np.linalg.inv(root.T @ root)
    # Over 700 samples the walk adds 700 q = 3e-6 to variances of 10 and more.
    std = np.sqrt(np.diagonal(covariance))
    expected = np.concatenate([std[:1], np.sqrt((std[1:4] ** 2 + std[4:] ** 2) / 2)])
    assert_allclose(tracks.std[:, n // 2], expected, rtol=1e-4)


def test_outputs_are_a_subset():
    x, settings = problem(1100, 3, 2)
    full = track_orders(x, method="exact", **settings)
    few = track_orders(x, method="exact", output_every=37, **settings)
    assert_allclose(few.sample_index, np.arange(0, 1100, 37))
    # The same nodes; only the outputs between them differ.
    assert_allclose(few.complex_amplitude, full.complex_amplitude[:, ::37], rtol=1e-11)
    assert_allclose(few.std, full.std[:, ::37], rtol=1e-11)


@pytest.mark.parametrize("poles", [1, 2, 3])
def test_the_matrices_step_by_step_on_filterpy_are_the_causal_filter(poles):
    x, settings = problem(300, 3, poles)
    x = np.nan_to_num(x)
    settings |= {"bandwidth_hz": np.linspace(1, 3, 300)[None]}
    model = harmonic_model(**with_mean(settings))
    kalman, found = model.as_filterpy(), []
    for n, value in enumerate(x):
        kalman.update(value, H=model.H(n))
        found.append(model.amplitude(kalman.x[:, 0])[:, 0])
        kalman.predict(Q=model.Q(n))
    tracks = track_orders(x, **settings, estimator="filter", method="exact")
    assert_allclose(np.transpose(found)[:-1], tracks.complex_amplitude, atol=1e-11)


def test_the_state_of_the_matrices_makes_the_record():
    """A state with levels and differences: y[n] = H[n] x[n] is Re sum Z exp(j order phase) of its amplitudes."""
    phase = 0.3 * np.arange(40)
    model = harmonic_model(
        phase_rad=phase, orders=[0, 2.5], bandwidth_hz=0.1, rate_hz=1, noise_variance=4.0, initial_std=3.0, poles=2
    )
    state, measured, rebuilt = np.random.default_rng(0).standard_normal(6), [], []
    for n in range(40):
        measured.append((model.H(n) @ state)[0])
        mean, z = model.amplitude(state)[:, 0]
        rebuilt.append(mean.real + (z * np.exp(2.5j * phase[n])).real)
        state = model.F @ state
    assert_allclose(measured, rebuilt, atol=1e-12)
    assert_allclose(np.diag(model.P0)[:3], 9.0)
    assert model.R == 4.0
