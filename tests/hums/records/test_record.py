"""Records: what the constructor builds, what survives slicing, and the sentence for every refusal."""

import sys
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from xarray.indexes import RangeIndex

from hums.records.record import (
    UNITS,
    Channel,
    NominalSpeed,
    PulseTimes,
    RecordError,
    TachometerWaveform,
    UnknownAngle,
    attach_time,
    channel_values,
    check_record,
    detach_time,
    make_record,
    nominal_speed,
    sampling,
    tachometers,
    vibration_channels,
)

RATE_HZ = 1000.0
NOISE = np.random.default_rng(7).normal(size=2000)
PULSES = PulseTimes(times_s=np.arange(0.05, 2, 0.1), shaft="input", pulses_per_rev=2)
NOMINAL = NominalSpeed(rpm=1500, shaft="input")
SLOW = NominalSpeed(rpm=6, shaft="output")


def build(channels=None, **changes):
    arguments = {"rate_hz": RATE_HZ, "units": "g", "angle": PULSES} | changes
    return make_record({"case": NOISE} if channels is None else channels, **arguments)


def refusal(channels=None, **changes):
    with pytest.raises(RecordError) as caught:
        build(channels, **changes)
    return str(caught.value)


# ---- what is built -----------------------------------------------------------------------------------------


def test_a_record_of_pulse_times():
    record = build(
        {"case": Channel(values=NOISE, units="m/s^2", sensor="A1", direction=(0, 0, 1))},
        units=None,
        machine="turbine 4",
        recorded_at="2013-03-11T03:00:24Z",
        start_s=0.25,
        attrs={"site": "north"},
    )
    assert record.attrs == {
        "schema": "hums-record/2",
        "machine": "turbine 4",
        "recorded_at": "2013-03-11T03:00:24Z",
        "rate_hz": 1000.0,
        "start_s": 0.25,
        "site": "north",
    }
    assert record["case"].dims == ("time",)
    assert record["case"].attrs == {
        "units": "m s-2",
        "role": "vibration",
        "sensor": "A1",
        "direction": [0.0, 0.0, 1.0],
    }
    assert_array_equal(record["case"], NOISE)
    assert record["tachometer"].dims == ("pulse_tachometer",)
    assert record["tachometer"].attrs == {"units": "s", "shaft": "input", "pulses_per_rev": 2}
    assert_array_equal(record["tachometer"], PULSES.times_s)
    assert vibration_channels(record) == ["case"]
    assert tachometers(record) == ["tachometer"]
    assert nominal_speed(record) is None


def test_a_record_of_declared_speed():
    record = build(angle=NOMINAL)
    speed = nominal_speed(record)
    assert float(speed) == 25.0
    assert speed.attrs == {"units": "rev s-1", "shaft": "input", "nominal": 1}
    assert tachometers(record) == []


@pytest.mark.parametrize("own_rate_hz", [None, 4000.0])
def test_a_waveform_becomes_pulses_and_is_kept(own_rate_hz):
    rate_hz, start_s, shaft_hz = own_rate_hz or RATE_HZ, 3.0, 7.3
    time_s = start_s + np.arange(2 * rate_hz) / rate_hz
    waveform = np.sin(2 * np.pi * shaft_hz * time_s)
    angle = TachometerWaveform(values=waveform, shaft="input", pulses_per_rev=1, rate_hz=own_rate_hz)
    record = build(angle=angle, start_s=start_s)
    first, last = np.ceil(shaft_hz * start_s), np.floor(shaft_hz * time_s[-1])
    rises_s = np.arange(first, last + 1) / shaft_hz  # where a sine rises through its middle
    # Linear interpolation of a sine over half a step h errs by less than (2 pi f h)^2 / 8 of a step.
    assert_allclose(record["tachometer"], rises_s, rtol=0, atol=0.01 / rate_hz)
    assert_array_equal(record["tachometer_waveform"], waveform)
    assert record["tachometer_waveform"].attrs["role"] == "tachometer"
    assert record["tachometer_waveform"].attrs["units"] == "V"
    assert record["tachometer"].attrs["threshold"] == pytest.approx(0, abs=1e-2)
    assert vibration_channels(record) == ["case"]
    assert tachometers(record) == ["tachometer"]


def test_several_tachometers():
    slow = PulseTimes(times_s=[0.2, 1.2], shaft="output", pulses_per_rev=1, name="keyphasor")
    record = build(angle=[PULSES, slow])
    assert tachometers(record) == ["tachometer", "keyphasor"]
    assert record["keyphasor"].dims == ("pulse_keyphasor",)
    assert record["keyphasor"].attrs["shaft"] == "output"


def test_bare_arrays_take_their_units_from_a_mapping():
    record = build({"a": NOISE, "b": NOISE}, units={"a": "g", "b": "mm/s"})
    assert [record[name].attrs["units"] for name in "ab"] == ["g", "mm s-1"]


@pytest.mark.parametrize(("units", "aliases"), UNITS.items())
def test_every_spelling_of_a_unit_becomes_one(units, aliases):
    for spelling in (units, *aliases, f" {units} "):
        assert build(units=spelling)["case"].attrs["units"] == units


@pytest.mark.parametrize(
    ("given", "kept"),
    [("f4", "f4"), ("f8", "f8"), (">f4", "f4"), (">f8", "f8"), ("i2", "f8"), ("u1", "f8"), ("f2", "f8")],
)
def test_floats_stay_and_integers_become_float64(given, kept):
    values = np.arange(50).astype(given)
    record = build({"case": values}, angle=NOMINAL)
    assert record["case"].dtype == np.dtype(kept)
    assert_array_equal(record["case"], np.arange(50))


def test_gaps_are_kept():
    masked = np.ma.masked_array([1, 2, 3], mask=[False, True, False])
    record = build({"a": [1.0, np.nan, np.inf], "b": masked}, angle=NOMINAL)
    assert_array_equal(record["a"], [1, np.nan, np.inf])
    assert_array_equal(record["b"], [1, np.nan, 3])


@pytest.mark.parametrize(
    "moment",
    [
        datetime(2024, 5, 1, 12, tzinfo=UTC),
        datetime(2024, 5, 1, 14, tzinfo=timezone(timedelta(hours=2))),
        "2024-05-01T14:00:00+02:00",
        "2024-05-01T12:00Z",
    ],
)
def test_moments_are_kept_in_utc(moment):
    assert build(recorded_at=moment).attrs["recorded_at"] == "2024-05-01T12:00:00Z"


def test_truth_is_passed_through():
    phase = xr.DataArray(np.arange(2000.0), dims="time", attrs={"units": "rad"})
    labels = xr.DataArray([1.0, 2.0], dims="fault", coords={"fault": ["crack", "spall"]})
    record = build(truth={"truth_phase": phase, "truth_depth": labels})
    assert record["truth_phase"].attrs == {"units": "rad"}
    assert_array_equal(record["truth_phase"], phase)
    assert float(record["truth_depth"].sel(fault="spall")) == 2.0
    assert isinstance(record.xindexes["time"], RangeIndex)
    assert vibration_channels(record) == ["case"]


def test_truth_with_a_time_axis_of_its_own_gets_that_of_the_record():
    phase = xr.DataArray(np.arange(2000.0), dims="time", coords={"time": np.arange(2000) / RATE_HZ})
    record = build(truth={"truth_phase": phase})
    assert isinstance(record.xindexes["time"], RangeIndex)


def test_the_arguments_are_not_changed():
    attrs = {"site": "north"}
    build(attrs=attrs)
    assert attrs == {"site": "north"}


# ---- the time axis -----------------------------------------------------------------------------------------


def test_the_time_axis_is_computed_and_exact():
    # At these rates arange(0, n / rate, 1 / rate) has one element too many.
    for rate_hz, count in ((97656.0, 292968), (49.0, 49), (3.0, 7)):
        record = build({"case": np.zeros(count)}, rate_hz=rate_hz, angle=SLOW)
        assert record.sizes["time"] == count
        assert isinstance(record.xindexes["time"], RangeIndex)
        assert_allclose(record["time"], np.arange(count) / rate_hz, rtol=1e-14)


@given(start=st.integers(0, 1998), length=st.integers(1, 2000))
def test_a_slice_is_a_record_that_knows_its_clock(start, length):
    piece = build(angle=NOMINAL, start_s=5.0).isel(time=slice(start, start + length))
    check_record(piece)
    when = sampling(piece, "case")
    assert when.start_s == pytest.approx(5 + start / RATE_HZ, rel=1e-14)
    assert when.rate_hz == RATE_HZ
    assert when.count == min(length, 2000 - start)


@given(
    rate_hz=st.sampled_from([97656.25, 1 / 3, 44100.0, 1e6]),
    count=st.integers(1, 5000),
    start_s=st.sampled_from([0.0, 0.1, -2.0, 1.7e9]),
    part=st.integers(0, 100),
)
def test_the_length_is_exact_at_any_rate(rate_hz, count, start_s, part):
    record = build({"case": np.zeros(count)}, rate_hz=rate_hz, angle=SLOW, start_s=start_s)
    first = part * (count - 1) // 100
    for piece, skipped in ((record, 0), (record.isel(time=slice(first, None)), first)):
        back = attach_time(detach_time(piece))
        assert back["time"].to_numpy().shape == back["case"].shape == (count - skipped,)
        assert sampling(back, "case").rate_hz == rate_hz
        assert sampling(back, "case").start_s == pytest.approx(start_s + skipped / rate_hz, rel=1e-14)


def test_a_slice_of_a_slice():
    piece = (
        build(angle=NOMINAL, start_s=5.0)
        .isel(time=slice(100, None))
        .isel(time=slice(10, 20))
        .isel(time=slice(-4, None))
    )
    check_record(piece)
    assert sampling(piece, "case").start_s == pytest.approx(5.116, rel=1e-14)
    assert_array_equal(piece["case"], NOISE[116:120])


def test_a_slice_by_time():
    piece = build().sel(time=slice(0.5, 0.75), method="nearest")
    assert sampling(piece, "case").start_s == pytest.approx(0.5)
    assert_array_equal(piece["case"], NOISE[500:750])
    check_record(piece)


def test_a_slice_between_two_pulses_still_knows_the_angle():
    check_record(build().isel(time=slice(60, 70)))


def test_detaching_keeps_where_a_slice_starts():
    fast = Channel(values=np.zeros(4000), units="g", rate_hz=2000)
    piece = build({"case": NOISE, "fast": fast}).isel(time=slice(300, None), time_fast=slice(40, None))
    bare = detach_time(piece)
    assert not bare.coords
    assert bare.attrs["start_s"] == pytest.approx(0.3)
    assert bare["fast"].attrs["start_s"] == pytest.approx(0.02)
    assert attach_time(bare).drop_attrs().equals(piece.drop_attrs())
    assert piece.attrs["start_s"] == 0.0


def test_a_channel_at_its_own_rate():
    fast = Channel(values=np.zeros(4000), units="mm/s", rate_hz=2000)
    record = build({"case": NOISE, "fast": fast}, start_s=0.5)
    assert record["fast"].dims == ("time_fast",)
    assert record["fast"].attrs["rate_hz"] == 2000
    assert sampling(record, "fast").rate_hz == 2000
    assert sampling(record, "fast").start_s == 0.5
    assert_allclose(record["time_fast"], 0.5 + np.arange(4000) / 2000)


def test_a_stated_rate_that_is_the_records_shares_its_axis():
    record = build({"a": NOISE, "b": Channel(values=NOISE, units="g", rate_hz=RATE_HZ)})
    assert record["b"].dims == ("time",)


@pytest.mark.parametrize("pick", [slice(None, None, 2), slice(None, None, -1), [0, 5, 6]])
def test_a_thinned_record_is_refused(pick):
    with pytest.raises(RecordError, match=r"does not run evenly at rate_hz=1000.*a stride aliases"):
        check_record(build().isel(time=pick))


def test_one_sample_by_number_is_not_a_record():
    with pytest.raises(RecordError, match='channel "case": dimensions'):
        check_record(build().isel(time=3))


# ---- what is refused ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [0, -1000.0, np.nan, np.inf, True, "1000", None, [1000]])
def test_a_rate_is_a_positive_number(rate_hz):
    assert f"rate_hz={rate_hz!r}: a positive, finite number is needed" in refusal(rate_hz=rate_hz)
    own = Channel(values=NOISE, units="g", rate_hz=rate_hz)
    if rate_hz is not None:
        assert 'channel "fast": rate_hz=' in refusal({"case": NOISE, "fast": own})


@pytest.mark.parametrize("start_s", [np.nan, np.inf, "0", None, True])
def test_a_start_is_a_finite_number(start_s):
    assert f"start_s={start_s!r}: a finite number of seconds" in refusal(start_s=start_s)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ([], "empty"),
        (np.zeros((2, 3)), r"shape (2, 3) where one row"),
        (3.0, "shape () where one row"),
        (["a", "b"], "values of type <U1"),
        ([True, False], "values of type bool"),
        ([1 + 2j], "values of type complex128"),
        ([1.0, None], "values of type object"),
        ([[1.0], [1.0, 2.0]], "not an array of numbers"),
    ],
)
def test_a_channel_is_one_row_of_numbers(values, sentence):
    assert f'channel "case": {sentence}' in refusal({"case": values})


def test_channels_at_one_rate_have_one_length():
    text = refusal({"a": NOISE, "b": NOISE[:-1], "c": NOISE})
    assert '"b" has 1999 where the others have 2000' in text


def test_a_waveform_at_the_rate_of_the_record_has_its_length():
    wave = TachometerWaveform(values=np.sin(np.arange(500.0)), shaft="input", pulses_per_rev=1)
    assert '"tachometer_waveform" has 500' in refusal(angle=wave)


def test_a_waveform_cut_short_of_a_second_pulse():
    once = TachometerWaveform(values=np.arange(2000) // 1000, shaft="input", pulses_per_rev=1)
    assert "upwards 1 times; at least 2 pulses are needed" in refusal(angle=once)


def test_pulse_times_in_place_of_a_waveform():
    times = TachometerWaveform(values=np.linspace(0, 2, 2000), shaft="input", pulses_per_rev=1)
    text = refusal(angle=times)
    assert "looks like a list of pulse times, not a waveform" in text
    assert "--tach-times" in text


@pytest.mark.parametrize(("channels", "kind"), [(NOISE, "ndarray"), ([NOISE], "list")])
def test_channels_without_names(channels, kind):
    assert f"channels: a {kind}, which has no names" in refusal(channels)


def test_no_channels():
    assert "no vibration channel" in refusal({}, angle=NOMINAL)


@pytest.mark.parametrize("units", [None, "", {}])
def test_undeclared_units(units):
    text = refusal(units=units)
    assert 'channel "case": no units' in text
    assert "--units g" in text
    assert '"mm s-1"' in text


@pytest.mark.parametrize("units", ["G", "furlong", "m s-3", 9.81])
def test_unknown_units(units):
    text = refusal({"case": Channel(values=NOISE, units=units)})
    assert f"units={units!r} are not known" in text
    assert '"g", "m s-2"' in text


def test_units_for_a_channel_that_is_not_there_or_states_its_own():
    assert 'units: no channel "cass"; the channels are case' in refusal(units={"cass": "g"})
    own = Channel(values=NOISE, units="g")
    assert "states its own already" in refusal({"case": own}, units={"case": "V"})


@pytest.mark.parametrize("direction", [(0, 0, 0), (1, 0), (np.nan, 0, 1), ("x", "y", "z")])
def test_a_direction_points_somewhere(direction):
    assert "direction=" in refusal({"case": Channel(values=NOISE, units="g", direction=direction)})


@pytest.mark.parametrize(
    "moment",
    ["yesterday", "2024-05-01T12:00:00", datetime(2024, 5, 1), 1.7e9, "0001-01-01T00:00:00+10:00"],  # noqa: DTZ001
)
def test_a_moment_has_a_time_zone(moment):
    assert "recorded_at=" in refusal(recorded_at=moment)


@pytest.mark.parametrize("angle", [None, [], 1500.0, np.arange(5.0), "1500", [1500.0]])
def test_without_an_angle_all_three_ways_are_named(angle):
    text = refusal(angle=angle)
    for way in ("PulseTimes", "TachometerWaveform", "NominalSpeed"):
        assert way in text
    for option in ("--tach-times", "--tach-waveform", "--shaft-rpm"):
        assert option in text


WAVEFORM = TachometerWaveform(values=NOISE, shaft="input", pulses_per_rev=1, name="other")


@pytest.mark.parametrize("angle", [[PULSES, NOMINAL], [PULSES, WAVEFORM], [NOMINAL, NOMINAL]])
def test_one_kind_of_angle_only(angle):
    assert "contradict each other or repeat" in refusal(angle=angle)


def pulses(times_s, **changes):
    return PulseTimes(**({"times_s": times_s, "shaft": "input", "pulses_per_rev": 1} | changes))


def test_pulses_that_run_backwards():
    text = refusal(angle=pulses([0.1, 0.2, 0.15, 0.3]))
    assert 'tachometer "tachometer": its times run backwards: pulse 2 is at 0.15 s, pulse 1 at 0.2 s' in text
    assert "two of its times are equal: pulses 1 and 2 are both at 0.2 s" in refusal(angle=pulses([0.1, 0.2, 0.2, 0.3]))


def test_a_waveform_in_place_of_pulse_times():
    text = refusal(angle=pulses(np.sin(0.1 * np.arange(2000))))
    assert "--tach-waveform" in text
    assert "such places in 2000" in text


@pytest.mark.parametrize(
    ("times_s", "sentence"),
    [
        ([0.1], "1 pulse; at least 2"),
        ([], "empty"),
        ([0.1, np.nan, 0.3], "pulse 1 is at nan"),
        ([0.1, np.inf], "pulse 1 is at inf"),
        ([[0.1, 0.2]], "shape (1, 2)"),
        ([5.0, 6.0], "5 s to 6 s, lie outside of the record, 0 s to 2 s"),
        ([-6.0, -5.0], "lie outside"),
        (np.arange(100.0, 2000, 100), "not sample numbers"),
    ],
)
def test_pulse_times_that_make_no_sense(times_s, sentence):
    text = refusal(angle=pulses(times_s))
    assert text.startswith('tachometer "tachometer": ')
    assert sentence in text


@pytest.mark.parametrize("count", [0, -1, 2.0, True, "2", None, np.nan])
def test_pulses_per_rev_is_a_positive_whole_number(count):
    text = refusal(angle=pulses([0.1, 0.2], pulses_per_rev=count))
    assert f"pulses_per_rev={count!r}: a positive whole number" in text


@pytest.mark.parametrize("source", [pulses([0.1, 0.2], shaft=""), NominalSpeed(rpm=1500, shaft="")])
def test_a_shaft_has_a_name(source):
    assert "name the shaft" in refusal(angle=source)


@pytest.mark.parametrize("rpm", [1e9, 30000])
def test_a_declared_speed_that_the_samples_cannot_show(rpm):
    text = refusal(angle=NominalSpeed(rpm=rpm, shaft="input"))
    assert f"nominal speed: {rpm:g} rpm is {rpm / 60:g} rev/s" in text
    assert "samples at 1000 Hz cannot resolve; it must be below 500" in text
    assert nominal_speed(build(angle=NominalSpeed(rpm=29999, shaft="input"))) is not None


def test_pulses_closer_than_samples():
    text = refusal(angle=pulses(np.arange(5000) / 2500))
    assert "its pulses are 0.0004 s apart on average, 0.4 samples at 1000 Hz: a pulse about every sample" in text
    fast = Channel(values=np.zeros(20000), units="g", rate_hz=10000)  # one channel that shows them is enough
    assert tachometers(build({"case": NOISE, "fast": fast}, angle=pulses(np.arange(5000) / 2500)))


@pytest.mark.parametrize("rpm", [0, -1500, np.nan, np.inf, True, "1500"])
def test_a_declared_speed_is_positive(rpm):
    assert f"nominal speed: rpm={rpm!r}: a positive" in refusal(angle=NominalSpeed(rpm=rpm, shaft="input"))


def test_a_waveform_without_pulses():
    flat = TachometerWaveform(values=np.zeros(2000), shaft="input", pulses_per_rev=1)
    assert 'tachometer "tachometer": no pulses found' in refusal(angle=flat)


@pytest.mark.parametrize(
    "name", ["", " a", "a/b", "a\udcff", "b\ufffd", ".", "a\0b", 3, "time", "nominal_speed", "truth_a"]
)
def test_names_that_cannot_be_kept(name):
    assert refusal({name: NOISE}).startswith("channel: the name")
    assert refusal(angle=pulses([0.1, 0.2], name=name)).startswith("tachometer: the name")


@pytest.mark.parametrize(
    ("channels", "angle"),
    [
        ({"tachometer": NOISE}, PULSES),
        ({"tachometer_waveform": NOISE}, TachometerWaveform(values=np.sin(NOISE), shaft="i", pulses_per_rev=1)),
        ({"case": NOISE}, [PULSES, PULSES]),
    ],
)
def test_two_parts_of_one_name(channels, angle):
    assert "two parts of the record are named" in refusal(channels, angle=angle)


def test_a_name_of_a_dimension():
    assert '"pulse_tachometer" is that of a dimension' in refusal({"pulse_tachometer": NOISE})


@pytest.mark.parametrize(
    ("truth", "sentence"),
    [
        ({"order": xr.DataArray(1.0)}, "named truth_..."),
        ({"truth_order": 1.0}, "an xarray.DataArray"),
        ({"truth_phase": xr.DataArray(np.zeros(7), dims="time")}, "does not fit the record"),
        ({"truth_a/b": xr.DataArray(1.0)}, "cannot be kept"),
        (
            {
                "truth_a": xr.DataArray([1.0], dims="fault", coords={"fault": ["crack"]}),
                "truth_b": xr.DataArray([1.0], dims="fault", coords={"fault": ["spall"]}),
            },
            "does not fit the record",
        ),
    ],
)
def test_truth_that_does_not_fit(truth, sentence):
    assert sentence in refusal(truth=truth)


def test_attributes_of_the_record_itself():
    assert '"rate_hz" is written by make_record' in refusal(attrs={"rate_hz": 1.0})


# ---- what is no record -------------------------------------------------------------------------------------


def without_angle(record):
    return record.drop_vars("tachometer")


def with_extra_variable(record):
    return record.assign(extra=("time", NOISE))


def with_both_kinds(record):
    return record.assign(nominal_speed=((), 25.0, {"shaft": "input"}))


def with_two_dimensions(record):
    return record.assign(case=(("time", "x"), np.zeros((2000, 2)), record["case"].attrs))


def with_an_alias_for_units(record):
    return record.assign(case=record["case"].assign_attrs(units="m/s^2"))


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda _: np.zeros(3), "is an xarray.Dataset, not a ndarray"),
        (lambda record: record["case"], "is an xarray.Dataset, not a DataArray"),
        (lambda record: record.drop_attrs(), "schema=None"),
        (lambda record: record.assign_attrs(rate_hz=0.0), "attribute rate_hz=0.0"),
        (lambda record: record.assign_attrs(rate_hz=1010.0), "does not run evenly"),
        (lambda record: record.drop_vars("time"), "does not run evenly"),
        (lambda record: record.drop_vars("case"), "no vibration channel"),
        (lambda record: record.isel(time=slice(0, 0)), "empty"),
        (lambda record: record.astype(np.int32), "float32 or float64"),
        (without_angle, "this record has no source of shaft angle"),
        (with_extra_variable, 'variable "extra" is no part of a record'),
        (with_both_kinds, "both nominal_speed and the tachometer"),
        (with_two_dimensions, "a channel has one"),
        (with_an_alias_for_units, 'units="m/s^2" are written "m s-2"'),
    ],
)
def test_what_is_no_record(spoil, sentence):
    with pytest.raises(RecordError) as caught:
        check_record(spoil(build()))
    assert sentence in str(caught.value)


def stored_axis(record, times_s):
    return record.drop_vars("time").assign_coords(time=times_s)


def test_an_axis_of_numbers_becomes_a_range():
    plain = stored_axis(build(angle=NOMINAL), 7 + np.arange(2000) / RATE_HZ)
    assert sampling(attach_time(plain), "case").start_s == 7.0


@pytest.mark.parametrize(
    ("times_s", "sentence"),
    [
        (np.arange(2000) * 2 / RATE_HZ, "2000 samples from 0 s to 3.998 s, does not run evenly at rate_hz=1000"),
        (-np.arange(2000) / RATE_HZ, "does not run evenly"),
        (np.full(2000, np.nan), "does not run evenly"),
        (np.arange(2000).astype("datetime64[s]"), "is of type datetime64[s]; seconds are needed"),
    ],
)
def test_an_axis_of_numbers_that_contradicts_the_rate(times_s, sentence):
    with pytest.raises(RecordError) as caught:
        attach_time(stored_axis(build(angle=NOMINAL), times_s))
    assert str(caught.value).startswith('channel "case": its axis "time"')
    assert sentence in str(caught.value)


def test_a_renamed_channel_stays_one():
    fast = Channel(values=np.zeros(4000), units="g", rate_hz=2000)
    record = build({"case": NOISE, "fast": fast}).rename(fast="quick", case="housing")
    check_record(record)
    assert sampling(record, "quick").rate_hz == 2000


def test_values_of_a_channel():
    assert_array_equal(channel_values(build(), "case"), NOISE)


def test_pulses_are_all_that_is_asked_of_signals(monkeypatch):
    monkeypatch.setitem(sys.modules, "signals.shaft.tachometer", None)
    build()
    build(angle=NOMINAL)


# ---- channels that state their own sampling ----------------------------------------------------------------


def labelled(times, units="g", time_units="s"):
    axis = ("time", times, {"units": time_units})
    return xr.DataArray(np.arange(float(len(times))), dims="time", coords={"time": axis}, attrs={"units": units})


@pytest.mark.parametrize("time_units", ["s", "ms"])
def test_a_data_array_states_units_rate_start_and_gaps(time_units):
    times_s = 5 + np.delete(np.arange(1003), [500, 501, 502]) / 1000
    channel = labelled(times_s * {"s": 1, "ms": 1000}[time_units], time_units=time_units)
    record = make_record({"vib": channel}, angle=UnknownAngle())
    assert (record.attrs["rate_hz"], record.vib.attrs["units"]) == (1000, "g")
    assert record.attrs["start_s"] == pytest.approx(5)
    assert_array_equal(record.vib, np.insert(np.arange(1000.0), 500, [np.nan] * 3))


@pytest.mark.parametrize(
    ("declared", "why"),
    [
        ({"rate_hz": 1008}, "state 1000 Hz, which rate_hz=1008 contradicts"),
        ({"units": "V"}, 'units="V" contradict its DataArray, which states "g"'),
        ({"start_s": 3.0}, "begin at 5 s, which start_s=3 contradicts"),
    ],
)
def test_a_data_array_that_contradicts_a_declaration(declared, why):
    with pytest.raises(RecordError, match=why):
        make_record({"vib": labelled(5 + np.arange(1000) / 1000)}, angle=UnknownAngle(), **declared)
