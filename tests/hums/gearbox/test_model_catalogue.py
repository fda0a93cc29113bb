"""The gearboxes that ship: each loads and solves, and gives every number its source prints (with the errata)."""

import math
import warnings
from fractions import Fraction as F  # noqa: N817
from itertools import pairwise

import numpy as np
import pytest

from hums.gearbox.components import read_toml
from hums.gearbox.defect_orders import defects
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxWarning, catalogue, load_gearbox


def turn(degrees):
    return np.exp(1j * np.radians(degrees))


def solved(name):
    with warnings.catch_warnings():
        if name == "oh-58":
            warnings.simplefilter("ignore", GearboxWarning)  # its teeth need profile shift; asserted below
        return solve_kinematics(load_gearbox(name))


def speed(kinematics, link, **speeds):
    return kinematics.relative_speed(link, seen_from=kinematics.gearbox.frame, speeds=speeds or None)


class TestAll:
    @pytest.mark.parametrize("name", sorted(catalogue()))
    def test_it_loads_and_solves(self, name):
        kinematics = solved(name)
        # N less the rank of the papers' matrix (2012, eq. 4)
        matrix = kinematics.constraint_matrix
        assert kinematics.dof == matrix.shape[1] - np.linalg.matrix_rank(matrix)

    @pytest.mark.parametrize("name", sorted(catalogue()))
    def test_it_names_its_source(self, name):
        lines = catalogue()[name].read_text(encoding="utf-8").splitlines()
        comment = " ".join(line.removeprefix("# ") for line in lines if line.startswith("#")).casefold()
        assert "source: " in comment or "sources: " in comment or "our own example" in comment


class TestNelson:
    # Penaud and Alazard 2010, example 1: links sun, ring, planet, carrier
    LINKS = ("sun", "ring", "planet", "carrier")
    # eq. 9 with beta = pi/4
    M = np.array(
        [
            [15 * turn(45), 0, 10 * turn(-15), -15 * turn(45) - 10 * turn(-15)],
            [0, 25 * turn(-105), 10 * turn(15), -25 * turn(-105) - 10 * turn(15)],
        ]
    )

    @pytest.fixture
    def kinematics(self):
        return solved("nelson-bevel-planet")

    @pytest.fixture
    def omega(self, kinematics):
        return kinematics.velocity_ratios().sel(link=list(self.LINKS), input="ring").to_numpy()

    def test_velocity_ratios(self, omega):
        # eq. 11, modulus and angle as printed: half a unit of the last decimal
        np.testing.assert_allclose(np.abs(omega), [0, 1, 1.36, 0.625], rtol=0, atol=5e-3)
        assert np.angle(omega[2]) == pytest.approx(0.639, abs=5e-4)

    def test_planet_against_carrier(self, kinematics, omega):
        assert kinematics.relative_speed("planet", seen_from="carrier") == F(15, 16)
        # eq. 12 with the errata: along alpha = pi/3
        assert omega[2] - omega[3] == pytest.approx(0.9375 * turn(60), abs=1e-14)

    def test_the_printed_matrix(self, omega):
        np.testing.assert_allclose(self.M @ omega, 0, atol=1e-13)  # terms near 25

    def test_the_printed_null_space(self, omega):
        # eq. 10, polar and rounded to three decimals; the sun turns along, so only differences count
        printed = np.array(
            [
                [0.357 * np.exp(2.147j), 0.729 * np.exp(-0.070j)],
                [0.412 * np.exp(-0.686j), 0.444 * np.exp(0.633j)],
                [0.828 * np.exp(0.125j), 0.069 * np.exp(-0.106j)],
                [0.136 * np.exp(-0.382j), 0.517 * np.exp(0.284j)],
            ]
        )
        for column in printed.T:
            from_sun = (column - column[0]) / (column[1] - column[0])
            # two roundings of 7e-4 over a difference of 0.5 and more
            np.testing.assert_allclose(from_sun, omega, rtol=0, atol=3e-3)


class TestDifferential:
    # Penaud and Alazard 2010, example 2; 2012, section 2: links 1 to 7
    LINKS = ("car", "drive shaft", "left wheel", "right wheel", "planet a", "planet b", "cage")
    CORNER = {"left wheel": F(26), "right wheel": F(30)}  # rad/s, right corner at 30 km/h  # noqa: RUF012

    @pytest.fixture
    def kinematics(self):
        return solved("car-differential")

    @pytest.fixture
    def omega(self, kinematics):
        return kinematics.velocity_ratios(inputs=["left wheel", "right wheel"]).sel(link=list(self.LINKS)).to_numpy()

    def test_velocity_ratio_matrix(self, omega):
        left = np.array([0, -2.5, 1, 0, 0.5 + 0.7j, 0.5 - 0.7j, 0.5])
        right = np.array([0, -2.5, 0, 1, 0.5 - 0.7j, 0.5 + 0.7j, 0.5])
        # 2012, eq. 6 on the right: tenths, so exact but for the float
        np.testing.assert_allclose(omega, np.stack([left, right], axis=1), rtol=0, atol=1e-15)
        # 2010, eq. 15: the planets in polar form, two decimals
        np.testing.assert_allclose(np.abs(omega[4:6]), 0.86, rtol=0, atol=5e-3)
        np.testing.assert_allclose(np.angle(omega[4:6]), [[0.95, -0.95], [-0.95, 0.95]], rtol=0, atol=5e-3)

    def test_corner(self, kinematics):
        # 2012, eq. 8; 2010, eq. 16: two decimals
        turning = kinematics.velocities(self.CORNER).sel(link=list(self.LINKS)).to_numpy()
        np.testing.assert_allclose(np.abs(turning), [0, 140, 26, 30, 28.14, 28.14, 28], rtol=0, atol=5e-3)
        np.testing.assert_allclose(np.angle(turning[4:6]), [-0.10, 0.10], rtol=0, atol=5e-3)
        assert speed(kinematics, "drive shaft", **self.CORNER) == -140
        assert kinematics.relative_speed("planet a", seen_from="cage", speeds=self.CORNER) == F(-14, 5)


class TestAlouette:
    # 2012, section 3: links 1 to 8
    LINKS = ("housing", "input", "main shaft", "tail", "lower carrier", "lower planet", "upper carrier", "upper planet")

    @pytest.fixture
    def kinematics(self):
        return solved("alouette-iii")

    def test_exact_ratios(self, kinematics):
        assert speed(kinematics, "main shaft") == F(20, 41)
        assert speed(kinematics, "tail") == F(17, 41)
        # lower stage: sun 51 against ring 93; upper stage: the same on the lower carrier
        assert speed(kinematics, "lower carrier") == F(20, 41) * F(51, 51 + 93) == F(85, 492)
        assert speed(kinematics, "upper carrier") == F(85, 492) * F(51, 51 + 93) == F(1445, 23616)
        assert speed(kinematics, "lower planet") == F(85, 492) * (1 - F(93, 21))
        assert speed(kinematics, "upper planet") == F(1445, 23616) * (1 - F(93, 21))

    def test_velocity_ratio_vector(self, kinematics):
        ratios = kinematics.velocity_ratios().sel(link=list(self.LINKS), input="input").to_numpy()
        # eq. 9: three decimals, four for the upper carrier
        printed = np.array([0, 1, 0.488j, 0.415, 0.173j, -0.592j, 0.0612j, -0.210j])
        np.testing.assert_allclose(ratios, printed, rtol=0, atol=5e-4)
        assert ratios[6].imag == pytest.approx(0.0612, abs=5e-5)

    def test_table_4(self, kinematics):
        number = {link: place for place, link in enumerate(self.LINKS, start=1)}
        found = {
            tuple(sorted(number[link] for link, _ in contact.gears)): number[contact.carrier]
            for contact in kinematics.contacts
        }
        assert found == {(1, 6): 5, (1, 8): 7, (2, 3): 1, (3, 4): 1, (3, 6): 5, (5, 8): 7}


class TestGlinsky:
    def test_compound(self):
        kinematics = solved("glinsky-compound")
        given = {"gear 1": F(15)}
        assert [speed(kinematics, f"gear {k}", **given) for k in range(1, 6)] == [15, -10, 6, 6, -2]

    @pytest.mark.parametrize(("name", "planets"), [("glinsky-planetary-1", 1), ("glinsky-planetary-3", 3)])
    def test_planetary(self, name, planets):
        kinematics = solved(name)
        names = [f"planet {k + 1}" for k in range(planets)] if planets > 1 else ["planet"]
        given = {"sun": F(10), "ring": F(-4)}
        # the sun's 24 teeth and the ring's 60 share the carrier: (24 x 10 - 60 x 4) / 84 = 0
        assert speed(kinematics, "carrier", **given) == 0
        given = {"sun": F(7), "ring": F(0)}
        assert speed(kinematics, "carrier", **given) == 2
        for planet in names:
            # w_s + i_sp w_p - w_c = 0 with i_sp = 18/24, w_p against the carrier
            spin = kinematics.relative_speed(planet, seen_from="carrier", speeds=given)
            assert spin == F(24, 18) * (2 - 7)
            # "ground velocity": w_pg = w_p + w_c
            assert speed(kinematics, planet, **given) == spin + 2


class TestOH58:
    @pytest.fixture
    def table(self):
        return read_toml(catalogue()["oh-58"], error=ValueError)

    def test_ratio(self):
        kinematics = solved("oh-58")
        ratio = F(71, 19) * (1 + F(99, 27))
        assert abs(speed(kinematics, "carrier")) == 1 / ratio
        assert float(ratio) == pytest.approx(17.44, abs=5e-3)

    def test_planets_stand_where_teeth_permit(self, table):
        places = np.array(table["axes"]["planet"]["spacing_deg"]) / (360 / (27 + 99))
        np.testing.assert_allclose(places, [0, 32, 63, 95], atol=1e-6)  # written with six decimals
        gaps = [b - a for a, b in pairwise([*table["axes"]["planet"]["spacing_deg"], 360])]
        np.testing.assert_allclose(gaps, [91.43, 88.57, 91.43, 88.57], atol=5e-3)

    def test_a_planet_out_of_place(self, table):
        places = table["axes"]["planet"]["spacing_deg"]
        assert "planet 3" not in self.warnings_of(table)
        table["axes"]["planet"]["spacing_deg"] = [*places[:2], 181.0, places[3]]  # 63.35 steps
        assert "planet 3 at 181 degrees" in self.warnings_of(table)

    def test_even_spacing_is_not_permitted(self, table):
        del table["axes"]["planet"]["spacing_deg"]
        text = self.warnings_of(table)
        assert "(27 + 99) / 4 = 31.5" in text
        assert "27 + 2 x 35 = 97" in text

    @staticmethod
    def warnings_of(table):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            Gearbox.from_mapping(table)
        assert {w.category for w in caught} <= {GearboxWarning}
        return " ".join(str(w.message) for w in caught)


class TestOthers:
    def test_wijianto(self):
        kinematics = solved("wijianto-pair")
        assert abs(speed(kinematics, "pinion", gear=F(1))) == F(7, 4)  # table 1: 1.75
        (mesh,) = kinematics.gearbox.meshes
        for gear, diameter_cm in zip(mesh.gears, (12.881, 22.543), strict=True):
            diameter_mm = mesh.module_mm * gear.teeth / math.cos(math.radians(mesh.helix_angle_deg))
            assert diameter_mm / 10 == pytest.approx(diameter_cm, abs=5e-4)
        # 36 x 231.5 = 8334 rad/s = 1326.4 Hz (errata)
        (mesh_order,) = (row.order for row in defects(kinematics) if row.kind == "gear_mesh")
        assert mesh_order * 231.5 == pytest.approx(8334, abs=0.5)
        assert mesh_order * 231.5 / (2 * math.pi) == pytest.approx(1326.4, abs=0.05)

    @pytest.mark.parametrize(
        ("held", "turned", "ratio"),
        [
            ("carrier", "small sun", F(12, 5)),  # first gear, 2.40
            ("large sun", "small sun", F(22, 15)),  # second, 1.47
            ("large sun", "carrier", F(2, 3)),  # fourth, 0.67
            ("carrier", "large sun", F(-2)),  # reverse, 2.00
        ],
    )
    def test_ravigneaux_gears(self, held, turned, ratio):
        assert speed(solved("ravigneaux"), "ring", **{held: F(0), turned: ratio}) == 1

    def test_two_motors(self):
        kinematics = solved("two-motor-split")
        given = {"motor 1": F(18), "motor 2": F(96)}
        # the ring's rim of 96 turns at -23 for the pinion's 96; (30 x 18 - 78 x 23) / 108
        assert speed(kinematics, "ring", **given) == -23
        assert speed(kinematics, "carrier", **given) == F(30 * 18 - 78 * 23, 108)

    def test_wind_turbine(self):
        kinematics = solved("wind-turbine-3-stage")
        ratio = (1 + F(99, 21)) * F(97, 23) * F(103, 25)
        assert speed(kinematics, "high speed shaft", **{"main shaft": F(1)}) == ratio
        assert float(ratio) == pytest.approx(99.3, abs=0.05)
        for a, b in ((97, 23), (103, 25)):
            assert math.gcd(a, b) == 1
