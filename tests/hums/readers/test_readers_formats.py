"""Files of other measuring programs, written by the libraries that are made for them and read back."""

import struct
import sys
import warnings
import zlib

import h5py
import numpy as np
import pytest
import pyuff
import xarray as xr
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat

from hums.readers import convert, read_file
from hums.records.channels import sampling, tachometers, vibration_channels
from hums.records.fields import RecordError, RecordWarning
from hums.records.record import NominalSpeed, make_record
from hums.records.store import open_record, save_record

RATE_HZ = 97656.25
NOISE = np.random.default_rng(11).normal(size=500)
NOMINAL = {"shaft_rpm": 1500.0, "shaft": "input"}


def refusal(source, **arguments):
    with pytest.raises(RecordError) as caught:
        convert(source, **(NOMINAL | arguments))
    return str(caught.value)


# ---- TDMS --------------------------------------------------------------------------------------------------


def tdms(path, *channels):
    """Write (name, values, properties) into the group "Log"."""
    objects = [ChannelObject("Log", name, values, properties=properties) for name, values, properties in channels]
    with TdmsWriter(str(path)) as writer:
        writer.write_segment([RootObject(properties={"author": "test"}), GroupObject("Log"), *objects])
    return path


def waveform(rate_hz=RATE_HZ, **more):
    return {"wf_increment": 1 / rate_hz, "wf_samples": 1} | more


@pytest.fixture
def logged(tmp_path):
    began = {"wf_start_time": np.datetime64("2026-03-01T12:00:00.5"), "wf_start_offset": 0.25}
    tacho = np.sin(2 * np.pi * 1000.0 * np.arange(500) / RATE_HZ)
    return tdms(
        tmp_path / "log.tdms",
        ("Dev1/ai0", NOISE, waveform(unit_string="g", **began)),
        ("Dev1/ai1", 2 * NOISE, waveform(unit_string="m/s^2", **began)),
        ("slow", NOISE[:100].astype(np.float32), waveform(RATE_HZ / 5, unit_string="Volts", **began)),
        ("tacho", tacho, waveform(unit_string="V", **began)),
        ("bare", np.arange(500, dtype=np.int32), {}),
        ("late", NOISE, waveform(unit_string="g", **(began | {"wf_start_offset": 0.3}))),
        ("notes", ["a", "b"], {}),
        ("nothing", np.zeros(0), {}),
        ("strange", NOISE, waveform(unit_string="furlongs")),
    )


def test_a_tdms_file_states_units_rate_names_and_its_beginning(logged, tmp_path):
    record = convert(logged, channels=["Log.Dev1.ai0", "Log/Dev1/ai1", "Log.slow"], **NOMINAL)
    assert vibration_channels(record) == ["Log.Dev1.ai0", "Log.Dev1.ai1", "Log.slow"]
    assert_array_equal(record["Log.Dev1.ai0"], NOISE)
    assert_array_equal(record["Log.Dev1.ai1"], 2 * NOISE)
    assert [record[name].attrs["units"] for name in vibration_channels(record)] == ["g", "m s-2", "V"]
    assert sampling(record, "Log.Dev1.ai0").rate_hz == RATE_HZ
    assert sampling(record, "Log.slow").rate_hz == RATE_HZ / 5
    assert sampling(record, "Log.slow").start_s == 0.25
    assert record.attrs["recorded_at"] == "2026-03-01T12:00:00.500000Z"
    save_record(record, tmp_path / "record.h5")
    with open_record(tmp_path / "record.h5") as opened:
        assert opened.load().identical(record)


def test_a_tachometer_of_a_tdms_file(logged):
    record = convert(logged, channels=["Log.Dev1.ai0"], tach_waveform="Log/tacho", pulses_per_rev=1, shaft="input")
    assert tachometers(record) == ["tachometer"]
    # A sine at 1 kHz rises through zero each millisecond after the first sample at 0.25 s; interpolated between
    # samples of 10 µs, its bend moves that by less than a hundredth of one.
    assert_allclose(record["tachometer"], 0.25 + np.arange(1, 6) / 1000, rtol=0, atol=1e-7)


def test_what_a_tdms_file_does_not_state(logged):
    assert 'log.tdms has no "Log.Dev1.ai2". Did you mean \'Log.Dev1.ai' in refusal(logged, channels=["Log.Dev1.ai2"])
    assert '"Log.notes" is text' in refusal(logged, channels=["Log.notes"])
    assert "does not state its sampling rate" in refusal(logged, channels=["Log.bare"], units="g")
    assert "--units g" in refusal(logged, channels=["Log.bare"], rate_hz=1000.0)
    record = convert(logged, channels=["Log.bare"], units="g", rate_hz=1000.0, **NOMINAL)
    assert_array_equal(record["Log.bare"], np.arange(500))
    assert record.attrs["recorded_at"] == ""
    assert "units='furlongs' are not known" in refusal(logged, channels=["Log.strange"])
    assert convert(logged, channels=["Log.strange"], units="m", **NOMINAL)["Log.strange"].attrs["units"] == "m"


def test_what_contradicts_a_tdms_file(logged):
    text = refusal(logged, channels=["Log.slow"], units="g")
    assert 'units="g" contradict log.tdms, which states "Volts"' in text
    assert 'scale={"Log.slow": ...}' in text
    assert convert(logged, channels=["Log.slow"], units="V", **NOMINAL)["Log.slow"].attrs["units"] == "V"
    record = convert(logged, channels=["Log.slow"], units="g", scale={"Log.slow": 10.0}, **NOMINAL)
    assert_array_equal(record["Log.slow"], np.float32(10) * NOISE[:100].astype(np.float32))
    assert 'states "Volts" for "Log.slow", which no longer holds after scale=10' in refusal(
        logged, channels=["Log.slow"], scale={"Log.slow": 10.0}
    )
    assert "rate_hz=48000 contradicts log.tdms" in refusal(logged, channels=["Log.Dev1.ai0"], rate_hz=48000)
    assert '"Log.late" begins 0.05 s after "Log.Dev1.ai0"' in refusal(logged, channels=["Log.Dev1.ai0", "Log.late"])
    assert 'has no "Log.x"' in refusal(logged, channels=["Log.slow"], units={"Log.x": "g"})


def test_a_declared_time_against_that_of_a_tdms_file(logged):
    near, far = "2026-03-01T13:00+01:00", "2026-03-01T12:00+02:00"
    assert convert(logged, channels=["Log.Dev1.ai0"], recorded_at=near, **NOMINAL).recorded_at == "2026-03-01T12:00:00Z"
    assert "which states 2026-03-01T12:00:00.5" in refusal(logged, channels=["Log.Dev1.ai0"], recorded_at=far)
    for trust, when in (("declared", "2026-03-01T10:00:00Z"), ("file", "2026-03-01T12:00:00.500000Z")):
        with pytest.warns(RecordWarning, match="was trusted"):
            record = convert(logged, channels=["Log.Dev1.ai0"], recorded_at=far, trust=trust, **NOMINAL)
        assert record.attrs["recorded_at"] == when
        assert "recorded_at" in record.attrs["notes"]


def segments(path, *parts):
    """Write samples and properties of one channel, a segment each."""
    with TdmsWriter(str(path)) as writer:
        for values, properties in parts:
            writer.write_segment([ChannelObject("Log", "x", values, properties=properties)])
    return path


@pytest.mark.parametrize(
    ("later", "missing"),
    [
        ({"wf_start_time": np.datetime64("2026-03-01T12:00:01")}, 0),  # goes on
        ({}, 0),
        ({"wf_start_time": np.datetime64("2026-03-01T12:00:01.3")}, 300),
        ({"wf_start_offset": 1.02}, 20),
    ],
)
def test_segments_of_a_tdms_file_have_their_own_starts(tmp_path, later, missing):
    first = waveform(1000.0, unit_string="g", wf_start_time=np.datetime64("2026-03-01T12:00:00"), wf_start_offset=0.0)
    path = segments(tmp_path / "a.tdms", (np.arange(1000.0), first), (np.arange(1000.0, 2000.0), first | later))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        record = convert(path, channels=["x"], **NOMINAL)
    assert record.attrs["recorded_at"] == "2026-03-01T12:00:00Z"
    assert_array_equal(record.x, np.r_[np.arange(1000.0), np.full(missing, np.nan), np.arange(1000.0, 2000.0)])


@pytest.mark.parametrize(
    ("later", "why"),
    [
        ({"wf_start_time": np.datetime64("2026-03-01T11:00:00")}, "run backwards"),
        ({"wf_start_time": np.datetime64("2026-03-01T13:00:00")}, "Split the file"),
        ({"wf_start_time": np.datetime64("2026-03-01T12:00:01"), "wf_increment": 1 / 1008}, "not evenly spaced"),
    ],
)
def test_segments_of_a_tdms_file_that_are_no_record(tmp_path, later, why):
    first = waveform(1000.0, unit_string="g", wf_start_time=np.datetime64("2026-03-01T12:00:00"), wf_start_offset=0.0)
    path = segments(tmp_path / "a.tdms", (np.zeros(1000), first), (np.zeros(1000), first | later))
    assert why in refusal(path, channels=["x"])
    assert why in refusal(path, channels=["x"], rate_hz=1000)


def test_two_channels_of_one_dotted_name(tmp_path):
    path = tdms(tmp_path / "a.tdms", ("a/b", NOISE, {}), ("a.b", NOISE, {}))
    assert "have the same name once slashes become dots" in refusal(path, channels=["Log.a.b"])


# ---- UFF ---------------------------------------------------------------------------------------------------


def uff(path, **changes):
    """Add a time history to a universal file."""
    values = changes.pop("data", NOISE)
    settings = {
        "binary": 1,
        "func_type": 1,
        "ver_num": 0,
        "load_case_id": 0,
        "rsp_ent_name": "NONE",
        "rsp_node": 3,
        "rsp_dir": 3,
        "ref_ent_name": "NONE",
        "ref_node": 0,
        "ref_dir": 0,
        "abscissa_spacing": 1,
        "abscissa_min": 0.0,
        "abscissa_inc": 1 / RATE_HZ,
        "z_axis_value": 0.0,
        "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 0,
        "ordinate_axis_units_lab": "g",
        "abscissa_axis_units_lab": "s",
        "id1": "test",
    } | changes
    settings.setdefault("x", settings["abscissa_min"] + np.arange(values.size) * settings["abscissa_inc"])
    with warnings.catch_warnings():  # pyuff leaves a file open that it writes; what it reads it closes
        warnings.simplefilter("ignore", ResourceWarning)
        pyuff.UFF(str(path)).write_sets(pyuff.prepare_58(data=values, **settings), mode="add")
    return path


@pytest.mark.parametrize("binary", [0, 1])
def test_a_universal_file_states_units_rate_and_places(tmp_path, binary):
    path = tmp_path / "a.uff"
    uff(path, binary=binary, abscissa_min=0.5)
    uff(path, binary=binary, abscissa_min=0.5, rsp_ent_name="case", rsp_dir=-1, data=2 * NOISE)
    uff(path, binary=binary, abscissa_min=0.5, rsp_node=4, rsp_dir=0, ordinate_axis_units_lab="m/s^2", data=3 * NOISE)
    record = convert(path, channels=["3+Z", "case 3-X", "4"], **NOMINAL)
    for factor, name in enumerate(["3+Z", "case 3-X", "4"], start=1):
        # text keeps twelve digits of double precision
        assert_allclose(record[name], factor * NOISE, rtol=2e-11 if binary == 0 else 0)
        assert sampling(record, name).rate_hz == RATE_HZ
        assert sampling(record, name).start_s == 0.5
    assert [record[name].attrs["units"] for name in vibration_channels(record)] == ["g", "g", "m s-2"]


def test_a_step_of_six_digits_may_be_refined(tmp_path):
    path = uff(tmp_path / "a.uff", binary=0, abscissa_inc=1 / 65537)
    stated = read_file(path).metadata("3+Z").rate_hz
    assert stated != 65537
    assert abs(stated / 65537 - 1) < 5e-6  # half of the last digit of 1.52586e-05
    assert convert(path, channels=["3+Z"], rate_hz=65537, **NOMINAL).attrs["rate_hz"] == 65537
    assert "rate_hz=65540 contradicts" in refusal(path, channels=["3+Z"], rate_hz=65540)


def test_an_uneven_abscissa_is_refused(tmp_path):
    step_s = np.where(np.arange(500) % 7 == 3, 3e-3, 1e-3)
    path = uff(tmp_path / "a.uff", abscissa_spacing=0, x=np.cumsum(step_s))
    for rate in ({}, {"rate_hz": 1000}):
        assert "not evenly spaced" in refusal(path, channels=["3+Z"], **rate)
    with pytest.warns(RecordWarning, match="the declared rate was trusted"):
        assert convert(path, channels=["3+Z"], rate_hz=1000, trust="declared", **NOMINAL).attrs["rate_hz"] == 1000


def test_a_frequency_response_is_no_channel(tmp_path):
    path = uff(tmp_path / "a.uff")
    uff(path, func_type=4, rsp_node=7, data=NOISE + 1j * NOISE, abscissa_spec_data_type=18)
    assert '"7+Z" is a function of type 4, no time history' in refusal(path, channels=["7+Z"])


# ---- HDF5 of other programs --------------------------------------------------------------------------------


@pytest.fixture
def foreign(tmp_path):
    with h5py.File(tmp_path / "a.h5", mode="w") as file:
        file["run 1/acc"] = NOISE
        file["run 1/acc"].attrs["units"] = "m/s^2"
        file["run 1/column"] = NOISE[:, None].astype(np.float32)
        file["table"] = np.zeros((500, 3))
        file["text"] = "read me"
        file["one"] = 3.5
        file["pairs"] = np.zeros(4, dtype=[("a", "f8"), ("b", "i4")])
        file["type"] = np.dtype("f8")
        file["empty"] = h5py.Empty("f8")
        file["g/notes"] = np.array([b"a", b"b"])
    return tmp_path / "a.h5"


@pytest.mark.parametrize("name", ["run 1.acc", "/run 1/acc"])
def test_an_array_of_a_foreign_hdf5_file(foreign, name):
    record = convert(foreign, channels=[name], rate_hz=1000.0, **NOMINAL)
    assert_array_equal(record["run 1.acc"], NOISE)
    assert record["run 1.acc"].attrs["units"] == "m s-2"


def test_what_is_no_channel_of_a_foreign_hdf5_file(foreign):
    def why(name):
        return refusal(foreign, channels=[name], rate_hz=1000.0, units="g")

    assert "run 1.column (500 x 1)" in why("none")
    assert '"table" is a table of 500 x 3 values' in why("table")
    assert '"text" is text' in why("text")
    assert '"g/notes" is text' in why("g/notes")
    assert '"pairs" is a table with named columns' in why("pairs")
    assert '"empty" is empty' in why("empty")
    assert "does not state its sampling rate" in refusal(foreign, channels=["run 1/acc"])
    assert "--units g" in refusal(foreign, channels=["run 1.column"], rate_hz=1000.0)


def test_packed_values_and_times_of_a_netcdf_file(tmp_path):
    """As xarray writes them by the CF conventions."""
    truth = np.round(np.sin(0.3 * np.arange(500)), 3)
    truth[7] = np.nan
    packing = {"dtype": "int16", "scale_factor": 1e-3, "add_offset": 0.25, "_FillValue": -32768}
    when = np.datetime64("2026-03-01T12:00:00.5", "ns") + 40_000 * np.arange(500)
    dataset = xr.Dataset({"DE": ("time", truth, {"units": "g"})}, coords={"time": when})
    dataset.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding={"DE": packing})
    record = convert(tmp_path / "a.nc", channels=["DE"], **NOMINAL)
    assert_allclose(record.DE, truth, rtol=0, atol=1e-12)
    assert (record.attrs["rate_hz"], record.attrs["recorded_at"]) == (25000.0, "2026-03-01T12:00:00.500000Z")
    assert "rate_hz=25200 contradicts" in refusal(tmp_path / "a.nc", channels=["DE"], rate_hz=25200)
    dataset.to_netcdf(tmp_path / "b.nc", engine="scipy", encoding={"DE": packing})
    assert "b.nc is netCDF of version 3; convert it to version 4" in refusal(tmp_path / "b.nc", channels=["DE"])


def test_attributes_of_an_hdf5_file(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/DE"], file["run/ND"] = NOISE, NOISE
        file["run"].attrs.update({"sample_rate": 25.6e3, "start_time": "2026-03-01T14:00:00+02:00"})
        file["run/DE"].attrs.update({"units": "V", "sensitivity": 100.0, "sensitivity_units": "mV/g"})
        file["run/ND"].attrs.update({"units": "g", "gain": 10.0})
    record = convert(tmp_path / "a.h5", channels=["run.DE"], **NOMINAL)
    assert (record.attrs["rate_hz"], record.attrs["recorded_at"]) == (25600.0, "2026-03-01T12:00:00Z")
    assert (record["run.DE"].attrs["sensitivity"], record["run.DE"].attrs["measures"]) == (0.1, "g")
    with pytest.warns(RecordWarning, match="gain=10, which is not applied"):
        assert "gain=10" in convert(tmp_path / "a.h5", channels=["run.ND"], **NOMINAL).attrs["notes"]


@pytest.mark.parametrize("kind", ["mat", "npz"])
def test_scalars_beside_an_array_state_its_rate_and_units(tmp_path, kind):
    for key, value in {"fs": 12000.0, "SampleRate": 12000, "dt": 1 / 12000, "Fs_kHz": 12.0}.items():
        contents = {"DE": NOISE, key: value, "units": "g"}
        path = tmp_path / f"a.{kind}"
        savemat(path, contents) if kind == "mat" else np.savez(path, **contents)
        record = convert(path, channels=["DE"], **NOMINAL)
        assert (record.attrs["rate_hz"], record.DE.attrs["units"]) == (12000.0, "g")
        assert "which states 12000 Hz" in refusal(path, channels=["DE"], rate_hz=12800)


def test_variable_units_of_a_mat_file(tmp_path):
    about = {"VariableUnits": np.array(["g", "V"], dtype=object), "SampleRate": 5000.0}
    savemat(tmp_path / "a.mat", {"data": {"DE": NOISE, "tacho": NOISE, "Properties": about}})
    record = convert(tmp_path / "a.mat", channels=["DE", "tacho"], **NOMINAL)
    assert [record[name].attrs["units"] for name in ("DE", "tacho")] == ["g", "V"]
    assert record.attrs["rate_hz"] == 5000


def test_a_record_is_no_foreign_file(tmp_path):
    record = make_record({"x": NOISE}, rate_hz=1000.0, units="g", angle=NominalSpeed(rpm=60, shaft="input"))
    save_record(record, tmp_path / "record.h5")
    assert "is already a record" in refusal(tmp_path / "record.h5", channels=["x"])


# ---- either ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("suffix", "module", "package"),
    [(".tdms", "nptdms", "npTDMS"), (".uff", "pyuff", "pyuff"), (".mf4", "asammdf", "asammdf")],
)
def test_a_library_that_is_missing(tmp_path, monkeypatch, suffix, module, package):
    (tmp_path / f"data{suffix}").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, module, None)
    text = refusal(tmp_path / f"data{suffix}", channels=["acc"])
    assert f"requires {package}, which is not installed" in text
    assert 'pip install "hums-toolkit[readers]"' in text


def test_a_compressed_variable_of_a_mat_file_is_bounded(tmp_path):
    # a tag of 2 GB in a file of 200 bytes: scipy would unpack whatever follows
    tag = struct.pack("<2I", 14, 2_000_000_000)
    packed = zlib.compress(tag + bytes(1000))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    (tmp_path / "bomb.mat").write_bytes(header + struct.pack("<2I", 15, len(packed)) + packed)
    with pytest.raises(
        RecordError, match=r"bomb\.mat: a compressed variable declares 2e\+09 bytes .* at most 6\.71e\+07"
    ):
        read_file(tmp_path / "bomb.mat")
    savemat(tmp_path / "fine.mat", {"a": np.ones(9), "box": {"b": np.arange(5.0)}}, do_compression=True)
    with pytest.raises(RecordError, match="most_bytes"):
        read_file(tmp_path / "fine.mat", most_bytes=50)
    assert read_file(tmp_path / "fine.mat").vector("box.b").tolist() == [0, 1, 2, 3, 4]
