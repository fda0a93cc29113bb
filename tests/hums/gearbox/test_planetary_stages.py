"""Planetary stages: which gearboxes have one, and where its planets stand."""

from fractions import Fraction

import pytest

import hums
from hums.gearbox.planetary_stages import planetary_stages


def stages_of(name):
    return planetary_stages(hums.solve_kinematics(hums.load_gearbox(name)))


def test_teeth_and_places_are_those_of_the_drawing():
    (stage,) = stages_of("planetary-27-36-99")
    teeth = stage.teeth
    assert (teeth.sun, teeth.planet, teeth.ring) == (27, 36, 99)
    assert teeth.positions_rev == (0, Fraction(1, 3), Fraction(2, 3))  # (27 + 99) / 3 = 42, a whole number
    assert (stage.sun, stage.carrier, stage.misfit) == ("sun", "carrier", "")


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # of its teeth
def test_unevenly_spaced_planets_stand_where_they_can_be_assembled():
    # (27 + 99) / 4 is not whole: the drawing has them at 0, 32, 63 and 95 times 360 / 126 degrees
    (stage,) = stages_of("oh-58")
    assert stage.teeth.positions_rev == tuple(Fraction(place, 27 + 99) for place in (0, 32, 63, 95))
    assert stage.misfit == ""


@pytest.mark.parametrize("name", ["two-stage", "wolfrom", "nelson-bevel-planet"])
def test_no_simple_stage_without_planets_or_with_stepped_or_bevel_ones(name):
    assert stages_of(name) == []
