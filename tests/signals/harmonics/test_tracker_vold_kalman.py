"""The smoother against the least-squares problem that defines the Vold-Kalman filter, solved by scipy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import block_array, block_diag, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.tracker import track_orders

SAMPLES = 700
N = np.arange(SAMPLES)
PHASE = 2 * np.pi * (0.05 * N + 4e-5 * N**2)
ORDERS = [1, 1.4, 3]


def record():
    rng = np.random.default_rng(8)
    x = 2 * np.cos(PHASE + np.sin(N / 100)) + np.cos(1.4 * PHASE) + (1 + N / SAMPLES) * np.cos(3 * PHASE + 1)
    return x + 0.2 * rng.standard_normal(SAMPLES)


def vold_kalman(x, orders, weights, poles):
    """Return the complex amplitudes of the exact smoother with these weights."""
    widths = [Bandwidth.from_weight(weight, poles=poles).width for weight in weights]
    settings = {"phase_rad": PHASE, "orders": orders, "bandwidth_hz": widths, "rate_hz": 1.0, "poles": poles}
    return track_orders(x, **settings, method="exact").complex_amplitude


def differences(poles):
    """`poles`-th differences of SAMPLES numbers."""
    matrix = eye_array(SAMPLES, format="csr")
    for _ in range(poles):
        matrix = matrix[1:] - matrix[:-1]
    return matrix


def real_problem(x, weights, poles, means=()):
    """Minimise `sum (r^2 / 2) |D Z|^2 + sum (x - sum Re{Z exp(j order phase)})^2` over real and imaginary parts.

    The half: a quadrature has half of each sample's cosine squared, while a mean (order 0) has all of it.
    """
    columns = [diags_array(np.ones(SAMPLES)) for _ in means]
    penalties = [r**2 for r in means]
    for order, r in zip(ORDERS, weights, strict=True):
        columns += [diags_array(np.cos(order * PHASE)), diags_array(-np.sin(order * PHASE))]
        penalties += [r**2 / 2] * 2
    A = block_array([columns], format="csr")
    D = differences(poles)
    matrix = block_diag([penalty * (D.T @ D) for penalty in penalties]) + A.T @ A
    levels = spsolve(matrix.tocsc(), A.T @ x).reshape(-1, SAMPLES)
    return levels[: len(means)], levels[len(means) :: 2] + 1j * levels[len(means) + 1 :: 2]


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
def test_smoother_is_the_least_squares_solution(poles):
    weights = np.array([Bandwidth(width=width, poles=poles).weight for width in (0.03, 0.04, 0.05)])
    error = np.abs(vold_kalman(record(), ORDERS, weights, poles) - real_problem(record(), weights, poles)[1])
    # Scipy's matrix has a condition of 4^4 r^2 = 2e10 at most, so six digits. It has no prior, the smoother one of 1000
    # standard deviations of the noise for levels and differences: a few 1e-6 of amplitudes ten times the noise at the
    # ends, some ten times that for every pole that extrapolates; inwards it decays, with four poles to 2e-6 in 200
    # samples, some six times 1 / bandwidth.
    assert error[:, 200:-200].max() < 1e-5
    assert error.max() < 1e-3


def test_the_mean_takes_the_weight_as_it_is():
    weight = Bandwidth(width=0.01, poles=2).weight
    x = record() + 3
    amplitude = vold_kalman(x, [0, *ORDERS], [weight] * 4, 2)
    (mean,), others = real_problem(x, [weight] * 3, 2, means=[weight])
    assert_allclose(amplitude[0], mean, atol=1e-4)  # the prior, as above
    assert_allclose(amplitude[1:], others, atol=1e-4)
