"""Import descriptions: what they refuse, what takes precedence, and how text files are read by them."""

from contextlib import nullcontext

import numpy as np
import pytest
from logger_files import COUNT, write_logger_table
from numpy.testing import assert_array_equal

import hums
from hums.readers import read_file
from hums.records.fields import RecordError, RecordWarning


def refusal(description, path="a.csv", **declared):
    with pytest.raises(RecordError) as caught:
        hums.convert(path, description, **declared)
    return str(caught.value)


def test_a_logger_with_twelve_lines_above_takes_one_try(tmp_path):
    told = tmp_path / "import.toml"
    told.write_text(
        'separator = ";"\ndecimal = ","\nencoding = "cp1252"\nheader_lines = 12\nchannels = ["DE", "ND"]\n'
        'time_zone = "Europe/Berlin"\nshaft_rpm = 1500.0\nshaft = "input"\n'
        'site = "hall 2"\nanalyst = "A. Meyer"\n[units]\nDE = "g"\nND = "mm/s"\n[measured]\n"Öl" = "°C"\n'
    )
    for name in ("one.csv", "two.csv"):  # of like files
        record = hums.convert(write_logger_table(tmp_path / name), told)
        assert_array_equal(record.DE, np.arange(COUNT) / 8)
        assert [record[one].attrs["units"] for one in ("DE", "ND", "Öl")] == ["g", "mm s-1", "degC"]
        assert record.attrs["rate_hz"] == 1000
        assert (record.attrs["site"], record.attrs["analyst"]) == ("hall 2", "A. Meyer")
        assert record.attrs["recorded_at"] == "2024-10-27T09:27:00Z"  # an hour after the clocks went back


def test_a_text_format_that_nothing_shows_is_declared(tmp_path):
    """Two lines of numbers are too few to recognise, and the header names columns by numbers."""
    (tmp_path / "a.csv").write_text("Gain|2|3\n1|2|3\nDE|ND|x\n1.485|1|a\n2.125|2|b\n")
    found = read_file(tmp_path / "a.csv", separator="|", header_lines=3, decimal=",")
    assert {name: found.fields[name].tolist() for name in ("DE", "ND")} == {"DE": [1485, 2125], "ND": [1, 2]}
    assert found.text_format == {"separator": "|", "decimal": ",", "encoding": "utf-8-sig", "header_lines": 3}
    with pytest.raises(RecordError, match="unknown encoding"):
        read_file(tmp_path / "a.csv", encoding="utf-9")


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"chanels": ["DE"]}, "did you mean \"channels\"? Its value is ['DE']; allowed keys: analyst, average, ch"),
        ({"channels": "DE"}, "channels = 'DE': give a list in brackets, as in [\"DE\"]"),
        ({"rate_hz": "fast"}, "rate_hz = 'fast': input should be a valid number"),
        ({"units": {"DE": 3}}, "units: {'DE': 3} is not a word"),
        ({"decimal": ";"}, "decimal = ';': input should be '.' or ','"),
        ({"time_zone": "Europe/Berln"}, "Did you mean 'Europe/Berlin'?"),
        ({"trust": "me"}, "trust = 'me': input should be 'declared' or 'file'"),
        ({"recorded_at": "yesterday"}, "recorded_at: 'yesterday' is not a date and time in ISO 8601"),
        (
            {"no_tachometer": True, "shaft_rpm": 100.0},
            "shaft_rpm and no_tachometer: the shaft angle has a single source",
        ),
        ({"units": ["g", "V"], "channels": ["DE"]}, "do not match the 1 channels"),
    ],
)
def test_what_is_refused_with_its_key(tmp_path, told, said):
    assert said in refusal(told)
    assert said in refusal(None, **told)  # keywords are the same keys
    assert f"{tmp_path}/none.toml: there is no such file" in refusal(tmp_path / "none.toml")


def test_keywords_take_precedence_and_what_the_file_states_is_compared(tmp_path):
    (tmp_path / "a.csv").write_text("DE (g),ND\n" + "".join(f"{k},{-k}\n" for k in range(100)))
    told = {"channels": ["DE", "ND"], "units": {"ND": "mm/s"}, "scale": {"ND": 2.0}, "rate_hz": 100.0}
    record = hums.convert(tmp_path / "a.csv", told, rate_hz=np.int64(200), no_tachometer=np.True_)
    assert_array_equal(record.ND, -2.0 * np.arange(100))
    assert (record.attrs["rate_hz"], record.DE.units, record.ND.units) == (200, "g", "mm s-1")
    text = refusal(told, tmp_path / "a.csv", units={"DE": "V", "ND": "g"}, no_tachometer=True)
    assert 'units="V" contradict a.csv, which states "g"' in text
    assert "(--trust)" in text
    assert "has no \"NDE\". Did you mean 'ND'" in refusal(told, tmp_path / "a.csv", units={"NDE": "g"})


def test_threshold_and_hysteresis_of_a_tachometer(tmp_path):
    """Pulses of 5 V with a bump of 2 V between them: at 1 V the bump is a pulse, too."""
    turn = np.r_[np.full(10, 5.0), np.zeros(40), np.full(10, 2.0), np.zeros(40)]
    np.savetxt(tmp_path / "a.csv", np.c_[np.arange(2000.0), np.tile(turn, 20)], delimiter=",", header="DE,tach")
    told = {"channels": ["# DE"], "units": "g", "rate_hz": 1000.0, "tach_waveform": "tach"}
    told |= {"pulses_per_rev": 1, "shaft": "input"}
    for threshold, pulses in ((3.5, 19), (1.0, 39)):
        record = hums.convert(tmp_path / "a.csv", told, threshold=threshold, hysteresis=0.5)
        assert record.tachometer.size == pulses
        assert (record.tachometer.attrs["threshold"], record.tachometer.attrs["hysteresis"]) == (threshold, 0.5)


def test_a_declared_time_column(tmp_path):
    (tmp_path / "a.csv").write_text("x,DE\n" + "".join(f"{k},{k}\n" for k in range(100)))
    told = {"channels": ["DE"], "units": "g", "no_tachometer": True, "time_column": "x"}
    assert "does not state the unit of its times" in refusal(told, tmp_path / "a.csv")
    assert hums.convert(tmp_path / "a.csv", told, time_unit="ms").attrs["rate_hz"] == 1000
    since = hums.convert(tmp_path / "a.csv", told | {"time_column": None}, rate_hz=1.0)
    assert since.attrs["recorded_at"] == ""
    (tmp_path / "a.csv").write_text("x,DE\n" + "".join(f"{1_700_000_000 + k},{k}\n" for k in range(100)))
    with pytest.warns(RecordWarning, match="1700000000 s, were taken to count from 1970"):
        record = hums.convert(tmp_path / "a.csv", told)
    assert record.attrs["recorded_at"] == "2023-11-14T22:13:20Z"  # date -u -d @1700000000


def test_a_date_that_may_be_in_two_months_is_not_guessed(tmp_path):
    for day, known in ((4, False), (14, True)):
        rows = "".join(f"03/{day:02d}/2024 12:00:00.{k:03d},{k}\n" for k in range(900))
        (tmp_path / "a.csv").write_text(f"time,DE (g)\n{rows}")
        with nullcontext() if known else pytest.warns(RecordWarning, match="ambiguous in day and month"):
            record = hums.convert(tmp_path / "a.csv", channels=["DE"], no_tachometer=True, time_zone="UTC")
        assert record.attrs["rate_hz"] == 1000
        assert record.attrs["recorded_at"] == ("2024-03-14T12:00:00Z" if known else "")
