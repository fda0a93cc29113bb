"""Mistakes of a new user: refused, or told, in a sentence that says what to do."""

import re
import sys

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import health_table, line_table, open_analysis, summary, verdict_table
from hums.analysis.settings import AnalysisError
from hums.cli import main
from hums.gearbox.model import load_gearbox
from hums.records.channels import speed_percentiles
from hums.records.fields import RecordError
from hums.records.record import NominalSpeed, PulseTimes, TachometerWaveform, UnknownAngle, make_record
from hums.records.store import save_record
from hums.records.validation import check_record
from hums.report.verdict_strip import answer

RATE_HZ, SPEED_HZ, SECONDS = 5000.0, 20.0, 4.0
TIME_S = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
TURNS_S = np.arange(0.0, SECONDS, 1 / SPEED_HZ)


def vibration(seed=0):
    return np.cos(2 * np.pi * 23 * SPEED_HZ * TIME_S) + np.random.default_rng(seed).normal(0, 0.1, TIME_S.size)


def two_meshes(*, noise=0.1):
    """A shaft and both of its meshes, which tell its speed."""
    orders = (1, 23, 46, 23 * 19 / 67, 2 * 23 * 19 / 67)
    tones = [np.cos(2 * np.pi * order * SPEED_HZ * TIME_S + order) for order in orders]
    return np.sum(tones, axis=0) + np.random.default_rng(0).normal(0, noise, TIME_S.size)


def record_of(times_s=TURNS_S, *, per_rev=1, channels=None, angle=None):
    pulses = PulseTimes(times_s=times_s, shaft="input", pulses_per_rev=per_rev)
    channels = channels or {"a": vibration()}
    return make_record(channels, units="g", rate_hz=RATE_HZ, angle=angle or pulses)


def analysed(record, **settings):
    return analyze(
        record, load_gearbox("two-stage"), settings=AnalysisSettings(most_tracks=0, pictures=False, **settings)
    )


def notes(record, **settings):
    return summary(analysed(record, **settings))["notes"]


# ---- tachometers -------------------------------------------------------------------------------------------


def test_a_fast_encoder_is_one():
    # 100 pulses a turn at 20 turns a second: 2.5 samples apart
    times_s = np.arange(0.0, SECONDS, 1 / (100 * SPEED_HZ))
    assert speed_percentiles(record_of(times_s, per_rev=100)["tachometer"])[0] == pytest.approx(SPEED_HZ, rel=1e-9)


@pytest.mark.parametrize(("samples", "refused"), [(3.9, True), (4.1, False)])
def test_a_shaft_faster_than_the_record_shows(samples, refused):
    times_s = np.arange(0.0, SECONDS, samples / RATE_HZ)
    if not refused:
        record_of(times_s)
        return
    with pytest.raises(RecordError, match=r"is 1282 rev/s, a revolution in 3\.9 samples at 5000 Hz"):
        record_of(times_s)


def test_a_vibration_channel_is_no_tachometer():
    angle = TachometerWaveform(values=vibration(), units="g", shaft="input", pulses_per_rev=1)
    with pytest.raises(RecordError, match=r'its waveform is identical to vibration channel "a".*--tach-waveform'):
        record_of(angle=angle)


@pytest.mark.parametrize("per_rev", [1, 3])
def test_pulses_without_order_are_no_tachometers(per_rev):
    # the intervals of random crossings are exponential, and so is |a - b| of two such: the medians are the same
    times_s = np.cumsum(np.random.default_rng(1).exponential(0.01, 400))
    with pytest.raises(RecordError, match="but irregular") as caught:
        record_of(times_s, per_rev=per_rev)
    percent = float(str(caught.value).partition("changes by ")[2].partition("%")[0])
    assert percent == pytest.approx(100, abs=20)  # the median of 400 scatters by 5 % or so


def test_uneven_stripes_missed_pulses_and_a_run_up_are_a_tachometers():
    turns = np.arange(0, 60, 0.5) + np.tile([0.0, -0.3], 60)  # two stripes, 0.2 and 0.8 of a turn apart
    times_s = np.sqrt(turns[1:] / 60) * SECONDS  # from rest
    kept = np.delete(times_s, np.arange(20, 110, 20))
    middle, low, high = speed_percentiles(record_of(kept, per_rev=2)["tachometer"])
    assert low < middle < high < 2 * 60 / SECONDS  # a run-up from rest ends at twice its mean


def test_a_start_from_rest_in_four_turns_is_a_tachometers():
    times_s = np.sqrt(np.arange(1, 200) / 200) * SECONDS  # 50 a turn: each turn is far shorter than the one before
    record_of(times_s, per_rev=50)


def test_turning_speeds_of_a_steady_shaft_and_of_less_than_a_turn():
    assert speed_percentiles(record_of()["tachometer"]) == pytest.approx((SPEED_HZ,) * 3, rel=1e-9)
    assert speed_percentiles(record_of(np.array([0.0, 1.0]), per_rev=4)["tachometer"]) is None


def test_the_command_info_prints_the_speed_found(tmp_path, monkeypatch, capsys):
    save_record(record_of(), tmp_path / "record.h5")
    monkeypatch.setattr(sys, "argv", ["hums", "info", str(tmp_path / "record.h5")])
    assert main() == 0
    assert "about 20 rev/s (98% of revolutions 20 to 20)" in capsys.readouterr().out


def test_an_old_record_with_such_pulses_is_refused_when_checked():
    record = record_of()
    bad = record.drop_vars("tachometer").assign(
        tachometer=("pulse_tachometer", TIME_S, record["tachometer"].attrs)  # as another program may write it
    )
    with pytest.raises(RecordError, match="about one pulse per sample"):
        check_record(bad)


# ---- gaps --------------------------------------------------------------------------------------------------


def with_gaps():
    values = vibration(1)
    values[[700, 701, 900]] = np.nan
    return values


def test_a_gap_costs_what_it_covers():
    analysis = analysed(record_of(channels={"gaps": with_gaps(), "sound": vibration()}))
    verdict = health_table(analysis).set_index("name")
    assert verdict["status"].to_dict() == {"gaps": "suspect", "sound": "ok", "tachometer": "ok"}
    words = "3 samples that are not finite in 2 gaps, the first at index 700 (0.14 s)"
    assert f"It drops out: it has {words}." in verdict.loc["gaps", "reasons"]
    assert verdict.loc["gaps", "missing"] == pytest.approx(3 / TIME_S.size)
    assert sum(f'Channel "gaps": {words}' in note for note in summary(analysis)["notes"]) == 1
    assert set(line_table(analysis, "order_spectrum")["channel"]) == {"gaps", "sound"}


def test_a_channel_with_gaps_does_not_hide_the_speed():
    record = record_of(channels={"gaps": with_gaps(), "sound": two_meshes()}, angle=UnknownAngle())
    analysis = analysed(record, speed_range_hz=(15.0, 25.0), max_acceleration_hz_s=0.5)
    assert summary(analysis)["speed_hz"]["estimated_from"] == "sound"


def test_where_no_segment_between_gaps_is_long_enough_the_way_on_is_named():
    holes = np.where(np.arange(TIME_S.size) % 50, vibration(), np.nan)
    with pytest.raises(AnalysisError, match=r"not finite in \d+ gaps, .* no segment between gaps .*--channel NAME"):
        analysed(record_of(channels={"a": holes}))


# ---- notes -------------------------------------------------------------------------------------------------


def test_an_estimated_angle_has_no_tachometer_to_blame():
    record = record_of(channels={"a": two_meshes(noise=5.0)}, angle=UnknownAngle())
    said = notes(record, speed_range_hz=(15.0, 25.0), max_acceleration_hz_s=0.5, max_order=110.0)
    assert any("The speed is estimated from the vibration" in note for note in said)
    assert any(note.startswith("The angle estimated from the vibration is uncertain by about") for note in said)
    assert not any("pulses" in note for note in said)


@pytest.mark.parametrize(
    ("angle", "known"),
    [(None, 'tachometer "tachometer"'), (NominalSpeed(rpm=60 * SPEED_HZ, shaft="input"), "a declared speed")],
)
def test_a_speed_range_that_is_not_needed_is_noted(angle, known):
    said = notes(record_of(angle=angle), speed_range_hz=(15.0, 25.0), max_acceleration_hz_s=1.0)
    assert any(note.startswith(f"The record has {known}") and "--speed-range" in note for note in said)


@pytest.mark.parametrize(("max_order", "noted"), [(5000.0, True), (50.0, False)])
def test_an_order_beyond_the_rate_is_noted(max_order, noted):
    said = [note for note in notes(record_of(), max_order=max_order) if "--max-order" in note]
    assert len(said) == noted
    assert all("not at the 5000 asked for" in note and "5000 Hz permits no higher order" in note for note in said)


def test_a_report_is_no_baseline(tmp_path):
    page = tmp_path / "report.html"
    page.write_text("<html></html>", encoding="utf-8")
    with pytest.raises(AnalysisError, match=r"give the analysis\.h5 that the earlier analysis"):
        open_analysis(page)
    with pytest.raises(ValueError, match="nowhere"):
        open_analysis(tmp_path / "nowhere.h5")


class TestImplausibleTachometer:
    @staticmethod
    def record(hz):
        noise = np.random.default_rng(0).standard_normal(20_000)
        pulses = PulseTimes(times_s=np.arange(0.001, 0.999, 1 / hz), shaft="input", pulses_per_rev=1)
        return make_record({"vib": noise}, rate_hz=20_000, units="g", angle=pulses)

    def test_59700_rpm_is_refused(self):
        with pytest.raises(AnalysisError, match=r'tachometer "tachometer" gives 995 rev/s \(59,700 rpm\).*750 rev/s'):
            analyze(self.record(995.0), load_gearbox("two-stage"))

    def test_a_speed_outside_the_declared_range_is_refused(self):
        settings = AnalysisSettings(speed_range_hz=(10, 30), max_acceleration_hz_s=5)
        with pytest.raises(AnalysisError, match=r"gives 40 rev/s .* outside the declared range, 10 to 30 rev/s"):
            analyze(self.record(40.0), load_gearbox("two-stage"), settings=settings)


def struck(impacts_hz, *, rate_hz=25_000.0, seconds=20.0, scatter=0.0, seed=3, gearbox=None):
    """The meshes of "two-stage" and its input shaft in noise, and impacts at a rate that scatters."""
    rng, ring_s = np.random.default_rng(seed), np.arange(200) / 25_000
    turned = 2 * np.pi * SPEED_HZ * np.arange(round(seconds * rate_hz)) / rate_hz
    values = np.sum([np.cos(order * turned + order) for order in (1, 23, 46, 23 * 19 / 67)], axis=0)
    values += rng.standard_normal(values.size)
    if impacts_hz:
        gaps = 1 + scatter * rng.standard_normal(round(0.97 * impacts_hz * seconds))
        places = np.bincount((np.cumsum(gaps) / impacts_hz * rate_hz).astype(int), minlength=values.size)
        ring = np.exp(-ring_s / 0.0016) * np.sin(2 * np.pi * 6000 * ring_s)
        values += 10 * np.convolve(places[: values.size], ring)[: values.size]
    pulses = PulseTimes(times_s=np.arange(0.0, seconds, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1)
    record = make_record({"a": values}, units="g", rate_hz=rate_hz, angle=pulses)
    return analyze(record, gearbox or load_gearbox("two-stage"), settings=AnalysisSettings(most_tracks=0))


@pytest.mark.parametrize("teeth", [61, 62])
def test_the_last_wheel_of_a_train_with_another_tooth_number_is_not_called_sound(teeth):
    analysis = struck(23 / 67 * 19 / teeth * SPEED_HZ)
    said = verdict_table(analysis).query("component == 'stage 2/output' and kind == 'tooth'").iloc[0]
    noted = [note for note in summary(analysis)["notes"] if "had 62 teeth in place of 61" in note]
    assert (said["verdict"] == "not judged", len(noted)) == (teeth != 61, int(teeth != 61))


@pytest.mark.parametrize("damaged", [False, True])
def test_a_bearing_declared_on_another_shaft_is_not_called_sound(damaged):
    """The outer race of "input bearing", struck as on the intermediate shaft, where the drawing has it not."""
    analysis = struck(3.555 * 23 / 67 * SPEED_HZ if damaged else 0.0, scatter=0.01)
    said = verdict_table(analysis).query("component == 'input bearing'").set_index("kind")
    assert (said["verdict"] == "nothing found").all() != damaged
    if damaged:
        assert set(said["verdict"]) == {"not judged"}
        assert "would be that of outer race on the shaft of order 0.3433" in said.loc["inner_race", "doubts"]


@pytest.mark.parametrize("elements", [-3, -1, 0, 1, 6])
def test_a_bearing_with_another_number_of_elements_is_not_called_sound(elements):
    """Its outer race is damaged: found with the right number, else a line of no component, which a note names."""
    gearbox = load_gearbox("two-stage")
    (bearing,) = (one for one in gearbox.bearings if "input bearing" in one.names)
    changed = bearing.model_copy(update={"elements": bearing.elements + elements})
    others = tuple(one for one in gearbox.bearings if one is not bearing)
    analysis = struck(
        3.555 * SPEED_HZ, scatter=0.005, gearbox=gearbox.model_copy(update={"bearings": (*others, changed)})
    )
    said = verdict_table(analysis).query("component == 'input bearing'").set_index("kind")["verdict"]
    if elements == -3:  # its inner race would be 2 % away: the bearing is named, with the wrong part
        assert said["inner_race"] == "indicated"
        return
    assert said["outer_race"] == ("not judged" if elements else "diagnosed")
    facts = summary(analysis)
    assert any("belongs to no component" in note for note in facts["notes"]) == bool(elements)
    assert any("belongs to no component" in said for _, said in answer(facts)) == bool(elements)


@pytest.mark.parametrize(("cut_hz", "judged"), [(3000.0, True), (500.0, False)])
def test_what_a_low_pass_filter_removes_is_not_called_inspected(cut_hz, judged):
    rate_hz, rng = 25_000.0, np.random.default_rng(2)
    pulses = PulseTimes(times_s=np.arange(0.0, 20.0, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1)
    sections = butter(8, cut_hz, fs=rate_hz, output="sos")
    values = sosfilt(sections, rng.standard_normal(500_000)) + 1e-4 * rng.standard_normal(500_000)
    turned = 2 * np.pi * SPEED_HZ * np.arange(500_000) / rate_hz
    values += np.sum([np.cos(order * turned + order) for order in (1, 23, 46, 23 * 19 / 67)], axis=0)
    record = make_record({"a": values}, units="g", rate_hz=rate_hz, angle=pulses)
    analysis = analyze(record, load_gearbox("two-stage"), settings=AnalysisSettings(most_tracks=0))
    assert any("low-pass filter" in note for note in summary(analysis)["notes"])
    races = verdict_table(analysis).query("kind == 'inner_race'")
    assert set(races["verdict"]) == {"nothing found" if judged else "not judged"}
    for said in races["evidence"]:
        inspected = re.search(r"between [\d.]+ and ([\d.]+) Hz", said)
        assert (inspected is not None) == judged
        assert inspected is None or float(inspected[1]) < 1.4 * cut_hz  # where the filter takes 20 dB
