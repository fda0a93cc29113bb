"""The papers' adjacency tables against what the papers print, and against the same mechanisms declared by hand."""

import numpy as np
import pytest

from hums.gearbox.adjacency import from_adjacency_table
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


class TestBothDoors:
    NAMES = ("housing", "input", "main shaft", "tail", "lower carrier", "lower planet", "upper carrier", "upper planet")

    @pytest.mark.parametrize(
        ("pair", "names", "name"),
        [(ALOUETTE, NAMES, "alouette-iii"), (NELSON, ("sun", "ring", "planet", "carrier"), "nelson-bevel-planet")],
    )
    def test_same_mechanism(self, pair, names, name):
        by_hand = solve_kinematics(load_gearbox(name))
        by_table = solved(pair, frame=names[0], names=names, reference=names[1])
        one, two = by_hand.velocity_ratios(), by_table.velocity_ratios()
        np.testing.assert_allclose(two.sel(link=list(by_hand.links)), one, atol=1e-12)
        carrier = {frozenset(name for name, _ in c.gears): c.carrier for c in by_hand.contacts}
        assert carrier == {frozenset(name for name, _ in c.gears): c.carrier for c in by_table.contacts}


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
        (changed(NELSON, 1, 0, 3, 2), {}, "the same whole number"),
        (changed(NELSON, 0, 1, 2, entry(25, 0.3)), {}, "correct the pitch angles"),
        (NELSON, {"frame": "5"}, 'frame = "5" is not a link'),
        (NELSON, {"names": ["a", "b"]}, "2 names are given for 4 links"),
    ],
)
def test_tables_that_are_none(pair, how, sentence):
    with pytest.raises(GearboxError, match=sentence):
        from_adjacency_table(*pair, **({"frame": 0} | how))
