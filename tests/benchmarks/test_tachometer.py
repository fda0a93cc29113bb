"""The report on tachometers runs, and shows what is promised: 1e-6 rad at order 400 from clean pulses."""

import tachometer


def test_the_table_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tachometer, "INSTANTS", 20_001)
    monkeypatch.setattr(tachometer, "REPEATS", 1)
    monkeypatch.setattr(tachometer, "LONG", 6_000)
    tachometer.main(tmp_path)
    report = (tmp_path / "tachometer.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == report.strip()
    assert "6,000 pulses with jitter" in report
    rows = [line.strip("| ").split(" | ") for line in report.splitlines() if line.startswith("| ")]
    errors = {(row[0], row[1]): float(row[4]) for row in rows[2:]}
    assert len(errors) == 3 * len(tachometer.METHODS)
    assert errors["clean", "ours"] < 1e-6
    assert errors["jitter, faults", "ours"] < 1.2 * errors["jitter", "ours"]
    assert errors["jitter, faults", "linear"] > 1  # what is not repaired is a turn off and more
