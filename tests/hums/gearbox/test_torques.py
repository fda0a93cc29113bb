"""Torques, forces and power against gear trains worked by hand, Müller's formulas and the complex matrix."""

import math
import re
from fractions import Fraction as F  # noqa: N817

import numpy as np
import pytest
from gearboxes import PLANETARY
from hypothesis import assume, given
from hypothesis import strategies as st

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, load_gearbox
from hums.gearbox.statics import TorqueError
from hums.gearbox.torques import solve_torques

TURN = 2 * math.pi  # W by 1 N m at one turn a second
RING_FIXED = PLANETARY | {"rigid": [["housing", "ring"]]}
DIFFERENTIAL = {
    "frame": "housing",
    "reference": "pinion",
    "axes": {
        "wheels": {"direction": [1, 0, 0], "links": ["housing", "left", "right", "cage"]},
        "drive": {"direction": [0, 1, 0], "links": ["housing", "pinion"]},
        "planet": {"direction": [0, 1, 0], "links": ["cage", "planet"], "copies": 2},
    },
    "mesh": [
        {"teeth": {"pinion": 13, "cage": 65}},
        {"teeth": {"left": -14, "planet": 10}},
        {"teeth": {"right": 14, "planet": 10}},
    ],
}
# Two planetaries whose carriers are one and whose suns are another shaft: power goes round between them.
COUPLED = {
    "frame": "housing",
    "reference": "carrier",
    "rigid": [["housing", "ring 1"], ["sun 1", "sun 2"]],
    "axes": {
        "main": ["housing", "carrier", "sun 1", "sun 2", "ring 1", "ring 2"],
        "planet a": {"links": ["carrier", "a"], "copies": 3},
        "planet b": {"links": ["carrier", "b"], "copies": 3},
    },
    "mesh": [
        {"teeth": {"sun 1": 30, "a": 30}},
        {"teeth": {"a": 30, "ring 1": -90}},
        {"teeth": {"sun 2": 28, "b": 35}},
        {"teeth": {"b": 35, "ring 2": -98}},
    ],
}
ROUNDING = 1e-12  # of a few dozen operations in double precision


def solved(table, **changes):
    return solve_kinematics(Gearbox.from_mapping({"name": "box"} | table | changes))


def shipped(name):
    return solve_kinematics(load_gearbox(name))


def train(*teeth, **mesh):
    """Shafts s0, s1, ... one after the other: stage k has the given teeth on shafts k and k + 1."""
    return {
        "frame": "h",
        "reference": "s0",
        "axes": {f"axis {k}": ["h", f"s{k}"] for k in range(len(teeth) + 1)},
        "mesh": [{"teeth": {f"s{k}": a, f"s{k + 1}": b}} | mesh for k, (a, b) in enumerate(teeth)],
    }


def balance(result):
    """Power that flows in, less what flows out and what is lost, over the input."""
    through = sum(load.power_w for load in result.external)
    return (through - sum(result.losses_w.values())) / result.input_power_w


class TestTrains:
    def test_a_pair(self):
        result = solve_torques(solved(train((20, 50))), {"s0": 4, "s1": None})
        # at s1 the outside holds against 50/20 of the input; the shafts turn against each other
        assert result.torques_nm == {"s0": 4.0, "s1": 10.0}
        (load,) = result.tooth_loads
        assert load.torques_nm == (-4.0, -10.0)
        assert load.carrier == "h"
        assert load.carrier_torque_nm == (14.0, 0.0, 0.0)
        assert result.frame_torque_nm == (-14.0, 0.0, 0.0)
        assert load.driver == "s0"
        assert load.gearing_power_w == load.absolute_power_w == pytest.approx(4 * TURN, rel=1e-15)
        assert result.input_power_w == result.output_power_w == pytest.approx(4 * TURN, rel=1e-15)
        assert (result.efficiency, result.circulating_ratio, result.gearing_ratio) == (1.0, 1.0, 1.0)
        assert result.indeterminate == ()

    @given(
        stages=st.lists(
            st.tuples(st.integers(5, 200), st.integers(5, 200) | st.integers(-200, -5)), min_size=1, max_size=5
        ),
        torque=st.fractions(-50, 50, max_denominator=20),
        efficiency=st.floats(0.5, 1),
    )
    def test_a_compound_train_is_the_product_of_its_stages(self, stages, torque, efficiency):
        assume(torque)
        stages = [(a, b if b > 0 else b - a) for a, b in stages]
        kinematics = solved(train(*stages))
        last = f"s{len(stages)}"
        result = solve_torques(kinematics, {"s0": torque, last: None}, mesh_efficiency=efficiency)
        ratio = math.prod(F(b, a) for a, b in stages)
        # a torque along the motion drives: each stage passes on its part; against it, the last shaft drives
        total = efficiency ** (len(stages) if torque > 0 else -len(stages))
        sign = (-1) ** (len(stages) - 1)  # each mesh turns both torques to one side
        assert result.torques_nm[last] == pytest.approx(float(torque * ratio * sign) * total, rel=1e-13)
        assert result.efficiency == pytest.approx(efficiency ** len(stages), rel=1e-13)
        assert balance(result) == pytest.approx(0, abs=ROUNDING)

    def test_two_outputs(self):
        table = train((20, 40)) | {"axes": {name: ["h", name] for name in ("s0", "s1", "s2")}}
        table["mesh"] = [*table["mesh"], {"teeth": {"s0": 20, "s2": 60}}]
        result = solve_torques(solved(table), {"s0": None, "s1": 3, "s2": 6})
        assert result.torques_nm["s0"] == 3 * 20 / 40 + 6 * 20 / 60
        assert result.output_power_w == pytest.approx(3.5 * TURN, rel=1e-15)
        # the stream divides behind the input shaft
        assert result.circulating_ratio == pytest.approx(2 / 3.5, rel=1e-15)


class TestPlanetary:
    def test_27_36_99_by_hand(self):
        result = solve_torques(solved(RING_FIXED), {"sun": 27, "carrier": None})
        # 1 : -(1 + 99/27) : 99/27
        assert result.torques_nm == {"sun": 27.0, "carrier": -126.0}
        assert result.frame_torque_nm == (99.0, 0.0, 0.0)
        # planets share equally
        assert [load.torques_nm for load in result.at("sun-planet")] == [(-9.0, -12.0)] * 3
        assert [load.torques_nm for load in result.at("planet-ring")] == [(12.0, -33.0)] * 3
        # the carrier takes 42 N m by each planet: 21 from the sun's teeth, 21 from the ring's
        assert {(load.carrier, load.carrier_torque_nm) for load in result.tooth_loads} == {
            ("carrier", (21.0, 0.0, 0.0))
        }
        assert [(branch.link, branch.through, branch.torque_nm) for branch in result.branches] == [
            ("sun", ("sun-planet",), -27.0),
            ("carrier", ("sun-planet", "planet-ring"), 126.0),
        ]
        # the sun passes the carrier at 99/126 turns; the rest of the power goes by the coupling, not by the teeth
        sun, ring = result.at("sun-planet")[0], result.at("planet-ring")[0]
        gearing_w = 9 * 99 / 126 * TURN
        assert (sun.gearing_power_w, ring.gearing_power_w) == pytest.approx((gearing_w, gearing_w), rel=1e-15)
        assert (sun.driver, ring.driver) == ("sun", "planet 1")
        assert (sun.absolute_power_w, ring.absolute_power_w) == (
            pytest.approx(9 * TURN, rel=1e-15),
            0,
        )  # the ring rests
        assert (result.gearing_ratio, result.circulating_ratio) == (pytest.approx(99 / 126, rel=1e-15), 1.0)

    @given(
        sun=st.integers(10, 200),
        planet=st.integers(10, 200),
        copies=st.integers(2, 6),
        torque=st.fractions(1, 99, max_denominator=9),
        speeds=st.tuples(*[st.fractions(-9, 9, max_denominator=99)] * 2),
    )
    @pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # any planets, whether or not they fit
    def test_any_planetary_in_any_motion(self, sun, planet, copies, torque, speeds):
        ring = sun + 2 * planet
        table = PLANETARY | {"axes": PLANETARY["axes"] | {"planet": {"links": ["carrier", "planet"], "copies": copies}}}
        table["mesh"] = [{"teeth": {"sun": sun, "planet": planet}}, {"teeth": {"planet": planet, "ring": -ring}}]
        motion = dict(zip(("sun", "ring"), speeds, strict=True))
        result = solve_torques(solved(table), {"sun": torque, "ring": None, "carrier": None}, speeds=motion)
        assert result.torques_nm["ring"] == float(torque * F(ring, sun))
        assert result.torques_nm["carrier"] == float(-torque * (1 + F(ring, sun)))
        assert result.frame_torque_nm[0] == pytest.approx(0, abs=ROUNDING * 999 * float(torque))
        if result.input_power_w:
            assert balance(result) == pytest.approx(0, abs=ROUNDING)

    def test_a_link_held_by_the_solver_needs_its_torque_named(self):
        kinematics = solve_kinematics(Gearbox.from_mapping({"name": "box"} | PLANETARY), fixed=["ring"])
        with pytest.raises(TorqueError, match=r'2 degrees of freedom.*as in torques=\{"ring": None\}'):
            solve_torques(kinematics, {"sun": 27, "carrier": None})
        result = solve_torques(kinematics, {"sun": 27, "carrier": None, "ring": None})
        assert result.torques_nm == {"sun": 27.0, "carrier": -126.0, "ring": 99.0}
        assert result.efficiency == 1.0

    def test_a_torque_on_a_planet(self):
        torques = {f"planet {k}": 12 for k in (1, 2, 3)}
        result = solve_torques(solved(RING_FIXED), torques | {"carrier": None})
        # the sun is free, so its teeth are too; a planet pushes itself off the ring with 36 teeth of 99
        assert [load.torques_nm for load in result.at("sun-planet")] == [(0.0, 0.0)] * 3
        assert [load.torques_nm for load in result.at("planet-ring")] == [(-12.0, 33.0)] * 3
        # the carrier holds against 36 N m from outside and 99 N m on the ring, which is 63 = 12 x 3 x (99/36 - 1)
        assert result.torques_nm["carrier"] == 63.0
        assert result.frame_torque_nm == (-99.0, 0.0, 0.0)

    def test_copies_with_loads_of_their_own_need_not_share(self):
        table = train((20, 50)) | {
            "axes": {"input": ["h", "s0"], "outputs": {"links": ["h", "s1"], "copies": 2}},
        }
        result = solve_torques(solved(table), {"s0": None, "s1 1": 10, "s1 2": 5})
        assert [load.torques_nm[0] for load in result.tooth_loads] == [-4.0, -2.0]


class TestPowerThatPositionsDecide:
    def test_on_a_carrier_that_is_carried(self):
        table = {
            "frame": "h",
            "reference": "sun",
            "axes": {"main": ["h", "sun", "arm"], "elbow": ["arm", "hub", "forearm"], "wrist": ["forearm", "hand"]},
            "mesh": [{"teeth": {"sun": 20, "hub": 20}}, {"teeth": {"hub": 20, "hand": 20}}],
        }
        torques = {"sun": 1, "arm": None, "forearm": None, "hand": None}
        result = solve_torques(solved(table), torques, speeds={"sun": 1, "arm": 0, "forearm": 0})
        # the teeth bring 1 N m to the hand; the forearm holds against the hand's 1 and the hub's teeth, the arm
        # against all that, and together with the sun's torque nothing is left for the frame
        assert result.torques_nm == {"sun": 1.0, "arm": -2.0, "forearm": 2.0, "hand": -1.0}
        assert result.frame_torque_nm == (0.0, 0.0, 0.0)
        sun, hand = result.tooth_loads
        assert sun.absolute_power_w == pytest.approx(TURN, rel=1e-15)
        assert hand.absolute_power_w is None
        assert hand.gearing_power_w == pytest.approx(TURN, rel=1e-15)


class TestLosses:
    R = F(99, 27)

    def test_sun_drives_carrier(self):
        result = solve_torques(solved(RING_FIXED), {"sun": 27, "carrier": None}, mesh_efficiency=0.98)
        eta0 = 0.98**2  # of the gear train with the carrier held: two meshes
        # T_c = -T_s (1 + eta0 R) at 1/(1 + R) of the speed
        assert result.torques_nm["carrier"] == pytest.approx(-27 * (1 + eta0 * self.R), rel=1e-14)
        assert result.efficiency == pytest.approx(1 - (1 - eta0) * self.R / (1 + self.R), rel=1e-14)
        assert balance(result) == pytest.approx(0, abs=ROUNDING)

    def test_carrier_drives_sun(self):
        result = solve_torques(solved(RING_FIXED), {"sun": -27, "carrier": None}, mesh_efficiency=0.98)
        eta0 = 0.98**2
        # power flows back through the gears: the ring drives, T_r = R T_s / eta0
        assert result.torques_nm["carrier"] == pytest.approx(27 * (1 + self.R / eta0), rel=1e-14)
        assert result.efficiency == pytest.approx((1 + self.R) / (1 + self.R / eta0), rel=1e-14)
        assert [load.driver for load in result.at("sun-planet")] == ["planet 1", "planet 2", "planet 3"]

    @pytest.mark.parametrize("torque", [27, -27])
    def test_each_mesh_with_its_own_efficiency(self, torque):
        parts = {"sun-planet": 0.97, "planet-ring": 0.99}
        result = solve_torques(solved(RING_FIXED), {"sun": torque, "carrier": None}, mesh_efficiency=parts)
        gearing = 27 * 99 / 126 * TURN
        first, second = (0.03, 0.97 * 0.01) if torque > 0 else (1 / 0.97 - 1, (1 / 0.99 - 1) / 0.97)
        # driven by the sun, the ring mesh receives 97 per cent; driving it, the sun mesh asks for 1/0.97
        assert result.losses_w["sun-planet"] == pytest.approx(gearing * first, rel=1e-13)
        assert result.losses_w["planet-ring"] == pytest.approx(gearing * second, rel=1e-13)
        assert balance(result) == pytest.approx(0, abs=ROUNDING)

    def test_a_planetary_that_turns_as_a_block_loses_nothing(self):
        result = solve_torques(
            solved(PLANETARY),
            {"sun": 27, "ring": None, "carrier": None},
            speeds={"sun": 1, "ring": 1},
            mesh_efficiency=0.9,
        )
        assert result.efficiency == 1.0
        assert result.losses_w == {"sun-planet": 0.0, "planet-ring": 0.0}
        load = result.tooth_loads[0]
        assert (load.gearing_power_w, load.driver) == (0.0, None)
        assert load.absolute_power_w == pytest.approx(9 * TURN, rel=1e-15)

    def test_a_train_at_rest_holds_without_power(self):
        result = solve_torques(solved(train((20, 50))), {"s0": 4, "s1": None}, speeds={"s0": 0}, mesh_efficiency=0.9)
        assert result.torques_nm["s1"] == 10
        assert (result.efficiency, result.circulating_ratio, result.gearing_ratio) == (None, None, None)

    def test_a_wolfrom_set_that_locks_itself(self):
        eta = 0.99
        # i0 between the rings with the carrier held; moments about the main axis add up to nothing without one on
        # the carrier. Loaded, the output ring drives the planets and these the resting ring, both times with losses.
        i0, rings = F(178 * 75, 79 * 169), F(178, 20)
        down = solve_torques(shipped("wolfrom"), {"sun": None, "output ring": -1000}, mesh_efficiency=eta)
        assert down.torques_nm["sun"] == pytest.approx(1000 * (1 - eta**2 * i0) / (1 + eta**2 * rings), rel=1e-12)
        # pulled along, the sun has to be driven all the same: rings the other way round, the sun's mesh as before
        back = solve_torques(shipped("wolfrom"), {"sun": None, "output ring": 1000}, mesh_efficiency=eta)
        assert back.torques_nm["sun"] == pytest.approx(1000 * (i0 / eta**2 - 1) / (1 + rings), rel=1e-12)
        assert (back.efficiency, back.output_power_w) == (0.0, 0.0)
        assert sum(back.losses_w.values()) == pytest.approx(back.input_power_w, rel=ROUNDING)


class TestDifferential:
    SPEEDS = {"left": F(-1, 4), "right": F(-3, 20)}  # round a bend, the cage at -1/5  # noqa: RUF012
    TORQUES = {"pinion": 1, "left": None, "right": None}  # noqa: RUF012

    def test_each_wheel_takes_half_of_the_cage(self):
        result = solve_torques(solved(DIFFERENTIAL), self.TORQUES, speeds=self.SPEEDS)
        assert result.torques_nm == {"pinion": 1.0, "left": 2.5, "right": 2.5}
        assert result.at("pinion-cage")[0].torques_nm == (-1.0, -5.0)
        assert [load.torques_nm for load in result.at("left-planet")] == [(-1.25, 125 / 140)] * 2
        # the bevel pair turns the axis of the torque: what holds the housing is a vector
        assert result.frame_torque_nm == (-5.0, -1.0, 0.0)
        assert result.efficiency == 1.0

    def test_driven_round_a_bend_the_slow_wheel_takes_more(self):
        result = solve_torques(
            solved(DIFFERENTIAL),
            self.TORQUES,
            speeds=self.SPEEDS,
            mesh_efficiency={"left-planet": 0.9, "right-planet": 0.9},
        )
        # seen from the cage the slow wheel drives the fast one through two meshes
        assert result.torques_nm["right"] == pytest.approx(5 / (1 + 0.9**2), rel=1e-14)
        assert result.torques_nm["left"] == pytest.approx(0.9**2 * 5 / (1 + 0.9**2), rel=1e-14)
        assert {load.driver for load in result.at("right-planet")} == {"right"}
        assert balance(result) == pytest.approx(0, abs=ROUNDING)

    def test_pinions_declared_one_by_one_are_indeterminate(self):
        kinematics = shipped("car-differential")
        torques = {"drive shaft": 1, "left wheel": None, "right wheel": None}
        speeds = {"left wheel": 1, "right wheel": 2}
        result = solve_torques(kinematics, torques, speeds=speeds)
        assert result.torques_nm == {"drive shaft": 1.0, "left wheel": 2.5, "right wheel": 2.5}
        pairs = [f"{side} wheel-planet {pinion}" for side in ("left", "right") for pinion in "ab"]
        assert result.indeterminate == tuple(pairs)
        for name in pairs:
            (load,) = result.at(name)
            assert not load.determinate
            assert np.isnan([*load.torques_nm, *load.carrier_torque_nm, load.gearing_power_w]).all()
        (crown,) = result.at("drive shaft-cage")
        assert crown.determinate
        assert crown.torques_nm == (-1.0, -5.0)
        assert (result.circulating_ratio, result.gearing_ratio) == (None, None)
        assert result.efficiency == 1.0
        with pytest.raises(TorqueError, match='"left wheel-planet a": its load is indeterminate, and so is its loss'):
            solve_torques(kinematics, torques, speeds=speeds, mesh_efficiency=0.98)
        # straight ahead its gears stand still on each other
        ahead = solve_torques(kinematics, torques, speeds=dict.fromkeys(speeds, 1), mesh_efficiency=0.98)
        assert ahead.efficiency == pytest.approx(0.98, rel=1e-14)


class TestNelson:
    def test_bevel_planet(self):
        # w_2 = 1.6 w_4 (2010, after Nelson and Cipra), so by the power the carrier takes 1.6 times the ring's torque
        result = solve_torques(shipped("nelson-bevel-planet"), {"ring": 5, "carrier": None})
        assert result.torques_nm == {"ring": 5.0, "carrier": -8.0}
        assert result.frame_torque_nm == (3.0, 0.0, 0.0)
        sun, ring = result.tooth_loads
        # 15/25 of the ring's on the sun, 10/25 on the planet, whose axis stands at 60 degrees
        assert ring.torques_nm == (-5.0, 2.0)
        assert sun.torques_nm == (-3.0, -2.0)
        np.testing.assert_allclose(ring.carrier_torque_nm, [5 - 1, -math.sqrt(3), 0], atol=1e-15)
        np.testing.assert_allclose(sun.carrier_torque_nm, [3 + 1, math.sqrt(3), 0], atol=1e-15)
        # relative to the carrier the ring turns at 3/8
        assert ring.gearing_power_w == pytest.approx(5 * 3 / 8 * TURN, rel=1e-15)
        assert ring.absolute_power_w == pytest.approx(5 * TURN, rel=1e-15)


class TestCirculatingPower:
    # Carrier 1, sun shaft 4, ring 2 at 1/7: the sun shaft brings back 4/(1/2) times what goes through.

    def test_where_it_goes_round(self):
        result = solve_torques(solved(COUPLED), {"carrier": None, "ring 2": -7})
        assert result.torques_nm == {"carrier": 1.0, "ring 2": -7.0}
        assert [(branch.link, branch.through, branch.torque_nm) for branch in result.branches] == [
            ("carrier", ("sun 1-a", "a-ring 1"), 8.0),
            ("carrier", ("sun 2-b", "b-ring 2"), -9.0),
            ("sun 1", ("sun 1-a",), -2.0),
            ("sun 1", ("sun 2-b",), 2.0),
            ("ring 2", ("b-ring 2",), 7.0),
        ]
        np.testing.assert_allclose([branch.power_w / TURN for branch in result.branches], [8, -9, -8, 8, 1], rtol=1e-14)
        assert result.circulating_ratio == pytest.approx(9, rel=1e-14)
        assert result.gearing_ratio == pytest.approx(6, rel=1e-14)

    def test_losses_grow_with_it(self):
        down = solve_torques(solved(COUPLED), {"carrier": None, "ring 2": -7}, mesh_efficiency=0.99)
        assert down.efficiency == pytest.approx(1 / (7 - 6 * 0.99**4), rel=1e-13)
        up = solve_torques(solved(COUPLED), {"carrier": None, "ring 2": 7}, mesh_efficiency=0.99)
        assert up.efficiency == pytest.approx(7 - 6 / 0.99**4, rel=1e-13)


LOADED = {
    "alouette-iii": {"input": 20, "tail": -3, "upper carrier": None},
    "car-differential": {"drive shaft": 1, "left wheel": None, "right wheel": None},
    "glinsky-compound": {"gear 1": 2, "gear 5": None},
    "nelson-bevel-planet": {"ring": 5, "carrier": None},
    "oh-58": {"input": 7, "carrier": None},
    "planetary-27-36-99": {"sun": 27, "carrier": None},
    "ravigneaux": {"small sun": 5, "large sun": -2, "ring": None, "carrier": None},
    "two-motor-split": {"motor 1": None, "motor 2": None, "carrier": -108},
    "two-stage": {"input": 3, "output": None},
    "wind-turbine-3-stage": {"main shaft": 1e6, "high speed shaft": None},
    "wolfrom": {"sun": None, "output ring": -1000},
}
MOVING = {
    "car-differential": {"left wheel": 1, "right wheel": 1.25},
    "ravigneaux": {"small sun": 1, "large sun": -0.3},
    "two-motor-split": {"motor 1": 1, "motor 2": 0.7},
}


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # the shipped OH-58 as printed
@pytest.mark.parametrize("name", LOADED)
class TestShippedGearboxes:
    def test_the_complex_matrix_carries_the_same_loads(self, name):
        # virtual work on the papers' matrix: E + M^H mu = 0, E the external torques as complex numbers; the first
        # row's multiplier is what holds the frame, each mesh's is its tooth load up to the row's unit factor. Where
        # loads can be shared in many ways, the least-squares solution is the one shared equally.
        kinematics = shipped(name)
        result = solve_torques(kinematics, LOADED[name], speeds=MOVING.get(name))
        external = np.zeros(len(kinematics.links), dtype=complex)
        for load in result.external:
            body = kinematics.bodies[load.link]
            x, y, _ = kinematics.mechanism.directions[kinematics.joints[body].axis]
            external[kinematics.links.index(load.link)] = load.torque_nm * complex(x, y)
        adjoint = kinematics.constraint_matrix.conj().T
        multipliers = np.linalg.lstsq(adjoint, -external)[0]
        scale = np.abs(external).max()
        # the condition of the matrices is below 1e5
        np.testing.assert_allclose(adjoint @ multipliers, -external, atol=1e-10 * scale)
        np.testing.assert_allclose(complex(*result.frame_torque_nm[:2]), multipliers[0], atol=1e-10 * scale)
        teeth = {contact.mesh: contact.gears[0][1] for contact in kinematics.contacts}
        for load, multiplier in zip(result.tooth_loads, multipliers[1:], strict=False):
            if load.determinate:
                tooth_load = abs(load.torques_nm[0] / teeth[load.mesh])
                np.testing.assert_allclose(abs(multiplier), tooth_load, rtol=1e-9, atol=1e-10 * scale)

    def test_power_balances_as_a_whole_and_at_every_link(self, name):
        result = solve_torques(
            shipped(name),
            LOADED[name],
            speeds=MOVING.get(name),
            # the differential's planets have indeterminate loads, which cannot lose a part
            mesh_efficiency={"drive shaft-cage": 0.98} if name == "car-differential" else 0.98,
        )
        assert balance(result) == pytest.approx(0, abs=ROUNDING)
        assert result.efficiency < 1
        outside = {shipped(name).bodies[load.link]: load for load in result.external}
        for link in {branch.link for branch in result.branches}:
            given = [outside[link]] if link in outside else []
            acting = [*given, *(branch for branch in result.branches if branch.link == link)]
            for values in ([part.torque_nm for part in acting], [part.power_w for part in acting]):
                if not np.isnan(values).any():
                    assert sum(values) == pytest.approx(0, abs=ROUNDING * max(map(abs, values)))


class TestForces:
    @staticmethod
    def force(*, teeth=(20, 50), torque=40, efficiency=1.0, **mesh):
        table = train(teeth, **mesh)
        return (
            solve_torques(solved(table), {"s0": torque, "s1": None}, mesh_efficiency=efficiency).tooth_loads[0].forces
        )

    @pytest.mark.parametrize("helix", [0, 15, -15])
    def test_one_stage(self, helix):
        force = self.force(module_mm=2, pressure_angle_deg=20, helix_angle_deg=helix)
        slant = math.radians(abs(helix))
        tangential = 40 / (0.020 / math.cos(slant))  # 40 N m at a radius of 20 mm
        assert force.tangential_n == pytest.approx(tangential, rel=1e-14)
        assert force.radial_n == pytest.approx(tangential * math.tan(math.radians(20)) / math.cos(slant), rel=1e-14)
        assert force.axial_n == pytest.approx(tangential * math.tan(slant), rel=1e-14)

    @pytest.mark.parametrize(
        "mesh",
        [
            {"module_mm": 2},
            {"pressure_angle_deg": 20},
            {"teeth": (20, -50), "module_mm": 2, "pressure_angle_deg": 20, "kind": "belt"},
        ],
    )
    def test_nothing_is_guessed(self, mesh):
        assert self.force(**mesh) is None

    @pytest.mark.parametrize("teeth", [(20, 50), (20, -50), (-50, 20)])
    @given(working=st.floats(12, 60), torque=st.floats(-100, 100))
    def test_profile_shift_turns_the_line_of_action(self, teeth, working, torque):
        assume(abs(torque) > 1e-3 and abs(working - 20) > 1e-3)

        # the shift that brings the pair to a given working angle
        def involute(deg):
            return math.tan(math.radians(deg)) - math.radians(deg)

        count = 70 if min(teeth) > 0 else -30
        shift = (involute(working) - involute(20)) * count / (2 * math.tan(math.radians(20)))
        force = self.force(teeth=teeth, torque=torque, module_mm=2, pressure_angle_deg=20, profile_shift=[shift, 0.0])
        # the moment about the axis is that of the force along the line of action at the base circle
        along = math.hypot(force.tangential_n, force.radial_n)
        base_m = 1e-3 * abs(teeth[0]) * math.cos(math.radians(20))
        assert along * base_m == pytest.approx(abs(torque), rel=1e-12)
        # the shift is a difference of involutes: rounding times 1 / tan^2 of the angle
        assert force.radial_n / force.tangential_n == pytest.approx(math.tan(math.radians(working)), rel=1e-9)

    def test_losses_leave_the_force_of_the_driver(self):
        assert self.force(module_mm=2, pressure_angle_deg=20, efficiency=0.9).tangential_n == pytest.approx(2000)


def bearings(link, *places, takes_axial=(), **changes):
    """Bearings of a shaft to the frame, called after it: "s0 1", "s0 2"."""
    names = [f"{link} {number + 1}" for number in range(len(places))]
    return {
        "names": names,
        "inner_ring": link,
        "outer_ring": "h",
        "elements": 9,
        "element_diameter_mm": 5,
        "pitch_diameter_mm": 50,
        "position_mm": list(places),
        "takes_axial": [f"{link} {number}" for number in takes_axial],
    } | changes


def placed(*, teeth=(20, 50), through=((0, 0, 0), (0, 0, 70)), held=None, direction=(1, 0, 0), **mesh):
    """Two shafts side by side, module 2 mm, the mesh 30 mm from `through`, each in bearings at 0 and 100 mm."""
    table = train(teeth, **{"module_mm": 2, "pressure_angle_deg": 20, "position_mm": 30} | mesh)
    table["axes"] = {
        f"axis {k}": {"links": ["h", f"s{k}"], "through": point and list(point), "direction": list(direction)}
        for k, point in enumerate(through)
    }
    return table | {"bearing": held or [bearings("s0", 0, 100, takes_axial=[1]), bearings("s1", 0, 100)]}


def declared(table):
    """The same without what is None."""
    if isinstance(table, dict):
        return {key: declared(value) for key, value in table.items() if value is not None}
    return [declared(item) for item in table] if isinstance(table, list) else table


def loads(table, torques=None, **options):
    result = solve_torques(solved(table), torques or {"s0": 40, "s1": None}, **options)
    return {load.bearing: load for load in result.bearing_loads}


def places(kinematics):
    """Where each bearing sits, in mm in the declared coordinates, and which way its axis points."""
    axes = {axis.name: axis for axis in kinematics.gearbox.axes}
    for bearing in kinematics.gearbox.bearings:
        axis = axes[kinematics.joints[kinematics.bodies[bearing.inner_ring]].axis]
        direction = np.array(kinematics.gearbox.direction(axis.name))
        for name, place in zip(bearing.names, bearing.position_mm, strict=True):
            yield name, np.array(axis.through) + place * direction, direction


def assert_whole_box_balances(table, torques, **options):
    """Forces between gears are internal: reactions add up to no force, and to the torque that holds the frame."""
    kinematics = solved(table)
    result = solve_torques(kinematics, torques, **options)
    reactions = {load.bearing: load for load in result.bearing_loads}
    assert {load.status for load in reactions.values()} == {"solved"}
    force, moment, largest = np.zeros(3), np.zeros(3), 0.0
    for name, point, direction in places(kinematics):
        reaction = np.array(reactions[name].radial_n) + reactions[name].axial_n * direction
        assert abs(np.dot(reactions[name].radial_n, direction)) <= ROUNDING * np.linalg.norm(reaction)
        force, moment = force + reaction, moment + np.cross(point, reaction)
        largest = max(largest, np.linalg.norm(reaction))
    np.testing.assert_allclose(force, 0, atol=10 * ROUNDING * largest)
    np.testing.assert_allclose(moment / 1000, result.frame_torque_nm, atol=10 * ROUNDING * largest)
    return result


class TestBearingLoads:
    # 40 N m on 20 teeth of 2 mm: 2000 N round the shaft. Gear s0 drives about +x with s1 above it at +z, so the
    # wheel pushes it by 2000 N along +y and by 2000 tan 20 N along -z; the bearings push back.
    RADIAL = 2000 * math.tan(math.radians(20))

    @pytest.mark.parametrize(("first_mm", "shares"), [(0, (0.7, 0.3)), (60, (1.75, -0.75))])  # between, overhung
    def test_a_spur_pair_30_mm_along(self, first_mm, shares):
        found = loads(placed(held=[bearings(f"s{k}", first_mm, 100) for k in range(2)]))
        for number, share in enumerate(shares, start=1):
            force = np.array([0, -2000, self.RADIAL]) * share
            np.testing.assert_allclose(found[f"s0 {number}"].radial_n, force, rtol=1e-13)
            np.testing.assert_allclose(found[f"s1 {number}"].radial_n, -force, rtol=1e-13)
        assert {(load.axial_n, load.status) for load in found.values()} == {(0.0, "solved")}

    def test_the_pinion_of_a_ring(self):
        found = loads(placed(teeth=(20, -50), through=((0, 0, 0), (0, 0, 30))))
        # they touch at -z, beyond the pinion; the ring pushes it to -y and inwards, +z
        np.testing.assert_allclose(found["s0 1"].radial_n, np.array([0, 2000, -self.RADIAL]) * 0.7, rtol=1e-13)
        np.testing.assert_allclose(found["s1 1"].radial_n, np.array([0, -2000, self.RADIAL]) * 0.7, rtol=1e-13)

    @pytest.mark.parametrize(("hand", "thrust"), [("right", 1), ("left", -1)])
    def test_helical(self, hand, thrust):
        slant = math.radians(15)
        apart = 70 / math.cos(slant)
        mesh = {"helix_angle_deg": 15, "hand": hand, "through": ((0, 0, 0), (0, 0, apart))}
        held = [bearings("s0", 0, 100, takes_axial=[2]), bearings("s1", 0, 100, takes_axial=[1])]
        found = loads(placed(held=held, **mesh))
        round_n = 40 / (0.020 / math.cos(slant))
        radial_n = round_n * math.tan(math.radians(20)) / math.cos(slant)
        # the fingers of the driver's hand point as it turns, the thumb as its thrust: right-handed to +x
        axial_n = thrust * round_n * math.tan(slant)
        assert found["s0 1"].axial_n == found["s1 2"].axial_n == 0
        assert found["s0 2"].axial_n == pytest.approx(-axial_n, rel=1e-13)
        assert found["s1 1"].axial_n == pytest.approx(axial_n, rel=1e-13)
        # the thrust at +z tilts the shaft about +y: 100 mm apart, the bearings hold against thrust times radius
        for name, sign, radius in (("s0", 1, 20 / math.cos(slant)), ("s1", 1, 50 / math.cos(slant))):
            tilt = axial_n * radius / 100
            share = np.array([0, -round_n, radial_n]) * (1 if name == "s0" else -1)
            np.testing.assert_allclose(found[f"{name} 1"].radial_n, share * 0.7 - [0, 0, sign * tilt], rtol=1e-12)
            np.testing.assert_allclose(found[f"{name} 2"].radial_n, share * 0.3 + [0, 0, sign * tilt], rtol=1e-12)

    @pytest.mark.parametrize("teeth", [(20, 50), (20, -50), (-50, 20)])
    def test_the_thrust_depends_neither_on_shift_nor_on_the_side_of_the_pitch_point(self, teeth):
        helix, working, normal = (math.radians(deg) for deg in (15, 24, 20))
        transverse = math.atan(math.tan(normal) / math.cos(helix))
        count = 70 if min(teeth) > 0 else -30
        involutes = math.tan(working) - working - math.tan(transverse) + transverse
        shift = count * involutes / (2 * math.tan(normal))
        apart = abs(count) / math.cos(helix) * math.cos(transverse) / math.cos(working)
        mesh = {"helix_angle_deg": 15, "hand": "right", "profile_shift": [shift, 0.0]}
        result = assert_whole_box_balances(
            placed(
                teeth=teeth,
                through=((0, 0, 0), (0, 0, apart)),
                held=[bearings(f"s{k}", 0, 100, takes_axial=[1]) for k in range(2)],
                **mesh,
            ),
            {"s0": 40, "s1": None},
        )
        reference_m = 1e-3 * abs(teeth[0]) / math.cos(helix)
        assert result.bearing_loads[0].axial_n == pytest.approx(-40 / reference_m * math.tan(helix), rel=1e-12)
        near, far = (np.array(load.radial_n) for load in result.bearing_loads[:2])
        assert result.tooth_loads[0].forces.radial_n == pytest.approx(abs((near + far)[2]), rel=1e-12)
        assert result.tooth_loads[0].forces.tangential_n == pytest.approx(abs((near + far)[1]), rel=1e-12)

    @given(
        teeth=st.tuples(st.integers(12, 90), st.integers(12, 90)),
        second=st.tuples(st.integers(12, 40), st.integers(-120, -60)),
        helix=st.floats(0, 35),
        hands=st.tuples(*[st.sampled_from(["left", "right"])] * 2),
        turned=st.floats(-180, 180),
        direction=st.sampled_from([(1, 0, 0), (0, 0, 2), (1, -2, 3)]),
        reversed_=st.tuples(*[st.booleans()] * 3),
        offsets=st.tuples(*[st.floats(-200, 200)] * 3),
        torque=st.floats(1, 100) | st.floats(-100, -1),
    )
    def test_the_whole_box_balances(self, teeth, second, helix, hands, turned, direction, reversed_, offsets, torque):
        along = np.array(direction) / np.linalg.norm(direction)
        aside = np.cross(along, [0.6, 0.0, 0.8])
        aside /= np.linalg.norm(aside)
        turned = math.radians(turned)
        way = math.cos(turned) * aside + math.sin(turned) * np.cross(along, aside)
        apart = [(teeth[0] + teeth[1]) / math.cos(math.radians(helix)), 1.5 * abs(sum(second))]
        points = [np.zeros(3), apart[0] * aside, apart[0] * aside + apart[1] * way]
        signs = [-1 if flip else 1 for flip in reversed_]
        # teeth carry the sense of the axes: the same box, drawn with some of them the other way round
        pairs = [
            (teeth[0], signs[0] * signs[1] * teeth[1]),
            (second[0], signs[1] * signs[2] * second[1]),
        ]
        table = train(*pairs) | {
            "axes": {
                f"axis {k}": {
                    "links": ["h", f"s{k}"],
                    "direction": list(signs[k] * along),
                    "through": list(points[k] + offsets[k] * along),
                }
                for k in range(3)
            },
            "bearing": [bearings(f"s{k}", 0, 100 + k, takes_axial=[1 + k % 2]) for k in range(3)],
        }
        angles = {"pressure_angle_deg": 20}
        table["mesh"][0] |= angles | {"module_mm": 2, "position_mm": 30, "helix_angle_deg": helix, "hand": hands[0]}
        table["mesh"][1] |= angles | {"module_mm": 3, "position_mm": 140, "hand": hands[1], "helix_angle_deg": 0}
        assert_whole_box_balances(table, {"s0": torque, "s2": None})

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"held": [bearings("s0", 0)]}, r'"s0" runs in 1 bearing \("s0 1"\); .* indeterminate'),
            ({"held": [bearings("s0", 0, 50, 100)]}, r'"s0" runs in 3 bearings \(.*"s0 3"\); .* indeterminate'),
            ({"held": [bearings("s0", 50, 50)]}, r'"s0 1", "s0 2" have the same position_mm = 50: indeterminate'),
            (
                {"held": [bearings("s0", 0, 1) | {"position_mm": None}]},
                r'position_mm of "s0 1", "s0 2" is not declared',
            ),
            ({"held": [bearings("s0", 0, 1, outer_ring="s2")]}, r'neither of its rings \("s0", "s2"\) is at rest'),
            (
                {"held": [bearings("s0", 0), bearings("s0", 5, names=["pilot"], outer_ring="s2")]},
                r'"s0" also runs in a bearing on a rotating shaft \("s0 1", "pilot"\): indeterminate',
            ),
            ({"position_mm": None}, 'mesh "s0-s1": position_mm is not declared'),
            ({"module_mm": None}, 'mesh "s0-s1": a force needs module_mm'),
            ({"kind": "belt"}, 'mesh "s0-s1": a force needs'),
            ({"helix_angle_deg": 15}, 'mesh "s0-s1": the hand of its helix is not declared'),
            ({"module_mm": 2.01}, 'axes "axis 0", "axis 1" are 70 mm apart, but its teeth need 70.35 mm'),
            ({"through": ((0, 0, 0), None)}, 'axis "axis 1": through is not declared; add a point on it in mm'),
            ({"more": {"teeth": {"s0": 17}, "carrier": "h"}}, 'mesh "s0-unknown" has an undeclared mate'),
            ({"more": placed()["mesh"][0] | {"name": "beside"}}, 'the load of mesh "s0-s1" is indeterminate'),
        ],
    )
    def test_what_statics_does_not_settle_is_said(self, changes, words):
        table = declared(placed(**{key: value for key, value in changes.items() if key != "more"}))
        table["axes"]["axis 0"]["links"].append("s2")  # a layshaft's output, on the line of its input
        table["mesh"] += [placed()["mesh"][0] | {"teeth": {"s1": 50, "s2": 20}}]
        table["mesh"] += [changes["more"]] if "more" in changes else []
        found = loads(table, {"s0": 40, "s2": None})["s0 1"]
        assert re.search(words, found.status)
        assert np.isnan([*found.radial_n, found.axial_n]).all()

    @pytest.mark.parametrize(("takes", "words"), [([], "takes_axial names neither"), ([1, 2], "both do")])
    def test_without_one_bearing_for_the_thrust_the_radial_loads_stand(self, takes, words):
        apart = 70 / math.cos(math.radians(15))
        mesh = {"helix_angle_deg": 15, "hand": "left", "through": ((0, 0, 0), (0, 0, apart))}
        known = loads(placed(**mesh))["s0 2"]
        held = [bearings("s0", 0, 100, takes_axial=takes), bearings("s1", 0, 100)]
        found = loads(placed(held=held, **mesh))["s0 2"]
        assert words in found.status
        assert math.isnan(found.axial_n)
        assert found.radial_n == known.radial_n

    def test_planets_are_not_covered(self):
        held = [bearings(link, 0, 100, outer_ring="housing") for link in ("sun", "carrier")]
        held.append(bearings("planet", 0, 10, outer_ring="carrier"))
        found = loads(RING_FIXED | {"bearing": held}, {"sun": 27, "carrier": None})
        assert 'mesh "sun-planet" is held by "carrier", not by the frame' in found["sun 1"].status
        assert '"carrier" carries "planet 1", "planet 2", "planet 3"' in found["carrier 1"].status
        assert '"planet" stands for 3 copies' in found["planet 1"].status


TRAIN = train((20, 50), (20, 50))
WHOLE = {"sun": 1, "carrier": None}


class TestRefusals:
    @pytest.mark.parametrize("torques", [{"s0": 4}, {"s0": 4, "s1": 0}])
    def test_nothing_takes_the_balance(self, torques):
        with pytest.raises(TorqueError, match="no other torque balances them") as caught:
            solve_torques(solved(TRAIN), torques)
        # what it proposes works
        cure = str(caught.value).split("torques={")[1].split('"')[1]
        assert solve_torques(solved(TRAIN), torques | {cure: None}).efficiency == 1.0

    @pytest.mark.parametrize(
        ("kinematics", "torques", "options", "words"),
        [
            (
                solved(DIFFERENTIAL),
                {"pinion": 1, "left": None},
                {"speeds": TestDifferential.SPEEDS},
                r'2 degrees of freedom, .* as in torques=\{"right": None\}',
            ),
            (
                solved(DIFFERENTIAL),
                {"planet 1": 1, "left": None, "right": None},
                {"speeds": TestDifferential.SPEEDS},
                'the axis of "planet 1" rotates with its carrier',
            ),
            (
                solved(RING_FIXED),
                {"planet 1": 12, "planet 2": 0, "sun": 1, "carrier": None},
                {},
                r'"planet 1", "planet 2" load copies of one axis differently',
            ),
            (
                shipped("wolfrom"),
                {"output ring": None, "carrier": -1, "sun": 7},
                {"speeds": {"output ring": -4}, "mesh_efficiency": 0.3},
                r'is self-locking: .* meshes "planet-fixed ring", "small planet-output ring"',
            ),
            (
                solved(train((20, 50), module_mm=2, pressure_angle_deg=20, profile_shift=[-2.0, 0.0])),
                {"s0": 40, "s1": None},
                {},
                "no common pitch point; correct the shifts",
            ),
            (
                solved(TRAIN),
                {"s0": 4, "s2": 7},
                {},
                r'"s0" = 4, "s2" = 7 N m do not balance; .* torques=\{"s2": None\}',
            ),
            (solved(TRAIN), {"s0": 4, "s2": -25}, {"mesh_efficiency": 0.98}, "with the losses .* do not balance"),
            (solved(TRAIN), {"s0": None, "s2": None}, {}, 'are indeterminate; .* 1 degree of freedom, .* Give .* "s2"'),
            (
                shipped("two-stage"),
                {"output": 1, "input": None, "pinion": None},
                {},
                'torques of "input", "pinion" are indeterminate',
            ),
            (
                solved(TRAIN, axes=TRAIN["axes"] | {"loose": ["h", "lonely"]}),
                {"s0": 4, "s2": None, "lonely": 1},
                {"speeds": {"s0": 1, "lonely": 1}},
                '"lonely" has no path to another link',
            ),
            (solved(RING_FIXED), WHOLE | {"ring": None}, {}, '"ring" belongs to the frame .* read frame_torque_nm'),
            (
                solved(RING_FIXED),
                WHOLE,
                {"mesh_efficiency": {"sun-plant": 0.9}},
                'no mesh "sun-plant" of two gears; did you mean "sun-planet"',
            ),
        ],
    )
    def test_refused(self, kinematics, torques, options, words):
        with pytest.raises(TorqueError, match=words):
            solve_torques(kinematics, torques, **options)


class TestBalance:
    def test_torques_that_agree_need_nobody(self):
        result = solve_torques(solved(train((30, 71), (19, 47))), {"s0": 4.1, "s2": -4.1 * (71 * 47) / (30 * 19)})
        assert balance(result) == pytest.approx(0, abs=ROUNDING)

    def test_no_torque_at_all(self):
        result = solve_torques(solved(placed()), {})
        assert [load.torques_nm for load in result.tooth_loads] == [(0.0, 0.0)]
        assert {load.radial_n for load in result.bearing_loads} == {(0.0, 0.0, 0.0)}
        assert (result.input_power_w, result.efficiency, result.circulating_ratio) == (0.0, None, None)

    def test_power_through_one_body_takes_no_branch(self):
        table = {"frame": "h", "reference": "s0", "rigid": [["s0", "flange"]], "axes": {"main": ["h", "s0", "flange"]}}
        table["mesh"] = [{"teeth": {"s0": 20}, "carrier": "h"}]  # its mate is unknown
        result = solve_torques(solved(table), {"s0": 5, "flange": None})
        assert result.torques_nm == {"s0": 5.0, "flange": -5.0}
        assert (result.branches, result.efficiency) == ((), 1.0)
        assert (result.circulating_ratio, result.gearing_ratio) == (0.0, 0.0)

    @pytest.mark.parametrize("speed", [1, -3])
    def test_power_follows_the_speed(self, speed):
        result = solve_torques(solved(TRAIN), {"s0": 4, "s2": None}, speeds={"s2": speed}, mesh_efficiency=0.9)
        # 4 N m at 6.25 turns; backwards the input brakes, and the output has to overcome the losses
        given, taken = (4, 4 * 0.9**2) if speed > 0 else (4 / 0.9**2, 4)
        assert result.input_power_w == pytest.approx(given * 6.25 * abs(speed) * TURN, rel=1e-14)
        assert result.output_power_w == pytest.approx(taken * 6.25 * abs(speed) * TURN, rel=1e-14)
