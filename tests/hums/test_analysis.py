"""The workflow on small made-up records: layout, round trip, and a sentence for every kind of bad input."""

import json

import numpy as np
import pytest
import xarray as xr

from hums.analysis import AnalysisSettings, analyze
from hums.gearbox import Gearbox, load_gearbox
from hums.layout import GROUPS, AnalysisError, group, open_analysis, save_analysis
from hums.record import Channel, NominalSpeed, PulseTimes, RecordError, make_record
from hums.store import write_tree
from hums.tables import line_table, summary

RATE_HZ = 5000.0
SPEED_HZ = 20.0
SECONDS = 4.0


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


def test_layout(analysis):
    assert set(analysis.children) == set(GROUPS)
    assert isinstance(analysis, xr.DataTree)


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


def test_level_is_amplitude_over_the_median_of_the_surroundings(analysis):
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
    bare = analyze(tone_record(), load_gearbox("two-stage"))
    assert line_table(bare, "envelope").empty
    assert any("No envelope band" in note for note in summary(bare)["notes"])


def test_reference_differs_from_the_tachometer_shaft():
    gearbox = load_gearbox("two-stage").changed(reference="intermediate")
    record = tone_record()
    speed = group(analyze(record, gearbox), "speed")["speed_hz"].to_numpy()
    np.testing.assert_allclose(speed, SPEED_HZ * 23 / 67, rtol=1e-9)


def test_two_channels_stay_apart():
    rng = np.random.default_rng(1)
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    quiet = rng.normal(0, 0.1, time.size)
    loud = quiet + np.cos(2 * np.pi * 23 * SPEED_HZ * time)
    record = tone_record(channels={"a": Channel(values=loud, units="g"), "b": Channel(values=quiet, units="m s-2")})
    table = line_table(analyze(record, load_gearbox("two-stage")), "order_spectrum")
    mesh = table[(table["component"] == "stage 1") & (table["harmonic"] == 1) & (table["kind"] == "gear_mesh")]
    assert dict(zip(mesh["channel"], mesh["claimed"], strict=True)) == {"a": True, "b": False}
    assert dict(zip(mesh["channel"], mesh["units"], strict=True)) == {"a": "g", "b": "m s-2"}


def test_nan_in_the_signal():
    values = np.random.default_rng(0).normal(size=20000)
    values[[700, 900]] = np.nan
    record = tone_record(channels={"housing": Channel(values=values, units="g")})
    with pytest.raises(
        AnalysisError, match=r'channel "housing" has 2 samples that are not finite, the first at index 700'
    ):
        analyze(record, load_gearbox("two-stage"))


def test_a_channel_that_is_not_there():
    with pytest.raises(AnalysisError, match=r'no vibration channel "housin"; did you mean "housing"\?'):
        analyze(tone_record(), load_gearbox("two-stage"), settings=AnalysisSettings(channels=("housin",)))


def test_a_record_shorter_than_one_revolution():
    time = np.arange(200) / RATE_HZ
    pulses = PulseTimes(times_s=[0.0, 0.05], shaft="input", pulses_per_rev=1)
    record = tone_record(channels={"a": Channel(values=np.sin(time), units="g")}, angle=pulses)
    with pytest.raises(AnalysisError, match="holds no whole revolution of the shaft"):
        analyze(record, load_gearbox("two-stage"))


def test_pulses_that_run_backwards():
    pulses = PulseTimes(times_s=[0.0, 0.05, 0.04, 0.15], shaft="input", pulses_per_rev=1)
    with pytest.raises(RecordError, match="backwards"):
        tone_record(angle=pulses)


def test_a_missing_pulse_is_named():
    times = np.delete(np.arange(0.0, SECONDS, 1 / SPEED_HZ), 30)
    record = tone_record(angle=PulseTimes(times_s=times, shaft="input", pulses_per_rev=1))
    with pytest.raises(AnalysisError, match=r'tachometer "tachometer": a tachometer pulse is missing'):
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


@pytest.mark.parametrize("band", [(2000.0, 1000.0), (1000.0, 9000.0)])
def test_a_band_that_is_none(band):
    with pytest.raises(AnalysisError, match=r"band_hz = .* must rise and lie between 0 and 2500 Hz"):
        analyze(tone_record(), load_gearbox("two-stage"), settings=AnalysisSettings(envelope_band_hz=band))


def test_opening_what_is_no_analysis(tmp_path):
    write_tree(xr.DataTree(xr.Dataset({"a": ("x", np.zeros(3))})), tmp_path / "other.h5")
    with pytest.raises(AnalysisError, match="this is not an analysis"):
        open_analysis(tmp_path / "other.h5")
