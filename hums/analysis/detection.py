"""Significance of measured lines, and attribution of each line to its strongest explanation.

A line is *detected* if the probability that noise alone exceeds it, at any line of the record that can raise a finding,
is below the false-alarm probability of the settings. A detected line is *significant* (column ``claimed``) unless
something else explains it:

- a line of a bearing, what explains that of its part in all bands (`hums.analysis.evidence`); its harmonics and
  sidebands are significant only together with it, at the right spacing;
- leakage: through the window, a larger line contributes half of its amplitude or more;
- a larger line, assessed before it, within the main lobe (two bins) of whose third harmonics it lies;
- a sideband, if the planet pass produces it in a healthy stage, or if it stands off the mesh that was found.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from hums.analysis.evidence import PartEvidence
from hums.analysis.expected_lines import LOBE_BINS, MeasuredLine, is_support, supports
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.spectra.lines import record_probability

LEAKAGE_SHARE = 0.5
_EXPLAINED = 3  # harmonics of a larger line


@dataclass(frozen=True, kw_only=True)
class AssessedLine:
    """A measured line with its significance, and what explains it otherwise."""

    measured: MeasuredLine
    false_alarm_probability: float
    significant: bool
    explained_by: str = ""


def assessed_lines(
    lines: Sequence[MeasuredLine],
    evidence: Iterable[PartEvidence],
    *,
    false_alarm_probability: float,
    healthy_spacings: Mapping[str, Sequence[float]],
) -> list[AssessedLine]:
    """Return whether each line of a record is significant, or what explains it, in the given order.

    Parameters
    ----------
    lines : sequence of MeasuredLine
    evidence : iterable of PartEvidence
        On bearings, in all channels.
    false_alarm_probability : float
        Probability that noise alone makes a line of a healthy record significant.
    healthy_spacings : mapping of str to sequence of float
        Sideband spacings of each gear of a healthy planetary stage, in orders.
    """
    parts = {(part.channel, part.component, part.kind): part for part in evidence}
    count = searches(lines)
    probability = [record_probability(line.line.false_alarm_probability, searches=count) for line in lines]
    result = [
        AssessedLine(measured=line, false_alarm_probability=p, significant=False)
        for line, p in zip(lines, probability, strict=True)
    ]
    detected = [i for i in range(len(lines)) if probability[i] < false_alarm_probability]
    significant: list[MeasuredLine] = []
    for i in sorted(detected, key=lambda i: (is_support(lines[i]), -lines[i].line.snr)):
        line = lines[i]
        if is_support(line):
            result[i] = replace(result[i], significant=any(supports(line, other) for other in significant))
            continue
        if line.expected.kind in BEARING_KINDS:
            part = parts.get((line.channel, *line.family))
            cause = "the flank of a peak outside the searched range" if line.line.at_edge else ""
            cause = cause or (part.hidden_by if part else "")
        else:
            same = [one for one in significant if one.expected.spectrum == line.expected.spectrum]
            cause = _healthy_cause(line, healthy_spacings) or next(
                filter(None, (_explanation(line, other) for other in same if other.channel == line.channel)), ""
            )
        result[i] = replace(result[i], significant=not cause, explained_by=cause)
        if not cause:
            significant.append(line)
    return result


def _healthy_cause(line: MeasuredLine, healthy_spacings: Mapping[str, Sequence[float]]) -> str:
    """Return the cause that produces this line without any defect, or an empty string."""
    if line.line.leakage > LEAKAGE_SHARE * line.line.amplitude:
        return "the flank of a stronger adjacent line, or of a mains line that the speed crosses"
    if line.expected.kind == "tooth":
        centre = line.expected.order - line.expected.sideband * line.expected.spacing
        for spacing in healthy_spacings.get(line.expected.component, ()):
            side = round((line.line.found - centre) / spacing)
            if side and _near(line, centre + side * spacing):
                return f"sideband {side:+d} x {spacing:.4g} of the mesh, which planets cause in a healthy stage"
    return ""


def _explanation(weaker: MeasuredLine, stronger: MeasuredLine) -> str:
    """Return how a stronger line of the same spectrum produces one at the order of a weaker, or an empty string."""
    if weaker.family == stronger.family:
        return ""
    kind, base = stronger.expected.kind, stronger.line.found
    name = f"{stronger.expected.component} {kind.replace('_', ' ')}"
    carried = weaker.expected.component.startswith(f"{stronger.expected.component}/")
    if carried and (kind, stronger.expected.harmonic) == ("gear_mesh", weaker.expected.harmonic):
        # the sidebands of a mesh follow from where it was found; a nominal speed leaves room for other lines
        place = weaker.expected.order * base / stronger.expected.order
        if not _near(weaker, place):
            return f"off the sidebands of {name}, the nearest of which is at {place:.4g}"
    if not weaker.expected.sideband:
        return f"indistinguishable from {name}" if _near(weaker, base, bins=1.0) else ""
    if kind == "shaft":  # where the speed was measured, its order is exact, and that of its line is not
        base = (base if stronger.expected.tolerance else stronger.expected.order) / stronger.expected.harmonic
    for harmonic in range(1, 1 + (1 if kind == "tooth" else _EXPLAINED)):
        if _near(weaker, harmonic * base):
            return f"harmonic {harmonic} of {name}" if harmonic > 1 else f"coincides with {name}"
    return ""


def single_probability(lines: Sequence[MeasuredLine], of_record: float) -> float:
    """Return the false-alarm probability of one line among these below which it is detected."""
    return -math.expm1(math.log1p(-of_record) / searches(lines))


def searches(lines: Iterable[MeasuredLine]) -> int:
    """Return the number of searches for lines that can raise a finding, over all bands."""
    return max(1, sum(line.searches for line in lines if line.expected.fundamental))


def _near(line: MeasuredLine, order: float, *, bins: float = LOBE_BINS) -> bool:
    return abs(line.line.found - order) <= bins * line.bin_width
