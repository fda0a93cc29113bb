"""Tacholess speed estimation: the posterior probability of every speed, given the orders of the gearbox.

In each short frame, each listed order gives a likelihood of each speed, by a line at order times speed or none
(Leclere, Andre & Antoni 2016, "A multi-order probabilistic approach for instantaneous angular speed tracking"). The
frames form a hidden Markov model: the speed changes by no more than the declared acceleration allows, and the orders of
the shaft may disappear. Its posterior gives the confidence; its evidence decides whether there is a shaft at all: for
white noise in independent frames the mean of the evidence ratio is one, so that it exceeds 1000 in at most one record
in a thousand (Markov's inequality). Noise with peaks narrower than the bins of its estimate exceeds it more often;
those cases are mostly called ambiguous.

Alternative speeds that explain the record nearly as well are found by the same search without the speeds found before.
The phase is then refined from the significant harmonics (`signals.shaft.phase_demodulation`).

Frames of another length mix the lines of the shaft with those of other machines in another way, and smear high orders
less or more. A speed of which shorter frames are surer counts; one that they contradict is ambiguous.

Where all of that leaves a doubt, lines that stay in one bin through half the record, as hum and other machines of
constant speed make them, are taken for noise, and the search is repeated with the lines that move: several that move
together in the ratios of the drawing are of nothing else. It decides only where it is sure by the same rules.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from signals._validation import Array, checked, positive, real_vector
from signals.shaft._angle_confirmation import decide, strays, sure_refinements
from signals.shaft._angle_spectrum import sharp_lines
from signals.shaft._line_likelihood import without_steady_lines
from signals.shaft._speed_search import (
    AS_MUCH,
    CERTAIN,
    SAME_SPEED,
    Rival,
    Search,
    beyond_harmonics,
    longest_run,
    low_family,
    no_mesh_shows,
    rivals,
    search_speeds,
    single_line,
    slower_shaft,
)
from signals.shaft._steady_lines import one_tone
from signals.shaft.phase import ShaftPhase
from signals.shaft.phase_demodulation import listed_orders

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

_FEWEST_FRAMES, _FEWEST_REVOLUTIONS = 8, 10.0
_SHORTEST_RUN = 4
_LONGEST_FRAME_S = 2.0
_SMEAR = 4.0  # bins by which the median order may move within a frame at the largest acceleration
_LEFT_STD, _LEFT_SHARE = 2.5, 0.05  # of the search, in this share of frames: the refined speed follows another line
_FEWEST_SAMPLES = 64  # a frame
_FRAMES = (0.5, 0.25)  # of the default length: two next to one another should find the same speed
_AT_AN_END = 0.02  # of the time: a part that is not known and begins there is cut off
_KEPT = 0.5  # of the evidence, by lines that move: more than any rival of a sure speed has
_SAME_PATH = 0.95  # of the frames within 1 %: two paths need not both be followed
_LEAST_LEFT = 0.5  # of a phase without its ends
_ONE_LINE_DB = 1.5  # beside the strongest: less than 12 dB above the noise, which a close sideband reaches
_AS_SHARP = 0.8  # of the levels: octaves share up to three quarters of the lines
_CONTRADICTION = "frames of another length find another speed, or one in a part of the record"
_AGREEING = 0.98  # of the frames within 1 % of speed, or three standard deviations


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Another speed that explains the record about as well: over time, as a ratio to the first, and its probability."""

    speed_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    ratio: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class SpeedEstimate:
    """Speed of a shaft against time, estimated from vibration.

    Attributes
    ----------
    status : {"ok", "ambiguous", "not found"}
        Ambiguous for the `reason` given: `alternatives` are nearly as likely; nearly all evidence is of one of several
        orders, which may be any order, or another machine's; at most three whole orders below ten show, which half or a
        third of the speed, in range, would show too, or while none of the other orders does; the phase of the harmonics
        cannot be followed surely enough; frames of another length are as sure of another speed; over the whole record a
        single line is in the bin of its order, or as many are at another ratio; its lines keep one frequency, and are
        of fewer than three families of harmonics; or a straight course over some part explains that as well. Where
        such a part, or one without lines, is at an end, the phase ends before it.
    times_s : (frame,) array
        Times in s of the middles of the frames.
    speed_hz, std_hz : (frame,) arrays
        Speed in Hz and its standard deviation; NaN in frames without the shaft, and everywhere if it is not found.
    confidence : (frame,) array
        Probability that the orders of the shaft are present and its speed is within 1 % (or the resolution) of
        `speed_hz`; at most a half where ambiguous.
    alternatives : tuple of Alternative
        Other speeds that explain the record, with their probabilities.
    orders, shown : (order,) arrays
        Orders searched for, and the logarithm of the evidence for each (in the angle domain, where that decided).
    evidence : float
        Logarithm of the evidence for a shaft against noise.
    phase : ShaftPhase or None
        Phase refined from the harmonics; None unless the status is "ok".
    phase_std_rev : float
        Median standard deviation of the phase in revolutions.
    reason : str
        Why the status is not "ok", in a clause; empty where it is.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import estimate_speed
    >>> noise = np.random.default_rng(1).standard_normal(10_000)
    >>> found = estimate_speed(noise, rate_hz=1000, orders=[3, 7], speed_range_hz=(10, 30), max_acceleration_hz_s=2)
    >>> found.status
    'not found'
    """

    status: Literal["ok", "ambiguous", "not found"]
    times_s: Array = field(metadata={"dims": ("frame",), "units": "s"})
    speed_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    std_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    confidence: Array = field(metadata={"dims": ("frame",), "units": "1"})
    alternatives: tuple[Alternative, ...]
    orders: Array = field(metadata={"dims": ("order",), "units": "1"})
    shown: Array = field(metadata={"dims": ("order",), "units": "1"})
    evidence: float
    phase: ShaftPhase | None
    phase_std_rev: float
    reason: str = ""


@checked
def estimate_speed(
    x: ArrayLike,
    *,
    rate_hz: float,
    orders: Sequence[float],
    speed_range_hz: tuple[float, float],
    max_acceleration_hz_s: float,
    frame_s: float | None = None,
    start_s: float = 0.0,
) -> SpeedEstimate:
    """Estimate the speed of a shaft from a vibration record and the orders of the gearbox.

    Parameters
    ----------
    x : (n,) array
        Vibration, any unit; finite.
    rate_hz : float
        Sampling rate in Hz.
    orders : sequence of float
        Orders per revolution of the shaft that the vibration may contain: mesh orders and their multiples, and 1.
        Orders that are absent cost little evidence; orders close to each other add least.
    speed_range_hz : (low, high)
        Range of the speed in Hz.
    max_acceleration_hz_s : float
        Largest rate of change of the speed in Hz/s.
    frame_s : float, optional
        Length of the frames in s. Default: the median order moves by at most 4 bins within one, and at most an eighth
        of the record or 2 s; the speed is searched in frames of a half and a quarter of it as well, until two lengths
        agree.
    start_s : float
        Time of the first sample in s.

    Returns
    -------
    SpeedEstimate

    Raises
    ------
    ValueError
        A record of too few revolutions, orders beyond half the sampling rate, values that are not finite.

    Examples
    --------
    A shaft that rises from 20 to 25 rev/s, with lines of orders 12 and 17:

    >>> import numpy as np
    >>> from signals import estimate_speed
    >>> t = np.arange(10_000) / 1000
    >>> angle = 2 * np.pi * (20 * t + t**2 / 4)
    >>> x = np.sin(12 * angle) + np.sin(17 * angle) + np.random.default_rng(1).standard_normal(t.size)
    >>> found = estimate_speed(x, rate_hz=1000, orders=[12, 17], speed_range_hz=(10, 30), max_acceleration_hz_s=2)
    >>> found.status, round(float(np.median(found.speed_hz)), 1)
    ('ok', 22.5)
    """
    signal = real_vector(x, name="the signal", minimum=64)
    rate = positive(rate_hz, name="rate_hz")
    listed = listed_orders(orders)
    low, high = _checked_range(speed_range_hz)
    acceleration = positive(max_acceleration_hz_s, name="max_acceleration_hz_s")
    duration = signal.size / rate
    if duration * high < _FEWEST_REVOLUTIONS:
        raise ValueError(
            f"the record lasts {duration:.3g} s, {duration * high:.3g} revolutions at the top of speed_range_hz, "
            f"{high:g} Hz; at least {_FEWEST_REVOLUTIONS:g} are needed. Record longer."
        )
    if listed[0] * low > rate / 2:
        raise ValueError(
            f"the lowest order, {listed[0]:g}, lies at {listed[0] * low:.4g} Hz or higher, beyond half of "
            f"rate_hz={rate:g}; list lower orders, or use a record of a higher rate."
        )
    if frame_s is None:
        most = min(duration / _FEWEST_FRAMES, max(_LONGEST_FRAME_S, _FEWEST_SAMPLES / rate))
        frame = min(max(np.sqrt(_SMEAR / (acceleration * np.median(listed))), _FEWEST_SAMPLES / rate), most)
    else:
        frame = positive(frame_s, name="frame_s")
        if frame > duration / _FEWEST_FRAMES:
            raise ValueError(
                f"frame_s={frame:g} leaves fewer than {_FEWEST_FRAMES} frames of a record of {duration:.3g} s; "
                f"give at most {duration / _FEWEST_FRAMES:.3g}."
            )
    if frame * rate < _FEWEST_SAMPLES:
        raise ValueError(
            f"frames of {frame:.3g} s hold {frame * rate:.3g} samples at rate_hz={rate:g}; at least {_FEWEST_SAMPLES} "
            "are needed. Record longer, or give a longer frame_s."
        )

    tried: list[tuple[SpeedEstimate, Search]] = []

    def estimate(length_s: float, *, moving: bool = False) -> SpeedEstimate:
        search = search_speeds(signal, rate, listed, low, high, acceleration, length_s, moving=moving)
        one = _estimate(signal, rate, search)
        tried.append((one, search))
        return one

    shorter = [] if frame_s is not None else [part * frame for part in _FRAMES if part * frame * rate > _FEWEST_SAMPLES]
    found = _confirmed(estimate, float(frame), shorter)
    if found.status != "not found" and not any(one is found and _moves(one, search) for one, search in tried):
        found = _surer(found, _confirmed(partial(estimate, moving=True), float(frame), shorter))
    if found.status == "ambiguous":
        found = _decided(signal, rate, found, _distinct([one for one, _ in tried]), (low, high))
    return _from(_proven(signal, rate, found, (low, high)), start_s)


def _proven(signal: Array, rate: float, found: SpeedEstimate, range_hz: tuple[float, float]) -> SpeedEstimate:
    """Return an estimate, a sure one as ambiguous where its lines may be of no shaft, or its course of other lines."""
    if found.phase is None:
        return found
    doubt = _line_doubt(signal, rate, found, found.phase, range_hz)
    if doubt:
        return _doubted(found, doubt)
    start_s, stop_s = found.phase.start_s, found.phase.stop_s
    seconds = stop_s - start_s
    close = _AT_AN_END * seconds
    for first, last in strays(signal, rate, found.phase, found.orders):
        if first < start_s + close:
            start_s = max(start_s, last)
        elif last > stop_s - close:
            stop_s = min(stop_s, first)
        else:
            return _doubted(found, "in a part of the record a straight course of the speed explains as much")
    if stop_s - start_s < _LEAST_LEFT * seconds:
        return _doubted(found, "its lines show in less than half of the record")
    return _cut(found, found.phase, start_s, stop_s)


def _cut(found: SpeedEstimate, phase: ShaftPhase, start_s: float, stop_s: float) -> SpeedEstimate:
    """Return a sure estimate without the ends of its phase in which the speed is not known."""
    if (start_s, stop_s) == (phase.start_s, phase.stop_s):
        return found
    inside = (phase.times_s > start_s) & (phase.times_s < stop_s)
    times = np.concatenate([[start_s], phase.times_s[inside], [stop_s]])
    known = (found.times_s >= start_s) & (found.times_s <= stop_s)
    return replace(
        found,
        speed_hz=np.where(known, found.speed_hz, np.nan),
        std_hz=np.where(known, found.std_hz, np.nan),
        confidence=np.where(known, found.confidence, 0.0),
        phase=replace(phase, times_s=times, revolutions=phase.revolutions_at(times)),
    )


def _from(found: SpeedEstimate, start_s: float) -> SpeedEstimate:
    """Return the estimate of a record that starts at another time than zero."""
    phase = None if found.phase is None else replace(found.phase, times_s=found.phase.times_s + start_s)
    return replace(found, times_s=found.times_s + start_s, phase=phase)


def _moves(found: SpeedEstimate, search: Search) -> bool:
    """Return whether a sure speed keeps its evidence where steady lines are left out: a search without them is saved.

    That search would find the same lines. What a steady machine in the same record shows is then a rival already.
    """
    if found.status != "ok":
        return False
    seen = np.isfinite(found.speed_hz)
    left = replace(search, evidence=without_steady_lines(search.evidence)).score(found.speed_hz, seen)
    return float(left.sum()) > _KEPT * float(found.shown.sum())


def _distinct(tried: Sequence[SpeedEstimate]) -> list[tuple[Array, Array, float]]:
    """Return all paths that were found, each once: times, speeds, and half the length of its frames in s."""
    paths: list[tuple[Array, Array, float]] = []
    for one in tried:
        for speed in (one.speed_hz, *(other.speed_hz for other in one.alternatives)):
            known = np.isfinite(speed)
            if np.count_nonzero(known) < _SHORTEST_RUN:
                continue
            path = one.times_s[known], speed[known], float(one.times_s[0])
            if not any(_same_path(path, other) for other in paths):
                paths.append(path)
    return paths


def _same_path(one: tuple[Array, Array, float], other: tuple[Array, Array, float]) -> bool:
    """Return whether a path is another one in nearly all of its frames."""
    times, speed, _ = one
    near = np.abs(speed / np.interp(times, other[0], other[1], np.nan, np.nan) - 1) < SAME_SPEED
    return bool(np.mean(near) > _SAME_PATH)


def _line_doubt(
    signal: Array, rate: float, found: SpeedEstimate, phase: ShaftPhase, range_hz: tuple[float, float]
) -> str:
    """Return why the lines of a sure speed over the whole record may be another's, empty where nothing says so."""
    sharp = sharp_lines(signal, rate, phase, found.orders, range_hz=range_hz)
    if sharp.joint < _ONE_LINE_DB and found.orders.size > 1:
        return "over the whole record a single one of its lines is where the speed puts it"
    if sharp.rival > _AS_SHARP * sharp.joint:
        return "over the whole record another speed, in a ratio of two orders, has as many sharp lines"
    times, known = np.linspace(phase.start_s, phase.stop_s, found.times_s.size), np.isfinite(found.std_hz)
    std = np.interp(times, found.times_s[known], found.std_hz[known])
    if one_tone(signal, rate, phase, std, found.orders):
        return "its lines keep one frequency, and may be one tone with harmonics, of no shaft"
    return ""


def _doubted(found: SpeedEstimate, reason: str) -> SpeedEstimate:
    """Return a sure estimate as ambiguous for a reason."""
    confidence = np.minimum(found.confidence, 0.5)
    return replace(found, status="ambiguous", confidence=confidence, phase=None, phase_std_rev=np.nan, reason=reason)


def _decided(
    signal: Array,
    rate: float,
    found: SpeedEstimate,
    paths: Sequence[tuple[Array, Array, float]],
    range_hz: tuple[float, float],
) -> SpeedEstimate:
    """Return an ambiguous estimate as what the angle domain decides for, where it does."""
    stop_s = (signal.size - 1) / rate
    rough = [_integrated(times, speed, half_frame=half, stop_s=stop_s) for times, speed, half in paths]
    decision = decide(signal, rate, rough, found.orders, range_hz=range_hz)
    if decision is None or (phase := decision.refined.phase) is None:
        return found
    refined = decision.refined
    seen = (found.times_s >= phase.start_s) & (found.times_s <= phase.stop_s)
    speed = phase.speed_hz(np.clip(found.times_s, phase.start_s, phase.stop_s))
    return replace(
        found,
        status="ok",
        speed_hz=np.where(seen, speed, np.nan),
        std_hz=np.where(seen, np.interp(found.times_s, refined.times_s, refined.std_hz), np.nan),
        confidence=np.where(seen, decision.probability, 0.0),
        alternatives=(),
        shown=decision.followed.scores,
        phase=phase,
        phase_std_rev=float(np.median(refined.phase_std_rev)),
        reason="",
    )


def _confirmed(estimate: Callable[[float], SpeedEstimate], frame_s: float, shorter_s: Sequence[float]) -> SpeedEstimate:
    """Return the estimate of some frame length, or a surer one of shorter frames that find the same speed.

    It is ambiguous where all shorter frames that find a shaft find another speed, where some are as sure of one, and
    where frames that find the same speed hold a rival for more likely.
    """
    first = estimate(frame_s)
    sure, other_speed = first.status == "ok", None
    if first.status == "not found":
        return first
    for length in shorter_s:
        other = estimate(length)
        if _agree(first, other):
            if sure or other.status == "ok":
                found, beside = (first, other) if sure else (other, first)
                return beside if _outweighed(beside) else found
        elif not sure:
            return first
        elif other.status == "ok":
            return _contradicted(first, other)
        elif other.status == "ambiguous":
            other_speed = other_speed or other
    return _contradicted(first, other_speed) if sure and other_speed is not None else first


def _outweighed(one: SpeedEstimate) -> bool:
    """Return whether a rival is more likely than the speed that was found."""
    return any(rival.probability > 0.5 for rival in one.alternatives)  # noqa: PLR2004


def _surer(found: SpeedEstimate, moving: SpeedEstimate) -> SpeedEstimate:
    """Return the estimate from all lines, or that from the lines that move where it is the surer one.

    It is where the first is ambiguous. Of two frame lengths that differ in a part of the record it decides by agreeing
    with either; two speeds that all lines are as sure of are a contradiction that fewer lines cannot resolve.
    """
    if moving.status != "ok":
        return found
    if found.status == "ok":
        return found if _agree(found, moving, share=0.5) else _contradicted(found, moving)
    if found.reason != _CONTRADICTION:
        return moving
    other = replace(found, speed_hz=found.alternatives[0].speed_hz)
    strays = abs(found.alternatives[0].ratio - 1) < SAME_SPEED
    return moving if strays and (_agree(found, moving) or _agree(other, moving)) else found


def _agree(one: SpeedEstimate, other: SpeedEstimate, *, share: float = _AGREEING) -> bool:
    """Return whether two estimates of a record are of one speed, in some share of the frames."""
    seen = np.isfinite(one.speed_hz)
    there = np.isfinite(other.speed_hz) & (other.times_s >= one.times_s[0]) & (other.times_s <= one.times_s[-1])
    if not seen.any() or not there.any():
        return False
    at = other.times_s[there]
    speed, std = (np.interp(at, one.times_s[seen], values[seen]) for values in (one.speed_hz, one.std_hz))
    reach = np.maximum(SAME_SPEED * speed, 3 * np.hypot(std, other.std_hz[there]))
    return bool(np.mean(np.abs(other.speed_hz[there] - speed) <= reach) >= share)


def _contradicted(found: SpeedEstimate, other: SpeedEstimate) -> SpeedEstimate:
    """Return an estimate as ambiguous, since another in frames of another length is as sure of another speed."""
    seen = np.isfinite(other.speed_hz)
    speed = np.interp(found.times_s, other.times_s[seen], other.speed_hz[seen], left=np.nan, right=np.nan)
    ratio = float(np.nanmedian(speed / found.speed_hz))
    rival = Alternative(speed_hz=speed, ratio=ratio, probability=0.5)
    return replace(_doubted(found, _CONTRADICTION), alternatives=(rival,))


def _checked_range(speed_range_hz: tuple[float, float]) -> tuple[float, float]:
    """Return the ends of the range, or raise where it is empty."""
    low, high = speed_range_hz
    low, high = positive(low, name="the lower end of speed_range_hz"), positive(high, name="its upper end")
    if low >= high:
        raise ValueError(f"speed_range_hz={speed_range_hz!r} is empty; give the lower end first.")
    return low, high


def _estimate(signal: Array, rate: float, search: Search) -> SpeedEstimate:
    """Return the estimate from the search: posterior, path, rivals, and the phase where it is unambiguous."""
    from signals.shaft._line_likelihood_kernels import most_likely_path, posterior  # noqa: PLC0415

    frames = search.evidence.times_s.size
    likelihood = np.exp(np.minimum(search.votes, 300.0))
    probability, absent, evidence = posterior(likelihood, search.kernel, 1 / frames)
    seen = longest_run(absent < 0.5)  # noqa: PLR2004
    path = search.speeds[most_likely_path(search.votes, np.log(search.kernel))]
    if evidence < CERTAIN or np.count_nonzero(seen) < _SHORTEST_RUN:
        return _not_found(search, evidence)
    scores = search.score(path, seen)
    same_speed = np.abs(search.speeds - path[:, None]) <= search.width(path, scores)[:, None]
    near = np.where(same_speed, probability, 0.0)
    confidence = near.sum(axis=1)
    weight = np.maximum(confidence, 1e-300)
    mean = np.where(confidence > 0, near @ search.speeds / weight, path)
    # with the variance of the uniform distribution within a step of the grid
    std = np.sqrt(((search.speeds - mean[:, None]) ** 2 * near).sum(axis=1) / weight + search.spacing**2 / 12)
    shown = search.score(mean, seen)
    others = [
        other
        for other in rivals(search, mean, seen, shown)
        if other.odds > 1 or low_family(search, shown) or _can_be_followed(signal, rate, search, other.speed, seen)
    ]
    total = 1 + sum(other.odds for other in others)
    share = 1 / total
    single = single_line(search, float(np.median(mean[seen])), beyond_harmonics(search, shown))
    if single:
        share /= search.orders.size
    slower, foreign = slower_shaft(search, float(np.median(mean[seen])), shown), no_mesh_shows(search, shown)
    phase, phase_std = None, np.nan
    if not others and not single and slower is None and not foreign:
        phase, mean, std, phase_std = _refined(signal, rate, search, mean, std, seen, shown)
    reason = ""
    if phase is None:
        share, speed_hz = min(share, 0.5), float(np.median(mean[seen]))
        reason = _doubt(others, single=single, foreign=foreign, slower_hz=slower, speed_hz=speed_hz)
    alternatives = tuple(
        Alternative(
            speed_hz=other.speed,
            ratio=float(np.median(other.speed[seen] / mean[seen])),
            probability=other.odds / total,
        )
        for other in others
    )
    if slower is not None and not any(
        abs(one.ratio * np.median(mean[seen]) / slower - 1) < SAME_SPEED for one in alternatives
    ):
        ratio = slower / float(np.median(mean[seen]))
        alternatives += (
            Alternative(speed_hz=np.where(seen, mean * ratio, np.nan), ratio=ratio, probability=1 - share),
        )
    return SpeedEstimate(
        status="ambiguous" if phase is None else "ok",
        times_s=search.evidence.times_s,
        speed_hz=np.where(seen, mean, np.nan),
        std_hz=np.where(seen, std, np.nan),
        confidence=confidence * share,
        alternatives=alternatives,
        orders=search.orders,
        shown=shown,
        evidence=float(evidence),
        phase=phase,
        phase_std_rev=float(phase_std),
        reason=reason,
    )


def _can_be_followed(signal: Array, rate: float, search: Search, speed: Array, seen: NDArray[np.bool_]) -> bool:
    """Return whether a rival's harmonics hold together in phase: a patchwork of other lines does not."""
    path = np.where(seen, speed, np.nan)
    scores = search.score(path, seen)
    std = np.full(speed.size, search.spacing)
    return _refined(signal, rate, search, path, std, seen, scores)[0] is not None


def _doubt(others: list[Rival], *, single: bool, foreign: bool, slower_hz: float | None, speed_hz: float) -> str:
    """Return why a speed is ambiguous, the strongest reason."""
    if foreign:
        return "only harmonics of one shaft show, which may be another machine's: none of the other orders does"
    if others:
        return (
            f"{len(others)} other speeds explain lines that it does not"
            if len(others) > 1
            else ("another speed explains lines that it does not")
        )
    if single:
        return "nearly all of the evidence rests on a single order"
    if slower_hz is not None:
        return (
            f"only its first harmonics show, which a shaft at {slower_hz:.4g} rev/s, {slower_hz / speed_hz:.3g} times "
            "it and in the range, may have too"
        )
    return "the phase of its harmonics cannot be followed surely through the record"


def _not_found(search: Search, evidence: float) -> SpeedEstimate:
    """Return the estimate of a record without a shaft."""
    none = np.full(search.evidence.times_s.size, np.nan)
    return SpeedEstimate(
        status="not found",
        times_s=search.evidence.times_s,
        speed_hz=none,
        std_hz=none,
        confidence=np.zeros(none.size),
        alternatives=(),
        orders=search.orders,
        shown=np.zeros(search.orders.size),
        evidence=float(evidence),
        phase=None,
        phase_std_rev=np.nan,
        reason="no shaft shows against noise",
    )


def _refined(
    signal: Array, rate: float, search: Search, speed: Array, std: Array, seen: NDArray[np.bool_], shown: Array
) -> tuple[ShaftPhase | None, Array, Array, float]:
    """Return the phase refined from the harmonics, its speed and standard deviations; None where they are too weak."""
    times = search.evidence.times_s
    rough = _integrated(times[seen], speed[seen], half_frame=search.frame_s / 2, stop_s=(signal.size - 1) / rate)
    tolerance = float(np.median(std[seen] / speed[seen]))
    for refined, phase in sure_refinements(signal, rate, rough, search.orders, shown, tolerance=tolerance):
        refined_speed = phase.speed_hz(np.clip(times, phase.start_s, phase.stop_s))
        error = np.interp(times, refined.times_s, refined.std_hz)
        extrapolated = (times < refined.times_s[0]) | (times > refined.times_s[-1])
        kept = search.score(refined_speed, seen).sum() > AS_MUCH * shown.sum()
        left = np.abs(refined_speed - speed)[seen] > _LEFT_STD * np.hypot(np.maximum(std, search.spacing), error)[seen]
        if kept and np.mean(left) <= _LEFT_SHARE:
            error[extrapolated] = std[extrapolated]
            return phase, refined_speed, error, float(np.median(refined.phase_std_rev))
    return None, speed, std, np.nan


def _integrated(times: Array, speed: Array, *, half_frame: float, stop_s: float) -> ShaftPhase:
    """Return the integral of the interpolated speeds, from the start of the first frame to the end of the last."""
    before, after = max(times[0] - half_frame, 0.0), times[-1] + half_frame
    if stop_s < after + half_frame:  # the record ends before another frame would
        after = stop_s
    ends = np.array([before, after])
    early, late = np.polyfit(times[:4], speed[:4], 1), np.polyfit(times[-4:], speed[-4:], 1)
    outer = np.maximum([np.polyval(early, before), np.polyval(late, after)], 0.5 * speed.min())
    knots = np.concatenate([ends[:1], times, ends[1:]])
    curve = PchipInterpolator(knots, np.concatenate([outer[:1], speed, outer[1:]])).antiderivative()
    return ShaftPhase(times_s=knots, revolutions=curve(knots))
