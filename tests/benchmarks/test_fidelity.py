"""The report on fidelity: every scene of it keeps its floor, and the picture is drawn."""

import fidelity
import numpy as np
import pytest

from data_synth.fidelity.choice import KINEMATIC
from hums.plots import save_figure

# All but two whose stages, and the choice for them, are those of the cracked one.
CASES = {
    name: scene
    for name, scene in fidelity.cases().items()
    if name not in ("two-stage demo", "with a chipped and a cracked tooth")
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_auto_is_within_its_floor(name):
    auto, full = (
        fidelity.channels(fidelity.at(CASES[name].changed(duration_s=0.3), level)) for level in ("auto", "full")
    )
    floor_db = CASES[name].dynamics.floor_db
    # 1 dB: the floor holds on the piece that decides, and errors of steps, -60 dB, come on top
    assert fidelity.apart_db(auto, full) < floor_db + 1


def test_the_report_has_a_row_for_each_fidelity_and_a_picture(tmp_path):
    rows = fidelity.measure(fidelity.cases()["even teeth with errors"].changed(duration_s=0.1), repeats=1)
    assert [row.level for row in rows] == ["auto", KINEMATIC, "torsional", "lateral", "full"]
    auto, kinematic, torsional, lateral, full = rows
    assert auto.chosen == "kinematic"
    assert auto.decibels == kinematic.decibels < -57
    assert torsional.decibels < -40  # stiffness is constant, so what is left out follows exactly
    assert full.decibels == -np.inf
    assert lateral.decibels < fidelity.EXACT_DB
    save_figure(lambda ax: fidelity.draw(ax, {"even": rows}), tmp_path / "a.svg")
    assert "torsional" in (tmp_path / "a.svg").read_text(encoding="utf-8")
