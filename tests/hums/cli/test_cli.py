"""The command line, in process: what it prints, what it writes, and how it fails."""

import contextlib
import io
import json
import logging
import shutil
import sys
import warnings
from functools import cache

import numpy as np
import pytest
from scipy.io import savemat

from hums.analysis.record_analysis import analyze
from hums.analysis.result import open_analysis, summary
from hums.cli import main
from hums.gearbox.model import load_gearbox

RATE_HZ, SPEED_HZ, SECONDS = 2500, 20.0, 4.0


def invoke(*words):
    """Run `hums ...` and return exit code, standard output and standard error."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.setattr(sys, "argv", ["hums", *map(str, words)])
        return main(), out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    vibration = np.cos(2 * np.pi * 23 * SPEED_HZ * time) + np.random.default_rng(0).normal(0, 0.1, time.size)
    path = tmp_path_factory.mktemp("measured") / "data.mat"
    waveform = (np.mod(SPEED_HZ * time, 1) < 0.1).astype(float)
    savemat(path, {"vibration": vibration, "tach": np.arange(0, SECONDS, 1 / SPEED_HZ), "keyphasor": waveform})
    return path


@pytest.fixture
def mat(measured, tmp_path):
    return shutil.copy(measured, tmp_path / measured.name)


TACHOMETER = ("--tach-times", "tach", "--pulses-per-rev", 1, "--shaft", "input")
BAND = ("--envelope-band", 100, 200)
WORDS = ("--no-envelope", "--units", "Hz", "--velocity-limits", 1.8, 4.5, 11.2, "--machine-class", "ours")


@pytest.fixture(scope="module")
def analysed(measured):
    """The folder of a record and its report, and what the commands said."""
    folder = measured.parent
    told = [
        invoke(*convert_words(measured, folder / "record.h5", *TACHOMETER)),
        invoke("analyze", folder / "record.h5", "--gearbox", "two-stage", "-o", folder / "out", *WORDS),
    ]
    return folder, told


def convert_words(mat, target, *more):
    return ("convert", mat, target, "--channel", "vibration", "--rate-hz", RATE_HZ, "--units", "g", *more)


def test_orders_json_and_csv_hold_sidebands(run):
    mesh = json.loads(run("orders", "two-stage", "--json")[1])[3]
    assert mesh["exact"] == "23"
    assert mesh["sidebands"] == pytest.approx([1, 23 / 67], rel=1e-14)  # JSON keeps fifteen decimals
    line = next(line for line in run("orders", "two-stage", "--csv")[1].splitlines() if "gear_mesh" in line)
    assert line == "stage 1,gear_mesh,23.0,23,1,housing,1 23/67"


def test_orders_of_several_degrees_of_freedom(run):
    words = ("orders", "car-differential", "--json")
    assert 'give as many speeds, as in --speed "cage=1500"' in run(*words)[2]
    _, out, _ = run(*words, "--speed", "left wheel=26", "--speed", "right wheel=30")
    rows = {(row["component"], row["kind"]): row["order"] for row in json.loads(out)}
    assert rows["drive shaft-cage", "gear_mesh"] * 28 == pytest.approx(1820)  # table A, cage at 28


def test_convert_info_analyze(run, analysed):
    folder, told = analysed
    # steps are told to a terminal alone
    assert [(code, err) for code, _, err in told] == [(0, ""), (0, "")]
    assert "speed of input: 20 Hz (1200 rpm)" in told[1][1]
    code, out, _ = run("info", folder / "record.h5")
    assert code == 0
    assert "vibration: 10000 samples at 2500 Hz" in out
    facts = json.loads((folder / "out" / "summary.json").read_text())
    assert facts["record"] == "record.h5"
    assert_mesh(facts)


@pytest.mark.parametrize(
    "angle",
    [
        ("--tach-waveform", "keyphasor", "--pulses-per-rev", 1, "--shaft", "input"),
        ("--shaft-rpm", 1200, "--shaft", "input"),
    ],
)
def test_convert_of_other_angles(run, mat, tmp_path, angle):
    record = tmp_path / "record.h5"
    assert run(*convert_words(mat, record, *angle))[0] == 0
    assert_mesh(summary(analyze(record, load_gearbox("two-stage"))))


def assert_mesh(facts):
    mesh = next(row for row in facts["orders"] if row["component"] == "stage 1" and row["harmonic"] == 1)
    assert mesh["claimed"]
    assert mesh["amplitude"] == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("status", "words", "sentence"),
    [
        (2, ("orders", "two-stage", "--speed", "fast"), "write LINK=RPM"),
        (2, ("orders", "two-stage", "--rpm", "0"), "non-zero"),
        (2, ("analyze", "x.h5", "--gearbox", "two-stage", "-o", "out", "--no-envelope", *BAND), "keep one"),
    ],
)
def test_mistakes_end_in_a_sentence(run, status, words, sentence):
    code, _, err = run(*words)
    assert code == status
    assert sentence in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("orders", "two-stage", "--rpm", 100, "--rpm", 200), "--rpm"),
        (("orders", "two-stage", "--json", "--json"), "--json"),
        (("convert", "a.csv", "a.h5", "--rate-hz", 1, "--channel", "a", "--channel", "b", "--rate-hz", 2), "--rate-hz"),
        (("synth", "demo", "-o", "a.h5", "--out", "b.h5"), "--out"),
    ],
)
def test_an_option_given_twice_is_refused(run, words, option):
    code, _, err = run(*words)
    assert (code, option in err, "given 2 times" in err) == (2, True, True)


def test_a_dataset_states_its_size_and_time_before_it_starts(run, monkeypatch, tmp_path):
    from data_synth import PlanError  # noqa: PLC0415
    from data_synth.dataset_folder import DatasetCost  # noqa: PLC0415

    def refused(*_, **__):
        raise PlanError("not started.")

    monkeypatch.setattr("data_synth.make_dataset", refused, raising=False)
    monkeypatch.setattr(
        "data_synth.dataset_folder.dataset_cost",
        lambda plan: DatasetCost(size_bytes=plan.records * plan.record_bytes, truth_bytes=12_000_000, seconds=1200.0),
    )
    code, out, err = run("dataset", "classification", "-o", tmp_path / "made")
    assert (code, "not started" in err) == (1, True)
    assert out.startswith("1000 records of ")
    assert ": 200 MB of samples and up to 12 MB of truth; about 20 minutes on one core" in out


def test_warnings_reach_the_user_as_a_line(run, request):
    turbine = request.path.parents[2] / "data" / "wind-turbine.toml"
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code, _, err = run("orders", turbine)
    assert code == 0
    assert err.startswith("warning: ")
    assert "16.18" in err


def test_convert_writes_no_hdf5_under_another_suffix(run, mat, tmp_path):
    code, _, err = run(*convert_words(mat, tmp_path / "a6.txt", "--no-tachometer"))
    assert code == 2
    assert err == f"hums: {tmp_path / 'a6.txt'}: records are HDF5 files; name it {tmp_path / 'a6.h5'}.\n"
    assert not (tmp_path / "a6.txt").exists()


def test_analyze_without_a_tachometer(run, mat, tmp_path):
    record = tmp_path / "record.h5"
    assert run(*convert_words(mat, record, "--no-tachometer"))[0] == 0
    words = ("analyze", record, "--gearbox", "two-stage", "-o", tmp_path / "out", "--no-envelope")
    code, _, err = run(*words)
    assert code == 1
    assert "--speed-range LOW HIGH --max-acceleration HZ_PER_S" in err
    code, _, err = run(*words, "--speed-range", 5, 40)
    assert (code, "how fast it may change, --max-acceleration HZ_PER_S" in err) == (2, True)
    code, _, err = run("fleet", *words[1:], "--max-acceleration", 1)
    assert code == 2
    assert "where the reference's speed lies in rev/s, --speed-range LOW HIGH" in err
    # one tone may be any of the orders, and that is said
    code, _, err = run(*words, "--speed-range", 5, 40, "--max-acceleration", 1)
    assert code == 1
    assert "ambiguous" in err


def test_analyze_passes_the_baseline_on(run, analysed, tmp_path):
    folder, _ = analysed
    record = folder / "record.h5"
    words = ("analyze", record, "--gearbox", "two-stage", "--tachometer", "tachometer", "--no-envelope")
    code, out, _ = run(*words, "-o", tmp_path / "two", "--baseline", folder / "out" / "analysis.h5")
    assert code == 0
    assert "speed of input: 1200 rpm (20 Hz)" in out
    assert "history of 2 records" in (tmp_path / "two" / "indicators.csv").read_text()
    assert run(*words, "-o", tmp_path / "three", "--freeze-baseline")[0] == 1


def test_report_is_made_again(run, analysed, tmp_path, monkeypatch):
    out = analysed[0] / "out"
    monkeypatch.setattr("hums.analysis.result.open_analysis", cache(open_analysis))  # the same file each time
    assert "ISO 20816, ours" in (out / "report.html").read_text()
    assert run("report", out / "analysis.h5", "-o", tmp_path / "again", "--units", "Hz")[0] == 0
    assert (tmp_path / "again" / "report.html").read_text() == (out / "report.html").read_text()
    shutil.copytree(tmp_path / "again", tmp_path / "in place")
    assert run("report", tmp_path / "in place")[1] == f"report: {tmp_path / 'in place' / 'report.html'}\n"
    with open_analysis(tmp_path / "in place" / "analysis.h5") as kept, open_analysis(out / "analysis.h5") as first:
        assert summary(kept) == summary(first)
    earlier = ("--baseline", out / "analysis.h5")
    assert run("report", out / "analysis.h5", "-o", tmp_path / "since", *earlier)[0] == 0
    assert "baseline record.h5" in (tmp_path / "since" / "report.html").read_text()


def test_steps_are_told_once_on_a_terminal(run, mat, tmp_path, monkeypatch, capsys):
    logger = logging.getLogger("hums")
    monkeypatch.setattr(logger, "handlers", [])
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    _, _, err = run(*convert_words(mat, tmp_path / "record.h5", "--no-tachometer"))
    logger.info("compiling, first run only")
    logger.info("compiling, first run only")
    assert err.count("hums: reading") == 1
    assert capsys.readouterr().err == "hums: compiling, first run only\n"
