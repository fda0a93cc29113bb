"""The page on time and error of gears that vibrate: its rows and its picture."""

import fidelity

from hums.plots import save_figure


def test_the_report_has_a_row_for_each_way_and_a_picture(tmp_path):
    rows = fidelity.measure(fidelity.cases()["even teeth with errors"].changed(duration_s=0.1), repeats=1)
    auto, linear, *in_steps, dynamic = rows
    assert auto.name.startswith("auto: linear response: both differ by nothing")
    assert auto.decibels == linear.decibels < -100
    assert [row.name for row in in_steps] == [f"dynamic, {steps} to a sample" for steps in fidelity.STEPS]
    assert dynamic.decibels < -60
    save_figure(lambda ax: fidelity.draw(ax, {"even": rows}), tmp_path / "a.svg")
    assert "linear response" in (tmp_path / "a.svg").read_text(encoding="utf-8")
