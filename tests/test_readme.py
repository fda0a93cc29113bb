"""The README's sessions run as printed."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hums.cli import main
from hums.jobs import Serial

README = Path(__file__).parents[1] / "README.md"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.slow
def test_python_session(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (session,) = blocks("python")
    exec(compile(session, "README", "exec"), {})  # noqa: S102
    assert (tmp_path / "out" / "report.html").exists()


def write_csv(path, seed):
    time = np.arange(5000) / 2500
    mesh = np.cos(2 * np.pi * 19 * 1450 / 60 * time) + np.random.default_rng(seed).normal(0, 0.3, time.size)
    np.savetxt(path, np.column_stack([time, mesh]), fmt="%.6f", delimiter=",", header="time (s),DE (g)", comments="")


NOTED = """
hums() { printf '%s\\0' hums "$@" >> noted; printf '\\n' >> noted; }
"""


@pytest.mark.slow
def test_shell_session(tmp_path, monkeypatch, capsys):
    """A shell reads the session, and each command runs as it has read it; the first is the one that is installed."""
    (gearbox,) = blocks("toml")
    (tmp_path / "my-gearbox.toml").write_text(gearbox)
    write_csv(tmp_path / "measured.csv", 0)
    (tmp_path / "folder").mkdir()
    write_csv(tmp_path / "folder" / "mill_2026-10-01.csv", 1)
    (session,) = (block for block in blocks("sh") if "my-gearbox" in block)
    subprocess.run(["bash", "-euo", "pipefail", "-c", NOTED + session], cwd=tmp_path, check=True)
    first, *others = (line.split("\0")[:-1] for line in (tmp_path / "noted").read_text().splitlines())
    installed = Path(sys.executable).parent / first[0]
    subprocess.run([installed, *first[1:]], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hums.jobs.Processes", lambda **_: Serial())  # processes have tests of their own
    for words in others:
        monkeypatch.setattr(sys, "argv", words)
        assert main() == 0, capsys.readouterr().err
    assert [words[1] for words in (first, *others)] == re.findall(r"^hums (\w+)", session, flags=re.MULTILINE)
    for page in ("out/report.html", "fleet/fleet.html"):
        assert (tmp_path / page).exists()
