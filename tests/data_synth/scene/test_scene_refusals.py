"""Scenes that cannot be: each is refused with a sentence that names the thing, its value and what to do."""

import pytest

from data_synth import Scene, SceneError, load_scene, make_dataset, simulate
from data_synth.plan import PlanError

DEMO = load_scene("gears-in-motion").model_dump(mode="json", by_alias=True, exclude_none=True)


def changed(**changes):
    return Scene.from_mapping({**DEMO, "duration_s": 0.1, **changes})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"fault": [{"kind": "spall", "component": "stage 3/pinion", "size_mm": 1.0}]},
            'fault 1: spall has no component "stage 3/pinion"; valid: "stage 1/pinion", "stage 1/intermediate", ',
        ),
        (
            {"torque": {"link": "housing", "nm": 450}},
            'torque names the link "housing", which does not turn, so that it transmits no power; name one that does',
        ),
        (
            {"torque": {"link": "input", "nm": 20}},
            'and the reference "input" drives; name the link that takes the power out as dynamics.load_on',
        ),
        (
            {"dynamics": {**DEMO["dynamics"], "load_on": "input"}},
            'dynamics.load_on = "input" is at rest or is the reference, which drives; name the link that takes the',
        ),
        (
            {"dynamics": {**DEMO["dynamics"], "links": {"q": {"mass_kg": 3}}}},
            'dynamics: links names "q"',
        ),
        (
            {"sensor": [{**DEMO["sensor"][0], "direction": [0, 0, 0]}]},
            "[0, 0, 0] is not a direction",
        ),
        (
            {"tachometer": {"link": "input", "pulses_per_rev": 4096}},
            "tachometer: pulses_per_rev = 4096 makes ",
        ),
        ({"sensor": [{**DEMO["sensor"][0], "name": "time"}]}, 'name = "time" is reserved in records'),
        ({"sensor": [{**DEMO["sensor"][0], "name": "a/b"}]}, 'name = "a/b" is reserved in records'),
        (
            {"dynamics": {**DEMO["dynamics"], "bearings": {"output": {"radial_n_m": -1e8}}}},
            "radial_n_m = -100000000.0: input should be greater than 0",
        ),
        (
            {"dynamics": {**DEMO["dynamics"], "meshes": {"stage 1": {"stiffness_n_m": -6e8}}}},
            "stiffness_n_m = -600000000.0: input should be greater than 0",
        ),
        (
            {"sensor": [{**DEMO["sensor"][0], "on": "nothing"}]},
            'sensor "input vertical" is on "nothing", which is not a bearing, link or mesh of gearbox "two-stage"',
        ),
        (
            {"speed": {"link": "input", "rpm": 90_000}},
            '"stage 1", 23, at top speed; raise rate_hz, or lower the speed: the highest order that fits is 16.67.',
        ),
        (
            {"fidelity": "kinematic", "speed": {"link": "input", "rpm": 30_000}},
            "raise rate_hz, or lower excitation.harmonics: the highest order that fits is 50.",
        ),
    ],
)
def test_a_bad_scene_gets_a_sentence(changes, sentence):
    with pytest.raises(SceneError) as caught:
        simulate(changed(**changes), seed=1)
    assert sentence in str(caught.value)


def test_a_plan_larger_than_the_disk_gets_a_sentence(monkeypatch, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text('scene = "gears-in-motion"\nrecords = 1000\nseed = 1\n', encoding="utf-8")
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 1_000_000_000}))
    with pytest.raises(
        PlanError, match=r"1000 records of 2 MB and .* MB of truth need .* but 1 GB are free at .*Lower records"
    ):
        make_dataset(plan, tmp_path / "set")


def test_a_torque_that_starts_nothing_gets_a_sentence():
    still = load_scene("wijianto").changed(torque={"link": "pinion", "nm": 0})
    with pytest.raises(SceneError, match=r"The link makes 0 revolutions: raise the torque to start it\.$"):
        simulate(still, seed=1)


def test_text_in_place_of_a_file_gets_a_sentence():
    with pytest.raises(SceneError, match=r"is text, not a file name; .*tomllib\.loads to from_mapping"):
        Scene.from_toml(load_scene("demo").to_toml())


def test_a_resonance_above_the_band_is_refused_only_where_a_fault_rings_it():
    moving = load_scene("gears-in-motion").changed(rate_hz=12_000)  # its crack has no impacts: its teeth vibrate
    assert moving.resonance.frequency_hz > moving.rate_hz / 2
    with pytest.raises(SceneError, match=r"resonance\.frequency_hz = 8000 is not below half of rate_hz = 12000"):
        moving.changed(fidelity="kinematic")
