from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.kinematic.shaft_faults import (
    bent_shaft,
    imbalance,
    imbalance_force_n,
    shaft_fault_family,
    shaft_misalignment,
)
from data_synth.transfer.paths import line_amplitudes

KINDS = {"imbalance": imbalance(), "bent shaft": bent_shaft(), "misalignment": shaft_misalignment()}


@pytest.mark.parametrize(("name", "multiples"), [("imbalance", 1), ("bent shaft", 2), ("misalignment", 3)])
def test_a_shaft_speaks_at_its_own_turns_only(name, multiples):
    family = shaft_fault_family(
        KINDS[name], component="shaft", order=Fraction(23, 67), amplitude=0.2, reference_speed_hz=25.0
    )
    assert family.orders == [k * Fraction(23, 67) for k in range(1, multiples + 1)]
    assert family.kind == "shaft"
    assert np.all(family.nonzero)
    largest = 1 if name == "misalignment" else 0
    assert np.argmax(np.abs(family.coefficients)) == largest
    assert abs(family.coefficients[largest]) == pytest.approx(0.2)


def heard(family, speeds):
    return line_amplitudes(family, gains=np.ones(1), speed_hz=speeds, load=0.1 * np.ones(speeds.size), mode=None)[0]


def test_imbalance_grows_with_the_square_of_the_speed_and_not_with_the_load():
    speeds = np.array([10.0, 25.0, 50.0])
    family = shaft_fault_family(imbalance(), component="s", order=Fraction(1), amplitude=0.2, reference_speed_hz=25.0)
    assert_allclose(np.abs(heard(family, speeds)[0]), 0.2 * (speeds / 25) ** 2, rtol=1e-14)
    bow = shaft_fault_family(bent_shaft(), component="s", order=Fraction(1), amplitude=0.2, reference_speed_hz=25.0)
    assert_allclose(np.abs(heard(bow, speeds)), np.outer([0.2, 0.04], np.ones(3)), rtol=1e-14)


def test_a_growing_imbalance_is_that_of_each_instant():
    sizes = np.array([0.1, 0.2, 0.4])
    family = shaft_fault_family(imbalance(), component="s", order=Fraction(1), amplitude=sizes, reference_speed_hz=25.0)
    assert_allclose(np.abs(heard(family, np.full(3, 25.0))[0]), sizes, rtol=1e-14)


def test_the_heavy_spot_points_where_it_is():
    # m e w^2 (cos, sin) of the turn of the heavy spot, 50 deg ahead of the datum
    speed, turns = 20.0, np.linspace(0, 2, 37)
    size = imbalance_force_n(mass_kg=2.0, eccentricity_m=1e-4, speed_hz=speed)
    spot = 2 * np.pi * turns - np.radians(50)
    force = imbalance(phase_rad=np.radians(50))
    given = {"speed_hz": speed, "size_n": size, "reference_speed_hz": speed}
    assert_allclose(force.force(turns, **given), 2e-4 * (40 * np.pi) ** 2 * np.cos(spot), atol=1e-12)
    assert_allclose(force.force(turns, twist=0.25, **given), 2e-4 * (40 * np.pi) ** 2 * np.sin(spot), atol=1e-12)
    faster = force.force(turns, speed_hz=2 * speed, size_n=size, reference_speed_hz=speed)
    assert_allclose(faster, 4 * force.force(turns, **given), rtol=1e-12)


def test_the_lines_are_the_force():
    kind = shaft_misalignment(phase_rad=0.3)
    family = shaft_fault_family(
        kind, component="s", order=Fraction(1), amplitude=1.5, reference_speed_hz=10.0, offset=0.2
    )
    rev = np.linspace(0, 1, 29)
    lines = (family.coefficients @ np.exp(2j * np.pi * np.outer([1, 2, 3], rev))).real
    assert_allclose(lines, kind.force(rev + 0.2, speed_hz=10.0, size_n=1.5, reference_speed_hz=10.0), atol=1e-13)
