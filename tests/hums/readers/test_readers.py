"""Other people's files: what each format holds, what a user has to declare, and the sentence for each mistake."""

import struct

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat, wavfile
from scipy.sparse import eye_array

from hums.readers import convert, read_file
from hums.records.channels import nominal_speed, sampling, tachometers, vibration_channels
from hums.records.fields import RecordError, RecordWarning
from hums.records.store import open_record, save_record
from hums.records.validation import check_record

RATE_HZ = 1000.0
NOISE = np.random.default_rng(3).normal(size=2000)
PULSES_S = np.arange(0.05, 2, 0.1)
ANGLE = {"tach_times": "tach", "pulses_per_rev": 2, "shaft": "high speed"}
NOMINAL = {"shaft_rpm": 1500.0, "shaft": "input"}


@pytest.fixture
def classic(tmp_path):
    """A MATLAB file of version 5."""
    contents = {
        "vibration": NOISE[:, None],
        "row": NOISE[None, :],
        "tach": PULSES_S[:, None],
        "wave": np.sin(2 * np.pi * 7.3 * np.arange(2000) / RATE_HZ),
        "bearing": {"gs": NOISE, "sr": RATE_HZ, "housing": {"top": NOISE + 1}, "label": "front"},
        "counts": np.arange(2000, dtype=np.int16),
        "table": np.zeros((2000, 3)),
        "notes": "read me",
        "cells": np.array([NOISE, "x"], dtype=object),
        "many": np.array([(1,), (2,)], dtype=[("a", object)]),
        "sparse": eye_array(4).tocsc(),
        "waves": NOISE + 1j,
        "nothing": np.zeros((0, 0)),
    }
    savemat(tmp_path / "data.mat", contents, oned_as="column")
    return tmp_path / "data.mat"


@pytest.fixture
def modern(tmp_path):
    """A MATLAB file of version 7.3 with the layout MATLAB gives it: a header of 512 bytes, axes reversed."""
    with h5py.File(tmp_path / "data.mat", mode="w", userblock_size=512) as file:

        def add(name, values, matlab_class):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_(matlab_class)

        add("vibration", NOISE[None, :], "double")
        add("row", NOISE[:, None].astype(np.float32), "single")
        add("tach", PULSES_S[None, :], "double")
        add("bearing/gs", NOISE[None, :], "double")
        add("bearing/housing/top", NOISE[None, :] + 1, "double")
        add("counts", np.arange(2000, dtype=np.int16)[None, :], "int16")
        add("table", np.zeros((3, 2000)), "double")
        add("notes", np.array([[114], [101]], dtype=np.uint16), "char")
        add("#refs#/a", NOISE, "double")
        add("cells", np.array([file["#refs#/a"].ref], dtype=h5py.ref_dtype), "cell")
        file["many/a"] = np.array([file["#refs#/a"].ref] * 2, dtype=h5py.ref_dtype)
        file["waves"] = np.zeros(5, dtype=[("real", "f8"), ("imag", "f8")])
        add("nothing", np.zeros(2, dtype=np.uint64), "double")
        file["nothing"].attrs["MATLAB_empty"] = np.uint8(1)
        file["sparse/data"], file["sparse/ir"], file["sparse/jc"] = np.ones(4), np.arange(4), np.arange(5)
        file["sparse"].attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_sparse": np.uint64(4)})
    with (tmp_path / "data.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return tmp_path / "data.mat"


@pytest.fixture(params=["classic", "modern"])
def mat(request):
    return request.getfixturevalue(request.param)


def read(source, **changes):
    arguments = {"channels": ["vibration"], "rate_hz": RATE_HZ, "units": "g"} | changes
    if not {"tach_times", "tach_waveform", "shaft_rpm"} & arguments.keys():
        arguments = NOMINAL | arguments
    return convert(source, **arguments)


def refusal(source, **changes):
    with pytest.raises(RecordError) as caught:
        read(source, **changes)
    return str(caught.value)


# ---- MATLAB ------------------------------------------------------------------------------------------------


def test_a_mat_file_to_a_record_on_disk(mat, tmp_path):
    record = read(mat, machine="turbine 4", regime="hover", recorded_at="2013-03-11T03:00:24Z", **ANGLE)
    check_record(record)
    assert_array_equal(record["vibration"], NOISE)
    assert_array_equal(record["tachometer"], PULSES_S)
    assert record["tachometer"].attrs == {"units": "s", "shaft": "high speed", "pulses_per_rev": 2}
    assert record["vibration"].attrs["units"] == "g"
    assert (record.attrs["machine"], record.attrs["regime"]) == ("turbine 4", "hover")
    assert record.attrs["source"] == "data.mat"
    save_record(record, tmp_path / "record.h5")
    with open_record(tmp_path / "record.h5") as opened:
        assert opened.load().identical(record)


def test_rows_columns_and_fields_of_structs(mat):
    record = read(mat, channels=["row", "bearing.gs", "bearing.housing.top", "counts"])
    assert vibration_channels(record) == ["row", "bearing.gs", "bearing.housing.top", "counts"]
    assert_allclose(record["row"], NOISE, rtol=1e-7)  # single precision in the modern file
    assert_array_equal(record["bearing.gs"], NOISE)
    assert_array_equal(record["bearing.housing.top"], NOISE + 1)
    assert_array_equal(record["counts"], np.arange(2000))
    assert record["counts"].dtype == np.float64


def test_a_waveform_in_the_file(classic):
    record = read(classic, tach_waveform="wave", pulses_per_rev=1, shaft="input")
    assert tachometers(record) == ["tachometer"]
    # A sine at 7.3 Hz rises through its middle every 1 / 7.3 s, interpolation errs by far less than a sample.
    assert_allclose(record["tachometer"], np.arange(1, 15) / 7.3, rtol=0, atol=0.01 / RATE_HZ)


def test_scale_turns_volts_into_units(mat):
    assert_array_equal(read(mat, scale={"vibration": 9.81}, units="m/s^2")["vibration"], NOISE * 9.81)


def test_a_channel_that_is_not_there(mat):
    text = refusal(mat, channels=["vibratoin"])
    assert "data.mat has no \"vibratoin\". Did you mean 'vibration'?" in text
    assert "vibration (2000 x 1)" in text
    assert "table (2000 x 3)" in text
    assert "bearing.housing.top (" in text
    assert "notes (text)" in text


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"channels": ["notes"]}, '"notes" is text, not numbers'),
        ({"channels": ["cells"]}, '"cells" is a cell array, not numbers'),
        ({"channels": ["waves"]}, '"waves" is complex numbers'),
        ({"channels": ["nothing"]}, '"nothing" is empty'),
        ({"channels": ["sparse"]}, '"sparse" is a sparse matrix'),
        ({"channels": ["table"]}, '"table" is a table of 2000 x 3 values'),
        ({"channels": []}, "--channel"),
        ({"shaft_rpm": 1500.0, "shaft": None}, "shaft_rpm needs the shaft"),
        ({"pulses_per_rev": 1}, "no meaning with shaft_rpm"),
    ],
)
def test_what_is_no_channel_rate_scale_or_speed(mat, changes, what):
    assert what in refusal(mat, **changes)


@pytest.mark.parametrize("version", ["classic", "7.3"])
def test_an_element_of_a_struct_array(tmp_path, version):
    """As in the files of the Paderborn bearing data: K001.Y(2).Data, named by .Name."""
    path, names = tmp_path / "K001.mat", ("force", "vibration_1")
    if version == "classic":
        channels = np.array([(name, NOISE + k) for k, name in enumerate(names)], dtype=[("Name", "O"), ("Data", "O")])
        savemat(path, {"K001": {"Y": channels}})
    else:
        with h5py.File(path, "w") as file:
            for k, name in enumerate(names):
                file[f"#refs#/data{k}"] = NOISE[:, None] + k
                file[f"#refs#/name{k}"] = np.array([[ord(letter)] for letter in name], dtype=np.uint16)
                file[f"#refs#/name{k}"].attrs["MATLAB_class"] = np.bytes_("char")
            for field in ("data", "name"):
                references = [[file[f"#refs#/{field}{k}"].ref] for k in range(2)]
                file.create_dataset(f"K001/Y/{field.title()}", data=references, dtype=h5py.ref_dtype)
    for asked in ("K001.Y(2).Data", "Y(2).Data", "vibration_1"):
        record = read(path, channels=[asked])
        assert vibration_channels(record) == [asked]
        assert_array_equal(record[asked], NOISE + 1)


@pytest.mark.parametrize(
    ("matlab_class", "what"),
    [("string", "a string object"), ("datetime", "a datetime"), ("function_handle", "a function")],
)
def test_objects_of_version_7_3_are_not_taken_for_their_keys(modern, matlab_class, what):
    with h5py.File(modern, mode="r+") as file:
        file["thing"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32)  # what MATLAB writes for an object
        file["thing"].attrs["MATLAB_class"] = np.bytes_(matlab_class)
        file["thing"].attrs["MATLAB_object_decode"] = np.int32(3)
    assert f'"thing" is {what}, not numbers' in refusal(modern, channels=["thing"])


def test_truth_values_are_numbers_in_either_version(classic, modern):
    pulses = (np.arange(2000) % 100 < 10)[:, None]
    savemat(classic, {"wave": pulses, "vibration": NOISE})
    first = read(classic, tach_waveform="wave", pulses_per_rev=1, shaft="input")
    with h5py.File(modern, mode="w") as file:
        file["wave"], file["vibration"] = pulses.T.astype(np.uint8), NOISE[None, :]
        file["wave"].attrs["MATLAB_class"] = np.bytes_("logical")
        file["wave"].attrs["MATLAB_int_decode"] = np.int32(1)
    second = read(modern, tach_waveform="wave", pulses_per_rev=1, shaft="input")
    rises_s = np.arange(100, 2000, 100) / RATE_HZ - 0.5 / RATE_HZ  # half-way between low and high
    for record in (first, second):
        assert_allclose(record["tachometer"], rises_s, rtol=1e-12)


# ---- what the user declares --------------------------------------------------------------------------------


def test_undeclared_rate_units_and_angle(mat):
    assert "does not state its sampling rate: rate_hz=... (--rate-hz)" in refusal(mat, rate_hz=None)
    assert "--units g" in refusal(mat, units=None)
    text = refusal(mat, shaft_rpm=None, shaft=None)
    for option in ("--tach-times", "--tach-waveform", "--shaft-rpm"):
        assert option in text


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"shaft": None}, "tach_times needs the shaft"),
        ({"pulses_per_rev": None}, 'the tachometer "tach" needs its pulses per revolution of "high speed"'),
        ({"tach_waveform": "wave"}, "tach_times and tach_waveform: the shaft angle has a single source"),
        ({"shaft_rpm": 1500.0}, "tach_times and shaft_rpm: the shaft angle has a single source"),
        ({"tach_times": "tacho"}, "Did you mean 'tach'?"),
        ({"tach_times": "row"}, "--tach-waveform"),
        ({"pulses_per_rev": 0}, "pulses_per_rev = 0"),
        ({"threshold": 2.0}, "threshold = 2 needs a tach_waveform"),
    ],
)
def test_mistakes_about_the_tachometer(mat, changes, sentence):
    assert sentence in refusal(mat, **(ANGLE | changes))


# ---- WAV ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dtype", "full_scale", "middle"),
    [("u1", 128, 128), ("i2", 2**15, 0), ("i4", 2**31, 0), ("f4", 1, 0), ("f8", 1, 0)],
)
def test_full_scale_of_a_wav_is_what_scale_says(tmp_path, dtype, full_scale, middle):
    wanted = np.array([-1, -0.5, 0, 0.5])
    wavfile.write(tmp_path / "a.wav", 48000, (wanted * full_scale + middle).astype(dtype))
    record = read(tmp_path / "a.wav", channels=["channel 1"], rate_hz=None, scale={"channel 1": 50.0})
    assert_array_equal(record["channel 1"], 50 * wanted)
    assert record.attrs["rate_hz"] == 48000


def test_24_bits(tmp_path):
    samples = b"".join(struct.pack("<i", value)[:3] for value in (-(2**23), -(2**22), 0, 2**22))
    header = struct.pack("<4sI4s4sIHHIIHH", b"RIFF", 36 + 12, b"WAVE", b"fmt ", 16, 1, 1, 8000, 24000, 3, 24)
    (tmp_path / "a.wav").write_bytes(header + struct.pack("<4sI", b"data", len(samples)) + samples)
    record = read(tmp_path / "a.wav", channels=["channel 1"], rate_hz=None)
    assert_array_equal(record["channel 1"], [-1, -0.5, 0, 0.5])


def test_several_channels_of_a_wav(tmp_path):
    wave = np.sin(2 * np.pi * 5 * np.arange(8000) / 8000)
    wavfile.write(tmp_path / "A.WAV", 8000, np.column_stack([np.zeros(8000), wave]).astype(np.float32))
    record = read(
        tmp_path / "A.WAV",
        channels=["channel 1"],
        rate_hz=8000,
        tach_waveform="channel 2",
        pulses_per_rev=1,
        shaft="input",
    )
    assert vibration_channels(record) == ["channel 1"]
    assert_array_equal(record["tachometer_waveform"], wave.astype(np.float32))
    assert "channel 2 (8000)" in refusal(tmp_path / "A.WAV", channels=["channel 3"], rate_hz=None)


def test_a_rate_that_contradicts_the_wav(tmp_path):
    wavfile.write(tmp_path / "a.wav", 97656, np.zeros(100, dtype=np.int16))
    text = refusal(tmp_path / "a.wav", channels=["channel 1"], rate_hz=48000)
    assert "rate_hz=48000 contradicts a.wav, which states 97656 Hz" in text
    # The header holds whole numbers only: a fraction it dropped can be put back.
    assert sampling(read(tmp_path / "a.wav", channels=["channel 1"], rate_hz=97656.25), "channel 1").rate_hz == 97656.25


# ---- CSV ---------------------------------------------------------------------------------------------------


def write(tmp_path, text, encoding="utf-8"):
    (tmp_path / "a.csv").write_text(text, encoding=encoding)
    return tmp_path / "a.csv"


@pytest.mark.parametrize(
    "text",
    [
        "time,acc\n0,1.5\n1,-2\n2,1e3\n",
        "time, acc\r\n0, 1.5\r\n1, -2\r\n2, 1e3\r\n",
        "\ntime;acc\n0;1,5\n\n1;-2\n2;1e3\n",
        "time;acc\n0;1.5\n1;-2\n2;1e3\n",
        "time\tacc\n0\t1.5\n1\t-2\n2\t1e3",
        '"time","acc"\n"0","1.5"\n"1","-2"\n"2","1e3"\n',
    ],
)
def test_a_csv_with_a_header(tmp_path, text):
    fields = read_file(write(tmp_path, text, "utf-8-sig" if text[0] == '"' else "utf-8")).fields
    assert list(fields) == ["time", "acc"]
    assert_array_equal(fields["acc"], [1.5, -2, 1000])


@pytest.mark.parametrize(
    "text",
    ["0,1.5\n1,-2\n", "0,1;1,5\n1;-2\n", ",1.5\n1,-2\n", "0\t1.5\n1\t-2\n"],
)
def test_a_csv_without_a_header(tmp_path, text):
    record = read(write(tmp_path, text), channels=["column 2"])
    assert_array_equal(record["column 2"], [1.5, -2])


def test_a_single_column(tmp_path):
    assert_array_equal(read(write(tmp_path, "acc\n1\n2\n"), channels=["acc"])["acc"], [1, 2])
    assert_array_equal(read(write(tmp_path, "1\n2\n"), channels=["column 1"])["column 1"], [1, 2])


def test_a_short_column_of_pulse_times_is_padded_with_blanks(tmp_path):
    rows = [f"{value!r},{0.002 * k + 0.001 if k < 5 else ''}" for k, value in enumerate(NOISE[:50].tolist())]
    path = write(tmp_path, "acc,tach\n" + "\n".join(rows) + "\n")
    record = read(path, channels=["acc"], **ANGLE)
    assert_allclose(record["tachometer"], [0.001, 0.003, 0.005, 0.007, 0.009])
    assert_array_equal(record["acc"], NOISE[:50])


def test_a_blank_line_among_the_samples_of_a_single_column_is_not_skipped(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("DE (g)\n1.5\n2.5\n\n3.5\n4.5\n")
    with pytest.raises(RecordError, match="line 4 is blank"):
        read_file(path)
    path.write_text("DE (g)\n\n1.5\n\n2.5\n\n3.5\n\n\n")  # alternating, and at the end
    assert read_file(path).fields["DE"].tolist() == [1.5, 2.5, 3.5]


def test_a_blank_among_the_pulse_times_is_no_padding(tmp_path):
    path = write(tmp_path, "acc,tach\n1,0.001\n2,\n3,0.002\n")
    assert "pulse 1 is at nan" in refusal(path, channels=["acc"], **ANGLE)


def test_a_column_of_text(tmp_path):
    path = write(tmp_path, "acc,state\n1,ok\n2,ok\n")
    assert '"state" is text, "ok" in line 2, not numbers' in refusal(path, channels=["state"])
    path = write(tmp_path, "acc\n1\n2\nOVLD\n")
    assert '"acc" is text, "OVLD" in line 4' in refusal(path, channels=["acc"])


def test_truth_values_are_text(tmp_path):
    for cells in ("True\nFalse", "True\n"):  # alone, and with a blank
        path = write(tmp_path, f"state,acc\n{cells.replace(chr(10), ',1' + chr(10))},2\n")
        assert '"state" is text, "True" in line 2' in refusal(path, channels=["state"], scale={"state": 2.0})


def test_two_columns_of_one_name(tmp_path):
    assert 'two columns are named "acc"' in refusal(write(tmp_path, "acc,acc \n1,2\n"), channels=["acc"])


@pytest.mark.parametrize("name", ["t", "Zeit (s)", "T"])
def test_a_column_of_times_that_contradicts_the_rate(tmp_path, name):
    rows = "".join(f"{0.5 + k / 512:.3f},{k}\n" for k in range(1000))  # printed to half a step
    path = write(tmp_path, f"{name},acc\n{rows}")
    for rate_hz in (5120, 515):
        text = refusal(path, channels=["acc"], rate_hz=rate_hz)
        assert f'rate_hz={rate_hz} contradicts a.csv, whose "{name}" goes in steps of 0.00195312 s, 512.00' in text
    # The times are known to a millisecond, in two seconds a rate is known to 0.05 %.
    assert read(path, channels=["acc"], rate_hz=512.1).attrs["rate_hz"] == 512.1
    assert sampling(read(path, channels=["acc"], rate_hz=512), "acc").start_s == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("time", [0, 0, 0, 0, 0, 0]),
        ("T", [20.5, 20.1, 20.7, 20.2, 20.3, 20.9]),  # a torque or a temperature
        ("time [ms]", ["", 1, 2, 3, 4, 5]),
        ("timer", range(6)),
    ],
)
def test_columns_that_contradict_no_rate(tmp_path, name, times):
    path = write(tmp_path, f"{name},acc\n" + "".join(f"{time},{k}\n" for k, time in enumerate(times)))
    assert_array_equal(read(path, channels=["acc"])["acc"], range(6))


@pytest.mark.parametrize(
    ("name", "text", "names", "units"),
    [
        # what a logger writes above: a title, settings of two cells, blank lines
        ("a.csv", "Title\nSerial,5120\n\nDE,NDE\n{}", ["DE", "NDE"], None),
        ("a.csv", "Title;x\nSerial;5120;x\n{}", ["column 1", "column 2"], None),
        ("a.csv", "Title\nDE,NDE\n(g),g\n{}", ["DE", "NDE"], "g"),
        ("a.csv", "DE,NDE\n[m/s2],[m/s2]\n{}", ["DE", "NDE"], "m/s2"),
        ("a.csv", "front bearing,rear bearing\n{}", ["front bearing", "rear bearing"], None),
        ("a.txt", "{}", ["column 1", "column 2"], None),
        ("a.asc", "front rear\n{}", ["front", "rear"], None),
        ("2003.10.22.12.06.24", "{}", ["column 1", "column 2"], None),
    ],
)
def test_tables_as_loggers_write_them(tmp_path, name, text, names, units):
    separator = "," if name.endswith("csv") else "  "
    path = tmp_path / name
    path.write_text(text.format("".join(f"{k}{separator}{-k / 2}\n" for k in range(50))))
    found = read_file(path)
    assert list(found.fields) == names
    assert_array_equal(found.fields[names[1]], -np.arange(50) / 2)
    assert {one.units for one in found.stated.values()} == ({units} if units else set())


def test_a_column_of_speeds_and_a_stated_rate_that_its_times_contradict(tmp_path):
    rows = "".join(f"{k / 1000:.3f};{k / 8:.3f};1485.0\n".replace(".", ",") for k in range(2000))
    path = write(tmp_path, f"Sampling rate [kHz];1\nZeit (s);DE;Drehzahl\n;g;rpm\n{rows}")
    record = convert(path, channels=["DE"], speed_column="Drehzahl", shaft="input")
    assert float(nominal_speed(record)) == pytest.approx(1485 / 60)
    write(tmp_path, path.read_text().replace("[kHz];1\n", "[kHz];2\n"))
    assert "states 2000 Hz, but" in refusal(path, channels=["DE"], rate_hz=None, units=None)


@pytest.mark.parametrize("text", ["acc,b\n1,2\n3\n4,5\n", "acc;b\n1;2\n\n3\n4;5\n", '"acc","b"\n"1","2"\n"3"\n'])
def test_short_rows_are_refused(tmp_path, text):
    line = text.replace('"', "").split("\n").index("3") + 1
    text = refusal(write(tmp_path, text), channels=["acc"])
    assert f"the row in line {line} has 1 of 2 cells" in text


@pytest.mark.parametrize("text", ["acc,b\n1,2,3\n4,5,6\n", "acc,b\n1,2\n4,5,6\n", "\n\n", "acc,b\n"])
def test_what_is_no_table(tmp_path, text):
    text = refusal(write(tmp_path, text), channels=["acc"])
    assert "a.csv is not a text table, or is damaged" in text or '"acc" is empty, not numbers' in text
    assert "\n" not in text


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "utf-8", "utf-16", "utf-16-be"])
def test_a_header_states_units_in_any_encoding(tmp_path, encoding):
    path = write(tmp_path, "Gehäuse [m/s²],b\n1,2\n3,4\n", encoding)
    record = read(path, channels=["Gehäuse"], units=None)
    assert record["Gehäuse"].attrs["units"] == "m s-2"
    assert_array_equal(record["Gehäuse"], [1, 3])


@pytest.mark.parametrize(
    "line",
    [
        "Sample rate, 25600, Hz",
        "# fs = 25600",
        "Sampling frequency: 25.6 kHz",
        '"dt [ms]";0,0390625',
        "Delta_X\t3.90625E-5",
    ],
)
def test_lines_above_a_table_state_its_rate(tmp_path, line):
    path = write(tmp_path, f"Logger\n{line}\nDE,ND\n" + "1,2\n" * 9)
    assert read(path, channels=["DE"], rate_hz=None).attrs["rate_hz"] == 25600
    assert "which states 25600 Hz" in refusal(path, channels=["DE"], rate_hz=25000)


@pytest.mark.parametrize("line", ["Sample rate: 25,600 Hz", "Ts: 1700000000", "Rate of the shaft: 25", "fs: fast"])
def test_lines_above_a_table_that_state_no_rate(tmp_path, line):
    path = write(tmp_path, f"Logger\n{line}\nDE,ND\n" + "1,2\n" * 9)
    assert "does not state its sampling rate" in refusal(path, channels=["DE"], rate_hz=None)


@pytest.mark.parametrize(
    ("cells", "value"),
    [
        ("0,5;1.485", 1485),
        ("0.5;1,485", 1485),
        ("0.5;1,485.25", 1485.25),
        ("0.5;1'485", 1485),
        ("1.234.567;1.485", 1485),
        ("0.5;1.485", 1.485),
        ("0,5;1,485", 1.485),
        ('0.5,"1,485"', 1485),
        ("1,1.485", 1.485),  # commas separate the cells
        ("0,5 1.485", 1485),
    ],
)
def test_one_sign_is_decimal_in_the_whole_file(tmp_path, cells, value):
    # Numbers without a sign come first, more than the lines from which the format is detected.
    separator = next(sign for sign in ";, " if sign in cells and (sign != "," or ";" not in cells))
    separator = " " if cells == "0,5 1.485" else separator
    plain = f"7{separator}8\n" * 200
    path = write(tmp_path, f"a{separator}b\n{plain}{cells}\n")
    assert_array_equal(read_file(path).fields["b"], [8] * 200 + [value])


def test_a_sign_that_may_be_either_is_refused(tmp_path):
    path = write(tmp_path, "a;b\n7;8\n1;1.485\n")
    with pytest.raises(RecordError, match=r'"1\.485" may have a decimal sign'):
        read_file(path)
    assert read_file(path, decimal=".").fields["b"][1] == 1.485
    assert read_file(path, decimal=",").fields["b"][1] == 1485


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF])
def test_a_wav_whose_recorder_wrote_no_sizes(tmp_path, size):
    wavfile.write(tmp_path / "a.wav", 8000, np.arange(100, dtype=np.int16))
    data = bytearray((tmp_path / "a.wav").read_bytes())
    data[4:8] = data[40:44] = struct.pack("<I", size)
    (tmp_path / "a.wav").write_bytes(data)
    with pytest.warns(RecordWarning, match="read to the end of the file"):
        record = read(tmp_path / "a.wav", channels=["1"], rate_hz=None)
    assert_array_equal(record["channel 1"] * 2**15, range(100))
    assert "its header states no length" in record.attrs["notes"]


# ---- any file ----------------------------------------------------------------------------------------------


def test_unknown_suffixes(tmp_path):
    (tmp_path / "data.xls").write_bytes(b"xls")
    assert 'no reader for the suffix ".xls"; supported are .mat, .wav, .csv' in refusal(tmp_path / "data.xls")
    (tmp_path / "data").write_bytes(b"x")
    assert 'no reader for the suffix ""' in refusal(tmp_path / "data")


@pytest.mark.parametrize("suffix", [".mat", ".wav", ".csv"])
def test_files_that_are_not_there(tmp_path, suffix):
    assert "there is no such file" in refusal(tmp_path / f"none{suffix}")
    (tmp_path / f"empty{suffix}").touch()
    assert "is empty" in refusal(tmp_path / f"empty{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    assert "is a directory" in refusal(tmp_path / f"folder{suffix}")


@pytest.mark.parametrize("suffix", [".mat", ".wav", ".tdms", ".uff", ".h5", ".lvm"])
def test_a_wrong_suffix(tmp_path, suffix):
    (tmp_path / f"data{suffix}").write_bytes(b"time,acc\n0,1\n" * 50)
    assert f"data{suffix} is no" in refusal(tmp_path / f"data{suffix}")
