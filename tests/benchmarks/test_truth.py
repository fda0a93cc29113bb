"""The page on the truth is made, and the lines of a kinematic tooth are nearly all of its record."""

import truth

from data_synth import load_scene


def test_the_page_is_written(tmp_path, capsys):
    demo = load_scene("demo").changed(duration_s=1.0)
    assert truth.main(tmp_path, (("demo", demo.changed(faults=demo.faults[:1])),)) == 0
    report = (tmp_path / "truth.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == report.strip()
    _, _, record, healthy, fault, *_ = report.splitlines()[-1].strip("| ").split(" | ")
    assert float(record) > 99
    assert float(healthy) > 99.99
    assert float(fault) > 95
