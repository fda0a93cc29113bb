"""Findings from assessed lines.

A significant fundamental (see `hums.analysis.detection`) raises a finding. That of a bearing is *diagnosed* when it
modulates its band by a tenth of the mean or more, a harmonic or sideband at the right spacing supports it, and no other
race or element of the same bearing comes within a factor of three of it in any band; one of a cage never, since damage
of an element makes the same line. Otherwise it is *indicated*, and the evidence states why. A line of a faulty sensor
is never diagnosed. Gears are judged in `hums.analysis.gear_damage`.

Indicators support a finding or cast doubt on it; they never raise one, which would change
the false-alarm probability.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from hums.analysis.detection import RIVAL_FACTOR, AssessedLine
from hums.analysis.lines import ENVELOPE, is_support, supports
from hums.gearbox.orders import BEARING_KINDS

Depths = Mapping[str, Mapping[tuple[str, str], float]]
"""Of each channel the largest modulation, over all bands, by each kind of defect of each bearing."""

__all__ = ["DIAGNOSED", "INDICATED", "Finding", "findings"]

DIAGNOSED, INDICATED = "diagnosed", "indicated"
# Part of the mean envelope by which a damaged race modulates it. Halved, weak lines of sound bearings are diagnosed;
# doubled, early damage is only indicated.
FAULTY_DEPTH = 0.1
SUPPORT_PROBABILITY = 0.01


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Verdict on one kind of defect of one component, with the evidence in words and its strongest line."""

    component: str
    kind: str
    channel: str
    verdict: str
    evidence: str
    false_alarm_probability: float
    snr: float
    order_found: float
    amplitude: float
    units: str


def findings(
    assessed: Sequence[AssessedLine],
    *,
    faulty: Collection[str] = (),
    depths: Depths | None = None,
) -> list[Finding]:
    """Return a finding for every bearing and kind with a significant fundamental.

    Diagnosed findings come before indicated ones, then those of higher level over the background. Sidebands of a mesh
    raise none, for every sound pair has them: teeth are judged by `hums.analysis.gear_damage`.

    Parameters
    ----------
    assessed : sequence of AssessedLine
        All lines of all channels of the record.
    faulty : collection of str
        Channels with a faulty sensor.
    depths : mapping of channel to mapping, optional
        See `Depths`: rivals count where they are largest.
    """
    families: dict[tuple[str, str], list[AssessedLine]] = {}
    for line in assessed:
        families.setdefault(line.measured.family, []).append(line)
    raised = {
        family: lines
        for family, lines in families.items()
        if any(line.significant and line.measured.expected.fundamental for line in lines)
    }
    results = [
        _bearing_finding(lines, raised, faulty, depths or {})
        for (_, kind), lines in raised.items()
        if kind in BEARING_KINDS
    ]
    return sorted(results, key=lambda finding: (finding.verdict != DIAGNOSED, -finding.snr))


def _main_line(lines: Sequence[AssessedLine]) -> AssessedLine:
    """Return the significant fundamental of the highest level over the background."""
    fundamental = [line for line in lines if line.significant and line.measured.expected.fundamental]
    return max(fundamental, key=lambda line: line.measured.line.snr)


def _bearing_finding(
    lines: Sequence[AssessedLine],
    raised: Mapping[tuple[str, str], Sequence[AssessedLine]],
    faulty: Collection[str],
    depths: Depths,
) -> Finding:
    """Return the finding on one kind of defect of a bearing, indicated if rivals or weak evidence leave doubts."""
    main = _main_line(lines)
    component, kind = main.measured.family
    channel = [line for line in lines if line.measured.channel == main.measured.channel]
    support = _supporting_lines(main, channel)
    own, seen = main.measured.depth, {family: _largest_depth(others) for family, others in raised.items()}
    for family, depth in (pair for channel in depths.values() for pair in channel.items()):
        seen[family] = max(seen.get(family, 0.0), depth)
    rivals = {
        other_kind: depth
        for (other, other_kind), depth in seen.items()
        if other == component and other_kind != kind and depth * RIVAL_FACTOR > own and kind != "cage" != other_kind
    }
    doubts = _sensor_doubts(main, faulty)
    if main.measured.depth < FAULTY_DEPTH:
        doubts.append(
            f"it modulates the band by only {main.measured.depth:.1%}: it is there, but sound bearings have races and "
            "elements that are not perfect, too; compare with earlier and later records"
        )
    if kind == "cage":
        doubts.append("damage of a rolling element makes this line, too")
    if not support:
        doubts.append("no harmonic or sideband supports it")
    doubts += [
        f"a line of {_kind_text(rival)} of the same bearing is {_comparison(size, own)}"
        for rival, size in rivals.items()
    ]
    return _finding(main, support, doubts)


def _comparison(rival: float, own: float) -> str:
    if rival > RIVAL_FACTOR * own:
        return f"{rival / own:.0f} times as large, of which this may be a trace"
    return "of similar size, which one local defect would not make"


def _supporting_lines(main: AssessedLine, lines: Iterable[AssessedLine]) -> list[str]:
    """Return the names of the harmonics and sidebands of a fundamental that noise alone seldom produces."""
    support = []
    for line in lines:
        expected, found = line.measured.expected, line.measured.line
        if not is_support(line.measured) or not supports(line.measured, main.measured) or line.explained_by:
            continue
        if found.false_alarm_probability <= SUPPORT_PROBABILITY:
            name = f"sideband {expected.sideband:+d}" if expected.sideband else f"harmonic {expected.harmonic}"
            support.append(f"{name} at {found.found:.3f}")
    return support


def _largest_depth(lines: Iterable[AssessedLine]) -> float:
    return max(
        (line.measured.depth for line in lines if line.significant and not line.measured.expected.sideband),
        default=0.0,
    )


def _sensor_doubts(main: AssessedLine, faulty: Collection[str]) -> list[str]:
    return ["the sensor is sick, and may make such a line by itself"] if main.measured.channel in faulty else []


def _finding(main: AssessedLine, support: Sequence[str], doubts: Sequence[str]) -> Finding:
    """Return the finding on the main line's component; any doubt makes it indicated."""
    found, expected = main.measured.line, main.measured.expected
    where = (
        "envelope line"
        if expected.spectrum == ENVELOPE
        else f"sideband {expected.sideband:+d} of mesh harmonic {expected.harmonic}"
    )
    offset = found.found / expected.order - 1
    off = f", {offset:+.1%}" if abs(offset) > 5e-4 else ""  # noqa: PLR2004  (what one decimal can show)
    evidence = (
        f"{where} at {found.found:.3f} orders (nominal {expected.order:.3f}{off}), {found.amplitude:.3g} "
        f"{main.measured.units}, {found.snr:.1f} times its surroundings"
    )
    if main.measured.level > 0:
        evidence += f", a modulation of the band by {main.measured.depth:.1%}"
    if support:
        evidence += "; supported by " + ", ".join(support)
    if doubts:
        evidence += "; not certain: " + "; ".join(doubts)
    return Finding(
        component=expected.component,
        kind=expected.kind,
        channel=main.measured.channel,
        verdict=INDICATED if doubts else DIAGNOSED,
        evidence=evidence + ".",
        false_alarm_probability=main.false_alarm_probability,
        snr=found.snr if math.isfinite(found.snr) else 1e9,
        order_found=found.found,
        amplitude=found.amplitude,
        units=main.measured.units,
    )


def _kind_text(kind: str) -> str:
    return "the " + kind.replace("_", " ")
