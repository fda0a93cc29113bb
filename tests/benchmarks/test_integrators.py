"""The page on integrators: its peers solve the pair's equations, and the page and its picture are written."""

from dataclasses import replace

import integrators
import numpy as np
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
    return {
        name: by_scipy(cases[name].problem, output(cases[name].rate_hz))
        for name in ("rectangular", "smooth", "parting")
    }


@pytest.mark.parametrize(
    ("name", "method", "steps", "tolerance"),
    [
        ("rectangular", "RK4, aligned", 4, 1e-6),
        ("smooth", "Dormand-Prince 8", 1, 1e-7),
        ("smooth", "generalised alpha 0.8", 32, 1e-3),
        ("parting", "Newmark 1/4", 32, 0.05),
    ],
)
def test_peers_solve_the_equations_of_the_pair(cases, expected, name, method, steps, tolerance):
    assert worst(cases[name].read_by(method, steps), expected[name]) < tolerance


def test_the_page_is_written(cases, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(integrators, "CASES", tuple(cases.values()))
    monkeypatch.setattr(integrators, "OSCILLATIONS", 20)
    monkeypatch.setattr(integrators, "REPEATS", 1)
    monkeypatch.setattr(integrators, "SLOW_S", 1e-3)
    assert integrators.main(tmp_path) == 0
    page = (tmp_path / "integrators.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == page.strip()
    for title in (*(case.title for case in integrators.CASES), "Energy"):
        assert f"## {title}\n" in page
    rows = [line for line in page.splitlines() if line.startswith("| splitting")]
    errors = [float(row.split(" | ")[3].strip(" |")) for row in rows[:4]]
    assert max(errors) < 1e-4
    assert np.isfinite(errors).all()
    assert (tmp_path / "integrators.svg").read_text(encoding="utf-8").count("<svg") == 1
