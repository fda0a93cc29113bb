import tomllib

import numpy as np
import pytest
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.kinematic._harmonics_kernels import add_series
from data_synth.transfer._acquisition_kernels import add_pole_responses
from hums.records.channels import tachometers

HEALTHY = {
    **TWO_STAGE,
    "speed": {"link": "input", "rpm": 6000},
}
RUN_UP = {
    **HEALTHY,
    "duration_s": 0.6,
    "speed": {"link": "output", "rpm": [[0, 580], [0.3, 660], [0.6, 620]]},
    "torque": {"link": "input", "nm": [[0, 100], [0.4, 20]]},
    "path": {"frequency_hz": 5000, "damping_ratio": 0.1},
    "tachometer": {"link": "intermediate", "pulses_per_rev": 3},
}


def scene(table, **changes):
    return Scene.from_mapping({**table, **changes})


def reference_turns(record, times_s):
    """Revolutions of the reference since the first pulse, from the declared profile alone.

    Mean speed times duration, piece by piece: exact for a speed that is linear in each piece.
    """
    scene = Scene.from_mapping(tomllib.loads(record.attrs["truth_scene"]))
    at, rpm = np.array(scene.speed.knots).T
    speed = rpm / 60 / float(abs(scene.ratio(scene.speed.link)))
    if at.size == 1:
        return speed[0] * (times_s - record["tachometer"].values[0])

    def turns(until_s):
        ends = np.clip(until_s, at[:-1, None], at[1:, None])
        return np.sum((ends - at[:-1, None]) * (np.interp(ends, at, speed) + speed[:-1, None]) / 2, axis=0)

    return turns(times_s) - turns(record["tachometer"].values[:1])


def rebuilt(record):
    """The signal that the listed lines make, their amplitudes linear between the truth's instants."""
    times, instants, signal = record["time"].values, record["truth_time"].values, 0.0
    turns = reference_turns(record, times)
    for order, z in zip(record["truth_order"].values, record["truth_amplitude"].values[0], strict=True):
        signal = signal + (np.interp(times, instants, z) * np.exp(2j * np.pi * order * turns)).real
    return signal


def test_in_a_run_up_the_truth_is_the_whole_signal():
    # Z is linear between the instants by construction, so only the rounding of the angle is left: 69 x 60 turns
    record = simulate(scene(RUN_UP), seed=4)
    assert_allclose(record["a"].values, rebuilt(record), atol=1e-11)
    truth = record["truth_amplitude"].values[0]
    assert np.max(np.abs(truth[:, 0] / truth[:, -1])) > 1.5  # load and path did change it
    assert np.max(np.abs(np.angle(truth[:, 0] / truth[:, -1]))) > 0.1


def test_truth_amplitude_is_amplitude_times_load_times_path():
    record = simulate(scene(RUN_UP), seed=5)
    line = record["truth_amplitude"].sel(truth_order=23.0, truth_channel="a").values
    instants, speed = record["truth_time"].values, record["truth_speed"].values
    load = 0.3 + 0.7 * np.interp(instants, [0, 0.4], [1.0, 0.2])
    ratio = 23 * speed / 5000
    assert_allclose(np.abs(line), 0.5 * load / np.hypot(1 - ratio**2, 2 * 0.1 * ratio), rtol=1e-12)
    assert str(record["truth_component"].sel(truth_order=23.0).values) == "stage 1"
    assert str(record["truth_kind"].sel(truth_order=23.0).values) == "gear_mesh"


def test_a_healthy_gearbox_has_no_sidebands():
    record = simulate(scene(HEALTHY), seed=6)
    shafts, meshes = (1, 23 / 67, 437 / 4087), (23, 437 / 67)
    assert_allclose(
        record["truth_order"].values, sorted(h * order for order in shafts + meshes for h in (1, 2, 3)), rtol=1e-14
    )
    # and none in the signal: all that is not a listed line is rounding
    assert_allclose(record["a"].values, rebuilt(record), atol=1e-11)
    assert record["truth_fault_component"].size == record["truth_fault_kind"].size == 0
    assert not [name for name in record if str(name).startswith("truth_impact")]


def test_a_crack_adds_lines_at_the_mesh_and_multiples_of_its_gear_s_turns_only():
    crack = {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 1.5, "impact_per_mm": 0}
    sound, cracked = (
        simulate(scene(HEALTHY, rate_hz=30_000, duration_s=0.25, fault=faults), seed=7) for faults in ([], [crack])
    )
    added = sorted(set(cracked["truth_order"].values) - set(sound["truth_order"].values))
    assert added
    assert_allclose(added, np.round(added), rtol=1e-15)  # whole orders: 23 h +- k
    kinds = set(cracked["truth_kind"].sel(truth_order=added).values)
    assert kinds == {"tooth"}
    assert_allclose(cracked["a"].values, rebuilt(cracked), atol=1e-11)
    # the rest of the signal is as it was
    others = sound["truth_order"].values[sound["truth_order"].values % 1 != 0]
    assert_allclose(
        cracked["truth_amplitude"].sel(truth_order=others).values,
        sound["truth_amplitude"].sel(truth_order=others).values,
        rtol=1e-14,
    )


def test_impacts_add_to_the_listed_orders_what_the_truth_says():
    # 100 rev/s at 200 kHz: whole turns in whole samples, so the transform of the record is its order spectrum.
    # What folds back from above 100 kHz falls with the square of the rate: below 2 zeta (f_n/rate)^2 of the peak
    crack = {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 2.0}
    record = simulate(scene(HEALTHY, rate_hz=200_000, duration_s=0.67, fault=[crack]), seed=8)
    values = record["a"].values
    bins = np.fft.rfft(values) * 2 / values.size  # 67 turns: an order is 67 bins
    start = reference_turns(record, np.zeros(1))[0]
    peak = 2 * 100 * 2.0 / (2 * 0.03 * 2 * np.pi * 8000)
    whole = [order for order in record["truth_order"].values if order == round(order)]
    truth = record["truth_amplitude"].sel(truth_order=whole).values[0, :, 0]
    found = np.array([bins[round(67 * order)] for order in whole]) * np.exp(-2j * np.pi * np.array(whole) * start)
    leak = 1e-4  # the output shaft's and stage 2's lines are not whole in 67 turns
    assert_allclose(found, truth, atol=2 * 0.03 * (8000 / 200_000) ** 2 * peak + leak)


def test_the_tachometer_pulses_at_whole_parts_of_a_turn():
    record = simulate(scene(RUN_UP), seed=9)
    assert tachometers(record) == ["tachometer"]
    pulses = record["tachometer"].values
    turns = reference_turns(record, pulses) * 23 / 67 * 3
    assert_allclose(turns, np.arange(pulses.size), atol=1e-11)
    assert record["tachometer"].attrs["shaft"] == "intermediate"
    given = scene(HEALTHY, tachometer={"link": "input", "pulses_per_rev": 1, "offset_rev": 0.25})
    assert simulate(given, seed=9)["tachometer"].values[0] == pytest.approx(0.0025, rel=1e-12)


def test_bearing_impacts_ring_at_their_stated_times():
    fault = {"kind": "outer_race", "component": "input bearing", "size_mm": 0.5, "slip_std": 0.02}
    quiet = {"shaft_amplitude": 0, "mesh_amplitude": 0}
    record = simulate(scene(HEALTHY, excitation=quiet, fault=[fault]), seed=10)
    struck = record["truth_impact_times_1"]
    assert struck.attrs["component"] == "input bearing"
    assert list(record["truth_fault_kind"].values) == ["outer_race"]
    # 355.5 impacts a second, known to 2 % / sqrt(355)
    assert struck.size == pytest.approx(100 * 3.5553719, rel=0.005)
    times = record["time"].values
    natural = 2 * np.pi * 8000
    since = times[:, None] - struck.values
    heard = 0.5 * np.where(since >= 0, np.exp(-0.03 * natural * np.maximum(since, 0)), 0.0)
    expected = np.sum(heard * np.sin(natural * np.sqrt(1 - 0.03**2) * since), axis=1)
    late = times > 0.03  # earlier samples also hear impacts from before the record
    assert_allclose(record["a"].values[late], expected[late], atol=1e-10)
    assert record.sizes["truth_order"] == 0


def test_noise_is_white_and_of_the_stated_size():
    loud = simulate(scene(HEALTHY, noise={"rms": 0.2}), seed=11)
    clean = simulate(scene(HEALTHY), seed=11)
    noise = loud["a"].values - clean["a"].values
    # 20000 samples: the rms is known to 1 / sqrt(40000) = 0.5 %, a correlation to 0.7 %; 4 of each
    assert np.std(noise) == pytest.approx(0.2, rel=0.02)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.028 * 0.2**2


def test_each_sensor_receives_each_source_by_its_own_path():
    common = {"on": "stage 1", "units": "m s-2", "anti_alias": "none", "direction": [1, 0, 0]}
    sensors = [{"name": name, **common} for name in ("a", "b")]
    record = simulate(scene(RUN_UP, sensor=sensors), seed=12)
    first, second = record["truth_amplitude"].values
    gains = second / first
    assert_allclose(gains, gains[:, :1] * np.ones(gains.shape[1]), rtol=1e-12)
    assert len(np.unique(np.round(gains[:, 0], 9))) == 5  # three shafts, two meshes
    assert np.all((np.abs(gains) >= 0.5) & (np.abs(gains) <= 2))
    assert record["b"].attrs["units"] == record["truth_amplitude"].attrs["units"] == "m s-2"
    alone = simulate(scene(RUN_UP), seed=12)
    assert_allclose(record["a"].values, alone["a"].values, atol=1e-13)


def test_kernels_round_every_operation_in_the_order_of_their_source():
    # the interpreter follows IEEE 754; a fused or reordered sum would differ in some of thousands of last digits
    rng = np.random.default_rng(5)
    lines = rng.standard_normal((2, 2, 9))
    turns, edges = np.cumsum(rng.random(701)), np.array([0, 701])
    poles = rng.standard_normal((3, 3)) + 1j * rng.standard_normal((3, 3))
    poles[0] *= 0.9 / np.abs(poles[0])  # decays
    drive = rng.standard_normal(702)
    compiled, interpreted = (
        (
            add_series_by(np.zeros(701), *lines, turns, np.linspace(0, 1, 701), edges),
            add_responses_by(np.zeros(701), drive, *poles, np.zeros(3, dtype=np.complex128)),
        )
        for add_series_by, add_responses_by in (
            (_returning_first(add_series), _returning_first(add_pole_responses)),
            (_returning_first(add_series.py_func), _returning_first(add_pole_responses.py_func)),
        )
    )
    for one, other in zip(compiled, interpreted, strict=True):
        assert one.any()
        assert one.tobytes() == other.tobytes()


def _returning_first(kernel):
    def called(signal, *arguments):
        kernel(signal, *arguments)
        return signal

    return called


def test_a_fault_leaves_noise_phases_and_tachometer_as_they_were():
    demo = load_scene("demo").changed(duration_s=0.3)
    one = demo.changed(faults=demo.faults[:1])
    both, single = simulate(demo, seed=3), simulate(one, seed=3)
    assert np.array_equal(both["tachometer"].values, single["tachometer"].values)
    assert np.array_equal(both["truth_amplitude"].values, single["truth_amplitude"].values)


def test_a_planetary_gearbox_is_simulated():
    faults = [
        {"kind": "tooth_crack", "component": "sun-planet/planet", "depth_mm": 1.0},
        {"kind": "inner_race", "component": "carrier front", "size_mm": 1.0},
    ]
    speed = {"link": "carrier", "rpm": 600}
    tachometer = {"link": "sun", "pulses_per_rev": 1}
    sensor = [{"name": "a", "on": "sun-planet", "units": "g"}]
    planetary = scene(
        HEALTHY, gearbox="planetary-27-36-99", speed=speed, tachometer=tachometer, fault=faults, sensor=sensor
    )
    record = simulate(planetary.changed(duration_s=0.5), seed=6)
    # carrier / sun = 27 / (27 + 99), mesh = 99 carrier turns (Willis); planet to carrier: mesh / 36
    orders = record["truth_order"].values
    mesh = 99 * 27 / 126
    assert np.min(np.abs(orders - mesh)) < 1e-12
    assert np.min(np.abs(orders - (mesh + mesh / 36))) < 1e-12
    assert record["truth_speed"].values[0] == pytest.approx(10 * 126 / 27)


@pytest.mark.parametrize(
    ("changes", "seed", "sentence"),
    [
        ({"rate_hz": 10_000}, 1, r"rate_hz = 10000 is not above 13800 Hz, twice the highest line, order 69"),
        ({"duration_s": 0.01}, 1, r"duration_s = 0.01, tachometer pulses within it: 1; a speed needs 2"),
        ({}, -1, r"seed = -1 must be a whole number, 0 or more"),
        ({}, True, r"seed = True must be a whole number"),
    ],
)
def test_what_cannot_be_simulated_is_refused(changes, seed, sentence):
    with pytest.raises(SceneError, match=sentence):
        simulate(scene(HEALTHY, **changes), seed=seed)
