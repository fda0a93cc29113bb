"""Figures: what they must show stands in them, where it belongs, and no text covers another."""

from functools import cache
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon
from matplotlib.text import Annotation

import hums
from hums.gearbox.defect_orders import defect_orders
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, load_gearbox
from hums.plots import (
    mechanism_graph,
    plot_average,
    plot_control_chart,
    plot_kurtogram,
    plot_order_map,
    plot_spectrum,
    save_figure,
    speed_order_chart,
    svg,
    velocity_diagram,
)

LOCKED = {"left wheel": 0, "right wheel": 1}
# shafts, planets, planets in stages, bevel gears, planets that mesh with planets
SHOWN = ["two-stage", "planetary-27-36-99", "alouette-iii", "car-differential", "ravigneaux"]
CROWDED = ["alouette-iii", "car-differential", "wind-turbine-3-stage", "ravigneaux"]
SPEEDS = {"car-differential": LOCKED, "ravigneaux": {"small sun": 1, "ring": 0}}


def axes(*, width=6.4, height=4.2):
    return Figure(figsize=(width, height), layout="constrained").add_subplot()


def kinematics_of(name):
    return solve_kinematics(load_gearbox(name))


def written(ax):
    """Every text that is seen, after the figure is laid out: names in boxes with their boxes."""
    ax.figure.draw_without_rendering()
    legend = ax.get_legend()
    texts = [*ax.texts, ax.title, ax._left_title, *(legend.get_texts() if legend else [])]
    return [text for text in texts if text.get_text() and text.get_visible()]


def extent(text):
    box = text.get_bbox_patch()
    return text.get_window_extent() if box is None else box.get_window_extent()


def text_extent(text):
    """Extent of the letters alone: an annotation's own extent holds its leader line too."""
    return super(Annotation, text).get_window_extent() if isinstance(text, Annotation) else extent(text)


def overlapping(ax):
    """Pairs of texts that cover each other, as they are drawn."""
    boxes = [(text.get_text(), text_extent(text)) for text in written(ax)]
    return [
        (one, other)
        for (one, a), (other, b) in combinations(boxes, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 0.5 and min(a.y1, b.y1) - max(a.y0, b.y0) > 0.5  # of a pixel
    ]


def vertices(ax):
    return {text.get_text(): text for text in ax.texts if text.get_bbox_patch() is not None}


def edges(ax, *, dashed):
    paths = [patch for patch in ax.patches if isinstance(patch, PathPatch)]
    return [patch for patch in paths if (patch.get_linestyle() not in ("-", "solid")) == dashed]


def polygons(ax):
    return [patch for patch in ax.patches if isinstance(patch, Polygon)]


@cache
def graph_of(name):
    """Return the drawn graph of a gearbox, to be looked at only."""
    ax = axes()
    mechanism_graph(kinematics_of(name), ax=ax)
    return ax


@pytest.fixture(params=SHOWN)
def graph(request):
    return kinematics_of(request.param), graph_of(request.param)


class TestMechanismGraph:
    @pytest.mark.parametrize(
        ("name", "counts"),
        # Penaud, Alazard and Amiez 2012: links, gear pairs, levels drawn as polygons, and turning pairs beside these
        [("car-differential", (7, 5, 2, 1)), ("alouette-iii", (8, 6, 1, 4))],
    )
    def test_counts_of_the_papers(self, name, counts):
        ax = graph_of(name)
        drawn = (len(vertices(ax)), len(edges(ax, dashed=True)), len(polygons(ax)), len(edges(ax, dashed=False)))
        assert drawn == counts

    def test_corners_of_the_differentials_polygons(self):
        ax = graph_of("car-differential")
        at = {text.get_position(): name for name, text in vertices(ax).items()}
        corners = [{at[float(x), float(y)] for x, y in polygon.get_xy()} for polygon in polygons(ax)]
        assert {"car", "left wheel", "right wheel", "cage"} in corners
        assert {"cage", "planet a", "planet b"} in corners

    def test_teeth_stand_nearer_to_their_gear(self):
        ax = graph_of("two-stage")
        places = {name.split(" ")[0]: np.array(text.get_position()) for name, text in vertices(ax).items()}
        teeth = {text.get_text(): np.array(text.get_position()) for text in ax.texts}
        for number, gear, mate in (
            ("23", "input", "intermediate"),
            ("67", "intermediate", "input"),
            ("19", "intermediate", "output"),
            ("61", "output", "intermediate"),
        ):
            assert np.linalg.norm(teeth[number] - places[gear]) < np.linalg.norm(teeth[number] - places[mate])

    def test_a_gear_pair_has_the_colour_of_its_carrier(self):
        # Penaud, Alazard and Amiez 2012, Table 4
        ax = graph_of("alouette-iii")
        named = vertices(ax)
        at = {text.get_position(): name for name, text in named.items()}
        carrier = {
            ("housing", "lower planet"): "lower carrier",
            ("lower planet", "main shaft"): "lower carrier",
            ("lower carrier", "upper planet"): "upper carrier",
            ("housing", "upper planet"): "upper carrier",
            ("input", "main shaft"): "housing",
            ("main shaft", "tail"): "housing",
        }
        for edge in edges(ax, dashed=True):
            ends = tuple(sorted(at[tuple(edge.get_path().vertices[k])] for k in (0, -1)))
            border = named[carrier[ends]].get_bbox_patch()
            assert same_color(edge.get_edgecolor(), border.get_edgecolor())
            assert border.get_linewidth() > named["input"].get_bbox_patch().get_linewidth()

    def test_nothing_covers_another_and_all_is_in_the_figure(self, graph):
        _, ax = graph
        assert not overlapping(ax)
        for text in written(ax):
            box = extent(text)
            assert min(box.x0, box.y0) >= -1
            assert box.x1 <= ax.figure.bbox.x1 + 1
            assert box.y1 <= ax.figure.bbox.y1 + 1
        # no edge runs behind a vertex at which it does not end
        boxes = {text.get_position(): text.get_bbox_patch().get_window_extent() for text in vertices(ax).values()}
        for edge in [*edges(ax, dashed=True), *edges(ax, dashed=False)]:
            path = edge.get_path()
            ends = {tuple(path.vertices[k]) for k in (0, -1)}
            drawn = path.transformed(ax.transData)
            assert not [box for at, box in boxes.items() if at not in ends and drawn.intersects_bbox(box, filled=False)]
        # no polygon holds a vertex of another level
        for polygon in polygons(ax):
            corners = {tuple(map(float, corner)) for corner in polygon.get_xy()}
            assert not polygon.get_path().contains_points(sorted(boxes.keys() - corners)).any()

    def test_copies_are_one_vertex(self):
        ax = graph_of("planetary-27-36-99")
        assert set(vertices(ax)) == {"housing = ring", "sun", "carrier", "planet\n3 copies"}
        assert len(edges(ax, dashed=True)) == 2

    def test_an_unknown_mate_is_a_question_mark(self):
        shaft = {"axes": {"line": ["housing", "shaft"]}, "mesh": [{"teeth": {"shaft": 20}, "carrier": "housing"}]}
        gearbox = Gearbox.from_mapping({"name": "a", "frame": "housing", "reference": "shaft"} | shaft)
        ax = axes(width=4, height=2)
        mechanism_graph(solve_kinematics(gearbox), ax=ax)
        assert set(vertices(ax)) == {"housing", "shaft", "?"}
        assert [text.get_text() for text in ax.texts if text.get_weight() == "bold"] == ["20"]


def arrows(ax, *, dashed):
    """Arrows as complex vectors, with where they start."""
    found = []
    for arrow in ax.texts:
        if isinstance(arrow, Annotation) and not arrow.get_text():
            style = arrow.arrow_patch.get_linestyle()
            if (style not in ("-", "solid")) == dashed:
                start, end = complex(*arrow.xyann), complex(*arrow.xy)
                found.append((end - start, start))
    return found


def matched(found, expected):
    """Whether two lists hold the same complex numbers, in any order."""
    key = [sorted(np.round(values, 6), key=lambda z: (z.real, z.imag)) for values in (found, expected)]
    return len(found) == len(expected) and np.allclose(*key, atol=2e-6)


class TestVelocityDiagram:
    def test_left_wheel_locked(self):
        # Penaud, Alazard and Amiez 2012, eq. 6, first column, and figure 5
        ax = axes()
        velocity_diagram(kinematics_of("car-differential"), LOCKED, ax=ax)
        assert matched([vector for vector, _ in arrows(ax, dashed=False)], [1, 0.5, -2.5, 0.5 + 0.7j, 0.5 - 0.7j])
        relative = arrows(ax, dashed=True)
        assert matched([vector for vector, _ in relative], [0.7j, -0.7j])
        assert matched([start for _, start in relative], [0.5, 0.5])  # at the tip of the cage
        assert ax._left_title.get_text() == "at rest: car, left wheel"

    def test_parallel_axes_by_willis(self):
        # ring at rest: carrier 27 / (27 + 99), planet on it -27/36 of what the carrier sees of the sun
        carrier = 27 / 126
        planet = -27 / 36 * (1 - carrier)
        ax = axes()
        velocity_diagram(kinematics_of("planetary-27-36-99"), ax=ax)
        assert matched([vector for vector, _ in arrows(ax, dashed=False)], [1, carrier, carrier + planet])
        [(vector, start)] = arrows(ax, dashed=True)
        assert vector == pytest.approx(planet)
        assert start.real == pytest.approx(carrier)
        assert f"planet 1, 2, 3  \N{MINUS SIGN}{abs(carrier + planet):.5g}" in {text.get_text() for text in ax.texts}

    @pytest.mark.parametrize("name", SHOWN[1:])
    def test_nothing_covers_a_text(self, name):
        ax = axes()
        velocity_diagram(kinematics_of(name), SPEEDS.get(name), ax=ax)
        assert not overlapping(ax)

    def test_a_mechanism_at_rest(self):
        ax = axes()
        velocity_diagram(kinematics_of("two-stage"), {"input": 0}, ax=ax)
        assert not arrows(ax, dashed=False)
        assert ax._left_title.get_text() == "at rest: housing, input, intermediate, output, pinion"


def chart(name="two-stage", *, speeds=None, height=4.6, **settings):
    ax = axes(width=7.4, height=height)
    table = defect_orders(load_gearbox(name), speeds=speeds)
    return speed_order_chart(table, reference_rpm=(600, 1200), ax=ax, **settings), table


def table_of(*rows):
    return pd.DataFrame([{"component": c, "kind": k, "order": o} for c, k, o in rows])


class TestSpeedOrderChart:
    def test_frequencies(self):
        ax, table = chart()
        ends = {tuple(np.round([line.get_ydata()[0], line.get_ydata()[-1]], 9)) for line in ax.lines}
        expected = {tuple(np.round([order * 600 / 60, order * 1200 / 60], 9)) for order in table["order"]}
        assert ends == expected
        assert (230.0, 460.0) in ends  # 23 teeth at 10 and 20 revolutions a second
        assert ax.get_xlim() == (600, 1200)

    def test_coinciding_orders_are_one_line_in_two_colours_with_one_name(self):
        ax, _ = chart()
        labels = [text.get_text() for text in ax.texts]
        assert "1  input = stage 1/pinion tooth" in labels
        assert "23  stage 1 mesh = assembly phase" in labels
        doubled = [line for line in ax.lines if np.isclose(line.get_ydata()[-1], 20.0)]
        assert [line.get_linestyle() for line in doubled] == ["-", "--"]
        assert not same_color(doubled[0].get_color(), doubled[1].get_color())

    @pytest.mark.parametrize("name", CROWDED)
    def test_nothing_covers_a_text(self, name):
        ax, _ = chart(name, speeds=SPEEDS.get(name))
        assert not overlapping(ax)

    def test_names_that_do_not_fit_are_counted(self):
        ax, table = chart("alouette-iii", height=2.2)
        lines = table["order"].round(12).nunique()
        notes = [text.get_text() for text in ax.texts if "not labelled" in text.get_text()]
        assert notes == [f"{lines - len(ax.texts) + 1} lines not labelled; increase the height"]
        assert not overlapping(ax)

    @pytest.mark.parametrize(
        ("rows", "settings", "words"),
        [
            *(
                (1, {"reference_rpm": bad}, r"give \(low, high\) in rpm")
                for bad in ((0, 100), (200, 100), (100, float("inf")), (float("nan"), 100))
            ),
            (0, {}, "table of defect orders is empty"),
        ],
    )
    def test_refused(self, rows, settings, words):
        table = table_of(("a", "shaft", 1.0))[:rows]
        with pytest.raises(ValueError, match=words):
            speed_order_chart(table, **({"reference_rpm": (1, 2), "ax": axes()} | settings))


class TestSaveFigure:
    @pytest.mark.parametrize(
        ("suffix", "start"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF"), ("SVG", b"<?xml")]
    )
    def test_suffix_says_what_is_written_and_two_runs_agree(self, tmp_path, suffix, start):
        paths = [tmp_path / f"{name}.{suffix}" for name in "ab"]
        for path in paths:
            assert save_figure(lambda ax: ax.plot([0, 1]), path, width=3, height=2) == path
            assert suffix != "svg" or 'width="216pt" height="144pt"' in path.read_text()
        first, second = (path.read_bytes() for path in paths)
        assert first.startswith(start)
        assert first == second
        assert {path.name for path in tmp_path.iterdir()} == {path.name for path in paths}

    def test_powers_of_ten_on_logarithmic_axes_are_plain_text(self):
        def draw(ax):
            ax.loglog([0.01, 100.0], [1.0, 5.0])

        text = svg(draw)
        assert all(f">{power}<" in text for power in ("10⁻²", "10⁻¹", "10⁰", "10¹", "10²"))
        assert "$" not in text

    @pytest.mark.parametrize("name", ["a.jpeg", "a", "svg"])
    def test_another_suffix_is_refused(self, tmp_path, name):
        with pytest.raises(ValueError, match=r"use \.svg, \.png or \.pdf"):
            save_figure(lambda ax: ax.plot([0, 1]), tmp_path / name, width=3, height=2)
        with pytest.raises(ValueError, match="positive size in inches"):
            save_figure(lambda ax: ax.plot([0, 1]), tmp_path / "a.png", width=0, height=2)
        assert not list(tmp_path.iterdir())

    def test_a_drawing_that_fails_leaves_the_file_that_was_there(self, tmp_path):
        path = tmp_path / "a.png"
        save_figure(lambda ax: ax.plot([0, 1]), path, width=3, height=2)
        before = path.read_bytes()
        with pytest.raises(ZeroDivisionError):
            save_figure(lambda _: 1 / 0, path, width=3, height=2)
        assert path.read_bytes() == before
        assert [each.name for each in tmp_path.iterdir()] == ["a.png"]


def crowded(count=30):
    """A spectrum with identified lines so close that not all can be named; the last is a fundamental, and low."""
    found = np.append(np.linspace(10, 14, count), 12.05)
    size = found.size
    heights = np.append(np.linspace(1.0, 0.5, count), 0.1)
    spectrum = np.full((1, 400), 0.01)
    spectrum[0, 200] = heights.max()
    return xr.Dataset(
        {
            "amplitude": (("channel", "order"), spectrum),
            "units": ("channel", ["g"]),
            "line_channel": ("line", ["a"] * size),
            "line_order": ("line", found),
            "order_found": ("line", found),
            "line_amplitude": ("line", heights),
            "claimed": ("line", np.ones(size, dtype=int)),
            "kind": ("line", ["inner_race"] * size),
            "component": ("line", ["bearing"] * count + ["wanted"]),
            "harmonic": ("line", [2] * count + [1]),
            "sideband": ("line", np.zeros(size, dtype=int)),
        },
        coords={"channel": ["a"], "order": np.linspace(0, 20, 400)},
    )


class TestSpectrum:
    def test_names_do_not_cover_each_other_and_fundamentals_come_first(self):
        ax = axes(height=3.4)
        plot_spectrum(xr.DataTree.from_dict({"order_spectrum": crowded()}), channel="a", ax=ax)
        labels = [text.get_text() for text in ax.texts]
        assert labels[0] == "wanted inner race"
        assert 3 < len(labels) < 31
        assert not overlapping(ax)


@pytest.fixture(scope="module")
def analysis():
    """One of 10 s at 20 rev/s: a mesh of 23 teeth, and impacts that ring at 1500 Hz."""
    times_s = np.arange(60000) / 6000
    mesh = 0.5 * np.cos(2 * np.pi * 23 * 20 * times_s)
    since_s = times_s % 0.0731
    ring = np.exp(-800 * since_s) * np.cos(2 * np.pi * 1500 * since_s)
    noise = np.random.default_rng(0).normal(0, 0.02, times_s.size)
    pulses = hums.PulseTimes(times_s=np.arange(201) / 20, shaft="input", pulses_per_rev=1)
    record = hums.make_record({"housing": mesh + ring + noise}, rate_hz=6000, units="g", angle=pulses)
    return hums.analyze(record, load_gearbox("two-stage"))


class TestOfAnAnalysis:
    def test_the_mesh_is_the_largest_line_of_the_order_map(self, analysis):
        ax = plot_order_map(analysis, channel="housing", ax=axes())
        (image,) = ax.collections
        largest = np.argmax(np.asarray(image.get_array()).mean(axis=0))
        assert analysis["order_map/housing"]["order"][largest] == pytest.approx(23, abs=0.1)

    def test_the_band_that_rings_has_the_largest_kurtosis(self, analysis):
        ax = plot_kurtogram(analysis, channel="housing", ax=axes())
        (cells,) = ax.collections
        box = cells.get_paths()[int(np.argmax(cells.get_array()))].get_extents()
        assert box.x0 < 1900
        assert box.x1 > 1100
        assert ax.get_xlim() == (0, 3000)

    def test_the_average_of_a_gear_has_a_wave_for_each_tooth(self, analysis):
        ax = plot_average(analysis, channel="housing", component="stage 1/pinion", ax=axes())
        average, difference = (line.get_ydata() for line in ax.lines)
        assert np.argmax(np.abs(np.fft.rfft(average))) == 23
        assert np.ptp(difference) < np.ptp(average) / 4  # without its mesh lines

    def test_what_is_not_there_is_refused(self, analysis):
        with pytest.raises(ValueError, match='no order map of channel "x"; available: housing'):
            plot_order_map(analysis, channel="x", ax=axes())
        with pytest.raises(ValueError, match='no average of "x"; it has stage 1/pinion'):
            plot_average(analysis, channel="housing", component="x", ax=axes())
        fleet = xr.Dataset({"machine": ("record", ["a"]), "health": (("record", "watched"), [[np.nan]])})
        with pytest.raises(ValueError, match='machine "a" has no condition index'):
            plot_control_chart(fleet.assign_coords(watched=["stage 1"]), machine="a", ax=axes())


def test_a_dollar_in_a_name_is_a_dollar():
    # with mathematics these are parsed, and the second one ends the report
    page = svg(lambda ax: ax.set_title("$x$ and $\\frac$"))
    assert "$x$ and $\\frac$" in page
