"""Averages in angle: indicators of closed forms, what is refused by name, and the fleet and report that take them."""

import numpy as np
import pytest

import hums
from hums.analysis.averages import envelope_depths
from hums.analysis.settings import AnalysisError
from hums.fleet.fleet_analysis import analyze_fleet
from hums.records.quantities import AngularAverage
from hums.records.record import make_record
from hums.records.store import save_record

PER_REV, TEETH, DEPTH = 512, 36, 0.2
ANGLE = 2 * np.pi * np.arange(PER_REV) / PER_REV
MESH = (1 + DEPTH * np.cos(ANGLE)) * np.cos(TEETH * ANGLE)


def average(values, component="planet 1", *, units="g", over=50, **changes):
    angle = AngularAverage(component=component, samples_per_rev=PER_REV, averaged_over=over)
    return make_record({"ring": values}, angle=angle, units=units, machine="rig", **changes)


@pytest.fixture(scope="module")
def gearbox():
    return hums.load_gearbox("planetary-27-36-99")


def indicators(record, gearbox):
    table = hums.indicator_table(hums.analyze(record, gearbox))
    return table.set_index(["component", "indicator"])


@pytest.fixture(scope="module")
def table(gearbox):
    """A mesh with one sideband pair, and between the meshes order 10 that is modulated twice a revolution."""
    left = 0.05 * (1 + 0.4 * np.cos(2 * ANGLE)) * np.cos(10 * ANGLE)
    return indicators(average(MESH + left), gearbox)


GEAR = "planet-ring/planet 1"


def test_indicators_of_a_closed_form(table):
    value = table["value"]
    assert value["record", "rms"] == pytest.approx(np.sqrt(0.5 * (1 + DEPTH**2 / 2) + 0.05**2 / 2 * 1.08), rel=1e-6)
    assert value[GEAR, "sideband_index"] == pytest.approx(DEPTH / 2, rel=1e-9)
    # the residual keeps the sidebands of the mesh, the difference signal does not
    assert value["planet 1", "residual_rms"] == pytest.approx(np.sqrt(DEPTH**2 / 4 + 0.05**2 / 2 * 1.08), rel=1e-6)
    assert np.isfinite(value[GEAR, "fm4"])
    assert np.isfinite(value[GEAR, "na4"])  # the first of its history: the kurtosis of the residual signal
    assert value[GEAR, "na4"] == pytest.approx(value["planet 1", "residual_kurtosis"], rel=0.02)


@pytest.mark.parametrize("depth", [0.0, 0.3, 0.9])
def test_envelope_lines_over_the_mean_of_the_envelope(gearbox, depth):
    # without a gear the whole average is demodulated: carrier, and level, do not matter
    values = 7 + 3 * (1 + depth * np.cos(3 * ANGLE)) * np.cos(99 * ANGLE)
    found = indicators(average(values, "carrier"), gearbox)["value"]
    assert [found["carrier", f"envelope_line_{order}"] for order in (1, 2, 3)] == pytest.approx([0, 0, depth], abs=1e-9)


def test_envelope_lines_do_not_depend_on_the_level():
    values = (1 + 0.5 * np.cos(ANGLE)) * np.cos(40 * ANGLE)
    assert envelope_depths(1e-6 * values, harmonics=2) == pytest.approx(envelope_depths(values, harmonics=2))
    with pytest.raises(ValueError, match="zero throughout"):
        envelope_depths(0 * values, harmonics=2)


def test_the_rest_is_refused_by_name(table):
    why = table["withheld"]
    assert "no time" in why["planet 1", "velocity_rms"]
    assert "not whole orders" in why["planet 1", "defect_energy"]
    assert "average over a carrier" in why["planet 1", "carrier_sideband_ratio"]
    assert (table["value"].isna() == (why != "")).all()


def test_a_link_without_gears_says_so(gearbox):
    found = indicators(average(MESH, "carrier"), gearbox)
    assert "carrier carries no gear" in found["withheld"]["carrier", "fm4"]
    assert found["withheld"]["carrier", "carrier_sideband_ratio"] == ""


def test_levels_of_a_standardised_average_are_withheld(gearbox):
    found = indicators(average((MESH - MESH.mean()) / MESH.std(), units="1"), gearbox)
    assert "deviation of one" in found["withheld"]["record", "rms"]
    assert found["value"]["record", "kurtosis"] == pytest.approx(np.mean(MESH**4) / np.mean(MESH**2) ** 2, rel=1e-6)


def test_several_revolutions_are_averaged_further(gearbox):
    rng = np.random.default_rng(0)
    turns = np.concatenate([MESH + rng.normal(0, 0.3, PER_REV) for _ in range(400)])
    found = indicators(average(turns, over=None), gearbox)
    assert found["value"][GEAR, "sideband_index"] == pytest.approx(DEPTH / 2, abs=4 * 0.3 * np.sqrt(2 / PER_REV / 400))
    assert "average of 400 revolutions" in found["takes"][GEAR, "fm0"]


def test_nothing_is_judged(gearbox):
    verdicts = hums.verdict_table(hums.analyze(average(MESH), gearbox))
    assert set(verdicts["verdict"]) == {"not judged"}
    reasons = verdicts.set_index(["component", "kind"])["doubts"]
    assert "scatter between revolutions" in reasons["planet-ring/planet", "tooth"]
    assert "average over planet 1" in reasons["sun-planet/sun", "tooth"]
    assert "averaging removed" in reasons["carrier front", "inner_race"]


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (average(MESH, "planet 4"), 'does not have as a link; did you mean "planet 3"'),
        (average(np.ones(PER_REV)), "same value"),
        (average(np.where(np.arange(PER_REV) == 7, np.nan, MESH)), "not finite"),
    ],
)
def test_what_cannot_be_analysed(gearbox, record, said):
    with pytest.raises(AnalysisError, match=said):
        hums.analyze(record, gearbox)


def test_a_fleet_and_a_report_take_it(gearbox, tmp_path):
    for day in range(1, 4):
        values = MESH + np.random.default_rng(day).normal(0, 0.01, PER_REV)
        save_record(average(values, recorded_at=f"2020-01-0{day}T00:00:00Z"), tmp_path / f"{day}.h5")
    fleet = analyze_fleet([tmp_path / f"{day}.h5" for day in range(1, 4)], gearbox, tmp_path / "fleet")
    assert (fleet.records, fleet.failed) == (3, 0)
    analysis = hums.analyze(tmp_path / "1.h5", gearbox)
    page = hums.write_report(analysis, tmp_path / "report").read_text(encoding="utf-8")
    assert "unknown: the record is a synchronous average" in page
    settings = hums.MonitorSettings(baseline_records=2)
    judged = [
        hums.watch(hums.analyze(tmp_path / f"{day}.h5", gearbox), tmp_path / "rig.state", settings=settings).judged
        for day in range(1, 4)
    ]
    assert judged == [False, False, True]
