"""Quantities measured with a record, and averages in angle."""

import numpy as np
import pytest

from hums.records.channels import sampling
from hums.records.fields import RecordError
from hums.records.quantities import AngularAverage, Measured, mean_quantities
from hums.records.record import Channel, NominalSpeed, make_record
from hums.records.store import open_record, save_record
from hums.records.validation import check_record

SPEED = NominalSpeed(rpm=1500, shaft="input")


def build(**measured):
    return make_record({"vib": np.ones(1000)}, rate_hz=1000, angle=SPEED, units="g", measured=measured)


@pytest.mark.parametrize(
    ("value", "units", "held", "unit"),
    [
        (1500, "rpm", 25, "rev s-1"),
        (4.2, "kN", 4200, "N"),
        (60, "degC", 60, "degC"),
        (3, "bar", 3e5, "Pa"),
        (5, "%", 0.05, "1"),
    ],
)
def test_units_become_si(value, units, held, unit):
    record = build(x=Measured(values=value, units=units))
    assert float(record.x) == pytest.approx(held)
    assert record.x.attrs == {"units": unit, "role": "measured"}


def test_samples_at_the_rate_or_at_one_of_their_own(tmp_path):
    slow = Measured(values=[50.0, np.nan, 70.0], units="degC", rate_hz=3)
    record = build(torque=Measured(values=np.arange(1000.0), units="Nm"), oil=slow)
    assert record.torque.dims == ("time",)
    assert record.oil.dims == ("time_oil",)
    assert float(record.time_oil[2]) == pytest.approx(2 / 3)
    assert mean_quantities(record) == {"torque": (499.5, "N m"), "oil": (60.0, "degC")}
    save_record(record, tmp_path / "r.h5")
    with open_record(tmp_path / "r.h5") as opened:
        assert opened.load().identical(record)


@pytest.mark.parametrize(
    ("measured", "said"),
    [
        ({"x": Measured(values=1, units="furlong")}, "furlong"),
        ({"x": 3.0}, "use Measured"),
        ({"vib": Measured(values=1, units="N")}, 'named "vib"'),
        ({"x": Measured(values=np.ones(10), units="N")}, '"x" has 10, the others 1000 samples'),
        ({"x": Measured(values="warm", units="degC")}, "give a real array"),
    ],
)
def test_what_is_refused(measured, said):
    with pytest.raises(RecordError, match=said):
        build(**measured)


# ---- averages in angle -------------------------------------------------------------------------------------


def average(values=None, *, per_rev=128, **changes):
    arguments = {"angle": AngularAverage(component="planet 1", samples_per_rev=per_rev, averaged_over=50), "units": "1"}
    return make_record({"vib": np.ones(256) if values is None else values}, **(arguments | changes))


def test_an_average_lies_over_revolutions(tmp_path):
    record = average(measured={"torque": Measured(values=3, units="N m")}, recorded_at="2020-01-01T00:00:00Z")
    assert record.vib.dims == ("angle",)
    assert float(record.angle[-1]) == pytest.approx(2 - 1 / 128)
    assert {"average_of": "planet 1", "samples_per_rev": 128, "averaged_over": 50}.items() <= record.attrs.items()
    assert sampling(record, "vib").rate_hz == 128
    save_record(record, tmp_path / "a.h5")
    with open_record(tmp_path / "a.h5") as opened:
        assert opened.load().identical(record)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rate_hz": 1000}, "no sampling rate"),
        ({"values": np.ones(200)}, "1.5625 revolutions"),
        (
            {"values": Channel(values=np.ones(128), units="g", rate_hz=5), "units": None},
            "no rate_hz of a channel; omit it",
        ),
        ({"measured": {"x": Measured(values=np.ones(256), units="N")}}, "give one number"),
        ({"units": None}, "no units"),
        ({"angle": AngularAverage(component="", samples_per_rev=128)}, "name the link"),
        ({"angle": AngularAverage(component="a", samples_per_rev=4)}, "at least 8"),
        ({"angle": AngularAverage(component="a", samples_per_rev=12.5)}, "whole number"),
        ({"angle": AngularAverage(component="a", samples_per_rev=64, averaged_over=0)}, "averaged_over=0"),
    ],
)
def test_averages_that_are_refused(changes, said):
    with pytest.raises(RecordError, match=said):
        average(**changes)


def test_an_average_has_no_speed():
    with pytest.raises(RecordError, match="no tachometer and no speed"):
        check_record(average().assign(nominal_speed=build().nominal_speed))
