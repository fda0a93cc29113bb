"""Evidence ratio of a speed profile: lines of the listed orders in the order spectrum, against every rival.

Over many revolutions a bin is a few hundredths of an order. A line of the shaft then lies in the bin of its order, a
line of another machine does not, and for a wrong speed profile all lines are smeared (Fyfe and Munck 1997, "Analysis of
computed order tracking"). Each peak has the likelihood ratio of a line against noise and lines of other sources, whose
density is that of all peaks (`log_line_ratio`). The fraction of orders present is unknown and integrated out with
Jeffreys' prior, as is that of their sidebands.

A single line can be any order of some speed: what determines the speed is no evidence for it, neither the strongest
line nor what chance finds among as many speeds. A rival is another profile ("course"), another speed in a constant
ratio, or one tone with harmonics at fixed frequencies. A course is only as certain as in the sixth of the record with
the least evidence, so that a rival that is right in one sixth wins there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal.windows import blackmanharris

from signals.shaft._speed_search import (
    CERTAIN,
    SAME_SPEED,
    log_line_ratio,
    lowest_band,
    most_likely_speeds,
    search_speeds,
)
from signals.shaft.phase import ShaftPhase, constant_speed
from signals.shaft.phase_demodulation import RefinedPhase, refine_phase

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from signals._validation import Array
    from signals.shaft.phase_demodulation import RefinedPhase

# ---- A course tracked in the angle domain, where the lines of the right speed are not smeared ------------------------
# An approximate course is integrated to an angle, the record is resampled uniformly in it, and the orders are searched
# again within one per cent, in frames that grow as the course improves; finally the phase is refined from the strongest
# harmonics (`signals.shaft.phase_demodulation`).

_FRAMES = 12  # of the longest length per record, enough to see a line appear and disappear
_MOST_REV = 32.0  # of the longest frame; beyond, lines of a speed known to a few bins do not become narrower
SHOWS = 3.0  # smallest log likelihood ratio of an order that counts as present
_SAMPLES = 2.5  # per cycle of the highest order
_MARGIN_ORDERS = 2.0


def in_angle(signal: Array, rate: float, phase: ShaftPhase, order: float) -> tuple[Array, Array, float]:
    """Return the record sampled uniformly in angle up to an order, the sample times, and samples per revolution."""
    top = order + _MARGIN_ORDERS
    band, band_rate = lowest_band(signal, rate_hz=rate, top_hz=min(top * fastest_hz(phase), rate / 2))
    per_rev = _SAMPLES * top
    turns = np.arange(phase.revolutions[0], phase.revolutions[-1], 1 / per_rev)
    times = PchipInterpolator(phase.revolutions, phase.times_s)(turns)
    return CubicSpline(np.arange(band.size) / band_rate, band)(times), times, per_rev


def fastest_hz(phase: ShaftPhase) -> float:
    """Return the highest mean speed between two times of a phase."""
    return float((np.diff(phase.revolutions) / np.diff(phase.times_s)).max())


def followed(signal: Array, rate: float, rough: ShaftPhase, orders: Array) -> ShaftPhase:
    """Return an approximate phase corrected from the orders, in frames that grow to 32 revolutions."""
    turns = float(np.ptp(rough.revolutions))
    longest = min(2 * turns / (_FRAMES + 1), _MOST_REV)
    listed = orders[orders * fastest_hz(rough) * (1 + SAME_SPEED) < rate / 2]
    phase, tolerance = rough, SAME_SPEED
    fewest_samples = 64  # of a frame
    for doubling in range(2, -1, -1):  # the frame length is doubled twice
        window = longest / 2**doubling
        if not listed.size or window * _SAMPLES * (listed[-1] + _MARGIN_ORDERS) < fewest_samples:
            continue
        values, _, per_rev = in_angle(signal, rate, phase, float(listed[-1]))
        search = search_speeds(values, per_rev, listed, 1 - tolerance, 1 + tolerance, tolerance / window, window)
        ratio = most_likely_speeds(search.votes, search)
        first, last = phase.revolutions[[0, -1]]
        at = np.concatenate([[first - 1e-6], first + search.evidence.times_s, [last + 1e-6]])
        turned = PchipInterpolator(at, np.concatenate([ratio[:1], ratio, ratio[-1:]])).antiderivative()
        knots = np.linspace(first, last, int(4.0 * (last - first)) + 8)  # four per revolution
        times = PchipInterpolator(phase.revolutions, phase.times_s)(knots)
        phase = ShaftPhase(times_s=times, revolutions=turned(knots))
        # the highest order may still be off by 4.0 bins in frames of the next length
        tolerance = min(tolerance, 4.0 / (window * float(listed[-1])))
    return phase


def refinements(
    signal: Array, rate: float, phase: ShaftPhase, orders: Array, shown: Array
) -> Iterator[tuple[ShaftPhase, RefinedPhase]]:
    """Yield the refinements of a phase from the most prominent orders, one for each window length."""
    most_demodulated = 8
    count = min(most_demodulated, max(np.count_nonzero(shown > SHOWS), 1))
    strongest = np.sort(orders[np.argsort(-shown)[:count]])
    turns = float(np.ptp(phase.revolutions))
    # the highest order is finally known to within 2.0 bins of the longest frame
    tolerance = 2.0 / (min(2 * turns / (_FRAMES + 1), _MOST_REV) * float(orders[-1]))
    sure = 1.5e-3  # largest median relative std of the refined speed, three of which are within half a per cent
    for window in (6.0, 24.0, 2.0):  # in revolutions
        try:
            refined = refine_phase(
                signal,
                rate_hz=rate,
                phase=phase,
                orders=strongest.tolist(),
                tolerance=tolerance,
                window_rev=min(window, turns / 3),
            )
        except ValueError:  # no order low enough, or too few revolutions
            continue
        relative = refined.std_hz / refined.speed_hz
        if refined.phase is not None and np.median(relative) < sure and relative.max() < SAME_SPEED:
            yield refined.phase, refined


# ---- Evidence of tracked courses -------------------------------------------------------------------------------------

_ODDS = np.log(20.0)  # of a speed against chance, another speed, and none in a sixth of the record

_PARTS = 6
_LOBE_BINS = 3  # half the main lobe of a Blackman-Harris window, whose side lobes are 92 dB down
_HIGH = 10.0  # power over noise, which noise exceeds in one bin in 20,000
_SIDEBANDS = (-2.0, -1.0, 1.0, 2.0)
_HARMONICS = 7  # of one tone, such as the mains: hum above the seventh is seldom louder than the machine (our choice)
_MOST_RATIOS, _SCORED = 20_000, 30
_REFINED = 2  # best courses whose phase is refined
_SHARES = np.sin((np.arange(16) + 0.5) / 16 * np.pi / 2) ** 2  # equal steps of Jeffreys' prior


def _presence(log_ratios: Array) -> Array:
    """Return the log evidence of lines, (..., lines) to (...,), of which an unknown fraction is present."""
    excess = np.expm1(np.minimum(log_ratios, 60.0))
    logs = np.stack([np.log1p(share * excess).sum(axis=-1) for share in _SHARES])
    return np.asarray(np.logaddexp.reduce(logs, axis=0) - np.log(_SHARES.size))


@dataclass(frozen=True, kw_only=True)
class _Spectrum:
    """Log likelihood ratio of a line within a bin of each point of an order spectrum, and its bins per order."""

    log_ratios: Array
    turns: float

    def at(self, orders: Array) -> Array:
        """Return the log likelihood ratio at orders, of any shape; zero beyond the spectrum."""
        bins = np.minimum(np.rint(orders * self.turns), self.log_ratios.size - 1).astype(np.int64)
        return self.log_ratios[bins]

    def separate(self, orders: Array, beside: Array) -> Array:
        """Return the orders more than half a main lobe from the preceding ones and from those `beside`."""
        kept = beside.tolist()
        for order in orders.tolist():
            if all(abs(order - other) * self.turns > _LOBE_BINS for other in kept):
                kept.append(order)
        return np.array(kept[beside.size :])

    def log_evidence(self, orders: Array, ratios: Array) -> Array:
        """Return the log evidence of orders and their sidebands at each ratio to the speed of the spectrum."""
        own = self.separate(orders, np.zeros(0))
        sides = np.add.outer(own[own > max(_SIDEBANDS)], np.array(_SIDEBANDS)).ravel()
        sides = self.separate(np.unique(sides), own)
        beside = _presence(self.at(np.outer(ratios, sides))) if sides.size else np.zeros(ratios.size)
        return np.asarray(_presence(self.at(np.outer(ratios, own))) + np.logaddexp(0.0, beside) - np.log(2))

    def tone_evidence(self, orders: Array) -> float:
        """Return the log evidence that one tone with up to seven harmonics causes the lines at orders and sidebands."""
        places = np.unique(np.add.outer(orders, np.array([0.0, *_SIDEBANDS])))
        bins = np.unique(np.rint(np.add.outer(places[places > 0] * self.turns, np.arange(-2, 3))).astype(np.int64))
        bins = bins[bins < self.log_ratios.size]
        masked = np.minimum(self.log_ratios, 0.0)
        masked[bins] = self.log_ratios[bins]
        lines = np.add.outer(orders[self.at(orders) > SHOWS], np.arange(-1.5, 2.0, 0.5) / self.turns).ravel()
        harmonics = np.arange(1.0, _HARMONICS + 1)
        if not lines.size:
            return 0.0
        levels = _Spectrum(log_ratios=masked, turns=self.turns).at(
            np.outer(np.divide.outer(lines, harmonics), harmonics)
        )
        return float(max(_presence(levels[:, : count + 1]).max() for count in range(_HARMONICS)))


def _spectra(signal: Array, rate: float, phase: ShaftPhase, top: float, *counts: int) -> list[_Spectrum]:
    """Return the order spectra of a phase, up to an order, of the record in each of these numbers of parts."""
    top = min(top, rate / 2 / fastest_hz(phase))
    values, times, per_rev = in_angle(signal, rate, phase, top)
    return [
        _spectrum(part, per_rev, phase.speed_hz(np.linspace(at[0], at[-1], 64)), top)
        for count in counts
        for part, at in zip(np.array_split(values, count), np.array_split(times, count), strict=True)
    ]


def _spectrum(values: Array, per_rev: float, speed_hz: Array, top: float) -> _Spectrum:
    turns = values.size / per_rev
    power = np.abs(np.fft.rfft((values - values.mean()) * blackmanharris(values.size, sym=False))) ** 2
    noise = np.maximum(median_filter(power, 81) / np.log(2), 1e-20 * power.max() + np.finfo(float).tiny)
    ratio = (power / noise)[: int(top * turns) + 2 * _LOBE_BINS]
    peaks = np.where(ratio >= maximum_filter1d(ratio, 2 * _LOBE_BINS + 1), ratio, 0.0)
    peaks = maximum_filter1d(peaks, 3)  # crossing a mode shifts the phase of a line by half a cycle, half a bin
    foreign = (0.005, 0.3)
    found = log_line_ratio(peaks, foreign=float(np.clip(np.mean(peaks > _HIGH), *foreign)))
    found[: _LOBE_BINS + 2] = 0.0
    found[-1] = 0.0
    mains_hz = (50.0, 60.0)
    for hum in {number * mains for mains in mains_hz for number in range(1, _HARMONICS + 1)}:
        low, high = hum / speed_hz.max() * turns, hum / speed_hz.min() * turns
        if high - low < _LOBE_BINS:  # otherwise it is smeared
            found[int(max(low - _LOBE_BINS, 0)) : int(high + _LOBE_BINS) + 1] = 0.0
    return _Spectrum(log_ratios=found, turns=turns)


@dataclass(frozen=True, kw_only=True)
class Followed:
    """A course tracked in angle: its phase, refined if possible, and its log evidence.

    `evidence` is that over the whole record and in the sixth with the least, `shown` the log likelihood ratio of each
    order, averaged over the sixths, and `place` the index of the course among those tracked.
    """

    place: int
    phase: ShaftPhase
    refined: RefinedPhase | None = None
    evidence: tuple[float, float]
    shown: Array

    @property
    def total(self) -> float:
        """Sum of both."""
        return sum(self.evidence)


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another speed, as a ratio to the best one at uniform times, and the log odds of the best one against it."""

    ratio: Array
    log_odds: float


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The most likely course, its rivals, and the log likelihood ratio of each order.

    `beyond_chance` is the log evidence apart from the strongest line and beyond what chance finds among as many speeds;
    `against_others` and `against_tone` are the log odds against the most likely other speed and against one tone.
    """

    best: Followed
    rivals: tuple[Rival, ...]
    shown: Array
    beyond_chance: float
    against_others: float
    against_tone: float

    @property
    def doubt(self) -> str:
        """Why the speed is in doubt, as a clause; empty if it is not."""
        if self.beyond_chance < _ODDS:
            return "its lines are no more than chance would place at the orders of some speed"
        if self.best.evidence[1] < _ODDS:
            return "its lines are missing in part of the record"
        if self.rivals:
            return "another speed explains the record about as well"
        odds_of_tone = np.log(100.0)  # higher, since neighbouring machines and electronics cause tones
        if self.against_tone < odds_of_tone:
            return "its lines stay at fixed frequencies and may be one tone with harmonics, unrelated to a shaft"
        return "" if self.best.refined else "the phase of its harmonics cannot be tracked through the record"


def judged(
    signal: Array,
    rate: float,
    rough: Sequence[ShaftPhase],
    orders: Array,
    range_hz: tuple[float, float],
    *,
    steady: ShaftPhase | None = None,
) -> Verdict:
    """Return the most likely of several approximate courses, tracked and refined, with the evidence against its rivals.

    A `steady` speed is retained unless a course, which is free to vary, has more evidence in every part.
    """
    every = [_followed(signal, rate, phase, orders, place) for place, phase in enumerate(rough)]
    every.sort(key=lambda one: -one.total)
    every[:_REFINED] = [_refined(signal, rate, one, orders) for one in every[:_REFINED]]
    if steady is not None:
        constant = along(signal, rate, steady, orders)
        gains = [np.subtract(one.evidence, constant.evidence) for one in every]
        every = [one for one, gain in zip(every, gains, strict=True) if gain[0] > CERTAIN and gain[1] > 0] or [constant]
    best = max(every[:_REFINED], key=lambda one: one.total)
    points = 400  # at which two courses are compared
    times = np.linspace(best.phase.start_s, best.phase.stop_s, points)
    speed = best.phase.speed_hz(times)
    low = min(float(range_hz[0] / np.quantile(speed, 0.1)), 1.0)
    high = max(float(range_hz[1] / np.quantile(speed, 0.9)), 1.0)
    whole, *parts = _spectra(signal, rate, best.phase, (float(orders[-1]) + 3) * high, 1, _PARTS)
    ratios = _rival_ratios(parts, orders, low, high)
    rivals = [
        Rival(ratio=np.full(points, ratio), log_odds=_log_odds(best, (total, least)))
        for ratio, total, least in zip(ratios, *_evidence(whole, parts, orders, ratios), strict=True)
    ]
    for one in every:
        ratio = _ratio(one.phase, times, speed)
        if np.isfinite(ratio).any() and np.nanquantile(np.abs(ratio - 1), 0.8) > SAME_SPEED:
            rivals.append(Rival(ratio=ratio, log_odds=_log_odds(best, one.evidence)))
    against_others = min((one.log_odds for one in rivals), default=np.inf)
    # 0.1 of the evidence: lines of one source appear and disappear together, so that more of them add less
    rivals = _likely(rivals, max(_ODDS, 0.1 * best.evidence[0]))
    mean_hz, shown = float(speed.mean()), whole.at(orders)
    tried = max((high - low) * min(float(orders[-1]), rate / 2 / mean_hz), 1 / whole.turns)
    beyond_chance = best.evidence[0] - max(np.log(tried * whole.turns), float(shown.max()))
    still = constant_speed(mean_hz, start_s=best.phase.start_s, stop_s=best.phase.stop_s)
    (fixed,) = _spectra(signal, rate, still, float(orders[-1]) + 3, 1)
    # a tone may have any frequency, of which there are more than speeds in the range
    tone = fixed.tone_evidence(orders) - max(np.log(rate / 2 / mean_hz / tried), 0.0)
    return Verdict(
        best=best,
        rivals=tuple(rivals),
        shown=shown,
        beyond_chance=beyond_chance,
        against_others=against_others,
        against_tone=best.evidence[0] - tone,
    )


def along(signal: Array, rate: float, phase: ShaftPhase, orders: Array, place: int = -1) -> Followed:
    """Return a phase as a course, with the log evidence of the orders along it."""
    whole, *parts = _spectra(signal, rate, phase, float(orders[-1]) + 3, 1, _PARTS)
    total, least = _evidence(whole, parts, orders, np.ones(1))
    shown = np.mean([part.at(orders) for part in parts], axis=0)
    return Followed(place=place, phase=phase, evidence=(float(total[0]), float(least[0])), shown=shown)


def _evidence(whole: _Spectrum, parts: Sequence[_Spectrum], orders: Array, ratios: Array) -> tuple[Array, Array]:
    if not ratios.size:
        return np.zeros(0), np.zeros(0)
    return whole.log_evidence(orders, ratios), np.min([part.log_evidence(orders, ratios) for part in parts], axis=0)


def _log_odds(best: Followed, rival: tuple[float, float]) -> float:
    """Return the log odds of the best against a rival, which must be as likely both overall and in every part."""
    return max(mine - its for mine, its in zip(best.evidence, rival, strict=True))


def _followed(signal: Array, rate: float, rough: ShaftPhase, orders: Array, place: int) -> Followed:
    """Return a course tracked in angle, or unchanged if that does not increase its evidence."""
    tried = [along(signal, rate, phase, orders, place) for phase in (rough, followed(signal, rate, rough, orders))]
    return max(tried, key=lambda one: one.total)


def _refined(signal: Array, rate: float, one: Followed, orders: Array) -> Followed:
    """Return a course with its phase refined, with the first window length that retains its lines, else unchanged."""
    for phase, refined in refinements(signal, rate, one.phase, orders, one.shown):
        found = replace(along(signal, rate, phase, orders, one.place), refined=refined)
        if found.total > 0.5 * one.total:  # the refinement follows the same lines
            return found
    return one


def likeliest_constant(
    signal: Array, rate: float, phase: ShaftPhase, orders: Array, range_hz: tuple[float, float]
) -> ShaftPhase:
    """Return the constant speed within a range that is most likely over the whole record of a phase."""
    mean_hz = float(np.ptp(phase.revolutions) / np.ptp(phase.times_s))
    low, high = range_hz[0] / mean_hz, range_hz[1] / mean_hz
    (whole,) = _spectra(signal, rate, phase, (float(orders[-1]) + 3) * high, 1)
    ratios = _grid(whole, orders, low, high)
    found = whole.log_evidence(orders, ratios)
    near = np.abs(ratios / ratios[np.argmax(found)] - 1) < SAME_SPEED
    return phase.scaled(float(np.average(ratios[near], weights=np.exp(found[near] - found.max()))))


def _grid(spectrum: _Spectrum, orders: Array, low: float, high: float) -> Array:
    """Return ratios half a bin of the highest order apart."""
    return np.arange(low, high, max(0.5 / (spectrum.turns * float(orders[-1])), (high - low) / _MOST_RATIOS))


def _rival_ratios(parts: Sequence[_Spectrum], orders: Array, low: float, high: float) -> Array:
    """Return the constant ratios to a speed at which most orders have lines, octaves among them."""
    own = parts[0].separate(orders, np.zeros(0))
    shown = np.maximum(np.mean([part.at(own) for part in parts], axis=0), 1e-3)
    width = max(SAME_SPEED, _LOBE_BINS / (parts[0].turns * float(np.average(own, weights=shown))))
    ratios = _grid(parts[0], orders, low, high)
    ratios = ratios[np.abs(ratios - 1) > width]
    if not ratios.size:
        return ratios
    total = np.min([_presence(part.at(np.outer(ratios, own))) for part in parts], axis=0)
    return ratios[np.argsort(-total)[:_SCORED]]


def _ratio(phase: ShaftPhase, times: Array, speed: Array) -> Array:
    """Return the ratio of the speed of a phase to another at given times, NaN outside the phase."""
    inside = (times >= phase.start_s) & (times <= phase.stop_s)
    return np.where(inside, phase.speed_hz(np.clip(times, phase.start_s, phase.stop_s)) / speed, np.nan)


def _likely(rivals: Sequence[Rival], log_odds: float) -> list[Rival]:
    """Return the distinct rivals within the odds, the most likely first."""
    kept: list[Rival] = []
    for one in sorted(rivals, key=lambda rival: rival.log_odds):
        if one.log_odds < log_odds and not any(_same(one.ratio, other.ratio) for other in kept):
            kept.append(one)
    return kept


def _same(one: Array, other: Array) -> NDArray[np.bool_]:
    return np.asarray(np.nanmedian(np.abs(one / other - 1)) < SAME_SPEED)
