"""The compiled tracker against the same model on filterpy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import harmonic_model, track_orders


@pytest.mark.parametrize("poles", [1, 2, 3])
@pytest.mark.parametrize("shafts", [1, 2])
def test_the_matrices_step_by_step_on_filterpy_are_the_causal_filter(poles, shafts):
    """Three orders on a speed that drifts, their bandwidth too; the filter has the mean as an order of its own."""
    n = np.arange(300)
    phase = 2 * np.pi * (0.02 * n + 0.2 * np.sin(np.pi * n / n.size))
    x = sum(np.cos(order * phase + order) for order in (2.5, 7, 11.5)) + np.random.default_rng(poles).standard_normal(
        300
    )
    phase_rad, orders = (phase, [2.5, 7, 11.5]) if shafts == 1 else (
        {"sun": phase, "planet": phase / 2}, [("sun", 2.5), ("planet", 14), ("sun", 11.5)]
    )  # fmt: skip
    settings = {
        "phase_rad": phase_rad,
        "bandwidth_hz": np.linspace(1, 3, 300)[None],
        "rate_hz": 1000.0,
        "poles": poles,
        "noise_variance": 0.01,
        "initial_std": 1.0,
    }
    model = harmonic_model(orders=[*orders, 0.0 if shafts == 1 else ("sun", 0.0)], **settings)
    kalman, found = model.as_filterpy(), []
    for k, value in enumerate(x):
        kalman.update(value, H=model.H(k))
        found.append(model.amplitude(kalman.x[:, 0])[:, 0])
        kalman.predict(Q=model.Q(k))
    tracks = track_orders(x, orders=orders, **settings, estimator="filter", method="exact")
    assert_allclose(np.transpose(found)[:-1], tracks.complex_amplitude, atol=1e-11)
