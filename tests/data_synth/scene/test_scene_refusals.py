"""Scenes that cannot be: each is refused with a sentence that names the thing, its value and what to do."""

import pytest

from data_synth import Scene, SceneError, load_scene, simulate

DEMO = load_scene("gears-in-motion").model_dump(mode="json", by_alias=True, exclude_none=True)


def changed(**changes):
    return Scene.from_mapping({**DEMO, "duration_s": 0.1, **changes})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"torque": {"link": "input", "nm": 20}},
            'and the reference "input" drives; name the link that takes the power out as dynamics.load_on',
        ),
        (
            {"dynamics": {**DEMO["dynamics"], "load_on": "input"}},
            'dynamics.load_on = "input" is at rest or is the reference, which drives; name the link that takes the',
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
            {"speed": {"link": "input", "rpm": 90_000}},
            '"stage 1", 23, at top speed; raise rate_hz, or lower the speed: the highest order that fits is 16.67.',
        ),
    ],
)
def test_a_bad_scene_gets_a_sentence(changes, sentence):
    with pytest.raises(SceneError) as caught:
        simulate(changed(**changes), seed=1)
    assert sentence in str(caught.value)


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
