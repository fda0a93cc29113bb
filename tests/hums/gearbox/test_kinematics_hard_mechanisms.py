"""Mechanisms that break solvers in floating point, or solvers that trust what they are given."""

from fractions import Fraction as F  # noqa: N817
from itertools import pairwise

import numpy as np
import pytest
from gearboxes import planetary

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, load_gearbox


def solved(table):
    return solve_kinematics(Gearbox.from_mapping({"name": "box"} | table))


def speed(kinematics, link, **speeds):
    return kinematics.relative_speed(link, seen_from=kinematics.gearbox.frame, speeds=speeds or None)


class TestWolfrom:
    """Two products that differ by one part in 13,351 make the ratio; three sets in a row make 2.3e15."""

    RATIO = F(1321749, 10)

    def table(self, sets):
        """Several sets in a row: output ring k is sun k + 1."""
        main = ["housing", *(f"s{k}" for k in range(sets + 1)), *(f"carrier {k}" for k in range(sets))]
        axes = {"main": main}
        mesh = []
        for k in range(sets):
            axes[f"axis {k}"] = {"links": [f"carrier {k}", f"big {k}", f"small {k}"], "copies": 3}
            mesh += [
                {"teeth": {f"s{k}": 20, f"big {k}": 79}},
                {"teeth": {f"big {k}": 79, "housing": -178}},
                {"teeth": {f"small {k}": 75, f"s{k + 1}": -169}},
            ]
        rigid = [[f"big {k}", f"small {k}"] for k in range(sets)]
        return {"frame": "housing", "reference": "s0", "rigid": rigid, "axes": axes, "mesh": mesh}

    @pytest.mark.parametrize("sets", [1, 10])
    def test_exactly(self, sets):
        kinematics = solved(self.table(sets))
        assert speed(kinematics, "s0", **{f"s{sets}": F(1)}) == self.RATIO**sets
        assert speed(kinematics, f"s{sets}") == 1 / self.RATIO**sets


class TestRedundantPlanets:
    TABLE = planetary(200, 20, 240, copies=20)

    def test_twenty_planets_are_no_constraint(self):
        kinematics = solved(self.TABLE)  # (200 + 240) / 20 is whole, so no warning either
        assert len(kinematics.contacts) == 40
        assert kinematics.dof == 2
        given = {"sun": F(3), "ring": F(-7)}
        carrier = F(200 * 3 - 240 * 7, 440)
        assert speed(kinematics, "carrier", **given) == carrier
        spins = {kinematics.relative_speed(f"planet {k + 1}", seen_from="carrier", speeds=given) for k in range(20)}
        assert spins == {-10 * (3 - carrier)}


class TestLockedLoop:
    """Three external gears in a ring: each would have to turn against both others."""

    LOOP = tuple(pairwise("abca"))

    def table(self, **signs):
        return {
            "frame": "h",
            "reference": "a",
            "axes": {name: ["h", name] for name in "abc"},
            "mesh": [{"teeth": {x: 20, y: 25 * signs.get(x + y, 1)}} for x, y in self.LOOP],
        }

    def test_it_cannot_move(self):
        with pytest.raises(GearboxError, match="cannot move") as caught:
            solved(self.table())
        for x, y in self.LOOP:
            assert f'"{x}-{y}"' in str(caught.value)

    def test_teeth_that_do_not_close_lock_it_too(self):
        # one internal mesh: the senses agree, but 20/25 three times round is not 1
        with pytest.raises(GearboxError, match="cannot move"):
            solved(self.table(ca=-1))

    def test_an_even_loop_turns(self):
        teeth = {"a": 20, "b": 25, "c": 31, "d": 47}
        table = {
            "frame": "h",
            "reference": "a",
            "axes": {name: ["h", name] for name in teeth},
            "mesh": [{"teeth": {x: teeth[x], y: teeth[y]}} for x, y in pairwise("abcda")],
        }
        kinematics = solved(table)
        assert [speed(kinematics, name) for name in teeth] == [1, F(-20, 25), F(20, 31), F(-20, 47)]


class TestLongTrain:
    def test_a_thousand_links_exactly(self):
        teeth = [(17 + k % 11, 40 + k % 29) for k in range(999)]
        kinematics = solved(
            {
                "frame": "housing",
                "reference": "s0",
                "axes": {f"axis {k}": ["housing", f"s{k}"] for k in range(1000)},
                "mesh": [{"teeth": {f"s{k}": a, f"s{k + 1}": b}} for k, (a, b) in enumerate(teeth)],
            }
        )
        rates = kinematics.rates()
        expected = F(1)
        for k, (a, b) in enumerate(teeth):
            expected *= F(-a, b)
            assert rates[f"s{k + 1}"] == expected
        assert 0 < abs(expected) < F(1, 10**300)  # no float holds it


class TestAxesInSpace:
    """Bevel axes along x, y and z about one apex: no plane, so no complex number, holds them."""

    TABLE = {  # noqa: RUF012
        "frame": "housing",
        "reference": "first",
        "axes": {
            "one": {"direction": [1, 0, 0], "links": ["housing", "first"]},
            "two": {"direction": [0, 1, 0], "links": ["housing", "second"]},
            "three": {"direction": [0, 0, 1], "links": ["housing", "third"]},
        },
        "mesh": [{"teeth": {"first": 20, "second": 41}}, {"teeth": {"second": 17, "third": -23}}],
    }

    def test_complex_refuses(self):
        kinematics = solved(self.TABLE)
        for call in (kinematics.velocity_ratios, kinematics.velocities):
            with pytest.raises(GearboxError, match=r"use vectors\(\)"):
                call()

    def test_a_spider_with_pins_in_two_directions(self):
        # a differential with four planets: two along y, two along z
        table = {
            "frame": "housing",
            "axes": {
                "main": {"direction": [1, 0, 0], "links": ["housing", "left", "right", "cage"]},
                "pin y": {"direction": [0, 1, 0], "links": ["cage", "up", "down"]},
                "pin z": {"direction": [0, 0, 1], "links": ["cage", "front", "back"]},
            },
            "mesh": [
                {"teeth": {wheel: side * 14, planet: 10 * sign}}
                for wheel, side in (("left", -1), ("right", 1))
                for planet, sign in (("up", 1), ("down", -1), ("front", 1), ("back", -1))
            ],
        }
        kinematics = solved(table)
        assert kinematics.dof == 2
        vectors = kinematics.vectors({"left": F(26), "right": F(30)})
        for link, expected in (
            ("cage", [28, 0, 0]),
            ("up", [28, -2.8, 0]),
            ("down", [28, 2.8, 0]),
            ("front", [28, 0, -2.8]),
            ("back", [28, 0, 2.8]),
        ):
            np.testing.assert_allclose(vectors.sel(link=link), expected, rtol=0, atol=1e-13)

    def test_a_planet_carried_out_of_the_plane(self):
        # the carrier turns about x, its planet about (1, 2, 2) / 3: relative speed exact, vector the sum
        table = {
            "frame": "housing",
            "axes": {
                "main": {"direction": [1, 0, 0], "links": ["housing", "sun", "carrier"]},
                "planet": {"direction": [1, 2, 2], "links": ["carrier", "planet"]},
            },
            "mesh": [{"teeth": {"sun": 15, "planet": 10}}],
        }
        kinematics = solved(table)
        given = {"sun": F(0), "carrier": F(1)}
        assert kinematics.relative_speed("planet", seen_from="carrier", speeds=given) == F(3, 2)
        np.testing.assert_allclose(kinematics.vectors(given).sel(link="planet"), [1.5, 1, 1], rtol=0, atol=1e-15)
        with pytest.raises(GearboxError, match=r"or vectors\(\)"):
            kinematics.relative_speed("planet", seen_from="housing", speeds=given)


def test_two_motors_add_up():
    kinematics = solve_kinematics(load_gearbox("two-motor-split"))
    ratios = kinematics.velocity_ratios(inputs=["motor 1", "motor 2"]).sel(link="carrier")
    np.testing.assert_allclose(ratios, [30 / 108, -78 / 108 * 23 / 96], rtol=1e-14)
    # the output at rest: the motors work against each other, 30 w_s = -78 w_r
    assert speed(kinematics, "motor 2", carrier=F(0), **{"motor 1": F(23)}) == F(30, 78) * 96
    assert set(kinematics.rates({"motor 1": 0, "motor 2": 0}).values()) == {0}
