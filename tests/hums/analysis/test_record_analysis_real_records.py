"""Lines of real records, and what hard ones may not be called; which parts are named, the scoreboard counts."""

import numpy as np
import pytest

from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import findings_table, group, health_table, line_table, summary, verdict_table
from hums.gearbox.model import GearboxWarning, load_gearbox
from hums.readers import convert
from hums.report import render
from signals.angle.averaging import synchronous_average
from signals.demodulation.envelope import envelope
from signals.resampling.resampling import angular_resample
from signals.shaft.tachometer import shaft_phase
from signals.spectra.spectra import amplitude_spectrum

TURBINE = {
    "0311": "data-20130311T030024Z.mat",
    "0326": "data-20130326T014150Z.mat",
    "0420": "data-20130420T151307Z.mat",
    "0425": "data-20130425T232202Z.mat",
}
RATE_HZ = 97656
CHOOSING = AnalysisSettings(most_tracks=0, pictures=False)
TURBINE_SETTINGS = CHOOSING.changed(envelope_band_hz=(9000.0, 11000.0))
RIG_SETTINGS = CHOOSING.changed(envelope_band_hz=(2000.0, 4000.0))
CWRU = {
    "IR007_0": ("X105_DE_time", 12000, 1797),
    "B007_0": ("X118_DE_time", 12000, 1796),
    "normal_0": ("X097_DE_time", 48000, 1796),
}


@pytest.fixture(scope="module")
def data(request):
    return request.path.parents[2] / "data"


@pytest.fixture(scope="module")
def turbine(data):
    with pytest.warns(GearboxWarning, match=r"9\.46 \+ outer 6\.72 = 16\.18"):
        return load_gearbox(data / "wind-turbine.toml")


def turbine_record(real_data, day):
    return convert(
        real_data / "wt_hss_bearing" / TURBINE[day],
        channels=["vibration"],
        rate_hz=RATE_HZ,
        units="g",
        tach_times="tach",
        pulses_per_rev=2,
        shaft="high speed shaft",
    )


@pytest.fixture(scope="module")
def turbine_analyses(real_data, turbine):
    return {day: analyze(turbine_record(real_data, day), turbine, settings=TURBINE_SETTINGS) for day in TURBINE}


def fundamental(analysis, component, kind):
    table = line_table(analysis, "envelope")
    chosen = (table["component"] == component) & (table["kind"] == kind)
    return table[chosen & (table["harmonic"] == 1) & (table["sideband"] == 0)].iloc[0]


def test_turbine_speed(turbine_analyses):
    speed = summary(turbine_analyses["0425"])["speed_hz"]
    assert abs(speed["min"] - 31.08) < 0.02
    assert abs(speed["max"] - 31.47) < 0.02
    assert group(turbine_analyses["0425"], "speed")["speed_hz"].size == 93


def test_turbine_inner_race_line(turbine_analyses):
    line = fundamental(turbine_analyses["0425"], "high speed bearing", "inner_race")
    assert abs(line["order_found"] - 9.366) < 0.02
    assert line["amplitude"] == pytest.approx(0.76, rel=0.07)


def test_order_tracking_raises_the_line_over_the_plain_spectrum(real_data):
    record = turbine_record(real_data, "0425")
    phase = shaft_phase(record["tachometer"].to_numpy(), pulses_per_rev=2)
    start, stop = phase.times_at(np.array([0.0, 93.0]))
    demodulated = envelope(record["vibration"].to_numpy(), rate_hz=RATE_HZ, band_hz=(9000, 11000))
    part = demodulated[int(np.ceil(start * RATE_HZ)) : int(stop * RATE_HZ)]
    spectrum = amplitude_spectrum(part, rate=RATE_HZ)
    near = np.abs(spectrum.axis - 9.366 * 31.25) < 0.02 * 9.366 * 31.25
    assert spectrum.amplitude[near].max() == pytest.approx(0.435, rel=0.07)


def test_turbine_sidebands_one_order_away(turbine_analyses):
    table = line_table(turbine_analyses["0425"], "envelope")
    sides = table[(table["kind"] == "inner_race") & (table["sideband"] != 0)]
    assert set(sides["sideband"]) == {-1, 1}
    assert sides["claimed"].all()


def test_turbine_synchronous_amplitudes(real_data):
    record = turbine_record(real_data, "0425")
    phase = shaft_phase(record["tachometer"].to_numpy(), pulses_per_rev=2)
    signal = angular_resample(record["vibration"].to_numpy(), rate_hz=RATE_HZ, phase=phase, samples_per_rev=256)
    assert signal.revolutions == 93
    amplitude = np.abs(synchronous_average(signal).complex_amplitude)
    np.testing.assert_allclose(amplitude[[20, 40, 60]], [0.182, 0.219, 0.347], rtol=0.05)


def test_turbine_line_grows_over_the_records(turbine_analyses):
    amplitude = [fundamental(turbine_analyses[day], "high speed bearing", "inner_race")["amplitude"] for day in TURBINE]
    np.testing.assert_allclose(amplitude, [0.095, 0.22, 0.44, 0.76], rtol=0.10)


def test_turbine_early_record_says_what_can_and_cannot_be_said(turbine_analyses):
    analysis = turbine_analyses["0311"]
    found = findings_table(analysis)
    assert "diagnosed" not in set(found["verdict"])
    page = render(analysis)
    assert found.empty or "sound bearings have races and elements that are not perfect, too" in page
    line = fundamental(analysis, "high speed bearing", "inner_race")
    assert 3.5 < line["snr"] < 5.5


def rig_record(real_data, name):
    channel, rate, rpm = CWRU[name]
    return convert(
        real_data / "cwru" / f"{name}.mat",
        channels=[channel],
        rate_hz=rate,
        units="g",
        shaft_rpm=rpm,
        shaft="motor shaft",
    )


def test_the_error_of_an_estimated_steady_speed_makes_no_line_one_of_the_clock(real_data, data):
    path = real_data / "cwru" / "OR007@6_0.mat"
    record = convert(path, channels=["X130_DE_time"], rate_hz=12000, units="g", no_tachometer=True)
    settings = CHOOSING.changed(speed_range_hz=(20.0, 40.0), max_acceleration_hz_s=1.5)
    found = findings_table(analyze(record, load_gearbox(data / "cwru-rig.toml"), settings=settings))
    assert found.iloc[0][["kind", "verdict"]].tolist() == ["outer_race", "diagnosed"]


@pytest.fixture(scope="module")
def rig_analyses(real_data, data):
    gearbox = load_gearbox(data / "cwru-rig.toml")
    return {name: analyze(rig_record(real_data, name), gearbox, settings=RIG_SETTINGS) for name in CWRU}


def test_rig_line_at_twelve_times_the_cage_is_not_a_ball(rig_analyses):
    line = fundamental(rig_analyses["IR007_0"], "drive end bearing", "rolling_element")
    assert line["order_found"] == pytest.approx(4.798, abs=0.005)
    assert not line["claimed"]
    assert line["explained_by"]


def test_rig_healthy_names_nothing(rig_analyses):
    assert findings_table(rig_analyses["normal_0"]).empty
    table = line_table(rig_analyses["normal_0"], "envelope")
    assert not table[table["kind"] != "shaft"]["claimed"].any()


def test_rig_weak_race_lines_of_the_ball_record_are_not_certain(rig_analyses):
    # a damaged ball strikes both races: their lines are there, and neither is at fault
    table = verdict_table(rig_analyses["B007_0"]).set_index("kind")
    races = table.loc[["inner_race", "outer_race"]]
    assert set(races["verdict"]) <= {"indicated", "not judged"}
    assert races["doubts"].str.len().min() > 0
    assert races["order_found"].tolist() == pytest.approx([5.40, 3.60], abs=0.01)


def test_rig_ball_record_is_not_an_outer_race_in_a_band_of_its_own_choice(real_data, data):
    # the outer race's line leads there, but that of the inner race is of similar size, as damage of a ball makes both
    analysis = analyze(rig_record(real_data, "B007_0"), load_gearbox(data / "cwru-rig.toml"), settings=CHOOSING)
    assert findings_table(analysis).empty
    outer = verdict_table(analysis).set_index("kind").loc["outer_race"]
    assert outer["verdict"] == "not judged"
    assert "the line of the inner race is of similar size" in outer["evidence"]


def test_nominal_speed_is_marked(rig_analyses):
    facts = summary(rig_analyses["IR007_0"])
    assert facts["speed_hz"]["nominal"]
    assert "(nominal)" in render(rig_analyses["IR007_0"])


def test_no_sensor_of_the_real_records_is_sick(turbine_analyses, rig_analyses):
    for analysis in (*turbine_analyses.values(), *rig_analyses.values()):
        assert set(health_table(analysis)["status"]) <= {"ok", "suspect"}
