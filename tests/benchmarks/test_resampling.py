"""The report on resampling is written, and its peers are what they are called."""

import numpy as np
import resampling


def test_the_report_is_written(tmp_path, capsys):
    resampling.main(tmp_path, samples=30_000, repeats=1)
    report = (tmp_path / "resampling.md").read_text(encoding="utf-8")
    assert report.strip() in capsys.readouterr().out
    rows = dict(line.split(" | ", 1) for line in report.splitlines() if line.startswith("| "))
    assert {"| np.interp", "| sinc, whole", "| sinc, given", "| CubicSpline"} <= rows.keys()
    error = {name: float(cells.split(" | ")[4]) for name, cells in rows.items() if name not in ("| method", "| ---")}
    assert error["| sinc, whole"] < 2e-6  # the claim, at order 400
    assert error["| np.interp"] > 0.1
    assert (tmp_path / "resampling.svg").read_text(encoding="utf-8").count("<svg") == 1


def test_given_places_give_what_the_whole_gives():
    record = resampling.Record.made(20_000)
    x = record.tone(200)
    for method in ("sinc", "cubic", "linear"):
        given, whole = (make(method).prepare(record, 1024)(x) for make in (resampling.given, resampling.whole))
        np.testing.assert_allclose(given, whole, rtol=0, atol=1e-7)  # places to 1e-8 of a step
