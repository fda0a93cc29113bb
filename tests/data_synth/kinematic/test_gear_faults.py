import math
from fractions import Fraction

import numpy as np
from numpy.testing import assert_allclose
from scipy.special import ive

from data_synth import load_scene, simulate
from data_synth.kinematic.gear_faults import SIDEBAND_CUTOFF, gear_damage_family
from data_synth.kinematic.harmonics import HarmonicFamily
from data_synth.scene.faults import FaultyGear, ToothCrack
from data_synth.scene.scene import declared_size_mm

SCENE = load_scene("demo")


def crack(**changes):
    return ToothCrack(**{"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 1.0, **changes})


def crack_comb(fault, *, mesh, offset):
    return gear_damage_family(
        fault,
        gear=FaultyGear(teeth=float(mesh.base_order / SCENE.exact_orders("tooth")[fault.component])),
        mesh=mesh,
        tooth=SCENE.exact_orders("tooth")[fault.component],
        offset=offset,
        rise=fault.depth_mm * fault.factors[0],
        lag_rad=fault.depth_mm * fault.factors[1],
    )


def mesh(coefficients, base_order=23):
    values = np.asarray(coefficients, dtype=complex)
    return HarmonicFamily(
        component="stage 1",
        kind="gear_mesh",
        source="stage 1",
        base_order=Fraction(base_order),
        coefficients=values,
        load_dependent=True,
    )


def test_sidebands_are_bessel_functions():
    # exp(kappa (cos t - 1)) = sum_k exp(-kappa) I_k(kappa) exp(j k t) (Abramowitz and Stegun 9.6.34), and
    # (1 + a w) exp(-j b w) = sum_n (-j b)^n / n! (w^n + a w^(n + 1)), where w^n has kappa n in place of kappa
    kappa, a, b = math.log(2) / (1 - math.cos(math.pi / 23)), 0.3, 0.7

    def coefficient(k):
        powers = [ive(abs(k), n * kappa) if n else float(k == 0) for n in range(30)]
        terms = [(-1j * b) ** n / math.factorial(n) * (powers[n] + a * powers[n + 1]) for n in range(29)]
        line = 0.8j * np.exp(2j * np.pi * 0.3 * k) * (sum(terms) - (k == 0))
        return line if abs(line) >= SIDEBAND_CUTOFF * largest else 0.0

    largest = 0.0  # nothing is cut off while the largest is looked for
    largest = abs(coefficient(0))
    fault = crack(amplitude_per_mm=a, phase_rad_per_mm=b)
    family = crack_comb(fault, mesh=mesh([0.8j]), offset=0.3)
    assert {abs(order - 23) for order in family.orders[1:]} >= set(range(40))
    for k in range(-22, family.coefficients.size - 22):
        # the line at 23 + k, and the one at -(23 + k) folded onto it
        expected = coefficient(k) + np.conj(coefficient(-46 - k))
        assert_allclose(family.coefficients[23 + k - 1], expected, rtol=1e-11, atol=1e-15)
    assert np.argmax(np.abs(family.coefficients)) == 22


def test_a_missing_tooth_has_no_more_to_lose_than_its_height():
    scene = load_scene("gears-in-motion").changed(duration_s=0.2, fidelity="kinematic")
    module_mm = declared_size_mm(scene, "stage 1", "module_mm")

    def made(size_mm):
        broken = {"kind": "missing_tooth", "component": "stage 1/pinion", "size_mm": size_mm}
        return simulate(scene.changed(faults=(broken,)), seed=1)[scene.sensors[0].name].values

    whole = made(2.5 * module_mm)  # of 2.25 modules
    assert np.array_equal(made(30 * module_mm), whole)
    assert not np.array_equal(made(module_mm), whole)
