"""Combs: how much better than any other source a damaged part explains the peaks of an envelope.

Every source of lines in an envelope is a *comb*: a set of teeth, orders at which it shows peaks. A damaged bearing part
has harmonics of its order, with sidebands at the rate that carries it through the load zone; a shaft, the mains or an
unknown machine has multiples of its own. The evidence of a comb is the logarithm of a ratio of likelihoods,

    E = sum over teeth with a peak of log(q / p) + sum over the others of log((1 - q) / (1 - p))                     (1)

with q the share of such sources that show the tooth, and p the probability that a peak as deep stands within its width
by accident, from the density of those peaks around it that the comb does not explain. Peaks count from a quarter of the
depth of the line in question on.

The score of a part is the evidence of its own comb, less that of the best other comb that explains its line, plus the
logarithm of how likely a bearing slips as far (Laplace, of half a per cent), plus twice the logarithm of its
modulation: damage modulates deeper than what is imperfect on a sound bearing,

    S = E_part - max(0, E_rival) - |found / order - 1| / 0.5 % + 2 log(strength / 1 %).                            (2)

The strength counts as 1 % where it is less. A rival is a shaft, the mains, another part, or a fundamental that the
drawing does not know, alone or modulated by a shaft; that one costs the logarithm of the number of orders at which it
might stand.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hums.analysis.thresholds import (
    EXACT_BINS,
    IMPACT_HARMONICS,
    LEAST_STRENGTH,
    MAINS_ACCURACY,
    MAINS_HARMONICS,
    MAINS_HZ,
    MATCH_BINS,
    PEAK_RATIO,
    SHAFT_MULTIPLES,
    SLIP_SCATTER,
    STEADY_SPEED,
    TRUSTED_SNR,
)

Numbers = NDArray[np.float64]
Mask = NDArray[np.bool_]

HARMONICS, SIDEBAND, MULTIPLE = (0.95, 0.9, 0.7), 0.6, 0.5
"""Shares of sources that show a tooth: the line itself, its second and every higher harmonic, sidebands of the first
and second harmonic, and multiples of a shaft.

Of damaged parts of 35 dB and more that score, 99 % show the second harmonic, 80 % the third to fifth, 73 % sidebands on
inner races and elements (both simulators and measured rigs; measured inner races 52 %).
"""

_HARMONICS = 5  # of a part
_EXPLAINED_SIDEBANDS = 3
_FEWEST_MULTIPLES = 10
_COUNTED = 0.25  # of the depth of the line in question, from which on a peak counts
_SPAN = 1.6  # factor in order on either side, in which the density of peaks is counted
_ACCIDENT = (1e-3, 0.9)  # least and largest probability of a peak by accident: the spectrum is not known better
_DEPTH_WEIGHT = 2.0

Key = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Orders of what turns, and mean and range of speed in rev/s; `measured` if it is not merely declared."""

    shafts: tuple[float, ...]
    speed_hz: float
    speed_range_hz: float = 0.0
    measured: bool = True

    @property
    def steady(self) -> bool:
        """Whether lines at a fixed frequency are narrow in orders."""
        return self.speed_range_hz <= STEADY_SPEED * self.speed_hz


@dataclass(frozen=True, kw_only=True)
class Part:
    """What the drawing says of a part: its order, how far its line may be off, and the rates that modulate it.

    `traces` are the rates that also modulate the lines that it leaves at those of other parts; `fastest` is by how much
    its line may exceed the order, relatively.
    """

    order: float
    tolerance: float
    spacings: tuple[float, ...] = ()
    traces: tuple[float, ...] = ()
    fastest: float = math.inf


@dataclass(frozen=True, kw_only=True)
class Claim:
    """The line of a part in one band: the score of its comb, and what explains the line better, if anything does."""

    found: float
    depth: float
    snr: float
    strength: float
    score: float
    explained_by: str = ""

    @property
    def shows(self) -> bool:
        """Whether its comb explains the peaks better than accident or any other source."""
        return self.score > 0 and not self.explained_by


@dataclass(frozen=True)
class _Comb:
    """Teeth of a source with the share of such sources that show them, and the peaks that it explains."""

    name: str
    places: Numbers
    shares: Numbers
    widths: Numbers
    own: Mask


@dataclass(frozen=True, kw_only=True)
class Peaks:
    """Peaks of the spectrum of an envelope: orders, depths and backgrounds, both over the mean of the envelope."""

    orders: Numbers
    depths: Numbers
    backgrounds: Numbers
    bin_width: float

    @property
    def width(self) -> float:
        """Distance within which two lines are one."""
        return MATCH_BINS * self.bin_width

    def separable(self, spacings: Sequence[float]) -> list[float]:
        """Return the spacings at which sidebands are apart from their line."""
        return [one for one in spacings if one > 2 * self.width]

    def at(self, places: Numbers, widths: Numbers) -> Mask:
        """Return which peaks stand at which places, (place, peak)."""
        return np.asarray(np.abs(self.orders - places[:, None]) <= widths[:, None])

    def evidence(self, comb: _Comb, depth: float) -> float:
        """Return the evidence of a comb (1) for a line of a depth.

        A tooth that would be as shallow as the background says nothing by its absence: teeth that show are taken to
        have depths from `_COUNTED` times that of the line to all of it, evenly in their logarithm.
        """
        counted = _COUNTED * depth
        inside = (comb.places > 2 * self.width) & (comb.places <= self.orders[-1])
        places, shares, widths = comb.places[inside], comb.shares[inside], comb.widths[inside]
        depths = np.max(self.depths * self.at(places, widths), axis=1, initial=0.0)
        shown = depths >= counted
        as_deep = self.depths >= np.where(shown, depths, counted)[:, None]
        around = (self.orders > places[:, None] / _SPAN) & (self.orders < places[:, None] * _SPAN) & ~comb.own
        density = ((as_deep & around).sum(axis=1) + 0.5) / (places * (_SPAN - 1 / _SPAN))
        chance = np.clip(2 * widths * density, *_ACCIDENT)
        least = PEAK_RATIO * np.interp(places, self.orders, self.backgrounds)
        visible = np.clip(np.log(depth / least) / math.log(1 / _COUNTED), 0.0, 1.0)
        missing = np.log((1 - shares * visible) / (1 - chance * visible))
        return float(np.where(shown, np.log(shares / chance), missing).sum())

    def line(self, part: Part) -> int | None:
        """Return the peak that may be the line of a part with the largest strength."""
        low, high = part.order - part.tolerance, part.order + min(part.tolerance, part.order * part.fastest)
        first, last = np.searchsorted(self.orders, (low - self.width, high + self.width))
        return max(range(first, last), key=self.strength, default=None)

    def strength(self, peak: int) -> float:
        """Return the strength of a line with its second and third harmonic."""
        multiples = np.arange(1.0, 4.0)
        at = self.at(self.orders[peak] * multiples, self.width * np.sqrt(multiples))
        depths = np.max(self.depths * at, axis=1)
        ratios = np.max(self.depths / self.backgrounds * at, axis=1)
        return strength([self.depths[peak], *depths[1:]], float(np.hypot.reduce(ratios)))

    def defect(self, name: str, order: float, spacings: Sequence[float], count: int = _HARMONICS) -> _Comb:
        """Return the comb of damage that strikes at an order, with so many harmonics, modulated at some rates."""
        harmonics = np.arange(1.0, count + 1)
        apart = self.separable(spacings)
        sides = [(k * order + side * one, k) for one in apart for k in (1, 2) for side in (-1, 1)]
        places = np.array([*(harmonics * order), *(place for place, _ in sides)])
        shown = [HARMONICS[min(k, len(HARMONICS)) - 1] for k in range(1, count + 1)]
        shares = np.array([*shown, *[SIDEBAND] * len(sides)])
        widths = self.width * np.sqrt([*harmonics, *(k for _, k in sides)])
        return _Comb(name, places, shares, widths, self.explained(order, apart, self.width))

    def explained(
        self, order: float, spacings: Sequence[float], width: float | Numbers, most: float = IMPACT_HARMONICS
    ) -> Mask:
        """Return which peaks are harmonics of an order, up to a number, or sidebands of these."""
        own = np.zeros(self.orders.size, dtype=bool)
        sides = range(1, _EXPLAINED_SIDEBANDS + 1)
        for offset in (0.0, *(sign * side * one for one in spacings for side in sides for sign in (-1, 1))):
            multiple = np.clip(np.round((self.orders - offset) / order), 1, most)
            own |= np.abs(self.orders - offset - multiple * order) <= width * np.sqrt(multiple)
        return own

    def support(self, claim: Claim, spacings: Sequence[float]) -> tuple[list[str], list[str]]:
        """Return the harmonics and the sidebands of a line that stand out, in words."""

        def standing(teeth: Mapping[str, tuple[float, int]]) -> list[str]:
            found = []
            for name, (place, harmonic) in teeth.items():
                at = np.abs(self.orders - place) <= self.width * math.sqrt(harmonic)
                if at.any():
                    found.append(f"{name} at {self.orders[at][np.argmax(self.depths[at])]:.3f}")
            return found

        harmonics = {f"harmonic {k}": (k * claim.found, k) for k in range(2, _HARMONICS + 1)}
        sides = {
            f"sideband {sign * side:+d}": (claim.found + sign * side * one, 1)
            for one in self.separable(spacings)
            for side in range(1, _EXPLAINED_SIDEBANDS + 1)
            for sign in (-1, 1)
        }
        return standing(harmonics), standing(sides)

    def multiples(self, name: str, order: float, count: int, width: float) -> _Comb:
        """Return the comb of a source at multiples of an order."""
        places = order * np.arange(1.0, count + 1)
        own = np.abs(self.orders - order * np.round(self.orders / order)) <= width
        return _Comb(name, places, np.full(count, MULTIPLE), np.full(count, width), own)


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
    >>> from hums.analysis.combs import strength
    >>> round(strength([0.3, 0.9], 800.0), 4)  # the harmonic counts as the fundamental
    0.4242
    >>> round(strength([0.3], 8.0), 4)
    0.15
    """
    comb = math.hypot(*(min(depth, depths[0]) for depth in depths))
    return comb * snr**2 / (snr**2 + TRUSTED_SNR**2)


def claims(peaks: Peaks, parts: Mapping[Key, Part], setting: Setting) -> dict[Key, Claim]:
    """Return the claim of every part that has a line in a band.

    Parameters
    ----------
    peaks : Peaks
    parts : mapping of (str, str) to Part
        By component and kind.
    setting : Setting
    """
    if not peaks.orders.size:
        return {}
    lines = {key: line for key, part in parts.items() if (line := peaks.line(part)) is not None}
    found = {key: _claim(peaks, key, lines, parts, setting) for key in lines}
    for key, one in found.items():
        same = [other for other in lines if other != key and abs(found[other].found - one.found) <= peaks.bin_width]
        best = max(same, key=lambda other: found[other].score, default=None)
        if best is not None and found[best].score > one.score and not one.explained_by:
            found[key] = replace(one, explained_by=f"it coincides with {_words(best)}")
    return found


def _claim(peaks: Peaks, key: Key, lines: Mapping[Key, int], parts: Mapping[Key, Part], setting: Setting) -> Claim:
    """Return the claim of one part."""
    peak, part = lines[key], parts[key]
    order, depth, strong = float(peaks.orders[peak]), float(peaks.depths[peak]), peaks.strength(peak)
    own = peaks.evidence(peaks.defect("", order, part.spacings), depth)
    about = _DEPTH_WEIGHT * math.log(max(strong / LEAST_STRENGTH, 1.0)) - abs(order / part.order - 1) / SLIP_SCATTER
    rivals = _rivals(peaks, key, lines, parts, setting) if own + about > 0 else ()
    most, name = max(
        ((peaks.evidence(comb, depth) - cost, comb.name) for comb, cost in rivals), default=(-math.inf, "")
    )
    return Claim(
        found=order,
        depth=depth,
        snr=depth / float(peaks.backgrounds[peak]),
        strength=strong,
        score=float(own + about - max(0.0, most)),
        explained_by=name if most >= own else "",
    )


def _rivals(
    peaks: Peaks, key: Key, lines: Mapping[Key, int], parts: Mapping[Key, Part], setting: Setting
) -> Iterator[tuple[_Comb, float]]:
    """Yield the combs of other sources that explain the line of a part, with their penalty."""
    peak, width = lines[key], peaks.width
    order, depth = peaks.orders[peak], peaks.depths[peak]
    exact = EXACT_BINS * peaks.bin_width if setting.measured else width
    for shaft in setting.shafts:
        multiple = round(order / shaft)
        if shaft > 2 * width and multiple and abs(order - multiple * shaft) <= exact:
            count = min(max(_FEWEST_MULTIPLES, multiple), SHAFT_MULTIPLES)
            name = f"it is {multiple} times the order {shaft:.4g} of a shaft or tooth"
            yield peaks.multiples(name, shaft, count, exact), 0.0
    for mains_hz, (multiple,) in mains_multiples(np.array([order]), setting, width / 2 * setting.speed_hz):
        if multiple and mains_hz > 4 * width * setting.speed_hz:
            name = f"{order * setting.speed_hz:.2f} Hz is {multiple:.0f} times mains of {mains_hz:g} Hz"
            yield peaks.defect(name, float(order), ()), 0.0
    for other, line in lines.items():
        if other == key or abs(peaks.orders[line] - order) <= peaks.bin_width or peaks.depths[line] < depth / 2:
            continue
        spacings = parts[other].spacings + (parts[other].traces if other[0] == key[0] else ())
        name = f"it belongs to the lines of {_words(other)}"
        comb = peaks.defect(name, float(peaks.orders[line]), spacings, IMPACT_HARMONICS)
        if comb.own[peak]:
            yield comb, 0.0
    yield from _unknown(peaks, peak, setting)


def _unknown(peaks: Peaks, peak: int, setting: Setting) -> Iterator[tuple[_Comb, float]]:
    """Yield the combs of fundamentals of no drawn source, alone or modulated by a shaft, with their penalty."""
    width, order, depth = peaks.width, peaks.orders[peak], peaks.depths[peak]
    cost = math.log(max(2.0, peaks.orders[-1] / width))
    multiple = np.maximum(1.0, np.round(peaks.orders / order))
    others = np.abs(peaks.orders - multiple * order) > width * np.sqrt(multiple)  # no harmonics of the line itself
    others &= (peaks.depths >= depth / 2) & (peaks.orders > 4 * width)
    for spacing in (0.0, *(shaft for shaft in setting.shafts if shaft > 4 * width)):
        sides = (-2, -1, 1, 2) if spacing else (0,)
        for place in np.flatnonzero(others & (peaks.depths > depth) if spacing else others):
            harmonics = np.arange(1 if spacing else 2, IMPACT_HARMONICS + 1)
            lines = peaks.orders[place] * harmonics[:, None] + spacing * np.array(sides)
            near = harmonics[(np.abs(lines - order) <= width).any(axis=1)]
            if near.size:  # with as many harmonics as that of the line has below its own last one
                name = f"it belongs to the lines of {peaks.orders[place]:.3f} orders, which it does not explain"
                count = min(_HARMONICS * int(near[0]), IMPACT_HARMONICS)
                yield peaks.defect(name, float(peaks.orders[place]), (spacing,) if spacing else (), count), cost


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


def _words(key: Key) -> str:
    return f"{key[0]} {key[1].replace('_', ' ')}"
