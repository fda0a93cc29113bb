"""The rate that a column of times states, and channels by number."""

from contextlib import nullcontext
from datetime import UTC, datetime, timedelta

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from hums.readers import convert
from hums.records.channels import sampling
from hums.records.fields import RecordError, RecordWarning

DECLARED = {"units": "g", "shaft": "input", "shaft_rpm": 600}


def csv(tmp_path, times, header):
    path = tmp_path / "log.csv"
    np.savetxt(
        path, np.column_stack([times, np.ones(times.size)]), fmt="%.9g", delimiter=",", header=header, comments=""
    )
    return path


def at_gap(jump_s, count=3000):
    return np.arange(count) / 1000 + jump_s * (np.arange(count) >= count // 2)


@pytest.mark.parametrize(
    ("name", "rate", "missing"),
    [("log.csv", {"rate_hz": 1000}, 1), *((f"log.{kind}", {}, 20) for kind in ("csv", "mat", "h5", "npz"))],
)
def test_samples_that_the_times_leave_out_are_nan(tmp_path, name, rate, missing):
    path = table(tmp_path / name, at_gap(missing / 1000))
    with pytest.warns(RecordWarning, match=f"skip {missing} samples"):
        record = convert(path, channels=["vib"], measured={"force": "kN"}, **rate, **DECLARED)
    expected = np.r_[np.arange(1500.0), np.full(missing, np.nan), np.arange(1500.0, 3000.0)]
    np.testing.assert_array_equal(record.vib, expected)
    np.testing.assert_allclose(record.force, 1000 * expected)
    assert record.attrs["rate_hz"] == 1000


@pytest.mark.parametrize("name", ["log.csv", "log.h5"])
@pytest.mark.parametrize(
    ("times_s", "why"),
    [
        (at_gap(5), "skip 5000 samples, more than the 3000"),
        (at_gap(-0.8), "run backwards: row 1501"),
        (np.arange(3000) / 1000 * (1 + 1e-3 * np.linspace(0, 1, 3000)), "not evenly spaced"),  # a clock that drifts
    ],
)
def test_times_that_are_no_record(tmp_path, name, times_s, why):
    path = table(tmp_path / name, times_s)
    for rate in ({}, {"rate_hz": 1000}):
        with pytest.raises(RecordError, match=why):
            convert(path, channels=["vib"], **rate, **DECLARED)
    with pytest.warns(RecordWarning, match="the declared rate was trusted"):
        record = convert(path, channels=["vib"], rate_hz=1000, trust="declared", **DECLARED)
    assert record.sizes["time"] == 3000
    assert why.split(":")[0] in record.attrs["notes"]


def table(path, times_s):
    """Write times, vibration and a force by the suffix of a path."""
    columns = {"time_s": times_s, "vib": np.arange(float(times_s.size)), "force": np.arange(float(times_s.size))}
    match path.suffix:
        case ".csv":
            text = "".join(f"{t:.9g},{vib},{force}\n" for t, vib, force in zip(*columns.values(), strict=True))
            path.write_text(",".join(columns) + "\n" + text)
        case ".mat":
            savemat(path, columns)
        case ".npz":
            np.savez(path, **columns)
        case ".h5":
            with h5py.File(path, "w") as file:
                for name, values in columns.items():
                    file[name] = values
    return path


@pytest.mark.parametrize(("trust", "rate_hz"), [("declared", 1000.0), ("file", 1008.0)])
def test_a_contradiction_is_refused_or_decided(tmp_path, trust, rate_hz):
    path = table(tmp_path / "log.npz", np.arange(3000) / 1008)
    with pytest.raises(RecordError, match=r"rate_hz=1000 contradicts log\.npz.* 1008 Hz.*--trust"):
        convert(path, channels=["vib"], rate_hz=1000, **DECLARED)
    with pytest.warns(RecordWarning, match="was trusted"):
        record = convert(path, channels=["vib"], rate_hz=1000, trust=trust, **DECLARED)
    assert record.attrs["rate_hz"] == pytest.approx(rate_hz, rel=1e-9)
    assert "rate_hz=1000 contradicts log.npz" in record.attrs["notes"]


@pytest.mark.parametrize(
    "stamp", ["%Y-%m-%dT%H:%M:%S.%f%z", "%Y-%m-%d %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %I:%M:%S.%f %p"]
)
def test_times_as_text_need_no_unit(tmp_path, stamp):
    began = datetime(2026, 2, 28, 10, 59, 59, 500_000, tzinfo=UTC)
    rows = [f"{began + timedelta(milliseconds=k):{stamp}},{k}\n" for k in range(3000)]
    (tmp_path / "log.csv").write_text("time,vib\n" + "".join(rows))
    record = convert(tmp_path / "log.csv", channels=["vib"], time_zone="UTC", **DECLARED)
    assert (record.attrs["rate_hz"], record.attrs["start_s"]) == (1000, 0)
    assert record.attrs["recorded_at"] == "2026-02-28T10:59:59.500000Z"
    with pytest.raises(RecordError, match='time_unit="ms" contradicts'):
        convert(tmp_path / "log.csv", channels=["vib"], time_unit="ms", **DECLARED)


@pytest.mark.parametrize(("at", "damaged"), [(5, "2026-02-28 11:00:0x"), (40, "2026-02-31 11:00:01"), (40, "OVLD")])
def test_a_damaged_time_stamp_is_named_with_its_line(tmp_path, damaged, at):
    stamps = [f"2026-02-28 11:00:{k:02d}" for k in range(50)]
    stamps[at] = damaged
    rows = "\n".join(f"{stamp};{k}" for k, stamp in enumerate(stamps))
    (tmp_path / "log.csv").write_text(f"Logger;A\nRun;7\ntime;vib\n\n{rows}\n")
    with pytest.raises(RecordError, match=f'"time" is text, .*"{damaged}" in line {5 + at}, not numbers'):
        convert(tmp_path / "log.csv", channels=["vib"], time_column="time", **DECLARED)


def test_dates_to_the_second_beside_times_to_the_millisecond(tmp_path):
    rows = [f"2026-02-28T11:00:{k // 1000:02d}+01:00,{5 + k / 1000:.3f},{k}\n" for k in range(10_000)]
    (tmp_path / "log.csv").write_text("Date,time (s),vib\n" + "".join(rows))
    record = convert(tmp_path / "log.csv", channels=["vib"], **DECLARED)
    assert (record.attrs["rate_hz"], record.attrs["start_s"]) == (1000, 5)
    assert record.attrs["recorded_at"] == "2026-02-28T09:59:55Z"  # from which the times count


def test_one_time_for_many_samples(tmp_path):
    """Times rounded to a second are no gaps, and state the rate to the second in thirty: too little for a spectrum."""
    (tmp_path / "log.csv").write_text("time (s),vib\n" + "".join(f"{k // 100},{k}\n" for k in range(3000)))
    with pytest.raises(RecordError, match=r'"time \(s\)" is rounded to a rate between 9\d\.\d+ and 10\d\.\d+ Hz only'):
        convert(tmp_path / "log.csv", channels=["vib"], **DECLARED)
    assert convert(tmp_path / "log.csv", channels=["vib"], rate_hz=100, **DECLARED).vib.notnull().all()
    with pytest.raises(RecordError, match="contradicts"):
        convert(tmp_path / "log.csv", channels=["vib"], rate_hz=110, **DECLARED)


def test_pulse_times_are_in_the_unit_that_the_file_states(tmp_path):
    columns = {"time (s)": np.arange(2000) / 1000, "vib": np.ones(2000), "pulse (ms)": 100.0 * np.arange(20)}
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, values in columns.items():
            file[name] = values
    tach = {"tach_times": "pulse (ms)", "pulses_per_rev": 1, "shaft": "input"}
    record = convert(tmp_path / "log.h5", channels=["vib"], units="g", **tach)
    np.testing.assert_allclose(record.tachometer, 0.1 * np.arange(20))


def test_times_without_a_unit_state_no_rate(tmp_path):
    path = csv(tmp_path, np.arange(2000) / 8000, "time,vib")
    with pytest.raises(RecordError, match="does not state the unit of its times"):
        convert(path, channels=["vib"], **DECLARED)
    assert sampling(convert(path, channels=["vib"], rate_hz=8000, **DECLARED), "vib").rate_hz == 8000


ANGLE = {"shaft": "input", "shaft_rpm": 600}


@pytest.mark.parametrize(
    ("title", "name", "units"),
    [
        ("DE [m/s²]", "DE", "m s-2"),
        ("DE (g)", "DE", "g"),
        ("Speed DE (mm/s)", "Speed DE", "mm s-1"),
        ("Motor [A]", "Motor", "A"),
    ],
)
def test_a_header_states_units(tmp_path, title, name, units):
    path = csv(tmp_path, np.arange(2000) / 8000, f"time (s),{title}")
    for asked in (name, title):
        record = convert(path, channels=[asked], **ANGLE)
        assert record[name].attrs["units"] == units
    with pytest.raises(RecordError, match="contradict"):
        convert(path, channels=[name], units="Pa", **ANGLE)


def test_a_name_with_slashes_and_times_in_another_struct(tmp_path):
    path = csv(tmp_path, np.arange(2000) / 8000, "time (s),DE [in/s^2]")
    record = convert(path, channels=["DE [in/s^2]"], units="m s-2", scale={"DE [in/s^2]": 0.0254}, **ANGLE)
    np.testing.assert_array_equal(record["DE [in.s^2]"], 0.0254)
    savemat(tmp_path / "log.mat", {"X": {"Data": np.arange(2000) / 8000}, "Y": {"Data": np.ones(2000)}})
    declared = {"units": "g", "time_column": "X.Data", "time_unit": "s"} | ANGLE
    assert convert(tmp_path / "log.mat", channels=["Y.Data"], **declared).attrs["rate_hz"] == 8000


def test_columns_of_times_with_two_rates_are_refused(tmp_path):
    for first, second in (("t1 [s]", "t2 [s]"), ("time DE [s]", "time NDE [s]"), ("time [s]", "time [s]")):
        rows = "".join(f"{k / 1000};{k};{k / 500};{k}\n" for k in range(900))
        (tmp_path / "log.csv").write_text(f"{first};DE;{second};NDE\n{rows}")
        for name in ("DE", "NDE"):
            with pytest.raises(RecordError, match=r"states (500|1000) Hz, but .* goes in steps of 0\.00[12] s"):
                convert(tmp_path / "log.csv", channels=[name], **DECLARED)


@pytest.mark.parametrize("footer", ["Max,9.5", ",Max,9.5", "RMS,0.7,0.8"])
def test_rows_of_statistics_are_no_samples(tmp_path, footer):
    rows = "".join(f"{k / 1000},{k},{k}\n" for k in range(900))
    footer = footer + "," * (2 - footer.count(","))
    (tmp_path / "log.csv").write_text(f"time (s),DE,ND\n{rows}{footer}\n")
    for rate in ({}, {"rate_hz": 1000}):
        with pytest.raises(RecordError, match=r'is text, "(Max|RMS)" in line 902, not numbers'):
            convert(tmp_path / "log.csv", channels=["DE"], **rate, **DECLARED)


@pytest.mark.parametrize(("title", "factor"), [("time [s]", 1), ("timestamp", 1e3), ("Timestamp (us)", 1e6)])
def test_times_since_1970_state_when_a_record_began(tmp_path, title, factor):
    rows = "".join(f"{factor * (1_700_000_000 + k / 1000):.3f},{k}\n" for k in range(900))
    (tmp_path / "log.csv").write_text(f"{title},vib\n{rows}")
    with pytest.warns(RecordWarning, match="count from 1970"):
        record = convert(tmp_path / "log.csv", channels=["vib"], **DECLARED)
    assert record.attrs["rate_hz"] == pytest.approx(1000, rel=1e-6)
    assert record.attrs["recorded_at"] == "2023-11-14T22:13:20Z"  # date -u -d @1700000000
    with pytest.raises(RecordError, match=r"recorded_at=2024-01-01T00:00:00.* contradicts"):
        convert(tmp_path / "log.csv", channels=["vib"], recorded_at="2024-01-01T00:00:00Z", **DECLARED)


@pytest.mark.parametrize(
    ("attributes", "rate_hz", "recorded_at", "said"),
    [
        ({"sampling_frequency": 25.6, "sampling_frequency_units": "kHz"}, 25600, "", None),
        ({"acq_freq_kSps": 16.384, "t_begin_utc": "2022-01-02T03:04:05"}, 16384, "2022-01-02T03:04:05Z", None),
        ({"Sample rate": "10 kS/s", "Date": "2016-1-5", "Time": "11:12:13"}, 10000, "2016-01-05T11:12:13Z", None),
        ({"fs": 25.6, "fs_unit": "kilo", "Date": "03/04/2024"}, None, "", "fs=25.6, which is not applied"),
    ],
)
def test_what_attributes_state_is_read_with_its_unit_or_named(tmp_path, attributes, rate_hz, recorded_at, said):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["vib"] = np.ones(2000)
        file["vib"].attrs.update(attributes)
    declared = DECLARED | {"time_zone": "UTC", "rate_hz": None if rate_hz else 25600}
    with pytest.warns(RecordWarning, match=said) if said else nullcontext():
        record = convert(tmp_path / "log.h5", channels=["vib"], **declared)
    assert (record.attrs["rate_hz"], record.attrs["recorded_at"]) == (rate_hz or 25600, recorded_at)
