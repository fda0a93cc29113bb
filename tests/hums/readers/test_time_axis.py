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


def test_channels_by_number(tmp_path):
    wavfile.write(tmp_path / "two.wav", 8000, np.tile(np.array([0.25, 0.5], dtype=np.float32), (1000, 1)))
    record = convert(tmp_path / "two.wav", channels=["2"], **DECLARED)
    assert float(record["channel 2"][0]) == 0.5
