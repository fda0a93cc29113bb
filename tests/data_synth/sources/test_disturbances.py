"""Lines, impacts and noise from outside of the machine, measured from records."""

from functools import partial

import numpy as np
import pytest
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.scene.random_streams import random_stream
from data_synth.sources.disturbances import noise_level

MILL = {
    **TWO_STAGE,
    "rate_hz": 10_000,
    "duration_s": 2,
    "speed": {"link": "input", "rpm": [[0, 900], [2, 1200]]},
    "excitation": {"shaft_amplitude": 0, "mesh_amplitude": 0},
    "resonance": {"frequency_hz": 2500, "damping_ratio": 0.05},
    "sensor": [{"name": name, "on": "input bearing", "units": "m s-2", "anti_alias": "none"} for name in ("a", "b")],
}
MODE = {"frequency_hz": 2000, "damping_ratio": 0.04}


def scene(imperfections=None, **changes):
    declared = {} if imperfections is None else {"imperfections": imperfections}
    return Scene.from_mapping({**MILL, **declared, **changes})


def record_of(imperfections=None, *, seed=1, **changes):
    return simulate(scene(imperfections, **changes), seed=seed)


def spectrum(record, name="a"):
    return np.abs(np.fft.rfft(record[name].values)) / (record[name].size / 2)


def test_mains_have_their_harmonics():
    record = record_of({"electrical": {"amplitude_m_s2": 0.2, "mains_hz": 60, "decay": 0.25}})
    lines = spectrum(record)
    assert_allclose(lines[[120, 240, 360]], [0.2, 0.05, 0.0125], rtol=1e-9)
    assert_allclose(np.sum(lines**2), 0.2**2 + 0.05**2 + 0.0125**2, rtol=1e-9)  # and nothing else
    assert_allclose(np.abs(record["truth_electrical"].sel(truth_channel="a")), [0.2, 0.05, 0.0125])


def test_an_inverter_has_the_sums_of_its_frequencies():
    lines = [[0, 1, 1.0], [1, 6, 0.3], [-1, 6, 0.2]]
    inverter = {"output_hz": 41.5, "lines": lines}
    found = spectrum(record_of({"electrical": {"amplitude_m_s2": 0.1, "harmonics": 1, "inverter": inverter}}))
    assert_allclose(found[[100, 83, 598, 398]], [0.1, 0.1, 0.03, 0.02], rtol=1e-9)


def test_an_inverter_follows_its_motor():
    record = record_of({"electrical": {"inverter": {"pole_pairs": 3, "slip": 0.04}}})
    times_s, output = record["time"].values, record["truth_electrical_output"].values
    # output turns: 3 / 0.96 to a turn of the shaft
    shaft = record["truth_revolutions"].values
    assert_allclose(output - output[0], (shaft - shaft[0]) * 3 / 0.96, atol=1e-9)
    # the speed rises evenly: turns are quadratic in time, from 15 to 20 rev/s in 2 s
    turns = output[0] + (15 * times_s + 5 / 4 * times_s**2) * 3 / 0.96
    rebuilt = sum(
        (z * np.exp(2j * np.pi * (m * 50 * times_s + n * turns))).real
        for z, (m, n) in zip(
            record["truth_electrical"].sel(truth_channel="b").values,
            record["truth_electrical_multiples"].values,
            strict=True,
        )
    )
    assert_allclose(record["b"].values, rebuilt, atol=1e-9)


def test_pick_up_swings_pulses_and_adds_some():
    pulses = {"link": "input", "pulses_per_rev": 60}
    pick_up = {"jitter_s": 5e-6, "extra_share": 0.1}
    record = record_of({"electrical": {"tachometer": pick_up}}, tachometer=pulses, duration_s=10)
    extra = record["truth_spurious_pulses"].values
    assert extra.size == pytest.approx(50, abs=4 * np.sqrt(500 * 0.1 * 0.9))  # a tenth of 500 crests
    seen = np.setdiff1d(record["tachometer"].values, extra)
    marks = record["truth_marks"].values
    swing = seen - marks
    waves = np.stack([np.cos(2 * np.pi * 50 * marks), np.sin(2 * np.pi * 50 * marks)], axis=1)
    fitted = np.linalg.lstsq(waves, swing, rcond=None)[0]
    assert_allclose(np.hypot(*fitted), 5e-6, rtol=1e-6)
    assert np.ptp(np.remainder(extra * 50 + 0.5, 1.0)) < 1e-6 or np.ptp(np.remainder(extra * 50, 1.0)) < 1e-6


def test_a_neighbour_has_its_own_lines_and_impacts():
    still = {"speed_hz": 24.5, "teeth": 20, "impact_m_s2": 0, "sideband": 0.1, "harmonics": 2}
    found = spectrum(record_of({"neighbour": still}))
    assert_allclose(found[[49, 98, 980, 931, 1029, 1960]], [0.05, 0.025, 0.1, 0.01, 0.01, 0.05], rtol=1e-9)
    struck = record_of({"neighbour": {"shaft_m_s2": 0, "mesh_m_s2": 0, "impact_m_s2": 2, **MODE}})
    times_s = struck["truth_neighbour_impacts"].values
    assert_allclose(np.diff(times_s), 1 / (3.58 * 24.3), rtol=1e-9)
    late = struck["time"].values > 0.06  # earlier samples also have impacts from before the record
    assert_allclose(struck["a"].values[late], rung(struck["time"].values, times_s, 2.0)[late], atol=1e-9)


def rung(times_s, struck_s, sizes, *, frequency_hz=2000, damping_ratio=0.04):
    natural = 2 * np.pi * frequency_hz
    total = np.zeros(times_s.size)
    for at_s, size in np.broadcast(struck_s, sizes):
        since = times_s[times_s >= at_s] - at_s
        total[times_s >= at_s] += (
            size * np.exp(-damping_ratio * natural * since) * np.sin(natural * np.sqrt(1 - damping_ratio**2) * since)
        )
    return total


def test_knocks_are_a_poisson_process():
    record = record_of({"knocks": {"per_second": 20, "mean_m_s2": 4}}, duration_s=20)
    times_s, sizes = record["truth_knocks"].values, record["truth_knock_sizes"].values
    assert times_s.size == pytest.approx(400, abs=4 * 20)
    assert np.mean(sizes) == pytest.approx(4, rel=0.2)  # exponential: deviation 1 / sqrt(400), 4 of them
    gaps = np.diff(times_s)
    assert np.std(gaps) == pytest.approx(np.mean(gaps), rel=0.3)  # exponential too
    expected = rung(record["time"].values, times_s, sizes, frequency_hz=2500, damping_ratio=0.05)
    assert_allclose(record["a"].values, expected, atol=1e-9)


def test_a_level_wanders_with_its_deviation_and_time_scale():
    slow = {"rate_hz": 200, "duration_s": 4000, "speed": {"link": "input", "rpm": 60}}
    declared = scene({"noise": {"std_db": 2, "time_scale_s": 4}}, **slow, resonance={**MODE, "frequency_hz": 80})
    level_db = noise_level(declared, rng_for=partial(random_stream, 1))(np.arange(0, 4000, 0.4))
    assert np.std(level_db) == pytest.approx(2, rel=0.15)  # of 4000 / 8 values, 4 deviations
    correlation = np.mean(level_db[10:] * level_db[:-10]) / np.var(level_db)
    assert correlation == pytest.approx(np.exp(-1), abs=0.15)


def test_noise_has_the_level_of_the_truth():
    record = record_of({"noise": {"std_db": 3, "time_scale_s": 1}}, noise={"rms": 0.5}, duration_s=8)
    parts = record["a"].values.reshape(32, 2500)  # a quarter of a second each
    level_db = 20 * np.log10(np.sqrt(np.mean(parts**2, axis=1)) / 0.5)
    instants = record["truth_time"].values
    middle_db = np.interp((np.arange(32) + 0.5) / 4, instants, record["truth_noise_level"].values)
    # 2500 samples: 0.12 dB, and a level that bends within a part
    assert_allclose(level_db, middle_db, atol=1.2)
    assert np.corrcoef(level_db, middle_db)[0, 1] > 0.95


def test_temperature_changes_what_comes_through_the_sensor():
    excitation = {"mesh_amplitude": 1}
    hot = {"temperature": {"celsius": 73, "drift_k_per_h": 3600, "per_k": 2e-3}}
    warm, plain = record_of(hot, excitation=excitation), record_of(excitation=excitation)
    factor = 1 + 2e-3 * (73 + warm["time"].values - 23)
    assert_allclose(warm["a"].values, factor * plain["a"].values, atol=1e-12)
    assert_allclose(warm["truth_temperature"].values, 73 + warm["truth_time"].values)
    ratio = warm["truth_amplitude"].values / plain["truth_amplitude"].values
    assert_allclose(ratio[0, 0], 1 + 2e-3 * (50 + warm["truth_time"].values))


# ---- all of them -----------------------------------------------------------------------------------------------------

ADDED = {"imbalance": {}, "bearings": {}, "electrical": {"inverter": {}}, "neighbour": {}, "knocks": {"per_second": 5}}


def test_each_has_a_stream_of_its_own():
    plain = record_of(noise={"rms": 0.1})["a"].values
    alone = sum(record_of({name: table}, noise={"rms": 0.1})["a"].values - plain for name, table in ADDED.items())
    together = record_of(ADDED, noise={"rms": 0.1})["a"].values - plain
    assert_allclose(together, alone, atol=1e-12)


def test_none_named_is_none():
    plain, none = record_of(noise={"rms": 0.1}), record_of({}, noise={"rms": 0.1})
    assert plain.drop_attrs().identical(none.drop_attrs())
    assert "imperfections" not in plain.attrs["truth_scene"]


@pytest.mark.parametrize(
    ("imperfections", "sentence"),
    [
        ({"neighbour": {"teeth": 300}}, "imperfections.neighbour extends to 21894.3 Hz, which is not below half"),
        ({"electrical": {"mains_hz": 3000}}, "imperfections.electrical extends to 9000 Hz"),
        ({"electrical": {"inverter": {"link": "housing"}}}, 'link = "housing" is not a rotating link'),
    ],
)
def test_what_does_not_fit_is_refused(imperfections, sentence):
    with pytest.raises(SceneError, match=sentence):
        record_of(imperfections)


def test_the_healthy_mill_has_every_one_that_its_gearbox_can():
    mill = load_scene("healthy-mill")
    tables = type(mill.imperfections).model_fields
    assert [name for name in tables if getattr(mill.imperfections, name) is None] == ["planets"]
    record = simulate(mill.changed(duration_s=0.3), seed=1)
    assert not mill.faults
    assert {"pitch_deviation", "waviness", "shaft", "gear_mesh"} <= set(
        " + ".join(record["truth_kind"].values).split(" + ")
    )
    assert record.identical(simulate(mill.changed(duration_s=0.3), seed=1))
