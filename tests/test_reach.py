"""An analysis and its report write into their folder and the user's caches alone, and connect to nothing."""

import os
import sys
from pathlib import Path

import numpy as np

import hums

WATCHED = {"open", "os.mkdir", "os.rename", "socket.connect", "socket.getaddrinfo"}
SEEN: list[tuple[str, tuple[object, ...]]] = []
ON: list[bool] = []


def watch(event, arguments):
    if ON and event in WATCHED:
        SEEN.append((event, arguments))


def places():
    """Yield what was written or connected to."""
    for event, arguments in SEEN:
        if event == "open":
            path, mode, flags = arguments
            if isinstance(path, str | bytes | os.PathLike) and (
                flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) if mode is None else set(mode or "r") & set("wxa+")
            ):
                yield os.fsdecode(path)
        else:
            yield os.fsdecode(arguments[0]) if event.startswith("os.") else event


def test_an_analysis_reaches_nothing_beyond_its_folder(tmp_path):
    noise = np.random.default_rng(0).normal(size=4000)
    angle = hums.NominalSpeed(rpm=1200, shaft="input")
    record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    sys.addaudithook(watch)  # stays, but sees nothing once `ON` is empty
    ON.append(True)
    try:
        hums.save_record(record, tmp_path / "record.h5")
        analysis = hums.analyze(tmp_path / "record.h5", hums.load_gearbox("two-stage"))
        hums.write_report(analysis, tmp_path / "report")
    finally:
        ON.clear()
    assert (tmp_path / "report" / "report.html").exists()
    written = {Path(place) for place in places()}
    assert tmp_path / "report" in {path.parent for path in written}
    caches = [tmp_path, Path.home() / ".cache", Path.home() / ".config" / "matplotlib", Path(os.devnull)]
    beyond = {path for path in written if not any(path.is_relative_to(place) for place in caches)}
    assert not {path for path in beyond if "__pycache__" not in path.parts}  # of compiled code
