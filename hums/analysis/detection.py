"""Significance of measured lines, and attribution of each line to its strongest explanation.

The rules, fixed on the wind turbine and CWRU records:

1. A line is *detected* if the probability that noise alone exceeds it, at any line of the record that can raise a
   finding, is below the false-alarm probability of the settings.
2. Detected lines are assessed in descending order of level (amplitude over background; a bearing's with its harmonics
   and sidebands). A detected line is *significant* (column ``claimed``) unless one of these explains it:

   - leakage: through the window, a larger line contributes half of its amplitude or more;
   - a bearing line is no peak: the spectrum still rises at the edge of the search range;
   - it lies within the main lobe (two bins) of a harmonic of a stronger significant line, of a bearing's to the tenth,
     or of a sideband of that line spaced by a ring's rotation or the cage;
   - it is a cage's: unequal elements and a damaged element produce a line at the cage order;
   - it is below a third of that of another defect of the same bearing, since the impacts of one defect excite lines at
     the orders of the others;
   - in the envelope, impacts once per revolution of a shaft, or once per contact of a planet's damaged tooth, produce
     any multiple of that order. These are of similar size: a comb of a shaft or cage whose first harmonics are below a
     third of a bearing line explains no multiple above the third, since a defect carried through the load zone causes
     such lines as well;
   - it is a sideband that the planet pass produces in a healthy stage.
3. If lines of bearings share a peak, the part with the nearest nominal order explains the others; a cage without a comb
   of impacts is assessed last.
4. Harmonics and sidebands of a bearing line are significant only together with it, at the right spacing.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from hums.analysis.expected_lines import ENVELOPE, LOBE_BINS, TOOTH_KINDS, MeasuredLine, is_support, supports
from hums.analysis.thresholds import IMPACT_HARMONICS, RIVAL_FACTOR
from hums.gearbox.bearing_catalogue import BearingOrders
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.spectra.lines import record_probability

LEAKAGE_SHARE = 0.5
_EXPLAINED = 3  # harmonics of a stronger line, and sidebands on either side of each

_Comb = tuple[tuple[str, str], str, str]  # component and kind, channel, spectrum


@dataclass(frozen=True, kw_only=True)
class AssessedLine:
    """A measured line with its significance, and the stronger line that explains it otherwise."""

    measured: MeasuredLine
    false_alarm_probability: float
    significant: bool
    explained_by: str = ""


@dataclass(frozen=True)
class LineAssessor:
    """Assessment of the lines of one record by the rule of this module.

    `healthy_spacings` are the sideband spacings of each gear of a healthy planetary stage, in orders.
    """

    bearings: Mapping[str, BearingOrders]
    false_alarm_probability: float
    healthy_spacings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def assess(self, lines: Sequence[MeasuredLine]) -> list[AssessedLine]:
        """Return whether each line is significant, or which stronger line explains it, in the given order."""
        searches = _searches(lines)
        probability = [record_probability(line.line.false_alarm_probability, searches=searches) for line in lines]
        result = [
            AssessedLine(measured=line, false_alarm_probability=p, significant=False)
            for line, p in zip(lines, probability, strict=True)
        ]
        significant: list[MeasuredLine] = []
        detected = [i for i in range(len(lines)) if probability[i] < self.false_alarm_probability]
        least = _least_of_combs(lines)
        rank = _ranks(lines, detected, least)
        for i in sorted(detected, key=rank.__getitem__):
            line = lines[i]
            parents = [other for other in significant if supports(line, other)] if is_support(line) else []
            if parents:
                result[i] = replace(result[i], significant=True)
                continue
            cause = self._healthy_cause(line)
            cause = cause or next(
                (text for other in significant if (text := self._explanation(line, other, least.get(_comb(other))))), ""
            )
            result[i] = replace(result[i], significant=not cause and not is_support(line), explained_by=cause)
            if result[i].significant:
                significant.append(line)
        return result

    def _healthy_cause(self, line: MeasuredLine) -> str:
        """Return the cause that produces this line without any defect, or an empty string."""
        if line.line.leakage > LEAKAGE_SHARE * line.line.amplitude:
            return "the flank of a stronger adjacent line, or of a mains line that the speed crosses"
        if line.expected.kind in BEARING_KINDS and line.line.at_edge:
            return "the flank of a peak outside the searched range"
        if line.expected.kind == "tooth":
            centre = line.expected.order - line.expected.sideband * line.expected.spacing
            for spacing in self.healthy_spacings.get(line.expected.component, ()):
                side = round((line.line.found - centre) / spacing)
                if side and _near(line, centre + side * spacing):
                    return f"sideband {side:+d} x {spacing:.4g} of the mesh, which planets cause in a healthy stage"
        return ""

    def _explanation(self, weaker: MeasuredLine, stronger: MeasuredLine, least: float | None) -> str:
        """Return how `stronger` produces a line at the order of `weaker`, or an empty string.

        `least` is the smallest amplitude of the comb that `stronger` is of, None if it is of none.
        """
        same_spectrum = weaker.expected.spectrum == stronger.expected.spectrum and weaker.channel == stronger.channel
        if not same_spectrum or weaker.family == stronger.family:
            return ""
        base = stronger.line.found
        name = f"{stronger.expected.component} {stronger.expected.kind.replace('_', ' ')}"
        carried = weaker.expected.component.startswith(f"{stronger.expected.component}/")
        if carried and (stronger.expected.kind, stronger.expected.harmonic) == ("gear_mesh", weaker.expected.harmonic):
            # the sidebands of a mesh follow from where it was found; a nominal speed leaves room for other lines
            place = weaker.expected.order * base / stronger.expected.order
            if not _near(weaker, place):
                return f"off the sidebands of {name}, the nearest of which is at {place:.4g}"
        if weaker.expected.kind in {"gear_mesh", "shaft"} or _is_comb(weaker):
            return f"indistinguishable from {name}" if _near(weaker, base, bins=1.0) else ""
        if stronger.expected.kind in {"shaft", "cage"} or _is_comb(stronger):
            # where the speed was measured, the shaft's order is exact, and that of its line is not
            base = (base if stronger.expected.tolerance else stronger.expected.order) / stronger.expected.harmonic
            multiple = round(weaker.line.found / base) if base > 0 else 0  # a slow cage may be found at 0
            # Coupling and run-out produce any multiple in an envelope; but a gear's sidebands lie at multiples of its
            # own shaft's order, so that only the searched harmonics explain them.
            impacts = least is None or RIVAL_FACTOR * least >= weaker.line.amplitude
            highest = multiple if impacts and weaker.expected.kind != "tooth" else _EXPLAINED
            near = 0 < multiple <= highest and _near(weaker, multiple * base)
            return f"harmonic {multiple} of {name}" if near else ""
        harmonics = 1 if stronger.expected.kind == "tooth" else _EXPLAINED
        if stronger.expected.kind in BEARING_KINDS and stronger.expected.fundamental:
            harmonics = IMPACT_HARMONICS
        for harmonic in range(1, harmonics + 1):
            if _near(weaker, harmonic * base):
                return f"harmonic {harmonic} of {name}" if harmonic > 1 else f"coincides with {name}"
        return self._bearing_explanation(weaker, stronger, name) if stronger.expected.kind in BEARING_KINDS else ""

    def _bearing_explanation(self, weaker: MeasuredLine, stronger: MeasuredLine, name: str) -> str:
        """Return the cage rate or sideband of a bearing line at the order of `weaker`, or an empty string."""
        order, bearing = weaker.line.found, self.bearings[stronger.expected.component]
        base = stronger.line.found / stronger.expected.harmonic
        # bearings of the same orders make the same lines: what one of them explains, it explains of all
        same = replace(bearing, name="") == replace(self.bearings.get(weaker.expected.component, bearing), name="")
        element = stronger.expected.kind == "rolling_element"
        if same and weaker.expected.kind == "cage":
            why = "it carries" if element else "unequal elements modulate"
            return f"the cage's rate, at which {why} {name}" + (" through the load zone" if element else "")
        for harmonic in range(1, _EXPLAINED + 1):
            for spacing in {abs(bearing.inner_ring), abs(bearing.outer_ring), bearing.cage} - {0.0}:
                side = round((order - harmonic * base) / spacing)
                if 0 < abs(side) <= _EXPLAINED and _near(weaker, harmonic * base + side * spacing):
                    return f"sideband {side:+d} x {spacing:.3g} of harmonic {harmonic} of {name}"
        times = stronger.line.amplitude / weaker.line.amplitude
        if same and not is_support(weaker) and times > RIVAL_FACTOR:
            return f"hidden by {name}, {times:.0f} times as large"
        return ""


def single_probability(lines: Sequence[MeasuredLine], of_record: float) -> float:
    """Return the false-alarm probability of one line among these below which it is detected."""
    return -math.expm1(math.log1p(-of_record) / _searches(lines))


def _searches(lines: Iterable[MeasuredLine]) -> int:
    """Return the number of searches for lines that can raise a finding, over all bands."""
    return max(1, sum(line.searches for line in lines if line.expected.fundamental))


def _combined_levels(detected: Sequence[MeasuredLine]) -> Callable[[MeasuredLine], float]:
    """Return a function that computes the level of a line together with the lines that belong to it.

    The level is the root sum of squares of the ratios to the background. A bearing fundamental is combined with its
    harmonics and sidebands, which often exceed it; a shaft or tooth line of an envelope with its other harmonics.
    """

    def belongs_to(other: MeasuredLine, line: MeasuredLine) -> bool:
        if _is_comb(line):
            return _is_comb(other) and other.family == line.family and other.channel == line.channel
        return is_support(other) and supports(other, line)

    def level(line: MeasuredLine) -> float:
        if line.expected.spectrum != ENVELOPE or is_support(line):
            return line.line.snr
        others = [o for o in detected if o is not line and o.expected.spectrum == ENVELOPE and belongs_to(o, line)]
        return math.hypot(line.line.snr, *(other.line.snr for other in others))

    return level


def _ranks(
    lines: Sequence[MeasuredLine], detected: Sequence[int], least: Mapping[_Comb, float]
) -> dict[int, tuple[bool, bool, bool, float, float]]:
    """Return the keys by which the detected lines are assessed, the smallest first.

    Impacts of a tooth cause every multiple of their rate, and a bearing no fraction of its own, so teeth come first.
    Harmonics and sidebands of a bearing follow all lines that can be significant alone, and its cage all other defects
    unless it has a comb of impacts. Bearing lines that share a peak have the level of the highest, the nearest to
    nominal first.
    """
    level = _combined_levels([lines[i] for i in detected])
    levels = {i: level(lines[i]) for i in detected}
    bearings = [i for i in detected if lines[i].expected.kind in BEARING_KINDS and lines[i].expected.fundamental]
    ranks = {}
    for i in detected:
        line, off, most = lines[i], 0.0, levels[i]
        if i in bearings:
            off = abs(line.line.found / line.expected.order - 1)
            most = max(
                levels[j]
                for j in bearings
                if lines[j].channel == line.channel and _near(lines[j], line.line.found, bins=1.0)
            )
        smooth = line.expected.kind == "cage" and RIVAL_FACTOR * least.get(_comb(line), 0.0) < line.line.amplitude
        ranks[i] = (is_support(line), not _is_tooth_comb(line), smooth, -most, off)
    return ranks


def _comb(line: MeasuredLine) -> _Comb:
    return line.family, line.channel, line.expected.spectrum


def _least_of_combs(lines: Iterable[MeasuredLine]) -> dict[_Comb, float]:
    """Return the smallest amplitude of the searched harmonics of every shaft, tooth and cage in an envelope."""
    least: dict[_Comb, float] = {}
    for line in lines:
        if _is_comb(line) or (line.expected.kind == "cage" and not line.expected.sideband):
            least[_comb(line)] = min(line.line.amplitude, least.get(_comb(line), math.inf))
    return least


def _is_tooth_comb(line: MeasuredLine) -> bool:
    """Whether a line is an envelope harmonic of impacts once per contact of two teeth."""
    return line.expected.spectrum == ENVELOPE and line.expected.kind in TOOTH_KINDS


def _is_comb(line: MeasuredLine) -> bool:
    """Whether a line is an envelope harmonic of impacts once per shaft revolution or per contact of two teeth."""
    return line.expected.spectrum == ENVELOPE and line.expected.kind in {"shaft", *TOOTH_KINDS}


def _near(line: MeasuredLine, order: float, *, bins: float = LOBE_BINS) -> bool:
    return abs(line.line.found - order) <= bins * line.bin_width
