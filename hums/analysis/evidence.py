"""Evidence for bearing defects: modulation depth in every band, and competing explanations.

Every rolling element strikes a local defect of a race and excites resonances. In the envelope of a band that carries
the ringing, divided by its slowly varying level, this causes a line at the defect order, decaying harmonics, and
sidebands at the rotation rate of the link that carries the defect through the load zone. The *depth* of a line is its
amplitude over the mean of the envelope: dimensionless, independent of gain, and near one if the band contains nothing
but the impacts.

The strength of the evidence is the root sum of squares of the depths of the fundamental and its harmonics, each counted
at most as the fundamental, times ``snr^2 / (snr^2 + TRUSTED_SNR^2)``, which is small for noise in a short record. A
defect that rotates through the load zone is struck harder there: if sidebands are expected and none is found, the
strength is divided by four, and likewise if harmonics were searched for and none is found, since impacts are not
sinusoidal. The strength of a part is that in its best band.

A line does not count for a part if another source explains it: a multiple of another line of the band, a harmonic of
the mains, or a multiple of a shaft, alone or in a comb.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hums.analysis.detection import AssessedLine
from hums.analysis.expected_lines import MeasuredLine, supports
from hums.analysis.thresholds import (
    APART_BINS,
    EXACT_BINS,
    FASTEST_SPIN,
    FAULTY_DEPTH,
    FEWEST_CYCLES,
    HINT,
    IMPACT_HARMONICS,
    JUDGED_SNR,
    MAINS_ACCURACY,
    MAINS_HARMONICS,
    MAINS_HZ,
    MATCH_BINS,
    NO_SIDEBAND,
    RIVAL_FACTOR,
    SEEN,
    SHAFT_MULTIPLES,
    SLIP_SCATTER,
    STEADY_SPEED,
    TRUSTED_SNR,
)
from hums.gearbox.bearing_catalogue import BearingOrders
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.spectra.lines import record_probability

_ALIKE = 0.99  # of the largest, above which bandwidths, or strengths of one peak, are equal to rounding
_ONE_IN_10 = 1.282  # standard deviations by which a normal variable is below its mean in one of ten cases
_SIDEBANDS = 3  # on either side that support a fundamental
_LOAD_MULTIPLES = 4  # of a shaft, from modulation once and twice per revolution: the second of the second
_FULL_COMB = 0.7  # share of eight multiples of a slow shaft, from impacts; a defect with sidebands has fewer
_MULTIPLES = 3  # of another line that may coincide with the line of a part
_DRAWN = 0.02  # relative distance within which a line is one of the drawing
_OF_A_BEARING = (1.5, 20.0)  # cycles a turn of its rings of races and elements: 4 large rollers, 40 small ones
_MISDECLARED = 0.2  # relative: one element more or less moves the lines of a bearing of seven or more by less

Numbers = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Orders of shafts, and mean and range of speed in rev/s; `measured` if it is not merely declared."""

    shafts: tuple[float, ...]
    speed_hz: float
    speed_range_hz: float = 0.0
    measured: bool = True

    @property
    def steady(self) -> bool:
        """Whether lines at a fixed frequency are narrow in orders."""
        return self.speed_range_hz <= STEADY_SPEED * self.speed_hz


@dataclass(frozen=True, kw_only=True)
class BandEvidence:
    """Lines and peaks in the envelope of one band, with the depth and background of each peak.

    `line_probability` is the false-alarm probability below which a single line is significant.
    """

    band_hz: tuple[float, float]
    lines: Sequence[AssessedLine]
    orders: Numbers
    depths: Numbers
    backgrounds: Numbers
    bin_width: float
    line_probability: float = 1.0

    @cached_property
    def families(self) -> Mapping[tuple[str, str], Sequence[AssessedLine]]:
        """Fundamentals and harmonics by component and kind, in their order."""
        found: dict[tuple[str, str], list[AssessedLine]] = {}
        for line in self.lines:
            if not line.measured.expected.sideband:
                found.setdefault(line.measured.family, []).append(line)
        return found


@dataclass(frozen=True, kw_only=True)
class PartEvidence:
    """The evidence for one kind of defect of one bearing in one channel.

    Attributes
    ----------
    component, kind, channel, units : str
    order : float
        Nominal order of the fundamental.
    found, amplitude, snr, depth, bin_width : float
        The fundamental in its best band, or, if the strength is 0, in that with the lowest background. `snr` is the
        ratio to its background, `depth` that to the mean of the envelope.
    band_low_hz, band_high_hz : float
    strength : float
        See the module; 0 where no line is significant.
    support : str
        Significant harmonics and sidebands.
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
    unsure_depth : float
        Deepest line in any band at its order that does not count, because noise causes it too often or something else
        explains it (in which case, if the strength is 0, `hidden_by` says what).
    other_order, other_depth, other_strength : float
        Strongest line in the best band, no slower than the slowest part, that this part does not explain, and its
        strength on its own; 0 if there is none. What causes the line of this part shows its own line beside it.
    undrawn : str
        Deep line that the drawing does not explain and its bearing might make, and what to check; empty without one.
    sibling_depths : tuple of float
        Depths, in the best band, of the significant lines of the parts of the bearing, in the order of
        `BEARING_KINDS`, 0 if there is none; empty if the strength is 0.
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
    strength: float = 0.0
    support: str = ""
    sidebands: int = 0
    carried: int = 0
    hidden_by: str = ""
    possible_depth: float = math.inf
    inspected_hz: tuple[float, float] = (0.0, math.inf)
    unsure_depth: float = 0.0
    other_order: float = 0.0
    other_depth: float = 0.0
    other_strength: float = 0.0
    undrawn: str = ""
    sibling_depths: tuple[float, ...] = ()
    modulation: float = 0.0


def strength(depths: Sequence[float], snr: float) -> float:
    """Return the strength of a family of lines from the depths of fundamental and harmonics and their joint SNR.

    Parameters
    ----------
    depths : sequence of float
        The fundamental first.
    snr : float
        Root sum of squares of the ratios to the background.

    Examples
    --------
    >>> from hums.analysis.evidence import strength
    >>> round(strength([0.3, 0.9], 800.0), 4)  # the harmonic counts as the fundamental
    0.4242
    >>> round(strength([0.3], 8.0), 4)
    0.15
    """
    if not depths:
        return 0.0
    comb = math.hypot(*(min(depth, depths[0]) for depth in depths))
    return comb * snr**2 / (snr**2 + TRUSTED_SNR**2)


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
    families: dict[tuple[str, str], list[tuple[BandEvidence, AssessedLine]]] = {}
    for band in bands:
        for line in band.lines:
            expected = line.measured.expected
            if expected.fundamental and expected.order >= FEWEST_CYCLES * band.bin_width:
                families.setdefault(line.measured.family, []).append((band, line))
    parts = [_part(seen, bearings[component], setting) for (component, _), seen in families.items()]
    parts = [
        replace(part, sibling_depths=_sibling_depths(part, families)) if part.strength > 0 else part for part in parts
    ]
    parts = [replace(part, hidden_by=part.hidden_by or _carried(part, parts, bearings)) for part in parts]
    strange = _strange_lines(bands, parts, setting)
    undrawn = {component: _undrawn(bearings[component], strange, setting) for component, _ in families}
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
        orders, width = band.orders, MATCH_BINS * band.bin_width
        strange = (band.depths >= FAULTY_DEPTH) & (orders >= slowest)
        strange &= ~_of_shafts(orders, EXACT_BINS * band.bin_width if setting.measured else width, setting)
        strange &= (np.abs(orders[:, None] - drawn) > np.maximum(width, _DRAWN * drawn)).all(axis=1)
        for _, multiple in mains_multiples(orders, setting, 0.5 * width * setting.speed_hz):
            strange &= multiple == 0
        spacings = [shaft for shaft in setting.shafts if shaft > 2 * width]
        scatter = np.maximum(width, SLIP_SCATTER * orders)
        for part in (one for one in parts if one.strength > 0):
            strange &= ~(_own(orders, part.found, (), scatter) & (band.depths <= 2 * part.depth))
            strange &= ~(_own(orders, part.found, spacings, scatter) & (band.depths <= part.depth))
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


def _sibling_depths(
    part: PartEvidence, families: Mapping[tuple[str, str], Sequence[tuple[BandEvidence, AssessedLine]]]
) -> tuple[float, ...]:
    """Return the depths of the lines of a bearing's parts in the best band of one of them."""
    band_hz = (part.band_low_hz, part.band_high_hz)
    depths = dict.fromkeys(BEARING_KINDS, 0.0)
    for kind in BEARING_KINDS:
        for band, line in families.get((part.component, kind), ()):
            if band.band_hz == band_hz and line.significant:
                depths[kind] = line.measured.depth
    return tuple(depths.values())


def _carried(part: PartEvidence, parts: Iterable[PartEvidence], bearings: Mapping[str, BearingOrders]) -> str:
    """Return the damaged element of another bearing whose cage causes a line, or an empty string.

    A cage carries a damaged element through the load zone and, if sidebands confirm that, causes lines at multiples of
    its rate; the line of a cage may be deeper than that of the element, since the load zone interrupts the impacts.
    """
    near = MATCH_BINS * part.bin_width
    for other in parts:
        least = 0.0 if part.kind == "cage" else part.strength
        carries = other.kind == "rolling_element" and other.sidebands and not other.hidden_by
        if not carries or other.component == part.component or part.strength == 0 or other.strength <= least:
            continue
        cage = bearings[other.component].cage
        turns = round(part.found / cage) if cage > 2 * near else 0  # slower, and any line is near a multiple
        if 0 < turns <= _SIDEBANDS and abs(part.found - turns * cage) <= near:
            return f"it is {turns} times the rate at which a cage carries {other.component} rolling element"
    return ""


def _of_shafts(orders: Numbers, width: float, setting: Setting) -> NDArray[np.bool_]:
    """Return which orders are multiples of that of a shaft."""
    on = np.zeros(orders.size, dtype=bool)
    for shaft in setting.shafts:
        if shaft > 2 * width:
            on |= np.abs(orders - shaft * np.round(orders / shaft)) <= width
    return on


def _part(seen: Sequence[tuple[BandEvidence, AssessedLine]], bearing: BearingOrders, setting: Setting) -> PartEvidence:
    """Return the evidence for one part from its fundamental in every band."""
    spacings = load_spacings(bearing, seen[0][1].measured.expected.kind)
    rated = [(_strength_in(band, line, spacings), number) for number, (band, line) in enumerate(seen)]
    least = min(range(len(seen)), key=lambda number: _background_depth(seen[number][1].measured))
    best, number = max(rated)
    if best == 0:
        number = least
    band, line = seen[number]
    main = line.measured
    widths = [band.band_hz[1] - band.band_hz[0] for band, _ in seen]
    whole = [one for one, width in zip(seen, widths, strict=True) if width > _ALIKE * max(widths)]
    unsure = max((one for _, one in seen if _unsure(one)), key=lambda one: one.measured.depth, default=None)
    plain = PartEvidence(
        component=main.expected.component,
        kind=main.expected.kind,
        channel=main.channel,
        units=main.units,
        carried=int(bool(spacings)),
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
        unsure_depth=0.0 if unsure is None else unsure.measured.depth,
        hidden_by="" if unsure is None else unsure.explained_by,
        modulation=max(_family_strength([one.measured for one in _family(band, line)]) for band, line in seen),
    )
    if best == 0:
        return plain
    harmonics, sidebands = _support(main, band, spacings)
    width = MATCH_BINS * band.bin_width
    known = _own(band.orders, main.line.found, spacings, width) | _of_shafts(band.orders, width, setting)
    own = 2 if main.expected.kind == "rolling_element" else 1  # two races, struck unequally
    alone = band.depths**3 / (band.depths**2 + (TRUSTED_SNR * band.backgrounds) ** 2)
    # what is slower than every part is a change of level
    slowest = min(one.measured.expected.order for one in band.lines if one.measured.expected.fundamental)
    rest = np.flatnonzero(~known & (band.orders >= (1 - _MISDECLARED) * slowest))
    strongest = rest[np.argmax(alone[rest])] if rest.size else None
    return replace(
        plain,
        strength=best,
        support=", ".join([*harmonics, *sidebands]),
        sidebands=len(sidebands),
        hidden_by=_faster_than_it_rolls(main)
        or _comb_of_a_shaft(main.line.found, main.depth, band, setting)
        or _mains(main.line.found, band.bin_width, setting)
        or _harmonic(main.line.found, main.depth, band, setting, own),
        other_order=0.0 if strongest is None else float(band.orders[strongest]),
        other_depth=0.0 if strongest is None else float(band.depths[strongest]),
        other_strength=0.0 if strongest is None else float(alone[strongest]),
    )


def _detectable_depth(band: BandEvidence, line: AssessedLine) -> float:
    """Return the least modulation that would be significant in a band and exceed its background `JUDGED_SNR` times."""
    measured = line.measured
    needed = max(JUDGED_SNR * measured.line.background, measured.line.amplitude_at(band.line_probability))
    return needed / measured.level if measured.level > 0 else math.inf


def _possible_depth(
    seen: Sequence[tuple[BandEvidence, AssessedLine]], whole: Sequence[tuple[BandEvidence, AssessedLine]]
) -> float:
    """Return the largest modulation that may have gone undetected in the widest bands, `whole`, of all bands `seen`.

    That a line is small there counts only if no band has one at its order that noise alone rarely causes.
    """
    unexplained = (one.measured.line for _, one in seen if _unsure(one) and not one.explained_by)
    chance = min((line.false_alarm_probability for line in unexplained), default=1.0)
    hint = record_probability(chance, searches=len(seen)) < HINT
    return max(
        _detectable_depth(*one) if hint else min(_detectable_depth(*one), _largest_depth(one[1])) for one in whole
    )


def _largest_depth(one: AssessedLine) -> float:
    """Return the depth at which a line would be measured as this small in at most one record in ten.

    Its magnitude is at least its in-phase component, whose noise is normal.
    """
    line = one.measured
    return (line.line.amplitude + _ONE_IN_10 * line.line.amplitude_std) / line.level if line.level > 0 else math.inf


def _unsure(line: AssessedLine) -> bool:
    """Whether a line does not count because of noise or another explanation."""
    return not (line.significant or line.measured.line.at_edge)


def _strength_in(band: BandEvidence, line: AssessedLine, spacings: Sequence[float]) -> float:
    if not line.significant:
        return 0.0
    width = MATCH_BINS * band.bin_width
    separable = [spacing for spacing in spacings if spacing > 2 * width]
    sidebands = _sidebands(line.measured, band, separable)
    family = [one.measured for one in _family(band, line)]
    family = [one for one in family if one is line.measured or one.line.false_alarm_probability < SEEN]
    searched = any(one.measured.expected.harmonic > 1 for one in band.families[line.measured.family])
    alone = len(family) == 1 and not sidebands and searched
    whole = _family_strength(family)
    return NO_SIDEBAND * whole if alone or (separable and not sidebands) else whole


def _family(band: BandEvidence, line: AssessedLine) -> list[AssessedLine]:
    """Return a fundamental and its harmonics in a band."""
    harmonics = (other for other in band.families[line.measured.family] if other is not line)
    return [line, *(other for other in harmonics if supports(other.measured, line.measured))]


def _family_strength(family: Sequence[MeasuredLine]) -> float:
    return strength([one.depth for one in family], math.hypot(*(one.line.snr for one in family)))


def _background_depth(line: MeasuredLine) -> float:
    return line.line.background / line.level if line.level > 0 else math.inf


def load_spacings(bearing: BearingOrders, kind: str) -> tuple[float, ...]:
    """Return the spacings of the sidebands that passing the load zone causes."""
    turning = {
        "inner_race": bearing.inner_ring,
        "outer_race": bearing.outer_ring,
        "rolling_element": bearing.cage,
    }.get(kind, 0.0)
    return tuple(dict.fromkeys(abs(spacing) for spacing in (turning, bearing.carried) if spacing))


def _support(
    main: MeasuredLine, band: BandEvidence, spacings: Iterable[float]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the significant harmonics and sidebands in a band."""
    harmonics = [
        f"harmonic {other.measured.expected.harmonic} at {other.measured.line.found:.3f}"
        for other in band.families[main.family]
        if other.measured.expected.harmonic > 1
        and supports(other.measured, main)
        and other.measured.line.false_alarm_probability <= SEEN
        and not other.explained_by
    ]
    return tuple(harmonics), tuple(_sidebands(main, band, spacings))


def _sidebands(main: MeasuredLine, band: BandEvidence, spacings: Iterable[float]) -> list[str]:
    """Return the names of the sidebands of a fundamental among the peaks of its band."""
    width, sidebands = MATCH_BINS * band.bin_width, []
    for spacing in spacings:
        if spacing <= 2 * width:
            continue
        for side in (*range(-_SIDEBANDS, 0), *range(1, _SIDEBANDS + 1)):
            order = main.line.found + side * spacing
            near = np.abs(band.orders - order) <= width
            if order > 0 and near.any():
                sidebands.append(f"sideband {side:+d} at {float(band.orders[near][0]):.3f}")
    return sidebands


def _own(orders: Numbers, fundamental: float, spacings: Sequence[float], width: float | Numbers) -> NDArray[np.bool_]:
    """Return which orders are harmonics of a fundamental, sidebands of them, or multiples of their spacing."""
    offsets = [0.0, *(side * s for s in spacings for side in range(-_SIDEBANDS, _SIDEBANDS + 1) if side)]
    own = np.zeros(orders.size, dtype=bool)
    own |= _of_spacings(orders, spacings, width)
    for offset in offsets:
        multiple = np.maximum(1, np.round((orders - offset) / fundamental))
        own |= np.abs(orders - offset - multiple * fundamental) <= width * np.sqrt(multiple)
    return own


def _of_spacings(orders: Numbers, spacings: Iterable[float], width: float | Numbers) -> NDArray[np.bool_]:
    """Return which orders are multiples of a spacing: what carries a defect also modulates the envelope directly."""
    on = np.zeros(orders.size, dtype=bool)
    for spacing in spacings:
        multiple = np.maximum(1, np.round(orders / spacing))
        on |= (multiple <= _SIDEBANDS) & (np.abs(orders - multiple * spacing) <= width)
    return on


def _faster_than_it_rolls(line: MeasuredLine) -> str:
    """Return how far the line of a rolling element is above its order, or an empty string if it may be."""
    excess = line.line.found / line.expected.order - 1
    if line.expected.kind != "rolling_element" or excess <= FASTEST_SPIN:
        return ""
    return f"it is {excess:.1%} above the order of the rolling element, and no element spins that fast"


def _comb_of_a_shaft(order: float, depth: float, band: BandEvidence, setting: Setting) -> str:
    """Return of which shaft a line is a multiple, exactly or as one of a comb, or an empty string.

    Harmonics of the line itself do not count as other multiples.
    """
    width = band.bin_width

    def stands(place: float) -> bool:
        near = np.abs(band.orders - place) <= width
        return bool(band.depths[near].max(initial=0.0) * RIVAL_FACTOR > depth)

    for shaft in setting.shafts:
        multiple = round(order / shaft)
        off = abs(order - multiple * shaft)
        if shaft <= 2 * MATCH_BINS * width or multiple < 1 or off > width:
            continue
        name = f"{multiple} times the order {shaft:.4g} of a shaft"
        slow = shaft <= APART_BINS * width
        if slow or _LOAD_MULTIPLES < multiple <= SHAFT_MULTIPLES:
            # near a multiple of a slow shaft any line is, and the shaft that a race turns with spaces its sidebands:
            # only a comb that stands far away from it says more
            far = [k for k in range(3, 11) if abs(k - multiple) > _SIDEBANDS and k % multiple]
            if sum(stands(k * shaft) for k in far) >= _FULL_COMB * len(far):
                return f"it is {name}, most of whose multiples stand out"
        exact = multiple == 1 or (off <= EXACT_BINS * width and setting.measured)
        if exact and not slow:
            return f"it coincides with {name}"
    return ""


def mains_multiples(orders: Numbers, setting: Setting, reach_hz: float) -> list[tuple[float, Numbers]]:
    """Return for each mains frequency the harmonic number of each order, 0 if it is none.

    Lines of the mains are narrow in orders only at steady speed; otherwise all are 0. `reach_hz` is the uncertainty of
    the frequency of a line, in addition to the tolerance of the mains.
    """
    found = []
    for mains in MAINS_HZ:
        frequency = orders * setting.speed_hz
        multiple = np.round(frequency / mains)
        near = np.abs(frequency - multiple * mains) <= MAINS_ACCURACY * multiple * mains + reach_hz
        on = near & (multiple >= 1) & (multiple <= MAINS_HARMONICS) & setting.steady
        found.append((mains, np.where(on, multiple, 0.0)))
    return found


def _mains(order: float, bin_width: float, setting: Setting) -> str:
    """Return of which harmonic of the mains a line is; empty if of none, or if lines are too wide to decide."""
    bin_hz = bin_width * setting.speed_hz
    for mains, (multiple,) in mains_multiples(np.array([order]), setting, 0.5 * MATCH_BINS * bin_hz):
        if multiple and mains > APART_BINS * bin_hz:
            return f"{order * setting.speed_hz:.2f} Hz is {multiple:.0f} times mains of {mains:g} Hz"
    return ""


def _harmonic(order: float, depth: float, band: BandEvidence, setting: Setting, own: int = 1) -> str:
    """Return of which line of a band a line is a harmonic, or an empty string; the harmonic `own` may be its own.

    Impacts make harmonics that are at most twice as deep as their fundamental, and no deeper above the third.
    """
    width = MATCH_BINS * band.bin_width
    multiples = np.round(order / band.orders)
    near = np.abs(order - multiples * band.orders) <= max(width, SLIP_SCATTER * order)  # which slip widens
    deep = band.depths >= np.where(multiples > _MULTIPLES, depth, depth / 2)
    many = (multiples > 1) & (multiples <= IMPACT_HARMONICS) & (multiples != own)
    carriers = np.flatnonzero(near & deep & many & ~_of_shafts(band.orders, width, setting))
    if not carriers.size:
        return ""
    of = carriers[np.argmax(band.depths[carriers])]
    return f"it is {multiples[of]:.0f} times the line at {band.orders[of]:.3f}, which it does not explain"
