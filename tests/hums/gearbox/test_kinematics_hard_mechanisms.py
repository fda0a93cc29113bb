"""Mechanisms that break solvers in floating point, or solvers that trust what they are given."""

from fractions import Fraction as F  # noqa: N817
from itertools import pairwise

import pytest

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError


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


def test_an_even_loop_turns():
    """Three gears in a ring lock each other, four need not: all products of teeth round it are one."""
    teeth = {"a": 20, "b": 25, "c": 31, "d": 47}
    axes = {name: ["h", name] for name in teeth}
    mesh = [{"teeth": {x: teeth[x], y: teeth[y]}} for x, y in pairwise("abcda")]
    kinematics = solved({"frame": "h", "reference": "a", "axes": axes, "mesh": mesh})
    assert [speed(kinematics, name) for name in teeth] == [1, F(-20, 25), F(20, 31), F(-20, 47)]


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
