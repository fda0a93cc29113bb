"""What may be written: by the library, and by each command that writes."""

import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from gearboxes import SHORT_SCENE

from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import save_analysis
from hums.conversion import convert_files, find_sources
from hums.fleet.fleet_analysis import analyze_fleet
from hums.gearbox.model import load_gearbox
from hums.jobs import Serial
from hums.records.fields import RecordError
from hums.records.outputs import check_outputs
from hums.records.record import NominalSpeed, make_record
from hums.records.store import save_record

READ, FOREIGN = "inputs are never overwritten", "was not written by hums"


@pytest.fixture
def raw(tmp_path):
    """Another program's file."""
    with h5py.File(tmp_path / "raw.h5", "w") as file:
        file["vib"] = np.random.default_rng(0).normal(size=8000)
    return tmp_path / "raw.h5"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A record and its analysis."""
    folder = tmp_path_factory.mktemp("made")
    noise = np.random.default_rng(0).normal(size=8000)
    record = make_record({"vib": noise}, rate_hz=4000, units="g", angle=NominalSpeed(rpm=1200, shaft="input"))
    save_record(record, folder / "record.h5")
    settings = AnalysisSettings(envelope_band_hz=None, pictures=False)
    save_analysis(analyze(record, load_gearbox("two-stage"), settings=settings), folder / "analysis.h5")
    return folder


@pytest.fixture
def refused(run, tmp_path):
    """Run a command that has to be refused with a sentence, and leave every file of the folder as it was."""

    def command(*words, because, status=1):
        def contents():
            return {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

        before = contents()
        code, _, err = run(*words)
        assert code == status
        assert because in err
        assert contents() == before

    return command


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_other_names_of_an_input_are_not_written(link, raw, tmp_path):
    link(raw, tmp_path / "other.h5")
    with pytest.raises(RecordError, match=READ):
        check_outputs([tmp_path / "other.h5"], inputs=[raw])
    with pytest.raises(RecordError, match=READ):
        check_outputs([tmp_path / "folder" / ".." / "raw.h5"], inputs=[raw])


def test_what_is_new_empty_or_ours_may_be_written(made, tmp_path):
    (tmp_path / "reserved.h5").touch()
    check_outputs([tmp_path / "new.h5", tmp_path / "reserved.h5", made / "record.h5", made / "analysis.h5"])


@pytest.mark.parametrize("content", [b"\x89HDF\r\n\x1a\n", b"time,vib\n0,1\n"])
def test_what_cannot_be_told_is_not_replaced(content, tmp_path):
    (tmp_path / "there.h5").write_bytes(content)
    (tmp_path / "link.h5").symlink_to("there.h5")
    for name, force in (("there.h5", False), ("link.h5", True)):
        with pytest.raises(RecordError, match=FOREIGN):
            check_outputs([tmp_path / name], force=force)


def test_convert_writes_no_folder_that_it_reads(raw, tmp_path):
    declared = {"channels": ["vib"], "units": "g", "rate_hz": 4000, "no_tachometer": True}
    np.savetxt(tmp_path / "a.csv", np.ones(100), header="vib", comments="")
    convert_files(find_sources([tmp_path / "a.csv"]), tmp_path / "out", form="files", **declared)
    inside = raw.rename(tmp_path / "out" / "raw.h5")
    before = inside.read_bytes()
    with pytest.raises(RecordError, match=READ):
        convert_files(find_sources([tmp_path / "a.csv", inside]), tmp_path / "out", form="files", **declared)
    np.savetxt(tmp_path / "raw.csv", np.ones(100), header="vib", comments="")
    sources = find_sources([tmp_path / "a.csv", tmp_path / "raw.csv"])
    with pytest.raises(RecordError, match=FOREIGN):
        convert_files(sources, tmp_path / "out", form="files", **declared)
    assert inside.read_bytes() == before


def test_analyze_and_report_write_no_input(refused, made, tmp_path):
    for name in ("record.h5", "analysis.h5"):
        (tmp_path / name).write_bytes((made / name).read_bytes())
    (tmp_path / "analysis.h5").rename(tmp_path / "baseline.h5")
    (tmp_path / "record.h5").rename(tmp_path / "analysis.h5")  # a record of that name
    words = ("--gearbox", "two-stage", "-o", tmp_path)
    refused("analyze", tmp_path / "analysis.h5", *words, because=READ)
    (tmp_path / "analysis.h5").rename(tmp_path / "record.h5")
    (tmp_path / "baseline.h5").rename(tmp_path / "analysis.h5")
    refused("analyze", tmp_path / "record.h5", *words, "--baseline", tmp_path / "analysis.h5", because=READ)
    refused("report", made / "analysis.h5", "-o", tmp_path, "--baseline", tmp_path / "analysis.h5", because=READ)


def test_fleet_writes_no_input(refused, made, tmp_path):
    for name in ("fleet.h5", "record.h5"):
        (tmp_path / name).write_bytes((made / "record.h5").read_bytes())
    (tmp_path / "alarms.csv").write_text("date,component,machine,serial,action\n")
    words = ("--gearbox", "two-stage", "-o", tmp_path, "--no-envelope")
    refused("fleet", tmp_path / "fleet.h5", *words, because=READ)
    refused("fleet", tmp_path / "record.h5", *words, "--maintenance", tmp_path / "alarms.csv", because=READ)


def test_a_link_to_itself_is_refused_in_a_sentence(run, made, tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    code, _, err = run("fleet", made / "record.h5", "--gearbox", "two-stage", "-o", tmp_path / "loop")
    assert (code, "loop" in err) == (1, True)


def test_a_fleet_beside_its_records_goes_on(made, tmp_path):
    (tmp_path / "record.h5").write_bytes((made / "record.h5").read_bytes())
    settings = AnalysisSettings(envelope_band_hz=None, most_tracks=0)
    for _ in range(2):
        fleet = analyze_fleet([tmp_path], "two-stage", tmp_path / "fleet", settings=settings)
        assert (fleet.records, fleet.failed) == (1, 0)


PLAN = 'scene = "demo"\nrecords = 1\nseed = 7\nchange = { duration_s = 0.2, fault = [] }\n'
READ_RAW = "--channel vib --units g --rate-hz 4000 --no-tachometer"
WRITERS = {  # and the files of each
    "analyze record.h5 --gearbox two-stage -o out --no-envelope":
        "out/analysis.h5 out/indicators.csv out/orders.csv out/report.html out/summary.json",
    "fleet record.h5 --gearbox two-stage -o out --no-envelope":
        "out/alarms.csv out/baselines.json out/components.csv out/fleet.csv out/fleet.h5 out/fleet.html "
        "out/indicators.parquet out/records.json out/task.json out/trends.csv",
    "dataset plan.toml -o out": "out/checksums.sha256 out/data-card.md out/index.h5 out/labels.csv",
    f"convert raw.h5 new.h5 {READ_RAW}": "new.h5",
    f"convert raw.h5 raw.h5 -o out {READ_RAW}": "out/conversion.json out/index.h5 out/labels.csv out/refused.csv",
    f"convert raw.h5 raw.h5 -o out --files {READ_RAW}": "out/conversion-files.json out/refused.csv",
    "synth scene.toml -o new.h5": "new.h5",
    "drawing two-stage -o m.pdf": "m.pdf",
    "drawing two-stage -o p.html": "p.html",
    "dynamics wijianto-pair --motions torsion -o out --format png": "out/campbell.png out/modes.png",
}  # fmt: skip


@pytest.mark.parametrize("words", WRITERS)
def test_a_command_replaces_only_what_it_wrote_file_by_file(run, refused, made, raw, tmp_path, monkeypatch, words):  # noqa: ARG001 - convert reads raw.h5
    monkeypatch.setattr("hums.jobs.Processes", lambda **_: Serial())
    monkeypatch.chdir(tmp_path)
    shutil.copy(made / "record.h5", "record.h5")
    (tmp_path / "scene.toml").write_text(SHORT_SCENE)
    (tmp_path / "plan.toml").write_text(PLAN)
    (tmp_path / "out").mkdir()
    assert run(*words.split())[0] == 0
    written = [*map(Path, WRITERS[words].split())]
    for path in written:
        whole = path.read_bytes()
        if path.suffix == ".h5":
            with h5py.File(path, "r+") as file:
                file.attrs["mine"] = 1
        else:
            path.write_bytes(whole + b"\n")
        refused(*words.split(), because=FOREIGN)
        path.unlink()
        os.mkfifo(path)
        refused(*words.split(), "--force", because="a device or pipe")
        path.unlink()
        path.write_bytes(whole)
    for path in written:
        path.write_text("the user's own")
    assert run(*words.split(), "--force")[0] == 0
    assert run(*words.split())[0] == 0  # which it wrote itself
    assert not [path for path in written if path.read_bytes() == b"the user's own"]


def test_what_is_read_is_not_written_by_force(refused, raw, tmp_path):
    refused("convert", raw, raw, "--channel", "vib", "--force", because=READ)
    refused("synth", "demo", "-o", tmp_path / "record.csv", because="records are HDF5 files", status=2)
    (tmp_path / "gearbox.svg").write_text('frame = "housing"\n')
    refused("drawing", tmp_path / "gearbox.svg", "-o", tmp_path / "gearbox.svg", "--force", because=READ)
