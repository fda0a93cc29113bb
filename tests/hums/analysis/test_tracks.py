"""Envelope lines of faulty components: amplitude, its standard deviation and slip against what was put in."""

from types import SimpleNamespace

import numpy as np
import pytest

from hums.analysis.record_analysis import analyze
from hums.analysis.result import findings_table, group, open_analysis, save_analysis
from hums.analysis.settings import AnalysisSettings
from hums.analysis.tracks import EnvelopeLine, track_envelope_lines
from hums.gearbox.defect_orders import defects
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import load_gearbox
from hums.records.record import PulseTimes, make_record
from hums.report import render
from signals.shaft.phase import constant_speed

TURNS, PER_REV, ORDER = 320, 16, 5.4
MACHINE = SimpleNamespace(phase=constant_speed(25.0, start_s=0.0, stop_s=TURNS / 25))


def envelope(seed, *, slips, noise):
    """A line whose amplitude swings by 60 % in 200 turns; its slip, where it has one, by 0.3 % in 300."""
    rng = np.random.default_rng(seed)
    turn = np.arange(TURNS * PER_REV) / PER_REV
    amplitude = 0.2 * (1 + 0.6 * np.sin(2 * np.pi * turn / 200 + rng.uniform(0, 6.3)))
    slip = slips * (0.008 + 0.003 * np.sin(2 * np.pi * turn / 300 + rng.uniform(0, 6.3)))
    angle = 2 * np.pi * ORDER * np.cumsum(1 + slip) / PER_REV + rng.uniform(0, 6.3)
    line = EnvelopeLine(
        component="b",
        kind="outer_race" if slips else "tooth",
        channel="a",
        units="g",
        order=ORDER,
        harmonic=1,
        band_hz=(1e3, 2e3),
        largest_slip=0.02 if slips else 0.0,
        values=1 + amplitude * np.cos(angle) + rng.normal(0, noise, turn.size),
        samples_per_rev=float(PER_REV),
        start_rev=0.0,
    )
    return line, turn, amplitude, slip


@pytest.mark.parametrize(("slips", "noise"), [(True, 0.15), (True, 0.5), (False, 0.15), (False, 0.5)])
def test_amplitude_and_slip_are_within_their_std_of_the_truth(slips, noise):
    errors, off = [], []
    for seed in range(2):
        line, turn, amplitude, slip = envelope(seed, slips=slips, noise=noise)
        tracks = track_envelope_lines([line], MACHINE)
        at = tracks["revolution"].to_numpy()
        found = np.abs(tracks["complex_amplitude"].to_numpy()[0])
        errors.append((found - np.interp(at, turn, amplitude)) / tracks["std"].to_numpy()[0])
        if slips:
            off.append((tracks["slip"].to_numpy()[0] - np.interp(at, turn, slip)) / tracks["slip_std"].to_numpy()[0])
    # 95.4 % of independent Gaussian errors; those of a record are some ten swings of the smoother's bandwidth each
    assert np.mean(np.abs(np.array(errors)) < 2) > 0.85
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.4
    # and the swing itself is far larger than its std
    assert tracks["std"].to_numpy().mean() < 0.25 * np.ptp(amplitude)
    if slips:
        assert np.mean(np.abs(np.array(off)) < 2) > 0.85


def test_more_steps_along_the_first_path_change_little(monkeypatch):
    line, *_ = envelope(0, slips=True, noise=0.5)
    tracks = track_envelope_lines([line], MACHINE)
    monkeypatch.setattr("hums.analysis.tracks._FIRST_STEPS", 20)
    exact = track_envelope_lines([line], MACHINE)
    change = np.abs(np.abs(tracks["complex_amplitude"]) - np.abs(exact["complex_amplitude"])).max()
    # 1e-6 and 7e-4 of the largest: the likelihood of the bandwidth is flat about its maximum
    assert change < 2e-3 * np.abs(exact["complex_amplitude"]).max()
    assert change < 0.05 * exact["std"].min()


@pytest.mark.parametrize("seed", [5, 6, 14])
def test_the_noise_alone_is_no_amplitude(seed):
    line, *_ = envelope(4, slips=True, noise=0.3)
    rng = np.random.default_rng(seed)
    tracks = track_envelope_lines(
        [EnvelopeLine(**vars(line) | {"values": 1 + rng.normal(0, 0.3, line.values.size)})], MACHINE
    )
    assert tracks["method"].item() == "slipping order, no line"
    assert np.all(np.abs(tracks["complex_amplitude"]) < 4 * tracks["std"])


@pytest.fixture(scope="module")
def modulated():
    """A tone of 3 kHz that the outer race of the input bearing modulates by 40 %, with 1 % of slip."""
    rate_hz, seconds, speed_hz = 10_000, 10.0, 20.0
    gearbox = load_gearbox("two-stage")
    race = next(
        row
        for row in defects(solve_kinematics(gearbox))
        if row.kind == "outer_race" and row.component == "input bearing"
    )
    time = np.arange(int(rate_hz * seconds)) / rate_hz
    passed = 2 * np.pi * 1.01 * race.order * speed_hz * time
    depth = 0.4 * sum(np.cos(k * passed) / k for k in (1, 2, 3))
    x = (1 + depth) * np.cos(2 * np.pi * 3000 * time) + np.random.default_rng(1).normal(0, 0.2, time.size)
    pulses = PulseTimes(times_s=np.arange(0.0, seconds, 1 / speed_hz), shaft="input", pulses_per_rev=1)
    record = make_record({"housing": x}, rate_hz=rate_hz, units="g", angle=pulses)
    settings = AnalysisSettings(envelope_band_hz=(2500.0, 3500.0), most_tracks=1, pictures=False)
    return analyze(record, gearbox, settings=settings)


def test_a_named_race_is_tracked_in_its_envelope(modulated, tmp_path):
    assert findings_table(modulated)[["component", "kind"]].iloc[0].tolist() == ["input bearing", "outer_race"]
    save_analysis(modulated, tmp_path / "a.h5")
    with open_analysis(tmp_path / "a.h5") as opened:
        tracks = group(opened, "envelope_tracks").load()
    one = tracks.isel(track=0)
    assert (one["component"].item(), one["kind"].item(), one["track_units"].item()) == (
        "input bearing",
        "outer_race",
        "g",
    )
    inner = slice(10, -10)
    amplitude = np.abs(one["complex_amplitude"].to_numpy())[inner]
    # the noise in the band, 0.09 g, lifts the mean of the envelope by half a per cent, and its swing by as little
    np.testing.assert_allclose(amplitude, 0.4, atol=0.01)
    off = one["slip"].to_numpy()[inner] - 0.01
    assert np.all(np.abs(off) < 4 * one["slip_std"].to_numpy()[inner])
    assert abs(off.mean()) < 1e-4  # a tenth of a bin of the whole record
    assert float(one["level"]) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("limit", [1.25, 0.95])
def test_tracks_of_a_clipped_channel_hold_their_std(limit):
    """Left out, 3 or 22 % of the samples would take 2 or 11 % off the amplitude, 3 or 16 times its `std`."""
    rate_hz, seconds, speed_hz, truth = 4000, 8.0, 20.0, np.exp(0.3j)
    time = np.arange(int(rate_hz * seconds)) / rate_hz
    rng, line = np.random.default_rng(6), (truth * np.exp(2j * np.pi * 23 * speed_hz * time)).real
    channels = {f"c{n}": np.clip(line + rng.normal(0, 0.2, time.size), -limit, limit) for n in range(12)}
    pulses = PulseTimes(times_s=np.arange(0.0, seconds, 1 / speed_hz), shaft="input", pulses_per_rev=1)
    record = make_record(channels, rate_hz=rate_hz, units="g", angle=pulses)
    settings = AnalysisSettings(most_tracks=1, track_bandwidth_orders=0.05, pictures=False)
    analysis = analyze(record, load_gearbox("two-stage"), settings=settings)
    tracks = group(analysis, "tracks").isel(output=slice(40, -40, 160))  # outputs 1 / bandwidth apart
    assert tracks.sizes["track"] == 12
    np.testing.assert_allclose(tracks["track_order"], 23)
    wrong = tracks["complex_amplitude"].to_numpy() - truth
    parts, std = np.stack([wrong.real, wrong.imag]), tracks["std"].to_numpy()
    assert abs(wrong.mean()) < 3e-3
    # a constant amplitude, where the prior of a moving one adds to `std`
    assert np.mean(np.abs(parts) < 1.645 * std) > 0.85
    assert 0.8 < np.median(std) / np.sqrt(np.mean(parts**2)) < 1.6
    clipped = np.mean([np.abs(x) == limit for x in channels.values()], axis=1)
    np.testing.assert_allclose(tracks["clipped_share"], clipped, rtol=1e-9)
    assert ("a lower bound" in render(analysis)) == (limit < 1)


def test_intervals_hold_the_truth_of_a_short_record():
    """Ten turns: the noise is the median of so few bins that two standard deviations hold less than they should."""
    rate_hz, speed_hz = 4000, 20.0
    time = np.arange(rate_hz // 2) / rate_hz
    rng, line = np.random.default_rng(8), np.cos(2 * np.pi * 23 * speed_hz * time)
    channels = {f"c{n}": line + rng.normal(0, 0.2, time.size) for n in range(100)}
    pulses = PulseTimes(times_s=np.arange(0.0, 0.6, 1 / speed_hz), shaft="input", pulses_per_rev=1)
    record = make_record(channels, rate_hz=rate_hz, units="g", angle=pulses)
    settings = AnalysisSettings(most_tracks=1, track_bandwidth_orders=0.1, pictures=False, envelope_band_hz=None)
    tracks = group(analyze(record, load_gearbox("two-stage"), settings=settings), "tracks")
    assert tracks["half_width"].attrs["confidence"] == 0.95
    middle = tracks.isel(output=tracks.sizes["output"] // 2)
    wider = (middle["half_width"] / middle["std"]).to_numpy()
    assert np.all((wider > 2.05) & (wider < 2.6))  # Student's t of 7 to 25 degrees of freedom; 1.96 of many
    wrong = middle["complex_amplitude"].to_numpy() - 1
    inside = np.abs([wrong.real, wrong.imag]) < middle["half_width"].to_numpy()
    assert inside.mean() > 0.93  # of 200, whose share scatters by 0.015


def test_nothing_is_tracked_where_nothing_is_named():
    settings = AnalysisSettings(most_tracks=0, pictures=False)
    noise = make_record(
        {"a": np.random.default_rng(2).normal(size=8000)},
        rate_hz=4000,
        units="g",
        angle=PulseTimes(times_s=np.arange(41) / 20, shaft="input", pulses_per_rev=1),
    )
    analysis = analyze(noise, load_gearbox("two-stage"), settings=settings)
    assert "track" not in group(analysis, "envelope_tracks").sizes
