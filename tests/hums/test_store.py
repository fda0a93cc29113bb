"""The store: what is read is what was written, a file is whole or not there, and damage is never silent."""

import errno
import os
import shutil
import stat
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from xarray.indexes import RangeIndex

from hums.record import (
    Channel,
    NominalSpeed,
    PulseTimes,
    RecordError,
    channel_values,
    make_record,
    sampling,
)
from hums.store import (
    existing_file,
    is_hdf5,
    open_hdf5,
    open_record,
    open_tree,
    save_record,
    write_tree,
)

COUNT = 150_000  # more than one chunk
NOISE = np.random.default_rng(11).normal(size=COUNT)


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


def test_what_is_read_is_what_was_written(record, written):
    with open_record(written) as opened:
        assert isinstance(opened.xindexes["time"], RangeIndex)
        xr.testing.assert_identical(opened.load(), record)


def test_a_declared_speed_comes_back(tmp_path):
    nominal = build(angle=NominalSpeed(rpm=1000, shaft="input"))
    save_record(nominal, tmp_path / "record.h5")
    with open_record(tmp_path / "record.h5") as opened:
        xr.testing.assert_identical(opened.load(), nominal)


def test_xarray_reads_it_without_our_code(record, written):
    with xr.open_dataset(written, engine="h5netcdf") as plain:
        assert "time" not in plain.coords
        assert set(plain.data_vars) == set(record.data_vars)
        for name in record.data_vars:
            xr.testing.assert_identical(
                plain[name].load().drop_attrs(),
                record[name]
                .drop_indexes([dim for dim in record[name].dims if dim in ("time", "time_fast")])
                .drop_vars(["time", "time_fast"], errors="ignore")
                .drop_attrs(),
            )
        assert plain.attrs == record.attrs


def test_every_array_is_chunked_along_time_and_checksummed(written):
    with h5py.File(written) as file:
        for name in ("case", "single", "fast", "tachometer", "truth_phase", "truth_line", "truth_struck"):
            assert file[name].fletcher32, name
        assert 1 < COUNT / file["case"].chunks[0] < 10
        assert file["time"].size == COUNT
        assert file["time"].id.get_storage_size() == 0  # a bare dimension: no number per sample


def test_samples_are_read_only_when_used(written):
    with open_record(written) as opened:
        assert not opened["case"].variable._in_memory
        piece = opened["case"].isel(time=slice(70_000, 70_010))
        np.testing.assert_array_equal(piece, NOISE[70_000:70_010])
        assert not opened["case"].variable._in_memory


def test_closing_closes(written):
    opened = open_record(written)
    opened.close()
    # HDF5 refuses to open for writing what is still open for reading.
    with h5py.File(written, mode="r+"):
        pass


def test_a_slice_is_written_with_its_own_clock(record, tmp_path):
    piece = record.isel(time=slice(60_000, 61_000))
    save_record(piece, tmp_path / "piece.h5")
    with open_record(tmp_path / "piece.h5") as opened:
        assert sampling(opened, "case") == sampling(piece, "case")
        assert opened.attrs["start_s"] == pytest.approx(0.5e-3 + 60_000 / 50_000)
        assert sampling(opened, "fast").start_s == 0.5e-3
        np.testing.assert_array_equal(opened["case"], NOISE[60_000:61_000])
    assert piece.attrs["start_s"] == 0.5e-3


def test_a_record_replaces_the_file_it_is_read_from(path):
    with open_record(path) as opened:
        save_record(opened.isel(time=slice(100, 1100)), path)
    with open_record(path) as opened:
        np.testing.assert_array_equal(opened["case"], NOISE[100:1100])


def test_a_time_axis_stored_by_other_hands_is_understood(record, tmp_path):
    record.isel(time=slice(500, 1500)).to_netcdf(tmp_path / "record.h5", engine="h5netcdf")
    with open_record(tmp_path / "record.h5") as opened:
        assert isinstance(opened.xindexes["time"], RangeIndex)
        assert sampling(opened, "case").start_s == pytest.approx(0.5e-3 + 500 / 50_000)


@given(
    text=st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=50),
    number=st.floats(allow_nan=False) | st.integers(-(2**63), 2**63 - 1),
    row=st.lists(st.floats(allow_nan=False), min_size=2, max_size=5),
)
def test_attributes_come_back(tmp_path_factory, text, number, row):
    path = tmp_path_factory.mktemp("attributes") / "tree.h5"
    write_tree(xr.DataTree(xr.Dataset(attrs={"text": text, "number": number, "row": row})), path)
    with open_tree(path) as tree:
        assert tree.attrs["text"] == text
        assert tree.attrs["number"] == number
        assert list(tree.attrs["row"]) == row


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


def test_a_tree_comes_back(tmp_path):
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs={"schema": "x/1"}),
            "/a/b": xr.Dataset(
                {"line": ("order", np.array([1 + 1j, np.nan])), "name": ("order", ["rød", ""])},
                coords={"order": [20.0, 40.0]},
            ),
            "/table": xr.Dataset({"power": (("order", "angle"), np.ones((300, 700), dtype=np.float32))}),
            "/empty": xr.Dataset({"none": ("row", np.zeros(0)), "words": ("row", np.zeros(0, dtype="<U1"))}),
        }
    )
    write_tree(tree, tmp_path / "tree.h5")
    with open_tree(tmp_path / "tree.h5") as opened:
        assert set(opened.groups) == set(tree.groups)
        for group in ("/", "/a/b", "/table"):
            xr.testing.assert_identical(opened[group].to_dataset().load(), tree[group].to_dataset())
        assert opened["/empty"].sizes == {"row": 0}


# ---- whole or not there ------------------------------------------------------------------------------------


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def interrupted(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("where", ["os.fsync", "pathlib.Path.replace", "xarray.Dataset.to_netcdf"])
@pytest.mark.parametrize("failure", [full_disk, interrupted])
def test_a_failed_write_leaves_the_old_file_whole(record, path, monkeypatch, where, failure):
    before = path.read_bytes()
    monkeypatch.setattr(where, failure)
    with pytest.raises((OSError, KeyboardInterrupt)):
        save_record(record, path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_source_that_cannot_be_read_leaves_the_old_file_whole(path, tmp_path):
    target = Path(shutil.copy(path, tmp_path / "target.h5"))
    before = target.read_bytes()
    spoil_samples(path)
    with open_record(path) as opened, pytest.raises(OSError, match="read"):
        save_record(opened, target)
    assert target.read_bytes() == before
    assert sorted(path.parent.iterdir()) == [path, target]


def test_what_is_no_record_is_not_written(record, tmp_path):
    assert "schema" in refusal(save_record, record.drop_attrs(), tmp_path / "record.h5")
    assert list(tmp_path.iterdir()) == []


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


def test_hdf5_that_is_not_ours(tmp_path):
    with h5py.File(tmp_path / "other.h5", mode="w") as file:
        file["vibration"] = np.zeros(10)
    assert "hums convert other.h5" in refusal(open_record, tmp_path / "other.h5")
    write_tree(xr.DataTree(xr.Dataset(attrs={"schema": "hums-analysis/1"})), tmp_path / "tree.h5")
    text = refusal(open_record, tmp_path / "tree.h5")
    assert "holds hums-analysis/1, where a record holds hums-record/1" in text


def test_a_record_that_lost_a_part_names_its_file(path):
    with h5py.File(path, mode="r+") as file:
        del file["tachometer"]
    text = refusal(open_record, path)
    assert text.startswith(f"{path}: angle: nothing in this record")
    with h5py.File(path, mode="r+") as file:
        del file.attrs["rate_hz"]
    assert "rate_hz=None" in refusal(open_record, path)


# ---- damage ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kept", [1, 7, 8, 9, 47, 48, 95, 96, 512, 4096, 0.25, 0.5, 0.9, -1])
@pytest.mark.parametrize("action", [open_record, open_tree, open_hdf5])
def test_a_file_cut_off_anywhere(path, action, kept):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole)) if isinstance(kept, float) else kept])
    assert "is damaged or cut off" in refusal(action, path)


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
        assert "no longer agree with their checksum" in text
        np.testing.assert_array_equal(channel_values(opened, "fast"), NOISE)  # the rest is as it was
    with xr.open_dataset(path, engine="h5netcdf") as plain, pytest.raises(OSError, match="read"):
        plain["case"].load()


def test_a_turned_bit_among_the_pulses_is_found(path):
    with h5py.File(path) as file:
        place = file["tachometer"].id.get_chunk_info(0).byte_offset
    spoiled = bytearray(path.read_bytes())
    spoiled[place + 3] ^= 0x10
    path.write_bytes(spoiled)
    assert "is damaged or cut off" in refusal(open_record, path)


def test_a_lost_chunk_reads_as_gap_and_not_as_silence(path):
    """A key of the chunk index carries no checksum; HDF5 then finds no chunk and reads the fill value."""
    with h5py.File(path) as file:
        assert np.isnan(file["case"].fillvalue)
        assert np.isnan(file["single"].fillvalue)


def test_a_file_that_another_program_writes(path):
    fcntl = pytest.importorskip("fcntl", reason="this system locks files in another way")
    with path.open("r+b") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)  # as HDF5 does while it writes
        text = refusal(open_record, path)
    assert "cannot be read now" in text
    assert "a program still writes it" in text
