"""The verdict strip: words for every verdict, the change since a baseline, and none beyond the facts."""

import pytest

from hums.report.verdict_strip import answer, verdict_rows, with_hz

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
        "next_step": "Inspect it.",
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


def test_the_probability_of_a_finding_is_said():
    assert (
        verdict_rows(facts(finding("diagnosed")))[0]["sure"]
        == "1 in 250 records of simulated healthy gears show as much"
    )
    rare = verdict_rows(facts(finding("diagnosed", strength=0.8, false_alarm_probability=0.0005)))[0]["sure"]
    assert rare == "fewer than 1 in 2,000 records of simulated healthy machines show as much"


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
    assert "unknown from a single record" in verdict_rows(facts(finding("diagnosed")))[0]["since"]


def test_nothing_found():
    (row,) = verdict_rows(facts())
    assert (row["verdict"], row["style"], row["part"]) == ("nothing found", "calm", "mill")
    assert "1 in 100 healthy records" in row["sure"]


def test_a_record_that_could_not_be_judged_is_not_called_clean():
    judged = [{"verdict": "nothing found", "doubts": ""}, {"verdict": "not judged", "doubts": "too short: 3 turns"}]
    (row,) = verdict_rows(facts() | {"verdicts": judged})
    assert (row["verdict"], row["style"], row["severity"]) == ("not judged", "unknown", "")
    assert row["word"] == "not judged in part"
    assert row["sure"].startswith("1 of 2 kinds of damage could not be judged (too short)")
    named = [one | {"component": "input", "kind": "shaft"} for one in judged]
    assert verdict_rows(facts() | {"verdicts": named})[0]["unjudged"] == "shaft: input"
    assert verdict_rows(facts() | {"verdicts": named[1:]})[0]["word"] == "not judged"


def test_what_was_not_judged_stands_beside_the_findings():
    every = [finding("diagnosed"), {"verdict": "not judged", "doubts": "out of band: 900 Hz"}]
    named, rest = verdict_rows(facts(finding("diagnosed", least_change="indicated below x")) | {"verdicts": every})
    assert named["least_change"] == "indicated below x"
    assert (rest["part"], rest["verdict"]) == ("Other components", "not judged")
    assert rest["sure"] == "1 of 2 kinds of damage could not be judged (out of band)"


def test_a_sick_sensor_comes_first():
    assert "Repair the sensor" in verdict_rows(facts(finding("diagnosed"), status="faulty"))[0]["next"]


@pytest.mark.parametrize(
    ("depth", "word"), [(0.05, "Slight"), (0.1, "Moderate"), (0.49, "Moderate"), (0.5, "Severe"), (1.4, "Severe")]
)
def test_severity_of_a_bearing_in_words(depth, word):
    severity = verdict_rows(facts(finding("diagnosed", depth=depth)))[0]["severity"]
    assert severity.startswith(f"{word.lower()}: impacts modulate the band by {depth:.1%}")
    assert severity.endswith("0.3 g, 12 times its background")


def two_sensors(ratio, status="ok"):
    other = LINE | {"channel": "b", "amplitude": LINE["amplitude"] / ratio}
    every = facts(finding("diagnosed"), lines=[LINE, other])
    every["health"] = [{"name": "a", "status": "ok"}, {"name": "b", "status": status}]
    return every | {"channels": [{"name": "a", "sensor": "on motor end"}, {"name": "b"}]}


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (3.0, "nearer to a (on motor end): its line there is 3 times that at b"),
        (1.5, "not resolved: "),
        (0.2, "to b: "),
    ],
)
def test_which_sensor_a_fault_is_nearer_to(ratio, words):
    assert words in verdict_rows(two_sensors(ratio))[0]["nearer"]


def test_no_place_from_one_sensor_or_beside_a_faulty_one():
    assert verdict_rows(facts(finding("diagnosed")))[0]["nearer"] == ""
    assert verdict_rows(two_sensors(3.0, status="faulty"))[0]["nearer"] == ""


def test_hertz_beside_orders():
    assert with_hz("at 2.5 orders, 3 to 4 orders; sideband -1 at 1.500.", 10.0) == (
        "at 2.5 orders = 25 Hz, 3 to 4 orders = 30 Hz to 40 Hz; sideband -1 at 1.500 = 15 Hz."
    )
    assert with_hz("at 2.5 orders", None) == "at 2.5 orders"
    line = verdict_rows(facts(finding("diagnosed")) | {"speed_hz": {"mean": 10.0}})[0]["line"]
    assert line == "order 2.5, 25 Hz, 1500 CPM at the mean speed"


def test_the_answer_says_each_part_once():
    rest = [{"verdict": "nothing found"}, {"verdict": "not judged"}, {"verdict": "not judged"}]
    every = facts(finding("diagnosed"), finding("indicated", component="gear", kind="tooth")) | {"verdicts": rest}
    assert answer(every) == [
        ("alarm", "Damaged: inner race of bearing."),
        ("watch", "Possibly damaged: tooth of gear."),
        ("calm", "Nothing found in the other check."),
        ("unknown", "2 checks could not be made."),
    ]
    assert answer(facts()) == [("calm", "Nothing found.")]
    faulty = facts(status="faulty")
    faulty["health"][0]["sensor"] = "vibration"
    assert answer(faulty) == [("alarm", "Sensor a (vibration) is faulty.")]
