"""Forces inside a gearbox that balance do not move its housing, whatever a sensor feels of each through its walls."""

import numpy as np
import pytest

from data_synth import Scene, load_scene, simulate
from data_synth.scene.sensors import Sensor
from data_synth.simulation import noise_free
from data_synth.transfer.housing import housing_of


def channel(name, **changes):
    table = load_scene(name).model_dump(mode="json", by_alias=True, exclude_none=True)
    table |= {"noise": {"rms": 0}, "fault": [], "excitation": {"shaft_amplitude": 0}, **changes}
    made = Scene.from_mapping(table)
    return made, noise_free(made, seed=1).signal[0]


def line(values, frequency_hz, *, rate_hz):
    """Return the amplitude of the line at a frequency, through a Blackman window."""
    window = np.blackman(values.size)
    turned = np.exp(-2j * np.pi * frequency_hz * np.arange(values.size) / rate_hz)
    return 2 * abs(np.sum(window * values * turned)) / np.sum(window)


def test_a_torque_that_swings_slowly_does_not_shake_the_housing():
    seconds = np.arange(0, 2.01, 0.02)
    nm = [[round(t, 2), 450 + 150 * np.sin(2 * np.pi * 2 * t)] for t in seconds.tolist()]
    made, values = channel("gears-in-motion", torque={"link": "output", "nm": nm}, duration_s=2)
    moved_m = 9.80665 * line(values, 2.0, rate_hz=made.rate_hz) / (2 * np.pi * 2.0) ** 2
    # bearing forces swing by 0.5 kN each, which would move it by a millimetre if one were felt more than another
    assert moved_m < 2e-6


@pytest.mark.parametrize("imperfection", ["planets", "gears"])
def test_planets_out_of_place_do_not_shake_the_housing(imperfection):
    made, values = channel("planets-in-motion", imperfections={imperfection: {}}, duration_s=2)
    for turns_a_second in (4.0, 20.4):  # of the carrier and of the sun
        moved_m = line(values, turns_a_second, rate_hz=made.rate_hz) / (2 * np.pi * turns_a_second) ** 2
        assert moved_m < 20e-6  # of the order of what is out of place, 20 um; 2.7 mm as a gain of static forces


def test_the_pass_of_a_planet_is_no_gain_for_the_slow_force_of_run_out():
    fault = [{"kind": "eccentricity", "component": "planet-ring/ring", "size_mm": 0.1}]
    rate = 20_000
    with_pass, without = (
        line(channel("planets-in-motion", fault=fault, duration_s=2, **changes)[1], 12.0, rate_hz=rate)
        for changes in ({}, {"planet_pass": None})
    )
    # 6.4 m/s2 when the window multiplied it: 1.1 mm of housing
    assert abs(with_pass - without) < 0.05


def test_what_bends_a_housing_passes_it_above_its_first_mode():
    sensor = Sensor.model_validate({"name": "a", "on": "input", "units": "m s-2", "anti_alias": "none"})
    made = load_scene("gears-in-motion").changed(path=None)  # 20 kg on mounts of 20 Hz, elastic above 200 Hz
    rigid, elastic = (housing_of(made, sensor, elastic=each) for each in (False, True))
    frequency_hz = np.array([2.0, 200.0, 5000.0])
    ratio = elastic.response(frequency_hz) / rigid.response(frequency_hz)
    s = 1j * frequency_hz / 200
    np.testing.assert_allclose(ratio, s**2 / (s**2 + np.sqrt(2) * s + 1), rtol=1e-12)


# ---- forces on bearings that are no gears' ---------------------------------------------------------------------------


def imperfect_lines(imperfections, kind, *, directions, fidelity="dynamic", transfer=(), **dynamics):
    """Return the lines of one kind, (sensor, line), by their orders, of sensors in some directions."""
    base = load_scene("gears-in-motion")
    sensors = [
        base.sensors[0].model_dump(mode="json", exclude_none=True) | {"name": f"s{number}", "direction": direction}
        for number, direction in enumerate(directions)
    ]
    table = base.model_dump(mode="json", by_alias=True, exclude_none=True)
    table["dynamics"] = {**table["dynamics"], "sensor_weights": [], **dynamics}
    table |= {
        "noise": {"rms": 0},
        "fault": [],
        "excitation": {"shaft_amplitude": 0},
        "duration_s": 2,
        "fidelity": fidelity,
        "transfer": [*transfer],
    }
    made = Scene.from_mapping(table | {"sensor": sensors, "imperfections": imperfections})
    record = simulate(made, seed=1)
    of_kind = record["truth_kind"].values == kind
    return made, record["truth_order"].values[of_kind], record["truth_amplitude"].values[:, of_kind, 0]


def test_an_imbalance_shakes_sensors_in_their_directions():
    directions = ([0, 1, 0], [0, 0, 1], [0, 0, -1], [0.8, 0, 0.6])  # the shafts are along x
    made, orders, lines = imperfect_lines({"imbalance": {"grade": 16, "rotor_kg": 3}}, "shaft", directions=directions)
    ratios = {"input": 1, "intermediate": -23 / 67, "output": 23 / 67 * 19 / 61}
    assert len(orders) == len(ratios)
    for ratio in ratios.values():
        (number,) = np.flatnonzero(np.isclose(orders, abs(ratio)))
        y, z, back, inclined = lines[:, number]
        turning_hz = abs(ratio) * 25
        sensor = housing_of(made, made.sensors[0])
        newtons = 3 * 16e-3 * 2 * np.pi * turning_hz  # m e w^2, e w that of the grade
        np.testing.assert_allclose(abs(y), newtons * abs(sensor.response(turning_hz)), rtol=0.02)  # 200 Hz is far
        np.testing.assert_allclose(z / y, -1j * np.sign(ratio), atol=1e-6)  # single precision; z a quarter turn later
        np.testing.assert_allclose(back, -z, rtol=1e-6)
        np.testing.assert_allclose(inclined, 0.6 * z, rtol=1e-6)  # none along the shaft


def test_an_imbalance_takes_the_declared_path_of_its_bearing():
    modes = [{"frequency_hz": 400, "damping_ratio": 0.05, "gain": 0.01}]
    transfer = [{"source": "input bearing", "sensor": "s0", "units": "g", "modes": modes}]
    directions = ([0, 0.6, 0.8], [0, 1, 0])
    imbalance = {"imbalance": {"grade": 16, "rotor_kg": 3}}
    _, orders, lines = imperfect_lines(imbalance, "shaft", directions=directions, transfer=transfer)
    _, _, without = imperfect_lines(imbalance, "shaft", directions=directions)
    (number,) = np.flatnonzero(np.isclose(orders, 1))
    ratio = 25 / 400
    response = 0.01 / (1 - ratio**2 + 2j * 0.05 * ratio)
    expected = 3 * 16e-3 * 2 * np.pi * 25 * abs(response)  # y and z are a quarter turn apart: 0.6 and 0.8 of 1
    np.testing.assert_allclose(abs(lines[0, number]), expected, rtol=1e-3)
    others = np.arange(orders.size) != number
    np.testing.assert_array_equal(lines[0, others], without[0, others])  # other shafts, through the housing
    np.testing.assert_array_equal(lines[1], without[1])  # and the other sensor


def test_the_waviness_of_another_bearing_is_felt_through_the_elastic_housing():
    directions = {"directions": ([0, 1, 0], [1, 0, 0]), "rigid_below_hz": 1.0}
    made, orders, lines = imperfect_lines({"bearings": {}}, "waviness", **directions)
    _, _, alike = imperfect_lines({"bearings": {}}, "waviness", elsewhere=1.0, **directions)
    rates = made.orders["input bearing", "outer_race"], made.orders["input bearing", "inner_race"]
    own = [n * rates[0] for n in (1, 2)] + [n * rates[1] + side for n in (1, 2) for side in (-1, 1)]
    near = np.any(np.isclose(orders[:, None], own), axis=1)
    assert np.sum(near) == len(own) < len(orders)
    expected = np.where(near, 1.0, made.dynamics.elsewhere)
    np.testing.assert_allclose(abs(lines[0] / alike[0]), expected, rtol=0.01)  # the high pass is flat far above 1 Hz
    np.testing.assert_array_equal(lines[1], 0.0)  # along the shafts
