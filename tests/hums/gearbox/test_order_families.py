"""Families of lines by hand, and collisions against all pairs and against the spectrum of two real lines."""

import itertools
import math
from fractions import Fraction as F  # noqa: N817

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hums.gearbox.defect_orders import defect_orders
from hums.gearbox.model import Gearbox
from hums.gearbox.order_families import collisions, order_families

BALL = {"elements": 10, "element_diameter_mm": 10, "pitch_diameter_mm": 50}


@pytest.fixture(scope="module")
def pair():
    """Gears of 20 and 45 teeth, the wheel in two bearings of one size: d/D = 1/5."""
    table = {
        "name": "pair",
        "frame": "h",
        "reference": "a",
        "axes": {"one": ["h", "a"], "two": ["h", "b"]},
        "mesh": [{"teeth": {"a": 20, "b": 45}}],
        "bearing": [{"names": ["x", "y"], "inner_ring": "b", "outer_ring": "h"} | BALL],
    }
    return defect_orders(Gearbox.from_mapping(table))


def table_of(*rows):
    """Rows of (component, order), exact where the order is a Fraction."""
    return pd.DataFrame(
        [(name, "shaft", float(order), order if isinstance(order, F) else None) for name, order in rows],
        columns=["component", "kind", "order", "exact"],
    )


class TestFamilies:
    def test_a_mesh_by_hand(self, pair):
        lines = order_families(pair, harmonics=2, sidebands=1)
        mesh = lines[(lines["component"] == "a-b") & (lines["kind"] == "gear_mesh")]
        assert list(mesh[["harmonic", "sideband", "exact"]].itertuples(index=False, name=None)) == [
            (1, 0, 20),
            (1, -1, 19),
            (1, 1, 21),
            (1, -1, 20 - F(4, 9)),
            (1, 1, 20 + F(4, 9)),
            (2, 0, 40),
            (2, -1, 39),
            (2, 1, 41),
            (2, -1, 40 - F(4, 9)),
            (2, 1, 40 + F(4, 9)),
        ]
        assert list(mesh["spacing"][:5]) == [0, 1, 1, 4 / 9, 4 / 9]

    def test_below_zero_and_at_zero(self):
        table = table_of(("a", F(3, 2))).assign(sources=1, seen_from="h", sidebands=[(F(1, 2), 0.7)])
        lines = order_families(table, harmonics=1, sidebands=3)
        by_teeth = lines[lines["spacing"] == 0.5]
        assert list(by_teeth["exact"]) == [F(1, 2), F(1), 2, F(5, 2), 3]  # the third below lies at zero
        measured = lines[lines["spacing"] == 0.7]
        assert list(measured["order"]) == pytest.approx([0.6, 0.1, 0.8, 2.2, 2.9, 3.6])
        assert list(measured["exact"]) == [None] * 6


class TestCollisions:
    def test_by_hand(self):
        table = table_of(("a", F(3)), ("b", F(3)), ("c", F(301, 100)), ("d", 4.0), ("e", 4.0))
        found = collisions(table, revolutions=100)
        assert list(found.columns) == [
            "component_a", "kind_a", "order_a", "component_b", "kind_b", "order_b",
            "difference", "exact", "resolvable", "revolutions_needed",
        ]  # fmt: skip
        shown = found[["component_a", "component_b", "difference", "exact", "resolvable", "revolutions_needed"]]
        assert list(shown.itertuples(index=False, name=None)) == [
            ("a", "b", 0.0, True, False, math.inf),
            ("a", "c", 0.01, False, False, 200.0),
            ("b", "c", 0.01, False, False, 200.0),
            ("c", "d", pytest.approx(0.99), False, True, pytest.approx(2 / 0.99)),
            ("d", "e", 0.0, False, False, math.inf),  # equal, but no teeth say so
        ]
        assert collisions(table, revolutions=200)["resolvable"].tolist() == [False, True, True, False]

    def test_equal_by_formula_up_to_rounding(self, pair):
        # ten elements: the tenth harmonic of the cage is the outer race's order, however both are rounded
        lines = order_families(pair, harmonics=10, sidebands=0)
        found = collisions(lines, revolutions=1e9)
        cage = (found["kind_a"] == "cage") & (found["kind_b"] == "outer_race") & (found["harmonic_b"] == 1)
        cage |= (found["kind_b"] == "cage") & (found["kind_a"] == "outer_race") & (found["harmonic_a"] == 1)
        assert cage.sum() == 4  # two bearings with two
        assert (found.loc[cage, "difference"] == 0).all()
        assert {"harmonic_a", "sideband_a", "harmonic_b", "sideband_b"} <= set(found.columns)

    def test_one_component_and_kind_does_not_collide_with_itself(self):
        table = table_of(("a", 1.0)).assign(sources=1, seen_from="h", sidebands=[(0.5, 1.0)])
        assert collisions(order_families(table, harmonics=4, sidebands=2), revolutions=1).empty

    @given(
        orders=st.lists(st.fractions(F(1, 10), 20, max_denominator=40), max_size=25),
        revolutions=st.integers(1, 400),
        exact=st.booleans(),
    )
    @settings(max_examples=40)
    def test_against_all_pairs(self, orders, revolutions, exact):
        table = table_of(*((str(rank), order if exact else float(order)) for rank, order in enumerate(orders)))
        found = collisions(table, revolutions=revolutions)
        too_close = {
            frozenset(map(str, pair))
            for pair in itertools.combinations(range(len(orders)), 2)
            if abs(orders[pair[0]] - orders[pair[1]]) * revolutions < 2 - (0 if exact else 1e-9)
        }
        refused = found[~found["resolvable"].astype(bool)]
        pairs = {frozenset(pair) for pair in zip(refused["component_a"], refused["component_b"], strict=True)}
        # exactly on the border a float may fall on either side
        border = {
            frozenset(map(str, pair))
            for pair in itertools.combinations(range(len(orders)), 2)
            if not exact and abs(abs(orders[pair[0]] - orders[pair[1]]) * revolutions - 2) < 1e-9
        }
        assert pairs - border == too_close - border
        assert len(refused) == len(pairs)  # each pair once
        assert (found["order_a"] <= found["order_b"]).all()
        # every line but the last stands in it with the next one above
        assert len(found) >= len(orders) - 1

    def test_what_is_needed_is_enough_for_a_spectrum(self):
        # the power of two equal lines under a Hann window, mean over their phases. By its transform, 1/2 a bin off
        # the peak and 0.849 half a bin off: at the length called for there is a dip of 1/sqrt(2) between two peaks,
        # at half of it the middle is 1.07 times as high as either line's place
        needed = collisions(table_of(("a", 10.0), ("b", 10.04)), revolutions=10).loc[0, "revolutions_needed"]
        assert needed == pytest.approx(50)

        def dip(revolutions):
            angle = np.arange(0, revolutions, 1 / 32)
            window = np.hanning(angle.size + 1)[:-1]
            orders = np.array([10.0, 10.02, 10.04])
            kernel = np.exp(-2j * np.pi * orders[:, None] * angle) * window
            spectra = [np.abs(kernel @ np.exp(2j * np.pi * order * angle)) / window.sum() for order in (10.0, 10.04)]
            low, middle, high = np.sqrt(spectra[0] ** 2 + spectra[1] ** 2)  # the mean over their phases
            return middle / min(low, high)

        assert dip(needed) < 0.75
        assert dip(needed / 2) > 1
