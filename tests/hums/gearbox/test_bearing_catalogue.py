"""The catalogue of bearings: the frequencies that its sources print, and how a gearbox file names a bearing."""

import csv
import warnings
from importlib.resources import files

import numpy as np
import pytest

from hums.analysis.expected_lines import SearchPlan, expected_lines
from hums.gearbox.bearing_catalogue import bearing_catalogue, bearings_named, typical_bearing
from hums.gearbox.defect_orders import bearing_orders
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning

# Factors of deep groove ball bearings by ball over pitch diameter: f_c of ISO 281 (table 2), f_0 of ISO 76 (table 1)
RATIOS = [0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.22, 0.24, 0.26, 0.28, 0.3]
F_C = [46.7, 49.1, 51.1, 52.8, 54.3, 55.5, 57.5, 58.8, 59.6, 59.9, 59.9, 59.6, 59.0, 58.2, 57.1, 56.0]
F_0 = [15.2, 14.9, 14.7, 14.4, 14.2, 14.0, 13.7, 13.5, 13.2, 13.0, 12.8, 12.5, 12.3, 12.1, 11.8, 11.6]  # from 0.15 on
RATED = [
    row
    for row in csv.DictReader((files("hums.gearbox") / "bearing_series.csv").read_text(encoding="utf-8").splitlines())
    if row["static_rating_n"] and float(row["element_diameter_mm"]) < 0.3 * float(row["pitch_diameter_mm"])
]


def gearbox(**bearing):
    entry = {"name": "left", "inner_ring": "a", "outer_ring": "box", **bearing}
    table = {"name": "pair", "frame": "box", "reference": "a", "axes": {"one": ["box", "a"], "two": ["box", "b"]}}
    return Gearbox.from_mapping(table | {"mesh": [{"teeth": {"a": 20, "b": 41}}], "bearing": [entry]})


def typical(designation):
    return typical_bearing(designation, bearings_named(designation))


@pytest.mark.parametrize(
    ("name", "speed_hz", "printed"),
    [
        # inner race, outer race, element (both races), cage, as far as the sources print them
        ("SKF 6205-2RS JEM", 1, (5.4152, 3.5848, 4.7135, 0.39828)),
        ("SKF 6203-2RS JEM", 1, (4.9469, 3.0530, 3.9874, 0.3817)),
        ("NICE (MFPT)", 25, (118.88, 81.12, None, None)),
        ("Rexnord ZA-2115", 2000 / 60, (296.9, 236.4, None, None)),
        ("LDK UER204", 35, (None, 107.91, None, None)),
        ("MB ER-16K", 1, (None, 3.572, None, None)),  # as a rig with this bearing states it
    ],
)
def test_printed_frequencies(name, speed_hz, printed):
    (rates,) = bearing_orders(gearbox(bearing=name))
    found = (rates.inner_race, rates.outer_race, rates.rolling_element, rates.cage)
    for value, known in zip(found, printed, strict=True):
        if known is not None:
            assert value * speed_hz == pytest.approx(known, rel=2e-4)  # diameters and frequencies have four digits


def rating_errors(row, elements, diameter):
    """Return how far the dynamic and the static rating of a geometry lie from the printed ones, relative."""
    ratio = diameter / float(row["pitch_diameter_mm"])
    size = diameter**1.8 if diameter <= 25.4 else 3.647 * diameter**1.4
    dynamic = 1.3 * np.interp(ratio, RATIOS, F_C) * elements ** (2 / 3) * size
    static = np.interp(ratio, 0.15 + 0.01 * np.arange(len(F_0)), F_0) * elements * diameter**2
    return dynamic / float(row["dynamic_rating_n"]) - 1, static / float(row["static_rating_n"]) - 1


@pytest.mark.parametrize("row", RATED, ids=[f"{row['basis']}-{row['designation']}" for row in RATED])
def test_ball_bearings_have_the_ratings_that_their_makers_print(row):
    errors = rating_errors(row, int(row["elements"]), float(row["element_diameter_mm"]))
    assert np.abs(errors).max() < 0.02  # ratings are printed to two or three digits
    others = [
        np.hypot(*rating_errors(row, elements, size * 25.4 / 32))  # balls are graded in 1/32 inch
        for elements in range(6, 14)
        for size in range(5, 60)
        if elements != int(row["elements"]) and 0.15 < size * 25.4 / 32 / float(row["pitch_diameter_mm"]) < 0.3
    ]
    assert np.hypot(*errors) < min(others)


@pytest.mark.parametrize(
    ("designation", "elements", "diameter_mm", "pitch_mm"),
    [
        ("6209", 9, 12.7, 65.0),  # Harris, Rolling Bearing Analysis, example 2.1
        ("22317", 14, 25.0, 135.08),  # the same book
        ("NU204", 11, 7.5, 34.0),  # Lee, Kim and Kim 2024, table 2
        ("30204", 15, 6.2, 35.8),  # the same table
    ],
)
def test_the_inside_of_dissected_bearings(designation, elements, diameter_mm, pitch_mm):
    found = typical(designation)
    assert found.elements == elements
    assert (found.element_diameter_mm, found.pitch_diameter_mm) == pytest.approx((diameter_mm, pitch_mm), rel=2e-3)


def test_frequencies_that_are_printed_of_a_spherical_roller_bearing():
    _, outer, element, cage = typical("SKF 22228 CC/W33").orders
    # vibroguard.cz gives those of an SKF 22228 at 1500 rpm, in Hz, the element's for one race
    assert (25 * outer, 25 * element / 2, 25 * cage) == pytest.approx((205.3, 89.1, 10.8), rel=5e-3)


@pytest.mark.parametrize(
    ("designation", "bore_outside_width_mm"),
    [
        ("6205", (25, 52, 15)),
        ("6322", (110, 240, 50)),
        ("NJ308", (40, 90, 23)),
        ("22220", (100, 180, 46)),
        ("30210", (50, 90, 21.75)),
        ("32012", (60, 95, 23)),
    ],
)
def test_boundary_dimensions_of_iso_15_and_355(designation, bore_outside_width_mm):
    assert typical(designation).boundary_mm == bore_outside_width_mm


def test_common_series_are_complete_and_name_their_sources():
    series = {"62": range(23), "63": range(23), "NU2": range(4, 21), "NJ2": range(4, 21), "NU3": range(4, 21)}
    series |= {"222": range(5, 23), "223": range(8, 23), "302": range(3, 21), "320": range(4, 21)}
    found = [bearings_named(f"{name}{size:02d}") for name, sizes in series.items() for size in sizes]
    assert len(found) > 150
    assert all(row.source.endswith(".") and row.spread >= 0.01 for rows in found for row in rows if row.boundary_mm)


def test_every_row_can_be_a_bearing():
    for row in bearing_catalogue():
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            bearing = gearbox(bearing=row.name).bearings[0]
        assert (bearing.elements, bearing.pitch_diameter_mm) == (row.elements, row.pitch_diameter_mm)
        assert bool(caught) == bool(row.spread)  # published ones are as sure as their source


@pytest.mark.parametrize("designation", ["6205", "NJ 308-E-TVP2", "SKF 22317 E"])
def test_what_is_typical_is_warned_of_and_searched_as_widely_as_makers_differ(designation):
    with pytest.warns(GearboxWarning, match=r'bearing "left", .*ypical of its series, check the data sheet'):
        named = gearbox(bearing=designation)
    spread = named.bearings[0].order_tolerance
    plan = SearchPlan(harmonics=2, sidebands=1, slip=0.001, speed_tolerance=0.0, envelope=True)
    searched = [line for line in expected_lines(solve_kinematics(named), plan) if line.component == "left"]
    assert searched
    assert all(line.tolerance == pytest.approx(spread * line.order) for line in searched)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert gearbox(bearing="skf 6205-2RS jem").bearings[0].order_tolerance == 0


def test_the_spread_of_a_designation_reaches_every_published_bearing():
    found = typical("6205")
    for row in bearings_named("6205"):
        ratios = np.array(row.orders) / found.orders
        assert np.abs(ratios - 1).max() <= found.spread


def test_a_designation_with_unlike_numbers_of_balls_is_not_guessed():
    with pytest.raises(
        GearboxError, match=r'bearing = "6203" has several geometries.*"SKF 6203-2RS JEM", "6203 \(Pader.*"TPI 6203"'
    ):
        gearbox(bearing="6203")


def test_unknown_and_contradicting_ones_are_refused():
    with pytest.raises(GearboxError, match=r'bearing = "7305" is not in the catalogue; did you mean "6305"'):
        gearbox(bearing="7305")
    with pytest.raises(GearboxError, match=r"elements = 8 contradicts SKF 6205-2RS JEM, which has 9"):
        gearbox(bearing="SKF 6205-2RS JEM", elements=8)
