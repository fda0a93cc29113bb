"""The table of defect orders against hand-worked trains, the papers' tables and published bearing figures."""

import math
import tomllib
from fractions import Fraction as F  # noqa: N817
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hums.gearbox.defect_orders import BEARING_KINDS, bearing_orders, defect_orders, defects
from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning, catalogue, load_gearbox

DIFFERENTIAL = tomllib.loads(catalogue()["car-differential"].read_text(encoding="utf-8"))
TURNING = {"left wheel": F(26), "right wheel": F(30)}  # rad/s
PAIR = {
    "frame": "h",
    "reference": "a",
    "axes": {"one": ["h", "a"], "two": ["h", "b"]},
    "mesh": [{"teeth": {"a": 20, "b": 45}}],
}


def box(table, **changes):
    return Gearbox.from_mapping({"name": "box"} | table | changes)


def planetary(*, sun=27, planet=36, copies=3, rest="ring"):
    """Sun, planets and ring, with one link rigid with the housing."""
    return {
        "frame": "housing",
        "reference": "sun",
        "rigid": [["housing", rest]],
        "axes": {
            "main": ["housing", "sun", "ring", "carrier"],
            "planet": {"links": ["carrier", "planet"], "copies": copies},
        },
        "mesh": [{"teeth": {"sun": sun, "planet": planet}}, {"teeth": {"planet": planet, "ring": -sun - 2 * planet}}],
    }


def single(**bearing):
    """A shaft in one bearing."""
    bearing = {"name": "x", "inner_ring": "shaft", "outer_ring": "h"} | bearing
    return box({"frame": "h", "reference": "shaft", "axes": {"main": ["h", "shaft"]}, "bearing": [bearing]})


def rows(table):
    """The table as {(component, kind): row}."""
    found = {(row.component, row.kind): row for row in table.itertuples(index=False)}
    assert len(found) == len(table)
    return found


class TestTableA:
    """Penaud and Alazard 2010, table A: what a car's differential does in a right turn."""

    CAGE = 28  # rad/s; orders count per turn of the cage, so order x 28 is in rad/s
    SHAPES = tuple((wheel, planet) for wheel in ("left wheel", "right wheel") for planet in ("planet a", "planet b"))
    GEARS = (
        ("drive shaft-cage", "gear_mesh", 1820, 1),
        ("drive shaft-cage/drive shaft", "tooth", 140, 13),
        ("drive shaft-cage/cage", "tooth", 28, 65),
        *((f"{wheel}-{planet}", "gear_mesh", 28, 1) for wheel, planet in SHAPES),
        *((f"{wheel}-{planet}/{wheel}", "tooth", 2, 14) for wheel, planet in SHAPES),
        *((f"{wheel}-{planet}/{planet}", "tooth", F(14, 5), 10) for wheel, planet in SHAPES),
    )

    def test_all_of_it(self):
        table = rows(defect_orders(box(DIFFERENTIAL), speeds=TURNING))
        for component, kind, printed, sources in self.GEARS:
            row = table.pop((component, kind))
            assert row.exact * self.CAGE == printed, component
            assert row.sources == sources, component
        for name in ("bearing 1", "bearing 2"):
            for kind, printed, sources in [
                ("inner_race", 381.3, 1),
                ("outer_race", 318.7, 1),
                ("rolling_element", 300.0, 25),  # errata: the paper prints 310.6, with the projected diameter
            ]:
                row = table.pop((name, kind))
                assert row.order * self.CAGE == pytest.approx(printed, abs=0.05)  # one decimal is printed
                assert row.sources == sources
        # what the paper does not list
        assert {kind for _, kind in table} == {
            "shaft",
            "hunting_tooth",
            "assembly_phase",
            "planet_pass",
            "planet_tooth",
            "cage",
        }


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

    def test_bevel_planet_of_nelson(self):
        table = rows(defect_orders(load_gearbox("nelson-bevel-planet")))
        ring_hz = 10
        assert table["sun-planet", "gear_mesh"].exact * ring_hz == F("93.75")  # eq. 13
        assert table["ring-planet", "gear_mesh"].exact * ring_hz == F("93.75")
        # a planet declared once passes once a turn of its carrier (eq. 11: 0.625), and meets sun and ring
        assert table["planet pass", "planet_pass"].exact == F(5, 8)
        assert table["planet", "planet_tooth"].exact == 2 * F(15, 16)

    def test_what_stands_still_has_no_row(self):
        # straight ahead the pinions rest in their cage
        table = rows(defect_orders(box(DIFFERENTIAL), speeds={"left wheel": 1, "right wheel": 1}))
        assert all(row.order > 0 for row in table.values())
        assert ("left wheel-planet a", "gear_mesh") not in table
        assert table["cage", "shaft"].exact == 1


class TestBearings:
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
        filling=st.floats(0.05, 0.99),
        angle=st.floats(0, 60),
        inner=st.integers(-50, 50),
        outer=st.integers(-50, 50),
    )
    def test_both_rings_turning(self, elements, filling, angle, inner, outer):
        ratio = min(0.9, filling * math.pi / elements)  # as many elements as fit
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


def spin_against_cage(speed, ratio, reach, *, on_outer):
    """Spin of an element about its own axis: it rolls on the ring at rest, seen from the cage that passes it."""
    cage = speed * (1 - reach) / 2 if on_outer else speed * (1 + reach) / 2
    radius = 1 + reach if on_outer else 1 - reach
    return abs(cage) * radius / ratio


class TestSidebands:
    """How far apart the sidebands of each kind lie: the rate of what modulates it."""

    @staticmethod
    def spacings(table, **settings):
        return {
            (row.component, row.kind): row.sidebands
            for row in defect_orders(box(table), **settings).itertuples()
            if row.sidebands
        }

    def test_parallel_shafts(self):
        # both gears turn past the mesh; its place is at rest, so nothing else is modulated
        assert self.spacings(PAIR) == {("a-b", "gear_mesh"): (1, F(4, 9))}

    def test_planetary(self):
        carrier = F(27, 126)
        sun, planet, ring = 1 - carrier, (1 - carrier) * F(27, 36), carrier  # against the carrier
        assert self.spacings(planetary()) == {
            # both gears against the carrier, and planets passing a sensor on the housing
            ("sun-planet", "gear_mesh"): (sun, planet, 3 * carrier),
            ("planet-ring", "gear_mesh"): (planet, ring, 3 * carrier),
            # a place on the sun turns with the sun, one on a planet with the carrier; the ring's rest
            ("sun-planet/sun", "tooth"): (1,),
            ("sun-planet/planet", "tooth"): (carrier,),
            ("planet-ring/planet", "tooth"): (carrier,),
            ("planet", "planet_tooth"): (carrier,),
        }

    def test_a_carrier_at_rest(self):
        ring = F(27, 99)
        assert self.spacings(planetary(rest="carrier")) == {
            ("sun-planet", "gear_mesh"): (1, F(27, 36)),
            ("planet-ring", "gear_mesh"): (F(27, 36), ring),
            # planets stand about at different distances of a sensor
            ("sun-planet/sun", "tooth"): (1,),
            ("planet-ring/ring", "tooth"): (ring,),
        }

    SIZE: ClassVar = {"elements": 10, "element_diameter_mm": 10, "pitch_diameter_mm": 50}

    @pytest.mark.parametrize(("inner", "outer"), [("a", "h"), ("h", "a"), ("b", "a")])
    def test_bearings_whose_load_rests_in_the_frame(self, inner, outer):
        speed = {"h": F(0), "a": F(1), "b": F(-1, 2)}
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {"main": ["h", "a", "b"]},
            "bearing": [{"name": "x", "inner_ring": inner, "outer_ring": outer} | self.SIZE],
        }
        found = self.spacings(table, speeds={"a": 1, "b": F(-1, 2)})
        rings = {
            ("x", kind): (abs(speed[ring]),)
            for kind, ring in (("inner_race", inner), ("outer_race", outer))
            if speed[ring]
        }
        # d/D = 1/5: the cage follows the inner ring by 2/5 and the outer one by 3/5
        cage = abs(float(F(2, 5) * speed[inner] + F(3, 5) * speed[outer]))
        assert found.pop(("x", "rolling_element")) == pytest.approx((cage,), rel=1e-14)
        assert found == rings

    def test_bearings_of_planets(self):
        # the load rests in the carrier, on which the inner ring sits, and the carrier takes all of it past a sensor
        bearing = {"name": "x", "inner_ring": "carrier", "outer_ring": "planet"} | self.SIZE
        carrier, planet = F(3, 14), -F(33, 56)
        found = self.spacings(planetary() | {"bearing": [bearing]})
        assert found["x", "inner_race"] == (carrier,)
        assert found["x", "outer_race"] == (-planet, carrier)
        assert found["x", "rolling_element"] == pytest.approx((0.6 * 33 / 56, 3 / 14), rel=1e-14)
        assert ("x", "cage") not in found
        (rates,) = bearing_orders(box(planetary() | {"bearing": [bearing]}))
        assert (rates.inner_ring, rates.outer_ring, rates.carried) == (0, float(planet), float(carrier))
        # ten elements, d/D = 1/5: 10/2 (1 + 1/5) and 10/2 (1 - 1/5), and the cage at 3/5
        assert (rates.inner_race, rates.outer_race, rates.cage) == pytest.approx(
            (6 * 33 / 56, 4 * 33 / 56, 0.6 * 33 / 56), rel=1e-14
        )


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

    @pytest.mark.parametrize(
        ("changes", "settings", "words"),
        [
            ({}, {"reference": "car", "speeds": TURNING}, "does not rotate"),
            ({}, {"speeds": {"left wheel": 1, "right wheel": -1}}, '"cage" does not rotate'),
            ({}, {"reference": "cge", "speeds": TURNING}, 'no link "cge"; did you mean "cage"'),
            ({}, {}, "2 degrees of freedom"),
            ({}, {"speeds": TURNING | {"cage": 29}}, "contradict"),
            ({"reference": None}, {"speeds": TURNING}, 'add reference = "LINK" or pass reference'),
        ],
    )
    def test_what_cannot_count(self, changes, settings, words):
        table = {key: value for key, value in (DIFFERENTIAL | changes).items() if value is not None}
        with pytest.raises(GearboxError, match=words):
            defect_orders(box(table), **settings)

    def test_measured_speeds_are_exact_only_where_teeth_alone_decide(self):
        measured = defect_orders(box(DIFFERENTIAL), speeds={link: float(speed) for link, speed in TURNING.items()})
        assert measured["exact"].isna().all()
        gearbox = load_gearbox("two-stage")
        assert defect_orders(gearbox, speeds={"output": 103.7}).equals(defect_orders(gearbox))


@pytest.mark.parametrize("name", ["car-differential", "planetary-27-36-99", "ravigneaux", "wolfrom"])
def test_the_order_of_declaration_changes_nothing(name):
    table = tomllib.loads(catalogue()[name].read_text(encoding="utf-8"))
    turned = {key: value[::-1] for key, value in table.items() if key in {"mesh", "bearing", "rigid"}}
    turned["axes"] = dict(reversed(table["axes"].items()))
    speeds = {"car-differential": TURNING, "ravigneaux": {"small sun": 1, "large sun": F(-1, 3)}}.get(name)
    before, after = (defects(Gearbox.from_mapping(one), speeds=speeds) for one in (table, table | turned))
    assert sorted(map(repr, after)) == sorted(map(repr, before))
