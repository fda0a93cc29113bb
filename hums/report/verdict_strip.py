"""Verdicts at the top of a report: component, confidence, severity, history and next step, from the findings."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from hums.analysis.findings import (
    DIAGNOSED,
    INDICATED,
    NOT_JUDGED,
    NOTHING_FOUND,
    UNEXPLAINED,
    not_judged_words,
    where_none_is_named,
)
from hums.analysis.healthy_machines import healthy_share_words
from hums.analysis.thresholds import FAULTY_DEPTH
from hums.gearbox.defect_orders import BEARING_KINDS

CLASSES = {DIAGNOSED: "alarm", INDICATED: "watch", NOT_JUDGED: "unknown", NOTHING_FOUND: "calm"}
"""Class in the page's style sheet for each verdict, the most serious first."""

_RARE = 1e-6
_GROWN = 1.5  # our choice: amplitudes of a healthy machine vary less between records at the same speed and load
_SEVERE_DEPTH = 0.5  # our choice: the envelope then varies between 0.5 and 1.5 times its mean
_NEARER = 2.0  # our choice: 6 dB, by which the transfer paths to two sensors differ on a healthy machine
_ORDERS = re.compile(r"\b(\d+(?:\.\d+)?)(?: to (\d+(?:\.\d+)?))? orders\b")
_NUMBERED = re.compile(r"\b((?:harmonic|sideband) [+-]?\d+ at (\d+\.\d+))")

Facts = Mapping[str, Any]


def probability_words(probability: float) -> str:
    """Return a probability in words: "fewer than 1 in 1,000,000", "1 in 250", "12 in 100"."""
    if probability < _RARE:
        return f"fewer than 1 in {1 / _RARE:,.0f}"
    if probability < 0.1:  # noqa: PLR2004
        return f"1 in {1 / probability:,.0f}"
    return f"{100 * probability:.0f} in 100"


def frequency_words(hz: float) -> str:
    """Return a frequency in Hz with four digits, never in powers of ten: "57.58 Hz", "12345 Hz"."""
    return f"{hz:.4g} Hz" if abs(hz) < 1e4 else f"{hz:.0f} Hz"  # noqa: PLR2004


def with_hz(text: str, speed_hz: float | None) -> str:
    """Return a text with the frequency after every order in it, at a speed of the reference in rev/s.

    Examples
    --------
    >>> from hums.report.verdict_strip import with_hz
    >>> with_hz("line at 2.557 orders; supported by harmonic 2 at 5.113.", 25.0)
    'line at 2.557 orders = 63.92 Hz; supported by harmonic 2 at 5.113 = 127.8 Hz.'
    """
    if speed_hz is None:
        return text

    def with_frequency(match: re.Match[str]) -> str:
        ends = [frequency_words(float(order) * speed_hz) for order in match.groups() if order]
        return f"{match.group(0)} = {' to '.join(ends)}"

    said = _ORDERS.sub(with_frequency, text)
    return _NUMBERED.sub(lambda match: f"{match.group(1)} = {frequency_words(float(match.group(2)) * speed_hz)}", said)


def answer(facts: Facts) -> list[tuple[str, str]]:
    """Return the report's answer in a few sentences, each with its class."""
    said = []
    for verdict, words in ((DIAGNOSED, "Damaged"), (INDICATED, "Possibly damaged")):
        parts = [f"{_kind(row)} of {part_words(row)}" for row in facts["findings"] if row["verdict"] == verdict]
        if parts:
            said.append((CLASSES[verdict], f"{words}: {', '.join(parts)}."))
    every = facts.get("verdicts", ())
    if any(row.get("doubts", "").startswith(UNEXPLAINED) for row in every):
        said.append((CLASSES[INDICATED], "An envelope line as deep as that of damage belongs to no component."))
    counts = {verdict: sum(row["verdict"] == verdict for row in every) for verdict in (NOTHING_FOUND, NOT_JUDGED)}
    if counts[NOTHING_FOUND]:
        rest = _checks(counts[NOTHING_FOUND])
        rest = f"the other {rest.removeprefix('1 ')}" if said else rest
        said.append((CLASSES[NOTHING_FOUND], f"Nothing found in {rest}."))
    if counts[NOT_JUDGED]:
        said.append((CLASSES[NOT_JUDGED], f"{_checks(counts[NOT_JUDGED])} could not be made."))
    said += [
        (CLASSES[DIAGNOSED], f"Sensor {item['name']} ({item['sensor']}) is faulty.")
        for item in facts["health"]
        if item["status"] == "faulty"
    ]
    return said or [(CLASSES[NOTHING_FOUND], "Nothing found.")]


def part_words(finding: Mapping[str, Any]) -> str:
    """Return the component of a finding and the components indistinguishable from it, joined by "or"."""
    return " or ".join(filter(None, [finding["component"], finding.get("alike")]))


def _checks(number: int) -> str:
    return "1 check" if number == 1 else f"{number} checks"


def _kind(row: Mapping[str, Any]) -> str:
    return str(row["kind"]).replace("_", " ")


def verdict_rows(facts: Facts, past: Facts | None = None) -> list[dict[str, str]]:
    """Return one row per finding, or one that states that nothing was found, and one for what was not judged.

    Parameters
    ----------
    facts : mapping
        Result of `hums.summary`.
    past : mapping, optional
        Summary of an earlier record of the machine.

    Returns
    -------
    list of dict
        part, kind, verdict, word (for the verdict), style (class), unjudged (parts), line, sure, severity, nearer,
        since, next, evidence and least_change, in words; empty if unknown.
    """
    rows = [_row(finding, facts, past) for finding in facts["findings"]]
    rows.sort(key=lambda row: list(CLASSES).index(row["verdict"]))
    every = facts.get("verdicts", ())
    if not rows:
        limit = facts["settings"]["false_alarm_probability"]
        verdict, sentence = where_none_is_named(every)
        sure = (
            f"{sentence[0].upper()}{sentence[1:]}. A component is reported if at most {probability_words(limit)} "
            "healthy records show as much."
        )
        since = "" if past is None else _before(past)
        row = _of_the_rest(facts["machine"] or facts["gearbox"], verdict, sure, since, _unjudged_parts(every))
        partly = verdict == NOT_JUDGED and any(one["verdict"] == NOTHING_FOUND for one in every)
        return [row | ({"word": "not judged in part"} if partly else {})]
    if unjudged := not_judged_words(every):
        rows.append(_of_the_rest("Other components", NOT_JUDGED, unjudged, "", _unjudged_parts(every)))
    return rows


def _unjudged_parts(every: Sequence[Mapping[str, Any]]) -> str:
    """Return the components that could not be judged, by kind of damage."""
    kinds: dict[str, list[str]] = {}
    for row in every:
        if row["verdict"] == NOT_JUDGED and "component" in row:
            kinds.setdefault(_kind(row), []).append(row["component"])
    return "; ".join(f"{kind}: {', '.join(dict.fromkeys(parts))}" for kind, parts in kinds.items())


def _of_the_rest(part: str, verdict: str, sure: str, since: str, unjudged: str) -> dict[str, str]:
    """Return the row of the components without a finding."""
    step = "Keep this analysis as the baseline for later records."
    if verdict == NOT_JUDGED:
        step = "The components table states what each verdict requires."
    known = {"part": part, "verdict": verdict, "word": verdict, "style": CLASSES[verdict]}
    known |= {"sure": sure, "unjudged": unjudged, "since": since, "next": step}
    return dict.fromkeys(("kind", "line", "nearer", "severity", "evidence", "least_change"), "") | known


def component_styles(facts: Facts) -> dict[str, str]:
    """Return the class of each component's most serious verdict.

    A shaft that was not judged is left out: its colour would hide that of its gears.
    """
    gravest: dict[str, str] = {}
    ranks = [*CLASSES.values()]
    for finding in facts.get("verdicts") or facts["findings"]:
        if finding.get("kind") == "shaft" and finding["verdict"] == NOT_JUDGED:
            continue
        style = CLASSES[finding["verdict"]]
        for component in part_words(finding).split(" or "):
            gravest[component] = min(style, gravest.get(component, style), key=ranks.index)
    return gravest


def _row(finding: Mapping[str, Any], facts: Facts, past: Facts | None) -> dict[str, str]:
    verdict = finding["verdict"]
    return {
        "part": part_words(finding),
        "kind": _kind(finding),
        "verdict": verdict,
        "word": verdict,
        "unjudged": "",
        "style": CLASSES[verdict],
        "line": _line_words(finding, facts),
        "sure": _sure(finding),
        "severity": _severity(finding),
        "nearer": _nearer(finding, facts),
        "since": _since(finding, facts, past),
        "next": _next(finding, facts),
        "evidence": finding["evidence"],
        "least_change": finding.get("least_change", ""),
    }


def _sure(finding: Mapping[str, Any]) -> str:
    """Return the false-alarm probability of a finding in words; empty if it has none."""
    value = finding["false_alarm_probability"]
    if value is None:
        return ""
    words, of = (probability_words, "gears") if finding.get("strength") is None else (healthy_share_words, "machines")
    return f"{words(value)} records of simulated healthy {of} show as much"


def _line_words(finding: Mapping[str, Any], facts: Facts) -> str:
    """Return the line of a finding as order, and in Hz and CPM at the mean speed; a tooth has none."""
    speed, order = facts.get("speed_hz", {}).get("mean"), finding.get("order_found")
    if speed is None or not order or finding["kind"] == "tooth":
        return ""
    return f"order {order:.5g}, {frequency_words(order * speed)}, {60 * order * speed:.5g} CPM at the mean speed"


def _severity(finding: Mapping[str, Any]) -> str:
    """Return the severity of a finding in words, or why it has no scale, and its amplitude."""
    depth = finding.get("depth")
    if finding["kind"] in BEARING_KINDS and depth is not None:
        word = "slight" if depth < FAULTY_DEPTH else "moderate" if depth < _SEVERE_DEPTH else "severe"
        scale = f"slight below {FAULTY_DEPTH:.0%}, severe at {_SEVERE_DEPTH:.0%} and above"
        said = [f"{word}: impacts modulate the band by {depth:.1%} ({scale})"]
    elif finding["kind"] == "tooth":
        return (
            "no scale: the response to a damaged tooth depends on load and transfer path; use its trend; it stands out "
            f"from the other teeth with a strength of {finding['snr']:.3g}"
        )
    else:
        said = [part for part in finding.get("severity", "").split("; ") if part and not part.startswith("unknown")]
    if finding.get("amplitude") is not None:
        said.append(f"{finding['amplitude']:.3g} {finding['units']}, {finding['snr']:.3g} times its background")
    return "; ".join(said) or "not measured"


def _nearer(finding: Mapping[str, Any], facts: Facts) -> str:
    """Return the sensor nearest to a bearing fault by the amplitudes of its line; empty with a single sensor."""
    faulty = {item["name"] for item in facts["health"] if item["status"] == "faulty"}
    largest: dict[str, float] = {}
    for line in facts["envelope"]:
        same = (line["component"], line["kind"], line["units"]) == (
            finding["component"],
            finding["kind"],
            finding["units"],
        )
        if same and (line["harmonic"], line["sideband"]) == (1, 0) and line["channel"] not in faulty:
            largest[line["channel"]] = max(line["amplitude"], largest.get(line["channel"], 0.0))
    if len(largest) < 2:  # noqa: PLR2004
        return ""
    first, second = sorted(largest, key=lambda channel: -largest[channel])[:2]
    ratio = largest[first] / largest[second] if largest[second] > 0 else float("inf")
    if ratio < _NEARER:
        return (
            f"not resolved: its line at {first} is {ratio:.2g} times that at {second}; transfer paths alone may "
            f"account for a factor of {_NEARER:g}"
        )
    places = {one["name"]: one["sensor"] for one in facts.get("channels", ()) if one.get("sensor")}
    where = f" ({places[first]})" if first in places else ""
    return f"nearer to {first}{where}: its line there is {ratio:.2g} times that at {second}, the next largest"


def _since(finding: Mapping[str, Any], facts: Facts, past: Facts | None) -> str:
    """Return a comparison of the finding with the earlier record, in words."""
    if past is None:
        return "unknown from a single record; give an earlier analysis as the baseline (--baseline analysis.h5)"
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
    for line in lines:
        same = all(line[name] == finding[name] for name in ("component", "kind", "channel"))
        if same and math.isclose(line["order_found"], finding["order_found"] or 0.0):
            return line
    return None


def _same_line(line: Mapping[str, Any], lines: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    key = ("component", "kind", "harmonic", "sideband", "channel", "units")
    return next((other for other in lines if all(other[name] == line[name] for name in key)), None)


def _next(finding: Mapping[str, Any], facts: Facts) -> str:
    """Return the recommended next step, which is no part of the verdict."""
    faulty = {item["name"] for item in facts["health"] if item["status"] == "faulty"}
    if finding.get("channel") in faulty:
        return f"Repair the sensor of {finding['channel']} first, then record again."
    return str(finding["next_step"])
