"""A record as segments: long ones cut, gaps left out, spectra averaged by power and judged once."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import hums
from hums.analysis import segments

RATE_HZ, TURN_HZ, COUNT = 4000, 20.0, 60_000
AMPLITUDE, STD = 0.5, 0.05
SEGMENTS = 3
BOX = hums.load_gearbox("two-stage")
SETTINGS = hums.AnalysisSettings(pictures=False)


def made(channels, count=COUNT):
    angle = hums.PulseTimes(times_s=np.arange(0, count / RATE_HZ, 1 / TURN_HZ), shaft="input", pulses_per_rev=1)
    return hums.make_record(channels, rate_hz=RATE_HZ, units="g", angle=angle)


def cut(record, monkeypatch, count=SEGMENTS, settings=SETTINGS):
    """Analyse a record as if it were too long to be held at once."""
    monkeypatch.setattr(segments, "LONGEST", record.sizes["time"] // count)
    return hums.analyze(record, BOX, settings=settings)


@pytest.fixture(scope="module")
def record():
    times_s = np.arange(COUNT) / RATE_HZ
    mesh = AMPLITUDE * np.cos(2 * np.pi * 23 * TURN_HZ * times_s)
    noise = np.random.default_rng(3).normal(0, STD, (2, COUNT))
    noise[1, 30_000:30_010] = np.nan
    return made({"a": mesh + noise[0], "b": mesh + noise[1]})


@pytest.fixture(scope="module")
def pooled(record):
    with pytest.MonkeyPatch.context() as patch:
        return cut(record, patch)


def mesh_lines(analysis):
    lines = hums.line_table(analysis, "order_spectrum")
    return lines[(lines.component == "stage 1") & (lines.harmonic == 1) & (lines.sideband == 0)]


def test_averaging_power_leaves_the_line_and_lowers_the_noise(record, pooled):
    # of K spectra of a third of the turns: 3 N / sqrt(K) of the noise N of the whole
    order = pooled["order_spectrum"]["order"].to_numpy()
    level = np.mean(pooled["order_spectrum"]["amplitude"].sel(channel="a").to_numpy()[(order > 30) & (order < 40)] ** 2)
    whole = hums.analyze(record, BOX, settings=SETTINGS.changed(channels=("a",)))["order_spectrum"]
    quiet = (whole["order"] > 30) & (whole["order"] < 40)
    assert_allclose(level / float((whole["amplitude"][0][quiet] ** 2).mean()), SEGMENTS**0.5, rtol=0.1)
    assert mesh_lines(pooled).claimed.all()
    assert_allclose(mesh_lines(pooled).amplitude, AMPLITUDE, rtol=0.01)


def test_a_gap_costs_what_it_covers(pooled):
    health = hums.health_table(pooled).set_index("name")
    assert (health.status["a"], health.status["b"]) == ("ok", "suspect")
    assert health.missing["b"] == pytest.approx(10 / COUNT)
    (note,) = [note for note in hums.summary(pooled)["notes"] if "10 samples that are not finite" in note]
    assert "14.8 of 15 s are analysed, whole revolutions in 4 segments between gaps" in note
    channels = {row["name"]: row["duration_s"] for row in json.loads(pooled.attrs["channels_json"])}
    assert channels == {"a": pytest.approx(COUNT / RATE_HZ), "b": pytest.approx(COUNT / RATE_HZ)}


def test_tracks_follow_each_other_with_nothing_in_a_gap(pooled):
    tracks = pooled["tracks"].to_dataset()
    times_s = tracks["time_s"].to_numpy()
    assert np.all(np.diff(times_s) > 0)
    assert times_s[0] < 0.1
    assert times_s[-1] > COUNT / RATE_HZ - 0.2
    for name, size in zip(tracks["track_channel"].to_numpy(), np.abs(tracks["complex_amplitude"]), strict=True):
        there = np.isfinite(size)
        assert_allclose(size[there], AMPLITUDE, rtol=0.1)
        assert there.mean() > 0.98
        in_gap = (times_s > 7.45) & (times_s < 7.55)
        assert there[in_gap].all() == (name == "a")


@pytest.mark.parametrize("angle", [hums.UnknownAngle(), hums.NominalSpeed(rpm=60.0 * TURN_HZ, shaft="input")])
def test_the_speed_is_found_in_each_part_between_the_gaps(angle, monkeypatch):
    # 20 rev/s growing by 0.02 rev/s a second; a gap in the middle of a part
    times_s = np.arange(COUNT) / RATE_HZ
    turn = TURN_HZ * times_s + 0.01 * times_s**2
    x = AMPLITUDE * np.cos(2 * np.pi * 23 * turn) + 0.2 * np.cos(2 * np.pi * 46 * turn + 1)
    x += 0.2 * np.cos(2 * np.pi * turn) + STD * np.random.default_rng(3).normal(size=COUNT)
    x[30_000] = np.nan
    record = hums.make_record({"a": x}, rate_hz=RATE_HZ, units="g", angle=angle)
    unknown = isinstance(angle, hums.UnknownAngle)
    limits = {"speed_range_hz": (17.0, 23.0), "max_acceleration_hz_s": 0.2} if unknown else {}
    found = cut(record, monkeypatch, settings=SETTINGS.changed(most_tracks=0, envelope_band_hz=None, **limits))
    speed = found["speed"].to_dataset()
    assert np.all(np.diff(speed.time_s) > 0)
    assert speed.time_s[-1] > COUNT / RATE_HZ - 0.2
    assert_allclose(speed.speed_hz, TURN_HZ + 0.02 * speed.time_s, rtol=2e-3 if unknown else 0.02)
    assert mesh_lines(found).claimed.all()
    if unknown:
        assert_allclose(mesh_lines(found).amplitude, AMPLITUDE, rtol=0.02)


def test_its_tables_are_those_of_an_analysis(pooled, tmp_path):
    hums.save_analysis(pooled, tmp_path / "pooled.h5")
    with hums.open_analysis(tmp_path / "pooled.h5") as opened:
        assert len(hums.derive_verdicts(opened)) == len(hums.verdict_table(opened)) > 10
        assert hums.summary(opened)["findings"] == []
    table = hums.indicator_table(pooled).query("channel == 'a'").set_index(["component", "indicator"])
    assert_allclose(table.value["record", "rms"], np.hypot(AMPLITUDE / 2**0.5, STD), rtol=0.01)
    assert "median of 3 segments" in table.takes["record", "kurtosis"]


def test_a_line_that_no_segment_shows_stands_out_of_their_average(monkeypatch):
    # noise whose level an outer race modulates by 4 %, found in the average of 16 segments
    orders = hums.defect_orders(hums.solve_kinematics(BOX)).set_index(["component", "kind"])["order"]
    order = float(orders["input bearing", "outer_race"])
    count = 16 * 20_000
    times_s = np.arange(count) / RATE_HZ
    noise = np.random.default_rng(1).normal(size=count)
    x = (1 + 0.04 * np.cos(2 * np.pi * order * TURN_HZ * times_s)) * noise
    settings = SETTINGS.changed(most_tracks=0, envelope_band_hz=(500.0, 1500.0))

    def outer_race(analysis):
        lines = hums.line_table(analysis, "envelope").query("component == 'input bearing' and kind == 'outer_race'")
        return lines[(lines.harmonic == 1) & (lines.sideband == 0)].iloc[0]

    alone = outer_race(hums.analyze(made({"a": x[: count // 16]}, count // 16), BOX, settings=settings))
    together = outer_race(cut(made({"a": x}, count), monkeypatch, 16, settings))
    assert not alone.claimed
    assert together.claimed
    assert together.order_found == pytest.approx(order, rel=1e-3)


def test_noise_makes_no_more_lines_than_stated(monkeypatch):
    """White noise, and noise that falls with frequency as an autoregression of first order."""
    monkeypatch.setattr(segments, "LONGEST", COUNT // 9)
    settings = SETTINGS.changed(most_tracks=0, envelope_band_hz=(500.0, 1500.0), false_alarm_probability=0.05)
    named, chances = 0, []
    for seed in range(12):
        noise = lfilter([1.0], [1.0, -0.9 * (seed % 2)], np.random.default_rng(seed).normal(size=COUNT // 3))
        analysis = hums.analyze(made({"a": noise}, COUNT // 3), BOX, settings=settings)
        named += len(hums.findings_table(analysis)) > 0
        lines = hums.line_table(analysis, "order_spectrum")
        chances.append(lines.false_alarm_probability[lines.kind == "tooth"].min())
    assert named <= 3  # of 12 at 0.05, in 99.8 of 100
    assert np.sum(np.array(chances) < 0.05) <= 3


def test_nothing_that_can_be_analysed(record, monkeypatch):
    silent = record.assign(a=record.a * 0 + 1, b=record.b * np.nan)
    with pytest.raises(hums.AnalysisError, match=r'channel "a" has the same value 1 throughout'):
        cut(silent, monkeypatch)
