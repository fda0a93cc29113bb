"""The README's sessions run as printed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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


@pytest.mark.slow
def test_shell_session(tmp_path):
    (gearbox,) = blocks("toml")
    (tmp_path / "my-gearbox.toml").write_text(gearbox)
    write_csv(tmp_path / "measured.csv", 0)
    (tmp_path / "folder").mkdir()
    write_csv(tmp_path / "folder" / "monday.csv", 1)
    (session,) = (block for block in blocks("sh") if "my-gearbox" in block)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path}
    subprocess.run(["bash", "-euo", "pipefail", "-c", session], cwd=tmp_path, env=environment, check=True)
    for page in ("out/report.html", "fleet/fleet.html"):
        assert (tmp_path / page).exists()
