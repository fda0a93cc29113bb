"""Forces inside a gearbox that balance do not move its housing, whatever a sensor feels of each through its walls."""

import numpy as np
import pytest

from data_synth import Scene, load_scene, simulate
from data_synth.scene.sensors import Mode, Sensor
from data_synth.transfer.housing import Housing


def channel(name, **changes):
    table = load_scene(name).model_dump(mode="json", by_alias=True, exclude_none=True)
    table |= {"noise": {"rms": 0}, "fault": [], "excitation": {"shaft_amplitude": 0}, **changes}
    made = Scene.from_mapping(table)
    return made, simulate(made, seed=1)[made.sensors[0].name].values


def line(values, frequency_hz, *, rate_hz):
    """Return the amplitude of the line at a frequency, through a Blackman window."""
    window = np.blackman(values.size)
    turned = np.exp(-2j * np.pi * frequency_hz * np.arange(values.size) / rate_hz)
    return 2 * abs(np.sum(window * values * turned)) / np.sum(window)


def test_a_torque_that_swings_slowly_does_not_shake_the_housing():
    seconds = np.arange(0, 4.01, 0.02)
    nm = [[round(t, 2), 450 + 150 * np.sin(2 * np.pi * 2 * t)] for t in seconds.tolist()]
    made, values = channel("gears-in-motion", torque={"link": "output", "nm": nm}, duration_s=4)
    moved_m = 9.80665 * line(values, 2.0, rate_hz=made.rate_hz) / (2 * np.pi * 2.0) ** 2
    # bearing forces swing by 0.5 kN each, which would move it by a millimetre if one were felt more than another
    assert moved_m < 2e-6


@pytest.mark.parametrize("imperfection", ["planets", "gears"])
def test_planets_out_of_place_do_not_shake_the_housing(imperfection):
    made, values = channel("planets-in-motion", imperfections={imperfection: {}}, duration_s=4)
    for turns_a_second in (4.0, 20.4):  # of the carrier and of the sun
        moved_m = line(values, turns_a_second, rate_hz=made.rate_hz) / (2 * np.pi * turns_a_second) ** 2
        assert moved_m < 20e-6  # of the order of what is out of place, 20 um; 2.7 mm as a gain of static forces


def test_the_pass_of_a_planet_is_no_gain_for_the_slow_force_of_run_out():
    fault = [{"kind": "eccentricity", "component": "planet-ring/ring", "size_mm": 0.1}]
    rate = 20_000
    with_pass, without = (
        line(channel("planets-in-motion", fault=fault, duration_s=4, **changes)[1], 12.0, rate_hz=rate)
        for changes in ({}, {"planet_pass": None})
    )
    # 6.4 m/s2 when the window multiplied it: 1.1 mm of housing
    assert abs(with_pass - without) < 0.05


def test_what_bends_a_housing_passes_it_above_its_first_mode():
    sensor = Sensor.model_validate({"name": "a", "on": "input", "units": "m s-2", "anti_alias": "none"})
    common = {"mass_kg": 20.0, "mounts": Mode(frequency_hz=20.0, damping_ratio=0.2), "path": None, "sensor": sensor}
    rigid, elastic = (
        Housing(**common, rate_hz=50e3, channel_rate_hz=50e3, rigid_below_hz=below) for below in (None, 200.0)
    )
    frequency_hz = np.array([2.0, 200.0, 5000.0])
    ratio = elastic.response(frequency_hz) / rigid.response(frequency_hz)
    s = 1j * frequency_hz / 200
    np.testing.assert_allclose(ratio, s**2 / (s**2 + np.sqrt(2) * s + 1), rtol=1e-12)
    times_s = np.arange(30_000) / 50e3
    found = elastic.push(np.cos(2 * np.pi * 700 * times_s))[-2000:]
    expected = (elastic.response(np.array([700.0]))[0] * np.exp(2j * np.pi * 700 * (times_s - 2 / 50e3))).real[-2000:]
    # of the start 1e-6 is left, and the filter is exact to 1e-4 up to a tenth of its rate
    np.testing.assert_allclose(found, expected, atol=2e-4 * np.abs(expected).max())
