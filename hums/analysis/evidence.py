"""Evidence for bearing defects over all bands of a channel.

Every rolling element strikes a local defect of a race and excites resonances. In the envelope of a band that carries
the ringing, divided by its slowly varying level, this causes a line at the defect order, decaying harmonics, and
sidebands at the rotation rate of the link that carries the defect through the load zone. The *depth* of a line is its
amplitude over the mean of the envelope: dimensionless, independent of gain, and near one if the band contains nothing
but the impacts.

The *strength* of a line is the root sum of squares of the depths of the fundamental and its second and third harmonic,
each counted at most as the fundamental, times ``snr^2 / (snr^2 + TRUSTED_SNR^2)``, which is small for noise in a short
record. Whose line it is says the *score* (`hums.analysis.combs`). The score of a part is that of its best band, its
line that of the strongest in which its score is above 0.

A line is *detected* if the probability that noise alone exceeds it, at any line of the record that can raise a finding,
is below the false-alarm probability of the settings. A detected line is *significant* (column ``claimed``) unless
something else explains it:

- a line of a bearing, what explains that of its part in all bands; its harmonics and sidebands are significant only
  together with it, at the right spacing;
- leakage: through the window, a larger line contributes half of its amplitude or more;
- a larger line, assessed before it, within the main lobe (two bins) of whose third harmonics it lies;
- a sideband, if the planet pass produces it in a healthy stage, or if it stands off the mesh that was found.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hums.analysis.combs import Claim, Key, Part, Peaks, Setting, claims, mains_multiples, strength
from hums.analysis.expected_lines import LOBE_BINS, MeasuredLine, is_support, supports
from hums.analysis.thresholds import (
    EXACT_BINS,
    FASTEST_SPIN,
    FAULTY_DEPTH,
    FEWEST_CYCLES,
    HINT,
    JUDGED_SNR,
    LEAST_SCORE,
    LEAST_STRENGTH,
    SLIP_SCATTER,
)
from hums.gearbox.bearing_catalogue import BearingOrders
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.spectra.lines import record_probability

LEAKAGE_SHARE = 0.5
_EXPLAINED = 3  # harmonics of a larger line
_ALIKE = 0.99  # of the largest, above which bandwidths are equal to rounding
_ONE_IN_10 = 1.282  # standard deviations by which a normal variable is below its mean in one of ten cases
_DRAWN = 0.02  # relative distance within which a line is one of the drawing
_OF_A_BEARING = (1.5, 20.0)  # cycles a turn of its rings of races and elements: 4 large rollers, 40 small ones
_MISDECLARED = 0.2  # relative: one element more or less moves the lines of a bearing of seven or more by less


@dataclass(frozen=True, kw_only=True)
class BandEvidence(Peaks):
    """Peaks of the envelope of one band, and the lines of bearings measured in it.

    `line_probability` is the false-alarm probability below which a single line is significant.
    """

    band_hz: tuple[float, float]
    lines: Sequence[MeasuredLine]
    line_probability: float = 1.0


@dataclass(frozen=True, kw_only=True)
class PartEvidence:
    """The evidence for one kind of defect of one bearing in one channel.

    Attributes
    ----------
    component, kind, channel, units : str
    order : float
        Nominal order of the fundamental.
    found, amplitude, snr, depth, bin_width : float
        The fundamental in its best band, or, if no band has a line at its order, in that with the lowest background.
        `snr` is the ratio to its background, `depth` that to the mean of the envelope.
    band_low_hz, band_high_hz : float
    score : float
        How much better its comb explains the peaks than any other source; -inf if no band has a line at its order.
    strength : float
        See the module; 0 where there is no line.
    support : str
        Harmonics and sidebands that stand out in that band.
    sidebands : int
        Number of sidebands among them.
    carried : int
        1 if the load zone modulates its line: of a race that turns, and of a rolling element.
    hidden_by : str
        What else explains its line; empty if nothing does.
    possible_depth : float
        Largest modulation that may have gone undetected in one of the widest bands, since damage may ring in any part
        of the range: that of a line which is significant and `JUDGED_SNR` times the background, or less if the line
        measured there is so small that a deeper one would have been larger in nine of ten records.
    inspected_hz : (float, float)
        Range of these bands; damage that rings outside it is not excluded.
    largest_strength : float
        Strength of the strongest line in any band at its order, whatever explains it.
    undrawn : str
        Deep line that the drawing does not explain and its bearing might make, and what to check; empty without one.
    sibling_depths : tuple of float
        Depths, in the best band, of the lines of the parts of the bearing that score above 0, in the order of
        `BEARING_KINDS`, 0 if there is none; empty if there is no line.
    modulation : float
        Strength of its lines in the band where that is largest, significant or not and whatever else explains them, for
        comparison between successive records.
    """

    component: str
    kind: str
    channel: str
    units: str
    order: float
    found: float
    amplitude: float
    snr: float
    depth: float
    bin_width: float
    band_low_hz: float
    band_high_hz: float
    score: float = -math.inf
    strength: float = 0.0
    support: str = ""
    sidebands: int = 0
    carried: int = 0
    hidden_by: str = ""
    possible_depth: float = math.inf
    inspected_hz: tuple[float, float] = (0.0, math.inf)
    largest_strength: float = 0.0
    undrawn: str = ""
    sibling_depths: tuple[float, ...] = ()
    modulation: float = 0.0

    @property
    def shows(self) -> bool:
        """Whether its comb explains the peaks better than accident or any other source."""
        return self.score > 0 and not self.hidden_by


def bearing_evidence(
    bands: Sequence[BandEvidence], bearings: Mapping[str, BearingOrders], setting: Setting
) -> tuple[list[PartEvidence], str]:
    """Return the evidence for every kind of defect of every bearing whose fundamental was measured in a band.

    The second value describes the deepest line that the drawing does not explain; it is empty if there is none.

    Parameters
    ----------
    bands : sequence of BandEvidence
        All bands of one channel.
    bearings : mapping of str to BearingOrders
    setting : Setting
    """
    seen: dict[Key, list[tuple[BandEvidence, MeasuredLine]]] = {}
    for band in bands:
        for line in band.lines:
            if line.expected.fundamental and line.expected.order >= FEWEST_CYCLES * band.bin_width:
                seen.setdefault(line.family, []).append((band, line))
    drawn = {key: _drawn(own[0][1], bearings[key[0]]) for key, own in seen.items()}
    claimed = [claims(band, {key: drawn[key] for key in drawn if _measured(band, key)}, setting) for band in bands]
    parts = [_part(own, list(zip(bands, claimed, strict=True)), drawn[key]) for key, own in seen.items()]
    strange = _strange_lines(bands, parts, setting)
    undrawn = {component: _undrawn(bearings[component], strange, setting) for component, _ in seen}
    return [replace(part, undrawn=undrawn[part.component]) for part in parts], _unknown(strange)


def _unknown(strange: Sequence[tuple[float, float]]) -> str:
    """Return what the deepest of some lines that the drawing does not explain may be; empty if there is none."""
    if not strange:
        return ""
    depth, order = strange[0]
    return (
        f"the envelope line at {order:.3f} orders, which modulates a band by {depth:.0%}, belongs to no component: the "
        "data of a bearing may be wrong (elements, diameters, contact angle), a bearing may be missing from the "
        "drawing, or another machine strikes"
    )


def _strange_lines(
    bands: Sequence[BandEvidence], parts: Sequence[PartEvidence], setting: Setting
) -> list[tuple[float, float]]:
    """Return depth and order of deep lines with a harmonic that neither drawing nor mains explain, the deepest first.

    A part with a line explains the harmonics of it that are at most twice as deep, and sidebands that are no deeper.
    """
    slowest = min((part.order for part in parts), default=0.0) * (1 - _MISDECLARED)
    drawn = np.array([part.order for part in parts])
    found: list[tuple[float, float]] = []
    for band in bands:
        orders, width = band.orders, band.width
        strange = (band.depths >= FAULTY_DEPTH) & (orders >= slowest)
        for shaft in setting.shafts:
            exact = EXACT_BINS * band.bin_width if setting.measured else width
            strange &= (shaft <= 2 * exact) | (np.abs(orders - shaft * np.round(orders / shaft)) > exact)
        strange &= (np.abs(orders[:, None] - drawn) > np.maximum(width, _DRAWN * drawn)).all(axis=1)
        for _, multiple in mains_multiples(orders, setting, 0.5 * width * setting.speed_hz):
            strange &= multiple == 0
        spacings = band.separable(setting.shafts)
        scatter = np.maximum(width, SLIP_SCATTER * orders)
        for part in (one for one in parts if one.shows and one.score >= LEAST_SCORE):
            strange &= ~(band.explained(part.found, (), scatter, math.inf) & (band.depths <= 2 * part.depth))
            strange &= ~(band.explained(part.found, spacings, scatter, math.inf) & (band.depths <= part.depth))
        for order, depth in zip(orders[strange].tolist(), band.depths[strange].tolist(), strict=True):
            if (np.abs(orders - 2 * order) <= width).any():
                found.append((depth, order))
    return sorted(found, reverse=True)


def _undrawn(bearing: BearingOrders, strange: Sequence[tuple[float, float]], setting: Setting) -> str:
    """Return which line that the drawing does not explain a bearing might make, and what to check; empty if none.

    It may sit on another shaft, where its own orders fit the line; or its data may be wrong.
    """
    elsewhere = [
        (abs(getattr(bearing, kind) * shaft / bearing.relative), kind, shaft)
        for kind, shaft in itertools.product(("inner_race", "outer_race", "rolling_element"), setting.shafts)
        if not math.isclose(shaft, abs(bearing.relative), rel_tol=_DRAWN)
    ]
    for depth, order in strange:
        for expected, kind, shaft in elsewhere:
            if abs(order / expected - 1) <= _DRAWN:
                of = f"the envelope line at {order:.3f} orders, which modulates a band by {depth:.0%}, would be that of"
                return f"{of} {kind.replace('_', ' ')} on the shaft of order {shaft:.4g}; check on which shaft it sits"
    low, high = (abs(bearing.relative) * turns for turns in _OF_A_BEARING)
    return _unknown([one for one in strange if low <= one[1] <= high])


def _drawn(line: MeasuredLine, bearing: BearingOrders) -> Part:
    """Return what the drawing says of the part that a fundamental is searched for."""
    expected = line.expected
    return Part(
        order=expected.order,
        tolerance=expected.tolerance,
        spacings=load_spacings(bearing, expected.kind),
        traces=(bearing.cage,),
        fastest=FASTEST_SPIN if expected.kind == "rolling_element" else math.inf,
    )


def _measured(band: BandEvidence, key: Key) -> bool:
    return any(line.family == key and line.expected.fundamental for line in band.lines)


def load_spacings(bearing: BearingOrders, kind: str) -> tuple[float, ...]:
    """Return the spacings of the sidebands that passing the load zone causes."""
    turning = {
        "inner_race": bearing.inner_ring,
        "outer_race": bearing.outer_ring,
        "rolling_element": bearing.cage,
    }.get(kind, 0.0)
    return tuple(dict.fromkeys(abs(spacing) for spacing in (turning, bearing.carried) if spacing))


def _part(
    seen: Sequence[tuple[BandEvidence, MeasuredLine]],
    claimed: Sequence[tuple[BandEvidence, Mapping[Key, Claim]]],
    drawn: Part,
) -> PartEvidence:
    """Return the evidence for one part from its fundamental in every band, and what all parts claim there."""
    band, main = min(seen, key=lambda one: _background_depth(one[1]))
    key = main.family
    widths = [one.band_hz[1] - one.band_hz[0] for one, _ in seen]
    whole = [one for one, width in zip(seen, widths, strict=True) if width > _ALIKE * max(widths)]
    plain = PartEvidence(
        component=key[0],
        kind=key[1],
        channel=main.channel,
        units=main.units,
        carried=int(bool(drawn.spacings)),
        order=main.expected.order,
        found=main.line.found,
        amplitude=main.line.amplitude,
        snr=main.line.snr,
        depth=main.depth,
        bin_width=main.bin_width,
        band_low_hz=band.band_hz[0],
        band_high_hz=band.band_hz[1],
        possible_depth=_possible_depth(seen, whole),
        inspected_hz=(min(one.band_hz[0] for one, _ in whole), max(one.band_hz[1] for one, _ in whole)),
        modulation=max(_family_strength(line, one.lines) for one, line in seen),
    )
    own = [(one, found[key], found) for one, found in claimed if key in found and found[key].strength >= LEAST_STRENGTH]
    if not own:
        return plain
    score = max((claim.score for _, claim, _ in own if not claim.explained_by), default=-math.inf)
    winning = [one for one in own if one[1].shows]
    band, best, others = max(winning or own, key=lambda one: one[1].strength)
    level = next(line.level for one, line in seen if one is band)
    harmonics, sidebands = band.support(best, drawn.spacings)
    beside = (others.get((key[0], kind)) for kind in BEARING_KINDS)
    return replace(
        plain,
        found=best.found,
        amplitude=best.depth * level,
        snr=best.snr,
        depth=best.depth,
        bin_width=band.bin_width,
        band_low_hz=band.band_hz[0],
        band_high_hz=band.band_hz[1],
        score=score,
        strength=best.strength,
        support=", ".join([*harmonics, *sidebands]),
        sidebands=len(sidebands),
        hidden_by=best.explained_by,
        largest_strength=max(claim.strength for _, claim, _ in own),
        sibling_depths=tuple(one.depth if one is not None and one.shows else 0.0 for one in beside),
    )


def _detectable_depth(band: BandEvidence, line: MeasuredLine) -> float:
    """Return the least modulation that would be significant in a band and exceed its background `JUDGED_SNR` times."""
    needed = max(JUDGED_SNR * line.line.background, line.line.amplitude_at(band.line_probability))
    return needed / line.level if line.level > 0 else math.inf


def _possible_depth(
    seen: Sequence[tuple[BandEvidence, MeasuredLine]], whole: Sequence[tuple[BandEvidence, MeasuredLine]]
) -> float:
    """Return the largest modulation that may have gone undetected in the widest bands, `whole`, of all bands `seen`.

    That a line is small there counts only if no band has one at its order that noise alone rarely causes.
    """
    chance = min((line.line.false_alarm_probability for _, line in seen if not line.line.at_edge), default=1.0)
    hint = record_probability(chance, searches=len(seen)) < HINT
    return max(
        _detectable_depth(*one) if hint else min(_detectable_depth(*one), _largest_depth(one[1])) for one in whole
    )


def _largest_depth(line: MeasuredLine) -> float:
    """Return the depth at which a line would be measured as this small in at most one record in ten.

    Its magnitude is at least its in-phase component, whose noise is normal.
    """
    return (line.line.amplitude + _ONE_IN_10 * line.line.amplitude_std) / line.level if line.level > 0 else math.inf


def _family_strength(main: MeasuredLine, lines: Iterable[MeasuredLine]) -> float:
    """Return the strength of a fundamental with the harmonics measured at its multiples."""
    family = [main, *(line for line in lines if line is not main and supports(line, main))]
    return strength([one.depth for one in family], math.hypot(*(one.line.snr for one in family)))


def _background_depth(line: MeasuredLine) -> float:
    return line.line.background / line.level if line.level > 0 else math.inf


# ---- Significance of measured lines ----------------------------------------------------------------------------------


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
    count = _searches(lines)
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
            if part and not part.shows:
                cause = cause or part.hidden_by or "an accident as likely, as its harmonics and sidebands show"
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
    return -math.expm1(math.log1p(-of_record) / _searches(lines))


def _searches(lines: Iterable[MeasuredLine]) -> int:
    """Return the number of searches for lines that can raise a finding, over all bands."""
    return max(1, sum(line.searches for line in lines if line.expected.fundamental))


def _near(line: MeasuredLine, order: float, *, bins: float = LOBE_BINS) -> bool:
    return abs(line.line.found - order) <= bins * line.bin_width
