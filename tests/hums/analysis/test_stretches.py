"""Long records in stretches: spectra averaged by power, rows of the median stretch, tracks one after the other."""

import json

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal

import hums
from hums.analysis import stretches
from hums.analysis.stretches import median_rows

RATE_HZ, TURN_HZ, COUNT = 4000, 20.0, 60_000
AMPLITUDE, STD = 0.5, 0.05
STRETCHES = 3


@pytest.fixture(scope="module")
def record():
    times_s = np.arange(COUNT) / RATE_HZ
    mesh = AMPLITUDE * np.cos(2 * np.pi * 23 * TURN_HZ * times_s)
    noise = np.random.default_rng(3).normal(0, STD, (2, COUNT))
    noise[1, 30_000:30_010] = np.nan  # in the second stretch
    angle = hums.PulseTimes(times_s=np.arange(0, COUNT / RATE_HZ, 1 / TURN_HZ), shaft="input", pulses_per_rev=1)
    return hums.make_record({"a": mesh + noise[0], "b": mesh + noise[1]}, rate_hz=RATE_HZ, units="g", angle=angle)


@pytest.fixture(scope="module")
def joined(record):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stretches, "LONGEST", COUNT // STRETCHES)
        return hums.analyze(record, hums.load_gearbox("two-stage"), settings=hums.AnalysisSettings(pictures=False))


def test_power_is_averaged(joined):
    # the power of noise in a bin has a standard deviation of its mean, and over the root of n in the mean of n
    order, amplitude = joined["order_spectrum"]["order"].to_numpy(), joined["order_spectrum"]["amplitude"]
    quiet = (order > 30) & (order < 40)  # between the mesh and its harmonic
    for channel, count in (("a", STRETCHES), ("b", STRETCHES - 1)):
        power = amplitude.sel(channel=channel).to_numpy()[quiet] ** 2
        assert_allclose(power.std() / power.mean(), count**-0.5, rtol=0.1)  # some 1,000 independent bins
        assert_allclose(float(amplitude.sel(channel=channel).max()), AMPLITUDE, rtol=0.01)


def test_a_gap_costs_its_stretch_alone(joined):
    channels = {row["name"]: row for row in json.loads(joined.attrs["channels_json"])}
    assert channels["a"]["duration_s"] == pytest.approx(COUNT / RATE_HZ)
    assert channels["b"]["duration_s"] == pytest.approx(2 / 3 * COUNT / RATE_HZ)
    notes = json.loads(joined.attrs["notes_json"])
    assert "3 stretches of equal length" in notes[0]
    assert any('"b" is left out: it has 10 samples' in note for note in notes)
    health = hums.health_table(joined).set_index("name")
    assert health.status["b"] == "sick"


def test_tracks_follow_each_other(joined):
    tracks = joined["tracks"].to_dataset()
    times_s = tracks["time_s"].to_numpy()
    assert np.all(np.diff(times_s) > 0)
    assert times_s[0] < 0.1
    assert times_s[-1] > COUNT / RATE_HZ - 0.2
    size = np.abs(tracks["complex_amplitude"].to_numpy())
    assert_allclose(size[tracks["track_channel"].to_numpy() == "a"], AMPLITUDE, rtol=0.05)
    middle = (times_s > 5.5) & (times_s < 9.5)  # where channel b has a gap
    assert np.isnan(size[tracks["track_channel"].to_numpy() == "b"][:, middle]).all()


def test_a_speed_is_estimated_for_each_stretch(monkeypatch):
    # 20 rev/s growing by 0.02 rev/s a second; the middle stretch has twenty times the noise
    times_s = np.arange(COUNT) / RATE_HZ
    turn = TURN_HZ * times_s + 0.01 * times_s**2
    std = np.repeat([STD, 20 * STD, STD], COUNT // STRETCHES)
    x = AMPLITUDE * np.cos(2 * np.pi * 23 * turn) + 0.2 * np.cos(2 * np.pi * 46 * turn + 1)
    x += 0.2 * np.cos(2 * np.pi * turn) + std * np.random.default_rng(3).normal(size=COUNT)
    record = hums.make_record({"a": x}, rate_hz=RATE_HZ, units="g", angle=hums.UnknownAngle())
    settings = hums.AnalysisSettings(
        pictures=False, most_tracks=0, envelope_band_hz=None, speed_range_hz=(17.0, 23.0), max_acceleration_hz_s=0.2
    )
    monkeypatch.setattr(stretches, "LONGEST", COUNT // STRETCHES)
    box = hums.load_gearbox("two-stage")
    found = hums.analyze(record, box, settings=settings)
    speed = found["speed"].to_dataset()
    assert np.all(np.diff(speed.time_s) > 0)
    assert speed.time_s[-1] > COUNT / RATE_HZ - 0.1
    assert_allclose(speed.speed_hz, TURN_HZ + 0.02 * speed.time_s, rtol=1e-3)
    alone = hums.analyze(record.isel(time=slice(COUNT // 3, 2 * COUNT // 3)), box, settings=settings)["speed"]
    assert {name: speed.attrs[name] for name in ("confidence", "phase_std_rev")} == {
        name: alone.attrs[name] for name in ("confidence", "phase_std_rev")
    }
    lines = hums.line_table(found, "order_spectrum")
    mesh = lines[(lines.component == "stage 1") & (lines.harmonic == 1) & (lines.sideband == 0)]
    assert_allclose(mesh.amplitude, AMPLITUDE, rtol=0.01)


def test_its_tables_are_those_of_an_analysis(joined, tmp_path):
    hums.save_analysis(joined, tmp_path / "joined.h5")
    with hums.open_analysis(tmp_path / "joined.h5") as opened:
        assert len(hums.derive_verdicts(opened)) == len(hums.verdict_table(opened)) > 10
        assert hums.summary(opened)["findings"] == []
    lines = hums.line_table(joined, "order_spectrum")
    mesh = lines[(lines.component == "stage 1") & (lines.harmonic == 1) & (lines.sideband == 0)]
    assert mesh.claimed.all()
    assert_allclose(mesh.amplitude, AMPLITUDE, rtol=0.01)
    rms = hums.indicator_table(joined).query("indicator == 'rms' and channel == 'a'").value.item()
    assert_allclose(rms, np.hypot(AMPLITUDE / 2**0.5, STD), rtol=0.01)


def test_nothing_that_can_be_analysed(record, monkeypatch):
    monkeypatch.setattr(stretches, "LONGEST", COUNT // STRETCHES)
    silent = record.assign(a=record.a * 0 + 1, b=record.b * np.nan)
    with pytest.raises(hums.AnalysisError, match=r"From 0 to 5 s nothing is analysed: channel"):
        hums.analyze(silent, hums.load_gearbox("two-stage"))


def table(names, values):
    return xr.Dataset({"part": ("row", np.array(names)), "strength": ("row", values), "other": ("x", [1, 2])})


def test_a_row_is_that_of_the_median_and_of_half_the_tables():
    tables = [
        table(["p", "q", "r"], [3.0, 1.0, 7.0]),
        table(["q", "p"], [2.0, 1.0]),
        table(["p", "q"], [2.0, np.nan]),
        table(["p"], [9.0]),
    ]
    rows = median_rows(tables, [0.0, 10.0, 20.0, 30.0], dim="row", keys=("part",), by=("strength",))
    assert rows["part"].to_numpy().tolist() == ["p", "q"]  # r is in one of four
    assert_array_equal(rows["strength"], [2.0, 1.0])  # of 1, 2, 3, 9 and of 1, 2 the lower
    assert_array_equal(rows["stretch_s"], [20.0, 0.0])
    assert "other" not in rows
