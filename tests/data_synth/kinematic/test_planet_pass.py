import math
from fractions import Fraction

import numpy as np
from numpy.testing import assert_allclose
from scipy.special import ive

from data_synth.kinematic.planet_pass import MovingPath, PassWindow, planet_pass_family

WINDOW = PassWindow(half_width_rad=math.radians(40), floor=0.1)


def test_the_largest_line_of_99_teeth_and_4_planets_is_beside_the_mesh():
    planets = MovingPath(window=WINDOW, places_rad=np.pi / 2 * np.arange(4), strengths=np.ones(4))
    mesh = {"component": "ring", "source": "ring", "carrier_order": Fraction(3, 14), "coefficients": np.ones(1)}
    family = planet_pass_family(planets, ring_teeth=99, **mesh)
    assert int(np.argmax(np.abs(family.coefficients))) + 1 == 100  # (99 + 1) mod 4 = 0


def test_the_window_is_made_of_bessel_functions():
    # exp(kappa (cos t - 1)) = sum_j exp(-kappa) I_j(kappa) exp(1j j t) (Abramowitz and Stegun 9.6.34)
    found = PassWindow(half_width_rad=math.radians(25)).coefficients()
    kappa = math.log(2) / (1 - math.cos(math.radians(25)))
    assert_allclose(found, ive(np.arange(found.size), kappa), rtol=1e-9, atol=1e-13)
    assert ive(found.size, kappa) < 1e-6 * ive(0, kappa)
    assert_allclose(WINDOW.gain([0, math.radians(40), math.pi]), [1, 0.55, 0.1], atol=0.01)
