"""Shafts that bend between bearings against the theory of beams, in the equations of motion and in a scene."""

import math

import numpy as np
import pytest
from moving_pair import motion, scene
from numpy.testing import assert_allclose

from data_synth import SceneError, simulate
from data_synth.dynamics import BearingShaft, Body, Shaft, Support, build_system, solve_modes

STEEL_PA, STEEL_KG_M3 = 206e9, 7850.0


def bending_nm2(diameter_m):
    return STEEL_PA * math.pi * diameter_m**4 / 64


def lateral_hz(scene_):
    """Return the frequency of the mode of the pinion across the line of action, which the teeth do not press."""
    system = motion(scene_).system
    modes = solve_modes(system)
    pressed = np.abs(system.meshes[0].direction @ modes.shapes)
    own = [number for number, name in enumerate(system.names) if name in ("pinion x", "pinion y")]
    moves = np.linalg.norm(modes.shapes[own], axis=0) * math.sqrt(system.mass[own[0], own[0]])
    (found,) = np.flatnonzero((pressed < 1e-6 * pressed.max()) & (moves > 0.5))
    return modes.frequencies_hz[found]


def with_shaft(*, diameter_mm, to_bearings_mm, mass_kg, radial_n_m=1e14):
    """Return the pair whose pinion is on a shaft that bends."""
    links = {name: {"mass_kg": mass_kg, "inertia_kg_m2": 0.01} for name in ("pinion", "gear")}
    return scene(
        dynamics={
            "shafts": {"pinion": {"diameter_mm": diameter_mm, "to_bearings_mm": to_bearings_mm}},
            "bearings": {"pinion": {"radial_n_m": radial_n_m}, "gear": {"radial_n_m": 1e8}},
            "links": links,
        }
    )


def test_jeffcott_s_rotor():
    rotor = with_shaft(diameter_mm=12, to_bearings_mm=[400, 400], mass_kg=5.0)
    expected = math.sqrt(48 * bending_nm2(0.012) / 0.8**3 / 5.0) / (2 * math.pi)
    assert_allclose(lateral_hz(rotor), expected, rtol=1e-3)  # shear adds 3e-4 to its compliance


def test_the_first_frequency_of_a_beam_on_simple_supports():
    # (pi / L)^2 sqrt(EI / rho A); 17/35 of its mass in the middle are as slow, to 0.7 % (Rayleigh)
    area = math.pi * 0.02**2 / 4
    expected = math.pi / 2 / 1.0**2 * math.sqrt(bending_nm2(0.02) / (STEEL_KG_M3 * area))
    beam = with_shaft(diameter_mm=20, to_bearings_mm=[500, 500], mass_kg=17 / 35 * STEEL_KG_M3 * area * 1.0)
    assert_allclose(lateral_hz(beam), expected, rtol=8e-3)


def test_a_rotor_beside_the_middle_gives_way_as_the_textbook_has_it():
    a, b = 0.2, 0.5
    radial, tilt, ahead_m = BearingShaft(diameter_m=0.01, to_bearings_m=(a, b)).on_bearings(1e15)
    # a force bends it by a^2 b^2 / (3 EI L), and tilts it by a b (b - a) / (3 EI L)
    displaced, tilted = 1 / radial + ahead_m**2 / tilt, -ahead_m / tilt
    assert_allclose(displaced, a**2 * b**2 / (3 * bending_nm2(0.01) * (a + b)), rtol=1e-3)
    assert_allclose(tilted, a * b * (b - a) / (3 * bending_nm2(0.01) * (a + b)), rtol=1e-3)


@pytest.mark.parametrize(("a", "b", "radial"), [(0.05, 0.12, 1e8), (0.3, 0.1, 1e7)])
def test_it_is_two_elements_of_timoshenko_s_beam_on_springs(a, b, radial):
    places = {"before": -a, "rotor": 0.0, "behind": b}
    every = [
        Body(
            name=name, mass_kg=1.0, inertia_kgm2=1.0, tilt_inertia_kgm2=1.0, centre_m=(0, 0, z), motions=("x", "tilt y")
        )
        for name, z in places.items()
    ]
    shafts = [Shaft(between=pair, diameter_m=0.04, bore_m=0.01) for pair in (("before", "rotor"), ("rotor", "behind"))]
    held = [Support(between=(name, None), x=radial) for name in ("before", "behind")]
    compliance = np.linalg.inv(build_system(every, [*shafts, *held]).stiffness)[2:4, 2:4]
    own, tilt, ahead_m = BearingShaft(diameter_m=0.04, bore_m=0.01, to_bearings_m=(a, b)).on_bearings(radial)
    support = Support(between=("rotor", None), point_m=(0, 0, ahead_m), x=own, tilt_y=tilt)
    assert_allclose(np.linalg.inv(build_system(every[1:2], [support]).stiffness), compliance, rtol=1e-9)


def test_a_record_is_that_of_springs_as_soft():
    # in the middle: the beam with its shear, and both bearings, in series
    area, length, kappa = math.pi * 0.03**2 / 4, 0.2, 6 * 1.3 / (7 + 6 * 0.3)
    bent = length**3 / (48 * bending_nm2(0.03)) + length / (4 * kappa * STEEL_PA / 2.6 * area) + 1 / 2e8
    shaft = {"shafts": {"pinion": {"diameter_mm": 30, "to_bearings_mm": [100, 100]}}}
    both = {"pinion": {"radial_n_m": 1e8}, "gear": {"radial_n_m": 1e8}}
    softer = both | {"pinion": {"radial_n_m": 1 / bent}}
    curved = simulate(scene(dynamics={**shaft, "bearings": both}), seed=1)["a"].values
    springs = simulate(scene(dynamics={"bearings": softer}), seed=1)["a"].values
    rigid = simulate(scene(dynamics={"bearings": both}), seed=1)["a"].values
    assert np.std(curved - springs) < 1e-3 * np.std(springs)
    assert np.std(curved - rigid) > 0.1 * np.std(springs)


@pytest.mark.parametrize(
    ("shafts", "words"),
    [
        (
            {"pinion": {"diameter_mm": 30, "bore_mm": 30, "to_bearings_mm": [10, 10]}},
            "bore_mm = 30 must be below diameter_mm = 30",
        ),
        ({"pinion": {"diameter_mm": 30, "to_bearings_mm": [10, 0]}}, "to_bearings_mm"),
        ({"pinon": {"diameter_mm": 30, "to_bearings_mm": [10, 9]}}, 'shafts names "pinon".*did you mean "pinion"'),
    ],
)
def test_shafts_that_cannot_be_are_refused(shafts, words):
    with pytest.raises(SceneError, match=words):
        simulate(scene(dynamics={"shafts": shafts}), seed=1)
