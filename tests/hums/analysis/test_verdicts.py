"""Every part of the drawing has a verdict; each is derived from the file, and turns where it says it would."""

import json
import math
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from hums.analysis.evidence import PartEvidence
from hums.analysis.findings import where_none_is_named
from hums.analysis.gear_damage import GearJudgement
from hums.analysis.record_analysis import analyze
from hums.analysis.result import (
    findings_table,
    group,
    open_analysis,
    rows_dataset,
    rows_of,
    save_analysis,
    summary,
    verdict_table,
)
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.thresholds import CLEAR_SCORE, LEAST_SCORE
from hums.analysis.verdicts import derive_verdicts
from hums.gearbox.defect_orders import BEARING_KINDS, defects
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import load_gearbox
from hums.records.record import PulseTimes, make_record

GEARBOX = load_gearbox("two-stage")
PARTS = {
    (row.component, row.kind)
    for row in defects(solve_kinematics(GEARBOX))
    if row.kind in {*BEARING_KINDS, "tooth", "shaft"}
}
MESHES = (23, 23 * 19 / 67)
SPEED_HZ = 20.0
PLAIN = AnalysisSettings(most_tracks=0, pictures=False)


def analysed(seconds=6.0, *, rate_hz=5000, settings=PLAIN, add=None, speed_hz=SPEED_HZ, baseline=None, noise=0.1):
    time = np.arange(int(rate_hz * seconds)) / rate_hz
    values = np.random.default_rng(1).normal(0, noise, time.size) + (0 if add is None else add(time))
    for order in MESHES:  # without any line nothing confirms the speed
        values += 0.2 * noise * sum(np.cos(2 * np.pi * k * order * speed_hz * time) for k in (1, 2))
    pulses = PulseTimes(times_s=np.arange(0.0, seconds, 1 / speed_hz), shaft="input", pulses_per_rev=1)
    record = make_record({"a": values}, rate_hz=rate_hz, units="g", angle=pulses)
    return analyze(record, GEARBOX, settings=settings, baseline=baseline)


def rows(analysis):
    return verdict_table(analysis).set_index(["component", "kind"])


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"seconds": 1.0}, "too short"),
        ({"seconds": 0.5}, "too short"),
        ({"seconds": 0.25}, "too short"),
        ({"rate_hz": 600}, "out of band"),
        ({"settings": PLAIN.changed(envelope_band_hz=(900.0, 960.0))}, "out of band"),
        ({"settings": PLAIN.changed(envelope_band_hz=None)}, "out of band"),
    ],
    ids=["1 s", "half a second", "a quarter", "slow", "narrow band", "no band"],
)
def test_no_part_is_without_a_row_and_none_is_called_clean_unseen(given, reason):
    analysis = analysed(**given)
    table = verdict_table(analysis)
    assert Counter(zip(table["component"], table["kind"], strict=True)) == Counter(dict.fromkeys(PARTS, 1))
    blind = table[table["verdict"] == "not judged"]
    assert (blind["doubts"] != "").all()
    assert (blind["least_change"] != "").all()
    assert reason in set(blind.loc[blind["kind"].isin(BEARING_KINDS), "doubts"].str.split(":").str[0])
    verdict, sentence = where_none_is_named(summary(analysis)["verdicts"])
    assert verdict == "not judged"
    assert sentence.startswith(f"{len(blind)} of {len(PARTS)} kinds of damage could not be judged")
    assert reason in sentence


def test_nothing_at_all_is_judged_in_five_turns():
    assert set(verdict_table(analysed(0.25))["verdict"]) == {"not judged"}


def test_a_long_record_judges_bearings_and_teeth_and_says_what_shafts_need():
    table = verdict_table(analysed(20.0))
    assert set(table.loc[table["kind"] != "shaft", "verdict"]) == {"nothing found"}
    shafts = table[table["kind"] == "shaft"]
    assert set(shafts["verdict"]) == {"not judged"}
    assert set(shafts["doubts"]) == {"no baseline or limits"}


def test_what_a_faulty_tachometer_orders_is_not_judged():
    rng = np.random.default_rng(3)
    times = np.sort(np.concatenate([np.arange(0.0, 6.0, 1 / SPEED_HZ), rng.uniform(0, 6, 12)]))
    record = make_record(
        {"a": rng.normal(size=30_000)},
        rate_hz=5000,
        units="g",
        angle=PulseTimes(times_s=times, shaft="input", pulses_per_rev=1),
    )
    table = verdict_table(analyze(record, GEARBOX, settings=PLAIN))
    assert set(table["verdict"]) == {"not judged"}
    assert set(table["doubts"].str.split(":").str[0]) == {"speed"}


# ---- derived from the file -----------------------------------------------------------------------------------------

OUTER = next(row.order for row in defects(solve_kinematics(GEARBOX)) if row.kind == "outer_race")


def struck(time, depth=0.4):
    """A carrier that the outer race of the input bearing modulates with two harmonics."""
    angle = 2 * np.pi * 1.005 * OUTER * SPEED_HZ * time
    return (1 + depth * np.cos(angle) + 0.5 * depth * np.cos(2 * angle)) * np.cos(2 * np.pi * 1500 * time)


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    path = tmp_path_factory.mktemp("verdicts") / "a.h5"
    settings = PLAIN.changed(envelope_band_hz=(1000.0, 2000.0))
    save_analysis(analysed(8.0, add=struck, settings=settings), path)
    with open_analysis(path) as analysis:
        yield analysis


def by_part(found):
    return {(one.component, one.kind): one for one in found}


def with_evidence(analysis, **changed):
    """The same file with other numbers of the evidence for the outer race."""
    parts = rows_of(group(analysis, "evidence"), PartEvidence)
    parts = [replace(part, **changed) if (part.component, part.kind) == RACE else part for part in parts]
    tree = analysis.copy()
    attrs = group(analysis, "evidence").attrs
    tree["evidence"] = xr.DataTree(rows_dataset(parts, PartEvidence, dim="part").assign_attrs(attrs))
    return by_part(derive_verdicts(tree))[RACE]


RACE = ("input bearing", "outer_race")


def test_verdicts_are_those_of_the_analysis(opened):
    told = by_part(derive_verdicts(opened))
    table = rows(opened)
    assert told.keys() == set(table.index) == PARTS
    for part, one in told.items():
        for name in ("verdict", "evidence", "doubts", "least_change", "next_step"):
            assert getattr(one, name) == table.loc[part, name]
        for name in ("false_alarm_probability", "strength", "depth", "snr"):
            assert getattr(one, name) == pytest.approx(table.loc[part, name], rel=1e-12, nan_ok=True)
    assert findings_table(opened)[["component", "kind", "verdict"]].iloc[0].tolist() == [*RACE, "diagnosed"]


def test_probabilities_follow_from_scores_and_library_in_the_file(opened):
    library = json.loads(group(opened, "evidence").attrs["library_json"])
    strengths, n = np.array(library["strengths"]), library["parts"]
    parts = rows_of(group(opened, "evidence"), PartEvidence)
    table = rows(opened)
    for part in parts:
        said = table.loc[(part.component, part.kind), "false_alarm_probability"]
        if part.score <= 0 or math.isnan(said):
            continue
        # of n healthy parts those at least as strong bound the probability of one part from both sides
        above = np.count_nonzero(strengths > part.score)
        low, high = (1 - (1 - (above + extra) / (n + 1)) ** len(parts) for extra in (1, 2))
        floor = 1 / 2000  # nothing rarer is stated
        assert max(low, floor) * (1 - 1e-9) <= said <= max(high, floor) * (1 + 1e-9)
        if said > 0.01 / 3 or part.score < LEAST_SCORE:  # the share of bearings
            assert table.loc[(part.component, part.kind), "verdict"] in {"nothing found", "not judged"}


def test_a_tooth_follows_from_its_strength_and_turns_at_the_stated_probability(opened):
    rows = rows_of(group(opened, "gears"), GearJudgement)
    attrs = group(opened, "gears").attrs
    library = json.loads(attrs["library_json"])
    known, n = np.array(library["strengths"]), library["parts"]
    tests, share = len({row.order for row in rows}), 0.01 * 2 / 3  # that of gears

    def told(strength):
        tree = opened.copy()
        changed = [replace(rows[0], strength=float(strength), explained_by=""), *rows[1:]]
        tree["gears"] = xr.DataTree(rows_dataset(changed, GearJudgement, dim="gear").assign_attrs(attrs))
        return by_part(derive_verdicts(tree))[rows[0].component, "tooth"]

    for row in rows:
        if row.strength > known[-1]:
            above = np.count_nonzero(known > row.strength)
            low, high = (1 - (1 - (above + extra) / (n + 1)) ** tests for extra in (1, 2))
            assert low * (1 - 1e-9) <= row.probability <= high * (1 + 1e-9)
        said = by_part(derive_verdicts(opened))[row.component, "tooth"].false_alarm_probability
        assert said == pytest.approx(max(row.probability, 1 / 2000), rel=1e-12)
    assert told(2 * known[0]).verdict == "indicated"
    between = told(known[60])
    assert share < between.false_alarm_probability < 0.05
    assert between.verdict == "not judged"
    clear = told(0.5 * known[-1])
    assert clear.verdict == "nothing found"
    assert number(clear.least_change, "indicated if at most 1 in ") == pytest.approx(1 / share, rel=0.01)


def number(text, after):
    """The number that follows some words at the start of a text."""
    assert text.startswith(after), text
    return float(re.match(r"[\d.]+", text.removeprefix(after))[0])


def test_a_verdict_turns_where_it_says(opened):
    parts = {(part.component, part.kind): part for part in rows_of(group(opened, "evidence"), PartEvidence)}
    # so deep that its score is nearer to where it turns, whatever the library
    least = number(with_evidence(opened, depth=10.0).least_change, "nothing found below a score of ")
    assert with_evidence(opened, score=1.02 * max(least, CLEAR_SCORE)).verdict == "diagnosed"
    assert with_evidence(opened, score=1.02 * least).verdict in {"diagnosed", "indicated"}
    assert with_evidence(opened, score=0.98 * least).verdict == "not judged"  # still rare in health
    shallow = number(with_evidence(opened, depth=0.12).least_change, "indicated below a modulation of ")
    assert with_evidence(opened, depth=1.01e-2 * shallow).verdict == "diagnosed"
    assert with_evidence(opened, depth=0.99e-2 * shallow).verdict == "indicated"
    assert "diagnosed at a modulation of 10% or more" in with_evidence(opened, depth=0.095).least_change
    weak = with_evidence(opened, score=0.8 * least, largest_strength=0.04, possible_depth=0.0001)
    needed = number(weak.least_change, "indicated at a score of ")
    assert with_evidence(opened, score=1.01 * needed).verdict in {"diagnosed", "indicated"}
    assert with_evidence(opened, score=0.1, largest_strength=0.04).verdict == "nothing found"
    none = {"score": -math.inf, "strength": 0.0, "largest_strength": 0.0}
    silent = with_evidence(opened, **none)
    now = parts[RACE].possible_depth * number(silent.least_change, "judged up to ")
    assert with_evidence(opened, **none, possible_depth=1.05 * now).verdict == "not judged"
    assert with_evidence(opened, **none, possible_depth=0.95 * now).verdict == "nothing found"
    assert with_evidence(opened, hidden_by="something").verdict == "not judged"
    # what noise makes too often, and damage, too, is no absence
    assert with_evidence(opened, **none | {"largest_strength": 0.2}).verdict == "not judged"


def test_an_analysis_without_its_evidence_derives_nothing(opened):
    with pytest.raises(AnalysisError, match="lacks the groups evidence, from which verdicts are derived"):
        derive_verdicts(opened.drop_nodes("evidence"))
    older = opened.copy()
    older["evidence"] = xr.DataTree(opened["evidence"].to_dataset().drop_vars("sibling_depths"))
    with pytest.raises(AnalysisError, match="lacks sibling_depths, from which verdicts are derived; make it again"):
        derive_verdicts(older)


# ---- shafts --------------------------------------------------------------------------------------------------------

LIMITS = (1.4, 2.8, 4.5)


def shaken(*, limits=None, **given):
    settings = PLAIN.changed(velocity_limits_mm_s=limits, envelope_band_hz=None)
    return analysed(3.0, rate_hz=2000, noise=0.02, settings=settings, **given)


def shaking(velocity_mm_s, speed_hz=SPEED_HZ):
    """An acceleration in g once a turn of the input, of a velocity in mm/s RMS: 1e-3 sqrt(2) v 2 pi f / 9.80665."""
    peak = 1e-3 * math.sqrt(2) * velocity_mm_s * 2 * math.pi * speed_hz / 9.80665
    return lambda time: peak * np.cos(2 * np.pi * speed_hz * time)


@pytest.mark.parametrize(("velocity", "verdict", "zone"), [(2.0, "nothing found", "B"), (3.5, "indicated", "C")])
def test_a_shaft_against_zones(velocity, verdict, zone):
    table = rows(shaken(add=shaking(velocity), limits=LIMITS))
    found = table.loc[("input", "shaft")]
    assert (found["verdict"], found["units"]) == (verdict, "mm s-1 RMS")
    assert found["amplitude"] == pytest.approx(velocity, rel=0.02)  # and 0.03 mm/s of noise
    assert f"alone in zone {zone} of ISO 20816" in found["evidence"]
    assert "2.8 mm s-1" in found["least_change"]


def test_a_shaft_against_the_first_record_of_its_baseline():
    first = shaken(add=shaking(1.0))
    same = shaken(add=shaking(1.2), baseline=first)
    assert rows(same).loc[("input", "shaft"), "verdict"] == "nothing found"
    # the chain's first record is the reference, not the one before
    grown = rows(shaken(add=shaking(3.0), baseline=same)).loc[("input", "shaft")]
    assert grown["verdict"] == "indicated"
    assert "in the first record of the baseline" in grown["evidence"]
    faster = rows(shaken(add=shaking(1.0, 24.0), speed_hz=24.0, baseline=first)).loc[("input", "shaft")]
    assert (faster["verdict"], faster["doubts"].split(":")[0]) == ("not judged", "no baseline at this speed")


def test_a_change_against_zones_counts_by_a_quarter_of_zone_b():
    first = shaken(add=shaking(1.0), limits=LIMITS)
    # 1.0 + 0.25 x 2.8 = 1.7
    for velocity, verdict in ((1.5, "nothing found"), (1.9, "indicated")):
        table = rows(shaken(add=shaking(velocity), limits=LIMITS, baseline=first))
        assert table.loc[("input", "shaft"), "verdict"] == verdict
