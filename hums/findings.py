"""From judged lines to statements.

A claimed fundamental (`judging` says which lines are) raises a finding. The finding is *diagnosed* when the line stands
at least six times above its surroundings, a harmonic or sideband at the right spacing supports it, and neither another
kind of defect of the same bearing nor, beside a race, a multiple of the cage rate is within a factor of three; for a
gear, when the residual of the synchronous average shows that the disturbance is local (FM4). Otherwise it is
*indicated*, and the evidence says why. What a sick sensor shows is never diagnosed.

Indicators support a finding or cast doubt on it; they never raise one, so they leave the rate of false alarms alone.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from hums.judging import OF_CAGE, RIVAL_FACTOR, JudgedLine, is_support, supports
from hums.orders import BEARING_KINDS
from hums.search import ENVELOPE

__all__ = ["DIAGNOSED", "INDICATED", "Finding", "Locality", "findings"]

DIAGNOSED, INDICATED = "diagnosed", "indicated"
STRONG_SNR = 6.0
SUPPORT_PROBABILITY = 0.01


@dataclass(frozen=True, kw_only=True)
class Locality:
    """How local a gear's disturbance is in its revolution: FM4, the kurtosis of its difference signal, and its limit.

    The limit is what noise and a smooth modulation, once or twice a turn, may reach.
    """

    kurtosis: float
    limit: float


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One component with one kind of defect, the verdict, and the evidence in words."""

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
    judged: Sequence[JudgedLine], *, locality: Mapping[str, Locality], sick: Collection[str] = ()
) -> list[Finding]:
    """Rank the claimed families: diagnosed before indicated, then by level above the surroundings.

    Parameters
    ----------
    judged : sequence of JudgedLine
        All lines of the record, all channels.
    locality : mapping of gear component to Locality
        For gears whose synchronous average could be made.
    sick : channels whose sensor spoils what is estimated.
    """
    families: dict[tuple[str, str], list[JudgedLine]] = {}
    for line in judged:
        families.setdefault(line.found.family, []).append(line)
    raised = {
        family: lines
        for family, lines in families.items()
        if any(line.claimed and line.found.wanted.fundamental for line in lines)
    }
    statements = [
        _bearing_finding(lines, raised, _cage_multiples(lines, families), sick)
        if kind in BEARING_KINDS
        else _gear_finding(lines, locality.get(component), sick)
        for (component, kind), lines in raised.items()
    ]
    return sorted(statements, key=lambda finding: (finding.verdict != DIAGNOSED, -finding.snr))


def _main_line(lines: Sequence[JudgedLine]) -> JudgedLine:
    fundamental = [line for line in lines if line.claimed and line.found.wanted.fundamental]
    return max(fundamental, key=lambda line: line.found.line.snr)


def _bearing_finding(
    lines: Sequence[JudgedLine],
    raised: Mapping[tuple[str, str], Sequence[JudgedLine]],
    cage_multiples: Sequence[int],
    sick: Collection[str],
) -> Finding:
    main = _main_line(lines)
    component, kind = main.found.family
    channel = [line for line in lines if line.found.channel == main.found.channel]
    support = _support(main, channel)
    strength = _strength(channel)
    rivals = {
        other_kind: _strength(other_lines)
        for (other, other_kind), other_lines in raised.items()
        if other == component and other_kind != kind and _strength(other_lines) * RIVAL_FACTOR > strength
    }
    doubts = _about_sensor(main, sick)
    if main.found.line.snr < STRONG_SNR:
        doubts.append(
            f"the line is only {main.found.line.snr:.1f} times its surroundings: it is there, but a line this weak "
            "does not tell a fault from normal wear; compare with earlier and later records"
        )
    if not support:
        doubts.append("no harmonic or sideband supports it")
    doubts += [
        f"a line of {_words(rival)} of the same bearing is {_comparison(size, strength)}"
        for rival, size in rivals.items()
    ]
    if cage_multiples:
        doubts.append(
            f"lines at {', '.join(map(str, cage_multiples))} times the cage rate are of similar size: elements that "
            "are not alike make them, as damage of one does, and a spot on a race does not"
        )
    return _finding(main, support, doubts)


def _cage_multiples(lines: Sequence[JudgedLine], families: Mapping[tuple[str, str], Sequence[JudgedLine]]) -> list[int]:
    """Return at which multiples of the cage rate stand lines about as large as those of a race, (k,).

    A race that rests in the load zone, or turns through it, is struck by all elements alike, whatever the cage does.
    Beside an inner race only the cage's own lines count: sidebands by the shaft fall on multiples of the cage rate.
    """
    main = _main_line(lines)
    component, kind = main.found.family
    strength = _strength(line for line in lines if line.found.channel == main.found.channel)
    speaking = {"outer_race": ("cage", "rolling_element"), "inner_race": ("cage",)}.get(kind, ())
    found = set()
    for line in (line for other in speaking for line in families.get((component, other), ())):
        number, is_multiple, of = line.explained_by.partition(f" {OF_CAGE} ")
        same = of == f"{component} {kind.replace('_', ' ')}" and line.found.channel == main.found.channel
        if is_multiple and same and line.found.line.amplitude * RIVAL_FACTOR > strength:
            found.add(int(number))
    return sorted(found)


def _comparison(rival: float, own: float) -> str:
    if rival > RIVAL_FACTOR * own:
        return f"{rival / own:.0f} times as large, of which this may be a trace"
    return "of similar size, which one local defect would not make"


def _support(main: JudgedLine, lines: Iterable[JudgedLine]) -> list[str]:
    """Name the harmonics and sidebands beside a fundamental that noise would seldom make there."""
    support = []
    for line in lines:
        wanted, found = line.found.wanted, line.found.line
        if not is_support(line.found) or not supports(line.found, main.found) or line.explained_by:
            continue
        if found.false_alarm_probability <= SUPPORT_PROBABILITY:
            name = f"sideband {wanted.sideband:+d}" if wanted.sideband else f"harmonic {wanted.harmonic}"
            support.append(f"{name} at {found.found:.3f}")
    return support


def _strength(lines: Iterable[JudgedLine]) -> float:
    return max(
        (line.found.line.amplitude for line in lines if line.claimed and not line.found.wanted.sideband),
        default=0.0,
    )


def _about_sensor(main: JudgedLine, sick: Collection[str]) -> list[str]:
    return ["the sensor is sick, and may make such a line by itself"] if main.found.channel in sick else []


def _gear_finding(lines: Sequence[JudgedLine], locality: Locality | None, sick: Collection[str]) -> Finding:
    main = _main_line(lines)
    claimed = [
        line
        for line in lines
        if line.claimed and line.found.wanted.sideband and line.found.channel == main.found.channel
    ]
    others = [line for line in claimed if line is not main]
    support = [f"{len(claimed)} claimed sidebands of its mesh"] if others else []
    doubts = _about_sensor(main, sick)
    if locality is None and not doubts:
        doubts.append("its synchronous average could not be made, so nothing shows that one tooth is at fault")
    elif locality is not None and locality.kurtosis <= locality.limit:
        doubts.append(
            f"the difference signal of its synchronous average is not local (FM4 {locality.kurtosis:.1f}; noise and "
            f"smooth modulation reach {locality.limit:.1f}): run-out, misalignment or load variation make such "
            "sidebands too"
        )
    elif locality is not None:
        support.append(
            f"a difference signal of its synchronous average that is local (FM4 {locality.kurtosis:.1f}; noise and "
            f"smooth modulation reach {locality.limit:.1f}), as one damaged tooth makes it"
        )
    if not others:
        doubts.append("a single sideband stands alone")
    if main.found.line.snr < STRONG_SNR:
        doubts.append(f"the largest is only {main.found.line.snr:.1f} times its surroundings")
    return _finding(main, support, doubts)


def _finding(main: JudgedLine, support: Sequence[str], doubts: Sequence[str]) -> Finding:
    found, wanted = main.found.line, main.found.wanted
    where = (
        "envelope line"
        if wanted.spectrum == ENVELOPE
        else f"sideband {wanted.sideband:+d} of mesh harmonic {wanted.harmonic}"
    )
    offset = found.found / wanted.order - 1
    off = f", {offset:+.1%}" if abs(offset) > 5e-4 else ""  # noqa: PLR2004  (what one decimal can show)
    evidence = (
        f"{where} at {found.found:.3f} orders (nominal {wanted.order:.3f}{off}), {found.amplitude:.3g} "
        f"{main.found.units}, {found.snr:.1f} times its surroundings"
    )
    if support:
        evidence += "; supported by " + ", ".join(support)
    if doubts:
        evidence += "; not certain: " + "; ".join(doubts)
    return Finding(
        component=wanted.component,
        kind=wanted.kind,
        channel=main.found.channel,
        verdict=INDICATED if doubts else DIAGNOSED,
        evidence=evidence + ".",
        false_alarm_probability=main.false_alarm_probability,
        snr=found.snr if math.isfinite(found.snr) else 1e9,
        order_found=found.found,
        amplitude=found.amplitude,
        units=main.found.units,
    )


def _words(kind: str) -> str:
    return "the " + kind.replace("_", " ")
