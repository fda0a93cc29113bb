"""Drafts of import descriptions: as TOML they hold what the file states, and convert it once one line is filled in."""

import tomllib

import numpy as np
import pytest
from logger_files import COUNT, write_logger_table
from scipy.io import savemat, wavfile

import hums
from hums.readers import read_file
from hums.readers.draft import draft

NOISE = np.random.default_rng(5).normal(size=1000)


def wav(path):
    wavfile.write(path, 8000, NOISE.astype(np.float32))


def mat(path):
    """As in the files of the Paderborn bearing data: Y(3).Data beside slower quantities."""
    rows = [("force", NOISE[:40], "kN"), ("speed", NOISE[:40], ""), ("vibration_1", NOISE, "")]
    savemat(
        path, {"K001": {"Y": np.array(rows, dtype=[("Name", "O"), ("Data", "O"), ("Unit", "O")])}, "Serial": "4711"}
    )


@pytest.mark.parametrize(
    ("name", "write", "filled", "channel", "rate_hz"),
    [
        ("log.csv", write_logger_table, ("time_zone = ",), "DE", 1000),
        ("a.wav", wav, ('"channel 1" = "g"',), "channel 1", 8000),
        ("K001.mat", mat, ("rate_hz = ", 'vibration_1 = "g"'), "vibration_1", 25600),
        ("a.npz", lambda path: np.savez(path, DE=NOISE, fs=12_000, units="g"), (), "DE", 12000),
    ],
)
def test_a_draft_converts_its_file_once_it_is_filled_in(tmp_path, name, write, filled, channel, rate_hz):
    write(tmp_path / name)
    text = draft(read_file(tmp_path / name))
    for key in (f"# {line.partition(' = ')[0]} = " for line in ("no_tachometer = true", *filled)):
        asked = next(line for line in text.splitlines() if line.startswith(key))
        text = text.replace(asked, asked.removeprefix("# ").replace('"..."', '"g"'))
    (tmp_path / "import.toml").write_text(text, encoding="utf-8")
    record = hums.convert(tmp_path / name, tmp_path / "import.toml")
    assert record.attrs["rate_hz"] == rate_hz
    assert record[channel].attrs["units"] == "g"


def test_a_draft_says_what_was_recognised_and_what_is_needed(tmp_path):
    text = draft(read_file(write_logger_table(tmp_path / "log.csv")))
    told = tomllib.loads(text)
    assert told["channels"] == ["DE", "ND"]
    assert (told["units"], told["measured"]) == ({"DE": "g", "ND": "mm/s"}, {"Öl": "°C"})
    assert [told[key] for key in ("separator", "decimal", "encoding", "header_lines")] == [";", ",", "cp1252", 12]
    assert "Sampling rate: 1000 Hz" in text
    assert "the time zone of 2024-10-27T10:27:00" in text
    assert f"Zeit ({COUNT} values)" in text
    np.savez(tmp_path / "a.npz", DE=NOISE, tach=NOISE[:9])
    text = draft(read_file(tmp_path / "a.npz"))
    assert "Sampling, needed: a.npz does not state its sampling rate" in text
    assert 'DE = "..."  # needed: one of g, m s-2' in text
    assert "tach (9 values)" in text


@pytest.mark.parametrize("name", ['a "quoted" name', "back\\slash", "[bracket", "Ölfilm", "a = 3 # b", "'"])
def test_any_name_of_a_column_is_toml(tmp_path, name):
    np.savez(tmp_path / "a.npz", **{name: NOISE})
    text = draft(read_file(tmp_path / "a.npz"))
    assert tomllib.loads(text)["channels"] == [name]
    line = next(one for one in text.splitlines() if one.endswith(", 1") or "# needed: one of" in one)
    assert tomllib.loads(line.removeprefix("# "))[name] == "..."


def test_the_command_writes_and_does_not_overwrite(run, tmp_path):
    write_logger_table(tmp_path / "log.csv")
    code, out, _ = run("info", tmp_path / "log.csv", "--draft", tmp_path / "import.toml")
    assert (code, "fill in what is missing" in out) == (0, True)
    assert tomllib.loads((tmp_path / "import.toml").read_text(encoding="utf-8"))["header_lines"] == 12
    code, _, err = run("info", tmp_path / "log.csv", "--draft", tmp_path / "import.toml")
    assert (code, "is not replaced" in err) == (1, True)
    text = (tmp_path / "import.toml").read_text(encoding="utf-8")
    (tmp_path / "import.toml").write_text(text.replace("# time_zone", "time_zone", 1), encoding="utf-8")
    words = ("convert", tmp_path / "log.csv", tmp_path / "r.h5", "-d", tmp_path / "import.toml", "--no-tachometer")
    assert run(*words)[0] == 0
    assert "in mm s-1" in run("info", tmp_path / "r.h5")[1]
