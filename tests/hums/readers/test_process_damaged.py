"""Damaged files of every reader: a result or a sentence that names the file, and the calling process lives."""

import numpy as np
import pytest
from attacks.damaged_files import attack_files, valid_files

import hums
from hums.readers import process
from hums.readers.process import ReaderProcess

pytestmark = pytest.mark.skipif(not process._FORKS, reason="a fork starts at once")
FILES = 8  # of each reader; benchmarks/attack.py reads thousands


def test_damaged_files_give_a_result_or_a_sentence(tmp_path):
    pytest.importorskip("nptdms")
    pytest.importorskip("pyuff")
    rows, wrong = attack_files(tmp_path, count=FILES, seed=7)
    assert len(rows) == len(valid_files(tmp_path))
    assert not wrong


def test_an_earlier_analysis_is_read_in_the_process(tmp_path):
    rng = np.random.default_rng(0)
    record = hums.make_record(
        {"housing": rng.normal(size=8000)}, rate_hz=4000, units="g", angle=hums.NominalSpeed(rpm=1200, shaft="input")
    )
    analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    hums.save_analysis(analysis, tmp_path / "analysis.h5")
    with ReaderProcess() as reader, reader.open_tree(tmp_path / "analysis.h5") as there:
        with hums.open_analysis(tmp_path / "analysis.h5") as here:
            assert there.identical(here)
        assert hums.summary(there) == hums.summary(analysis)


def test_a_name_that_is_no_utf8_is_refused_by_name(tmp_path):
    (tmp_path / "log.csv").write_bytes(b"time,vib\xff\n0.0,1\n0.1,2\n")
    with ReaderProcess() as reader, pytest.raises(hums.RecordError, match=r"log\.csv") as caught:
        reader.convert(tmp_path / "log.csv", channels=["vib"], units="g", rate_hz=10, no_tachometer=True)
    assert str(caught.value).isprintable()


def test_no_message_is_longer_than_a_page(tmp_path):
    names = ",".join(f"column number {number}" for number in range(2000))
    (tmp_path / "wide.csv").write_text(f"{names}\n{','.join(['1'] * 2000)}\n", encoding="utf-8")
    with pytest.raises(hums.RecordError, match=r"wide\.csv") as caught:
        hums.convert(tmp_path / "wide.csv", channels=["x" * 5000 + "\x1b[2J"], units="g", rate_hz=10)
    assert len(str(caught.value)) <= 1000
    assert str(caught.value).isprintable()
