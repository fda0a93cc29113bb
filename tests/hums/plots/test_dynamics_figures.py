"""Figures of dynamics: what is drawn is what was computed."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.testing import assert_allclose

from hums.plots import (
    plot_campbell,
    plot_mode_shape,
    plot_stability_map,
)


def axes():
    return Figure(figsize=(6, 4), layout="constrained").add_subplot()


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


def test_a_mode_s_bars_are_its_shape_over_the_largest_of_each_kind():
    ax = plot_mode_shape(MODES, 1, ax=axes())
    widths = {round(bar.get_y() + bar.get_height() / 2): bar.get_width() for bar in ax.patches}
    assert widths == pytest.approx({0: 1.0, 1: -1 / 3, 2: 1.0})
    assert ax.get_title(loc="left") == "mode 2: 120 Hz, mixed"
    ax = plot_mode_shape(MODES, 1, ax=axes(), energy={"sun": 0.75, "ring": 0.25})
    assert ax.get_title(loc="left") == "mode 2: 120 Hz, mixed\nsun 75%, ring 25%"
    # rounding beside a rotation is nothing
    ax = plot_mode_shape(MODES, 2, ax=axes())
    assert sorted(bar.get_width() for bar in ax.patches) == pytest.approx([-1.0, 0.0, 0.5])


def test_mesh_orders_are_rays():
    speeds = np.linspace(0, 200, 5)
    diagram = Diagram(speeds_rad_s=speeds, frequencies_hz=np.outer(np.ones(5), [0.0, 300.0]), orders=(20.0,))
    ax = plot_campbell(diagram, ax=axes(), harmonics=2)
    rays = [line for line in ax.lines if line.get_linestyle() != "-"]
    assert len(rays) == 2
    for ray, order in zip(rays, (20, 40), strict=True):
        assert_allclose(ray.get_ydata(), order * speeds / (2 * np.pi))
        assert_allclose(ray.get_xdata(), speeds * 30 / np.pi)  # rpm
    assert {text.get_text() for text in ax.texts} == {"order 20", "order 40", "mode 2, 300 Hz"}
    assert len(ax.lines) == 3  # what does not swing has no line


def test_names_of_a_campbell_diagram_do_not_overlap():
    frequencies = np.outer(np.ones(3), [0.0, 500.0, 501.0, 502.0, 660.0])
    diagram = Diagram(speeds_rad_s=np.linspace(0, 200, 3), frequencies_hz=frequencies, orders=(15.7, 15.8, 20.0))
    ax = plot_campbell(diagram, ax=axes())
    ax.figure.draw_without_rendering()
    heights = sorted(Text.get_window_extent(text).intervaly.tolist() for text in ax.texts)
    assert len(heights) == 7
    assert all(below[1] <= above[0] + 0.5 for below, above in pairwise(heights))
    assert max(Text.get_window_extent(text).x1 for text in ax.texts) <= ax.figure.bbox.x1


def test_a_map_shows_where_motion_grows():
    grid = Grid(
        speeds_rad_s=np.array([1.0, 2.0]), parameters=np.array([0.1, 0.2]), growth=np.array([[1.0, 1.2], [1.0, 1.0]])
    )
    ax = plot_stability_map(grid, ax=axes(), parameter="damping ratio")
    (mesh,) = ax.collections
    shown = np.ma.masked_invalid(mesh.get_array()).reshape(2, 2)
    assert shown.mask.tolist() == [[True, False], [True, True]]
    assert shown[0, 1] == pytest.approx(0.2)
    assert_allclose(ax.get_xlim(), [30 / np.pi, 60 / np.pi])  # rpm
    assert ax.get_ylabel() == "damping ratio"
    one = plot_stability_map(Grid(grid.speeds_rad_s, np.zeros(1), grid.growth[:1]), ax=axes())
    assert_allclose(one.lines[0].get_ydata(), [1.0, 1.2])
