"""`hums convert` of many files, of averages in angle, and what `hums info` says of such records."""

import warnings

import numpy as np
import pytest

import hums
from hums.jobs import Serial


@pytest.fixture(autouse=True)
def serial(monkeypatch):
    """Processes cost seconds and have tests of their own."""
    monkeypatch.setattr("hums.jobs.Processes", lambda **_: Serial())


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "measured"
    made.mkdir()
    for number in range(1, 5):
        np.savetxt(made / f"acc_{number:05d}.csv", np.full((500, 2), number / 10), delimiter=",")
    (made / "acc_00009.csv").write_text("1,2\n3\n")
    return made


MANY = ("--channel", 1, "--units", "g", "--rate-hz", 5000, "--shaft-rpm", 1800, "--shaft", "input", "--machine", "mill")
TIMED = ("--every", 10, "--recorded-at", "2010-12-01T09:39:39Z")


def test_many_files_become_a_dataset(run, folder, tmp_path):
    code, out, err = run("convert", folder / "acc_*.csv", tmp_path / "out", *MANY, *TIMED, "--measured", "2=degC")
    assert code == 0
    assert "4 records; 5 files read now, 0 before, 1 refused" in out
    assert "the row in line 2 has 1 of 2 cells" in out
    assert "files" in err  # the progress bar
    dataset = hums.open_dataset(tmp_path / "out")
    assert dataset["recorded_at"].values[-1] == "2010-12-01T09:40:09Z"
    assert hums.dataset_record(tmp_path / "out", 3)["column 2"].attrs["units"] == "degC"
    assert (
        "0 files read now, 5 before"
        in run("convert", folder, tmp_path / "out", *MANY, *TIMED, "--measured", "2=degC")[1]
    )


def test_snapshots_in_a_file_each(run, folder, tmp_path):
    code, _, _ = run("convert", folder, tmp_path / "out", *MANY, *TIMED, "--files", "--snapshots", 4)
    assert code == 0
    out = run("info", tmp_path / "out" / "acc_00001.h5")[1]
    assert "snapshots    4, every 10 s on average, the last 30 s after the first" in out
    assert "500 samples at 5000 Hz, 0.100 s from 0 s, in g" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("out", "--recorded-at", "2020-01-01T00:00:00Z"), "would be the time of every file"),
        (("out.h5",), "many files make a folder"),
        (("out", "--measured", "torque"), "write COLUMN=UNITS"),
        (("out", "--workers", 1, "--scheduler", "tcp://a:1"), "are both given"),
    ],
)
def test_what_many_files_refuse(run, folder, tmp_path, words, said):
    code, _, err = run("convert", folder, tmp_path / words[0], *MANY, *words[1:])
    assert code == 2
    assert said in err


def test_options_of_many_files_are_not_for_one(run, folder, tmp_path):
    code, _, err = run("convert", folder / "acc_00001.csv", tmp_path / "a.h5", *MANY, "--every", 10)
    assert code == 2
    assert "--every is for many files" in err


def test_an_average_in_angle(run, tmp_path):
    np.save(tmp_path / "planet.npy", np.random.default_rng(0).normal(size=(512, 2)))
    words = ("convert", tmp_path / "planet.npy", tmp_path / "planet.h5", "--channel", 2, "--units", "1")
    code, out, _ = run(*words, "--samples-per-rev", 256, "--average-of", "planet 1", "--averaged-over", 120)
    assert code == 0
    assert "average of   planet 1, 256 samples a revolution, over 120 revolutions" in out
    assert "column 2: 512 samples, 2 revolutions, in 1" in out
    for more, said in (
        (("--average-of", "planet 1"), "--samples-per-rev"),
        (("--average-of", "planet 1", "--samples-per-rev", 256, "--rate-hz", 100), "leave out --rate-hz"),
        (("--average-of", "planet 1", "--samples-per-rev", 256, "--shaft-rpm", 100), "--shaft-rpm has no meaning"),
    ):
        code, _, err = run(*words, *more)
        assert code == 2
        assert said in err


def test_a_time_column_and_a_measured_speed(run, tmp_path):
    lines = ["when,vib,rpm", *(f"2020-01-01T01:00:{i // 100:02d}+01:00,{i},{1500 + i % 3}" for i in range(1000))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    words = ("convert", tmp_path / "a.csv", tmp_path / "a.h5", "--channel", "vib", "--units", "g", "--rate-hz", 100)
    speed = ("--speed-column", "rpm", "--speed-units", "rpm", "--shaft", "input")
    code, out, _ = run(*words, *speed, "--time-column", "when")
    assert code == 0
    assert "recorded at  2020-01-01T00:00:00Z" in out
    assert "speed        1501 rpm of input" in out.replace("1500.99", "1501").replace("1501.0 ", "1501 ")
    (tmp_path / "a.csv").write_text("\n".join([*lines, "2020-01-01T01:00:10+01:00,0,1600"]))
    code, _, err = run(*words, *speed)
    assert code == 2
    assert 'the speed "rpm" departs by 6.6% from its mean' in err


def test_units_of_each_channel_and_what_decides_a_contradiction(run, tmp_path):
    rows = "".join(f"{k / 1008:.6f},{k},{-k}\n" for k in range(3000))
    (tmp_path / "a.csv").write_text(f"time (s),DE,ND\n{rows}")
    words = ("convert", tmp_path / "a.csv", tmp_path / "a.h5", "--channel", "DE", "--channel", "ND", "--no-tachometer")
    assert run(*words, "--units", "g", "--units", "mm/s")[0] == 0
    with hums.open_record(tmp_path / "a.h5") as record:
        assert [record[name].attrs["units"] for name in ("DE", "ND")] == ["g", "mm s-1"]
    code, _, err = run(*words, "--channel", "3", "--units", "g", "--units", "V")
    assert code == 2
    assert "give one for all 3 channels" in err
    code, _, err = run(*words, "--units", "g", "--rate-hz", 1000)
    assert (code, "--trust" in err) == (2, True)
    with warnings.catch_warnings():
        warnings.simplefilter("always")  # printed
        code, out, err = run(*words, "--units", "g", "--rate-hz", 1000, "--trust", "file")
    assert code == 0
    assert "1008 Hz; the file was trusted" in out
    assert "1008 Hz; the file was trusted" in err


def test_a_target_that_is_missing_and_times_that_no_name_states(run, folder, tmp_path):
    code, _, err = run("convert", folder / "acc_00001.csv")
    assert code == 2
    assert "acc_00001.csv alone is named; name the files to read and, last, the record or folder to write" in err
    assert "no time is known: neither names nor options" in run("convert", folder, tmp_path / "out", *MANY)[1]
    assert "no time is known" not in run("convert", folder, tmp_path / "timed", *MANY, *TIMED)[1]
    assert "dataset      4 records; the first:" in run("info", tmp_path / "out")[1]
    assert "measured is a folder, and no dataset" in run("info", folder)[2]
