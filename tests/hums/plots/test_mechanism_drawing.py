"""The drawn mechanism: parts in the colours asked for, names once each, none over another."""

import warnings
from itertools import combinations

import numpy as np
import pytest
from gearboxes import VARIED
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.text import Text

from hums.gearbox.defect_orders import defects
from hums.gearbox.layout import layout_of
from hums.gearbox.model import GearboxWarning, load_gearbox
from hums.plots import coloured_components, draw_mechanism


def figure(name, **words):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)
        gearbox = load_gearbox(name)
    return gearbox, draw_mechanism(gearbox, ax=Figure(figsize=(7, 5), layout="constrained").add_subplot(), **words)


def of_colour(ax, colour):
    return [patch for patch in ax.patches if same_color(patch.get_facecolor(), colour)]


def test_colours_by_component():
    parts = {"input bearing": "red", "stage 1/intermediate": "lime", "output": "blue", "stage 2": "magenta"}
    _, ax = figure("two-stage", colours=parts)
    assert [len(of_colour(ax, colour)) for colour in ("red", "lime", "blue")] == [
        2,
        1,
        2,
    ]  # both halves; wheel; with shaft
    assert all(isinstance(patch, Polygon) for patch in of_colour(ax, "blue"))
    assert len([line for line in ax.lines if line.get_color() == "magenta"]) == 1  # at the pitch point


@pytest.mark.parametrize("name", ["two-stage", "planetary-27-36-99", "wind-turbine-3-stage", "alouette-iii", "oh-58"])
def test_every_component_of_a_verdict_can_be_coloured(name):
    gearbox, _ = figure(name)
    components = {row.component for row in defects(gearbox) if row.kind != "planet_pass"}
    assert components <= coloured_components(gearbox)


def test_an_unknown_component_is_refused():
    with pytest.raises(ValueError, match='the drawing has no "stage 3"'):
        figure("two-stage", colours={"stage 3": "red"})


@pytest.mark.parametrize("name", VARIED)
def test_names_do_not_overlap(name):
    _, ax = figure(name)
    assert_apart(ax)


def test_names_beside_another_view_do_not_overlap_and_leave_the_mechanism_its_size():
    gearbox, _ = figure("wind-turbine-3-stage")
    left, right = Figure(figsize=(9, 6), layout="constrained").subplots(1, 2)
    for ax, view in ((left, "section"), (right, "axial")):
        draw_mechanism(gearbox, ax=ax, view=view)
    for ax in (left, right):
        assert_apart(ax)
        drawn = ax.dataLim.transformed(ax.transData)
        assert max(drawn.width, drawn.height) > 0.2 * 9 * ax.figure.dpi


def assert_apart(ax):
    """Names are drawn once each, apart from each other; leaders may cross."""
    ax.figure.draw_without_rendering()
    boxes = [(text.get_text(), Text.get_window_extent(text)) for text in ax.texts]
    assert len({text for text, _ in boxes}) == len(boxes) > 1
    for (one, a), (two, b) in combinations(boxes, 2):
        assert not (min(a.x1, b.x1) - max(a.x0, b.x0) > 0.5 and min(a.y1, b.y1) - max(a.y0, b.y0) > 0.5), (one, two)


@pytest.mark.parametrize("name", ["wind-turbine-3-stage", "oh-58", "alouette-iii"])
def test_no_two_bearings_of_a_shaft_are_at_one_place(name):
    places = [tuple(np.round(bearing.centre, 6)) for bearing in layout_of(figure(name)[0]).bearings]
    assert len(set(places)) == len(places)


def test_along_the_axes_each_tooth_has_a_tick():
    gearbox, ax = figure("planetary-27-36-99", view="axial")
    ticks = sum(line.get_xdata().size // 3 for line in ax.lines if line.get_xdata().size > 9)
    assert ticks == sum(gear.teeth for gear in layout_of(gearbox).gears) == 27 + 3 * 36 + 99


def test_along_axes_that_are_not_parallel_is_refused():
    with pytest.raises(ValueError, match="needs parallel axes"):
        figure("alouette-iii", view="axial")
