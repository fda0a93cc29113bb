"""The complete solver: imposed speeds, axes that cannot mesh, and planets that do not fit."""

from fractions import Fraction

import gearboxes
import pytest

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning

PLANETARY = {"name": "p"} | gearboxes.PLANETARY


SHEET = {"inner": 9.5, "outer": 6.5, "cage": 0.4, "element_spin": 3.0}


def solved(table=PLANETARY, **how):
    return solve_kinematics(Gearbox.from_mapping(table), **how)


class TestFixedAndConstrained:
    def test_constraint_between_two_links(self):
        # a belt outside the box makes the ring turn at half the sun's speed: 27 s + 99 r = 126 c
        kinematics = solved(constraints=[{"ring": 2, "sun": -1}])
        assert kinematics.relative_speed("carrier", seen_from="housing") == Fraction(27 * 2 + 99, 2 * 126)

    def test_too_many_that_agree_are_welcome(self):
        kinematics = solved()
        speeds = {"carrier": 1.0, "planet 1": -2.0, "planet 3": -2.0, "sun": 5.0}
        assert kinematics.relative_speed("ring", seen_from="housing", speeds=speeds) == 1 - Fraction(36 * 3, 99)

    def test_contradiction_names_only_those_that_fight(self):
        # planets 1 and 2 contradict each other; the carrier has no part in it
        with pytest.raises(GearboxError, match=r'"planet 1" = -2 imply -2 for "planet 2", but it is given as -3'):
            solved().rates({"carrier": 1.0, "planet 1": -2.0, "planet 2": -3.0})

    def test_floats_may_agree_to_rounding(self):
        kinematics = solved(fixed=["ring"])
        kinematics.rates({"sun": 1.0, "carrier": 27 / 126})
        with pytest.raises(GearboxError, match="contradict"):
            kinematics.rates({"sun": 1.0, "carrier": 27 / 126 * (1 + 1e-6)})

    def test_a_loop_that_locks_part_of_a_gearbox(self):
        # three gears in a ring hold the planetary's ring gear; sun and carrier still turn
        table = {**PLANETARY, "axes": {**PLANETARY["axes"], "x": ["housing", "x"], "y": ["housing", "y"]}}
        loop = [{"teeth": {a: 20, b: 20}} for a, b in (("ring", "x"), ("x", "y"), ("y", "ring"))]
        with pytest.raises(GearboxError, match=r'"[xy]|ring" cannot move: .*"ring-x".*"x-y".*"y-ring"'):
            solved({**table, "mesh": [*PLANETARY["mesh"], *loop]})


def pair(**changes):
    table = {
        "name": "pair",
        "frame": "h",
        "reference": "a",
        "axes": {
            "one": {"links": ["h", "a"], "direction": [1, 0, 0], "through": [0, 0, 0]},
            "two": {"links": ["h", "b"], "direction": [0, 1, 0], "through": [0, 0, 0]},
        },
        "mesh": [{"teeth": {"a": 2, "b": 40}}],
    }
    table["axes"]["two"].update(changes.pop("two", {}))
    table["mesh"][0].update(changes)
    return table


class TestAxesThatMesh:
    def test_axes_that_pass_each_other(self):
        with pytest.raises(
            GearboxError, match=r'mesh "a-b": its axes neither intersect nor are parallel \(they are 50 apart\)'
        ):
            solved(pair(two={"through": [0, 0, 50]}))

    @pytest.mark.parametrize("kind", ["worm", "crossed_helical"])
    def test_crossing_axes_declared_as_such(self, kind):
        # a worm of two starts
        kinematics = solved(pair(two={"through": [0, 0, 50]}, kind=kind))
        assert kinematics.relative_speed("b", seen_from="h") == Fraction(-1, 20)

    @pytest.mark.parametrize("kind", ["worm", "crossed_helical"])
    def test_parallel_axes_are_no_worm(self, kind):
        with pytest.raises(GearboxError, match="needs axes that cross"):
            solved(pair(two={"direction": [1, 0, 0]}, kind=kind))

    @pytest.mark.parametrize("kind", ["belt", "chain"])
    def test_belts_and_chains_need_parallel_axes(self, kind):
        with pytest.raises(GearboxError, match="needs parallel axes"):
            solved(pair(kind=kind))
        # an open belt turns both pulleys the same way: opposite signs
        table = pair(two={"direction": [1, 0, 0]}, kind=kind)
        table["mesh"][0]["teeth"] = {"a": 20, "b": -40}
        assert solved(table).relative_speed("b", seen_from="h") == Fraction(1, 2)

    def test_several_mechanisms_in_one_file(self):
        table = pair(two={"direction": [1, 0, 0]})
        table["axes"] |= {"three": ["h", "c"], "four": ["h", "d"]}
        table["mesh"].append({"teeth": {"c": 20, "d": 30}})
        with pytest.raises(GearboxError, match=r"2 mechanisms that share only the frame \(a, b; and c, d\)"):
            solved(table)


class TestBearingsInOneBody:
    @pytest.mark.parametrize(
        ("inner", "outer", "words"),
        [
            ("ring", "housing", '"ring" and outer_ring = "housing" are rigid with each other, so it cannot rotate'),
            ("pin", "carrier", '"pin" and outer_ring = "carrier" are rigid with each other'),
        ],
    )
    def test_refused(self, inner, outer, words):
        bearing = {"name": "x", "inner_ring": inner, "outer_ring": outer, "multiples": SHEET}
        # the pin is held to the carrier by way of a third link
        rigid = [["housing", "ring"], ["pin", "cheek"], ["cheek", "carrier"]]
        with pytest.raises(GearboxError, match=f'bearing "x": inner_ring = {words}'):
            solved(PLANETARY | {"rigid": rigid, "bearing": [bearing]})


class TestPlanetsThatDoNotFit:
    @staticmethod
    def planets(**axis):
        table = {**PLANETARY, "rigid": [["housing", "ring"]]}
        table["axes"] = {**PLANETARY["axes"], "planet": {"links": ["carrier", "planet"], **axis}}
        return table

    def test_gaps_and_angles_mean_the_same(self):
        # neither gaps nor angles in whole multiples of 360 / 126 degrees: one warning each, of the planets in between
        for spacing in ([0, 91.43, 180, 271.43], [91.43, 88.57, 91.43, 88.57]):
            with pytest.warns(GearboxWarning) as caught:
                Gearbox.from_mapping(self.planets(copies=4, spacing_deg=spacing))
            assert len(caught) == 1

    def test_neighbours_touch(self):
        # (27 + 36) sin(pi / 6) = 31.5 modules between centres, tips need 38
        with pytest.warns(GearboxWarning, match=r"touch: tip circles of 36 \+ 2 modules, centres 31.5 modules apart"):
            Gearbox.from_mapping(self.planets(copies=6))

    @staticmethod
    def coaxial(sun, planet, ring, *, copies=3, modules=(None, None)):
        meshes = [{"teeth": {"sun": sun, "planet": planet}}, {"teeth": {"planet": planet, "ring": ring}}]
        planets = {"links": ["carrier", "planet"]} | ({} if copies is None else {"copies": copies})
        return PLANETARY | {
            "axes": {**PLANETARY["axes"], "planet": planets},
            "mesh": [
                mesh if module is None else mesh | {"module_mm": module}
                for mesh, module in zip(meshes, modules, strict=True)
            ],
        }

    @pytest.mark.parametrize("copies", [3, None])
    def test_a_forgotten_minus(self, copies):
        Gearbox.from_mapping(self.coaxial(21, 39, -99, copies=copies))
        with pytest.warns(GearboxWarning) as caught:
            Gearbox.from_mapping(self.coaxial(21, 39, 99, copies=copies))
        (warning,) = caught
        assert str(warning.message) == (
            'planets "planet": sun and ring are coaxial and both mesh with planet by external teeth, but '
            "21 + 39 = 60 is not 99 + 39 = 138: internal teeth are negative, did you mean ring = -99?"
        )

    def test_a_small_difference_is_no_forgotten_minus(self):
        # Ferguson's paradox: gears of 99 and 101 teeth that one planet drives
        with pytest.warns(
            GearboxWarning, match=r"99 \+ 20 = 119 is not 101 \+ 20 = 121: the meshes need profile shift"
        ):
            Gearbox.from_mapping(self.coaxial(99, 20, 101))

    def test_outer_gears_at_one_distance_are_silent(self):
        Gearbox.from_mapping(self.coaxial(60, 20, 60))
        # 3 (21 + 39) = 2 (51 + 39): two gears of the planet, cut with two modules
        Gearbox.from_mapping(self.coaxial(21, 39, 51, modules=(3, 2)))
