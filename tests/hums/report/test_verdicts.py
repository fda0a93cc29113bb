"""The verdict strip: words for every verdict, the change since a baseline, and none beyond the facts."""

import pytest

from hums.report.verdicts import component_styles, probability_words, verdict_rows

LINE = {
    "component": "bearing",
    "kind": "inner_race",
    "channel": "a",
    "order_found": 2.5,
    "harmonic": 1,
    "sideband": 0,
    "units": "g",
    "amplitude": 0.3,
}


def finding(verdict, **changed):
    return {
        "component": "bearing",
        "kind": "inner_race",
        "channel": "a",
        "verdict": verdict,
        "evidence": "a line.",
        "false_alarm_probability": 0.004,
        "snr": 12.0,
        "order_found": 2.5,
        "amplitude": 0.3,
        "units": "g",
    } | changed


def facts(*findings, lines=(LINE,), recorded_at="2026-01-02", status="ok"):
    return {
        "findings": list(findings),
        "orders": [],
        "envelope": list(lines),
        "health": [{"name": "a", "status": status}],
        "machine": "mill",
        "gearbox": "two-stage",
        "record": "r.h5",
        "recorded_at": recorded_at,
        "settings": {"false_alarm_probability": 0.01},
    }


@pytest.mark.parametrize(
    ("probability", "words"),
    [(1e-9, "fewer than 1 in 1,000,000"), (0.004, "1 in 250"), (0.5, "50 in 100")],
)
def test_probabilities_in_words(probability, words):
    assert probability_words(probability) == words


def test_gravest_first_and_unknown_words_are_shown():
    rows = verdict_rows(facts(finding("not judged"), finding("something new"), finding("diagnosed")))
    assert [row["verdict"] for row in rows] == ["diagnosed", "not judged", "something new"]
    assert [row["style"] for row in rows] == ["alarm", "unknown", "unknown"]
    assert component_styles(facts(finding("indicated"), finding("diagnosed"))) == {"bearing": "alarm"}


def test_every_probability_of_a_finding_is_said():
    sure = verdict_rows(facts(finding("diagnosed", healthy_machine_probability=0.02)))[0]["sure"]
    assert sure == "a sound gear shows as much in 1 in 250 records; healthy machine probability 1 in 50"


@pytest.mark.parametrize(
    ("then", "words"),
    [(0.1, "was 0.1 g and has grown to 3 times that"), (0.25, "about the same"), (0.9, "has fallen to 0.33 times")],
)
def test_since_when(then, words):
    past = facts(finding("indicated"), lines=[LINE | {"amplitude": then}], recorded_at="2025-12-01")
    since = verdict_rows(facts(finding("diagnosed")), past)[0]["since"]
    assert since.startswith("baseline 2025-12-01: indicated then")
    assert words in since


def test_what_is_new_and_what_one_record_cannot_say():
    new = verdict_rows(facts(finding("diagnosed")), facts(lines=()))[0]["since"]
    assert new == "baseline 2026-01-02: not found then"
    assert "one record alone cannot say" in verdict_rows(facts(finding("diagnosed")))[0]["since"]


def test_nothing_found():
    (row,) = verdict_rows(facts())
    assert (row["verdict"], row["style"], row["part"]) == ("nothing found", "calm", "mill")
    assert "1 in 100 healthy records" in row["sure"]


def test_a_record_that_could_not_be_judged_is_not_called_clean():
    judged = [{"verdict": "nothing found", "doubts": ""}, {"verdict": "not judged", "doubts": "too short: 3 turns"}]
    (row,) = verdict_rows(facts() | {"verdicts": judged})
    assert (row["verdict"], row["style"], row["severity"]) == ("not judged", "unknown", "unknown")
    assert row["sure"].startswith("1 of 2 kinds of damage could not be judged (too short)")


def test_what_was_not_judged_stands_beside_the_findings():
    every = [finding("diagnosed"), {"verdict": "not judged", "doubts": "out of band: 900 Hz"}]
    named, rest = verdict_rows(facts(finding("diagnosed", least_change="indicated below x")) | {"verdicts": every})
    assert named["least_change"] == "indicated below x"
    assert (rest["part"], rest["verdict"]) == ("Other parts", "not judged")
    assert rest["sure"] == "1 of 2 kinds of damage could not be judged (out of band)"


def test_a_sick_sensor_comes_first():
    assert "Mend the sensor" in verdict_rows(facts(finding("diagnosed"), status="sick"))[0]["next"]
