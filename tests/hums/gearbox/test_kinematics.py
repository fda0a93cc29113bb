"""Velocity ratios against gear trains worked by hand, Willis' formula and the printed examples of the papers."""

import math
from fractions import Fraction as F  # noqa: N817

import numpy as np
import pytest
from gearboxes import PLANETARY, STEPPED, planetary
from hypothesis import given
from hypothesis import strategies as st

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, load_gearbox

CORNER = {"left wheel": F(26), "right wheel": F(30)}  # rad/s


def solved(table, **changes):
    return solve_kinematics(Gearbox.from_mapping({"name": "box"} | table | changes))


def speed(kinematics, link, **speeds):
    return kinematics.relative_speed(link, seen_from=kinematics.gearbox.frame, speeds=speeds or None)


class TestParallel:
    @given(
        stages=st.lists(
            st.tuples(st.integers(5, 400), st.integers(5, 400), st.booleans()),
            min_size=1,
            max_size=6,
        )
    )
    def test_any_train_is_the_product_of_its_stages(self, stages):
        # stage k: a wheel of b teeth driven by a pinion of a teeth; cut inside (minus) it turns the same way
        stages = [(a, a + b if internal else b, internal) for a, b, internal in stages]
        table = {
            "frame": "h",
            "reference": "s0",
            "axes": {f"axis {k}": ["h", f"s{k}"] for k in range(len(stages) + 1)},
            "mesh": [
                {"teeth": {f"s{k}": a, f"s{k + 1}": -b if internal else b}} for k, (a, b, internal) in enumerate(stages)
            ],
        }
        kinematics = solved(table)
        assert kinematics.dof == 1
        expected = [
            math.prod((F(a, b if internal else -b) for a, b, internal in stages[:k]), start=F(1)) for k in range(7)
        ]
        for k in range(len(stages) + 1):
            assert speed(kinematics, f"s{k}") == expected[k]  # exactly
        # and asked from the other end
        last = f"s{len(stages)}"
        assert speed(kinematics, "s0", **{last: F(1)}) == 1 / expected[len(stages)]


class TestPlanetary:
    def test_a_planet_axis_that_points_backwards(self):
        # along the reversed axis the planet counts the other way, so both of its meshes change their signs
        axes = PLANETARY["axes"] | {"planet": PLANETARY["axes"]["planet"] | {"direction": [-1, 0, 0]}}
        mesh = [{"teeth": {"sun": 27, "planet": -36}}, {"teeth": {"planet": 36, "ring": 99}}]
        kinematics = solved(PLANETARY, axes=axes, mesh=mesh, rigid=[["housing", "ring"]])
        assert speed(kinematics, "carrier") == F(3, 14)
        assert speed(kinematics, "planet 1") == -(F(3, 14) - F(33, 56))
        np.testing.assert_allclose(kinematics.vectors().sel(link="planet 1"), [3 / 14 - 33 / 56, 0, 0], atol=1e-15)

    @pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
    @given(
        sun=st.integers(10, 200),
        planet=st.integers(10, 200),
        copies=st.integers(2, 7),
        sun_speed=st.fractions(-9, 9, max_denominator=99),
        ring_speed=st.fractions(-9, 9, max_denominator=99),
    )
    def test_willis_for_any_two_speeds(self, sun, planet, copies, sun_speed, ring_speed):
        ring = sun + 2 * planet
        kinematics = solved(planetary(sun, planet, ring, copies=copies))
        assert kinematics.dof == 2
        speeds = {"sun": sun_speed, "ring": ring_speed}
        carrier = speed(kinematics, "carrier", **speeds)
        assert carrier == (sun * sun_speed + ring * ring_speed) / (sun + ring)
        spin = kinematics.relative_speed(f"planet {copies}", seen_from="carrier", speeds=speeds)
        assert spin == F(sun, planet) * (carrier - sun_speed)

    @pytest.mark.parametrize(
        "links", [["carrier", "big", "small"], ["carrier", "big"], ["carrier", "small"]], ids=["both", "big", "small"]
    )
    def test_stepped_planets_are_joined_copy_by_copy(self, links):
        axes = STEPPED["axes"] | {"planets": {"links": links, "copies": 3}}
        kinematics = solved(STEPPED, axes=axes)
        # (w_s - w_c) / (0 - w_c) = -(40/20) (78/18)
        assert speed(kinematics, "carrier") == 1 / (1 + F(40, 20) * F(78, 18))
        assert kinematics.relative_speed("big 3", seen_from="small 3") == 0
        assert kinematics.bodies["small 2"] == "big 2"


class TestSpeeds:
    @pytest.mark.parametrize(
        ("speeds", "words"),
        [
            (
                {"left wheel": 1},
                r"has 2 degrees of freedom; .* \(left wheel\) leave 1 degree undetermined. Also give the",
            ),
            ({}, "leave 2 degrees undetermined"),
            (CORNER | {"drive shaft": F(-141)}, 'imply -140 for "drive shaft", but it is given as -141'),
            ({"car": 1, "cage": 1, "left wheel": 1}, "contradict"),  # the frame does not rotate
            ({"cag": 1}, 'no link "cag"; did you mean "cage"'),
            ({"planet a": 1, "cage": 1}, "relative to the carrier, or vectors"),
        ],
    )
    def test_refused(self, speeds, words):
        with pytest.raises(GearboxError, match=words):
            solve_kinematics(load_gearbox("car-differential")).rates(speeds)

    def test_no_reference(self):
        with pytest.raises(GearboxError, match="declares no reference"):
            solve_kinematics(load_gearbox("car-differential").changed(reference=None)).rates()


def pair(a, b, **changes):
    """Two gears on shafts of their own."""
    axes = {name: ["h", name] for name in "ab"}
    return {"frame": "h", "reference": "a", "axes": axes, "mesh": [{"teeth": {"a": a, "b": b}}]} | changes


HELD = PLANETARY | {"rigid": [["housing", "ring"]]}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (pair(-20, -40), 'mesh "a-b": a = -20 and b = -40 are both internal gears'),
        (pair(40, -20), 'mesh "a-b": the internal gear b = -20 has no room for a = 40'),
        (pair(40, -40), "the internal gear b = -40 has no room for a = 40"),
        (
            pair(40, 40, axes={n: {"links": ["h", n], "direction": [x, 0, 0]} for n, x in (("a", 1), ("b", -1))}),
            "has no room for",
        ),
        (planetary(60, 20, 50, copies=3), "no room for planets between a sun of 60 and a ring of 50 teeth"),
        (
            pair(20, 41, bearing=[{"name": "c", "inner_ring": "a", "outer_ring": "b", "bearing": "SKF 6205-2RS JEM"}]),
            'inner_ring = "a" is on a and outer_ring = "b" on b, which are not coaxial',
        ),
        (
            HELD
            | {"axes": {"1": ["housing", "sun", "ring", "carrier"], "2": ["carrier", "arm"], "3": ["arm", "planet"]}},
            r'"sun-planet": no link carries both gears.*sun is coaxial with .*, planet with \{arm\}.*carrier = "',
        ),
        # either arm could carry the mesh of a with b
        (
            pair(20, 41, axes={"main": ["h", "arm", "a", "b"]}),
            r'mesh "a-b": both gears are on the same axis .* each of \{arm, h\}',
        ),
        (
            HELD | {"mesh": [{"teeth": {"sun": 27, "planet": 36}, "carrier": "housing"}]},
            'the carrier "housing" does not hold "planet 1"',
        ),
        (
            HELD | {"axes": HELD["axes"] | {"lost": ["moon", "star"]}},
            'nothing holds "moon"; put it on an axis that leads to the frame "housing"',
        ),
        (
            HELD | {"axes": HELD["axes"] | {"again": ["housing", "shaft"], "round": ["shaft", "sun"]}},
            r'"(sun|shaft)" is held twice',
        ),
    ],
)
def test_what_is_no_mechanism(table, words):
    with pytest.raises(GearboxError, match=words):
        solved(table)
