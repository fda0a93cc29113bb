"""Shafts that bend between bearings against the theory of beams, in the equations of motion and in a scene."""

import math

import numpy as np
import pytest
from moving_pair import scene
from numpy.testing import assert_allclose

from data_synth import SceneError, simulate
from data_synth.dynamics import BearingShaft, Body, Shaft, Support, build_system
from data_synth.vibration.run import scene_system

STEEL_PA = 206e9


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
    bent = length**3 / (48 * STEEL_PA * math.pi * 0.03**4 / 64) + length / (4 * kappa * STEEL_PA / 2.6 * area) + 1 / 2e8
    shaft = {"shafts": {"pinion": {"diameter_mm": 30, "to_bearings_mm": [100, 100]}}}
    both = {"pinion": {"radial_n_m": 1e8}, "gear": {"radial_n_m": 1e8}}
    softer = both | {"pinion": {"radial_n_m": 1 / bent}}
    curved = simulate(scene(dynamics={**shaft, "bearings": both}), seed=1)["a"].values
    springs = simulate(scene(dynamics={"bearings": softer}), seed=1)["a"].values
    rigid = simulate(scene(dynamics={"bearings": both}), seed=1)["a"].values
    assert np.std(curved - springs) < 1e-3 * np.std(springs)
    assert np.std(curved - rigid) > 0.1 * np.std(springs)


def test_the_faster_of_two_whirls_turns_with_its_shaft():
    # a gear beside the middle of its shaft tilts as it moves: its spin stiffens the whirl in its own sense
    shafts = {name: {"diameter_mm": 40, "to_bearings_mm": [30, 170]} for name in ("pinion", "gear")}
    free = {"shape": "constant", "stiffness_n_m": 1.0}  # either shaft whirls alone
    system = scene_system(scene(dynamics={"shafts": shafts, "damping_ratio": 1e-6}, mesh=free))(1000.0)
    inverse, still = np.linalg.inv(system.mass), np.zeros((system.dof, system.dof))
    stiffness, gyroscopic = inverse @ system.mean_stiffness(), inverse @ system.gyroscopic
    rates, modes = np.linalg.eig(np.block([[still, np.eye(system.dof)], [-stiffness, -gyroscopic]]))
    for name, turns in (("pinion", 1), ("gear", -1)):
        tilts = modes[[system.names.index(f"{name} tilt {axis}") for axis in "xy"]]
        own = np.flatnonzero((rates.imag > 1.0) & (np.abs(tilts[0]) > 1e-6 * np.max(np.abs(modes), axis=0)))
        around = -np.sign((tilts[0].conj() * tilts[1]).imag)  # 1 if y is a quarter of a turn behind x
        assert around[own[np.argsort(rates[own].imag)]].tolist() == [-turns, turns, -turns, turns]


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
