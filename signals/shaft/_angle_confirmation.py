"""Decision between doubtful speeds in the angle domain, where the lines of the right one no longer smear.

A candidate is integrated to an angle, the record is resampled evenly in it, and the orders are searched again within a
per cent of one, in frames that grow while the path gets better. In the longest frames the lines of the right speed are
narrow and stand far above the noise; those of other machines and along a wrong path are smeared (Fyfe and Munck 1997,
"Analysis of computed order tracking", on lines that smear).

Any one line may be any one order. What speaks for a speed is therefore its joint evidence: that of all lines beside the
strongest. Whole orders below ten and those of slower shafts, which a line of low frequency of any machine may be, do
not count. A speed is decided for where its joint evidence is beyond chance, and every other speed has less than half;
or where that holds for its lines over the whole record (`signals.shaft._angle_spectrum`), some of which show at any
time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator

from signals.shaft._angle_spectrum import even_angles, of_shafts, sampled, sharp_lines
from signals.shaft._line_likelihood import DC_BINS, PRESENT
from signals.shaft._speed_search import CERTAIN, MISSED, SAME_SPEED, SHOWS, Search, search_speeds
from signals.shaft.phase import ShaftPhase
from signals.shaft.phase_demodulation import RefinedPhase, refine_phase

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from signals._validation import Array

_FRAMES = 12  # of the longest length in the record: enough to see a line come and go
_MOST_REV = 32.0  # of the longest frame: beyond, no line of a speed that is known to a few bins gets narrower
_DOUBLINGS = 3  # of the frame length on the way there
_FEWEST_SAMPLES, _FEWEST_FRAMES = 64, 4  # of a frame; below, a candidate shows in too small a part to be followed
_KNOTS_REV = 4.0  # per revolution
_FINER = 4.0  # bins by which the highest order may still be off in frames of the next length
_SCANNED = 6  # best constant ratios of a candidate that are scored
_RIVAL = 0.5  # of the joint evidence, which no other speed may reach
_SECOND_DB = 4.0  # beside the strongest line: 14 dB above the noise, of which three bins hold it once in 10^10
_SAME_SHARE = 0.5  # of the time in which two candidates are within 1 %: they are of one speed
_LEAVING = 0.2  # share in which a candidate must agree to be compared where it does not
_MOST_DEMODULATED = 8
_BRIDGES = 10  # parts of a record that are half as long as a course that is tried
_WINDOWS_REV = (6.0, 24.0, 2.0)  # of the refinement: the first that leads to a sure speed that keeps the lines
_SURE = 1.5e-3  # largest median std of the refined speed, relative: three of them are within half a per cent
_STRAYING = 0.03  # share of the time in which a path may leave another, or the refined speed the path, by 1 %
_POINTS = 400  # at which speeds are compared


@dataclass(frozen=True, kw_only=True)
class Followed:
    """A candidate followed in the angle domain: its phase, the search in the longest frames, and scores of all orders.

    `orders` are all listed; those beyond half the sampling rate score zero. `levels` is the log evidence of each order
    searched in each frame, (frames, orders), `joint` the joint evidence.
    """

    phase: ShaftPhase
    search: Search
    orders: Array
    scores: Array
    levels: Array
    joint: float

    def speed_hz(self, times_s: Array) -> Array:
        """Return the speed in Hz at times, NaN beyond the candidate's."""
        inside = (times_s >= self.phase.start_s) & (times_s <= self.phase.stop_s)
        speed = self.phase.speed_hz(np.clip(times_s, self.phase.start_s, self.phase.stop_s))
        return np.where(inside, speed, np.nan)

    def votes(self, times_s: Array) -> Array:
        """Return the log evidence of all orders of the frames about given times."""
        middles = self.phase.times_at(self.phase.revolutions[0] + self.search.evidence.times_s)
        nearest = np.rint(np.interp(times_s, middles, np.arange(middles.size))).astype(np.int64)
        present = np.log1p(PRESENT * np.expm1(self.levels[nearest])).sum(axis=1)
        return np.asarray(np.logaddexp(present + np.log1p(-MISSED), np.log(MISSED)))


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The speed that is decided for, its refined phase, and its probability among the candidates."""

    followed: Followed
    refined: RefinedPhase
    probability: float


def joint_evidence(orders: Array, scores: Array) -> float:
    """Return the evidence of all orders beside the strongest, those of shafts left out."""
    counted = np.where(of_shafts(orders) | (scores < SHOWS), 0.0, scores)
    return float(counted.sum() - counted.max(initial=0.0))


def decide(
    signal: Array, rate: float, candidates: Sequence[ShaftPhase], orders: Array, *, range_hz: tuple[float, float]
) -> Decision | None:
    """Return the speed that the angle domain decides for, or None where none clearly is the best.

    `candidates` are approximate phases, the first that which is thought the best.
    """
    seconds = signal.size / rate
    mean_hz = float(np.ptp(candidates[0].revolutions) / np.ptp(candidates[0].times_s))
    frame_s = min(2 * seconds / (_FRAMES + 1), _MOST_REV / mean_hz)  # the same for all: as many frames, as narrow lines
    followed = [one for rough in candidates if (one := follow(signal, rate, rough, orders, frame_s=frame_s))]
    if not followed:
        return None
    best = max(followed, key=lambda one: one.joint)
    for other in list(followed):  # where another path has more evidence in a part, it is the better one there
        for part, gain in _stretches(best, other):
            if gain < -SHOWS and (one := follow(signal, rate, _spliced(best, other, part), orders, frame_s=frame_s)):
                followed.append(one)
                best = max(best, one, key=lambda one: one.joint)
    decision = _by_joint_evidence(signal, rate, best, followed, frame_s=frame_s, range_hz=range_hz)
    return decision or _by_sharp_lines(signal, rate, followed, range_hz=range_hz)


def _by_joint_evidence(
    signal: Array,
    rate: float,
    best: Followed,
    followed: Sequence[Followed],
    *,
    frame_s: float,
    range_hz: tuple[float, float],
) -> Decision | None:
    """Return the candidate of most joint evidence, where it has it all the time and no other speed has half of it."""
    low, high = range_hz
    trials = 2 * (high - low) * frame_s * float(best.search.orders[-1])  # speeds half a bin of the highest order apart
    others = [one.joint for one in followed if _agreeing(best, one) < _SAME_SHARE] + scanned(best, range_hz)
    if best.joint < CERTAIN + np.log(trials) or max(others, default=0.0) > _RIVAL * best.joint:
        return None
    if not _throughout(best) or _left(best, followed):
        return None
    refined = _refined(signal, rate, best)
    probability = _probability(best.joint, others)
    return None if refined is None else Decision(followed=best, refined=refined, probability=probability)


def _by_sharp_lines(
    signal: Array, rate: float, followed: Sequence[Followed], *, range_hz: tuple[float, float]
) -> Decision | None:
    """Return the candidate whose lines are the sharpest over the whole record, where no other speed's are half that.

    Its strongest lines need not stand side by side all the time; one of its lines must.
    """
    refined = [_refined(signal, rate, one) for one in followed]
    phases = [found.phase if found and found.phase else one.phase for found, one in zip(refined, followed, strict=True)]
    sharp = [
        sharp_lines(signal, rate, phase, one.orders, range_hz=range_hz)
        for phase, one in zip(phases, followed, strict=True)
    ]
    first = max(range(len(followed)), key=lambda k: sharp[k].joint)
    best, found, joint = followed[first], refined[first], sharp[first].joint
    if found is None or joint < _SECOND_DB:
        return None
    others = [lines.joint for one, lines in zip(followed, sharp, strict=True) if _agreeing(best, one) < _SAME_SHARE]
    others.append(sharp[first].rival)
    if max(others) > _RIVAL * joint or not _standing(best) or _left(best, followed):
        return None
    return Decision(followed=best, refined=found, probability=_probability(joint, others))


def _probability(joint: float, others: Sequence[float]) -> float:
    """Return the probability of a speed, tempered as in the search: half of the evidence has odds of one to twenty."""
    temper = max(1.0, _RIVAL * joint / np.log(20.0))
    return 1 / (1 + sum(float(np.exp((other - joint) / temper)) for other in others if other > 0))


def _left(best: Followed, followed: Sequence[Followed]) -> bool:
    """Return whether another candidate has as much evidence where it leaves the best."""
    return any(gain < SHOWS for one in followed for _, gain in _stretches(best, one))


def follow(signal: Array, rate: float, rough: ShaftPhase, orders: Array, *, frame_s: float) -> Followed | None:
    """Follow the orders along an approximate phase, in frames that grow to `frame_s`; None where it is too short.

    The search is within a per cent of the phase at first, then within some bins of the frame.
    """
    from signals.shaft._line_likelihood_kernels import most_likely_path  # noqa: PLC0415

    turns = float(np.ptp(rough.revolutions))
    longest = frame_s * turns / float(np.ptp(rough.times_s))
    fastest = float((np.diff(rough.revolutions) / np.diff(rough.times_s)).max()) * (1 + SAME_SPEED)
    listed = orders[orders * fastest < rate / 2]
    if not listed.size or turns < _FEWEST_FRAMES * longest:
        return None
    samples, per_rev = sampled(signal, rate, float(listed[-1]), fastest)
    if longest * per_rev < _FEWEST_SAMPLES:
        return None
    phase, tolerance = rough, SAME_SPEED
    for doubling in range(_DOUBLINGS, -1, -1):
        window = longest / 2**doubling
        if window * per_rev < _FEWEST_SAMPLES:
            continue
        values = samples(phase.times_at(even_angles(phase, per_rev)))
        search = search_speeds(values, per_rev, listed, 1 - tolerance, 1 + tolerance, tolerance / window, window)
        ratio = search.speeds[most_likely_path(search.votes, np.log(search.kernel))]
        phase = _corrected(phase, search, ratio)
        tolerance = min(tolerance, _FINER / (window * float(listed[-1])))
    scores, every = np.zeros(orders.size), np.ones(ratio.size, dtype=np.bool_)
    scores[: listed.size] = search.score(ratio, every)
    levels = search.levels(ratio, every)
    return Followed(
        phase=phase, search=search, orders=orders, scores=scores, levels=levels, joint=joint_evidence(orders, scores)
    )


def _corrected(phase: ShaftPhase, search: Search, ratio: Array) -> ShaftPhase:
    """Return the phase with its speed multiplied by the ratio found."""
    first, last = phase.revolutions[[0, -1]]
    at = np.concatenate([[first - 1e-6], first + search.evidence.times_s, [last + 1e-6]])
    turned = PchipInterpolator(at, np.concatenate([ratio[:1], ratio, ratio[-1:]])).antiderivative()
    knots = np.linspace(first, last, int(_KNOTS_REV * (last - first)) + 8)
    return ShaftPhase(times_s=phase.times_at(knots), revolutions=turned(knots))


def scanned(followed: Followed, range_hz: tuple[float, float]) -> list[float]:
    """Return the joint evidence of the best speeds in constant ratios to a candidate, octaves among them."""
    from signals.shaft._line_likelihood_kernels import add_votes  # noqa: PLC0415

    search, phase = followed.search, followed.phase
    speed = phase.speed_hz(np.linspace(phase.start_s, phase.stop_s, _POINTS))
    low, high = range_hz[0] / np.quantile(speed, 0.1), range_hz[1] / np.quantile(speed, 0.9)
    ratios = np.arange(low, high, 0.5 / (search.frame_s * search.orders[-1]))
    votes = np.zeros((ratios.size, search.evidence.times_s.size))
    levels = search.evidence.log_votes()
    add_votes(levels, search.evidence.bins_per_hz, search.orders, search.weights, ratios, DC_BINS, votes)
    total = np.where(np.abs(ratios - 1) < SAME_SPEED, -np.inf, np.maximum(votes, 0.0).sum(axis=1))
    found, every = [], np.ones(votes.shape[1], dtype=np.bool_)
    for _ in range(_SCANNED):
        if not np.isfinite(total).any():
            break
        ratio = ratios[np.argmax(total)]
        total[np.abs(ratios - ratio) < SAME_SPEED * ratio] = -np.inf
        found.append(joint_evidence(search.orders, search.score(np.full(every.size, ratio), every)))
    return found


def _agreeing(one: Followed, other: Followed) -> float:
    """Return the share of the time in which two candidates have one speed."""
    times = np.linspace(one.phase.start_s, one.phase.stop_s, _POINTS)
    off = np.abs(other.speed_hz(times) / one.speed_hz(times) - 1)
    known = np.isfinite(off)
    return float(np.mean(off[known] < SAME_SPEED)) if known.any() else 0.0


def _throughout(followed: Followed) -> bool:
    """Return whether joint evidence shows all the time: where it does not, a path may follow anything.

    Frames overlap by half, so that each two hold what one and a half hold.
    """
    both = _of_two_frames(followed)
    joint = both.sum(axis=1) - both.max(axis=1, initial=0.0)
    return bool(joint.min(initial=np.inf) >= SHOWS)


def _standing(followed: Followed) -> bool:
    """Return whether some line shows all the time, in each two frames next to one another."""
    return bool(_of_two_frames(followed).max(axis=1, initial=0.0).min(initial=np.inf) >= SHOWS)


def _of_two_frames(followed: Followed) -> Array:
    """Return the log evidence, no less than zero, of each order that shows in each two frames next to one another."""
    orders = followed.search.orders
    levels = followed.levels[:, ~of_shafts(orders) & (followed.scores[: orders.size] > SHOWS)]
    return np.maximum(levels[1:] + levels[:-1], 0.0)


def _stretches(best: Followed, other: Followed) -> list[tuple[Array, float]]:
    """Return the times of each stretch in which another candidate leaves a speed that it shares, and what it loses.

    What is lost is log evidence, per frame of the best candidate.
    """
    agreeing = _agreeing(best, other)
    if not _LEAVING < agreeing < 1:
        return []
    times = np.linspace(best.phase.start_s, best.phase.stop_s, _POINTS)
    apart = np.abs(other.speed_hz(times) / best.speed_hz(times) - 1) > SAME_SPEED
    edges = np.flatnonzero(np.diff(np.concatenate([[False], apart, [False]]).astype(np.int8))).reshape(-1, 2)
    frames = best.search.evidence.times_s.size / _POINTS
    found = [times[first:last] for first, last in edges if last - first > _STRAYING * _POINTS]
    return [(part, float((best.votes(part) - other.votes(part)).sum()) * frames) for part in found]


def _spliced(best: Followed, other: Followed, part: Array) -> ShaftPhase:
    """Return the phase of a candidate with the speeds of another in a stretch of time."""
    times = np.linspace(best.phase.start_s, best.phase.stop_s, 2 * _POINTS + 1)
    inside = (times >= part[0]) & (times <= part[-1])
    speed = np.where(inside, other.speed_hz(times), best.speed_hz(times))
    turned = PchipInterpolator(times, speed).antiderivative()
    return ShaftPhase(times_s=times, revolutions=best.phase.revolutions[0] + turned(times))


def _refined(signal: Array, rate: float, followed: Followed) -> RefinedPhase | None:
    """Return the phase refined from the harmonics, where that is sure and stays with the path; else None."""
    orders, scores = followed.search.orders, followed.scores[: followed.search.orders.size]
    tolerance = _FINER / (followed.search.frame_s * float(orders[-1]))
    for refined, phase in sure_refinements(signal, rate, followed.phase, orders, scores, tolerance=tolerance):
        times = np.linspace(phase.start_s, phase.stop_s, _POINTS)  # beyond the windows, too
        off = np.abs(phase.speed_hz(times) / followed.speed_hz(times) - 1)
        if np.nanmean(off > SAME_SPEED) <= _STRAYING:
            return refined
    return None


def sure_refinements(
    signal: Array, rate: float, phase: ShaftPhase, orders: Array, scores: Array, *, tolerance: float
) -> Iterator[tuple[RefinedPhase, ShaftPhase]]:
    """Yield each refinement from the strongest orders that makes the speed sure, with its phase: a window at a time."""
    significant = min(_MOST_DEMODULATED, np.count_nonzero(scores > SHOWS))
    strongest = np.sort(orders[np.argsort(-scores)[:significant]])
    for window_rev in _WINDOWS_REV:
        window = min(window_rev, float(phase.revolutions[-1] - phase.revolutions[0]) / 3)
        try:
            refined = refine_phase(
                signal, rate_hz=rate, phase=phase, orders=strongest.tolist(), tolerance=tolerance, window_rev=window
            )
        except ValueError:  # the speed of single frames is too rough for windows of several revolutions
            continue
        if refined.phase is None:
            continue
        relative = refined.std_hz / refined.speed_hz
        if np.median(relative) < _SURE and relative.max() < SAME_SPEED:  # in every window
            yield refined, refined.phase


def strays(signal: Array, rate: float, phase: ShaftPhase, orders: Array) -> list[tuple[float, float]]:
    """Return the times between which a phase has no evidence, at its ends, or a straight course there has as much.

    A path that follows another line for a moment, or before the shaft's lines show, leaves such a course by over 1 %.
    """
    seconds = float(phase.stop_s - phase.start_s)
    times = np.linspace(phase.start_s, phase.stop_s, _POINTS + 1)
    speed, width = phase.speed_hz(times), _POINTS // _BRIDGES
    frame_s = min(2 * seconds / (_FRAMES + 1), _MOST_REV / float(speed.mean()))
    own = follow(signal, rate, _integral(times, speed), orders, frame_s=frame_s)
    if own is None:
        return []
    found = _silent_ends(own)
    for part, ends in (
        *((slice(0, end), [end, 2 * end]) for end in (width, 2 * width)),
        *((slice(_POINTS - end, None), [_POINTS - 2 * end, _POINTS - end]) for end in (width, 2 * width)),
        *((slice(at, at + 2 * width + 1), [at, at + 2 * width]) for at in range(0, _POINTS + 1 - 2 * width, width)),
    ):
        straight = np.polyval(np.polyfit(times[ends], speed[ends], 1), times[part])
        if straight.min() <= 0 or np.abs(straight / speed[part] - 1).max() < SAME_SPEED:
            continue
        other = speed.copy()
        other[part] = straight
        one = follow(signal, rate, _integral(times, other), orders, frame_s=frame_s)
        if one is None:
            continue
        apart = times[part][np.abs(one.speed_hz(times[part]) / own.speed_hz(times[part]) - 1) > SAME_SPEED]
        gain = (own.votes(apart) - one.votes(apart)).sum() * own.search.evidence.times_s.size / _POINTS
        if apart.size > _STRAYING * _POINTS and gain < SHOWS:
            found.append((float(apart[0]), float(apart[-1])))
    return found


def _silent_ends(followed: Followed) -> list[tuple[float, float]]:
    """Return the times of the frames before the first in which any line shows, and of those after the last."""
    phase, search = followed.phase, followed.search
    middles = phase.revolutions[0] + search.evidence.times_s
    shows = np.flatnonzero(followed.votes(phase.times_at(middles)) >= SHOWS)
    if not shows.size:
        return [(phase.start_s, phase.stop_s)]
    first, last = shows[[0, -1]]
    edges = [
        middles[max(first - 1, 0)] + search.frame_s / 2,
        middles[min(last + 1, middles.size - 1)] - search.frame_s / 2,
    ]
    begins_s, ends_s = phase.times_at(np.array(edges)).tolist()
    before, after = (phase.start_s, begins_s), (ends_s, phase.stop_s)
    return [before] * bool(first > 0) + [after] * bool(last < middles.size - 1)


def _integral(times: Array, speed: Array) -> ShaftPhase:
    """Return the phase of speeds at times."""
    return ShaftPhase(times_s=times, revolutions=PchipInterpolator(times, speed).antiderivative()(times))
