"""Many files to records: names and times, resumption, refusals, one packed dataset or a file each."""

import os
from pathlib import Path

import numpy as np
import pytest

import hums
from hums.conversion import convert_files, find_sources
from hums.records.fields import RecordError

RATE_HZ, COUNT = 2000.0, 200
DECLARED = {
    "channels": ["vib"],
    "units": "g",
    "rate_hz": RATE_HZ,
    "shaft_rpm": 1500.0,
    "shaft": "input",
    "machine": "m",
}


def write(folder, name, number, *, count=COUNT, torque=None):
    columns = {"vib": number + np.arange(count) / count}
    columns |= {} if torque is None else {"torque": np.full(count, torque), "rpm": np.full(count, 1500 + number)}
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / name, table, header=",".join(columns), delimiter=",", comments="")
    return folder / name


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Seventy files in disorder, two that are no records and one of another length."""
    made = tmp_path_factory.mktemp("acc")
    for number in range(1, 71):
        write(made, f"acc_{number}.csv", number)
    (made / "acc_5.csv").write_text("")
    (made / "acc_40.csv").write_text("speed\nfast\n")
    write(made, "acc_41.csv", 41, count=COUNT - 1)
    return made


@pytest.fixture(scope="module")
def packed(folder):
    target = folder.parent / "packed"
    return convert_files(find_sources([f"{folder}/acc_*.csv"]), target, **DECLARED)


# ---- names -------------------------------------------------------------------------------------------------


def test_numbers_are_an_order(folder):
    found = find_sources([folder])
    assert [file.path.stem for file in found[:3]] == ["acc_1", "acc_2", "acc_3"]
    assert found[-1].path.stem == "acc_70"
    assert not any(file.recorded_at for file in found)


@pytest.mark.parametrize(
    ("pattern", "options", "when"),
    [
        ("*.csv", {"time_in_names": "d-%Y%m%dT%H%M%SZ.csv"}, "2013-03-11T03:00:24Z"),
        ("*.csv", {"time_in_names": "d-%Y%m%dT%H%M%SZ"}, "2013-03-11T03:00:24Z"),
        ("*.csv", {"time_in_names": "e-%Y"}, None),
        ("nothing-*.csv", {}, None),
    ],
)
def test_times_in_names(tmp_path, pattern, options, when):
    (tmp_path / "d-20130311T030024Z.csv").write_text("x")
    if when is None:
        with pytest.raises(RecordError, match=r"no file matches|does not match"):
            find_sources([tmp_path / pattern], **options)
        return
    assert [file.recorded_at for file in find_sources([tmp_path / pattern], **options)] == [when]


def test_a_time_without_offset_needs_one(tmp_path):
    (tmp_path / "d_20130311_030024.csv").write_text("x")
    with pytest.raises(RecordError, match='state time_zone, "Europe/Berlin"'):
        find_sources([tmp_path], time_in_names="d_%Y%m%d_%H%M%S")
    for zone, hour in {"+01:00": "02", "Europe/Berlin": "02", "UTC": "03", "America/New_York": "07"}.items():
        (found,) = find_sources([tmp_path], time_in_names="d_%Y%m%d_%H%M%S", time_zone=zone)
        assert found.recorded_at == f"2013-03-11T{hour}:00:24Z"


def test_a_time_when_the_clocks_change_has_two_offsets(tmp_path):
    for hour, zone, why in ((2, "Europe/Berlin", "two UTC offsets"), (2, "Europe/Berln", "did you mean|Did you mean")):
        (tmp_path / f"d_20241027_{hour:02d}3000.csv").write_text("x")
        with pytest.raises(RecordError, match=why):
            find_sources([tmp_path], time_in_names="d_%Y%m%d_%H%M%S", time_zone=zone)


def test_times_from_numbers_and_their_distance(folder):
    found = find_sources([f"{folder}/acc_?.csv"], every_s=10, recorded_at="2010-12-01T23:59:50Z")
    assert [file.recorded_at for file in found[:2]] == ["2010-12-01T23:59:50Z", "2010-12-02T00:00:00Z"]
    with pytest.raises(RecordError, match=r"every_s = 10 needs recorded_at"):
        find_sources([folder], every_s=10)


@pytest.mark.parametrize("given", [[], ["nowhere.csv"], ["no-folder/*.csv"]])
def test_nothing_found(given):
    with pytest.raises(RecordError, match=r"no file|no such file"):
        find_sources(given)


# ---- one dataset -------------------------------------------------------------------------------------------


def test_a_dataset_of_what_can_be_read(packed):
    assert (packed.records, packed.done, packed.kept) == (67, 70, 0)
    assert sorted(Path(file).name for file in packed.refused) == ["acc_40.csv", "acc_41.csv", "acc_5.csv"]
    dataset = hums.open_dataset(packed.folder)
    assert dataset.vib.dtype == np.float32
    assert dataset["file"].values[[0, 4, -1]].tolist() == ["acc_1.csv", "acc_6.csv", "acc_70.csv"]
    assert dataset.vib[:, 0].values.tolist() == [n for n in range(1, 71) if n not in {5, 40, 41}]
    record = hums.dataset_record(packed.folder, 40)  # in the second file, after two that were refused
    assert (record.attrs["source"], float(record.vib[0])) == ("acc_44.csv", 44.0)
    rows = (packed.folder / "refused.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 4
    assert "written again" in rows[1] or "write it again" in rows[1]


def test_the_same_again_reads_nothing_and_changes_are_made_again(folder, packed):
    sources = find_sources([f"{folder}/acc_*.csv"])
    again = convert_files(sources, packed.folder, **DECLARED)
    assert (again.done, again.kept, again.records) == (0, 70, 67)
    write(folder, "acc_70.csv", 700)
    write(folder, "acc_5.csv", 5)
    os.utime(folder / "acc_70.csv", ns=(1, 1))
    once_more = convert_files(sources, packed.folder, **DECLARED)
    assert (once_more.done, once_more.kept, once_more.records) == (32 + 6, 32, 68)
    assert hums.open_dataset(packed.folder).vib[[4, -1], 0].values.tolist() == [5, 700]


def test_a_conversion_that_was_stopped_goes_on(folder, tmp_path, monkeypatch):
    sources = find_sources([f"{folder}/acc_*.csv"])
    written = []

    def stop(records, *args, **kwargs):
        if written:
            raise KeyboardInterrupt
        written.append(1)
        hums.records.store.write_shard(records, *args, **kwargs)

    monkeypatch.setattr("hums.conversion.write_shard", stop)
    with pytest.raises(KeyboardInterrupt):
        convert_files(sources, tmp_path / "out", **DECLARED)
    with pytest.raises(RecordError, match="complete it by the same hums convert"):
        hums.open_dataset(tmp_path / "out")
    monkeypatch.undo()
    result = convert_files(sources, tmp_path / "out", **DECLARED)
    assert (result.done, result.kept) == (38, 32)


def test_a_conversion_that_a_full_disk_stopped_at_once_goes_on(folder, tmp_path, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"conversion\.json"):
        convert_files(find_sources([f"{folder}/acc_*.csv"]), tmp_path / "out", **DECLARED)
    monkeypatch.undo()
    assert convert_files(find_sources([f"{folder}/acc_*.csv"]), tmp_path / "out", **DECLARED).records


def test_what_a_folder_refuses(folder, packed, tmp_path):
    sources = find_sources([f"{folder}/acc_*.csv"])
    with pytest.raises(RecordError, match="begun with rate_hz = 2000"):
        convert_files(sources, packed.folder, **(DECLARED | {"rate_hz": 1000.0}))
    with pytest.raises(RecordError, match="inputs are never overwritten"):
        convert_files(sources, folder, **DECLARED)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(RecordError, match="not from such a conversion"):
        convert_files(sources, tmp_path / "other", **DECLARED)
    with pytest.raises(RecordError, match="not among the sources"):
        convert_files(sources[:3], packed.folder, **DECLARED)
    (tmp_path / "a.csv").write_text("")
    with pytest.raises(RecordError, match="none of 1 files could be converted"):
        convert_files(find_sources([tmp_path]), tmp_path / "out", **DECLARED)


# ---- a file each, snapshots --------------------------------------------------------------------------------


def test_a_file_each_of_snapshots_with_measured_columns(tmp_path):
    for number in range(5):
        write(tmp_path, f"s{number}.csv", number, torque=10.0 * number)
    declared = {key: value for key, value in DECLARED.items() if key != "shaft_rpm"}
    declared |= {"speed_column": "rpm", "speed_units": "rpm", "measured": {"torque": "N m"}}
    sources = find_sources([tmp_path], every_s=10, recorded_at="2020-01-01T00:00:00Z")
    result = convert_files(sources, tmp_path / "out", form="files", snapshots=2, **declared)
    assert result.records == 3
    assert sorted(path.name for path in result.folder.glob("*.h5")) == ["s0.h5", "s2.h5", "s4.h5"]
    with hums.open_record(result.folder / "s2.h5") as record:
        assert record.attrs["recorded_at"] == "2020-01-01T00:00:20Z"
        assert record.snapshot_s.values.tolist() == [0, 10]
        np.testing.assert_allclose(60 * record.nominal_speed, [1502, 1503])
        assert record.torque.mean("time").values.tolist() == [20, 30]


def test_a_dataset_has_one_rate(tmp_path):
    for number, rate_hz in enumerate((2000.0, 2000.001, 4000.0)):  # the second as sample times scatter
        times = np.arange(COUNT) / rate_hz
        columns = np.column_stack([times, np.arange(COUNT)])
        np.savetxt(tmp_path / f"acc_{number}.csv", columns, header="time (s),vib", delimiter=",", comments="")
    declared = {name: value for name, value in DECLARED.items() if name != "rate_hz"}
    made = convert_files(find_sources([f"{tmp_path}/acc_*.csv"]), tmp_path / "out", **declared)
    assert made.records == 2
    (reason,) = made.refused.values()
    assert reason.startswith('"rate_hz" is 4000.0, but 2000.0 in the first file; write a record per file')


def test_two_files_of_one_name(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write(tmp_path / name, "x.csv", 1)
    with pytest.raises(RecordError, match='named "x"'):
        convert_files(find_sources([tmp_path / "a", tmp_path / "b"]), tmp_path / "out", form="files", **DECLARED)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere names of files are text")
def test_a_name_that_is_no_utf8_is_one_refusal(tmp_path):
    source = tmp_path / "in"
    source.mkdir()
    for name in (b"a.csv", b"pr\xfcf.csv"):
        write(source, os.fsdecode(name), 1)
    made = convert_files(find_sources([source]), tmp_path / "out", **DECLARED)
    assert made.records == 1
    assert [Path(file).name for file in made.refused] == ["pr\udcfcf.csv"]
    table = (tmp_path / "out" / "refused.csv").read_text(encoding="utf-8")
    assert r"pr\xfcf.csv" in table
    assert "not UTF-8 text" in table
