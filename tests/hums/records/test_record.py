"""Records: what the constructor builds, what survives slicing, and the sentence for every refusal."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from xarray.indexes import RangeIndex

from hums.records.channels import attach_time, detach_time, nominal_speed, sampling, tachometers, vibration_channels
from hums.records.fields import RecordError
from hums.records.record import Channel, NominalSpeed, PulseTimes, TachometerWaveform, UnknownAngle, make_record
from hums.records.validation import check_record

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
        regime="hover",
        recorded_at="2013-03-11T03:00:24Z",
        start_s=0.25,
        attrs={"site": "north"},
    )
    assert record.attrs == {
        "schema": "hums-record/2",
        "machine": "turbine 4",
        "regime": "hover",
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


@pytest.mark.parametrize(
    ("given", "kept"),
    [("f4", "f4"), (">f8", "f8"), ("u1", "f8"), ("f2", "f8")],
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


# ---- the time axis -----------------------------------------------------------------------------------------


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


def test_a_channel_at_its_own_rate():
    fast = Channel(values=np.zeros(4000), units="mm/s", rate_hz=2000)
    record = build({"case": NOISE, "fast": fast}, start_s=0.5)
    assert record["fast"].dims == ("time_fast",)
    assert record["fast"].attrs["rate_hz"] == 2000
    assert sampling(record, "fast").rate_hz == 2000
    assert sampling(record, "fast").start_s == 0.5
    assert_allclose(record["time_fast"], 0.5 + np.arange(4000) / 2000)


@pytest.mark.parametrize("pick", [slice(None, None, 2), slice(None, None, -1), [0, 5, 6]])
def test_a_thinned_record_is_refused(pick):
    with pytest.raises(RecordError, match=r"is not evenly spaced at rate_hz=1000.*a stride aliases"):
        check_record(build().isel(time=pick))


# ---- what is refused ---------------------------------------------------------------------------------------


def pulses(times_s, **changes):
    return {"angle": PulseTimes(**({"times_s": times_s, "shaft": "input", "pulses_per_rev": 1} | changes))}


def waveform(values):
    return {"angle": TachometerWaveform(values=values, shaft="input", pulses_per_rev=1)}


def turning(rpm, shaft="input"):
    return {"angle": NominalSpeed(rpm=rpm, shaft=shaft)}


def channel(**changes):
    return {"channels": {"case": Channel(**({"values": NOISE, "units": "g"} | changes))}}


def crack(name):
    return xr.DataArray([1.0], dims="fault", coords={"fault": [name]})


NO_ANGLE = "(?s)(?=.*PulseTimes)(?=.*TachometerWaveform)(?=.*NominalSpeed)(?=.*--tach-times)(?=.*--shaft-rpm)"


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        # rates and starts
        ({"rate_hz": np.inf}, "rate_hz=inf: a positive, finite number is needed"),
        (channel(rate_hz=-1), 'channel "case": rate_hz='),
        ({"start_s": np.nan}, "start_s=nan: a finite number of seconds"),
        # values of channels
        ({"channels": {"case": []}}, 'channel "case": shape \\(0,\\), but one row'),
        ({"channels": {"case": np.zeros((2, 3))}}, r"shape \(2, 3\), but one row"),
        ({"channels": {"case": [[1.0], [1.0, 2.0]]}}, "not an array of numbers"),
        ({"channels": {"a": NOISE, "b": NOISE[:-1], "c": NOISE}}, '"b" has 1999, the others 2000 samples'),
        ({"channels": NOISE}, "channels: ndarray given, without names"),
        ({"channels": {}, **turning(1500)}, "no vibration channel"),
        # units, directions, moments
        *(({"units": units}, 'channel "case": no units.*--units g.*"mm s-1"') for units in (None, "", {})),
        *((channel(units=units), f"units={units!r} are not known.*") for units in ("G", "m s-3", 9.81)),
        ({"units": {"cass": "g"}}, 'units: no channel "cass"; the channels are case'),
        ({**channel(), "units": {"case": "V"}}, "already states its own"),
        *((channel(direction=way), "direction=") for way in ((0, 0, 0), (1, 0), (np.nan, 0, 1), ("x", "y", "z"))),
        *(
            ({"recorded_at": moment}, "recorded_at=")
            for moment in ("yesterday", "2024-05-01T12:00:00", 1.7e9, "0001-01-01T00:00:00+10:00")
        ),
        # shaft angles
        *(({"angle": angle}, NO_ANGLE) for angle in (None, [], 1500.0, np.arange(5.0), [1500.0])),
        ({"angle": [PULSES, NOMINAL]}, "contradict each other or repeat"),
        ({"angle": [NOMINAL, NOMINAL]}, "contradict each other or repeat"),
        (waveform(np.sin(np.arange(500.0))), '"tachometer_waveform" has 500'),
        (waveform(np.arange(2000) // 1000), "upwards 1 times; at least 2 pulses are needed"),
        (waveform(np.linspace(0, 2, 2000)), "looks like a list of pulse times, not a waveform.*--tach-times"),
        (waveform(np.zeros(2000)), 'tachometer "tachometer": no pulses found'),
        (
            pulses([0.1, 0.2, 0.15]),
            'tachometer "tachometer": its times must increase, but pulse 1 is at 0.2 s and pulse 2 at 0.15 s',
        ),
        (pulses([0.1, 0.2, 0.2, 0.3]), "pulse 1 is at 0.2 s and pulse 2 at 0.2 s"),
        (pulses(np.sin(0.1 * np.arange(2000))), "(?s)(?=.*such pulses of 2000)(?=.*--tach-waveform)"),
        (pulses([0.1]), "1 pulse; at least 2"),
        (pulses([]), 'tachometer "tachometer": shape \\(0,\\)'),
        (pulses([0.1, np.nan, 0.3]), "pulse 1 is at nan"),
        (pulses([5.0, 6.0]), "5 s to 6 s, lie outside the record, 0 s to 2 s"),
        (pulses(np.arange(100.0, 2000, 100)), "not sample numbers"),
        (
            pulses(np.arange(5000) / 2500),
            "0.0004 s apart on average, 0.4 samples at 1000 Hz, about one pulse per sample",
        ),
        (pulses([0.1, 0.2], pulses_per_rev=0), "pulses_per_rev=0: a positive whole number"),
        (pulses([0.1, 0.2], shaft=""), "name the shaft"),
        (turning(1500, shaft=""), "name the shaft"),
        (turning(30000), "nominal speed: 30000 rpm is 500 rev/s, .* 1000 Hz cannot resolve; it must be below 500"),
        (turning(-1500), "nominal speed: rpm=-1500: a positive"),
        # names
        ({"channels": {"tachometer": NOISE}}, "two parts of the record are named"),
        ({"angle": [PULSES, PULSES]}, "two parts of the record are named"),
        ({"channels": {"pulse_tachometer": NOISE}}, '"pulse_tachometer" is reserved for a dimension'),
        ({"attrs": {"rate_hz": 1.0}}, '"rate_hz" is written by make_record'),
        # truth
        ({"truth": {"order": xr.DataArray(1.0)}}, "named truth_..."),
        ({"truth": {"truth_order": 1.0}}, "give xarray.DataArrays"),
        ({"truth": {"truth_phase": xr.DataArray(np.zeros(7), dims="time")}}, "does not fit the record"),
        ({"truth": {"truth_a/b": xr.DataArray(1.0)}}, "cannot be stored"),
        ({"truth": {"truth_a": crack("crack"), "truth_b": crack("spall")}}, "does not fit the record"),
    ],
)
def test_what_is_declared_wrongly(changes, sentence):
    with pytest.raises(RecordError, match=sentence):
        build(**changes)


def test_pulse_times_in_their_own_unit():
    times = xr.DataArray([100.0, 350.0, 600.0], dims="pulse", attrs={"units": "ms"})
    assert_allclose(build(**pulses(times))["tachometer"], [0.1, 0.35, 0.6], rtol=1e-15)


def test_one_channel_that_shows_the_pulses_is_enough():
    fast = Channel(values=np.zeros(20000), units="g", rate_hz=10000)
    assert tachometers(build({"case": NOISE, "fast": fast}, **pulses(np.arange(5000) / 2500)))
    assert nominal_speed(build(**turning(29999))) is not None


@pytest.mark.parametrize(
    "name", ["", " a", "a/b", "a\udcff", "b\ufffd", ".", "a\0b", 3, "time", "nominal_speed", "truth_a"]
)
def test_names_that_cannot_be_kept(name):
    assert refusal({name: NOISE}).startswith("channel: the name")
    assert refusal(**pulses([0.1, 0.2], name=name)).startswith("tachometer: the name")


# ---- what is no record -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda record: record["case"], "must be an xarray.Dataset, not DataArray"),
        (lambda record: record.drop_attrs(), "schema=None"),
        (lambda record: record.assign_attrs(rate_hz=0.0), "attribute rate_hz=0.0"),
        (lambda record: record.assign_attrs(rate_hz=1010.0), "is not evenly spaced"),
        (lambda record: record.drop_vars("time"), "is not evenly spaced"),
        (lambda record: record.drop_vars("case"), "no vibration channel"),
        (lambda record: record.isel(time=slice(0, 0)), "empty"),
        (lambda record: record.isel(time=3), 'channel "case": dimensions'),
        (lambda record: record.astype(np.int32), "float32 or float64"),
        (lambda record: record.drop_vars("tachometer"), "this record has no source of shaft angle"),
        (lambda record: record.assign(extra=("time", NOISE)), 'variable "extra" does not belong in a record'),
        (
            lambda record: record.assign(nominal_speed=((), 25.0, {"shaft": "input"})),
            "both nominal_speed and tachometer",
        ),
        (
            lambda record: record.assign(case=(("time", "x"), np.zeros((2000, 2)), record["case"].attrs)),
            "a channel has one",
        ),
        (
            lambda record: record.assign(case=record["case"].assign_attrs(units="m/s^2")),
            'units="m/s\\^2" must be written "m s-2"',
        ),
    ],
)
def test_what_is_no_record(spoil, sentence):
    with pytest.raises(RecordError, match=sentence):
        check_record(spoil(build()))


def stored_axis(record, times_s):
    return record.drop_vars("time").assign_coords(time=times_s)


@pytest.mark.parametrize(
    ("times_s", "sentence"),
    [
        (np.arange(2000) * 2 / RATE_HZ, "2000 samples from 0 s to 3.998 s, is not evenly spaced at rate_hz=1000"),
        (-np.arange(2000) / RATE_HZ, "is not evenly spaced"),
        (np.full(2000, np.nan), "is not evenly spaced"),
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
