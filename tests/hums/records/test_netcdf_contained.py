"""Files that reach into others, files that declare too much, and files that were changed after they were written."""

import h5py
import numpy as np
import pytest

import hums
from hums.readers import read_file
from hums.records.fields import RecordError, RecordWarning


@pytest.fixture
def record():
    return hums.make_record({"vib": np.arange(1000.0)}, rate_hz=1000, angle=hums.UnknownAngle(), units="g")


def external_link(file, other):
    file["stolen"] = h5py.ExternalLink(other, "/x")


def external_storage(file, other):
    file.create_dataset("stolen", shape=(4,), dtype="f8", external=[(other, 0, 32)])


def virtual_dataset(file, other):
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource(other, "x", shape=(4,))
    file.create_virtual_dataset("stolen", layout)


REACHING = [(external_link, "external link"), (external_storage, "external storage"), (virtual_dataset, "virtual")]


@pytest.mark.parametrize(("reach", "words"), REACHING)
@pytest.mark.parametrize("name", ["data.h5", "data.mat", "record.h5"])
def test_nothing_reaches_into_another_file(tmp_path, record, reach, words, name):
    other = tmp_path / "secret.h5"
    with h5py.File(other, "w") as file:
        file["x"] = np.ones(4)
    path = tmp_path / name
    if name == "record.h5":
        hums.save_record(record, path)
    with h5py.File(path, "a") as file:
        file.require_dataset("own", (4,), "f8")
        reach(file, str(other))
    opened = hums.open_record if name == "record.h5" else read_file
    with pytest.raises(RecordError, match=f'"/stolen".*{words}'):
        opened(path)


@pytest.mark.parametrize("name", ["data.h5", "data.mat"])
def test_only_the_named_channel_is_read(tmp_path, name):
    with h5py.File(tmp_path / name, "w") as file:
        file["vib"] = np.arange(100.0)
        file.create_dataset("huge", shape=(10**12,), dtype="f8", chunks=(1024,))  # declared, and never written
        file["gone"] = h5py.SoftLink("/nowhere")
        file["null"] = h5py.Empty("f8")
        group = file.create_group("deep")
        for _ in range(40):  # 2^40 paths to the last group
            below = group.create_group("a")
            group["b"] = below
            group = below
    found = read_file(tmp_path / name)
    assert found.vector("vib").tolist() == list(range(100))
    with pytest.raises(RecordError, match=r"declares 8e\+12 bytes.*most_bytes"):
        found.vector("huge")
    with pytest.raises(RecordError, match='"null" is empty'):
        found.vector("null")
    with pytest.raises(RecordError, match='has no "gone"'):
        found.vector("gone")


def test_a_changed_attribute_is_seen(tmp_path, record):
    path = tmp_path / "record.h5"
    hums.save_record(record, path)
    hums.open_record(path).close()  # as written: no warning
    with h5py.File(path, "a") as file:
        file["vib"].attrs["units"] = "mV"
    with pytest.warns(RecordWarning, match="was changed after it was written"):
        hums.open_record(path).close()


def test_a_record_of_another_program_is_opened_with_a_warning(tmp_path, record):
    path = tmp_path / "record.h5"
    hums.save_record(record, path)
    with h5py.File(path, "a") as file:
        del file.attrs["_NCProperties"]
    with pytest.warns(RecordWarning, match="another program"):
        hums.open_record(path).close()


def test_a_foreign_time_of_recording_is_refused_when_opened(tmp_path, record):
    with pytest.raises(RecordError, match="recorded_at='yesterday'"):
        hums.save_record(record.assign_attrs(recorded_at="yesterday"), tmp_path / "record.h5")
    with pytest.raises(RecordError, match="recorded_at=5: text"):
        hums.save_record(record.assign_attrs(recorded_at=5), tmp_path / "record.h5")
