"""No line of vibrating gears folds into a channel: each rate of sampling against one eight times as high."""

import numpy as np
import pytest

from data_synth import Scene, load_scene, simulate
from data_synth.scene.sensors import AntiAlias

RATE = 12_000


def channel(rate_hz, anti_alias):
    table = load_scene("gears-in-motion").model_dump(mode="json", by_alias=True, exclude_none=True)
    table |= {"fault": [], "noise": {"rms": 0}, "duration_s": 0.5, "rate_hz": rate_hz}
    table["sensor"][0]["anti_alias"] = anti_alias
    return simulate(Scene.from_mapping(table), seed=1)[table["sensor"][0]["name"]].values


def line(values, frequency_hz, *, rate_hz):
    window = np.blackman(values.size)
    turned = np.exp(-2j * np.pi * frequency_hz * np.arange(values.size) / rate_hz)
    return 2 * abs(np.sum(window * values * turned)) / np.sum(window)


@pytest.fixture(scope="module")
def filtered():
    return channel(RATE, {})


def test_the_fourteenth_mesh_harmonic_does_not_fold(filtered):
    # 14 x 23 teeth at 25 rev/s are 8,050 Hz, which 12 kHz fold to 3,950 Hz, where no line of the gearbox is
    at_source = line(channel(50_000, "none"), 8050, rate_hz=50_000)
    folded = line(channel(RATE, "none"), 3950, rate_hz=RATE)
    assert folded == pytest.approx(at_source, rel=1e-2)
    down_db = 20 * np.log10(line(filtered, 3950, rate_hz=RATE) / at_source)
    stated = AntiAlias().cutoff_hz(RATE)
    # -75 dB, where what the window and the steps in time leave is a tenth of the line
    assert down_db == pytest.approx(-10 * np.log10(1 + (8050 / stated) ** 32), abs=2)
    assert down_db < -60


def test_a_channel_is_that_of_a_higher_rate_behind_the_same_filter(filtered):
    dense = channel(8 * RATE, {"frequency_hz": AntiAlias().cutoff_hz(RATE)})[::8]
    # steps in time may err by 1e-3
    assert np.std(filtered - dense) < 1e-3 * np.std(dense)
