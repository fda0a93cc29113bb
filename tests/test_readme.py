"""The README's sessions run as printed."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from hums.cli import main

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
def test_shell_session(tmp_path, monkeypatch):
    data = {"vibration": np.random.default_rng(0).normal(size=200_000), "tach": np.arange(0, 2, 1 / 60)}
    savemat(tmp_path / "data.mat", data)
    (session,) = (block for block in blocks("sh") if "hums convert" in block)
    plain = re.sub(r" +#.*", "", session).replace("\\\n", " ")
    monkeypatch.chdir(tmp_path)
    for line in plain.strip().splitlines():
        words = shlex.split(line)
        assert words[0] == "hums"
        monkeypatch.setattr(sys, "argv", words)
        assert main() == 0
    assert (tmp_path / "out" / "report.html").exists()
