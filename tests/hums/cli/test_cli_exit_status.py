"""The exit status of every command, as docs/reference.md lists them."""

import os
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path

import numpy as np
import pytest
from gearboxes import SHORT_SCENE

from hums.jobs import Serial
from hums.records.record import NominalSpeed, make_record
from hums.records.store import save_record

PLAN = 'scene = "demo"\nrecords = 1\nseed = 7\n[change]\nduration_s = 0.2\nfault = []\n'
READ = "--channel vib --units g --rate-hz 5000 --no-tachometer"
BOX = "--gearbox two-stage -o out --no-envelope"


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """A record, its analysis, files of columns one of which is damaged, and hand-written files."""
    folder = tmp_path_factory.mktemp("material")
    noise = np.random.default_rng(0).normal(size=6000)
    angle = NominalSpeed(rpm=1200, shaft="input")
    save_record(make_record({"vib": noise}, rate_hz=5000, units="g", angle=angle), folder / "record.h5")
    (folder / "raw").mkdir()
    for name in ("a", "b"):
        np.savetxt(folder / "raw" / f"{name}.csv", noise, header="vib", comments="")
    (folder / "raw" / "damaged.csv").write_text("vib\n1\n2,3\n")
    (folder / "damaged.h5").write_text("nothing of the kind")
    (folder / "scene.toml").write_text(SHORT_SCENE)
    (folder / "plan.toml").write_text(PLAN)
    return folder


ROWS = [
    (0, "orders two-stage"), (1, "orders two-stag"), (2, "orders two-stage --csv --json"),
    (0, "bearings 6205"), (1, "bearings none"), (2, "bearings 6205 6206"),
    (0, "schema scene"), (2, "schema scenery"),
    (0, "drawing two-stage -o out/m.svg"), (1, "drawing damaged.h5 -o m.svg"), (2, "drawing two-stage"),
    (0, "dynamics wijianto-pair -o out --motions torsion"), (2, "dynamics two-stage --stability"),
    (2, "dynamics wijianto-pair -o out --rpm 0"),
    (0, "synth scene.toml -o new.h5"), (1, "synth damaged.h5 -o new.h5"), (2, "synth scene.toml"),
    (0, "dataset plan.toml -o out"), (1, "dataset scene.toml -o out"), (2, "dataset plan.toml -o out --workers none"),
    (0, "info record.h5"), (1, "info damaged.h5"), (2, "info"),
    (0, f"convert raw/a.csv new.h5 {READ}"), (1, f"convert raw/damaged.csv new.h5 {READ}"),
    (2, f"convert raw/a.csv raw/b.csv out {READ}"), (3, f"convert raw out {READ}"),
    (0, f"convert raw/a.csv raw/b.csv -o out {READ}"),
    (0, f"analyze record.h5 {BOX}"), (1, f"analyze damaged.h5 {BOX}"), (2, f"analyze record.h5 {BOX} --units m"),
    (2, f"analyze record.h5 {BOX} --false-alarm-probability 2"),
    (0, "report analysis.h5 -o out"), (1, "report record.h5 -o out"), (2, "report analysis.h5 --units m"),
    (0, f"fleet record.h5 {BOX}"), (1, f"fleet damaged.h5 {BOX}"), (2, f"fleet record.h5 {BOX} --baseline-records 0"),
    (3, f"fleet record.h5 damaged.h5 {BOX}"),
    (1, "demo -o record.h5"), (2, "demo --seed none"),
]  # fmt: skip


@pytest.mark.parametrize(("status", "words"), ROWS, ids=[f"{words} is {status}" for status, words in ROWS])
def test_exit_status(run, material, monkeypatch, tmp_path, status, words):
    monkeypatch.setattr("hums.jobs.Processes", lambda **_: Serial())  # processes cost seconds and add nothing here
    monkeypatch.chdir(material)
    if words.startswith("report") and not Path("analysis.h5").exists():
        run("analyze", "record.h5", *BOX.replace("out", "made").split())
        Path("made/analysis.h5").rename("analysis.h5")
    placed = [str(tmp_path / word) if word in {"out", "out/m.svg", "new.h5"} else word for word in words.split()]
    (tmp_path / "out").mkdir()
    code, out, err = run(*placed)
    assert code == status, err
    assert "Traceback" not in err
    assert bool(err) >= (status in {1, 2})
    if status == 3:
        assert out.splitlines()[-1].startswith("1 of ")


@pytest.mark.skipif(os.name != "posix", reason="a signal of POSIX")
@pytest.mark.parametrize("command", ["fleet", "convert"])
def test_ctrl_c_exits_130(command, tmp_path):
    noise = np.random.default_rng(0).normal(size=500_000)  # seconds of work
    if command == "convert":
        (tmp_path / "raw").mkdir()
        for number in range(30):
            np.savetxt(tmp_path / "raw" / f"{number}.csv", noise[:50_000], header="vib", comments="")
        words = ["convert", "raw", "out", *READ.split()]
    else:
        angle = NominalSpeed(rpm=1200, shaft="input")
        save_record(make_record({"vib": noise}, rate_hz=5_000, units="g", angle=angle), tmp_path / "record.h5")
        words = [command, "record.h5", "--gearbox", "two-stage", "-o", "out"]
    process = subprocess.Popen(
        [sys.executable, "-m", "hums", *words],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - jobs in the background ignore it
    )
    while process.poll() is None and not (tmp_path / "out").exists():
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130, told
    assert b"Traceback" not in told


def test_ctrl_c_in_a_callback_of_the_interpreter_is_not_lost(run, monkeypatch):
    def busy(_):
        weakref.finalize(type("Thing", (), {})(), signal.raise_signal, signal.SIGINT)  # which runs at once
        for _ in range(3000):
            time.sleep(0.01)

    monkeypatch.setattr("hums.gearbox.model.load_gearbox", busy)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    try:
        assert run("orders", "two-stage")[0] == 130
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize(
    ("status", "redirection", "unbuffered"),
    [(1, "> /dev/full", ""), (1, "> /dev/full", "1"), (0, "2> /dev/full", ""), (0, ">&-", ""), (0, "2>&-", "")],
)
def test_streams_that_take_nothing(status, redirection, unbuffered, monkeypatch):
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    told = subprocess.run(
        ["sh", "-c", f"exec {sys.executable} -m hums orders two-stage {redirection}"], capture_output=True, check=False
    )
    assert told.returncode == status, told.stderr
    assert (b"standard output: [Errno 28]" in told.stderr) == (status == 1)
