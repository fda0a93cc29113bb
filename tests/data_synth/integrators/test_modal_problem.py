"""What integrators are made of: tables of periodic functions, modes."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from gear_pair import DIRECTION, MASSES, MEAN, pair, rectangle, ten_harmonics
from numpy.polynomial import legendre as polynomials
from scipy import linalg

from data_synth.dynamics.modes import undamped_modes
from data_synth.dynamics.system import System
from data_synth.integrators._periodic_kernels import (
    integrals_at,
    legendre,
    legendre_of_product,
    value_at,
)
from data_synth.integrators.periodic_tables import tabulated


@dataclass(frozen=True)
class Curve:
    """A function of phase, its period and its jumps."""

    value: Callable
    period: int = 1
    jumps: tuple[float, ...] = ()

    def __call__(self, phase):
        return self.value(phase)


CURVES = {
    "smooth": Curve(ten_harmonics()),
    "rectangle": Curve(rectangle(), 1, (0.0, 0.4)),
    "three cycles": Curve(lambda p: ten_harmonics()(p / 3) + rectangle()(p), 3, (0.0, 0.4, 1.0, 1.4, 2.0, 2.4)),
}
INTERVALS = [
    (5.1, 5.15),
    (5.3, 5.9),
    (0.95, 2.5),
    (-3.7, -3.2),
    (0.3995, 0.4005),  # shorter than what integrals are used for, over a jump
    (2.9999, 3.0005),  # over the end of a period
    (3.0005, 2.9999),  # backwards
    (5.9, 5.3),
    (0.2, 0.2001),
]


def by_quadrature(curves, interval):
    """Legendre coefficients of a product of functions over a interval of phase."""
    (start, stop), (low, high) = interval, sorted(interval)
    jumps = {j + curve.period * cycle for curve in curves for j in curve.jumps for cycle in range(-5, 7)}
    edges = [low, *sorted(j for j in jumps if low < j < high), high]
    nodes, weights = polynomials.leggauss(60)
    found = np.zeros(3)
    for a, b in pairwise(edges):
        at = (a + b) / 2 + (b - a) / 2 * nodes
        rows = polynomials.legvander(2 * (at - start) / (stop - start) - 1, 2)
        values = np.prod([curve(at) for curve in curves], axis=0)
        found += (b - a) / 2 / (high - low) * (weights * values) @ rows * (1, 3, 5)
    return found


class TestTables:
    @pytest.mark.parametrize("name", CURVES)
    def test_values(self, name):
        curve, at = CURVES[name], np.linspace(-4.0123, 6.0321, 397)
        table = tabulated([CURVES["smooth"], curve])
        found = [value_at(table, 1, p) for p in at]
        # cells are halved until the polynomial of degree five fits to 1e-11 of the largest value
        np.testing.assert_allclose(found, curve(at), rtol=1e-10)

    @pytest.mark.parametrize("interval", INTERVALS)
    @pytest.mark.parametrize("name", CURVES)
    def test_moments_by_quadrature(self, name, interval):
        curve, (start, stop) = CURVES[name], interval
        wanted, table = by_quadrature([curve], interval), tabulated([curve])
        found = legendre(table, 0, start, stop, integrals_at(table, 0, start), integrals_at(table, 0, stop))
        # differences of integrals over a interval d lose eps / d^2
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * MEAN)

    @pytest.mark.parametrize("interval", INTERVALS)
    @pytest.mark.parametrize("name", CURVES)
    def test_moments_of_a_product_by_quadrature(self, name, interval):
        saw, smooth = Curve(lambda p: np.mod(p, 2) - 0.3, 2, (0.0,)), CURVES["smooth"]
        tables, other = tabulated([smooth, CURVES[name]]), tabulated([saw], integrals=False)
        found = legendre_of_product(tables, 1, other, 0, *interval)
        wanted = by_quadrature([CURVES[name], saw], interval)
        # Gauss's rule of four points, over an eighth of a cycle of ten harmonics or less
        np.testing.assert_allclose(found, wanted, rtol=0, atol=(1e-10 if name == "rectangle" else 2e-3) * MEAN)


def digits_of(bearings):
    """Natural frequencies of the gear pair in 50 digits."""
    with mpmath.workdps(50):
        g = mpmath.matrix([mpmath.mpf(x) for x in DIRECTION])
        k = mpmath.diag([mpmath.mpf(bearings), 0, mpmath.mpf(bearings), 0]) + MEAN * g * g.T
        d = mpmath.diag([1 / mpmath.sqrt(mpmath.mpf(m)) for m in MASSES])
        squares = sorted(mpmath.eigsy(d * k * d, eigvals_only=True))
        return np.array([float(mpmath.sqrt(abs(s))) for s in squares[1:]])


class TestModes:
    @pytest.mark.parametrize("bearings", [1e8, 1e12, 1e16])
    def test_every_frequency_has_all_its_digits(self, bearings):
        angular, shapes = undamped_modes(pair(rectangle(), bearings=bearings), [MEAN])
        assert angular[0] == 0  # the rigid mode, exactly
        np.testing.assert_allclose(angular[1:], digits_of(bearings), rtol=2e-15)
        np.testing.assert_allclose(shapes.T @ np.diag(MASSES) @ shapes, np.eye(4), atol=1e-14)

    def test_a_full_mass_matrix(self):
        rng = np.random.default_rng(1)
        a, b = rng.standard_normal((2, 6, 6))
        mass, stiffness = a @ a.T + np.eye(6), b @ b.T
        system = System(mass=mass, damping=0 * mass, stiffness=stiffness, meshes=(), names=("x",) * 6)
        wanted = np.sqrt(linalg.eigh(stiffness, mass, eigvals_only=True))
        np.testing.assert_allclose(undamped_modes(system, [])[0], wanted, rtol=1e-9)  # of scipy's own error

    def test_nothing_but_rigid_modes(self):
        mass = np.diag([2.0, 8.0])
        system = System(mass=mass, damping=0 * mass, stiffness=0 * mass, meshes=(), names=("x",) * 2)
        angular, shapes = undamped_modes(system, [])
        assert not angular.any()
        np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(2), atol=1e-15)
