"""Shaft speed without a tachometer: the probability of every speed, given all orders of the gearbox.

Each listed order tells, in each short frame of the record, how likely each speed is: a line stands at order times
speed, or none does (Leclere, Andre & Antoni 2016, "A multi-order probabilistic approach for instantaneous angular
speed tracking"). The frames are a hidden Markov chain: the speed moves by no more than the declared acceleration
allows, and the shaft may stop showing. Its posterior gives the confidence; its evidence tells whether there is a shaft
at all: for level noise in independent frames its mean is one, so it passes 1000 in at most one record in a thousand
(Markov). Noise with peaks narrower than the bins it is levelled over passes more often; those are called ambiguous.

What else would explain the record nearly as well is looked for too: the same search with the found speeds taken out.
The phase is then refined from the harmonics that show (`signals.phase_demodulation`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from signals._checks import Array, positive, real_vector
from signals._speed_search import CERTAIN, SHOWS, Search, longest_run, rivals, search_speeds, stands_alone
from signals.phase import ShaftPhase
from signals.phase_demodulation import listed_orders, refine_phase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

_FEWEST_FRAMES, _FEWEST_REVOLUTIONS = 8, 10.0
_SHORTEST_RUN = 4
_LONGEST_FRAME_S = 2.0
_SMEAR = 4.0  # bins a middle order may move within a frame at the largest acceleration
_MOST_DEMODULATED = 8
_WINDOW_REV = 6.0
_FEWEST_SAMPLES = 64  # a frame


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Another speed that explains the record about as well."""

    speed_hz: Array = field(metadata={"dims": ("frame",), "units": "Hz"})
    ratio: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class SpeedEstimate:
    """Speed of a shaft against time, and how sure it is.

    ``speed_hz`` and ``std_hz`` are NaN in frames that do not show the shaft, and everywhere if it is not found.
    ``confidence`` is the probability, frame by frame, that the shaft shows and turns within 1 % (or the resolution) of
    ``speed_hz``; at most a half where that is ambiguous. ``shown`` tells, for each of ``orders``, the log of the
    evidence that it shows.

    If "ambiguous" there is no phase, and ``alternatives`` are what else it may be; a narrower range of speeds or
    further orders decide. It is "ambiguous" without alternatives if nearly all evidence is one order's where several
    were listed (a single line may be any order, or another machine's), or if the harmonics cannot be followed.
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
    x : (n,) array, any unit
        Vibration; finite.
    rate_hz : float
        Samples a second.
    orders : sequence of float
        Orders the vibration may hold, per revolution of the wanted shaft: mesh orders and their multiples, the shaft
        itself. Orders that do not show cost little; orders close to each other help least.
    speed_range_hz : (low, high)
        Where the speed lies while the shaft shows.
    max_acceleration_hz_s : float
        How fast the speed may change, in Hz a second.
    frame_s : float, optional
        Length of the frames. Default: such that the middle order moves by at most 4 bins within one, and at most an
        eighth of the record or 2 s.
    start_s : float
        Time of the first sample.

    Returns
    -------
    SpeedEstimate

    Raises
    ------
    ValueError
        A record of too few revolutions, orders beyond half the sampling rate, values that are not finite.
    """
    signal = real_vector(x, name="the signal", minimum=64)
    rate = positive(rate_hz, name="rate_hz")
    wanted = listed_orders(orders)
    low, high = _checked_range(speed_range_hz)
    acceleration = positive(max_acceleration_hz_s, name="max_acceleration_hz_s")
    duration = signal.size / rate
    if duration * high < _FEWEST_REVOLUTIONS:
        raise ValueError(
            f"the record lasts {duration:.3g} s, {duration * high:.3g} revolutions at the top of speed_range_hz, "
            f"{high:g} Hz; at least {_FEWEST_REVOLUTIONS:g} are needed. Record longer."
        )
    if wanted[0] * low > rate / 2:
        raise ValueError(
            f"the lowest order, {wanted[0]:g}, lies at {wanted[0] * low:.4g} Hz or higher, beyond half of "
            f"rate_hz={rate:g}; list lower orders, or use a record of a higher rate."
        )
    if frame_s is None:
        most = min(duration / _FEWEST_FRAMES, max(_LONGEST_FRAME_S, _FEWEST_SAMPLES / rate))
        frame = min(max(np.sqrt(_SMEAR / (acceleration * np.median(wanted))), _FEWEST_SAMPLES / rate), most)
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
    search = search_speeds(signal, rate, wanted, low, high, acceleration, float(frame))
    return _estimate(signal, rate, search, start_s)


def _checked_range(speed_range_hz: tuple[float, float]) -> tuple[float, float]:
    low, high = speed_range_hz
    low, high = positive(low, name="the lower end of speed_range_hz"), positive(high, name="its upper end")
    if low >= high:
        raise ValueError(f"speed_range_hz={speed_range_hz!r} is empty; give the lower end first.")
    return low, high


def _estimate(signal: Array, rate: float, search: Search, start_s: float) -> SpeedEstimate:
    from signals._speed_kernels import likeliest_path, posterior  # noqa: PLC0415

    frames = search.evidence.times_s.size
    likelihood = np.exp(np.minimum(search.votes, 300.0))
    probability, unseen, evidence = posterior(likelihood, search.kernel, 1 / frames)
    seen = longest_run(unseen < 0.5)  # noqa: PLR2004
    path = search.speeds[likeliest_path(search.votes, np.log(search.kernel))]
    if evidence < CERTAIN or np.count_nonzero(seen) < _SHORTEST_RUN:
        return _nothing(search, evidence, start_s)
    scores = search.score(path, seen)
    around = np.abs(search.speeds - path[:, None]) <= search.width(path, scores)[:, None]
    near = np.where(around, probability, 0.0)
    confidence = near.sum(axis=1)
    weight = np.maximum(confidence, 1e-300)
    mean = np.where(confidence > 0, near @ search.speeds / weight, path)
    # half the spacing even where one speed of the grid takes it all
    std = np.sqrt(((search.speeds - mean[:, None]) ** 2 * near).sum(axis=1) / weight + search.spacing**2 / 12)
    shown = search.score(mean, seen)
    others = rivals(search, mean, seen, shown)
    total = 1 + sum(other.odds for other in others)
    share = 1 / total
    alone = stands_alone(search, float(np.median(mean[seen])), shown)
    if alone:
        share /= search.orders.size
    phase, phase_std = None, np.nan
    if not others and not alone:
        phase, mean, std, phase_std = _followed(signal, rate, search, mean, std, seen, shown)
    if phase is None:
        share = min(share, 0.5)
    return SpeedEstimate(
        status="ambiguous" if phase is None else "ok",
        times_s=search.evidence.times_s + start_s,
        speed_hz=np.where(seen, mean, np.nan),
        std_hz=np.where(seen, std, np.nan),
        confidence=confidence * share,
        alternatives=tuple(
            Alternative(
                speed_hz=other.speed,
                ratio=float(np.median(other.speed[seen] / mean[seen])),
                probability=other.odds / total,
            )
            for other in others
        ),
        orders=search.orders,
        shown=shown,
        evidence=float(evidence),
        phase=None if phase is None else _later(phase, start_s),
        phase_std_rev=float(phase_std),
    )


def _later(phase: ShaftPhase, start_s: float) -> ShaftPhase:
    return ShaftPhase(times_s=phase.times_s + start_s, revolutions=phase.revolutions, jitter_s=phase.jitter_s)


def _nothing(search: Search, evidence: float, start_s: float) -> SpeedEstimate:
    none = np.full(search.evidence.times_s.size, np.nan)
    return SpeedEstimate(
        status="not found",
        times_s=search.evidence.times_s + start_s,
        speed_hz=none,
        std_hz=none,
        confidence=np.zeros(none.size),
        alternatives=(),
        orders=search.orders,
        shown=np.zeros(search.orders.size),
        evidence=float(evidence),
        phase=None,
        phase_std_rev=np.nan,
    )


def _followed(
    signal: Array, rate: float, search: Search, speed: Array, std: Array, seen: NDArray[np.bool_], shown: Array
) -> tuple[ShaftPhase | None, Array, Array, float]:
    """Phase over the frames that show the shaft by its harmonics, if they can be followed; with speed and std by it."""
    times = search.evidence.times_s
    rough = _integrated(times[seen], speed[seen], half_frame=search.frame_s / 2, stop_s=(signal.size - 1) / rate)
    tolerance = float(np.median(std[seen] / speed[seen]))
    worth = shown * (shown > SHOWS)
    strongest = np.sort(search.orders[np.argsort(-worth)[: min(_MOST_DEMODULATED, np.count_nonzero(worth))]])
    window = min(_WINDOW_REV, float(rough.revolutions[-1] - rough.revolutions[0]) / 3)
    try:  # refused where speeds of single frames are too rough for windows of several revolutions
        refined = refine_phase(
            signal, rate_hz=rate, phase=rough, orders=strongest.tolist(), tolerance=tolerance, window_rev=window
        )
    except ValueError:
        refined = None
    if refined is None or refined.phase is None:
        return None, speed, std, np.nan
    phase = refined.phase
    inside = np.clip(times, phase.start_s, phase.stop_s)
    error = np.interp(times, refined.times_s, refined.std_hz)
    carried_on = (times < refined.times_s[0]) | (times > refined.times_s[-1])
    error[carried_on] = std[carried_on]
    return phase, phase.speed_hz(inside), error, float(np.median(refined.phase_std_rev))


def _integrated(times: Array, speed: Array, *, half_frame: float, stop_s: float) -> ShaftPhase:
    """Phase whose slope runs through the speeds, from the first frame's start to the last one's end or the record's."""
    before, after = max(times[0] - half_frame, 0.0), times[-1] + half_frame
    if stop_s < after + half_frame:  # no room for another frame
        after = stop_s
    ends = np.array([before, after])
    early, late = np.polyfit(times[:4], speed[:4], 1), np.polyfit(times[-4:], speed[-4:], 1)
    outer = np.maximum([np.polyval(early, before), np.polyval(late, after)], 0.5 * speed.min())
    knots = np.concatenate([ends[:1], times, ends[1:]])
    curve = PchipInterpolator(knots, np.concatenate([outer[:1], speed, outer[1:]])).antiderivative()
    return ShaftPhase(times_s=knots, revolutions=curve(knots))
