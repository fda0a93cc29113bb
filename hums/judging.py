"""Which lines are real, and which are another line's shadow.

The rule, fixed on the wind turbine and CWRU records:

1. A line is *significant* when noise alone would reach it, anywhere among all the lines of the record that
   can raise a finding, with less than the false-alarm probability of the settings.
2. From the strongest (by level above its surroundings, a bearing's with its harmonics and sidebands) downwards, a
   significant line is *claimed* unless a taller line spreads half as much or more to its place through the window
   (a flank or side lobe), or it lies within the main lobe (two bins) of a harmonic of a stronger claimed line, of its
   sideband by a ring's rotation or the cage, or of a multiple of the cage rate which that line implies. The one
   race's rate is itself such a multiple when the other's is known; there the weaker line is taken for a shadow only
   below a third of the stronger, for comparable lines on both races mean something. A damaged element makes a line
   at the cage rate, too. In the envelope impacts once a turn of a shaft, or whenever a planet's damaged tooth meets
   another gear, reach any multiple of that rate.
   Sidebands that the planets' passing makes in health, too, are taken for that.
3. Harmonics and sidebands of a bearing line are claimed with it, at the right spacing, and never alone. A line that
   would be a harmonic of two claimed fundamentals supports neither.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from hums.orders import BEARING_KINDS, BearingOrders
from hums.search import ENVELOPE, TOOTH_KINDS, FoundLine
from signals.lines import record_probability

__all__ = ["OF_CAGE", "RIVAL_FACTOR", "Judge", "JudgedLine", "implied_cage", "is_support", "supports"]

RIVAL_FACTOR = 3.0
LOBE_BINS = 2.0
LEAKAGE_SHARE = 0.5
OF_CAGE = "times the cage rate implied by"
_SHADOW_HARMONICS = 3
_SHADOW_SIDEBANDS = 3


@dataclass(frozen=True, kw_only=True)
class JudgedLine:
    """A found line with the verdict on it."""

    found: FoundLine
    false_alarm_probability: float
    claimed: bool
    explained_by: str = ""


@dataclass(frozen=True)
class Judge:
    """Applies the rule to the lines of one record.

    `natural_spacings` names, for each gear of a planetary stage, the sideband spacings that a healthy one shows.
    """

    bearings: Mapping[str, BearingOrders]
    false_alarm_probability: float
    natural_spacings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def judge(self, lines: Sequence[FoundLine]) -> list[JudgedLine]:
        """Mark each line as claimed, explained by a stronger one, or neither; order as given."""
        searches = max(1, sum(line.wanted.fundamental for line in lines))
        chance = [record_probability(line.line.false_alarm_probability, searches=searches) for line in lines]
        verdict = [
            JudgedLine(found=line, false_alarm_probability=p, claimed=False)
            for line, p in zip(lines, chance, strict=True)
        ]
        claimed: list[FoundLine] = []
        significant = [i for i in range(len(lines)) if chance[i] < self.false_alarm_probability]
        level = _levels([lines[i] for i in significant])
        # a bearing's harmonics and sidebands come after all lines that can stand alone
        for i in sorted(significant, key=lambda i: (is_support(lines[i]), -level(lines[i]))):
            line = lines[i]
            parents = [other for other in claimed if supports(line, other)] if is_support(line) else []
            if parents and not self._is_anothers(line, claimed):
                verdict[i] = replace(verdict[i], claimed=True)
                continue
            shadow = self._nature(line)
            shadow = shadow or next((text for other in claimed if (text := self._shadow(line, other))), "")
            verdict[i] = replace(verdict[i], claimed=not shadow and not is_support(line), explained_by=shadow)
            if verdict[i].claimed:
                claimed.append(line)
        return verdict

    def _nature(self, line: FoundLine) -> str:
        """Say what makes this line without any fault, or return an empty string."""
        if line.line.leakage > LEAKAGE_SHARE * line.line.amplitude:
            return "the flank of a stronger line beside it"
        if line.wanted.kind == "tooth":
            centre = line.wanted.order - line.wanted.sideband * line.wanted.spacing
            for spacing in self.natural_spacings.get(line.wanted.component, ()):
                side = round((line.line.found - centre) / spacing)
                if side and _near(line, centre + side * spacing):
                    return f"sideband {side:+d} x {spacing:.4g} of the mesh, which the planets' passing makes in health"
        return ""

    def _is_anothers(self, line: FoundLine, claimed: Iterable[FoundLine]) -> bool:
        """Whether a bearing harmonic is one of another claimed defect of the same bearing as well."""
        return not line.wanted.sideband and any(
            _near(line, harmonic * other.line.found)
            for other in claimed
            if other.wanted.fundamental and other.wanted.kind in BEARING_KINDS and other.family != line.family
            for harmonic in range(1, 2 * _SHADOW_HARMONICS + 1)
        )

    def _shadow(self, weaker: FoundLine, stronger: FoundLine) -> str:
        """Say how `stronger` makes a line where `weaker` stands, or return an empty string."""
        same_spectrum = weaker.wanted.spectrum == stronger.wanted.spectrum and weaker.channel == stronger.channel
        if not same_spectrum or weaker.family == stronger.family:
            return ""
        base = stronger.line.found
        name = f"{stronger.wanted.component} {stronger.wanted.kind.replace('_', ' ')}"
        if weaker.wanted.kind in {"gear_mesh", "shaft"} or _is_comb(weaker):
            return f"not to be told from {name}" if _near(weaker, base, bins=1.0) else ""
        if stronger.wanted.kind == "shaft" or _is_comb(stronger):
            # where the speed was measured a shaft's order is known better than a line shows it
            base = (base if stronger.wanted.tolerance else stronger.wanted.order) / stronger.wanted.harmonic
            multiple = round(weaker.line.found / base)
            # Coupling and run-out reach any multiple in an envelope; but a gear's sidebands are multiples of its
            # own shaft by nature, so there only the searched harmonics count.
            reach = _SHADOW_HARMONICS if weaker.wanted.kind == "tooth" else multiple
            near = 0 < multiple <= reach and _near(weaker, multiple * base)
            return f"harmonic {multiple} of {name}" if near else ""
        harmonics = 1 if stronger.wanted.kind == "tooth" else _SHADOW_HARMONICS
        for harmonic in range(1, harmonics + 1):
            if _near(weaker, harmonic * base):
                return f"harmonic {harmonic} of {name}" if harmonic > 1 else f"coincides with {name}"
        if stronger.wanted.kind not in BEARING_KINDS:
            return ""
        return self._bearing_shadow(weaker, stronger, name)

    def _bearing_shadow(self, weaker: FoundLine, stronger: FoundLine, name: str) -> str:
        order, bearing = weaker.line.found, self.bearings[stronger.wanted.component]
        base = stronger.line.found / stronger.wanted.harmonic
        cage = implied_cage(bearing, stronger.wanted.kind, base)
        if cage:
            multiple = round(order / cage)
            races = {weaker.wanted.kind, stronger.wanted.kind} == {"inner_race", "outer_race"}
            rival = races and not is_support(weaker) and weaker.line.amplitude * RIVAL_FACTOR > stronger.line.amplitude
            if 0 < multiple <= 2 * bearing.elements and _near(weaker, multiple * cage) and not rival:
                return f"{multiple} {OF_CAGE} {name}"
        turns = stronger.wanted.kind == "rolling_element"
        if turns and weaker.wanted.kind == "cage" and weaker.wanted.component == stronger.wanted.component:
            return f"the cage's rate, at which it takes {name} through the load zone"
        spacings = {abs(bearing.inner_ring), abs(bearing.outer_ring), bearing.cage if turns else cage} - {0.0}
        for harmonic in range(1, _SHADOW_HARMONICS + 1):
            for spacing in spacings:
                side = round((order - harmonic * base) / spacing)
                if 0 < abs(side) <= _SHADOW_SIDEBANDS and _near(weaker, harmonic * base + side * spacing):
                    return f"sideband {side:+d} x {spacing:.3g} of harmonic {harmonic} of {name}"
        return ""


def _levels(significant: Sequence[FoundLine]) -> Callable[[FoundLine], float]:
    """Return a function that tells how strongly a line stands out with all that speaks for it.

    A bearing's fundamental has its harmonics and sidebands, which often outdo it; a shaft or a tooth in an envelope,
    which impacts fill with a comb, has its other harmonics.
    """

    def speaks_for(other: FoundLine, line: FoundLine) -> bool:
        if _is_comb(line):
            return _is_comb(other) and other.family == line.family and other.channel == line.channel
        return is_support(other) and supports(other, line)

    def level(line: FoundLine) -> float:
        if line.wanted.spectrum != ENVELOPE or is_support(line):
            return line.line.snr
        with_it = [o for o in significant if o is not line and o.wanted.spectrum == ENVELOPE and speaks_for(o, line)]
        return math.hypot(line.line.snr, *(other.line.snr for other in with_it))

    return level


def _is_comb(line: FoundLine) -> bool:
    """Whether a line is of what impacts once a turn, or once a meeting of two teeth, make in an envelope."""
    return line.wanted.spectrum == ENVELOPE and line.wanted.kind in {"shaft", *TOOTH_KINDS}


def is_support(line: FoundLine) -> bool:
    """Whether a line only means something beside its fundamental: a bearing's harmonic or sideband."""
    return line.wanted.kind in BEARING_KINDS and not line.wanted.fundamental


def supports(line: FoundLine, fundamental: FoundLine) -> bool:
    """Whether a harmonic or sideband belongs to a fundamental: same family and channel, at the right spacing."""
    if line.family != fundamental.family or line.channel != fundamental.channel or not fundamental.wanted.fundamental:
        return False
    if line.wanted.sideband:
        return True  # it was looked for beside the found fundamental
    return abs(line.line.found - line.wanted.harmonic * fundamental.line.found) <= (
        line.wanted.harmonic * LOBE_BINS * line.bin_width
    )


def _near(line: FoundLine, order: float, *, bins: float = LOBE_BINS) -> bool:
    return abs(line.line.found - order) <= bins * line.bin_width


def implied_cage(bearing: BearingOrders, kind: str, order: float) -> float:
    """Return the cage's rate against the outer ring that a race or cage line implies; 0 for other kinds."""
    if kind == "outer_race":
        return order / bearing.elements
    if kind == "inner_race":
        return bearing.relative - order / bearing.elements
    return order if kind == "cage" and bearing.outer_ring == 0 else 0.0
