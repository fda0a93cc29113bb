"""Figures of dynamics: what is drawn is what was computed."""

from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from hums.plots import (
    plot_campbell,
    plot_frequencies,
    plot_mesh_stiffness,
    plot_mode_shape,
    plot_stability_map,
)


def axes():
    return Figure(figsize=(6, 4), layout="constrained").add_subplot()


@dataclass(frozen=True)
class Step:
    """A stiffness of 3 N/um for the first half of a cycle, 1 N/um for the second."""

    mean: float = 2e6
    period: int = 1
    jumps: tuple[float, ...] = (0.0, 0.5)

    def __call__(self, phase_cycles):
        return np.where(np.remainder(phase_cycles, 1) < 0.5, 3e6, 1e6)


@dataclass(frozen=True)
class Shapes:
    frequencies_hz: np.ndarray
    shapes: np.ndarray
    kinds: tuple[str, ...]
    names: tuple[str, ...]


@dataclass(frozen=True)
class Diagram:
    speeds_rad_s: np.ndarray
    frequencies_hz: np.ndarray
    orders: tuple[float, ...]


@dataclass(frozen=True)
class Grid:
    speeds_rad_s: np.ndarray
    parameters: np.ndarray
    growth: np.ndarray


MODES = Shapes(
    frequencies_hz=np.array([0.0, 120.0, 450.0]),
    shapes=np.array([[0.0, 2.0, 1e-14], [0.5, -1.0, 0.25], [1.0, 3.0, -0.5]]),
    kinds=("rigid", "mixed", "rotational"),
    names=("sun x", "sun rotation", "ring rotation"),
)


def test_jumps_stand_upright():
    ax = plot_mesh_stiffness(Step(), ax=axes(), cycles=(0.0, 2.0))
    phase, value = ax.lines[0].get_data()
    falls = np.flatnonzero(np.abs(np.diff(value)) > 1)
    assert_allclose(phase[falls], [0.5, 1.0, 1.5], atol=1e-6)
    assert np.diff(phase)[falls].max() < 1e-8
    assert set(value) == {1.0, 3.0}
    assert_allclose(ax.lines[1].get_ydata(), 2.0)


def test_a_mode_s_bars_are_its_shape_over_the_largest_of_each_kind():
    ax = plot_mode_shape(MODES, 1, ax=axes())
    widths = {round(bar.get_y() + bar.get_height() / 2): bar.get_width() for bar in ax.patches}
    assert widths == pytest.approx({0: 1.0, 1: -1 / 3, 2: 1.0})
    assert ax.get_title(loc="left") == "120 Hz, mixed"
    # rounding beside a rotation is nothing
    ax = plot_mode_shape(MODES, 2, ax=axes())
    assert sorted(bar.get_width() for bar in ax.patches) == pytest.approx([-1.0, 0.0, 0.5])


def test_each_kind_of_mode_has_its_row():
    ax = plot_frequencies(MODES, ax=axes())
    assert [label.get_text() for label in ax.get_yticklabels()] == ["rigid", "rotational", "mixed"]
    drawn = [segment[0][0] for lines in ax.collections for segment in lines.get_segments()]
    assert_allclose(drawn, [0.0, 450.0, 120.0])


def test_mesh_orders_are_rays():
    speeds = np.linspace(0, 200, 5)
    diagram = Diagram(speeds_rad_s=speeds, frequencies_hz=np.outer(np.ones(5), [0.0, 300.0]), orders=(20.0,))
    ax = plot_campbell(diagram, ax=axes(), harmonics=2)
    rays = [line for line in ax.lines if line.get_linestyle() != "-"]
    assert len(rays) == 2
    for ray, order in zip(rays, (20, 40), strict=True):
        assert_allclose(ray.get_ydata(), order * speeds / (2 * np.pi))
    assert {text.get_text() for text in ax.texts} == {"20", "40"}
    assert np.isnan(ax.lines[0].get_ydata()).all()  # what does not swing has no line


def test_a_map_shows_where_motion_grows():
    grid = Grid(
        speeds_rad_s=np.array([1.0, 2.0]), parameters=np.array([0.1, 0.2]), growth=np.array([[1.0, 1.2], [1.0, 1.0]])
    )
    ax = plot_stability_map(grid, ax=axes(), cycles_per_rev=36, parameter="damping ratio")
    (mesh,) = ax.collections
    shown = np.ma.masked_invalid(mesh.get_array()).reshape(2, 2)
    assert shown.mask.tolist() == [[True, False], [True, True]]
    assert shown[0, 1] == pytest.approx(0.2)
    assert ax.get_xlim() == (36, 72)
    assert ax.get_ylabel() == "damping ratio"
    one = plot_stability_map(Grid(grid.speeds_rad_s, np.zeros(1), grid.growth[:1]), ax=axes())
    assert_allclose(one.lines[0].get_ydata(), [1.0, 1.2])
