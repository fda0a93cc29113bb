"""The peers of the page on integrators solve the pair's equations."""

from dataclasses import replace

import integrators
import pytest
from gear_pair import PERIOD_S, by_scipy, output, worst


@pytest.fixture(scope="module")
def cases():
    """Return the page's cases, cut short."""
    return {
        case.name: replace(case, problem=replace(case.problem, duration_s=3 * PERIOD_S)) for case in integrators.CASES
    }


@pytest.fixture(scope="module")
def expected(cases):
    """Return what scipy makes of them."""
    return {name: by_scipy(cases[name].problem, output(cases[name].rate_hz)) for name in ("smooth", "parting")}


@pytest.mark.parametrize(
    ("name", "method", "steps", "tolerance"),
    [
        ("smooth", "Dormand-Prince 8", 1, 1e-7),
        ("parting", "Newmark 1/4", 32, 0.05),
    ],
)
def test_peers_solve_the_equations_of_the_pair(cases, expected, name, method, steps, tolerance):
    assert worst(cases[name].read_by(method, steps), expected[name]) < tolerance
