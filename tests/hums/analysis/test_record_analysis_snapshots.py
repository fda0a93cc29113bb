"""Snapshots too short for lines: pooled, they show what none shows; what they do not resolve is not judged."""

import os
from pathlib import Path

import numpy as np
import pytest

import hums
from hums.analysis.result import AnalysisError
from hums.records.record import NominalSpeed, make_record
from hums.records.snapshots import join_snapshots
from hums.records.store import save_record

RATE_HZ, COUNT, RPM = 25600.0, 2560, 1800.0  # three turns
OUTER, INNER = 13 / 2 * (1 - 3.5 / 25.6), 13 / 2 * (1 + 3.5 / 25.6)
SETTINGS = hums.AnalysisSettings(most_tracks=0, pictures=False)
RIG = """
name = "rig"
frame = "housing"
reference = "shaft"
[axes]
main = ["housing", "shaft"]
[[bearing]]
name = "test"
inner_ring = "shaft"
outer_ring = "housing"
elements = 13
element_diameter_mm = 3.5
pitch_diameter_mm = 25.6
"""


@pytest.fixture(scope="module")
def gearbox(tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    return hums.load_gearbox(path)


def snapshots(count, *, order, depth, seed=0, samples=COUNT):
    """Noise whose level a defect modulates, with five harmonics, at a phase of its own in each snapshot."""
    rng = np.random.default_rng(seed)
    cycles = order * RPM / 60 * np.arange(samples) / RATE_HZ
    passed = 2 * np.pi * (cycles + rng.uniform(size=(count, 1)))
    level = 1 + depth * sum(np.cos(k * passed) for k in range(1, 6))
    angle = NominalSpeed(rpm=RPM, shaft="shaft")
    return join_snapshots(
        [
            make_record({"h": row}, rate_hz=RATE_HZ, units="g", angle=angle, machine="rig")
            for row in level * rng.normal(size=(count, samples))
        ]
    )


def verdicts(record, gearbox):
    return hums.verdict_table(hums.analyze(record, gearbox, settings=SETTINGS)).set_index("kind")


@pytest.fixture(scope="module")
def outer(gearbox):
    return hums.analyze(snapshots(100, order=OUTER, depth=0.3), gearbox)


def test_many_show_what_one_does_not(gearbox, outer):
    longer = {"order": OUTER, "depth": 0.08, "samples": 4 * COUNT}
    assert verdicts(snapshots(1, **longer), gearbox)["verdict"]["outer_race"] == "not judged"
    pooled = verdicts(snapshots(100, **longer), gearbox)
    assert pooled["verdict"]["outer_race"] in {"indicated", "diagnosed"}
    assert pooled["depth"]["outer_race"] == pytest.approx(0.08, abs=0.02)
    # three turns resolve too little to tell whose comb it is: its line is stated, and no clean bill given
    short = hums.verdict_table(outer).set_index("kind")
    assert (short["verdict"]["outer_race"], short["depth"]["outer_race"]) == (
        "not judged",
        pytest.approx(0.3, abs=0.03),
    )
    assert set(pooled["verdict"].drop("outer_race")) <= {"not judged", "nothing found"}


def test_lines_nearer_than_a_snapshot_resolves_are_not_judged(gearbox):
    found = verdicts(snapshots(100, order=INNER, depth=0.3), gearbox)
    assert set(found["verdict"][["inner_race", "rolling_element"]]) == {"not judged"}
    assert found["doubts"].str.contains("segments this short resolve 0.5 orders").sum() >= 1


def test_noise_names_nothing(gearbox):
    named = [
        verdict
        for seed in range(2)
        for verdict in verdicts(snapshots(20, order=OUTER, depth=0.0, seed=seed), gearbox)["verdict"]
    ]
    assert not {"indicated", "diagnosed"} & set(named)


def test_the_resolution_is_stated_and_the_rest_is_withheld(outer):
    (note,) = [note for note in hums.summary(outer)["notes"] if "analysed together" in note]
    assert "100 blocks of 2.875 revolutions" in note
    assert "closer to each other than 0.5 orders are not resolved" in note
    table = hums.indicator_table(outer).set_index("indicator")
    assert "cannot be averaged" in table["withheld"]["fm4"]
    assert table["value"]["rms"] == pytest.approx(np.sqrt(1 + 5 * 0.3**2 / 2), rel=0.01)
    assert hums.derive_verdicts(outer)  # from the groups alone


def test_snapshots_with_gaps_are_left_out(gearbox):
    record = snapshots(12, order=OUTER, depth=0.3)
    values = record.h.values.copy()
    values[3, 7], values[5] = np.nan, 0.0
    gapped = record.assign(h=record.h.copy(data=values))
    notes = hums.summary(hums.analyze(gapped, gearbox, settings=SETTINGS))["notes"]
    assert any("11 segments between gaps" in note and "1 sample that is not finite" in note for note in notes)
    with pytest.raises(AnalysisError, match="same value -0 throughout"):
        hums.analyze(record.assign(h=record.h.copy(data=0 * values)), gearbox)


def test_a_fleet_and_a_report_take_them(gearbox, outer, tmp_path):
    save_record(snapshots(8, order=OUTER, depth=0.3), tmp_path / "a.h5")
    fleet = hums.analyze_fleet([tmp_path / "a.h5"], gearbox, tmp_path / "fleet")
    assert (fleet.records, fleet.failed) == (1, 0)
    page = hums.write_report(outer, tmp_path / "report").read_text(encoding="utf-8")
    assert "analysed together" in page


def test_the_end_of_a_measured_run_to_failure(gearbox):
    path = Path(os.environ.get("HUMS_REAL_DATA", "")) / "pronostia" / "bearing1_1.npz"
    if not path.is_file():
        pytest.skip("no measured records; name their folder in HUMS_REAL_DATA")
    segment = np.load(path)["milli_g"][-40:] / 1000
    angle = NominalSpeed(rpm=RPM, shaft="shaft")
    parts = [make_record({"h": h, "v": v}, rate_hz=RATE_HZ, units="g", angle=angle) for h, v in segment]
    found = verdicts(join_snapshots(parts), gearbox)
    assert found["depth"].max() > 0.2  # something modulates the level, at the line of inner race or rolling element
    assert set(found["verdict"][["inner_race", "rolling_element"]]) == {"not judged"}
