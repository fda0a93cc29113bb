"""Velocity ratios against gear trains worked by hand, Willis' formula and the printed examples of the papers."""

import math
import random
from fractions import Fraction as F  # noqa: N817
from itertools import pairwise

import numpy as np
import pytest
from gearboxes import STEPPED
from hypothesis import given
from hypothesis import strategies as st

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, load_gearbox

ALOUETTE = {
    "name": "Alouette III main gearbox",
    "frame": "housing",
    "reference": "input",
    "axes": {
        "mast": {"direction": [0, 1, 0], "links": ["housing", "main shaft", "lower carrier", "upper carrier"]},
        "input": {"direction": [1, 0, 0], "links": ["housing", "input"]},
        "tail": {"direction": [1, 0, 0], "links": ["housing", "tail"]},
        "lower planet": {"parallel_to": "mast", "links": ["lower carrier", "lower planet"]},
        "upper planet": {"parallel_to": "mast", "links": ["upper carrier", "upper planet"]},
    },
    "mesh": [
        {"teeth": {"input": 20, "main shaft": -41}},
        {"teeth": {"main shaft": -17, "tail": 20}},
        {"teeth": {"main shaft": 51, "lower planet": 21}},
        {"teeth": {"lower planet": 21, "housing": -93}},
        {"teeth": {"lower carrier": 51, "upper planet": 21}},
        {"teeth": {"upper planet": 21, "housing": -93}},
    ],
}
# Penaud and Alazard 2010, example 2; 2012, figure 2. Links 1 to 7: car, drive shaft, wheels, pinions, cage.
DIFFERENTIAL = {
    "name": "car differential",
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
}
# Penaud and Alazard 2010, example 1, after Nelson and Cipra 2005: the planet's axis at pi/3 to the main one.
BEVEL_PLANET = {
    "name": "simple bevel planet",
    "frame": "sun",
    "reference": "ring",
    "axes": {
        "main": {"direction": [1, 0, 0], "links": ["sun", "ring", "carrier"]},
        "planet": {"direction": [math.cos(math.pi / 3), math.sin(math.pi / 3), 0], "links": ["carrier", "planet"]},
    },
    "mesh": [{"teeth": {"sun": 15, "planet": 10}}, {"teeth": {"ring": -25, "planet": 10}}],
}


def solved(table, **changes):
    return solve_kinematics(Gearbox.from_mapping({"name": "box"} | table | changes))


def planetary(*, frame="housing", rigid=(), sun=27, planet=36, ring=99, copies=3):
    """Sun, planets, carrier and ring about one line; nothing held but the frame."""
    return {
        "frame": frame,
        "reference": "sun",
        "rigid": rigid,
        "axes": {
            "main": ["housing", "sun", "ring", "carrier"],
            "planet": {"links": ["carrier", "planet"], "copies": copies},
        },
        "mesh": [{"teeth": {"sun": sun, "planet": planet}}, {"teeth": {"planet": planet, "ring": -ring}}],
    }


def speed(kinematics, link, **speeds):
    return kinematics.relative_speed(link, seen_from=kinematics.gearbox.frame, speeds=speeds or None)


class TestParallel:
    def test_two_stages_by_hand(self):
        kinematics = solve_kinematics(load_gearbox("two-stage"))
        assert kinematics.dof == 1
        assert speed(kinematics, "pinion") == 1  # rigid with the input
        assert speed(kinematics, "intermediate") == F(-23, 67)
        assert speed(kinematics, "output") == F(23 * 19, 67 * 61)
        assert kinematics.carriers == ("housing", "housing")

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

    def test_a_mate_that_is_unknown_binds_nothing(self):
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {"one": ["h", "a"], "two": ["h", "b"]},
            "mesh": [{"teeth": {"a": 20, "b": 41}}, {"teeth": {"b": 17}, "carrier": "h"}],
        }
        kinematics = solved(table)
        assert kinematics.dof == 1
        assert speed(kinematics, "b") == F(-20, 41)
        assert kinematics.contacts[1].gears == (("b", 17),)


class TestPlanetary:
    def test_27_36_99_by_willis(self):
        kinematics = solve_kinematics(load_gearbox("planetary-27-36-99"))
        # (w_s - w_c) / (0 - w_c) = -99/27, so w_c = 27/126
        assert speed(kinematics, "carrier") == F(27, 126)
        for number in (1, 2, 3):
            # the sun passes the carrier at 11/14 and drives 36 teeth with 27
            assert kinematics.relative_speed(f"planet {number}", seen_from="carrier") == -F(11, 14) * F(27, 36)
            assert speed(kinematics, f"planet {number}") == F(3, 14) - F(33, 56)
        assert kinematics.dof == 1
        assert kinematics.carriers == ("carrier",) * 6

    @pytest.mark.parametrize(
        ("held", "link", "expected"),
        [
            ("ring", "carrier", F(27, 27 + 99)),
            ("carrier", "ring", F(-27, 99)),
            ("sun", "carrier", F(99, 27 + 99)),  # counted by the ring
        ],
    )
    def test_each_part_held_in_turn(self, held, link, expected):
        table = planetary(rigid=[["housing", held]])
        kinematics = solved(table, reference="ring" if held == "sun" else "sun")
        assert speed(kinematics, link) == expected

    def test_a_body_that_is_part_of_the_frame_has_the_frames_name(self):
        kinematics = solved(planetary(rigid=[["ring", "housing"]]))
        assert kinematics.bodies["ring"] == "housing"
        assert set(kinematics.joints) == {"sun", "carrier", "planet 1", "planet 2", "planet 3"}

    def test_a_planet_axis_that_points_backwards(self):
        # along the reversed axis the planet counts the other way, so both of its meshes change their signs
        table = planetary(rigid=[["housing", "ring"]])
        table["axes"]["planet"]["direction"] = [-1, 0, 0]
        table["mesh"] = [{"teeth": {"sun": 27, "planet": -36}}, {"teeth": {"planet": 36, "ring": 99}}]
        kinematics = solved(table)
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
        kinematics = solved(planetary(sun=sun, planet=planet, ring=ring, copies=copies))
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


class TestPapers:
    def test_alouette_ratios(self):
        kinematics = solved(ALOUETTE)
        assert kinematics.dof == 1
        # 2012, eq. 9 prints 0.488, 0.415, 0.173, 0.0612; exact from the teeth
        assert speed(kinematics, "main shaft") == F(20, 41)
        assert speed(kinematics, "tail") == F(17, 41)
        assert speed(kinematics, "lower carrier") == F(85, 492)
        assert speed(kinematics, "upper carrier") == F(1445, 23616)

    def test_alouette_carriers(self):
        # 2012, table 4, in the order of the meshes above: 2-3, 3-4, 3-6, 1-6, 5-8, 1-8
        assert solved(ALOUETTE).carriers == (
            "housing",
            "housing",
            "lower carrier",
            "lower carrier",
            "upper carrier",
            "upper carrier",
        )

    def test_alouette_velocity_ratio_vector(self):
        ratios = solved(ALOUETTE).velocity_ratios()
        links = [
            "housing",
            "input",
            "main shaft",
            "tail",
            "lower carrier",
            "lower planet",
            "upper carrier",
            "upper planet",
        ]
        printed = np.array([0, 1, 0.488j, 0.415, 0.173j, -0.592j, 0.0612j, -0.210j])
        # half a unit of the third printed decimal
        np.testing.assert_allclose(ratios.sel(link=links, input="input"), printed, rtol=0, atol=5e-4)

    def test_differential_velocity_ratio_matrix(self):
        kinematics = solved(DIFFERENTIAL)
        assert kinematics.dof == 2
        assert kinematics.carriers == ("car", "cage", "cage", "cage", "cage")
        links = ["car", "drive shaft", "left wheel", "right wheel", "upper pinion", "lower pinion", "cage"]
        ratios = kinematics.velocity_ratios(["left wheel", "right wheel"]).sel(link=links).to_numpy()
        # 2012, eq. 6, the form on the right: 14/10 and 1/2 are exact, so rounding alone is allowed
        left = np.array([0, -2.5, 1, 0, 0.5 + 0.7j, 0.5 - 0.7j, 0.5])
        right = np.array([0, -2.5, 0, 1, 0.5 - 0.7j, 0.5 + 0.7j, 0.5])
        np.testing.assert_allclose(ratios, np.stack([left, right], axis=1), rtol=0, atol=1e-15)
        # straight ahead: seven components (errata); wheels against each other, eq. 7
        np.testing.assert_allclose(ratios @ [1, 1], [0, -5, 1, 1, 1, 1, 1], atol=1e-15)
        np.testing.assert_allclose(ratios @ [1, -1], [0, 0, 1, -1, 1.4j, -1.4j, 0], atol=1e-15)
        # turning right, eq. 8: two decimals printed
        turning = ratios @ [26, 30]
        np.testing.assert_allclose(np.abs(turning), [0, 140, 26, 30, 28.14, 28.14, 28], atol=5e-3)
        np.testing.assert_allclose(np.angle(turning[4:6]), [-0.10, 0.10], atol=5e-3)

    def test_bevel_planet(self):
        kinematics = solved(BEVEL_PLANET)
        assert speed(kinematics, "carrier") == F(5, 8)  # 2010: w_2 = 1.6 w_4
        assert kinematics.relative_speed("planet", seen_from="carrier") == F(15, 16)  # 0.9375, eq. 12
        ratios = kinematics.velocity_ratios()
        planet, carrier = (complex(ratios.sel(link=link, input="ring")) for link in ("planet", "carrier"))
        # the relative velocity lies along alpha = pi/3 (errata: not pi/4); products of rounded cosines
        assert planet - carrier == pytest.approx(0.9375 * np.exp(1j * np.pi / 3), abs=1e-15)
        # eq. 11 prints 1.36 at 0.639
        assert abs(planet) == pytest.approx(1.36, abs=5e-3)
        assert np.angle(planet) == pytest.approx(0.639, abs=5e-4)

    def test_vectors_out_of_the_plane_have_no_complex_form(self):
        axes = DIFFERENTIAL["axes"] | {
            "pinions": {"direction": [0, 0, 1], "links": DIFFERENTIAL["axes"]["pinions"]["links"]}
        }
        kinematics = solved(DIFFERENTIAL, axes=axes)
        speeds = {"left wheel": F(1), "right wheel": F(-1)}
        np.testing.assert_allclose(kinematics.vectors(speeds).sel(link="upper pinion"), [0, 0, 1.4], atol=1e-15)
        with pytest.raises(GearboxError, match=r"use vectors\(\)"):
            kinematics.velocity_ratios(["left wheel", "right wheel"])


class TestSpeeds:
    def test_too_few(self):
        kinematics = solved(DIFFERENTIAL)
        with pytest.raises(
            GearboxError, match=r"has 2 degrees of freedom; .* \(left wheel\) leave 1 degree open. Give the"
        ):
            kinematics.rates({"left wheel": 1})
        with pytest.raises(GearboxError, match="leave 2 degrees open"):
            kinematics.rates({})

    def test_contradictory(self):
        kinematics = solved(DIFFERENTIAL)
        speeds = {"left wheel": F(26), "right wheel": F(30), "drive shaft": F(-141)}
        with pytest.raises(GearboxError, match='make "drive shaft" turn at -140, but it is given as -141'):
            kinematics.rates(speeds)
        # the third speed that follows from the two is welcome
        assert speed(kinematics, "cage", **(speeds | {"drive shaft": F(-140)})) == 28

    def test_the_frame_does_not_turn(self):
        kinematics = solved(DIFFERENTIAL)
        assert speed(kinematics, "cage", car=0, cage=F(3), **{"left wheel": F(1)}) == 3
        with pytest.raises(GearboxError, match="contradict"):
            kinematics.rates({"car": 1, "cage": 1, "left wheel": 1})

    @pytest.mark.parametrize("bad", [float("nan"), float("inf"), True, "3", None])
    def test_what_is_no_speed(self, bad):
        with pytest.raises(GearboxError, match=r'"pinion" = .* is not a finite number'):
            solve_kinematics(load_gearbox("two-stage")).rates({"pinion": bad})

    @pytest.mark.parametrize("kind", [int, float, F, np.float64, np.float32, np.int64])
    def test_any_kind_of_number(self, kind):
        kinematics = solve_kinematics(load_gearbox("two-stage"))
        assert speed(kinematics, "output", input=kind(67 * 61)) == 23 * 19

    def test_unknown_link(self):
        kinematics = solve_kinematics(load_gearbox("two-stage"))
        with pytest.raises(GearboxError, match='no link "pinoin"; did you mean "pinion"'):
            kinematics.rates({"pinoin": 1})

    def test_no_reference(self):
        table = {key: value for key, value in DIFFERENTIAL.items() if key != "reference"}
        with pytest.raises(GearboxError, match="declares no reference"):
            solved(table).rates()

    def test_one_number_cannot_say_how_fast_a_bevel_planet_turns(self):
        with pytest.raises(GearboxError, match="relative to its carrier, or use vectors"):
            solved(DIFFERENTIAL).rates({"upper pinion": 1, "cage": 1})


class TestNoMechanism:
    BASE = planetary(rigid=[["housing", "ring"]])

    @pytest.mark.parametrize(
        ("teeth", "directions", "words"),
        [
            ((-20, -40), (1, 1), 'mesh "a-b": a = -20 and b = -40 are both internal gears'),
            ((40, -20), (1, 1), 'mesh "a-b": the internal gear b = -20 has no room for a = 40'),
            ((40, -40), (1, 1), "the internal gear b = -40 has no room for a = 40"),
            ((40, 40), (1, -1), "has no room for"),
        ],
    )
    def test_gears_that_cannot_stand_inside_each_other(self, teeth, directions, words):
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {
                name: {"links": ["h", name], "direction": [sense, 0, 0]}
                for name, sense in zip("ab", directions, strict=True)
            },
            "mesh": [{"teeth": dict(zip("ab", teeth, strict=True))}],
        }
        with pytest.raises(GearboxError, match=words):
            solved(table)

    def test_a_ring_without_room_for_planets(self):
        with pytest.raises(GearboxError, match="between a sun of 60 and a ring of 50 teeth is no room for any"):
            solved(planetary(sun=60, planet=20, ring=50))

    def test_a_bearing_between_shafts_side_by_side(self):
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {name: ["h", name] for name in "ab"},
            "mesh": [{"teeth": {"a": 20, "b": 41}}],
            "bearing": [{"names": ["c"], "inner_ring": "a", "outer_ring": "b", "bearing": "SKF 6205-2RS JEM"}],
        }
        with pytest.raises(GearboxError, match='inner_ring = "a" turns on a and outer_ring = "b" on b, so no line'):
            solved(table)

    def test_no_carrier(self):
        axes = {"main": ["housing", "sun", "ring", "carrier"], "arm": ["carrier", "arm"], "planet": ["arm", "planet"]}
        with pytest.raises(GearboxError) as caught:
            solved(self.BASE, axes=axes)
        message = str(caught.value)
        assert 'mesh "sun-planet": no link carries both gears' in message
        assert "sun turns on {carrier, housing}, planet on {arm}" in message
        assert 'carrier = "..."' in message

    def test_two_possible_carriers(self):
        # shafts a and b, and two arms, all on one line: either arm could carry the mesh of a with b
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {"main": ["h", "arm", "a", "b"]},
            "mesh": [{"teeth": {"a": 20, "b": 41}}],
        }
        with pytest.raises(GearboxError, match=r'mesh "a-b": both gears turn about one line .* each of \{arm, h\}'):
            solved(table)

    def test_a_carrier_that_does_not_hold_a_gear(self):
        meshes = [{"teeth": {"sun": 27, "planet": 36}, "carrier": "housing"}]
        with pytest.raises(GearboxError, match='the carrier "housing" does not hold "planet 1"'):
            solved(self.BASE, mesh=meshes)

    def test_a_link_nobody_holds(self):
        axes = self.BASE["axes"] | {"lost": ["moon", "star"]}
        with pytest.raises(
            GearboxError, match='nothing holds "moon"; put it on an axis that leads to the frame "housing"'
        ):
            solved(self.BASE, axes=axes)

    def test_a_link_held_twice(self):
        axes = self.BASE["axes"] | {"again": ["housing", "planet shaft"], "round": ["planet shaft", "sun"]}
        with pytest.raises(GearboxError, match=r'"(sun|planet shaft)" is held twice'):
            solved(self.BASE, axes=axes)

    def test_a_mechanism_that_cannot_move(self):
        # three gears in a ring, each turning its neighbour the other way
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {name: ["h", name] for name in "abc"},
            "mesh": [{"teeth": {x: 20, y: 20}} for x, y in pairwise("abca")],
        }
        with pytest.raises(GearboxError, match='cannot move: it is locked by mesh "b-c", mesh "a-b", mesh "c-a"'):
            solved(table)
        # four of them turn
        table |= {"axes": {name: ["h", name] for name in "abcd"}}
        table |= {"mesh": [{"teeth": {x: 20, y: 20}} for x, y in pairwise("abcda")]}
        assert speed(solved(table), "c") == 1


class TestOrderOfDeclaration:
    @pytest.mark.parametrize(
        "table",
        [ALOUETTE, DIFFERENTIAL, STEPPED],
        ids=["alouette", "differential", "stepped planets"],
    )
    @given(seed=st.integers(0, 2**32))
    def test_it_changes_nothing(self, table, seed):
        draw = random.Random(seed)  # noqa: S311
        speeds = {"left wheel": F(3), "right wheel": F(7)} if table is DIFFERENTIAL else None

        def shuffled(items):
            items = list(items)
            return draw.sample(items, len(items))

        def links(body):
            return body | {"links": shuffled(body["links"])} if isinstance(body, dict) else shuffled(body)

        mixed = dict(shuffled(table.items())) | {
            "axes": {name: links(body) for name, body in shuffled(table["axes"].items())},
            "mesh": [
                mesh | {"teeth": dict(shuffled(mesh["teeth"].items())), "name": "-".join(mesh["teeth"])}
                for mesh in shuffled(table["mesh"])
            ],
        }
        before, after = solved(table), solved(mixed)
        assert set(after.links) == set(before.links)
        assert after.dof == before.dof
        assert after.bodies == before.bodies
        assert after.joints == before.joints
        assert after.rates(speeds) == before.rates(speeds)
        assert {(c.mesh, frozenset(c.gears), c.carrier) for c in after.contacts} == {
            (c.mesh, frozenset(c.gears), c.carrier) for c in before.contacts
        }
