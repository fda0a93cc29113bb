"""The README's sessions run as printed."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

README = Path(__file__).parents[1] / "README.md"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.slow
def test_python_sessions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sessions = blocks("python")
    assert len(sessions) == 2
    for session in sessions:
        exec(compile(session, "README", "exec"), {})  # noqa: S102
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.slow
def test_shell_session(tmp_path):
    data = {"vibration": np.random.default_rng(0).normal(size=200_000), "tach": np.arange(0, 2, 1 / 60)}
    savemat(tmp_path / "data.mat", data)
    (session,) = (block for block in blocks("sh") if "hums convert" in block)
    plain = re.sub(r" +#.*", "", session).replace("\\\n", " ")
    for line in plain.strip().splitlines():
        name, *words = shlex.split(line)
        assert name == "hums"
        subprocess.run([sys.executable, "-m", "hums.cli", *words], cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "out" / "report.html").exists()
