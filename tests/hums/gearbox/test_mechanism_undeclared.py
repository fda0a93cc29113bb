"""What a gearbox file leaves out is said: bodies without a bearing, no mesh."""

from itertools import pairwise

import pytest

from hums.gearbox.mechanism import undeclared_parts
from hums.gearbox.model import Gearbox, load_gearbox

BEARING = {"outer_ring": "housing", "elements": 9, "element_diameter_mm": 8, "pitch_diameter_mm": 40}


def box(*on, links=("housing", "input"), rigid=()):
    rows = [BEARING | {"names": [f"of {link}"], "inner_ring": link} for link in on]
    table = {"name": "box", "frame": "housing", "axes": {"one": list(links)}, "bearing": rows}
    return Gearbox.from_mapping(table | ({"rigid": [list(rigid)]} if rigid else {}))


def stage_on_planet_bearings():
    axes = {"main": ["housing", "sun", "ring", "carrier"], "planet": {"links": ["carrier", "planet"], "copies": 3}}
    bearing = BEARING | {"names": ["planet bearing"], "inner_ring": "carrier", "outer_ring": "planet"}
    teeth = [{"teeth": {"sun": 24, "planet": 30}}, {"teeth": {"planet": 30, "ring": -84}}]
    table = {"name": "stage", "frame": "housing", "rigid": [["housing", "ring"]], "bearing": [bearing], "mesh": teeth}
    return Gearbox.from_mapping(table | {"axes": axes})


@pytest.mark.parametrize(
    ("gearbox", "named"),
    [
        (box("input"), []),
        (box(), ["input"]),
        (box("pinion", links=("housing", "input"), rigid=("input", "pinion")), []),  # one body by two names
        (load_gearbox("two-stage"), ["output"]),
        (load_gearbox("planetary-27-36-99"), ["sun", "planet"]),  # all three planets by their one name
        (load_gearbox("wind-turbine-3-stage"), ["sun"]),  # which floats; bearings hold the carrier and its planets
        (stage_on_planet_bearings(), ["sun", "carrier"]),
    ],
)
def test_bodies_without_a_bearing(gearbox, named):
    said = [sentence for sentence in undeclared_parts(gearbox) if "bearing" in sentence]
    assert [sentence.split(" on ")[1].split(":")[0].split(", ") for sentence in said] == ([named] if named else [])


def test_no_mesh():
    assert undeclared_parts(box("input")) == ["No gear mesh is declared: damage to teeth was not assessed."]


def test_many_are_counted():
    links = [f"shaft {number}" for number in range(20)]
    axes = {link: ["housing", link] for link in links}
    gearbox = Gearbox.from_mapping(
        {
            "name": "train",
            "frame": "housing",
            "axes": axes,
            "mesh": [{"teeth": {a: 20, b: 21}} for a, b in pairwise(links)],
        }
    )
    assert "shaft 11 and 8 more: damage to their bearings" in undeclared_parts(gearbox)[0]
