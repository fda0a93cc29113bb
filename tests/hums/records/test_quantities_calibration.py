"""Calibration: what is declared is applied once, exactly, and noted."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import hums
from hums.records.fields import RecordError
from hums.records.record import Channel, NominalSpeed, make_record
from hums.records.store import open_record, save_record

RATE_HZ = 1000.0
VOLTS = np.random.default_rng(4).normal(size=500)
NOMINAL = NominalSpeed(rpm=1500, shaft="input")


def build(start_s=0.5, **channels):
    return make_record(channels, rate_hz=RATE_HZ, angle=NOMINAL, start_s=start_s)


@pytest.fixture
def record():
    return build(
        front=Channel(values=VOLTS, units="V", sensor="A1", sensitivity=0.1, measures="m/s^2", calibration_factor=1.02),
        rear=Channel(values=VOLTS.astype(np.float32), units="mV", sensitivity=-100, measures="g", delay_s=0.002),
        plain=Channel(values=VOLTS, units="g"),
    )


def test_values_and_units(record):
    found = hums.calibrated(record)
    assert_allclose(found["front"], VOLTS / 0.1 * 1.02, rtol=1e-14)
    assert_allclose(found["rear"], VOLTS / -100, rtol=1e-6)  # single precision stays
    assert found["rear"].dtype == np.float32
    assert_array_equal(found["plain"], VOLTS)
    assert [found[name].attrs["units"] for name in ("front", "rear", "plain")] == ["m s-2", "g", "g"]
    assert list(found.data_vars) == list(record.data_vars)


def test_what_was_applied_is_noted(record):
    attrs = hums.calibrated(record)["front"].attrs
    assert attrs == {
        "units": "m s-2",
        "role": "vibration",
        "sensor": "A1",
        "applied_sensitivity": 0.1,
        "applied_calibration_factor": 1.02,
        "applied_to_units": "V",
    }


def test_a_tone_that_came_late_is_on_the_clock_again():
    times_s = np.arange(500) / RATE_HZ
    late = np.sin(2 * np.pi * 30 * (times_s - 0.0037))
    found = hums.calibrated(build(start_s=0.0, a=Channel(values=late, units="g", delay_s=0.0037)))
    assert_allclose(found["a"], np.sin(2 * np.pi * 30 * found["time_a"]), atol=1e-12)


def test_twice_is_refused(record, tmp_path):
    found = hums.calibrated(record)
    with pytest.raises(RecordError, match='channel "front" is already calibrated'):
        hums.calibrated(found)
    with pytest.raises(RecordError, match="nothing to calibrate"):
        hums.calibrated(record[["plain"]].assign(nominal_speed=record.nominal_speed))
    save_record(found, tmp_path / "record.h5")
    with open_record(tmp_path / "record.h5") as opened:
        assert opened.load().identical(found)
        with pytest.raises(RecordError, match="is already calibrated"):
            hums.calibrated(opened)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sensitivity": 0.1}, "sensitivity=0.1 and measures=None belong together"),
        ({"measures": "g"}, "sensitivity=None and measures='g' belong together"),
        ({"sensitivity": 0, "measures": "g"}, "sensitivity=0: a finite number other than zero"),
        ({"sensitivity": 0.1, "measures": "ge"}, "measures: units='ge' are not known"),
        ({"calibration_factor": 0.0}, "calibration_factor=0: a finite number other than zero"),
        ({"delay_s": np.inf}, "delay_s=inf: a finite number of seconds"),
    ],
)
def test_what_is_declared_wrongly(changes, sentence):
    with pytest.raises(RecordError) as caught:
        build(a=Channel(values=VOLTS, units="V", **changes))
    assert f'channel "a": {sentence}' in str(caught.value)
