"""The table of defect orders against hand-worked trains, the papers' tables and published bearing figures."""

import math
from dataclasses import astuple
from fractions import Fraction as F  # noqa: N817

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hums.gearbox import Gearbox, GearboxError, GearboxWarning, load_gearbox
from hums.kinematics import solve_kinematics
from hums.orders import BEARING_KINDS, KINDS, bearing_multiples, bearing_orders, defect_orders, defects

# Penaud and Alazard 2010, section 3 and table A; the sides of the bevel gears as in the 2012 paper.
DIFFERENTIAL = {
    "frame": "car",
    "reference": "cage",
    "axes": {
        "wheels": {"direction": [1, 0, 0], "links": ["car", "left wheel", "right wheel", "cage"]},
        "pinions": {"direction": [0, 1, 0], "links": ["cage", "upper pinion", "lower pinion"]},
        "drive": {"direction": [1, 0, 0], "links": ["car", "drive shaft"]},
    },
    "mesh": [
        {"teeth": {"drive shaft": 13, "cage": 65}},
        {"teeth": {"left wheel": -14, "upper pinion": 10}},
        {"teeth": {"left wheel": -14, "lower pinion": -10}},
        {"teeth": {"right wheel": 14, "upper pinion": 10}},
        {"teeth": {"right wheel": 14, "lower pinion": -10}},
    ],
    "bearing": [
        {
            "names": ["bearing 1", "bearing 2"],
            "inner_ring": "cage",
            "outer_ring": "car",
            "elements": 25,
            "element_diameter_mm": 5,
            "pitch_diameter_mm": 54,
            "contact_angle_deg": 15,
        }
    ],
}
TURNING = {"left wheel": F(26), "right wheel": F(30)}  # rad/s
PAIR = {
    "frame": "h",
    "reference": "a",
    "axes": {"one": ["h", "a"], "two": ["h", "b"]},
    "mesh": [{"teeth": {"a": 20, "b": 45}}],
}


def box(table, **changes):
    return Gearbox.from_mapping({"name": "box"} | table | changes)


def single(**bearing):
    """A shaft in one bearing."""
    bearing = {"name": "x", "inner_ring": "shaft", "outer_ring": "h"} | bearing
    return box({"frame": "h", "reference": "shaft", "axes": {"main": ["h", "shaft"]}, "bearing": [bearing]})


def rows(table):
    """The table as {(component, kind): row}."""
    found = {(row.component, row.kind): row for row in table.itertuples(index=False)}
    assert len(found) == len(table)
    return found


class TestGears:
    def test_planetary_27_36_99_by_hand(self):
        table = rows(defect_orders(load_gearbox("planetary-27-36-99")))
        carrier = F(27, 126)
        sun, planet = 1 - carrier, (1 - carrier) * F(27, 36)  # both against the carrier
        mesh = 27 * sun
        gears = {
            ("sun", "shaft"): (F(1), 1, "housing"),
            ("carrier", "shaft"): (carrier, 1, "housing"),
            ("sun-planet", "gear_mesh"): (mesh, 3, "carrier"),
            ("planet-ring", "gear_mesh"): (99 * carrier, 3, "carrier"),
            # three planets strike each tooth of sun and ring once a turn, sun and ring each one of a planet
            ("sun-planet/sun", "tooth"): (3 * sun, 27, "carrier"),
            ("planet-ring/ring", "tooth"): (3 * carrier, 99, "carrier"),
            ("sun-planet/planet", "tooth"): (planet, 3 * 36, "carrier"),
            ("planet-ring/planet", "tooth"): (planet, 3 * 36, "carrier"),
            ("planet", "planet_tooth"): (2 * planet, 3 * 36, "carrier"),
            # the same two teeth meet after the least common multiple of both counts, and gcd sorts them
            ("sun-planet", "hunting_tooth"): (mesh / 108, 3, "carrier"),
            ("planet-ring", "hunting_tooth"): (mesh / 396, 3, "carrier"),
            ("sun-planet", "assembly_phase"): (mesh / 9, 3, "carrier"),
            ("planet-ring", "assembly_phase"): (mesh / 9, 3, "carrier"),
            ("planet pass", "planet_pass"): (3 * carrier, 1, "housing"),
        }
        assert mesh == 99 * carrier == F(297, 14)
        assert {
            key: (row.exact, row.sources, row.seen_from) for key, row in table.items() if row.exact is not None
        } == gears
        assert {key for key in table if key not in gears} == {
            (name, kind) for name in ("carrier front", "carrier rear") for kind in BEARING_KINDS
        }
        # sidebands: what turns past the mesh, in the order of its gears
        assert table["sun-planet", "gear_mesh"].sidebands == (float(sun), float(planet))

    def test_two_stage_by_hand(self):
        table = rows(defect_orders(load_gearbox("two-stage")))
        second = F(23, 67)
        assert table["stage 1", "gear_mesh"].exact == 23
        assert table["stage 2", "gear_mesh"].exact == 19 * second
        assert table["stage 1/pinion", "tooth"].exact == 1
        assert table["stage 1/intermediate", "tooth"].exact == second
        assert table["stage 2/output", "tooth"].exact == second * F(19, 61)
        assert table["stage 1", "hunting_tooth"].exact == F(1, 67)  # coprime: every tooth meets every other
        assert table["stage 1", "assembly_phase"].exact == 23
        assert table["output", "shaft"].exact == second * F(19, 61)
        assert table["stage 2", "gear_mesh"].sidebands == (float(second), float(second * F(19, 61)))

    def test_common_factors(self):
        table = rows(defect_orders(box(PAIR)))
        assert table["a-b", "hunting_tooth"].exact == F(20, math.lcm(20, 45)) == F(1, 9)
        assert table["a-b", "assembly_phase"].exact == F(20, math.gcd(20, 45)) == 4

    def test_a_mate_that_is_unknown(self):
        gearbox = box(PAIR, mesh=[*PAIR["mesh"], {"teeth": {"b": 17}, "carrier": "h"}])
        table = rows(defect_orders(gearbox))
        assert table["b-unknown", "gear_mesh"].exact == 17 * F(20, 45)
        assert table["b-unknown/b", "tooth"].exact == F(20, 45)
        assert {kind for component, kind in table if component == "b-unknown"} == {"gear_mesh"}

    def test_table_a_of_the_differential(self):
        table = rows(defect_orders(box(DIFFERENTIAL), speeds=TURNING))
        cage = 28  # rad/s; orders count per turn of the cage, so order x 28 is in rad/s
        for component, kind, printed, sources in [
            ("drive shaft-cage", "gear_mesh", 1820, 1),
            ("drive shaft-cage/drive shaft", "tooth", 140, 13),
            ("drive shaft-cage/cage", "tooth", 28, 65),
            *[
                (f"{wheel} wheel-{pinion} pinion{what}", kind, printed, sources)
                for wheel in ("left", "right")
                for pinion in ("upper", "lower")
                for what, kind, printed, sources in [
                    ("", "gear_mesh", 28, 1),
                    (f"/{wheel} wheel", "tooth", 2, 14),
                    (f"/{pinion} pinion", "tooth", F(14, 5), 10),
                ]
            ],
        ]:
            row = table[component, kind]
            assert row.exact * cage == printed, component
            assert row.sources == sources

    def test_stepped_planets_pass_once(self):
        table = rows(
            defect_orders(
                box(
                    {
                        "frame": "housing",
                        "reference": "sun",
                        "rigid": [["housing", "ring"], ["big", "small"]],
                        "axes": {
                            "main": ["housing", "sun", "ring", "carrier"],
                            "planets": {"links": ["carrier", "big", "small"], "copies": 3},
                        },
                        "mesh": [{"teeth": {"sun": 20, "big": 40}}, {"teeth": {"small": 18, "ring": -78}}],
                    }
                )
            )
        )
        carrier = 1 / (1 + F(40, 20) * F(78, 18))
        assert [row.exact for (_, kind), row in table.items() if kind == "planet_pass"] == [3 * carrier]
        assert table["sun-big", "gear_mesh"].exact == 20 * (1 - carrier)
        assert table["small-ring", "gear_mesh"].exact == 78 * carrier

    def test_what_stands_still_has_no_row(self):
        # straight ahead the pinions rest in their cage
        table = rows(defect_orders(box(DIFFERENTIAL), speeds={"left wheel": 1, "right wheel": 1}))
        assert all(row.order > 0 for row in table.values())
        assert ("left wheel-upper pinion", "gear_mesh") not in table
        assert table["cage", "shaft"].exact == 1


class TestBearings:
    def test_table_a_of_the_differential(self):
        cage = 28  # rad/s
        for name in ("bearing 1", "bearing 2"):
            (rates,) = (rates for rates in bearing_orders(box(DIFFERENTIAL), speeds=TURNING) if rates.name == name)
            # printed with one decimal; the last one with the usual D/d in front of the bracket (errata)
            assert rates.inner_race * cage == pytest.approx(381.3, abs=0.05)
            assert rates.outer_race * cage == pytest.approx(318.7, abs=0.05)
            assert rates.rolling_element * cage == pytest.approx(300.0, abs=0.05)
        sources = defect_orders(box(DIFFERENTIAL), speeds=TURNING).set_index(["component", "kind"])["sources"]
        assert [sources["bearing 2", kind] for kind in BEARING_KINDS] == [1, 1, 25, 1]

    @pytest.mark.parametrize(
        ("geometry", "printed", "tolerance"),
        [
            # Case Western Reserve's drive-end bearing 6205-2RS, sizes in inch, as its data page prints them: one
            # unit of the fourth decimal, since the sizes are rounded too (and its own 3.5848 / 9 is 0.39831)
            ((9, 0.3126, 1.537), (5.4152, 3.5848, 4.7135, 0.39828), 1e-4),
            # twelve balls of 7.12 mm on 38.5 mm, an independent computation to six decimals, here twice the spin
            ((12, 7.12, 38.5), (7.109610, 4.890390, 2 * 2.611184, 0.407532), 1e-6),
        ],
    )
    def test_published_figures(self, geometry, printed, tolerance):
        elements, element, pitch = geometry
        gearbox = single(elements=elements, element_diameter_mm=element, pitch_diameter_mm=pitch)
        (rates,) = bearing_orders(gearbox)
        found = (rates.inner_race, rates.outer_race, rates.rolling_element, rates.cage)
        assert found == pytest.approx(printed, abs=tolerance)
        table = rows(defect_orders(gearbox))
        assert tuple(table["x", kind].order for kind in BEARING_KINDS) == found
        assert table["x", "inner_race"].sidebands == (1.0,)
        assert table["x", "outer_race"].sidebands == ()  # the load stands still over it
        assert table["x", "rolling_element"].sidebands == (rates.cage,)

    def test_printed_multiples(self):
        multiples = {"inner": 9.46, "outer": 6.72, "element_spin": 2.87, "cage": 0.42}
        with pytest.warns(GearboxWarning, match=r"9\.46 \+ outer 6\.72 = 16\.18"):
            gearbox = single(multiples=multiples)
        (rates,) = bearing_orders(gearbox)
        assert (rates.inner_race, rates.outer_race, rates.cage, rates.elements) == (9.46, 6.72, 0.42, 16)
        assert rates.rolling_element == 2 * 2.87
        assert rows(defect_orders(gearbox))["x", "rolling_element"].sources == 16
        multiples["element_defect"] = 2 * multiples.pop("element_spin")
        with pytest.warns(GearboxWarning):
            assert bearing_orders(single(multiples=multiples)) == (rates,)

    @given(
        elements=st.integers(3, 60),
        ratio=st.floats(0.02, 0.9),
        angle=st.floats(0, 60),
        inner=st.integers(-50, 50),
        outer=st.integers(-50, 50),
    )
    def test_both_rings_turning(self, elements, ratio, angle, inner, outer):
        gearbox = box(
            {
                "frame": "h",
                "reference": "tick",
                "axes": {"main": ["h", "i", "o"], "clock": ["h", "tick"]},
                "bearing": [
                    {
                        "name": "x",
                        "inner_ring": "i",
                        "outer_ring": "o",
                        "elements": elements,
                        "element_diameter_mm": ratio * 100,
                        "pitch_diameter_mm": 100,
                        "contact_angle_deg": angle,
                    }
                ],
            }
        )
        (rates,) = bearing_orders(gearbox, speeds={"i": inner, "o": outer, "tick": 1})
        # without slip the contact points have the speed of their rings: radii R -+ r, and the cage carries the
        # element's centre, half-way between both points
        radius, reach = 1.0, ratio * math.cos(math.radians(angle))
        inner_speed, outer_speed = inner * (radius - reach), outer * (radius + reach)
        cage = (inner_speed + outer_speed) / 2 / radius
        tolerance = {"rel": 1e-12, "abs": 1e-11}  # sums of a few dozen, rounded, may cancel
        assert rates.cage == pytest.approx(abs(cage), **tolerance)
        assert rates.inner_race == pytest.approx(elements * abs(inner - cage), **tolerance)
        assert rates.outer_race == pytest.approx(elements * abs(outer - cage), **tolerance)
        if outer == 0 or inner == 0:
            # the element rolls on the ring at rest: its spin against the cage, both races struck once a turn
            defect = 2 * spin_against_cage(inner or outer, ratio, reach, on_outer=outer == 0)
            assert rates.rolling_element == pytest.approx(defect, **tolerance)
        assert rates.relative == abs(inner - outer)

    def test_outer_ring_turning_alone(self):
        # a wheel hub: the cage turns with 1 - FTF, races and elements as often as with the inner ring turning
        turning, resting = (
            bearing_orders(
                single(
                    inner_ring=inner,
                    outer_ring=outer,
                    elements=9,
                    element_diameter_mm=0.3126,
                    pitch_diameter_mm=1.537,
                )
            )[0]
            for inner, outer in (("h", "shaft"), ("shaft", "h"))
        )
        assert turning.cage == pytest.approx(1 - 3.5848 / 9, abs=1e-5)  # the outer race's printed rate, rounded
        assert turning.inner_race == resting.inner_race
        assert turning.outer_race == resting.outer_race

    def test_planet_bearing(self):
        planet = {"name": "planet bearing", "inner_ring": "carrier", "outer_ring": "planet"}
        size = {"elements": 10, "element_diameter_mm": 10, "pitch_diameter_mm": 50}
        shipped = load_gearbox("planetary-27-36-99")
        gearbox = box(
            {
                "frame": "housing",
                "reference": "sun",
                "rigid": [["housing", "ring"]],
                "axes": {
                    "main": ["housing", "sun", "ring", "carrier"],
                    "p": {"links": ["carrier", "planet"], "copies": 3},
                },
                "mesh": [{"teeth": {"sun": 27, "planet": 36}}, {"teeth": {"planet": 36, "ring": -99}}],
                "bearing": [planet | size],
            }
        )
        (rates,) = bearing_orders(gearbox)
        assert rates.relative == float(F(33, 56))  # planet against carrier
        # ten elements, d/D = 1/5: 10/2 (1 + 1/5) and 10/2 (1 - 1/5)
        assert rates.inner_race == pytest.approx(6 * 33 / 56, rel=1e-14)
        assert rates.outer_race == pytest.approx(4 * 33 / 56, rel=1e-14)
        table = rows(defect_orders(gearbox))
        assert [table["planet bearing", kind].sources for kind in BEARING_KINDS] == [3, 3, 30, 3]
        assert bearing_orders(shipped)[0].relative == float(F(3, 14))

    def test_multiples_of_the_geometry(self):
        (bearing,) = single(elements=12, element_diameter_mm=7.12, pitch_diameter_mm=38.5).bearings
        inner, outer, defect, cage, elements = bearing_multiples(bearing)
        # rolling without slip: the races share the elements, the outer one is passed by the cage
        assert inner + outer == pytest.approx(12, rel=1e-15)
        assert outer == pytest.approx(12 * cage, rel=1e-15)
        assert elements == 12
        assert defect == pytest.approx(2 * 2.611184, abs=1e-6)


def spin_against_cage(speed, ratio, reach, *, on_outer):
    """Spin of an element about its own axis: it rolls on the ring at rest, seen from the cage that passes it."""
    cage = speed * (1 - reach) / 2 if on_outer else speed * (1 + reach) / 2
    radius = 1 + reach if on_outer else 1 - reach
    return abs(cage) * radius / ratio


class TestReference:
    def test_another_reference_scales_every_order(self):
        gearbox = load_gearbox("two-stage")
        by_input, by_output = (rows(defect_orders(gearbox, reference=link)) for link in ("input", "output"))
        ratio = F(67 * 61, 23 * 19)
        assert by_input.keys() == by_output.keys()
        for key, row in by_input.items():
            if row.exact is None:
                assert by_output[key].order == pytest.approx(row.order * float(ratio), rel=1e-14)  # a few products
            else:
                assert by_output[key].exact == row.exact * ratio

    def test_only_ratios_of_speeds_matter(self):
        gearbox = box(DIFFERENTIAL)
        table = defect_orders(gearbox, speeds=TURNING)
        doubled = defect_orders(gearbox, speeds={link: 2 * speed for link, speed in TURNING.items()})
        assert table.equals(doubled)

    def test_measured_speeds_are_not_exact(self):
        gearbox = box(DIFFERENTIAL)
        exact, measured = (
            defect_orders(gearbox, speeds={link: kind(speed) for link, speed in TURNING.items()}) for kind in (F, float)
        )
        assert measured["exact"].isna().all()
        assert list(measured["order"]) == list(exact["order"])

    def test_two_degrees_of_freedom_need_speeds(self):
        with pytest.raises(GearboxError, match="2 degrees of freedom"):
            defect_orders(box(DIFFERENTIAL))
        with pytest.raises(GearboxError, match="contradict"):
            defect_orders(box(DIFFERENTIAL), speeds=TURNING | {"cage": 29})

    @pytest.mark.parametrize(
        ("reference", "speeds", "words"),
        [
            ("car", TURNING, "does not turn"),
            ("cage", {"left wheel": 1, "right wheel": -1}, '"cage" does not turn'),
            ("cge", TURNING, 'no link "cge"; did you mean "cage"'),
        ],
    )
    def test_what_cannot_count(self, reference, speeds, words):
        with pytest.raises(GearboxError, match=words):
            defect_orders(box(DIFFERENTIAL), reference=reference, speeds=speeds)

    def test_no_reference(self):
        table = {key: value for key, value in PAIR.items() if key != "reference"}
        with pytest.raises(GearboxError, match='add reference = "LINK" or pass reference'):
            defect_orders(box(table))
        assert rows(defect_orders(box(table), reference="b"))["a-b", "gear_mesh"].exact == 45


class TestTable:
    @pytest.mark.parametrize("name", ["two-stage", "planetary-27-36-99"])
    def test_columns(self, name):
        gearbox = load_gearbox(name)
        table = defect_orders(gearbox)
        assert list(table.columns) == ["component", "kind", "order", "exact", "sources", "seen_from", "sidebands"]
        assert set(table["kind"]) <= set(KINDS)
        assert table["order"].dtype == float
        for row in table.itertuples():
            assert row.exact is None or float(row.exact) == row.order
        assert [astuple(row) for row in defects(gearbox)] == [
            (row.component, row.kind, row.exact, row.order, row.sources, row.seen_from, row.sidebands)
            for row in table.itertuples()
        ]
        assert table.equals(defect_orders(solve_kinematics(gearbox)))

    def test_order_of_declaration_changes_nothing(self):
        mixed = DIFFERENTIAL | {
            "axes": dict(reversed(DIFFERENTIAL["axes"].items())),
            "mesh": DIFFERENTIAL["mesh"][::-1],
        }
        before, after = (rows(defect_orders(box(table), speeds=TURNING)) for table in (DIFFERENTIAL, mixed))
        assert before == after
