"""Files that crash, fill or hang the process that reads them: a sentence with their name, and the next one reads."""

import os
import signal
import sys
import time
import warnings

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import hums
from hums.readers import process
from hums.readers.process import ReaderProcess
from hums.records.fields import RecordWarning
from hums.records.store import open_record, save_record

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="what a file does is patched into the fork")
NOISE = np.random.default_rng(4).normal(size=(2, 30_000))
DECLARED = {"channels": ["vib"], "units": "g", "rate_hz": 1000, "no_tachometer": True}


@pytest.fixture
def path(tmp_path):
    pulses = hums.PulseTimes(times_s=np.arange(0, 30, 0.1), shaft="input", pulses_per_rev=1)
    settings = {"rate_hz": 1000, "units": "g", "angle": pulses, "attrs": {"gain": np.float32(3), "axes": [1, 2]}}
    record = hums.make_record({"a": NOISE[0], "b": NOISE[1].astype(np.float32)}, **settings)
    save_record(record, tmp_path / "good.h5")
    return tmp_path / "good.h5"


@pytest.fixture
def evil(path, monkeypatch):
    """A function that makes the next processes do something when they open the file evil.h5."""
    save_record(open_record(path).load(), path.with_name("evil.h5"))

    def install(deed):
        def opened(file):
            if str(file).endswith("evil.h5"):
                deed()
            return open_record(file)

        monkeypatch.setattr(process, "open_record", opened)
        return path.with_name("evil.h5")

    return install


def test_a_record_is_the_same_there_and_here(path):
    with ReaderProcess() as reader, reader.open_record(path) as there, open_record(path) as here:
        assert_array_equal(there.a[10:2000:7], NOISE[0][10:2000:7])  # before all of it is in memory
        assert_array_equal(there.b[-5:], NOISE[1][-5:].astype(np.float32))
        assert there.identical(here)
        assert there.a.dtype == here.a.dtype


def test_convert_is_the_same_there_and_here(tmp_path):
    np.savetxt(tmp_path / "log.csv", NOISE[0][:500], header="vib", comments="")
    with ReaderProcess() as reader:
        assert reader.convert(tmp_path / "log.csv", **DECLARED).identical(
            hums.convert(tmp_path / "log.csv", **DECLARED)
        )
        with pytest.raises(hums.RecordError, match=r"log\.csv has no \"vab\"\. Did you mean 'vib'"):
            reader.convert(tmp_path / "log.csv", **DECLARED | {"channels": ["vab"]})


@pytest.mark.parametrize(
    ("deed", "sentence"),
    [
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), r"evil\.h5: the process that reads it crashed \(SIGSEGV\)"),
        (lambda: os._exit(3), r"evil\.h5: the process that reads it ended"),
        (lambda: any(iter(int, 1)), r"evil\.h5: the process that reads it took more than 0\.5\d* s of processor"),
        (lambda: np.ones(1 << 27), r"evil\.h5 needs more memory than a reader may use"),
        (lambda: {}["a"], r"evil\.h5 cannot be read \(KeyError"),
    ],
)
def test_a_file_that_ends_the_process_is_named_and_the_next_one_reads(path, evil, monkeypatch, deed, sentence):
    monkeypatch.setattr(process, "_PATIENCE", 100)  # on a machine with much to do half a second of work takes long
    file = evil(deed)
    with ReaderProcess(cpu_s=0.5, memory_bytes=1 << 28) as reader:
        with pytest.raises(hums.RecordError, match=sentence):
            reader.open_record(file)
        with reader.open_record(path) as record:
            assert_array_equal(record.a, NOISE[0])


def test_a_process_that_waits_for_ever_is_ended(evil, monkeypatch):
    monkeypatch.setattr(process, "_PATIENCE", 0.5)
    file = evil(lambda: time.sleep(1000))
    with ReaderProcess(cpu_s=0.5) as reader, pytest.raises(hums.RecordError, match="did not answer within"):
        reader.open_record(file)


def test_killed_while_a_record_is_open_the_next_access_says_so(path):
    with ReaderProcess() as reader:
        record = reader.open_record(path)
        os.kill(reader._running[0].pid, signal.SIGKILL)
        with pytest.raises(hums.RecordError, match=r"good\.h5: the process that reads it crashed \(SIGKILL\)"):
            record.a.load()
        with pytest.raises(hums.RecordError, match=r"good\.h5 is no longer open"):
            record.a.load()


def test_warnings_come_back(evil):
    file = evil(lambda: warnings.warn("odd", RecordWarning, stacklevel=1))
    with ReaderProcess() as reader, pytest.warns(RecordWarning, match="odd"):
        reader.open_record(file)
