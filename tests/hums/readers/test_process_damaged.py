"""Damaged files of every reader: a result or a sentence that names the file, and the calling process lives."""

import os
import sys
import zipfile

import numpy as np
import pytest
from attacks.damaged_files import CHANNELS, DECLARED, KINDS, SUFFIXES, attack_kind, write_valid

import hums
from hums.readers.process import ReaderProcess
from hums.records.fields import RecordWarning

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a fork starts at once")
FILES = 6  # of each reader; benchmarks/attack.py reads thousands


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_give_a_result_or_a_sentence(tmp_path, kind):
    pytest.importorskip("nptdms")
    pytest.importorskip("pyuff")
    assert not attack_kind(kind, tmp_path, count=FILES, seed=[7])["wrong"]


def test_what_a_library_prints_of_a_damaged_file_is_not_seen(tmp_path, capfd):
    attack_kind("mf4", tmp_path, count=100, seed=(20, 3))
    assert capfd.readouterr().out == ""


def valid_file(tmp_path, kind):
    pytest.importorskip("nptdms")
    path = tmp_path / f"a{SUFFIXES.get(kind, '.h5')}"
    write_valid(kind, path)
    return path, CHANNELS.get(kind, "vib")


@pytest.mark.parametrize("kept", [10, 0.5, 0.9])
@pytest.mark.parametrize("kind", ["wav", "mat v5", "mat v7.3", "tdms", "uff", "mf4", "lvm"])
def test_a_file_cut_off_is_refused(tmp_path, kind, kept):
    path, name = valid_file(tmp_path, kind)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole)) if isinstance(kept, float) else kept])
    with ReaderProcess() as reader, pytest.raises(hums.RecordError, match=r"is not a|is no|damaged"):
        reader.convert(path, channels=[name], **DECLARED)


@pytest.mark.parametrize("kind", ["mat v7.3", "hdf5", "tdms"])
def test_a_name_that_is_no_utf8_is_refused_by_name(tmp_path, kind):
    path, name = valid_file(tmp_path, kind)
    path.write_bytes(path.read_bytes().replace(b"vib", b"v\xffb"))
    with ReaderProcess() as reader, pytest.raises(hums.RecordError, match="not UTF-8") as caught:
        reader.convert(path, channels=[name.replace("i", "\ufffd")], units="g", rate_hz=10, no_tachometer=True)
    text = str(caught.value)
    assert path.name in text
    assert '"group.v\ufffdb"' in text if kind == "tdms" else r"v\xffb" in text
    assert text.isprintable()


@pytest.mark.skipif(os.name != "posix", reason="elsewhere names of files are text")
@pytest.mark.parametrize("kind", ["csv", "wav", "mat v5", "hdf5", "record"])
def test_a_file_whose_name_is_no_utf8_is_refused_by_name(tmp_path, kind):
    path, name = valid_file(tmp_path, kind)
    path = path.rename(os.fsdecode(os.fsencode(path.parent) + b"/a\xff" + path.suffix.encode()))
    declared = {"channels": [name], "units": "g", "rate_hz": 10, "no_tachometer": True}
    with ReaderProcess() as reader, pytest.raises(hums.RecordError, match=r"a\\xff.*not UTF-8 text"):
        reader.open_record(path) if kind == "record" else reader.convert(path, **declared)


@pytest.mark.parametrize(
    ("stated", "why"),
    [
        (b"2026-01-\xff1", r"recorded_at='2026-01-\\udcff1T"),
        (b"2026-01\0\0\0", "recorded_at='2026-01'"),  # torn: text ends at a zero
        (b"yesterday!", "recorded_at='yesterday!T"),
    ],
)
def test_a_torn_or_foreign_time_is_refused_by_name(tmp_path, stated, why):
    record = hums.make_record(
        {"vib": np.ones(10)}, rate_hz=10, units="g", angle=hums.UnknownAngle(), recorded_at="2026-01-01T00:00:00Z"
    )
    path = tmp_path / "record.h5"
    hums.save_record(record, path)
    path.write_bytes(path.read_bytes().replace(b"2026-01-01", stated))
    with pytest.warns(RecordWarning), pytest.raises(hums.RecordError, match=why) as caught:
        hums.open_record(path)
    assert "record.h5" in str(caught.value)


def test_no_message_is_longer_than_a_page(tmp_path):
    names = ",".join(f"column number {number}" for number in range(2000))
    (tmp_path / "wide.csv").write_text(f"{names}\n{','.join(['1'] * 2000)}\n", encoding="utf-8")
    with pytest.raises(hums.RecordError, match=r"wide\.csv") as caught:
        hums.convert(tmp_path / "wide.csv", channels=["x" * 5000 + "\x1b[2J"], units="g", rate_hz=10)
    assert len(str(caught.value)) <= 1000
    assert str(caught.value).isprintable()


def test_a_packed_numpy_file_is_read_by_name_and_within_bounds(tmp_path):
    path, declared = tmp_path / "log.npz", {"units": "g", "rate_hz": 10, "no_tachometer": True}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:  # 100 MB of zeros in a tenth of one
        with archive.open("bomb.npy", "w", force_zip64=True) as stream:
            header = {"descr": "<f8", "fortran_order": False, "shape": (12_500_000,)}
            np.lib.format.write_array_header_1_0(stream, header)
            for _ in range(10):
                stream.write(bytes(10_000_000))
        with archive.open("vib.npy", "w") as stream:
            np.save(stream, np.arange(5.0))
    with ReaderProcess(memory_bytes=200_000_000) as reader:
        np.testing.assert_array_equal(reader.convert(path, channels=["vib"], **declared).vib, np.arange(5.0))
        with pytest.raises(hums.RecordError, match=r'log\.npz: "bomb" declares 1e\+08 bytes'):
            reader.convert(path, channels=["bomb"], **declared)
