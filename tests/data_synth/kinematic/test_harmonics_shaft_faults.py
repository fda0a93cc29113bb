from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.kinematic.harmonics import shaft_fault_family
from data_synth.transfer.paths import AnalogFilter, line_amplitudes


def family_of(kind, amplitude=0.2, order=Fraction(1)):
    return shaft_fault_family(kind, component="s", order=order, amplitude=amplitude, reference_speed_hz=25.0)


@pytest.mark.parametrize(("kind", "multiples"), [("imbalance", 1), ("bent_shaft", 2), ("shaft_misalignment", 3)])
def test_a_shaft_speaks_at_its_own_turns_only(kind, multiples):
    family = family_of(kind, order=Fraction(23, 67))
    assert family.orders == [k * Fraction(23, 67) for k in range(1, multiples + 1)]
    assert family.kind == "shaft"
    assert np.all(family.nonzero)
    largest = 1 if kind == "shaft_misalignment" else 0
    assert np.argmax(np.abs(family.coefficients)) == largest
    assert abs(family.coefficients[largest]) == pytest.approx(0.2)


def heard(family, speeds):
    load = 0.1 * np.ones(speeds.size)
    return line_amplitudes(family, gains=np.ones(1), speed_hz=speeds, load=load, path=AnalogFilter())[0]


def test_imbalance_grows_with_the_square_of_the_speed_and_not_with_the_load():
    speeds = np.array([10.0, 25.0, 50.0])
    assert_allclose(np.abs(heard(family_of("imbalance"), speeds)[0]), 0.2 * (speeds / 25) ** 2, rtol=1e-14)
    bow = heard(family_of("bent_shaft"), speeds)
    assert_allclose(np.abs(bow), np.outer([0.2, 0.04], np.ones(3)), rtol=1e-14)
