"""The rate that a column of times states, and channels by number."""

import h5py
import numpy as np
import pytest
from scipy.io import wavfile

from hums.readers import convert
from hums.records.record import RecordError, sampling

DECLARED = {"units": "g", "shaft": "input", "shaft_rpm": 600}


def csv(tmp_path, times, header):
    path = tmp_path / "log.csv"
    np.savetxt(
        path, np.column_stack([times, np.ones(times.size)]), fmt="%.9g", delimiter=",", header=header, comments=""
    )
    return path


@pytest.mark.parametrize(("header", "unit"), [("time (s),vib", 1), ("Time [ms],vib", 1e3), ("t_us,vib", 1e6)])
def test_a_time_column_states_the_rate(tmp_path, header, unit):
    path = csv(tmp_path, unit * np.arange(2000) / 8000, header)
    assert sampling(convert(path, channels=["vib"], **DECLARED), "vib").rate_hz == 8000


@pytest.mark.parametrize("name", ["log.h5", "log.mat"])
def test_no_array_is_read_but_the_channel_and_its_times(tmp_path, name):
    with h5py.File(tmp_path / name, "w") as file:
        file["time (s)"] = np.arange(2000) / 8000
        file["vib"] = np.ones(2000)
        file.create_dataset("huge", shape=(10**12,), dtype="f8", chunks=(1024,))  # refused where it is read
    assert sampling(convert(tmp_path / name, channels=["vib"], **DECLARED), "vib").rate_hz == 8000


def test_a_missing_sample_is_refused(tmp_path):
    path = csv(tmp_path, np.delete(np.arange(2001), 1000) / 8000, "time (s),vib")
    with pytest.raises(RecordError, match="not evenly spaced"):
        convert(path, channels=["vib"], **DECLARED)


def test_times_without_a_unit_state_no_rate(tmp_path):
    path = csv(tmp_path, np.arange(2000) / 8000, "time,vib")
    with pytest.raises(RecordError, match="does not say the unit of its times"):
        convert(path, channels=["vib"], **DECLARED)
    assert sampling(convert(path, channels=["vib"], rate_hz=8000, **DECLARED), "vib").rate_hz == 8000


@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("ms", 1e3), ("us", 1e6)])
def test_a_declared_unit_of_times(tmp_path, unit, factor):
    path = csv(tmp_path, factor * np.arange(2000) / 8000, "time,vib")
    for rate in ({}, {"rate_hz": 8000}):  # found, or held against what is declared
        record = convert(path, channels=["vib"], time_unit=unit, **rate, **DECLARED)
        assert sampling(record, "vib").rate_hz == 8000
    with pytest.raises(RecordError, match="contradicts"):
        convert(path, channels=["vib"], time_unit="s" if unit != "s" else "ms", rate_hz=8000, **DECLARED)


def test_a_declared_unit_that_contradicts_the_header(tmp_path):
    path = csv(tmp_path, np.arange(2000) / 8, "Time [ms],vib")
    with pytest.raises(RecordError, match='whose header says "Time'):
        convert(path, channels=["vib"], time_unit="s", **DECLARED)


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


@pytest.mark.parametrize("title", ["Case (V)", "Case (A)", "Case (1)", "Case [left]"])  # vertical, axial, a number
def test_a_header_without_units(tmp_path, title):
    path = csv(tmp_path, np.arange(2000) / 8000, f"time (s),{title}")
    assert convert(path, channels=[title], units="g", **ANGLE)[title].attrs["units"] == "g"


def test_units_that_tell_columns_apart(tmp_path):
    path = csv(tmp_path, np.arange(2000) / 8000, "DE [g],DE [V]")
    assert convert(path, channels=["DE [V]"], rate_hz=8000, **ANGLE)["DE [V]"].attrs["units"] == "V"


def test_channels_by_number(tmp_path):
    wavfile.write(tmp_path / "two.wav", 8000, np.tile(np.array([0.25, 0.5], dtype=np.float32), (1000, 1)))
    record = convert(tmp_path / "two.wav", channels=["2"], **DECLARED)
    assert float(record["channel 2"][0]) == 0.5
