"""Verdicts on the parts of a machine.

Every kind of defect of every part has one of four verdicts:

- *diagnosed*: few healthy machines show as much, and no doubt remains;
- *indicated*: few healthy machines show as much, but a doubt remains, which the evidence names;
- *not judged*: the record is inconclusive: too short or too noisy, out of band, a faulty sensor, or a line that
  something else explains;
- *nothing found*: a modulation of 5 % in the range inspected would have been detected, and was not.

The probability is that over healthy machines (`hums.analysis.healthy_machines`), for all parts of the record together,
of the score of a part (`hums.analysis.combs`). No bearing is named for a line that has another source: one that another
comb explains as well, that of a part of the same bearing three times as large; nor, unless the line is deep, if both
races have similar lines. A bearing is diagnosed if its line modulates a band by 10 % of the mean or more, a harmonic or
sideband supports it (a sideband for a race that rotates through the load zone), and no other race or element of it is
within a factor of three in the same band; a cage never, since damage of an element causes the same line. Gears are
judged in `hums.analysis.gear_damage`, and are at most indicated.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hums.analysis.evidence import PartEvidence
from hums.analysis.healthy_machines import RAREST_STATED, HealthyMachines, healthy_machines, healthy_share_words
from hums.analysis.thresholds import (
    CLEAR_SCORE,
    FAULTY_DEPTH,
    JUDGED_DEPTH,
    LEAST_SCORE,
    RIVAL_FACTOR,
    SELDOM_SOUND,
    SLIP_SCATTER,
)
from hums.gearbox.defect_orders import BEARING_KINDS

__all__ = [
    "DIAGNOSED",
    "INDICATED",
    "NOTHING_FOUND",
    "NOT_JUDGED",
    "Finding",
    "bearing_verdicts",
    "doubted",
    "findings",
    "judging_nothing",
    "not_judged_words",
    "where_none_is_named",
]

DIAGNOSED, INDICATED, NOT_JUDGED, NOTHING_FOUND = "diagnosed", "indicated", "not judged", "nothing found"
UNEXPLAINED = "unexplained line"
LONGER = "Take a longer record at a steady speed and load."
_UNKNOWN = "unknown: no earlier record of this machine to compare with"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Verdict on one kind of defect of one component, with the evidence in words and its strongest line.

    `depth` is the modulation of the band by that line, NaN if a verdict has none. `doubts` are the reasons for which it
    is not diagnosed, or not judged. `alike` names what else the record cannot distinguish from the component, joined by
    "or": other components, or a loose part on a shaft.
    """

    component: str
    kind: str
    alike: str = ""
    channel: str = ""
    verdict: str = NOT_JUDGED
    evidence: str = ""
    false_alarm_probability: float = math.nan
    snr: float = math.nan
    order_found: float = math.nan
    amplitude: float = math.nan
    units: str = ""
    strength: float = math.nan
    score: float = math.nan
    depth: float = math.nan
    doubts: str = ""
    severity: str = _UNKNOWN
    next_step: str = ""
    least_change: str = ""


def findings(every: Sequence[Finding]) -> list[Finding]:
    """Return the verdicts that name a part: diagnosed before indicated, bearings before gears, the deepest first."""
    named = [one for one in every if one.verdict in {DIAGNOSED, INDICATED}]

    return sorted(
        named,
        key=lambda one: (
            one.verdict != DIAGNOSED,
            one.kind not in BEARING_KINDS,
            -(one.score if math.isfinite(one.score) else one.snr),
        ),
    )


def where_none_is_named(every: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return the verdict on a machine without findings, from the rows of its verdicts, and a sentence on it.

    It is "nothing found" only if every part could be judged.

    Examples
    --------
    >>> from hums.analysis.findings import where_none_is_named
    >>> rows = [{"verdict": "nothing found", "doubts": ""}, {"verdict": "not judged", "doubts": "too short"}]
    >>> where_none_is_named(rows)
    ('not judged', '1 of 2 kinds of damage could not be judged (too short); nothing was found for the others')
    """
    unjudged = not_judged_words(every)
    if not unjudged:
        return NOTHING_FOUND, "every kind of damage was judged, and none stands out"
    others = "; nothing was found for the others" if any(row["verdict"] != NOT_JUDGED for row in every) else ""
    return NOT_JUDGED, unjudged + others


def not_judged_words(every: Sequence[Mapping[Any, Any]]) -> str:
    """Return how many kinds of damage could not be judged and why, from the rows of all verdicts; empty if all were.

    Examples
    --------
    >>> from hums.analysis.findings import not_judged_words
    >>> not_judged_words([{"verdict": "diagnosed", "doubts": ""}, {"verdict": "not judged", "doubts": "too short: x"}])
    '1 of 2 kinds of damage could not be judged (too short)'
    """
    blind = [row for row in every if row["verdict"] == NOT_JUDGED]
    if not blind:
        return ""
    reasons = dict.fromkeys(str(row["doubts"]).split(":")[0] for row in blind)
    return f"{len(blind)} of {len(every)} kinds of damage could not be judged ({'; '.join(reasons)})"


def bearing_verdicts(
    evidence: Sequence[PartEvidence],
    *,
    false_alarm_probability: float,
    faulty: Collection[str] = (),
    library: HealthyMachines | None = None,
) -> list[Finding]:
    """Return the verdict on every kind of defect of every bearing.

    Parameters
    ----------
    evidence : sequence of PartEvidence
        In all channels.
    false_alarm_probability : float
        Share of healthy records in which a bearing may be named.
    faulty : collection of str
        Channels with a faulty sensor.
    library : HealthyMachines, optional
        Default the shipped one.
    """
    library = library or healthy_machines("bearings")
    parts = {(part.component, part.kind) for part in evidence}
    results = []
    for family in sorted(parts):
        own = [part for part in evidence if (part.component, part.kind) == family]
        sound = [part for part in own if part.channel not in faulty]
        if not sound:
            why = "the sensor is faulty and may itself produce any line"
            results.append(_not_judged(own[0], why, least_change="judged with a sound sensor"))
            continue
        tried = evidence, faulty, library, len(parts), false_alarm_probability
        judged = [_bearing_verdict(part, *tried) for part in sound]
        results.append(min(judged, key=lambda one: (RANK[one.verdict], -one.score)))
    return _with_equal_bearings(results, {(part.component, part.kind): part.order for part in evidence})


def _with_equal_bearings(results: Sequence[Finding], orders: Mapping[tuple[str, str], float]) -> list[Finding]:
    """Return the verdicts with bearings of equal orders treated as one.

    Their lines are the same: the one with the strongest evidence is named together with the others, which are not
    judged.
    """
    stronger: dict[tuple[str, float], Finding] = {}
    for one in sorted(results, key=lambda one: (RANK[one.verdict], -one.score)):
        stronger.setdefault((one.kind, round(orders[one.component, one.kind], 9)), one)
    made = []
    for one in results:
        order = orders[one.component, one.kind]
        first = stronger[one.kind, round(order, 9)]
        equal = [
            name
            for name, kind in orders
            if kind == one.kind and name != one.component and _same_order(orders[name, kind], order)
        ]
        if equal and first.verdict in {DIAGNOSED, INDICATED}:
            made.append(_also(one, equal) if one is first else _of_another_bearing(one, first.component))
        else:
            made.append(one)
    return made


def _also(one: Finding, equal: Sequence[str]) -> Finding:
    """Return a finding that may also be on bearings with the same orders."""
    doubt = f"it may be {' or '.join(equal)}, which {'has' if len(equal) == 1 else 'have'} the same orders"
    step = f"Inspect {one.component} and {' and '.join(equal)}."
    return replace(doubted(one, doubt), alike=" or ".join(equal), next_step=step)


def doubted(one: Finding, doubt: str) -> Finding:
    """Return a finding that a doubt makes indicated."""
    joint = "; " if one.doubts else "; not certain: "
    return replace(
        one,
        verdict=INDICATED,
        evidence=f"{one.evidence.removesuffix('.')}{joint}{doubt}.",
        doubts="; ".join(filter(None, [one.doubts, doubt])),
        least_change=f"diagnosed if this doubt is resolved: {doubt}" if not one.doubts else one.least_change,
    )


def _of_another_bearing(one: Finding, named: str) -> Finding:
    """Return the verdict on a bearing with the same orders as one that is named: not judged."""
    why = f"the line may have another source: {named} has the same orders and a finding"
    return judging_nothing(one, why, f"judged if its orders differed from those of {named}")


def judging_nothing(one: Finding, why: str, least_change: str, next_step: str = "") -> Finding:
    """Return a verdict that judges nothing, with the reason and what would help."""
    return replace(
        one,
        verdict=NOT_JUDGED,
        evidence=f"not judged: {why.rstrip('.')}.",
        doubts=why,
        severity=_UNKNOWN,
        next_step=next_step or (LONGER if why.startswith("too short") else ""),
        least_change=least_change,
    )


RANK = {DIAGNOSED: 0, INDICATED: 1, NOT_JUDGED: 2, NOTHING_FOUND: 3}


def _bearing_verdict(
    part: PartEvidence,
    evidence: Sequence[PartEvidence],
    faulty: Collection[str],
    library: HealthyMachines,
    searches: int,
    stated: float,
) -> Finding:
    """Return the verdict on one kind of defect of a bearing, one of `searches`, by its line in one channel."""
    rivals = [other for other in evidence if other.channel not in faulty and other is not part]
    others = [one.score for one in rivals if (one.component, one.kind) == (part.component, part.kind)]
    tested: Any = {"parts": searches, "others": others}
    probability = library.probability(part.score, **tested)
    needed = max(LEAST_SCORE, library.strength_at(stated, **tested))
    shown = max(probability, RAREST_STATED)
    if probability > stated or part.score < LEAST_SCORE:
        return _unnamed(part, shown, needed)
    if part.hidden_by:
        least_change = "indicated if no other line explained it"
        return _not_judged(part, _hidden(part.hidden_by), probability=shown, least_change=least_change)
    if masked := _masked(part, rivals):
        why, least_change = masked
        step = f"Take a longer record at the same speed and load, and compare the line of {_kind_text(part.kind)}."
        return _not_judged(part, why, probability=shown, least_change=least_change, next_step=step)
    doubts = _doubts(part, rivals)
    return _named(part, doubts, shown, _least_of(_changes(part, rivals, doubts, needed)))


def _masked(part: PartEvidence, others: Sequence[PartEvidence]) -> tuple[str, str] | None:
    """Return why a line that few healthy machines show is no evidence for its part, and what would change that.

    A much larger line of the same bearing leaves traces at the orders of its other parts. Similar lines of both races,
    below `RIVAL_FACTOR` times `FAULTY_DEPTH`, are what a rough bearing or a damaged element causes.
    """
    rivals = _rivals(part, others)
    if part.kind == "cage" and any(rival.score > part.score for rival in rivals):
        why = "other parts of the bearing have lines: the cage's rate, at which unequal elements modulate these"
        return _hidden(why), "indicated, if it were the only part of its bearing with a line"
    larger = max(rivals, key=lambda rival: _where_it_is(part, rival), default=None)
    depth = 0.0 if larger is None else _where_it_is(part, larger)
    if larger is not None and depth > RIVAL_FACTOR * part.depth and larger.score > part.score:
        why = (
            f"the line of {_kind_text(larger.kind)} of the same bearing has {depth / part.depth:.0f} times "
            "its amplitude, and this line may be a side effect of it"
        )
        least = depth / RIVAL_FACTOR
        return _hidden(why), f"indicated at a modulation of {least:.1%} or more (now {part.depth:.1%})"
    clear = RIVAL_FACTOR * FAULTY_DEPTH
    if part.depth >= clear:
        return None
    least_change = f"indicated at a modulation of {clear:.0%} or more (now {part.depth:.1%})"
    for rival in rivals:
        alike = rival.channel == part.channel and 1 / RIVAL_FACTOR < rival.depth / part.depth < RIVAL_FACTOR
        if alike and {part.kind, rival.kind} == {"inner_race", "outer_race"}:
            why = (
                f"the line of {_kind_text(rival.kind)} is of similar size ({rival.depth:.1%}), as a rough bearing or a "
                "damaged element produces both"
            )
            return _hidden(why), least_change
    return None


def _doubts(part: PartEvidence, rivals: Sequence[PartEvidence]) -> list[str]:
    """Return what keeps a bearing's defect from being certain."""
    doubts = []
    if part.score < CLEAR_SCORE and part.depth < RIVAL_FACTOR * FAULTY_DEPTH:
        doubts.append(f"other sources explain its lines nearly as well (a score of {part.score:.1f})")
    if part.depth < FAULTY_DEPTH:
        doubts.append(
            f"it modulates the band by only {part.depth:.1%}, and the races and elements of sound bearings are not "
            "perfect either; compare with earlier and later records"
        )
    if part.kind == "cage":
        doubts.append("damage to a rolling element also produces this line")
    if not part.support:
        doubts.append("no harmonic or sideband supports it")
    elif part.kind in {"inner_race", "outer_race"} and part.carried and not part.sidebands:
        doubts.append("it has no sidebands from passing the load zone, as expected on a rotating race")
    doubts += [
        f"a line of {_kind_text(rival.kind)} of the same bearing is {_comparison(_where_it_is(part, rival), part)}"
        for rival in _rivals(part, rivals)
        if _where_it_is(part, rival) * RIVAL_FACTOR > part.depth
    ]
    doubts += [
        f"{_kind_text(other.kind)} of {other.component}, of order {other.order:.3f}, may also produce this line"
        for other in {(one.component, one.kind): one for one in rivals}.values()
        if _as_near(part, other)
    ]
    return doubts


def _where_it_is(part: PartEvidence, rival: PartEvidence) -> float:
    """Return the depth of a rival's line in the best band of a part; of another channel, in whatever band.

    Impacts on the parts of one bearing excite the same structure, so an equally strong source shows in the same band.
    """
    if rival.channel != part.channel or not part.sibling_depths:
        return rival.depth
    return part.sibling_depths[BEARING_KINDS.index(rival.kind)]


def _as_near(part: PartEvidence, other: PartEvidence) -> bool:
    """Whether a line is nearly as close to the order of another part, of a different order, as to its own."""
    off = abs(part.found / part.order - 1) + SLIP_SCATTER
    same = (other.component, other.kind) == (part.component, part.kind)
    return not same and not _same_order(part.order, other.order) and abs(part.found / other.order - 1) <= off


def _same_order(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=1e-9)


def _rivals(part: PartEvidence, others: Sequence[PartEvidence]) -> list[PartEvidence]:
    """Return the other races and elements of the same bearing, of which the line of a part may be a trace."""
    return [
        other
        for other in others
        if other.component == part.component and other.kind not in {part.kind, "cage"} and other.shows
    ]


def _changes(
    part: PartEvidence, rivals: Sequence[PartEvidence], doubts: Sequence[str], needed: float
) -> list[tuple[float, str]]:
    """Return changes that would alter the verdict on a named part, each with its factor; inf if it has none."""
    lost = [(part.score / needed, f"nothing found below a score of {needed:.3g} (now {part.score:.3g})")]
    if len(doubts) == 1:
        if part.depth < FAULTY_DEPTH:
            deeper = f"diagnosed at a modulation of {FAULTY_DEPTH:.0%} or more (now {part.depth:.1%})"
            return [*lost, (FAULTY_DEPTH / part.depth, deeper)]
        return [*lost, (math.inf, f"diagnosed if this doubt is resolved: {doubts[0]}")]
    if doubts:
        return lost
    changes = [
        (part.depth / FAULTY_DEPTH, f"indicated below a modulation of {FAULTY_DEPTH:.0%} (now {part.depth:.1%})"),
        *lost,
    ]
    most = part.depth / RIVAL_FACTOR
    for rival in _rivals(part, rivals):
        now = _where_it_is(part, rival)
        text = f"indicated, if the line of {_kind_text(rival.kind)} modulated by {most:.1%} (now {now:.1%})"
        changes.append((most / now if now else math.inf, text))
    return changes


def _least_of(changes: Sequence[tuple[float, str]]) -> str:
    """Return the change with the smallest factor."""
    return min(changes, key=lambda change: change[0])[1]


def _comparison(depth: float, part: PartEvidence) -> str:
    if depth > RIVAL_FACTOR * part.depth:
        return f"{depth / part.depth:.0f} times as large; this line may be a side effect of it"
    return "of similar size, which a single local defect would not produce"


def _named(part: PartEvidence, doubts: Sequence[str], probability: float, least_change: str) -> Finding:
    """Return a finding on a bearing; any doubt makes it indicated."""
    band = f"{part.band_low_hz:.6g}-{part.band_high_hz:.6g} Hz"
    evidence = f"{_line_text(part)}, a modulation of the band {band} by {part.depth:.1%}"
    if part.support:
        evidence += f"; supported by {part.support}"
    if doubts:
        evidence += "; not certain: " + "; ".join(doubts)
    kind = _kind_text(part.kind)
    return replace(
        _blank(part),
        verdict=INDICATED if doubts else DIAGNOSED,
        evidence=evidence + ".",
        false_alarm_probability=probability,
        doubts="; ".join(doubts),
        severity=f"{_UNKNOWN}; it modulates the band by {part.depth:.1%}",
        next_step=(
            f"Take another record at the same speed and load, and compare the line of {kind}; plan an inspection."
            if doubts
            else f"Inspect {kind} of {part.component}; until then, record often at the same speed and load."
        ),
        least_change=least_change,
    )


def _unnamed(part: PartEvidence, probability: float, needed: float) -> Finding:
    """Return that nothing was found, or that a part is not judged since its defect may have gone undetected."""
    if part.largest_strength > FAULTY_DEPTH:
        why = f"a line at its order, of noise or damage, modulates a band by {part.largest_strength:.0%}"
        if part.hidden_by:
            why = f"{_hidden(part.hidden_by)}; it modulates a band by {part.largest_strength:.0%} and may mask damage"
        return _not_judged(part, why, least_change=f"nothing found with that line below {FAULTY_DEPTH:.0%}")
    if part.possible_depth > JUDGED_DEPTH:
        longer = (part.possible_depth / JUDGED_DEPTH) ** 2  # the noise about a line falls as the root of the time
        return _not_judged(
            part,
            f"too short or too noisy: a modulation of {part.possible_depth:.1%} may go undetected, "
            f"while damage is indicated at {JUDGED_DEPTH:.0%}",
            least_change=f"judged in a record longer by a factor of {longer:.2g}"
            if math.isfinite(longer)
            else "judged in a band that has power",
        )
    seen = f"{healthy_share_words(probability)} records of healthy machines show as much"
    if probability <= SELDOM_SOUND and not part.hidden_by:
        why = f"a line at its order modulates a band by {part.depth:.1%}: {seen}, too few to call it sound"
        least_change = f"indicated at a score of {needed:.3g} or more (now {part.score:.3g})"
        step = "Take another record at the same speed and load, a longer one if possible, and compare the line."
        return _not_judged(part, why, probability=probability, least_change=least_change, next_step=step)
    if part.undrawn:
        return _not_judged(part, f"{UNEXPLAINED}: {part.undrawn}", least_change="nothing found without that line")
    seen = f"{_line_text(part)}: {seen}" if part.strength > 0 else "no line of its own at its orders"
    blind = JUDGED_DEPTH / part.possible_depth if part.possible_depth > 0 else math.inf
    changes = [(blind, f"judged up to {blind:.2g} times as much background noise")]
    if part.score > 0:
        changes.append((needed / part.score, f"indicated at a score of {needed:.3g} or more (now {part.score:.3g})"))
    low_hz, high_hz = part.inspected_hz
    return replace(
        _blank(part),
        verdict=NOTHING_FOUND,
        evidence=f"{seen}; a modulation of {part.possible_depth:.1%} between {low_hz:.5g} and {high_hz:.5g} Hz would "
        "have been detected.",
        false_alarm_probability=probability,
        doubts=_hidden(part.hidden_by) if part.hidden_by else "",
        least_change=_least_of(changes),
    )


def _hidden(what: str) -> str:
    return f"the line may have another source: {what}"


def _not_judged(
    part: PartEvidence, why: str, *, probability: float = math.nan, least_change: str, next_step: str = ""
) -> Finding:
    return judging_nothing(
        replace(_blank(part), false_alarm_probability=probability), why, least_change, next_step=next_step
    )


def _blank(part: PartEvidence) -> Finding:
    return Finding(
        component=part.component,
        kind=part.kind,
        channel=part.channel,
        snr=part.snr if math.isfinite(part.snr) else 1e9,
        order_found=part.found,
        amplitude=part.amplitude,
        units=part.units,
        strength=part.strength,
        score=part.score,
        depth=part.depth,
    )


def _line_text(part: PartEvidence) -> str:
    """Return the order and size of a part's line in words."""
    offset = part.found / part.order - 1
    off = f", {offset:+.1%}" if abs(offset) > 5e-4 else ""  # noqa: PLR2004  (what one decimal can show)
    return (
        f"envelope line at {part.found:.3f} orders (nominal {part.order:.3f}{off}), {part.amplitude:.3g} "
        f"{part.units}, {part.snr:.1f} times its background"
    )


def _kind_text(kind: str) -> str:
    return "the " + kind.replace("_", " ")
