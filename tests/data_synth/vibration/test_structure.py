"""What a fidelity leaves out follows what it simulates, so that levels of one scene can be compared."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import Scene, load_scene, simulate
from data_synth.scene.random_streams import random_stream
from data_synth.simulation import noise_free
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.run import motion_of, prepare_gears

SIZE = {"face_width_mm": 30, "pressure_angle_deg": 20}
EVEN = {
    "stage 1": {"module_mm": 3, "shape": "constant", "error_um": 2.0, "damping_n_s_m": 300.0, **SIZE},
    "stage 2": {"module_mm": 4, "shape": "constant", "error_um": 3.0, **SIZE},
}


def scene(fidelity, *, name="gears-in-motion", dynamics=None, **changes):
    table = load_scene(name).model_dump(mode="json", by_alias=True, exclude_none=True)
    table |= {"fidelity": fidelity, "fault": [], "noise": {"rms": 0}, "excitation": {"shaft_amplitude": 0}}
    table |= {"duration_s": 0.2, **changes}
    return Scene.from_mapping(table | ({} if dynamics is None else {"dynamics": dynamics}))


def channel(*args, **kwargs):
    return noise_free(scene(*args, **kwargs), seed=1).signal[0]


def motion(made):
    stage = prepare_scene(made, rng_for=partial(random_stream, 1))
    return motion_of(stage, prepare_gears(stage), levels={mesh.name: made.fidelity for mesh in made.gearbox.meshes})


def apart(found, wanted):
    return np.std(found - wanted) / np.std(wanted)


def test_torsional_is_lateral_where_stiffness_is_constant():
    dynamics = {"meshes": EVEN, "bearings": {"input bearing": {"damping_s": 1e-5}}, "error": 1e-4}
    # the filter of the left-out motions is exact to 1e-4 up to a tenth of its rate
    assert apart(channel("torsional", dynamics=dynamics), channel("lateral", dynamics=dynamics)) < 1e-3


def test_planets_alike_as_well():
    meshes = {
        "sun-planet": {"shape": "constant", "error_um": 2.0},
        "planet-ring": {"shape": "constant", "error_um": 3.0},
    }
    for bearings in ({}, {"planet 2": {"radial_n_m": 2e7}}):
        dynamics = {"meshes": meshes, "damping_ratio": 0.05, "bearings": bearings, "error": 1e-4}
        lateral, torsional = (
            channel(fidelity, name="planets-in-motion", dynamics=dynamics) for fidelity in ("lateral", "torsional")
        )
        assert apart(torsional, lateral) < 3e-3


@pytest.mark.parametrize("radial", [1e8, 1e13])
def test_a_mesh_force_passes_a_body_on_its_bearing_as_an_oscillator(radial):
    bearings = {name: {"radial_n_m": radial} for name in ("input bearing", "intermediate bearing", "output")}
    ready = motion(scene("torsional", dynamics={"meshes": EVEN, "bearings": bearings, "elsewhere": 0.0}))
    structure, frequency_hz = ready.sensor_forces.structure, np.array([0.0, 300.0])
    found = structure.response(frequency_hz)[:, 0].sum(axis=0)  # of the first mesh, near the sensor
    # at rest the pinion's bearing bears the force whole; a rigid one passes it whole at any frequency
    along = abs(found[0])
    assert 0 < along < 1
    if radial == 1e13:
        assert_allclose(np.abs(found), along, rtol=1e-3)
    else:
        assert abs(found[1]) != pytest.approx(along, rel=1e-3)


def test_the_fidelities_of_a_scene_are_as_loud_within_some_decibels():
    scenes = {fidelity: scene(fidelity) for fidelity in ("torsional", "lateral", "full")}
    meshes = {name: {**table, "fidelity": "kinematic"} for name, table in _meshes(scenes["full"]).items()}
    scenes["kinematic"] = scene("full", dynamics={"meshes": meshes})
    rms = {name: np.std(simulate(made, seed=1)["input vertical"].values) for name, made in scenes.items()}
    decibels = {name: 20 * np.log10(value / rms["full"]) for name, value in rms.items()}
    assert abs(decibels["lateral"]) < 0.1  # spur gears have no more motions
    assert abs(decibels["kinematic"]) < 2
    assert abs(decibels["torsional"]) < 6  # 24 dB, if bearings passed mesh forces as statics does


def _meshes(made):
    return {name: mesh.model_dump(mode="json", exclude_none=True) for name, mesh in made.dynamics.meshes}
