"""Levels of what healthy gears, shafts, bearings and sensors have, measured from their records."""

from functools import partial

import numpy as np
import pytest
from gearboxes import TWO_STAGE, without_sizes
from numpy.testing import assert_allclose
from scipy.special import jv

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.kinematic.imperfect_parts import planet_displacements_m, planet_loads
from data_synth.scene.random_streams import random_stream
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.run import prepare_gears

GRAVITY = 9.80665
SILENT = {"shaft_amplitude": 0, "mesh_amplitude": 0}
MILL = {
    **TWO_STAGE,
    "rate_hz": 4000,
    "duration_s": 3.35,  # 67 turns of the pinion at 20 rev/s: lines of stage 1 are whole bins
    "speed": {"link": "input", "rpm": 1200},
    "torque": {"link": "output", "nm": 300},
    "tachometer": {"link": "input", "pulses_per_rev": 1, "offset_rev": 0},
    "excitation": SILENT,
    "resonance": {"frequency_hz": 1500, "damping_ratio": 0.03},
    "dynamics": {
        "meshes": {
            name: {"module_mm": module, "face_width_mm": 30, "pressure_angle_deg": 20}
            for name, module in (("stage 1", 3), ("stage 2", 4))
        }
    },
    "sensor": [{"name": "a", "on": "input bearing", "direction": [0, 0, 1], "units": "m s-2"}],
}


def scene(imperfections=None, **changes):
    declared = {} if imperfections is None else {"imperfections": imperfections}
    return Scene.from_mapping({**MILL, **declared, **changes})


def values(imperfections=None, *, seed=1, **changes):
    return simulate(scene(imperfections, **changes), seed=seed)["a"].values


def amplitude(signal, frequency_hz, *, rate_hz=4000):
    """Amplitude of a line by its projection over the record, under a Hann window."""
    window = np.hanning(signal.size)
    times_s = np.arange(signal.size) / rate_hz
    return abs(np.sum(window * signal * np.exp(-2j * np.pi * frequency_hz * times_s))) * 2 / np.sum(window)


def test_run_out_modulates_the_phase_as_bessel_s_functions_say():
    # a run-out of 600 um shifts contact by 300 um in 3 mm times pi: harmonic 1 by 0.2 rad
    excitation = {"shaft_amplitude": 0, "mesh_amplitude": 1, "meshes": {"stage 2": 0}, "harmonics": 1}
    gears = {"runout_um": 600, "single_pitch_um": 0, "deflection_um": 1e9}
    spectrum = np.abs(np.fft.rfft(values({"gears": gears}, excitation=excitation))) / (4000 * 3.35 / 2)
    index = 2 * np.pi * 0.3 / (3 * np.pi)
    assert_allclose(spectrum[[67 * 22, 67 * 24]], jv(1, index), rtol=1e-6)
    assert_allclose(spectrum[[67 * 21, 67 * 25]], jv(2, index), rtol=1e-6)
    assert_allclose(spectrum[[67 * 23 - 23, 67 * 23 + 23]], jv(1, index), rtol=1e-6)  # of the wheel
    assert_allclose(spectrum[67 * 23], 1 + 2 * (jv(0, index) - 1), rtol=1e-6)  # each gear by itself


def test_single_pitch_deviations_modulate_the_amplitude():
    # without phase shift on a coarse pitch, teeth alternate by f over the deflection: the envelope's largest rise
    excitation = {"shaft_amplitude": 0, "mesh_amplitude": 1, "meshes": {"stage 2": 0}, "harmonics": 1}
    gears = {"runout_um": 0, "single_pitch_um": 1e-3, "deflection_um": 1e-1}
    changed = values({"gears": gears}, excitation=excitation) - values(excitation=excitation)
    lines = np.abs(np.fft.rfft(changed)) / (4000 * 3.35 / 2)
    orders = np.arange(lines.size) / 67
    beside = (np.abs(orders - 23) < 23) & (lines > 1e-6)
    assert set(np.round(orders[beside] * 67) % 23 * (np.round(orders[beside] * 67) % 67)) == {0.0}
    # f / deflection is at most 1 % at a tooth, and up to a half more between teeth: of both gears less than 3 %
    assert 0.005 < np.max(np.abs(changed)) < 0.03


def test_a_grade_needs_a_module():
    with pytest.raises(SceneError, match='need the module of mesh "stage 1"; declare module_mm'):
        simulate(scene({"gears": {}}, dynamics={}, gearbox=without_sizes("two-stage")), seed=1)


@pytest.mark.parametrize(("units", "per"), [("m s-2", 1.0), ("g", 1 / GRAVITY)])
def test_imbalance_has_the_force_of_its_grade_at_the_rated_speed_and_of_each_shaft_s_mass(units, per):
    # G is e w at the rated speed, by default the top one; at half of it m e w^2 / M of a housing of 20 kg halves
    sensor, masses = [MILL["sensor"][0] | {"units": units}], {"input": 3.0, "intermediate": 5.0, "output": 7.0}
    plain = values({"imbalance": {"grade": 16, "rotor_kg": 3}}, sensor=sensor)
    rated = values({"imbalance": {"grade": 16, "rated_rpm": 2400, "rotor_kg": masses}}, sensor=sensor)
    for ratio, mass in ((1, 3.0), (23 / 67, 5.0)):
        speed_rad_s = 2 * np.pi * 20 * ratio
        assert_allclose(amplitude(plain, 20 * ratio), per * 3 * 16e-3 * speed_rad_s / 20, rtol=1e-3)
        assert_allclose(amplitude(rated, 20 * ratio), per * mass * 16e-3 / 2 * speed_rad_s / 20, rtol=1e-3)
    with pytest.raises(SceneError, match="rotor_kg names input, but the shafts are input, intermediate, output"):
        values({"imbalance": {"rotor_kg": {"input": 3.0}}})


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"imbalance": 3}, r"imperfections\.imbalance = 3: give a table, \{ \} for its defaults"),
        ({"imbalance": {"rotor_kg": "a"}}, r"rotor_kg: 'a': give a table of values by name, as in \{ input = 1 \}"),
        ({"imbalance": {"rotor_kg": {"input": -1.0}}}, r"rotor_kg\.1\.2 = -1\.0: input should be greater than 0"),
    ],
)
def test_nonsense_is_refused_by_its_key(table, words):
    with pytest.raises(SceneError, match=words):
        scene(table)
    with pytest.raises(SceneError, match=words):
        scene().changed(imperfections=table)


def test_a_fault_of_imbalance_has_the_force_of_its_mass():
    fault = {"kind": "imbalance", "component": "intermediate", "size_mm": 0.4, "rotor_kg": 3}
    speed_rad_s = 2 * np.pi * 20 * 23 / 67
    signal = values(fault=[fault])
    assert_allclose(amplitude(signal, 20 * 23 / 67), 3 * 0.4e-3 * speed_rad_s**2 / 20, rtol=1e-3)
    with pytest.raises(SceneError, match="rotor_kg and amplitude_per_mm both determine the imbalance; keep one"):
        scene(fault=[fault | {"amplitude_per_mm": 1}])
    with pytest.raises(SceneError, match="rotor_kg applies to imbalance, not to bent_shaft; leave it out"):
        scene(fault=[fault | {"kind": "bent_shaft"}])


def test_waviness_has_weak_lines_at_race_orders():
    signal = values({"bearings": {"waviness_um": 0.05, "stiffness_n_m": 2e8}}, duration_s=10)
    outer = scene().orders["input bearing", "outer_race"]
    assert_allclose(amplitude(signal, 20 * outer), 0.05e-6 * 2e8 / 20, rtol=1e-3)
    assert_allclose(amplitude(signal, 40 * outer), 0.05e-6 * 2e8 / 20 / 2, rtol=1e-3)
    inner = scene().orders["input bearing", "inner_race"]
    assert_allclose(amplitude(signal, 20 * (inner + 1)), 0.05e-6 * 2e8 / 20, rtol=1e-3)
    record = simulate(scene({"bearings": {}}), seed=1)
    assert set(record["truth_kind"].values) == {"waviness"}


def test_forces_follow_declared_transfers():
    mode = [{"frequency_hz": 500, "damping_ratio": 0.05, "gain": 0.02}]
    transfer = [{"source": "input", "sensor": "a", "units": "m s-2", "modes": mode}]
    signal = values({"imbalance": {"grade": 16}}, transfer=transfer)
    ratio = 20 / 500
    response = 0.02 / abs(1 - ratio**2 + 2j * 0.05 * ratio)
    assert_allclose(amplitude(signal, 20), 2 * 16e-3 * 2 * np.pi * 20 * response, rtol=1e-3)


# ---- planets ---------------------------------------------------------------------------------------------------------


def planets(**changes):
    base = load_scene("planets-in-motion")
    return base.changed(faults=(), duration_s=0.5, **changes)


def test_unequal_planets_bring_back_the_line_that_equal_ones_forbid():
    # McFadden and Smith (1985): of equal planets only lines with m mod 3 = 0 are left
    equal = planets(fidelity="kinematic", excitation={"meshes": {"sun-planet": 0}})
    unequal = equal.changed(imperfections={"planets": {"load_std": 0.1}})
    lines = [simulate(each, seed=1)["truth_amplitude"] for each in (equal, unequal)]
    carrier = float(abs(equal.ratio("carrier")))
    assert not np.any(np.isclose(lines[0]["truth_order"].values, 82 * carrier))
    back = lines[1].isel(truth_order=np.argmin(np.abs(lines[1]["truth_order"].values - 82 * carrier)))
    assert abs(float(back["truth_order"]) - 82 * carrier) < 1e-9
    assert np.max(np.abs(back.values)) > 0


def test_loads_have_their_declared_deviation():
    declared = planets(imperfections={"planets": {"load_std": 0.08, "position_um": 15}})
    axis = declared.gearbox.axes[1]
    loads = planet_loads(declared, axis, rng_for=partial(random_stream, 4))
    assert_allclose([np.mean(loads), np.std(loads)], [1, 0.08])
    drawn = [planet_displacements_m(declared, axis, rng_for=partial(random_stream, seed)) for seed in range(200)]
    assert np.std(drawn) == pytest.approx(15e-6, rel=0.12)  # of 600 values, 4 deviations


def test_displaced_planets_open_both_their_meshes():
    declared = planets(imperfections={"planets": {}})
    stage = prepare_scene(declared, rng_for=partial(random_stream, 3))
    teeth = prepare_gears(stage).teeth
    displaced = planet_displacements_m(declared, declared.gearbox.axes[1], rng_for=stage.rng_for)
    for mesh in ("sun-planet", "planet-ring"):
        errors = [float(teeth[f"{mesh} {number}"].properties.error(0.3)) for number in (1, 2, 3)]
        assert_allclose(errors, np.cos(np.radians(20)) * displaced)


def test_planets_that_no_line_shows_are_refused():
    with pytest.raises(SceneError, match='gearbox "two-stage" has no planets'):
        simulate(scene({"planets": {}}), seed=1)
    with pytest.raises(SceneError, match="without planet_pass all planets of a kinematic scene have the same path"):
        simulate(planets(fidelity="kinematic", planet_pass=None, imperfections={"planets": {}}), seed=1)


# ---- in motion -------------------------------------------------------------------------------------------------------


def test_gears_in_motion_have_their_pitch_deviations():
    declared = scene({"gears": {"grade": 7}}, fidelity="dynamic")
    stage = prepare_scene(declared, rng_for=partial(random_stream, 2))
    error = prepare_gears(stage).teeth["stage 1"].properties.error
    assert error.period == 23 * 67
    cycles = np.arange(23 * 67) + 0.9  # one pair alone: each tooth's own deviation
    spectrum = np.fft.rfft(error(cycles)) * 2 / cycles.size
    # run-outs of ISO 1328-1 along the line of action, from peak to peak, of both gears
    for teeth in (23, 67):
        diameter = 3 * teeth
        runout = 0.9 * (0.002 * diameter + 0.55 * np.sqrt(diameter) + 0.7 * 3 + 12) * 2
        assert_allclose(2e6 * abs(spectrum[23 * 67 // teeth]), runout * np.cos(np.radians(20)), rtol=0.02)


# ---- sensors ---------------------------------------------------------------------------------------------------------


def test_gains_and_mounts_are_those_of_the_truth():
    excitation = {"shaft_amplitude": 0.1, "mesh_amplitude": 0.5}
    record = simulate(scene({"gains": {"std_db": 1}, "mounts": {"frequency_hz": 3000}}, excitation=excitation), seed=2)
    plain = simulate(scene(excitation=excitation), seed=2)
    gain, mount = float(record["truth_gain"][0]), float(record["truth_mount"][0])
    assert gain != 1
    for order in (1.0, 46.0):
        ratio = 20 * order / mount
        factor = gain / abs(1 - ratio**2 + 2j * 0.03 * ratio)
        found = amplitude(record["a"].values, 20 * order) / amplitude(plain["a"].values, 20 * order)
        assert_allclose(found, factor, rtol=1e-3)


def test_drawn_gains_and_mounts_have_their_deviations():
    sensors = [MILL["sensor"][0] | {"name": str(number)} for number in range(150)]
    declared = scene({"gains": {"std_db": 0.5}, "mounts": {}}, sensor=sensors)
    prepared = prepare_scene(declared, rng_for=partial(random_stream, 1))
    gains_db = 20 * np.log10([sensor.gain for sensor in prepared.scene.sensors])
    assert np.std(gains_db) == pytest.approx(0.5, rel=0.25)  # of 150 values, 4 deviations
    mounts = np.log([sensor.resonance.frequency_hz / 28_000 for sensor in prepared.scene.sensors])
    assert np.std(mounts) == pytest.approx(0.1, rel=0.25)
