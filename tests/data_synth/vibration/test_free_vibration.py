"""Free vibration against its closed form, and in scenes whose torque jumps or that start."""

import re
import tomllib

import numpy as np
import pytest
from numpy.testing import assert_allclose
from truth import explained, plain, rebuilt

from data_synth import Scene, load_scene, simulate
from data_synth.dynamics import Body, Support, build_system
from data_synth.vibration.free_vibration import Modes, Span, free_vibration, ringing_spans

RATE_HZ, SEED = 20_000.0, 1
MODES = Modes(frequencies_hz=np.array([310.0, 470.0, 1400.0]), longest_s=0.2)


def decays(frequencies_hz, ratios, *, samples=4000):
    """(1, n) of decaying cosines of amplitude 1, and their complex amplitudes (mode, n)."""
    times_s = np.arange(samples) / RATE_HZ
    frequencies, ratios = np.array(frequencies_hz)[:, None], np.array(ratios)[:, None]
    amplitudes = np.exp(-2 * np.pi * frequencies * ratios * times_s)
    return np.sum(amplitudes * np.cos(2 * np.pi * frequencies * times_s), axis=0)[None], amplitudes


def test_modes_are_those_of_an_oscillator():
    gear = Body(name="gear", mass_kg=1.0, motions=("x",))
    modes = Modes.of(build_system([gear], [Support(between=("gear", None), x=25.0, damping_s=0.24)]))
    assert_allclose(modes.frequencies_hz, 4 / (2 * np.pi))  # s^2 + 6 s + 25 = 0 has -3 +- 4 j
    assert_allclose(modes.longest_s, np.log(1000) / 3)


def test_a_body_that_is_free_or_undamped_rings_on():
    free = Body(name="gear", mass_kg=1.0, motions=("x", "y"))
    modes = Modes.of(build_system([free], [Support(between=("gear", None), x=25.0)]))
    assert_allclose(modes.frequencies_hz, 5 / (2 * np.pi))
    assert modes.longest_s > 1e6


def test_decays_are_found():
    signal, expected = decays(MODES.frequencies_hz, [0.01, 0.02, 0.01])
    first = 1000
    found = free_vibration([Span(first=first, left=signal)], MODES, rate_hz=RATE_HZ, top_hz=9000.0)
    assert_allclose(found.frequencies_hz, MODES.frequencies_hz)
    assert found.left < 1e-3 * np.sum(signal**2)
    times_s = np.arange(signal.shape[1]) / RATE_HZ + first / RATE_HZ
    for frequency, z, amplitude in zip(found.frequencies_hz, found.amplitude[0], expected, strict=True):
        own = np.interp(times_s, found.times_s, z) * np.exp(2j * np.pi * frequency * first / RATE_HZ)
        assert_allclose(own[100:-100], amplitude[100:-100], atol=0.02)
    assert np.all(found.amplitude[:, :, [0, -1]] == 0)  # nothing rings before, nor behind
    assert found.times_s[0] == pytest.approx((first - 1) / RATE_HZ)


def test_spans_that_touch_have_no_zero_between():
    signal, _ = decays([310.0], [0.0])
    parts = [Span(first=0, left=signal[:, :2000]), Span(first=2000, left=signal[:, 2000:])]
    found = free_vibration(parts, MODES, rate_hz=RATE_HZ, top_hz=400.0)
    assert np.all(np.diff(found.times_s) > 0)
    assert_allclose(np.abs(found.amplitude[0, 0, 1:-1]), 1, atol=1e-2)


@pytest.mark.parametrize("others", [0, 1, 8, 40])
def test_noise_does_not_ring(others):
    noise = np.random.default_rng(2).standard_normal((1, 4000))
    modes = Modes(frequencies_hz=np.linspace(300, 9000, 1 + others), longest_s=0.2)
    assert free_vibration([Span(first=0, left=noise)], modes, rate_hz=RATE_HZ, top_hz=9900.0) is None


def test_nothing_rings_without_modes_or_signal():
    silent = [Span(first=0, left=np.zeros((1, 4000)))]
    assert free_vibration(silent, MODES, rate_hz=RATE_HZ, top_hz=9000.0) is None
    signal, _ = decays([310.0], [0.01])
    assert free_vibration([Span(first=0, left=signal)], MODES, rate_hz=RATE_HZ, top_hz=300.0) is None


def test_spans_follow_changes_until_modes_have_rung_out():
    def spans(changes_s, *, everywhere=False):
        return ringing_spans(np.array(changes_s), MODES, samples=20_000, rate_hz=RATE_HZ, everywhere=everywhere)

    assert spans([0.1, 0.2]) == [(2000, 4000), (4000, 8000)]  # 0.2 s, or until the next
    assert spans([0.1, 0.105]) == [(2000, 6000)]  # less than four periods apart: one
    assert spans([]) == []
    assert spans([0.9], everywhere=True) == [(0, 18_000), (18_000, 20_000)]
    assert spans([0.999]) == []  # too near the end
    rigid = Modes(frequencies_hz=np.zeros(0), longest_s=np.inf)
    assert ringing_spans(np.array([0.1]), rigid, samples=20_000, rate_hz=RATE_HZ, everywhere=True) == []


@pytest.fixture(scope="module")
def jump():
    torque = {"link": "output", "steps": [[0, 300], [0.487, 450]]}
    scene = plain(load_scene("gears-in-motion").changed(torque=torque, duration_s=1.0, faults=()))
    return simulate(scene, seed=SEED, phases=True)


def test_a_jump_of_torque_rings(jump):
    channel = jump[jump["truth_channel"].values[0]].to_numpy()
    assert explained(rebuilt(jump), channel) > 99.7
    lines_alone = explained(rebuilt(jump.drop_vars("truth_ringing")), channel)
    assert lines_alone < 90
    times_s, ringing = jump["truth_ringing_time"].values, jump["truth_ringing"].values
    assert times_s[0] == pytest.approx(0.487, abs=2 / 20_000)
    assert np.abs(ringing[..., -10:]).max() < 0.01 * np.abs(ringing).max()
    assert jump["truth_ringing"].attrs["units"] == jump["truth_amplitude"].attrs["units"]
    stated = re.search(r"modes ring .* they leave ([0-9.]+) % of the power", jump.attrs["truth_mesh_lines"])
    assert float(stated.group(1)) == pytest.approx(100 - explained(rebuilt(jump), channel), rel=0.5)


def test_what_rings_drifts_with_the_sensor():
    torque = {"link": "output", "steps": [[0, 300], [0.487, 450]]}
    scene = plain(load_scene("gears-in-motion").changed(torque=torque, duration_s=1.0, faults=()))
    warm = scene.changed(imperfections={"temperature": {"celsius": 73.0, "drift_k_per_h": 0.0, "per_k": 2e-3}})
    rings = [simulate(each, seed=SEED)["truth_ringing"].values for each in (scene, warm)]
    assert_allclose(rings[1], 1.1 * rings[0], rtol=1e-9)


def test_a_smooth_ramp_rings_with_nothing():
    speed = {"link": "input", "rpm": [[0, 1200], [0.5, 1260], [1, 1200]]}
    made = simulate(plain(load_scene("gears-in-motion").changed(speed=speed, duration_s=1.0)), seed=SEED)
    assert "truth_ringing" not in made


def test_lines_that_friction_excites_are_not_taken_for_modes():
    declared = tomllib.loads(load_scene("gears-in-motion").changed(faults=()).to_toml())
    for mesh in declared["dynamics"]["meshes"].values():
        mesh["friction_coefficient"] = 0.05
    speed = {"link": "input", "rpm": [[0, 1200], [1, 1250]]}
    made = simulate(plain(Scene.from_mapping(declared)).changed(speed=speed, duration_s=1.0), seed=SEED)
    assert "truth_ringing" not in made


def test_a_start_is_lines_and_modes_that_ring():
    made = simulate(plain(load_scene("wijianto")), seed=SEED, phases=True)
    assert explained(rebuilt(made), made["pinion"].to_numpy()) > 98
    assert_allclose(made["truth_mode"].values, [110, 391, 684], atol=1)
    # the mesh's line at the end, where nothing rings any more, is expected and not fitted
    assert "truth_line_change" not in made
