"""What a stranger reads from record and analysis files, with the lines of the page and without this toolkit."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from hums.analysis.analyze import AnalysisSettings, analyze
from hums.analysis.result import group, save_analysis
from hums.gearbox.model import load_gearbox
from hums.records.record import NominalSpeed, make_record
from hums.records.store import save_record

PAGE = Path(__file__).parents[3] / "docs" / "file_layout.md"
WITHOUT_OURS = "import sys; sys.modules['hums'] = None\n"


def test_the_lines_of_the_page_read_what_was_written(tmp_path):
    values = np.random.default_rng(0).normal(size=8000)
    angle = NominalSpeed(rpm=1200, shaft="input")
    record = make_record({"input vertical": values}, rate_hz=4000, units="g", angle=angle, start_s=2.5)
    settings = AnalysisSettings(envelope_band_hz=None, pictures=False)
    analysis = analyze(record, load_gearbox("two-stage"), settings=settings)
    (tmp_path / "out").mkdir()
    save_record(record, tmp_path / "record.h5")
    save_analysis(analysis, tmp_path / "out" / "analysis.h5")
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    words = [sys.executable, "-c", WITHOUT_OURS + "".join(blocks)]
    told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    speed_hz = group(analysis, "speed")["speed_hz"].values[:2]
    component = group(analysis, "verdicts")["component"].values[:2].astype(object)
    of_record = f"{2.5 + np.arange(3) / 4000} g {values[:2]}"
    of_analysis = f"{speed_hz} {component}"
    assert told.splitlines() == [of_record, of_record, of_analysis, of_analysis]
