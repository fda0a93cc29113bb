"""The exit status of `hums` as a shell sees it."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from hums.records.record import NominalSpeed, make_record
from hums.records.store import save_record


@pytest.mark.skipif(os.name != "posix", reason="a signal of POSIX")
@pytest.mark.parametrize("command", ["analyze", "fleet"])
def test_ctrl_c_exits_130(command, tmp_path):
    noise = np.random.default_rng(0).normal(size=500_000)  # seconds of work
    angle = NominalSpeed(rpm=1200, shaft="input")
    save_record(make_record({"vib": noise}, rate_hz=5_000, units="g", angle=angle), tmp_path / "record.h5")
    words = [sys.executable, "-m", "hums", command, "record.h5", "--gearbox", "two-stage", "-o", "out"]
    process = subprocess.Popen(
        words,
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
