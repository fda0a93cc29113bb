"""Tooth friction as a key of a scene, and gears without load."""

import math

import numpy as np
import pytest
from declared_pair import declared_pair
from moving_pair import MODULE_MM, motion, scene
from numpy.testing import assert_allclose

from data_synth import SceneError, load_scene, simulate

COEFFICIENT = 0.06
RUBBING = {"friction_coefficient": COEFFICIENT}


@pytest.mark.parametrize("driver", ["pinion", "gear"])
def test_the_mean_loss_of_a_scene_s_friction_is_ohlendorf_s(driver):
    # Ohlendorf (1958), load in equal parts: mu pi (u + 1) / (z1 u) (1 - e + e1^2 + e2^2) of the power
    gearbox = declared_pair(teeth=(36, 63), wheel="gear", module_mm=MODULE_MM) | {"reference": driver}
    load = {"link": "gear" if driver == "pinion" else "pinion", "nm": 130}
    moving = motion(scene(gearbox=gearbox, torque=load, mesh=RUBBING))
    (mesh,), rigid = moving.system.meshes, moving.drive_load.rigid_motion
    phases = (np.arange(20_000) + 0.5) / 20_000
    power = sum(force.factor(phases) * (force.direction @ rigid) for force in mesh.friction)
    assert np.all(power <= 0)  # whichever gear drives
    ratios, (z1, z2) = contact_ratios(36, 63), (36, 63)
    loss = math.pi * (z1 + z2) / (z1 * z2) * (1 - sum(ratios) + sum(ratio**2 for ratio in ratios))
    base_m = abs(mesh.direction[moving.system.names.index(f"{driver} rotation")])
    assert_allclose(-np.mean(power) / base_m, COEFFICIENT * loss, rtol=1e-4)  # 20,000 phases, some jumps between them


def contact_ratios(*teeth):
    """Parts of the contact ratio before and after the pitch point, by the tip circles of spur gears of 20 degrees."""
    cosine = math.cos(math.radians(20))
    return [
        z / (2 * math.pi) * (math.tan(math.acos(z * cosine / (z + 2))) - math.tan(math.acos(cosine))) for z in teeth
    ]


def test_friction_shifts_with_the_teeth():
    # it turns round where the pair is at the pitch point, as the teeth's random phase has it
    moving = motion(scene(mesh=RUBBING))
    (mesh,) = moving.system.meshes
    friction = mesh.friction[0].factor.friction
    assert_allclose(mesh.stiffness.by_cycles, friction.by_cycles)
    jumps = np.array(mesh.friction[0].factor.jumps)
    sideways = mesh.friction[0].factor
    assert np.all(np.abs(sideways(jumps + 1e-9) - sideways(jumps - 1e-9)) > COEFFICIENT / 3)


def test_records_with_friction_differ_and_tend_to_those_without():
    smooth = simulate(scene(duration_s=0.05), seed=1)["a"].values
    none = simulate(scene(duration_s=0.05, mesh={"friction_coefficient": 0}), seed=1)
    assert none["a"].values.tobytes() == smooth.tobytes()  # where a sweep over friction begins
    differences = [
        np.std(simulate(scene(duration_s=0.05, mesh={"friction_coefficient": mu}), seed=1)["a"].values - smooth)
        for mu in (0.06, 0.006)
    ]
    assert differences[0] > 1e-3 * np.std(smooth)
    assert differences[1] == pytest.approx(differences[0] / 10, rel=0.05)  # linear but for the coupling


def test_friction_that_is_not_known_is_refused():
    planets = load_scene("planets-in-motion")
    dynamics = planets.dynamics.changed(meshes={"planet-ring": RUBBING})
    with pytest.raises(SceneError, match=r"friction_coefficient = 0\.06, but friction is modelled for external gears"):
        simulate(planets.changed(dynamics=dynamics, duration_s=0.2), seed=1)
    rubbing = simulate(scene(mesh=RUBBING, fidelity="auto", duration_s=0.1), seed=1)
    assert rubbing.attrs["truth_fidelity"].startswith('dynamic: the teeth of "mesh" rub')


@pytest.mark.parametrize("fidelity", ["kinematic", "dynamic", "auto"])
def test_gears_without_load_move_by_their_errors_alone(fidelity):
    unloaded = {"link": "gear", "nm": 0}
    record = simulate(scene(fidelity=fidelity, torque=unloaded, duration_s=0.1), seed=1)
    values = record["a"].values
    assert np.all(np.isfinite(values))
    assert np.std(values) > 0
    if fidelity != "kinematic":
        # a linear system under the transmission error alone: twice the error, twice the motion
        twice = simulate(
            scene(fidelity=fidelity, torque=unloaded, duration_s=0.1, mesh={"error_um": 6, "shape": "constant"}), seed=1
        )["a"].values
        once = simulate(
            scene(fidelity=fidelity, torque=unloaded, duration_s=0.1, mesh={"error_um": 3, "shape": "constant"}), seed=1
        )["a"].values
        assert_allclose(twice, 2 * once, atol=1e-4 * np.max(np.abs(twice)))
        # with the play that gears have, they hang between their flanks
        hanging = scene(fidelity=fidelity, torque=unloaded, duration_s=0.1, mesh={"backlash_um": None})
        assert not simulate(hanging, seed=1)["a"].values.any()
    assert record["truth_torque"].values.max() == 0
