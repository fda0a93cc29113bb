"""The compiled tracker against the same model on filterpy, and a slow shaft against ridge regression."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import harmonic_model, track_orders


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


def with_mean(settings):
    """The filter has the mean as an order of its own, as slow as the slowest one."""
    width, first = np.asarray(settings["bandwidth_hz"]), settings["orders"][0]
    mean = 0.0 if isinstance(first, float) else (first[0], 0.0)
    more = {} if width.ndim == 2 else {"bandwidth_hz": np.append(width, width.min())}
    return settings | {"orders": [*settings["orders"], mean]} | more


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
    x, settings = problem(300, 3, poles, two_shafts=poles == 2)
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
