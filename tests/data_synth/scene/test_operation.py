import numpy as np
import pytest
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate

BASE = {
    **TWO_STAGE,
    "rate_hz": 10_000,
    "duration_s": 2.0,
    "speed": {"link": "input", "rpm": 900},
    "sensor": [{"name": "a", "on": "input bearing", "units": "g"}],
}


def scene(**changes):
    return Scene.from_mapping({**BASE, **changes})


def test_steps_are_taken_at_their_times():
    stepped = scene(speed={"link": "input", "steps": [[0, 600], [0.5, 900], [1.5, 750]], "rise_s": 0.1})
    record = simulate(stepped, seed=1)
    expected = np.interp(record["truth_time"].values, [0.5, 0.6, 1.5, 1.6], [10, 15, 15, 12.5])
    assert_allclose(record["truth_speed"].values, expected, rtol=1e-12)
    jump = simulate(scene(speed={"link": "input", "steps": [[0, 600], [1, 900]]}), seed=1)
    turned = jump["truth_revolutions"].values
    assert_allclose(turned[-1] - turned[0], 10 + 15, rtol=1e-12)


def test_a_run_up_from_rest_follows_its_closed_form():
    # J w' = T - c w^2 from rest: w = w1 tanh(t / tau), w1^2 = T / c, tau = J / sqrt(T c); the angle w1 tau log cosh.
    # The torque acts on the output: its ratio brings 19 x 23 / (61 x 67) of it to the input
    ratio = 19 * 23 / (61 * 67)
    speed = {"link": "input", "run_up": {"inertia_kg_m2": 0.02, "load_nm_s2": 4e-4}}
    torque = {"link": "output", "nm": 10 / ratio}
    ran = scene(speed=speed, torque=torque, tachometer={"link": "input", "pulses_per_rev": 1, "offset_rev": 0.5})
    record = simulate(ran, seed=1)
    times, top = record["truth_time"].values, np.sqrt(10 / 4e-4)
    tau = 0.02 / np.sqrt(10 * 4e-4)
    assert_allclose(record["truth_speed"].values, top * np.tanh(times / tau) / (2 * np.pi), atol=1e-9)
    turns = top * tau * np.log(np.cosh(times / tau)) / (2 * np.pi) - 0.5
    assert_allclose(record["truth_revolutions"].values, turns, atol=1e-9)
    pulses = record["tachometer"].values
    marks = top * tau * np.log(np.cosh(pulses / tau)) / (2 * np.pi) - 0.5
    assert_allclose(marks, np.arange(pulses.size), atol=1e-8)


def test_amplitudes_grow_with_the_stated_power_of_speed():
    speed = {"link": "input", "rpm": [[0, 300], [2, 900]]}
    record = simulate(scene(speed=speed, excitation={"speed_exponent": 2}), seed=1)
    line = np.abs(record["truth_amplitude"].sel(truth_order=23.0).values[0])
    assert_allclose(line, 0.5 * (np.linspace(300, 900, 41) / 900) ** 2, rtol=1e-12)


def test_turbulence_rides_on_the_declared_speed():
    gusty = {"link": "input", "rpm": 900, "turbulence": {"rms": 20, "time_scale_s": 0.5, "highest_hz": 4}}
    first, again, other = (simulate(scene(duration_s=20, speed=gusty), seed=seed) for seed in (1, 1, 2))
    speed = first["truth_speed"].values
    assert_allclose(speed, again["truth_speed"].values, atol=0)
    assert not np.allclose(speed, other["truth_speed"].values)
    # 40 time scales and a spectrum cut at 4 Hz: mean and rms only roughly known
    assert np.mean(speed) == pytest.approx(15, abs=0.3)
    assert 0.1 < np.std(speed) < 0.6
    # the angle is that of the speed, between the truth's instants too
    pulses = first["tachometer"].values
    assert np.max(np.abs(np.diff(pulses) * 15 - 1)) < 0.2


def test_torque_turbulence_moves_the_load_and_nothing_else():
    torque = {"link": "output", "nm": 500, "unloaded_share": 0}
    gusts = {"rms": 50, "time_scale_s": 0.3, "highest_hz": 4}
    record = simulate(scene(torque={**torque, "turbulence": gusts}), seed=1)
    line = np.abs(record["truth_amplitude"].sel(truth_order=23.0).values[0])
    assert_allclose(line, 0.5 * np.abs(record["truth_torque"].values) / 500, rtol=1e-12)
    assert np.ptp(record["truth_torque"].values) > 50
    assert_allclose(record["truth_speed"].values, 15, rtol=1e-14)


def test_sources_speak_with_amplitudes_of_their_own():
    own = {"shafts": {"output": 0.7}, "meshes": {"stage 2": 0.25}}
    record = simulate(scene(excitation=own), seed=1)
    loudest = {
        (str(component), str(kind)): float(np.abs(record["truth_amplitude"].values[0, index, 0]))
        for index, (component, kind) in reversed(
            list(enumerate(zip(record["truth_component"].values, record["truth_kind"].values, strict=True)))
        )
    }
    assert loudest == pytest.approx(
        {
            ("input", "shaft"): 0.05,
            ("intermediate", "shaft"): 0.05,
            ("output", "shaft"): 0.7,
            ("stage 1", "gear_mesh"): 0.5,
            ("stage 2", "gear_mesh"): 0.25,
        }
    )
    written = scene(excitation=own)
    assert '[excitation.meshes]\n"stage 2" = 0.25' in written.to_toml()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"torque": {"link": "housing", "nm": 5}}, 'torque names the link "housing", which does not turn, so that'),
        ({"speed": {"link": "input"}}, "its values are missing; give rpm = a number or [[s, rpm], ...]"),
        ({"speed": {"link": "input", "rpm": 5, "steps": [[0, 5]]}}, "rpm and steps are both given; keep one"),
        (
            {"speed": {"link": "input", "rpm": 5, "rise_s": 1}},
            "rise_s = 1 is the duration of a step, but there are no",
        ),
        ({"speed": {"link": "input", "steps": [[0, 5], [1, 6], [2, 7]], "rise_s": 2}}, "reduce it to 1 or less"),
        ({"speed": {"link": "input", "run_up": {"inertia_kg_m2": 1}}}, "speed.run_up requires a driving torque"),
        ({"speed": {"link": "input", "run_up": {"inertia_kg_m2": -1}}}, "inertia_kg_m2 = -1"),
        (
            {"speed": {"link": "input", "rpm": 60, "turbulence": {"rms": 10, "time_scale_s": 1}}},
            "turbulence.rms = 10: 8 times that would stop a shaft at 60 rpm; lower it below 7.5",
        ),
        ({"excitation": {"meshes": {"stage 3": 1}}}, 'excitation.meshes names "stage 3"; did you mean "stage '),
        ({"excitation": {"shafts": {"input": -1}}}, "input should be greater than or equal to 0"),
    ],
)
def test_what_cannot_drive_a_gearbox_reads_as_a_sentence(change, sentence):
    with pytest.raises(SceneError) as caught:
        scene(**change)
    assert sentence in str(caught.value)


def test_a_load_that_wins_is_refused():
    speed = {"link": "input", "run_up": {"inertia_kg_m2": 0.1, "load_nm": 20.0, "rpm": 10}}
    with pytest.raises(SceneError, match=r"the load reverses the shaft, to .* rpm; raise the torque or lower the load"):
        simulate(scene(speed=speed, torque={"link": "input", "nm": 5}), seed=0)


def test_a_speed_beyond_the_rate_names_the_highest_order_that_fits():
    with pytest.raises(SceneError, match=r"twice the highest line, order 69, at top speed; .* that fits is 41.67"):
        simulate(scene(speed={"link": "input", "rpm": 7200}), seed=0)
