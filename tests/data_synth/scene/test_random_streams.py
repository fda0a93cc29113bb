"""What belongs to a machine stays the same from record to record, and turns with it in between."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import Scene, load_scene, simulate
from data_synth.scene.random_streams import Streams
from data_synth.simulation import noise_free

STEADY = {"noise": {"rms": 0}, "duration_s": 2, "resonance": {"frequency_hz": 3000, "damping_ratio": 0.05}}
IMPERFECT = {"gears": {"grade": 7}, "imbalance": {}, "mounts": {}, "gains": {}}


def table(name, **changes):
    base = load_scene(name).model_dump(mode="json", by_alias=True, exclude_none=True)
    return {**base, **STEADY, **changes}


def kinematic(**changes):
    fault = [{"kind": "tooth_crack", "component": "stage 1/intermediate", "depth_mm": 2.0}]
    mesh = {"dynamics": {"meshes": {"stage 1": {"module_mm": 3}, "stage 2": {"module_mm": 4}}}}
    steady = {"speed": {"link": "input", "rpm": 1200}, "torque": {"link": "output", "nm": 450}}
    return table("demo", fault=fault, rate_hz=12_000, **steady, **mesh, **changes)


def dynamic(**changes):
    fault = [{"kind": "tooth_crack", "component": "stage 1/intermediate", "depth_mm": 2.0}]
    return table("gears-in-motion", fault=fault, speed={"link": "input", "rpm": 1200}, rate_hz=12_000, **changes)


def planets(**changes):
    fault = [{"kind": "spall", "component": "sun-planet/sun", "size_mm": 0.1}]
    return table("planets-in-motion", fault=fault, speed={"link": "carrier", "rpm": 240}, rate_hz=12_240, **changes)


@pytest.mark.parametrize(
    ("made", "error"),
    [
        (kinematic(imperfections=IMPERFECT), 1e-9),
        (dynamic(imperfections=IMPERFECT), 3e-3),
        (planets(imperfections={"planets": {}, **IMPERFECT}), 5e-3),
    ],
    ids=["kinematic", "dynamic", "planets"],
)
def test_a_record_some_turns_later_is_the_later_part_of_a_longer_one(monkeypatch, made, error):
    scene, turns, samples = Scene.from_mapping(made | {"duration_s": 1}), 7, 600  # to a turn of the reference

    def channel(before):
        monkeypatch.setattr(Streams, "turns_before", before)
        if scene.fidelity != "kinematic":  # without the truth of a record
            return noise_free(scene, seed=3).signal[0]
        return simulate(scene, seed=3, machine_seed=5)[scene.sensors[0].name].values

    first, later = channel(0), channel(turns)
    expected, found = first[turns * samples :], later[: first.size - turns * samples]
    assert np.std(found - expected) < error * np.std(expected)
    assert np.std(later - first) > 0.1 * np.std(first)  # other shafts are elsewhere


def test_teeth_imbalance_and_sensors_of_a_machine_stay_and_its_noise_does_not():
    scene = Scene.from_mapping(kinematic(imperfections=IMPERFECT))
    one, two, other = (simulate(scene, seed=seed, machine_seed=of) for seed, of in ((1, 9), (2, 9), (1, 8)))
    # what turns with the reference has its lines where its mark finds them
    on_input = [
        number
        for number, (kind, component) in enumerate(
            zip(one["truth_kind"].values, one["truth_component"].values, strict=True)
        )
        if kind == "pitch_deviation" and component == "stage 1/pinion"
    ]
    assert len(on_input) > 20
    lines = [record["truth_amplitude"].values[0, on_input, 0] for record in (one, two, other)]
    assert_allclose(lines[1], lines[0], rtol=1e-9)
    assert np.all(np.abs(lines[2] / lines[0] - 1) > 1e-3)
    for variable in ("truth_gain", "truth_chain_poles"):
        assert_allclose(two[variable].values, one[variable].values)
    own = simulate(scene, seed=1)
    assert "truth_machine_seed" not in own.attrs
    noisy = scene.changed(noise=scene.noise.changed(rms=1.0))
    channels = [simulate(noisy, seed=seed, machine_seed=9)[scene.sensors[0].name].values for seed in (1, 2)]
    assert abs(np.corrcoef(*channels)[0, 1]) < 0.5


def test_a_declared_place_of_a_fault_is_kept():
    made = kinematic()
    places = [{**made["fault"][0], "component": "stage 1/pinion", "offset_rev": at} for at in (0.0, 0.25)]
    records = [simulate(Scene.from_mapping({**made, "fault": [fault]}), seed=1) for fault in places]
    for record, expected in zip(records, (0.0, 0.75), strict=True):  # turns from the mark, at 20 a second
        mark_s, struck_s = record["tachometer"].values[0], record["truth_impact_times_1"].values
        assert_allclose((20 * (struck_s - mark_s) - expected + 0.5) % 1, 0.5, atol=1e-9)


@pytest.mark.parametrize("kind", ["imbalance", "bent_shaft", "shaft_misalignment"])
def test_a_shaft_is_at_its_declared_place_when_the_reference_is_at_zero(kind):
    fault = {"kind": kind, "component": "intermediate", "size_mm": 0.1, "offset_rev": 0.2}
    quiet = {"shaft_amplitude": 0, "mesh_amplitude": 0}
    record = simulate(Scene.from_mapping({**kinematic(excitation=quiet), "fault": [fault]}), seed=1)
    crest_s = record["time"].values[np.argmax(record["input vertical"].values)]
    turned = 20 * (crest_s - record["tachometer"].values[0]) * 23 / 67
    # the filter at 4.7 kHz, of order 16, delays by 0.35 ms at 6.9 rev s-1, and crests are flat
    assert (turned + 0.2 + 0.5) % 1 == pytest.approx(0.5, abs=5e-3)
