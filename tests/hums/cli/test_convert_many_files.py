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
TIMED = 'every_s = 10\nrecorded_at = "2010-12-01T09:39:39Z"\n'


@pytest.fixture
def described(tmp_path):
    """Return the option that names a description with some lines."""

    def option(*lines):
        (tmp_path / "import.toml").write_text("\n".join(lines))
        return ("-d", tmp_path / "import.toml")

    return option


def test_many_files_become_a_dataset(run, folder, described, tmp_path):
    told = described(TIMED, 'measured = { 2 = "degC" }')
    code, out, err = run("convert", folder / "acc_*.csv", tmp_path / "out", *MANY, *told)
    assert code == 3
    assert "4 records; 5 files read now, 0 before, 1 refused" in out
    assert "the row in line 2 has 1 of 2 cells" in out
    assert out.endswith("1 of 5 refused; reasons: refused.csv\n")
    assert "files" in err  # the progress bar
    dataset = hums.open_dataset(tmp_path / "out")
    assert dataset["recorded_at"].values[-1] == "2010-12-01T09:40:09Z"
    assert hums.dataset_record(tmp_path / "out", 3)["column 2"].attrs["units"] == "degC"
    assert "0 files read now, 5 before" in run("convert", folder, tmp_path / "out", *MANY, *told)[1]


def test_snapshots_in_a_file_each(run, folder, described, tmp_path):
    code, _, _ = run("convert", folder, tmp_path / "out", *MANY, "--files", *described(TIMED, "snapshots = 4"))
    assert code == 3
    out = run("info", tmp_path / "out" / "acc_00001.h5")[1]
    assert "snapshots    4, every 10 s on average, the last 30 s after the first" in out
    assert "500 samples at 5000 Hz, 0.100 s from 0 s, in g" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("out", "--recorded-at", "2020-01-01T00:00:00Z"), "would apply to every file"),
        (("out.h5",), "several files are written to a folder"),
        (("out", "--workers", 1, "--scheduler", "tcp://a:1"), "are both given"),
    ],
)
def test_what_many_files_refuse(run, folder, tmp_path, words, said):
    code, _, err = run("convert", folder, tmp_path / words[0], *MANY, *words[1:])
    assert code == 2
    assert said in err


def test_keys_of_many_files_are_not_for_one(run, folder, described, tmp_path):
    code, _, err = run("convert", folder / "acc_00001.csv", tmp_path / "a.h5", *MANY, *described(TIMED))
    assert code == 1
    assert "every_s applies to many files" in err
    named = described('time_in_names = "acc_0%y%m"', 'time_zone = "Europe/Berlin"')
    code, out, _ = run("convert", folder / "acc_00001.csv", tmp_path / "a.h5", *MANY, *named)
    assert (code, "recorded at  1999-12-31T23:00:00Z" in out) == (0, True)


def test_an_average_in_angle(run, described, tmp_path):
    np.save(tmp_path / "planet.npy", np.random.default_rng(0).normal(size=(512, 2)))
    words = ("convert", tmp_path / "planet.npy", tmp_path / "planet.h5", "--channel", 2, "--units", "1")
    average = 'average = { component = "planet 1", samples_per_rev = 256, averaged_over = 120 }'
    code, out, _ = run(*words, *described(average))
    assert code == 0
    assert "average of   planet 1, 256 samples per revolution, over 120 revolutions" in out
    assert "column 2: 512 samples, 2 revolutions, in 1" in out
    for line, more, said in (
        ('average = { component = "planet 1" }', (), "a table of component, samples_per_rev"),
        (average, ("--rate-hz", 100), "rate_hz has no meaning for a synchronous average"),
        (average, ("--shaft-rpm", 100), "shaft_rpm has no meaning"),
    ):
        code, _, err = run(*words, *described(line), *more)
        assert code == 1
        assert said in err


def test_units_of_each_channel_and_what_decides_a_contradiction(run, tmp_path):
    rows = "".join(f"{k / 1008:.6f},{k},{-k}\n" for k in range(3000))
    (tmp_path / "a.csv").write_text(f"time (s),DE,ND\n{rows}")
    words = ("convert", tmp_path / "a.csv", tmp_path / "a.h5", "--channel", "DE", "--channel", "ND", "--no-tachometer")
    assert run(*words, "--units", "g", "--units", "mm/s")[0] == 0
    with hums.open_record(tmp_path / "a.h5") as record:
        assert [record[name].attrs["units"] for name in ("DE", "ND")] == ["g", "mm s-1"]
    code, _, err = run(*words, "--channel", "3", "--units", "g", "--units", "V")
    assert code == 2
    assert "do not match the 3 channels; give one for all" in err
    code, _, err = run(*words, "--units", "g", "--rate-hz", 1000)
    assert (code, "--trust" in err) == (1, True)
    with warnings.catch_warnings():
        warnings.simplefilter("always")  # printed
        code, out, err = run(*words, "--units", "g", "--rate-hz", 1000, "--trust", "file")
    assert code == 0
    assert "1008 Hz; the file was trusted" in out
    assert "1008 Hz; the file was trusted" in err


def test_a_target_that_is_missing(run, folder, tmp_path):
    code, _, err = run("convert", folder / "acc_00001.csv")
    assert code == 2
    assert "acc_00001.csv is given; name one source and the record or folder to write, or several and -o FOLDER" in err
    assert run("convert", folder, tmp_path / "out", *MANY)[0] == 3
    assert "dataset      4 records; the first:" in run("info", tmp_path / "out")[1]
    assert "measured is not a dataset" in run("info", folder)[2]
