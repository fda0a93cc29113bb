"""Bandwidth and process variance: the variance of a bandwidth, and what the smoother really passes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import track_orders


def passed(offset, *, order, poles, bandwidth, method="exact"):
    """Return the gain for an envelope that rotates by `offset` cycles a sample, in the middle of a record."""
    n = np.arange(int(16 / bandwidth))
    phase = 2 * np.pi * 0.1713 * n
    x = np.cos(order * phase + 2 * np.pi * offset * n)
    tracks = track_orders(
        x, phase_rad=phase, orders=[order], bandwidth_hz=bandwidth, rate_hz=1.0, poles=poles, method=method
    )
    middle = slice(int(6 / bandwidth), int(6 / bandwidth) + round(2 / abs(offset)))  # two turns of the envelope
    turned = np.exp(-2j * np.pi * offset * n[middle])
    if order == 0:
        # The mean follows the real envelope cos: its gain is the projection on it.
        return 2 * np.mean(tracks.complex_amplitude[0, middle] * turned).real
    return np.abs(np.mean(tracks.complex_amplitude[0, middle] * turned))


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize(
    ("side", "order", "method"), [(1, 1, "exact"), (-1, 1, "exact"), (1, 0, "exact"), (1, 1, "fast")]
)
def test_smoother_is_3_db_down_at_half_the_bandwidth(poles, side, order, method):
    bandwidth = 0.004
    inner, outer = (
        passed(side * share * bandwidth / 2, order=order, poles=poles, bandwidth=bandwidth, method=method)
        for share in (0.99, 1.01)
    )
    assert outer < 1 / np.sqrt(2) < inner


def test_each_order_has_its_own_bandwidth():
    rng = np.random.default_rng(0)
    phase = 2 * np.pi * 0.05 * np.arange(4000)
    x = rng.standard_normal(4000)
    settings = {"phase_rad": phase, "rate_hz": 1.0, "noise_variance": 1.0}
    both = track_orders(x, orders=[1, 4], bandwidth_hz=[0.001, 0.004], **settings)
    for k, (order, bandwidth) in enumerate([(1, 0.001), (4, 0.004)]):
        alone = track_orders(x, orders=[order], bandwidth_hz=bandwidth, **settings)
        # Far apart they hardly notice each other.
        middle = slice(1000, 3000)
        assert_allclose(both.std[k, middle], alone.std[0, middle], rtol=1e-3)
