"""The workflow on small made-up records: layout, round trip, and a sentence for every kind of bad input."""

import json

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter

from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import (
    envelope_bands,
    group,
    health_table,
    line_table,
    open_analysis,
    save_analysis,
    summary,
    verdict_table,
)
from hums.analysis.settings import AnalysisError
from hums.gearbox.defect_orders import BEARING_KINDS, defects
from hums.gearbox.model import Gearbox, load_gearbox
from hums.records.record import Channel, NominalSpeed, PulseTimes, UnknownAngle, make_record
from hums.records.store import open_record, save_record, write_tree
from hums.report import render

TWO_STAGE = load_gearbox("two-stage")
RATE_HZ = 5000.0
SPEED_HZ = 20.0
SECONDS = 4.0
NO_TRACKS = AnalysisSettings(most_tracks=0, pictures=False)


def tone_record(*, channels=None, angle=None, seconds=SECONDS):
    """One order-23 tone of 0.5 g in noise of 0.1 g, a pulse each revolution of the input."""
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    noise = np.random.default_rng(5).normal(0, 0.1, time.size)
    values = 0.5 * np.cos(2 * np.pi * 23 * SPEED_HZ * time) + noise
    pulses = PulseTimes(times_s=np.arange(0.0, seconds, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1)
    return make_record(
        channels or {"housing": Channel(values=values, units="g")}, rate_hz=RATE_HZ, angle=angle or pulses
    )


@pytest.fixture(scope="module")
def analysis():
    return analyze(
        tone_record(), load_gearbox("two-stage"), settings=AnalysisSettings(envelope_band_hz=(1200.0, 2200.0))
    )


def test_the_path_of_a_record_is_as_good_as_the_record(tmp_path):
    save_record(tone_record(), tmp_path / "record.h5")
    settings = NO_TRACKS.changed(envelope_band_hz=None)
    from_path = analyze(tmp_path / "record.h5", TWO_STAGE, settings=settings)
    with open_record(tmp_path / "record.h5") as record:
        # transforms of memory that lies elsewhere may round differently
        xr.testing.assert_allclose(from_path, analyze(record, TWO_STAGE, settings=settings), rtol=1e-9)


def test_mesh_line_is_found_and_tracked(analysis):
    table = line_table(analysis, "order_spectrum")
    mesh = table[(table["component"] == "stage 1") & (table["harmonic"] == 1) & (table["kind"] == "gear_mesh")].iloc[0]
    assert mesh["claimed"]
    # the noise moves a Hann line by less than four of its own std
    assert abs(mesh["amplitude"] - 0.5) < 4 * mesh["amplitude_std"]
    tracks = group(analysis, "tracks")
    track = tracks.isel(track=int(np.argmin(np.abs(tracks["track_order"].to_numpy() - 23))))
    error = (track["complex_amplitude"].to_numpy() - 0.5) / track["std"].to_numpy()
    assert np.abs(error.real).max() < 5
    assert np.abs(error.imag).max() < 5


def test_level_is_amplitude_over_the_median_of_the_background(analysis):
    dataset = group(analysis, "order_spectrum")
    orders, amplitude = dataset["order"].to_numpy(), dataset["amplitude"].sel(channel="housing").to_numpy()
    table = line_table(analysis, "order_spectrum")
    mesh = table[(table["component"] == "stage 1") & (table["harmonic"] == 1) & (table["kind"] == "gear_mesh")].iloc[0]
    distance = np.abs(orders - mesh["order_found"])
    around = (distance < 1) & (distance > 3 * dataset.attrs["bin_width_orders"])
    assert mesh["snr"] == pytest.approx(mesh["amplitude"] / np.median(amplitude[around]), rel=0.02)


def test_analysis_survives_the_file(analysis, tmp_path):
    save_analysis(analysis, tmp_path / "analysis.h5")
    with open_analysis(tmp_path / "analysis.h5") as reopened:
        assert summary(reopened) == summary(analysis)
        np.testing.assert_array_equal(
            group(reopened, "tracks")["complex_amplitude"], group(analysis, "tracks")["complex_amplitude"]
        )


def test_summary_has_the_stated_keys(analysis):
    facts = json.loads(json.dumps(summary(analysis), allow_nan=False))
    assert {
        "schema",
        "record",
        "gearbox",
        "reference",
        "settings",
        "speed_hz",
        "orders",
        "envelope",
        "findings",
    } <= set(facts)
    assert {"min", "max", "mean"} <= set(facts["speed_hz"])
    assert facts["speed_hz"]["mean"] == pytest.approx(SPEED_HZ, rel=1e-9)
    row = facts["orders"][0]
    expected = "component kind harmonic sideband channel order order_found amplitude amplitude_std units snr claimed"
    assert set(expected.split()) <= set(row)


def test_without_a_band_no_bearing_line_is_searched_and_the_report_says_so():
    bare = analyze(tone_record(), load_gearbox("two-stage"), settings=NO_TRACKS.changed(envelope_band_hz=None))
    assert line_table(bare, "envelope").empty
    assert any("No envelope band" in note for note in summary(bare)["notes"])


def test_reference_differs_from_the_tachometer_shaft():
    gearbox = load_gearbox("two-stage").changed(reference="intermediate")
    record = tone_record()
    speed = group(analyze(record, gearbox, settings=NO_TRACKS), "speed")["speed_hz"].to_numpy()
    np.testing.assert_allclose(speed, SPEED_HZ * 23 / 67, rtol=1e-9)


def test_two_channels_stay_apart():
    rng = np.random.default_rng(1)
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    quiet = rng.normal(0, 0.1, time.size)
    loud = quiet + np.cos(2 * np.pi * 23 * SPEED_HZ * time)
    record = tone_record(channels={"a": Channel(values=loud, units="g"), "b": Channel(values=quiet, units="m s-2")})
    table = line_table(analyze(record, TWO_STAGE, settings=NO_TRACKS), "order_spectrum")
    mesh = table[(table["component"] == "stage 1") & (table["harmonic"] == 1) & (table["kind"] == "gear_mesh")]
    assert dict(zip(mesh["channel"], mesh["claimed"], strict=True)) == {"a": True, "b": False}
    assert dict(zip(mesh["channel"], mesh["units"], strict=True)) == {"a": "g", "b": "m s-2"}


# ---- healthy machines and what passes for a fault in them --------------------------------------------------------


def healthy(rng, *, seconds=10.0, rate_hz=5000.0, jitter_s=0.0, covered=None, more=()):
    """A strong mesh line at 23 orders of 20 rev/s in little noise; `more` are further (order, amplitude)."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    values = np.cos(2 * np.pi * 23 * SPEED_HZ * time) + 0.05 * rng.standard_normal(time.size)
    for order, amplitude in more:
        values = values + amplitude * np.cos(2 * np.pi * order * SPEED_HZ * time)
    pulses = np.arange(0.0131, covered or seconds, 1 / SPEED_HZ)
    pulses = pulses + jitter_s * rng.standard_normal(pulses.size)
    angle = PulseTimes(times_s=pulses, shaft="input", pulses_per_rev=1)
    return make_record({"housing": Channel(values=values, units="g")}, rate_hz=rate_hz, angle=angle)


@pytest.mark.parametrize("jitter_s", [5e-6, 50e-6])
def test_jitter_of_the_tachometer_raises_no_finding(jitter_s):
    # the mesh line's phase noise fills half an order on either side; its sidebands are weighed against that
    rng = np.random.default_rng(1)
    found = [analyze(healthy(rng, jitter_s=jitter_s), load_gearbox("two-stage"), settings=NO_TRACKS) for _ in range(3)]
    assert all(group(one, "findings").sizes["finding"] == 0 for one in found)


def test_jitter_that_blurs_the_mesh_is_noted():
    # 0.2 ms of 50 ms a turn is 0.58 rad at order 23: the line shrinks, and the reader must know
    analysis = analyze(healthy(np.random.default_rng(1), jitter_s=2e-4), load_gearbox("two-stage"), settings=NO_TRACKS)
    (note,) = [note for note in summary(analysis)["notes"] if "jitter" in note]
    stated_us = float(note.split(" us")[0].rsplit(" ", 1)[1])
    assert stated_us == pytest.approx(200, rel=0.2)  # 200 pulses tell a standard deviation within 5 %, four times that
    calm = analyze(healthy(np.random.default_rng(1), jitter_s=5e-6), load_gearbox("two-stage"), settings=NO_TRACKS)
    assert not [note for note in summary(calm)["notes"] if "jitter" in note]


@pytest.mark.parametrize("covered", [0.4, 1.0, 3.0])
def test_the_flank_of_a_strong_line_is_not_claimed(covered):
    # so short that the window spreads the mesh line over its neighbours, 0.34 orders away
    record = healthy(np.random.default_rng(2), covered=covered, more=[(1, 0.2)])
    analysis = analyze(record, load_gearbox("two-stage"), settings=NO_TRACKS)
    table = line_table(analysis, "order_spectrum")
    claimed = table[table["claimed"]]
    assert set(zip(claimed["component"], claimed["harmonic"], strict=True)) <= {("stage 1", 1), ("input", 1)}
    assert any("are analysed" in note for note in summary(analysis)["notes"])


def test_channels_with_different_bandwidths_share_their_outputs():
    rng = np.random.default_rng(3)
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    steady = np.cos(2 * np.pi * 23 * SPEED_HZ * time)
    wandering = steady * (1 + 0.5 * np.sin(2 * np.pi * 1.5 * time))
    slow = np.cos(2 * np.pi * 23 * SPEED_HZ * np.arange(round(SECONDS * 1500)) / 1500)
    record = tone_record(
        channels={
            "a": Channel(values=steady + 0.05 * rng.standard_normal(time.size), units="g"),
            "b": Channel(values=wandering + 0.05 * rng.standard_normal(time.size), units="g"),
            "c": Channel(values=slow + 0.05 * rng.standard_normal(slow.size), units="g", rate_hz=1500.0),
        }
    )
    settings = AnalysisSettings(most_tracks=3, envelope_band_hz=None, pictures=False)
    tracks = group(analyze(record, TWO_STAGE, settings=settings), "tracks")
    assert set(tracks["track_channel"].to_numpy()) == {"a", "b", "c"}
    assert np.isfinite(tracks["complex_amplitude"].to_numpy()).all()


def test_a_dead_sensor_beside_a_sound_one():
    sound = np.random.default_rng(0).normal(0, 0.1, 20_000)
    record = tone_record(
        channels={"dead": Channel(values=np.zeros(20_000), units="g"), "sound": Channel(values=sound, units="g")}
    )
    analysis = analyze(record, TWO_STAGE, settings=NO_TRACKS)
    verdict = health_table(analysis).set_index("name")
    assert verdict["status"].to_dict() == {"sound": "ok", "dead": "faulty", "tachometer": "ok"}
    assert "It is 0 g throughout" in verdict.loc["dead", "reasons"]
    assert any('Left out: channel "dead" has the same value' in note for note in summary(analysis)["notes"])
    assert set(line_table(analysis, "order_spectrum")["channel"]) == {"sound"}


@pytest.mark.parametrize("value", [0.0, 5.0])
def test_a_dead_sensor(value):
    record = tone_record(channels={"dead": Channel(values=np.full(20000, value), units="g")})
    with pytest.raises(AnalysisError, match=r'channel "dead" has the same value . throughout'):
        analyze(record, load_gearbox("two-stage"))


def test_a_spike_is_noted():
    values = np.random.default_rng(4).normal(size=20000)
    values[777] = 1e5
    record = tone_record(channels={"a": Channel(values=values, units="g")})
    notes = summary(analyze(record, TWO_STAGE, settings=NO_TRACKS))["notes"]
    assert any("electrical spike" in note for note in notes)


@pytest.mark.parametrize("width_hz", [1.0, 100.0])
def test_lines_beyond_a_narrow_envelope_band_are_out_of_reach(width_hz):
    settings = NO_TRACKS.changed(envelope_band_hz=(1500.0, 1500.0 + width_hz))
    analysis = analyze(healthy(np.random.default_rng(5)), load_gearbox("two-stage"), settings=settings)
    assert group(analysis, "findings").sizes["finding"] == 0
    assert any("sampling rate or envelope band" in note for note in summary(analysis)["notes"])


def test_the_passing_of_planets_is_no_ring_tooth():
    # a healthy planetary: the mesh at 99 per turn of the carrier, modulated as the three planets pass the sensor
    rate_hz, carrier_hz = 4000.0, 5.0
    time = np.arange(round(20 * rate_hz)) / rate_hz
    passing = 1 + 0.5 * np.cos(2 * np.pi * 3 * carrier_hz * time)
    values = passing * np.cos(2 * np.pi * 99 * carrier_hz * time)
    values += 0.05 * np.random.default_rng(6).standard_normal(time.size)
    pulses = PulseTimes(times_s=np.arange(0.01, 20, 1 / carrier_hz), shaft="carrier", pulses_per_rev=1)
    record = make_record({"ring": Channel(values=values, units="g")}, rate_hz=rate_hz, angle=pulses)
    analysis = analyze(record, load_gearbox("planetary-27-36-99"), settings=NO_TRACKS)
    table = line_table(analysis, "order_spectrum")
    ring = table[(table["component"] == "planet-ring/ring") & (table["harmonic"] == 1)].set_index("sideband")
    assert ring.loc[3, "explained_by"].endswith("which planets cause in a healthy stage")
    assert group(analysis, "findings").sizes["finding"] == 0


def test_scale_does_not_matter():
    record = healthy(np.random.default_rng(7))
    loud = record.assign(housing=record["housing"] * 1e120).assign_attrs(record.attrs)
    loud["housing"].attrs.update(record["housing"].attrs)
    one, two = (analyze(r, load_gearbox("two-stage"), settings=NO_TRACKS) for r in (record, loud))
    np.testing.assert_allclose(
        line_table(one, "order_spectrum")["snr"], line_table(two, "order_spectrum")["snr"], rtol=1e-9
    )


def test_a_channel_that_is_not_there():
    with pytest.raises(AnalysisError, match=r'no vibration channel "housin"; did you mean "housing"\?'):
        analyze(tone_record(), load_gearbox("two-stage"), settings=AnalysisSettings(channels=("housin",)))


def test_a_record_shorter_than_one_revolution():
    time = np.arange(200) / RATE_HZ
    pulses = PulseTimes(times_s=[0.0, 0.05], shaft="input", pulses_per_rev=1)
    record = tone_record(channels={"a": Channel(values=np.sin(time), units="g")}, angle=pulses)
    with pytest.raises(AnalysisError, match="holds no whole revolution of the"):
        analyze(record, load_gearbox("two-stage"))


def test_repaired_pulses_are_noted():
    times = np.arange(0.0, SECONDS, 1 / SPEED_HZ)
    spoilt = np.sort(np.append(np.delete(times, [30, 50]), [times[40] + 0.02, times[60] + 0.001]))
    record = tone_record(angle=PulseTimes(times_s=spoilt, shaft="input", pulses_per_rev=1))
    analysis = analyze(record, TWO_STAGE, settings=NO_TRACKS)
    (note,) = [note for note in summary(analysis)["notes"] if "repaired" in note]
    assert "2 were missing and counted, 1 double and 1 spurious ones left out, of 78 that remain" in note
    sound = line_table(analyze(tone_record(), TWO_STAGE, settings=NO_TRACKS), "order_spectrum")
    found = line_table(analysis, "order_spectrum")
    np.testing.assert_allclose(found["amplitude"], sound["amplitude"], rtol=1e-6)


def test_pulses_that_cannot_be_repaired():
    times = np.delete(np.arange(0.0, SECONDS, 1 / SPEED_HZ), np.arange(20, 60))
    record = tone_record(angle=PulseTimes(times_s=times, shaft="input", pulses_per_rev=1))
    with pytest.raises(AnalysisError, match=r'tachometer "tachometer": the tachometer has no pulse from 0\.95 to 3 s'):
        analyze(record, load_gearbox("two-stage"))


def test_a_shaft_the_gearbox_does_not_have():
    record = tone_record(angle=NominalSpeed(rpm=1200, shaft="inptu"))
    with pytest.raises(AnalysisError, match=r'shaft "inptu".*did you mean "input"\?'):
        analyze(record, load_gearbox("two-stage"))


def test_a_gearbox_of_two_degrees_of_freedom():
    table = {
        "name": "two shafts",
        "frame": "housing",
        "reference": "input",
        "axes": {"a": ["housing", "input"], "b": ["housing", "other"]},
    }
    with pytest.raises(AnalysisError, match="2 degrees of freedom"):
        analyze(tone_record(), Gearbox.from_mapping(table))


def test_a_band_that_falls():
    with pytest.raises(AnalysisError, match=r"settings: envelope_band_hz = .* must rise"):
        AnalysisSettings(envelope_band_hz=(2000.0, 1000.0))


def test_a_band_that_is_none():
    with pytest.raises(AnalysisError, match=r"envelope_band_hz: 'automatic' is not a band; give \(low, high\) in Hz"):
        AnalysisSettings(envelope_band_hz="automatic")
    assert AnalysisSettings(envelope_band_hz=[1000, 2000]).envelope_band_hz == (1000, 2000)


def test_settings_survive_json():
    for settings in (AnalysisSettings(), AnalysisSettings(envelope_band_hz=(1.0, 2.0)), WITHOUT, NO_TRACKS):
        assert AnalysisSettings.model_validate_json(settings.model_dump_json()) == settings


def test_a_band_beyond_the_sampling_rate():
    with pytest.raises(AnalysisError, match=r"lie in 0 to 2500 Hz.*leave the channel out"):
        analyze(tone_record(), load_gearbox("two-stage"), settings=AnalysisSettings(envelope_band_hz=(1000.0, 9000.0)))


def test_settings_that_are_none():
    with pytest.raises(AnalysisError, match=r'unknown key "chanels"; did you mean "channels"'):
        AnalysisSettings(chanels=("a",))
    assert AnalysisSettings(channels=["a"]).channels == ("a",)
    for wrong in ({"settings": {"harmonics": 3}}, {}):
        gearbox = load_gearbox("two-stage") if wrong else "two-stage"
        with pytest.raises((AnalysisError, TypeError), match=r"settings, not .* type dict|gearbox.* of type str"):
            analyze(tone_record(), gearbox, **wrong)


def test_opening_what_is_no_analysis(tmp_path):
    write_tree(xr.DataTree(xr.Dataset({"a": ("x", np.zeros(3))})), tmp_path / "other.h5")
    with pytest.raises(AnalysisError, match="this is not an analysis"):
        open_analysis(tmp_path / "other.h5")


# ---- what the sensors are worth ------------------------------------------------------------------------------------


def verdicts(analysis):
    return health_table(analysis).set_index("name")["status"].to_dict()


def test_the_verdict_on_every_sensor(analysis):
    assert verdicts(analysis) == {"housing": "ok", "tachometer": "ok"}


def test_clipped_samples_are_missing_to_the_trackers():
    # a slow swing drives the record into its rails; cut samples know nothing of the mesh line on top of it
    rng = np.random.default_rng(8)
    time = np.arange(round(10 * RATE_HZ)) / RATE_HZ
    clean = 0.5 * np.cos(2 * np.pi * 23 * SPEED_HZ * time) + 1.2 * np.cos(2 * np.pi * 3 * SPEED_HZ * time)
    clean += rng.normal(0, 0.02, time.size)  # little, since a rail cuts more of the noise that points to it
    cut = np.clip(clean, -1.5, 1.5)
    share = np.mean(np.abs(cut) == 1.5)
    assert share > 0.02  # enough that taking them at face value would take more off than the std says
    pulses = PulseTimes(times_s=np.arange(0.0, 10.0, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1)
    record = make_record({"housing": Channel(values=cut, units="g")}, rate_hz=RATE_HZ, angle=pulses)
    settings = AnalysisSettings(most_tracks=3, envelope_band_hz=None, pictures=False)
    analysis = analyze(record, TWO_STAGE, settings=settings)
    assert verdicts(analysis)["housing"] == "faulty"
    tracks = group(analysis, "tracks")
    track = tracks.isel(track=int(np.argmin(np.abs(tracks["track_order"].to_numpy() - 23))))
    inner = slice(10, -10)
    error = track["complex_amplitude"].to_numpy()[inner].real - 0.5
    lines = line_table(analysis, "order_spectrum")
    mesh = lines[(lines["component"] == "stage 1") & (lines["harmonic"] == 1)].iloc[0]
    assert mesh["amplitude"] < 0.5 - 0.01  # what clipping takes off
    assert abs(error.mean()) < 0.25 * (0.5 - mesh["amplitude"])


def test_what_a_sick_sensor_shows_is_not_diagnosed():
    rng = np.random.default_rng(9)
    time = np.arange(round(8 * RATE_HZ)) / RATE_HZ
    inner = 5.445 * SPEED_HZ  # of the input bearing, per turn of the input
    burst = (1 + np.cos(2 * np.pi * inner * time)) ** 4 / 16
    values = np.clip(rng.normal(0, 0.2, time.size) + 3 * burst * rng.normal(size=time.size), -1.2, 1.2)
    record = make_record(
        {"housing": Channel(values=values, units="g")},
        rate_hz=RATE_HZ,
        angle=PulseTimes(times_s=np.arange(0.0, 8.0, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1),
    )
    analysis = analyze(record, load_gearbox("two-stage"), settings=NO_TRACKS)
    assert verdicts(analysis)["housing"] == "faulty"
    assert summary(analysis)["findings"] == []
    judged = summary(analysis)["verdicts"]
    assert {one["verdict"] for one in judged} == {"not judged"}
    assert all("the sensor is faulty" in one["evidence"] for one in judged if one["kind"] in BEARING_KINDS)


def test_a_tachometer_with_faults_is_suspect():
    times = np.delete(np.arange(0.0, SECONDS, 1 / SPEED_HZ), [30, 50])
    record = tone_record(angle=PulseTimes(times_s=times, shaft="input", pulses_per_rev=1))
    analysis = analyze(record, TWO_STAGE, settings=NO_TRACKS)
    assert verdicts(analysis)["tachometer"] == "suspect"


# ---- the band that is chosen ---------------------------------------------------------------------------------------


def test_a_band_is_chosen_where_the_bearing_rings():
    rng = np.random.default_rng(10)
    rate_hz, seconds = 20_000.0, 5.0
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    race = next(row for row in defects(TWO_STAGE) if row.kind == "inner_race").order
    strikes = np.arange(0.0, seconds, 1 / (race * SPEED_HZ))
    impulse = np.zeros(time.size)
    impulse[np.rint(strikes * rate_hz).astype(np.intp)] = 1.0
    decay = np.arange(400) / rate_hz
    ring = np.exp(-2000 * decay) * np.cos(2 * np.pi * 6000 * decay)
    values = np.convolve(impulse, ring)[: time.size] + rng.normal(0, 0.15, time.size)
    record = make_record(
        {"housing": Channel(values=values, units="g")},
        rate_hz=rate_hz,
        angle=PulseTimes(times_s=np.arange(0.0, seconds, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1),
    )
    analysis = analyze(record, TWO_STAGE, settings=NO_TRACKS)
    (band,) = envelope_bands(analysis)
    assert band["chosen"]
    assert band["low_hz"] < 6300  # the resonance, 640 Hz wide, is in it
    assert band["high_hz"] > 5700
    assert "the line of input bearing inner race modulates it by" in band["why"]
    first = summary(analysis)["findings"][0]
    # the strikes are alike all round, as no load zone makes them: no sideband, so a doubt remains
    assert (first["kind"], first["verdict"]) == ("inner_race", "indicated")


def test_a_bearing_too_fast_for_its_third_harmonic_is_diagnosed():
    """At 450 rev/s the third harmonic of the race needs bands wider than halves of the range; the first does not."""
    rng, rate_hz, speed_hz = np.random.default_rng(0), 25_000.0, 450.0
    time = np.arange(round(4 * rate_hz)) / rate_hz
    impulse = np.zeros(time.size)
    strikes = np.cumsum(1 + 0.005 * rng.standard_normal(round(3.9 * 5.445 * speed_hz))) / (5.445 * speed_hz)
    impulse[(strikes * rate_hz).astype(int)] = 1 + 0.8 * np.cos(2 * np.pi * speed_hz * strikes)  # in the load zone
    ring_s = np.arange(100) / rate_hz
    values = np.convolve(impulse, np.exp(-6000 * ring_s) * np.cos(2 * np.pi * 6000 * ring_s))[: time.size]
    values += sum(np.cos(2 * np.pi * order * speed_hz * time + order) for order in (1, 23 * 19 / 67, 23))
    record = make_record(
        {"housing": Channel(values=values + rng.normal(0, 0.1, time.size), units="g")},
        rate_hz=rate_hz,
        angle=PulseTimes(times_s=np.arange(0.0, 4.0, 1 / speed_hz), shaft="input", pulses_per_rev=1),
    )
    first = summary(analyze(record, TWO_STAGE, settings=NO_TRACKS))["findings"][0]
    assert (first["component"], first["kind"]) == ("input bearing", "inner_race")


# ---- where the angle comes from ------------------------------------------------------------------------------------


def test_a_tachometer_by_name():
    fast = PulseTimes(times_s=np.arange(0.0, SECONDS, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1, name="keyphasor")
    wrong = PulseTimes(times_s=np.arange(0.0, SECONDS, 1 / 7.0), shaft="output", pulses_per_rev=1, name="encoder")
    record = tone_record(angle=[wrong, fast])
    analysis = analyze(record, TWO_STAGE, settings=NO_TRACKS.changed(tachometer="keyphasor"))
    assert summary(analysis)["speed_hz"]["mean"] == pytest.approx(SPEED_HZ, rel=1e-9)
    assert summary(analysis)["speed_hz"]["tachometer"] == "keyphasor"
    assert any("contradict each other" in note for note in summary(analysis)["notes"])
    with pytest.raises(AnalysisError, match=r'no tachometer "keyfasor"; did you mean "keyphasor"\?'):
        analyze(record, TWO_STAGE, settings=NO_TRACKS.changed(tachometer="keyfasor"))


def run_up_without_tachometer(*, mesh=1.0, noise=0.5, seed=11):
    """Meshes of the two-stage box over a run-up from 20 to 24 rev/s, and nothing that tells the angle."""
    time = np.arange(40_000) / 4000.0
    turns = 20 * time + 0.2 * time**2
    second = 23 / 67 * 19
    values = mesh * (np.cos(2 * np.pi * 23 * turns) + 0.6 * np.cos(2 * np.pi * second * turns))
    values += mesh * 0.5 * np.cos(2 * np.pi * 46 * turns) + 0.4 * mesh * np.cos(2 * np.pi * turns)
    values += np.random.default_rng(seed).normal(0, noise, time.size)
    return make_record({"housing": Channel(values=values, units="g")}, rate_hz=4000.0, angle=UnknownAngle())


WITHOUT = NO_TRACKS.changed(speed_range_hz=(10.0, 40.0), max_acceleration_hz_s=1.0)


def test_speed_without_a_tachometer():
    analysis = analyze(run_up_without_tachometer(), TWO_STAGE, settings=WITHOUT)
    speed = group(analysis, "speed")
    expected = 20 + 0.4 * speed["time_s"].to_numpy()
    np.testing.assert_allclose(speed["speed_hz"], expected, rtol=2e-3)  # a tenth of a bin of the frames it rests on
    assert speed.attrs["status"] == "ok"
    assert speed.attrs["confidence"] > 0.99
    assert any("estimated from the vibration" in note for note in summary(analysis)["notes"])
    table = line_table(analysis, "order_spectrum")
    mesh = table[(table["component"] == "stage 1") & (table["harmonic"] == 1) & (table["kind"] == "gear_mesh")].iloc[0]
    assert mesh["claimed"]
    assert mesh["amplitude"] == pytest.approx(1.0, rel=0.05)
    assert "estimated from channel housing" in render(analysis)


def test_a_speed_that_cannot_be_told_is_refused():
    with pytest.raises(AnalysisError, match=r'the speed of "input" cannot be estimated.*no shaft shows in it'):
        analyze(run_up_without_tachometer(mesh=0.0), TWO_STAGE, settings=WITHOUT)
    with pytest.raises(AnalysisError, match=r"speed_range_hz=\(low, high\) and max_acceleration_hz_s"):
        analyze(run_up_without_tachometer(), TWO_STAGE)
    with pytest.raises(AnalysisError, match="belong together"):
        AnalysisSettings(speed_range_hz=(10.0, 40.0))


def test_an_ambiguous_speed_is_refused():
    # a single tone may be any of the orders
    time = np.arange(40_000) / 4000.0
    values = np.cos(2 * np.pi * 460 * time) + np.random.default_rng(1).normal(0, 0.5, time.size)
    record = make_record({"housing": Channel(values=values, units="g")}, rate_hz=4000.0, angle=UnknownAngle())
    with pytest.raises(AnalysisError, match="the speed is ambiguous"):
        analyze(record, TWO_STAGE, settings=WITHOUT)


@pytest.mark.slow
@pytest.mark.parametrize("jitter_s", [2e-5, 1e-4])
def test_jitter_of_the_tachometer_is_in_the_std_of_the_tracks(jitter_s):
    # over many records the error of the mesh line's track is what its std says, jitter or not
    squares = []
    for seed in range(6):
        record = healthy(np.random.default_rng(seed), jitter_s=jitter_s)
        settings = AnalysisSettings(envelope_band_hz=None, most_tracks=1, track_bandwidth_orders=0.05, pictures=False)
        tracks = group(analyze(record, TWO_STAGE, settings=settings), "tracks")
        track = tracks.isel(track=0)
        assert float(track["track_order"]) == 23
        # angle zero is the first pulse, at 0.0131 s and itself off by its jitter
        truth = np.exp(2j * np.pi * 23 * SPEED_HZ * 0.0131)
        estimate = track["complex_amplitude"].to_numpy()[20:-20]
        turned = estimate * np.exp(-1j * np.angle(np.mean(estimate / truth)))
        error = np.mean(np.abs(turned / truth - 1) ** 2) / 2  # of each quadrature
        squares.append(error / np.mean(track["std"].to_numpy()[20:-20] ** 2))
    assert 0.64 < np.mean(squares) < 1.56  # 0.8 to 1.25 in standard deviations, as for the demo


def test_a_line_off_the_sidebands_of_a_mesh_is_not_named_after_them():
    """4 BPFI lies 1 % below the first sideband: within the tolerance of a nominal speed, which the mesh narrows."""
    time = np.arange(60_000) / 5000.0
    lines = {1: 0.8, 6.522388: 0.8, 23: 0.8, 24: 0.2, 46: 0.8, 4 * 5.4446: 0.3}
    x = sum(amplitude * np.cos(2 * np.pi * 20 * order * time) for order, amplitude in lines.items())
    x = x + np.random.default_rng(3).normal(0, 0.2, time.size)
    record = make_record({"a": x}, rate_hz=5000.0, units="g", angle=NominalSpeed(rpm=1200, shaft="input"))
    settings = AnalysisSettings(envelope_band_hz=None, pictures=False)
    table = line_table(analyze(record, TWO_STAGE, settings=settings), "order_spectrum")
    sidebands = table[table["claimed"] & (table["component"] == "stage 1/pinion")]
    assert sidebands["order_found"].round(2).tolist() == [24.0]


RACE, LATTICE = 3.573, {"elements": 9, "element_diameter_mm": 8.0, "pitch_diameter_mm": 39.0}


def under_a_mesh(race, stranger, seed=5):
    """Return the analysis of a bearing that rings at 2.5 kHz, where a mesh is five times as loud as the noise.

    The load of the mesh wanders; `stranger` is the level of a source that is not drawn, which modulates at 7 kHz.
    """
    rate_hz, turn_hz, seconds = 20_000, 25.0, 12
    rng, t = np.random.default_rng(seed), np.arange(12 * rate_hz) / rate_hz
    angle = 2 * np.pi * turn_hz * t
    load = 1 + 0.1 * np.cos(2 * np.pi * 0.3 * t) + 0.1 * np.cos(angle)
    mesh = load * sum(np.cos(23 * k * angle + k) for k in range(1, 6))
    strikes = np.zeros(t.size)
    passes = np.cumsum(1 / RACE + 0.01 / RACE * rng.standard_normal(int(RACE * turn_hz * seconds) - 2)) / turn_hz
    strikes[(passes * rate_hz).astype(int)] = 1.0
    ringing = lfilter([1], [1, -2 * 0.97 * np.cos(2 * np.pi * 2500 / rate_hz), 0.97**2], strikes)
    noise = rng.standard_normal(t.size)
    beat = (1 + np.cos(5.31 * angle) + 0.5 * np.cos(2 * 5.31 * angle)) * np.cos(2 * np.pi * 7000.3 * t)
    x = noise + 5 * mesh + race * ringing / ringing.std() + stranger * beat
    table = {"name": "a mesh and a bearing", "frame": "housing", "reference": "in"}
    table |= {"axes": {name: ["housing", name] for name in ("in", "out")}, "mesh": [{"teeth": {"in": 23, "out": 57}}]}
    table |= {"bearing": [{"names": ["b"], "inner_ring": "in", "outer_ring": "housing", **LATTICE}]}
    pulses = PulseTimes(times_s=np.arange(0, seconds, 1 / turn_hz), shaft="in", pulses_per_rev=1)
    record = make_record({"a": x}, rate_hz=rate_hz, units="g", angle=pulses)
    return analyze(record, Gearbox.model_validate(table), settings=AnalysisSettings(pictures=False, most_tracks=0))


def of_the_outer_race(analysis):
    table = verdict_table(analysis)
    return table[table.kind == "outer_race"].iloc[0]


def test_a_bearing_that_rings_where_a_mesh_is_louder_is_named():
    assert of_the_outer_race(under_a_mesh(1.0, 0.0)).verdict == "diagnosed"
    sound = of_the_outer_race(under_a_mesh(0.0, 0.0))
    assert sound.verdict == "nothing found"
    assert "between 200 and 9800 Hz" in sound.evidence


def test_a_stronger_source_in_another_band_does_not_hide_a_bearing():
    assert of_the_outer_race(under_a_mesh(1.0, 2.0)).verdict == "diagnosed"
