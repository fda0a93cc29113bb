"""Verdict strip of a report: part, certainty, severity, since when, and what to do next, from the findings alone."""

from collections.abc import Mapping, Sequence
from typing import Any

from hums.analysis.findings import (
    DIAGNOSED,
    INDICATED,
    NOT_JUDGED,
    NOTHING_FOUND,
    not_judged_words,
    where_none_is_named,
)
from hums.gearbox.orders import BEARING_KINDS

CLASSES = {DIAGNOSED: "alarm", INDICATED: "watch", NOT_JUDGED: "unknown", NOTHING_FOUND: "calm"}
"""Class of the page's style sheet for each verdict; a word that is not here is shown as unknown."""

_RARE = 1e-6
_SAME_LINE_ORDERS = 1e-9
_GROWN = 1.5  # our choice: amplitudes of a sound machine vary by less from record to record at one speed and load

Facts = Mapping[str, Any]


def probability_words(probability: float) -> str:
    """Return a probability in words: "fewer than 1 in 1,000,000", "1 in 250", "12 in 100"."""
    if probability < _RARE:
        return f"fewer than 1 in {1 / _RARE:,.0f}"
    if probability < 0.1:  # noqa: PLR2004
        return f"1 in {1 / probability:,.0f}"
    return f"{100 * probability:.0f} in 100"


def verdict_rows(facts: Facts, past: Facts | None = None) -> list[dict[str, str]]:
    """Return the strip: one row per finding, or the one that says that nothing was found; then what was not judged.

    Parameters
    ----------
    facts : mapping
        Result of `hums.summary`.
    past : mapping, optional
        That of an earlier record of the machine.

    Returns
    -------
    list of dict
        part, kind, verdict, style (class), sure, severity, since, next and evidence, in words.
    """
    rows = [_row(finding, facts, past) for finding in facts["findings"]]
    rows.sort(key=lambda row: list(CLASSES).index(row["verdict"]) if row["verdict"] in CLASSES else len(CLASSES))
    every = facts.get("verdicts", ())
    if not rows:
        limit = facts["settings"]["false_alarm_probability"]
        verdict, sentence = where_none_is_named(every)
        sure = (
            f"{sentence[0].upper()}{sentence[1:]}. A part is named where at most {probability_words(limit)} healthy "
            "records show as much."
        )
        since = "" if past is None else _before(past)
        return [_of_the_rest(facts["machine"] or facts["gearbox"], verdict, sure, since)]
    if unjudged := not_judged_words(every):
        rows.append(_of_the_rest("Other parts", NOT_JUDGED, unjudged, ""))
    return rows


def _of_the_rest(part: str, verdict: str, sure: str, since: str) -> dict[str, str]:
    """Return the row of the parts that are not named."""
    return {
        "part": part,
        "kind": "",
        "verdict": verdict,
        "style": CLASSES[verdict],
        "sure": sure,
        "severity": "none seen" if verdict == NOTHING_FOUND else "unknown",
        "since": since,
        "next": "The table of components says of each part what would let it be judged."
        if verdict == NOT_JUDGED
        else "Keep this analysis as the baseline of later records.",
        "evidence": "",
        "least_change": "",
    }


def component_styles(facts: Facts) -> dict[str, str]:
    """Return the class of each component that was judged, that of its gravest verdict.

    A shaft that lacks a baseline is left out: its colour would cover that of the gears on it.
    """
    gravest: dict[str, str] = {}
    ranks = [*CLASSES.values()]
    for finding in facts.get("verdicts") or facts["findings"]:
        if finding.get("kind") == "shaft" and finding["verdict"] == NOT_JUDGED:
            continue
        style = CLASSES.get(finding["verdict"], "unknown")
        known = gravest.setdefault(finding["component"], style)
        if ranks.index(style) < ranks.index(known):
            gravest[finding["component"]] = style
    return gravest


def _row(finding: Mapping[str, Any], facts: Facts, past: Facts | None) -> dict[str, str]:
    verdict = finding["verdict"]
    return {
        "part": finding["component"],
        "kind": finding["kind"].replace("_", " "),
        "verdict": verdict,
        "style": CLASSES.get(verdict, "unknown"),
        "sure": _sure(finding),
        "severity": _severity(finding),
        "since": _since(finding, facts, past),
        "next": _next(finding, facts),
        "evidence": finding["evidence"],
        "least_change": finding.get("least_change", ""),
    }


def _sure(finding: Mapping[str, Any]) -> str:
    """Return the verdict with each of its probabilities; those of an analysis to come are named by their column."""
    said = []
    for name, value in finding.items():
        if not name.endswith("probability") or value is None:
            continue
        if name != "false_alarm_probability":
            said.append(f"{name.replace('_', ' ')} {probability_words(value)}")
        elif finding.get("strength") is None:
            said.append(f"a sound gear shows as much in {probability_words(value)} records")
        else:
            said.append(f"healthy machines show as much in {probability_words(value)} records")
    return "; ".join(said)


def _severity(finding: Mapping[str, Any]) -> str:
    """Return what is known of the severity; that it needs an earlier record stands under "since when"."""
    said = [part for part in finding.get("severity", "").split("; ") if part and not part.startswith("unknown")]
    if finding.get("amplitude") is not None:
        said.append(f"{finding['amplitude']:.3g} {finding['units']}, {finding['snr']:.3g} times its surroundings")
    return "; ".join(said) or "not measured"


def _since(finding: Mapping[str, Any], facts: Facts, past: Facts | None) -> str:
    """Return how the finding compares with the earlier record, in words."""
    if past is None:
        return "one record alone cannot say; give an earlier analysis as the baseline"
    same = [
        other
        for other in past["findings"]
        if (other["component"], other["kind"]) == (finding["component"], finding["kind"])
    ]
    was = f"{same[0]['verdict']} then" if same else "not found then"
    line = _line_of(finding, facts["orders"] + facts["envelope"])
    then = None if line is None else _same_line(line, past["orders"] + past["envelope"])
    grown = ""
    if then is not None and line is not None and then["amplitude"] > 0:
        factor, was_size = line["amplitude"] / then["amplitude"], f"{then['amplitude']:.3g} {then['units']}"
        if 1 / _GROWN < factor < _GROWN:
            grown = f"; its line was {was_size}, about the same"
        else:
            grown = (
                f"; its line was {was_size} and has {'grown' if factor > 1 else 'fallen'} to {factor:.2g} times that"
            )
    return f"{_before(past)}: {was}{grown}"


def _before(past: Facts) -> str:
    return f"baseline {past['recorded_at'] or past['record'] or 'without a date'}"


def _line_of(finding: Mapping[str, Any], lines: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Return the measured line that a finding names."""
    for line in lines:
        if (line["component"], line["kind"], line["channel"]) == (
            finding["component"],
            finding["kind"],
            finding["channel"],
        ) and abs(line["order_found"] - (finding["order_found"] or 0.0)) < _SAME_LINE_ORDERS * line["order_found"]:
            return line
    return None


def _same_line(line: Mapping[str, Any], lines: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    key = ("component", "kind", "harmonic", "sideband", "channel", "units")
    return next((other for other in lines if all(other[name] == line[name] for name in key)), None)


def _next(finding: Mapping[str, Any], facts: Facts) -> str:
    """Return what to do next; our advice, and no part of the verdict."""
    sick = {item["name"] for item in facts["health"] if item["status"] == "sick"}
    if finding.get("channel") in sick:
        return f"Mend the sensor of {finding['channel']} first, and record again."
    if finding.get("next_step"):
        return str(finding["next_step"])
    if finding["verdict"] == "diagnosed":
        if finding["kind"] in BEARING_KINDS:
            return "Inspect the bearing, and its grease or oil for particles."
        return "Inspect the teeth, from those that the average below shows."
    if finding["verdict"] == "indicated":
        return "Record again at the same speed and load, with this analysis as the baseline; inspect if it grows."
    return "Remove what stands in the way of a verdict, and record again."
