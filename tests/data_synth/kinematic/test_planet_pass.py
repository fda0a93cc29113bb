import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.testing import assert_allclose
from scipy.special import ive

from data_synth.kinematic.planet_pass import MovingPath, PassWindow
from data_synth.kinematic.planet_pass import planet_pass_family as pass_comb

RING = 99
WINDOW = PassWindow(half_width_rad=math.radians(40), floor=0.1)
MESH = np.array([1.0, 0.5j])
TURNS = np.arange(2048) / 2048  # of the carrier: every line up to 1023 is a bin


def even(planets):
    return MovingPath(window=WINDOW, places_rad=2 * np.pi * np.arange(planets) / planets, strengths=np.ones(planets))


def comb_of(path, **changes):
    given = {"ring_teeth": RING, "carrier_order": Fraction(3, 14), "coefficients": MESH, **changes}
    return pass_comb(path, component="planet-ring", source="planet-ring", **given)


def by_walking(path, coefficients=MESH, teeth=RING):
    """The sensor's signal planet by planet, where each is and how loud it is there."""
    signal = np.zeros(TURNS.size)
    for place, strength in zip(path.places_rad, path.strengths, strict=True):
        angle = 2 * np.pi * TURNS + place
        mesh = sum((c * np.exp(1j * teeth * h * angle)).real for h, c in enumerate(coefficients, start=1))
        signal += strength * path.window.gain(angle) * mesh
    return signal


def lines_of(signal):
    return 2 * np.fft.rfft(signal) / signal.size


def test_the_largest_line_of_99_teeth_and_4_planets_is_beside_the_mesh():
    family = comb_of(even(4))
    assert int(np.argmax(np.abs(family.coefficients))) + 1 == 100  # (99 + 1) mod 4 = 0


def test_unequal_planets_make_the_phasor_sum():
    path = replace(even(3), strengths=np.array([1.0, 0.9, 1.2]))
    path = replace(path, places_rad=path.places_rad + np.array([0.0, 0.01, -0.02]))
    found = lines_of(by_walking(path))
    family = comb_of(path)
    count = min(family.coefficients.size, 1000)
    # coefficients of the window below 1e-6 of the largest are left out, some of them folded onto one line
    assert_allclose(family.coefficients[:count], found[1 : count + 1], atol=1e-5 * np.max(np.abs(found)))
    # and by hand at the first sideband above the mesh, the window's coefficient by direct sum
    angle = 2 * np.pi * np.arange(4096) / 4096
    first = np.mean(WINDOW.gain(angle) * np.cos(angle))
    sum_of = sum(s * np.exp(1j * (RING + 1) * p) for s, p in zip(path.strengths, path.places_rad, strict=True))
    assert_allclose(family.coefficients[RING], first * sum_of, rtol=1e-4)


def test_the_window_is_made_of_bessel_functions():
    # exp(kappa (cos t - 1)) = sum_j exp(-kappa) I_j(kappa) exp(1j j t) (Abramowitz and Stegun 9.6.34)
    found = PassWindow(half_width_rad=math.radians(25)).coefficients()
    kappa = math.log(2) / (1 - math.cos(math.radians(25)))
    assert_allclose(found, ive(np.arange(found.size), kappa), rtol=1e-9, atol=1e-13)
    assert ive(found.size, kappa) < 1e-6 * ive(0, kappa)
    assert_allclose(WINDOW.gain([0, math.radians(40), math.pi]), [1, 0.55, 0.1], atol=0.01)
