"""Search for the speed of a shaft: log likelihoods of all orders in every frame, and speed profiles through them.

In each short frame, each listed order gives a likelihood of each speed. The frames form a hidden Markov model: the
speed changes by no more than the acceleration allows, and the orders may disappear. A course is a speed in every frame;
rival courses are found by the same search without the speeds already found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import convolve1d
from scipy.special import gamma, gammainc

from signals.shaft.phase import ShaftPhase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from signals._validation import Array

# ---- Likelihood ratio of a line against noise, at every bin of a short-time spectrum ---------------------------------
# The power of noise, over its local mean, is exponentially distributed: density ``exp(-u)``. For a line of unknown
# signal-to-noise ratio the mean ``s`` has the prior density ``s^-2`` from 1 on, so
#
#     p_1(u) = integral_1^inf s^-3 exp(-u / s) ds = (1 - (1 + u) exp(-u)) / u^2.
#
# Every record has lines of other sources, and noise that is not white. A fraction of all bins, estimated from the
# record, is attributed to them, with the prior density ``s^-2.5``, since most are weaker. A single strong line is
# therefore weak evidence: it adds only the logarithm of its amplitude.

DC_BINS = 3.0  # bins reached by the leakage of an offset with a Hann window
PRESENT = 0.3  # prior probability of a line of an order in a frame
_SMOOTH = 3  # frames
_HIGH = 8.0  # times the mean, which noise exceeds once in 3000 bins
_TABLE = np.linspace(-4.0, 16.0, 4001)  # log of the power ratio


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Ratio of short-time power to local noise, ``ratios`` (bins, frames); `foreign` is the fraction of other lines."""

    ratios: Array
    times_s: Array
    bins_per_hz: float
    foreign: float

    def log_votes(self) -> Array:
        """Return the log likelihood ratio of an order that may be present at each bin, (bins, frames)."""
        table = np.log1p(PRESENT * np.expm1(_log_ratio(self.foreign)))
        return np.asarray(np.interp(np.log(np.maximum(self.ratios, 1e-9)), _TABLE, table))


def _scale_mixture(u: Array, power: float) -> Array:
    """Return the density of an exponential variable whose mean has the density ``power s^-(power + 1)`` from 1 on."""
    return np.asarray(power * gamma(power + 1) * gammainc(power + 1, u) / u ** (power + 1))


@lru_cache(maxsize=8)  # a search uses that of one record at every speed
def _log_ratio(foreign: float) -> Array:
    """Return the table of log p_1 / p_0 over the power ratio."""
    u = np.exp(_TABLE)
    noise = (1 - foreign) * np.exp(-u) + foreign * _scale_mixture(u, 1.5)
    return np.asarray(np.log(_scale_mixture(u, 1.0)) - np.log(noise))


def lowest_band(signal: Array, *, rate_hz: float, top_hz: float) -> tuple[Array, float]:
    """Return the signal without its mean, low-pass filtered at `top_hz` and decimated, and the new rate."""
    length = fft.next_fast_len(signal.size, real=True)
    # 1.25 times the retained band
    fewer = fft.next_fast_len(int(np.ceil(length * min(1.0, 2 * 1.25 * top_hz / rate_hz))), real=True)
    level = signal - signal.mean()
    if fewer >= length:
        return level, rate_hz
    lines = fft.rfft(level, length)[: fewer // 2 + 1]
    rate = rate_hz * fewer / length
    values = fft.irfft(lines, fewer)[: int(np.floor((signal.size - 1) * fewer / length)) + 1]
    return np.asarray(values * (fewer / length)), rate


def short_time_evidence(signal: Array, *, rate_hz: float, frame_s: float) -> Evidence:
    """Return the spectra of Hann frames with 50 % overlap, normalised by their noise.

    The noise at each bin is the median over a block of bins, over log 2, averaged over three frames and interpolated
    between blocks.
    """
    length = int(frame_s * rate_hz) // 2 * 2
    hop = length // 2
    frames = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(length) + 0.5) / length)
    padded = fft.next_fast_len(length, real=True)
    lines = fft.rfft(frames * window, padded, axis=1)
    power = np.ascontiguousarray((lines.real**2 + lines.imag**2).T)
    ratios = _normalised(power, first=int(np.ceil(DC_BINS * padded / length)))
    times = np.asarray((np.arange(frames.shape[0]) * hop + (length - 1) / 2) / rate_hz, dtype=np.float64)
    return Evidence(ratios=ratios, times_s=times, bins_per_hz=padded / rate_hz, foreign=_foreign(ratios))


def _foreign(ratios: Array) -> float:
    """Return the fraction of bins that hold lines."""
    count = np.count_nonzero(ratios > _HIGH)
    shares = (0.005, 0.3)
    return float(np.clip(count / ratios.size - np.exp(-_HIGH), *shares))


def without_steady_lines(evidence: Evidence) -> Evidence:
    """Return the evidence of lines that move between bins: each bin relative to its median over frames, if above one.

    A line that stays in a bin for half the record, like hum and machines at constant speed, counts as noise of that
    bin.
    """
    own = np.median(evidence.ratios, axis=1, keepdims=True) / np.log(2)
    ratios = evidence.ratios / np.maximum(own, 1.0)
    return replace(evidence, ratios=ratios, foreign=_foreign(ratios))


def _normalised(power: Array, *, first: int) -> Array:
    """Return the power (bins, frames) over its local noise; 1 where the noise is zero."""
    bins, frames = power.shape
    block = 24  # bins per median
    starts = np.unique(np.clip(np.arange(first, bins, block // 2), first, max(bins - block, first)))
    level = np.array([np.median(power[start : start + block], axis=0) for start in starts]) / np.log(2)
    silent = level <= 1e-20 * power.max(initial=0.0)  # rounding
    padded = np.pad(np.log(np.where(silent, 1.0, level)), ((0, 0), (_SMOOTH // 2, _SMOOTH // 2)), mode="edge")
    smooth = np.mean([padded[:, k : k + frames] for k in range(_SMOOTH)], axis=0)
    position = np.interp(np.arange(bins), starts + (block - 1) / 2, np.arange(starts.size, dtype=np.float64))
    low = np.minimum(position.astype(np.int64), max(starts.size - 2, 0))
    high = np.minimum(low + 1, starts.size - 1)
    part = (position - low)[:, None]
    noise = np.exp(smooth[low] + part * (smooth[high] - smooth[low]))
    return np.where(silent[low] | silent[high], 1.0, power / noise)


def log_line_ratio(ratios: Array, *, foreign: float) -> Array:
    """Return log p_1 / p_0 for normalised powers of any shape."""
    return np.asarray(np.interp(np.log(np.maximum(ratios, 1e-9)), _TABLE, _log_ratio(foreign)))


CERTAIN = np.log(1000.0)
SAME_SPEED = 0.01


@dataclass(frozen=True, kw_only=True)
class Search:
    """Grid of speeds, log likelihoods of all orders (`votes`, frames x speeds) and transition kernel."""

    evidence: Evidence
    orders: Array
    speeds: Array
    votes: Array
    kernel: Array
    frame_s: float


@dataclass(frozen=True, kw_only=True)
class Course:
    """Speed in Hz in the frames with a shaft, NaN in others, its standard deviation, and the probability of a shaft."""

    times_s: Array
    speed_hz: Array
    std_hz: Array
    probability: Array
    frame_s: float

    def phase(self, stop_s: float) -> ShaftPhase:
        """Return the integral of the interpolated speeds, from the start of the first frame to the end of the last."""
        seen = np.isfinite(self.speed_hz)
        times, speed, half = self.times_s[seen], self.speed_hz[seen], self.frame_s / 2
        before, after = max(times[0] - half, 0.0), times[-1] + half
        if stop_s < after + half:  # the record ends before the next frame
            after = stop_s
        early, late = np.polyfit(times[:4], speed[:4], 1), np.polyfit(times[-4:], speed[-4:], 1)
        outer = np.maximum([np.polyval(early, before), np.polyval(late, after)], 0.5 * speed.min())
        knots = np.concatenate([[before], times, [after]])
        curve = PchipInterpolator(knots, np.concatenate([outer[:1], speed, outer[1:]])).antiderivative()
        return ShaftPhase(times_s=knots, revolutions=curve(knots))

    def is_of(self, other: Course) -> bool:
        """Return whether another course has the same speed in nearly all frames of this one."""
        there = np.isfinite(other.speed_hz)
        near = np.interp(self.times_s, other.times_s[there], other.speed_hz[there], np.nan, np.nan)
        seen = np.isfinite(self.speed_hz)
        return bool(np.mean(np.abs(self.speed_hz / near - 1)[seen] < SAME_SPEED) > 0.95)  # noqa: PLR2004


def search_speeds(
    signal: Array,
    rate: float,
    orders: Array,
    low: float,
    high: float,
    acceleration: float,
    frame_s: float,
    *,
    moving: bool = False,
) -> Search:
    """Sum the log likelihood ratios of all orders, for every frame and every speed of a grid.

    The step of the grid is half a bin of the highest order. Orders that no frame resolves count as one line. With
    `moving`, lines of constant frequency are left out.
    """
    from signals.shaft._kernels import add_votes  # noqa: PLC0415

    surroundings_bins = 40
    top = min(float(orders[-1]) * high + surroundings_bins / frame_s, rate / 2)
    band, band_rate = lowest_band(signal, rate_hz=rate, top_hz=top)
    evidence = short_time_evidence(band, rate_hz=band_rate, frame_s=frame_s)
    if moving:
        evidence = without_steady_lines(evidence)
    highest = min(float(orders[-1]), band_rate / 2 / low)
    spacing = 0.5 / (frame_s * highest)
    most_votes = 10**7  # frames x speeds, in several arrays of 80 MB
    steps = int(min(np.ceil((high - low) / spacing), most_votes)) + 1
    speeds = low + spacing * np.arange(steps, dtype=np.float64)
    if speeds.size * evidence.times_s.size > most_votes:
        raise ValueError(
            f"at least {speeds.size} speeds from {low:g} to {high:g} Hz in {evidence.times_s.size} frames are too many "
            "to search; give a narrower speed_range_hz, lower orders, or a shorter part of the record."
        )
    weights = 1 / np.count_nonzero(np.abs(orders[:, None] - orders) * high * frame_s < 0.5, axis=1)  # noqa: PLR2004
    votes = np.zeros((speeds.size, evidence.times_s.size))
    add_votes(evidence.log_votes(), evidence.bins_per_hz, orders, weights, speeds, DC_BINS, votes)
    missed = 0.1  # prior probability that a frame contains no line of a rotating shaft
    votes = np.ascontiguousarray(np.logaddexp(votes + np.log1p(-missed), np.log(missed)).T)
    reach = int(np.ceil(acceleration * (evidence.times_s[1] - evidence.times_s[0]) / spacing))
    most_work = 10**9  # frames x speeds x steps of acceleration: some seconds
    if reach * votes.size > most_work:
        raise ValueError(
            f"max_acceleration_hz_s={acceleration:g} allows the speed to change by {reach} of {speeds.size} steps "
            f"between two of {evidence.times_s.size} frames, too many to search; give a smaller one, or a narrower "
            "speed_range_hz."
        )
    kernel = 1 - (np.arange(-reach, reach + 1) / (reach + 1)) ** 2
    return Search(
        evidence=evidence, orders=orders, speeds=speeds, votes=votes, kernel=kernel / kernel.sum(), frame_s=frame_s
    )


def most_likely_speeds(votes: Array, search: Search) -> Array:
    """Return the speeds of the Viterbi path through log likelihoods of the speeds of a search, (frames,)."""
    from signals.shaft._kernels import most_likely_path  # noqa: PLC0415

    return np.asarray(search.speeds[most_likely_path(votes, np.log(search.kernel))])


def courses(search: Search) -> Iterator[Course]:
    """Yield the most likely course and its rivals; nothing if no shaft rises above the noise.

    For white noise in independent frames the mean of the evidence ratio is one, so that it exceeds 1000 in at most one
    record in a thousand (Markov's inequality).
    """
    probability, absent, evidence = _posterior(np.exp(np.minimum(search.votes, 300.0)), search.kernel)
    seen = _longest_run(absent < 0.5)  # noqa: PLR2004
    shortest_run = 4  # frames
    if evidence < CERTAIN or np.count_nonzero(seen) < shortest_run:
        return
    votes, chosen = search.votes[seen].copy(), probability[seen]
    spacing = float(search.speeds[1] - search.speeds[0])
    never = -50.0
    for _ in range(2):
        path = most_likely_speeds(votes, search)
        width = np.maximum(SAME_SPEED * path, 2 / (search.frame_s * float(search.orders[-1])))
        same_speed = np.abs(search.speeds - path[:, None]) <= width[:, None]
        votes[same_speed] = never
        near = np.where(same_speed, chosen, 0.0)
        total = near.sum(axis=1)
        weight = np.maximum(total, 1e-300)
        mean = np.where(total > 0, near @ search.speeds / weight, path)
        # including the variance of a uniform distribution within a step of the grid
        variance = ((search.speeds - mean[:, None]) ** 2 * near).sum(axis=1) / weight + spacing**2 / 12
        yield Course(
            times_s=search.evidence.times_s,
            speed_hz=_placed(mean, seen),
            std_hz=_placed(np.sqrt(variance), seen),
            probability=np.where(seen, 1 - absent, 0.0),
            frame_s=search.frame_s,
        )


def _posterior(likelihood: Array, kernel: Array) -> tuple[Array, Array, float]:
    """Forward-backward algorithm of the hidden Markov model: posterior probabilities and evidence.

    `likelihood` (frames, speeds) is relative to that of an absent shaft. Between frames the shaft may appear or
    disappear, once per record on average; while present, its speed has the transition probabilities `kernel`, and
    probability beyond the range is lost.

    Return the posterior of each speed in each frame (frames, speeds), that of an absent shaft (frames,), and the log
    evidence relative to a shaft that is always absent.
    """
    frames, n = likelihood.shape
    switch, evidence = 1 / frames, 0.0
    present, absent = np.empty_like(likelihood), np.empty(frames)
    prior, none = np.full(n, 0.5 / n), 0.5
    for t in range(frames):
        joint = prior * likelihood[t]
        total = joint.sum() + none
        present[t], absent[t] = joint / total, none / total
        evidence += float(np.log(total))
        prior = (1 - switch) * convolve1d(present[t], kernel, mode="constant") + switch * absent[t] / n
        none = (1 - switch) * absent[t] + switch * present[t].sum()
    later, later_absent = np.ones(n), 1.0
    for t in range(frames - 2, -1, -1):
        seen, gone = later * likelihood[t + 1], later_absent
        later = (1 - switch) * convolve1d(seen, kernel, mode="constant") + switch * gone
        later_absent = (1 - switch) * gone + switch * seen.mean()
        largest = max(later.max(), later_absent)
        later, later_absent = later / largest, later_absent / largest
        present[t] *= later
        absent[t] *= later_absent
        total = present[t].sum() + absent[t]
        present[t] /= total
        absent[t] /= total
    return present, absent, evidence


def _placed(values: Array, seen: NDArray[np.bool_]) -> Array:
    found = np.full(seen.size, np.nan)
    found[seen] = values
    return found


def _longest_run(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return only the longest run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    kept = np.zeros(flags.size, dtype=np.bool_)
    if edges.size:
        first = 2 * int(np.argmax(np.diff(edges)[::2]))
        kept[edges[first] : edges[first + 1]] = True
    return kept
