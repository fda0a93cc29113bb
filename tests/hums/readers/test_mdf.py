"""MDF 4 files, written by asammdf and read back."""

from datetime import UTC, datetime

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import hums
from hums.records.fields import RecordError, RecordWarning

asammdf = pytest.importorskip("asammdf", reason='MDF files need asammdf: pip install ".[readers]"')

NOISE = np.random.default_rng(8).normal(size=1000)
TIMES_S = np.arange(1000) / 5000
NONE = {"no_tachometer": True}
ENCODINGS = {"S": "utf-8"}


def write(path, *groups):
    """Write groups of (name, samples, times, unit)."""
    with asammdf.MDF(version="4.10") as contents:
        contents.start_time = datetime(2024, 1, 2, 3, 4, 5, tzinfo=UTC)
        for group in groups:
            contents.append(
                [
                    asammdf.Signal(samples, times, unit=unit, name=name, encoding=ENCODINGS.get(samples.dtype.kind))
                    for name, samples, times, unit in group
                ]
            )
        contents.save(path, overwrite=True)
    return path


@pytest.fixture
def measured(tmp_path):
    vibration = [("DE", NOISE, TIMES_S, "m/s^2"), ("ND", 2 * NOISE, TIMES_S, "g"), ("x", NOISE, TIMES_S, "")]
    slow = [("oil", np.linspace(50, 60, 11), np.arange(11) / 50, "degC"), ("DE", np.ones(11), np.arange(11) / 50, "V")]
    status = [("status", np.array([b"on"] * 11), np.arange(11) / 50, "")]
    return write(tmp_path / "a.mf4", vibration, slow, status)


def test_channels_state_units_rate_and_the_start(measured):
    record = hums.convert(measured, channels=["1.DE", "ND"], measured={"oil": ""}, shaft_rpm=1500.0, shaft="input")
    assert_array_equal(record["1.DE"], NOISE)
    assert_array_equal(record.ND, 2 * NOISE)
    assert [record[name].attrs["units"] for name in ("1.DE", "ND", "oil")] == ["m s-2", "g", "degC"]
    assert record.attrs["rate_hz"] == 5000
    assert record.attrs["recorded_at"] == "2024-01-02T03:04:05Z"
    assert record.oil.size == 11


def test_what_it_does_not_state_and_what_contradicts_it(measured):
    with pytest.raises(RecordError, match="--units g"):
        hums.convert(measured, channels=["x"], **NONE)
    with pytest.raises(RecordError, match=r"rate_hz=5100 contradicts a\.mf4"):
        hums.convert(measured, channels=["ND"], rate_hz=5100, **NONE)
    with pytest.raises(RecordError, match='"status" is text'):
        hums.convert(measured, channels=["status"], **NONE)


def test_samples_that_the_times_leave_out_are_nan(tmp_path):
    times = TIMES_S + 20 / 5000 * (np.arange(1000) >= 500)
    path = write(tmp_path / "a.mf4", [("DE", NOISE, times, "g")])
    with pytest.warns(RecordWarning, match="skip 20 samples"):
        record = hums.convert(path, channels=["DE"], **NONE)
    assert_array_equal(record.DE, np.r_[NOISE[:500], np.full(20, np.nan), NOISE[500:]])
