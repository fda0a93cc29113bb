"""The store: what is read is what was written, a file is whole or not there, and damage is never silent."""

import os
import shutil
import stat
import subprocess
import sys
import tracemalloc
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from xarray.indexes import RangeIndex

from hums.records.channels import channel_values
from hums.records.fields import RecordError
from hums.records.outputs import atomic_write
from hums.records.quantities import AngularAverage
from hums.records.record import Channel, NominalSpeed, PulseTimes, TachometerWaveform, UnknownAngle, make_record
from hums.records.snapshots import join_snapshots
from hums.records.store import existing_file, is_hdf5, open_hdf5, open_record, open_tree, save_record

COUNT = 150_000  # more than one chunk
NOISE = np.random.default_rng(11).normal(size=COUNT)
TONE = np.sin(2 * np.pi * 20 * np.arange(COUNT) / 50_000)
REVOLUTION = {"component": "input", "samples_per_rev": 512}


def build(**changes):
    arguments = {
        "rate_hz": 50_000.0,
        "angle": PulseTimes(times_s=np.arange(0.01, 3, 0.04), shaft="high speed", pulses_per_rev=2),
        "machine": "Türbine 4",
        "recorded_at": datetime(2024, 5, 1, 12, tzinfo=UTC),
        "start_s": 0.5e-3,
        "truth": {
            "truth_phase": xr.DataArray(np.linspace(0, 300, COUNT), dims="time", attrs={"units": "rad"}),
            "truth_depth": xr.DataArray([0.5, np.nan], dims="fault", coords={"fault": ["riß", "spall"]}),
            "truth_line": xr.DataArray([1 + 2j], dims="line"),
            "truth_struck": xr.DataArray([True, False, True], dims="tooth"),
            "truth_teeth": xr.DataArray([21, -93], dims="gear"),
        },
    }
    channels = {
        "case": Channel(values=NOISE, units="g", sensor="A1", direction=(0, 0, 1)),
        "single": Channel(values=NOISE.astype(np.float32), units="mm s-1", direction="radial"),
        "fast": Channel(values=NOISE, units="m s-2", rate_hz=100_000),
    }
    return make_record(channels, **(arguments | changes))


@pytest.fixture(scope="module")
def record():
    return build()


@pytest.fixture(scope="module")
def written(record, tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "record.h5"
    save_record(record, path)
    return path


@pytest.fixture
def path(written, tmp_path):
    """A copy that a test may spoil."""
    return Path(shutil.copy(written, tmp_path / "record.h5"))


def refusal(action, *arguments):
    with pytest.raises(RecordError) as caught:
        action(*arguments)
    return str(caught.value)


# ---- there and back ----------------------------------------------------------------------------------------


KINDS = {
    "pulses, truth, a channel at its own rate": build,
    "declared speed": lambda: build(angle=NominalSpeed(rpm=1000, shaft="input")),
    "unknown angle": lambda: build(angle=UnknownAngle()),
    "waveform": lambda: build(angle=TachometerWaveform(values=TONE, shaft="input", pulses_per_rev=1)),
    "average": lambda: make_record({"a": NOISE[:1024]}, units="g", angle=AngularAverage(**REVOLUTION)),
    "snapshots": lambda: join_snapshots([build(truth=None, recorded_at=f"2024-05-0{day}T00:00:00Z") for day in (1, 2)]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_read_is_what_was_written_by_xarray_alone_too(kind, tmp_path):
    record = KINDS[kind]()
    save_record(record, tmp_path / "record.h5")
    with open_record(tmp_path / "record.h5") as opened:
        assert all(isinstance(opened.xindexes[axis], RangeIndex) for axis in ("time", "angle") if axis in opened.dims)
        xr.testing.assert_identical(opened.load(), record)
    with xr.open_dataset(tmp_path / "record.h5", engine="h5netcdf") as plain:
        xr.testing.assert_identical(plain.drop_attrs(deep=True), record.drop_attrs(deep=True))
        assert plain.attrs == record.attrs
        units = {"time": "s", "time_fast": "s", "angle": "revolutions"}
        assert all(plain[axis].units == units[axis] for axis in units if axis in plain.dims)


@pytest.mark.parametrize("rate_hz", [25_600.0, 12_345.67])
def test_h5py_reads_seconds_which_cost_next_to_no_space(tmp_path, rate_hz):
    count = 1_000_000
    values = np.random.default_rng(0).normal(size=count)
    long = make_record({"a": values}, rate_hz=rate_hz, units="g", angle=UnknownAngle(), start_s=0.25)
    save_record(long, tmp_path / "record.h5")
    with h5py.File(tmp_path / "record.h5") as file:
        np.testing.assert_allclose(file["time"][:], 0.25 + np.arange(count) / rate_hz, rtol=1e-14)
        np.testing.assert_array_equal(file["a"][:], values)
    assert (tmp_path / "record.h5").stat().st_size < 1.07 * values.nbytes


def test_opening_costs_no_memory_for_samples(tmp_path):
    count = 2_000_000
    large = make_record(
        {"case": np.broadcast_to(1.0, count)},
        rate_hz=50_000.0,
        units="g",
        angle=NominalSpeed(rpm=1000, shaft="input"),
    )
    save_record(large, tmp_path / "large.h5")
    del large
    open_record(tmp_path / "large.h5").close()  # what the first opening imports is not counted
    tracemalloc.start()
    try:
        with open_record(tmp_path / "large.h5") as opened:
            assert opened["case"].isel(time=slice(-10, None)).to_numpy().tolist() == [1.0] * 10
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8 * count / 10  # a tenth of the samples, and of the time axis


def test_attributes_that_netcdf_lacks(tmp_path):
    attrs = {
        "long": "é" * 200_000,
        "nothing": None,
        "yes": True,
        "no": np.False_,
        "moment": datetime(2024, 5, 1, tzinfo=UTC),
        "words": ("a", "b"),
        "flags": np.array([True, False]),
    }
    save_record(build(attrs=attrs), tmp_path / "record.h5")
    with open_record(tmp_path / "record.h5") as opened:
        assert opened.attrs["long"] == attrs["long"]
        assert "nothing" not in opened.attrs
        assert opened.attrs["yes"] == 1
        assert opened.attrs["no"] == 0
        assert opened.attrs["moment"] == "2024-05-01T00:00:00+00:00"
        assert opened.attrs["words"] == ["a", "b"]
        assert list(opened.attrs["flags"]) == [1, 0]


@pytest.mark.parametrize("value", [{"a": 1}, object(), "a\0b", 1j, [1, "a", None]])
def test_attributes_that_no_file_holds(tmp_path, value):
    assert 'attribute "odd"' in refusal(save_record, build(attrs={"odd": value}), tmp_path / "record.h5")
    assert list(tmp_path.iterdir()) == []


# ---- whole or not there ------------------------------------------------------------------------------------


def interrupted(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("where", ["pathlib.Path.replace", "h5py.Group.create_dataset"])
def test_an_interrupted_write_leaves_the_old_file_whole(record, path, monkeypatch, where):
    before = path.read_bytes()
    monkeypatch.setattr(where, interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_record(record, path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


FULL_DISK = """
import os, resource, sys
import numpy as np
from hums.records.record import NominalSpeed, make_record
from hums.records.store import save_record
record = make_record({"a": np.ones(400_000)}, rate_hz=1000, units="g", angle=NominalSpeed(rpm=1, shaft="s"))
for limit in sys.argv[1:]:
    os.mkdir(limit)
    if not (child := os.fork()):
        os.chdir(limit)
        save_record(record.isel(time=slice(10)), "record.h5")
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), resource.RLIM_INFINITY))
        try:
            save_record(record, "record.h5")
        except OSError as error:
            print(limit, os.listdir(), flush=True)
        os._exit(0)  # what HDF5 makes of its unfinished file when the program ends is not our matter
    os.waitpid(child, 0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files as Linux does")
def test_a_disk_that_is_full_leaves_the_old_file_whole(tmp_path):
    pytest.importorskip("resource")
    limits = ["5000", "1000000", "3202000"]  # in the header, the samples, the last flush
    words = [sys.executable, "-c", FULL_DISK, *limits]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.stdout.splitlines() == [f"{limit} ['record.h5']" for limit in limits], done.stderr
    for limit in limits:
        with open_record(tmp_path / limit / "record.h5") as opened:
            assert opened["a"].to_numpy().tolist() == [1.0] * 10


def test_a_link_goes_on_pointing(record, path, tmp_path):
    link = tmp_path / "link.h5"
    link.symlink_to(path)
    save_record(record.isel(time=slice(10)), link)
    assert link.is_symlink()
    with open_record(path) as opened:
        assert opened.sizes["time"] == 10


@pytest.mark.skipif(os.name != "posix", reason="other systems have other rights")
def test_a_file_has_the_rights_of_any_new_file(written, tmp_path):
    (tmp_path / "plain").touch()
    assert stat.S_IMODE(written.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_where_nothing_can_be_written(record, tmp_path):
    assert "schema" in refusal(save_record, record.drop_attrs(), tmp_path / "record.h5")
    assert "is a directory" in refusal(save_record, record, tmp_path)
    assert "there is no directory" in refusal(save_record, record, tmp_path / "none" / "record.h5")


# ---- what is not a record ----------------------------------------------------------------------------------


@pytest.mark.parametrize("action", [open_record, open_tree, open_hdf5, existing_file])
def test_what_is_not_there(action, tmp_path):
    assert "there is no such file" in refusal(action, tmp_path / "none.h5")
    assert "is a directory" in refusal(action, tmp_path)
    (tmp_path / "empty.h5").touch()
    assert "is empty" in refusal(action, str(tmp_path / "empty.h5"))


@pytest.mark.parametrize("action", [open_record, open_tree, open_hdf5])
def test_what_is_not_hdf5(action, tmp_path):
    (tmp_path / "data.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(500))
    text = refusal(action, tmp_path / "data.mat")
    assert "is not an HDF5 file" in text
    assert "hums convert data.mat record.h5" in text
    assert not is_hdf5(tmp_path / "data.mat")


@pytest.mark.parametrize(
    ("schema", "said"),
    [
        *((schema, "not hums-record/2 of a record") for schema in (1.0, ["hums-record/2", "x"], "hums-record/1")),
        ("hums-shard/1", "use hums.open_dataset(folder)"),
    ],
)
def test_a_schema_of_something_else_or_of_an_older_layout(tmp_path, schema, said):
    with h5py.File(tmp_path / "other.h5", mode="w") as file:
        file.attrs["schema"] = schema
    assert said in refusal(open_record, tmp_path / "other.h5")


def test_hdf5_that_is_not_ours(tmp_path):
    with h5py.File(tmp_path / "other.h5", mode="w") as file:
        file["vibration"] = np.zeros(10)
    assert "hums convert other.h5" in refusal(open_record, tmp_path / "other.h5")


@pytest.mark.filterwarnings("ignore::hums.records.fields.RecordWarning")
def test_a_record_that_lost_a_part_names_its_file(path):
    with h5py.File(path, mode="r+") as file:
        del file["tachometer"]
    text = refusal(open_record, path)
    assert text.startswith(f"{path}: angle: this record has no source of shaft angle")
    with h5py.File(path, mode="r+") as file:
        del file.attrs["rate_hz"]
    assert "rate_hz=None" in refusal(open_record, path)


# ---- damage ------------------------------------------------------------------------------------------------


def test_samples_that_the_index_of_a_file_has_lost_are_refused(tmp_path):
    path = tmp_path / "record.h5"
    save_record(make_record({"a": Channel(values=np.ones(64), units="g")}, rate_hz=100.0, angle=UnknownAngle()), path)
    with h5py.File(path, "r+") as contents:  # as a damaged index does, an array of the same shape that has no chunk
        old, attrs = contents["a"], dict(contents["a"].attrs)
        layout = {"shape": old.shape, "dtype": old.dtype, "chunks": old.chunks, "fletcher32": True}
        del contents["a"]
        contents.create_dataset("a", **layout).attrs.update(
            {key: value for key, value in attrs.items() if key not in {"DIMENSION_LIST", "_Netcdf4Dimid"}}
        )
    with pytest.raises(RecordError, match=r"record\.h5 is damaged.*parts of a are missing"):
        open_record(path)


@pytest.mark.parametrize(
    ("action", "kept"),
    [*((open_record, kept) for kept in (1, 8, 95, 512, 0.5, -1)), (open_tree, 0.5), (open_hdf5, 0.5)],
)
def test_a_file_cut_off_anywhere(path, action, kept):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole)) if isinstance(kept, float) else kept])
    assert "is damaged or truncated" in refusal(action, path)


def spoil_samples(path):
    """Turn one bit in the middle of the samples of the channel "case"."""
    with h5py.File(path) as file:
        place = file["case"].id.get_chunk_info(1).byte_offset + 1000
    with path.open("r+b") as stream:
        stream.seek(place)
        byte = stream.read(1)[0]
        stream.seek(place)
        stream.write(bytes([byte ^ 1]))


def test_a_turned_bit_among_the_samples_is_found(path):
    spoil_samples(path)
    with open_record(path) as opened:
        text = refusal(channel_values, opened, "case")
        assert text.startswith(f'{path}: "case" cannot be read')
        assert "no longer match their checksum" in text
        np.testing.assert_array_equal(channel_values(opened, "fast"), NOISE)  # the rest is as it was
    with xr.open_dataset(path, engine="h5netcdf") as plain, pytest.raises(OSError, match="read"):
        plain["case"].load()


@pytest.mark.filterwarnings("ignore::hums.records.fields.RecordWarning")
def test_a_turned_bit_anywhere_never_gives_other_samples(record, tmp_path):
    """A place among the values is refused when read; among the names, it loses what is named or changes nothing."""
    piece = record[["case", "single", "fast", "tachometer"]].isel(time=slice(2000), time_fast=slice(2000))
    save_record(piece, tmp_path / "record.h5")
    whole = (tmp_path / "record.h5").read_bytes()
    refused = 0
    for place in range(0, len(whole), len(whole) // 20):
        (tmp_path / "record.h5").write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        try:
            with open_record(tmp_path / "record.h5") as opened:
                for name in ("case", "single", "fast"):
                    if name in opened:
                        np.testing.assert_array_equal(channel_values(opened, name), piece[name], err_msg=f"at {place}")
        except RecordError:
            refused += 1
    samples = sum(piece[name].nbytes for name in ("case", "single", "fast"))
    assert refused > 0.8 * 20 * samples / len(whole)


def test_a_file_that_another_program_writes(path):
    fcntl = pytest.importorskip("fcntl", reason="this system locks files in another way")
    with path.open("r+b") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)  # as HDF5 does while it writes
        text = refusal(open_record, path)
    assert "cannot be read now" in text
    assert "a program is writing it" in text


class TestLitter:
    """What killed writers leave is removed by the next writer of the same file, and only that."""

    def test_of_a_dead_process(self, tmp_path):
        code = (
            "import os, signal; from pathlib import Path; from hums.records.outputs import atomic_write\n"
            "with atomic_write('a.txt') as part:\n    part.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)"
        )
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False)
        assert len(list(tmp_path.iterdir())) == 1
        with atomic_write(tmp_path / "b.txt") as part:  # another target
            part.write_text("whole")
        assert len(list(tmp_path.glob(".hums-*"))) == 1
        with atomic_write(tmp_path / "a.txt") as part:
            part.write_text("whole")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "b.txt"]

    def test_not_of_a_living_one(self, tmp_path):
        with atomic_write(tmp_path / "a.txt") as first:
            first.write_text("first")
            with atomic_write(tmp_path / "a.txt") as second:
                second.write_text("second")
            assert first.exists()
        assert (tmp_path / "a.txt").read_text() == "first"
