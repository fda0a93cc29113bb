"""The papers' adjacency tables against what the papers print, and against the same mechanisms declared by hand."""

import numpy as np
import pytest

from hums.gearbox.adjacency import from_adjacency_table
from hums.gearbox.defect_orders import defect_orders
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import GearboxError, load_gearbox


def entry(teeth, angle=0.0):
    return teeth * np.exp(1j * angle)


def tables(count, turning, gears):
    """Build T and levels from pairs counted from 1, as the papers count."""
    T, levels = np.zeros((count, count), complex), np.zeros((count, count), int)
    for i, j, level in turning:
        levels[i - 1, j - 1] = levels[j - 1, i - 1] = level
    for i, j, of_i, of_j in gears:
        T[i - 1, j - 1], T[j - 1, i - 1] = of_i, of_j
    return T, levels


# Penaud, Alazard and Amiez 2012, Table 1
WHEEL, PLANET, TURN = 14, 10, np.pi / 4
DIFFERENTIAL = tables(
    7,
    [(1, 2, 3), (1, 3, 1), (1, 4, 1), (1, 7, 1), (5, 7, 2), (6, 7, 2)],
    [
        (2, 7, entry(13), entry(65)),
        (3, 5, entry(WHEEL, -TURN), entry(PLANET, TURN)),
        (3, 6, entry(WHEEL, TURN), entry(PLANET, -TURN)),
        (4, 5, entry(WHEEL, TURN), entry(PLANET, -TURN)),
        (4, 6, entry(WHEEL, -TURN), entry(PLANET, TURN)),
    ],
)
# Table 3, with the internal gears' minus
ALOUETTE = tables(
    8,
    [(1, 2, 2), (1, 3, 1), (1, 4, 3), (1, 5, 1), (1, 7, 1), (5, 6, 4), (7, 8, 5)],
    [
        (1, 6, entry(-93), entry(21)),
        (1, 8, entry(-93), entry(21)),
        (2, 3, entry(20, -TURN), entry(41, TURN)),
        (3, 4, entry(17, TURN), entry(20, -TURN)),
        (3, 6, entry(51), entry(21)),
        (5, 8, entry(51), entry(21)),
    ],
)
# Penaud and Alazard 2010, Table 1: alpha 60 degrees, beta 45 degrees
ALPHA, BETA = np.pi / 3, np.pi / 4
NELSON = tables(
    4,
    [(1, 4, 1), (2, 4, 1), (3, 4, 2)],
    [
        (1, 3, entry(15, BETA), entry(10, BETA - ALPHA)),
        (2, 3, entry(25, 2 * ALPHA - BETA - np.pi), entry(10, ALPHA - BETA)),
    ],
)


def solved(pair, **how):
    return solve_kinematics(from_adjacency_table(*pair, **how))


class TestPapers:
    def test_links_keep_the_order_of_the_table(self):
        assert solved(DIFFERENTIAL, frame=0).links == tuple("1234567")
        assert from_adjacency_table(*NELSON, frame=0, names=["sun", "ring", "planet", "carrier"]).links == (
            "sun",
            "ring",
            "planet",
            "carrier",
        )

    def test_differential_velocity_ratios(self):
        # equation 6
        kinematics = solved(DIFFERENTIAL, frame="1")
        assert kinematics.dof == 2
        assert kinematics.carriers == ("1", "7", "7", "7", "7")
        printed = [[0, -2.5, 1, 0, 0.5 + 0.7j, 0.5 - 0.7j, 0.5], [0, -2.5, 0, 1, 0.5 - 0.7j, 0.5 + 0.7j, 0.5]]
        found = kinematics.velocity_ratios(["3", "4"]).to_numpy()
        np.testing.assert_allclose(found, np.transpose(printed), atol=1e-12)

    def test_differential_rows_are_the_papers_up_to_a_unit_factor(self):
        # equation 3
        low, high = np.exp(-1j * TURN), np.exp(1j * TURN)
        printed = [
            [1, 0, 0, 0, 0, 0, 0],
            [-78, 13, 0, 0, 0, 0, 65],
            [0, 0, 14 * low, 0, 10 * high, 0, -14 * low - 10 * high],
            [0, 0, 14 * high, 0, 0, 10 * low, -14 * high - 10 * low],
            [0, 0, 0, 14 * high, 10 * low, 0, -14 * high - 10 * low],
            [0, 0, 0, 14 * low, 0, 10 * high, -14 * low - 10 * high],
        ]
        found = solved(DIFFERENTIAL, frame=0).constraint_matrix
        for row, wanted in zip(found, np.array(printed), strict=True):
            factor = np.vdot(wanted, row) / np.vdot(wanted, wanted)
            assert abs(factor) == pytest.approx(1, abs=1e-12)
            np.testing.assert_allclose(row, factor * wanted, atol=1e-12)

    def test_alouette(self):
        # Table 4 and equation 9, three digits as printed
        kinematics = solved(ALOUETTE, frame=0)
        assert kinematics.carriers == ("5", "7", "1", "1", "5", "7")
        printed = [0, 1, 0.488j, 0.415, 0.173j, -0.592j, 0.0612j, -0.210j]
        found = kinematics.velocity_ratios(["2"]).to_numpy()[:, 0]
        np.testing.assert_allclose(found, printed, atol=5e-4)

    def test_nelson(self):
        # equations 11 and 12 with the errata: the relative velocity points along alpha
        kinematics = solve_kinematics(from_adjacency_table(*NELSON, frame=0))
        ratio = kinematics.velocity_ratios(["2"]).to_numpy()[:, 0]
        np.testing.assert_allclose(ratio[[1, 3]], [1, 0.625], atol=1e-12)
        assert ratio[2] == pytest.approx(1.36 * np.exp(0.639j), abs=5e-3)
        assert ratio[2] - ratio[3] == pytest.approx(0.9375 * np.exp(1j * ALPHA), abs=1e-12)

    @pytest.mark.parametrize(("pair", "inputs"), [(DIFFERENTIAL, ["3", "4"]), (ALOUETTE, ["2"]), (NELSON, ["2"])])
    def test_null_space_agrees_with_the_joint_rates(self, pair, inputs):
        kinematics = solved(pair, frame=0)
        place = [kinematics.links.index(name) for name in inputs]
        free = kinematics.null_space
        # condition of the input rows is below 10; double precision leaves 1e-14
        np.testing.assert_allclose(
            free @ np.linalg.inv(free[place]), kinematics.velocity_ratios(inputs).to_numpy(), atol=1e-12
        )


class TestBothDoors:
    NAMES = ("housing", "input", "main shaft", "tail", "lower carrier", "lower planet", "upper carrier", "upper planet")

    def test_same_mechanism(self):
        by_hand = solve_kinematics(load_gearbox("alouette-iii"))
        by_table = solved(ALOUETTE, frame="housing", names=self.NAMES, reference="input")
        one, two = by_hand.velocity_ratios(), by_table.velocity_ratios()
        np.testing.assert_allclose(two.sel(link=list(by_hand.links)), one, atol=1e-12)
        carrier = {frozenset(name for name, _ in c.gears): c.carrier for c in by_hand.contacts}
        assert carrier == {frozenset(name for name, _ in c.gears): c.carrier for c in by_table.contacts}

    def test_same_orders_exactly(self):
        by_hand = defect_orders(load_gearbox("alouette-iii"))
        by_table = defect_orders(from_adjacency_table(*ALOUETTE, frame=0, names=self.NAMES, reference=1))
        shafts = [
            {row.component: row.exact for row in table.itertuples() if row.kind == "shaft"}
            for table in (by_hand, by_table)
        ]
        assert shafts[0] == shafts[1]
        meshes = [sorted(table["exact"][table["kind"] == "gear_mesh"]) for table in (by_hand, by_table)]
        assert meshes[0] == meshes[1]

    def test_bearings_come_along(self):
        bearing = {"names": ["b"], "inner_ring": "7", "outer_ring": "1", "elements": 25, "element_diameter_mm": 5}
        bearing |= {"pitch_diameter_mm": 54, "contact_angle_deg": 15}
        gearbox = from_adjacency_table(*DIFFERENTIAL, frame=0, bearings=[bearing], reference="7")
        assert gearbox.bearings[0].names == ("b",)
        again = from_adjacency_table(*DIFFERENTIAL, frame=0, bearings=gearbox.bearings, reference="7")
        assert again == gearbox

    def test_survives_its_own_file(self, tmp_path):
        gearbox = from_adjacency_table(*ALOUETTE, frame=0)
        (tmp_path / "box.toml").write_text(gearbox.to_toml())
        assert load_gearbox(tmp_path / "box.toml") == gearbox


def changed(pair, which, i, j, value):
    copies = [np.array(part) for part in pair]
    copies[which][i, j] = value
    return copies


@pytest.mark.parametrize(
    ("pair", "how", "sentence"),
    [
        ((np.zeros((2, 3)), np.zeros((2, 2))), {}, "T has shape"),
        ((np.zeros((2, 2)), np.zeros((3, 3))), {}, "give both for the same links"),
        (changed(NELSON, 0, 2, 0, 0), {}, r"T\[0, 2\] names a gear of \"1\" against \"3\", but T\[2, 0\] is 0"),
        (changed(NELSON, 0, 0, 2, 14.5), {}, "modulus 14.5"),
        (changed(NELSON, 0, 0, 2, np.nan), {}, "not finite"),
        (changed(NELSON, 1, 0, 3, 2), {}, "the same whole number"),
        (changed(NELSON, 0, 1, 2, entry(25, 0.3)), {}, "correct the pitch angles"),
        (NELSON, {"frame": 4}, "no index of 4 links"),
        (NELSON, {"frame": "5"}, 'frame = "5" is no link'),
        (NELSON, {"names": ["a", "b"]}, "2 names are given for 4 links"),
    ],
)
def test_tables_that_are_none(pair, how, sentence):
    with pytest.raises(GearboxError, match=sentence):
        from_adjacency_table(*pair, **({"frame": 0} | how))
