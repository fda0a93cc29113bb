"""Search for the speed of a shaft: log likelihoods of all orders in every frame, and courses through them.

In each short frame, each listed order gives a likelihood of each speed (`signals.shaft._line_likelihood`). The frames
form a hidden Markov model: the speed changes by no more than an acceleration allows, and the orders may disappear. A
course is a speed in every frame; rival courses are found by the same search without the speeds found before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import convolve1d

from signals.shaft._line_likelihood import (
    DC_BINS,
    Evidence,
    lowest_band,
    short_time_evidence,
    without_steady_lines,
)
from signals.shaft.phase import ShaftPhase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from signals._validation import Array

CERTAIN = np.log(1000.0)
SAME_SPEED = 0.01
_MOST_VOTES = 10**7  # frames x speeds, of which several arrays of 80 MB are made
_MISSED = 0.1  # prior probability that a frame contains no line of a rotating shaft


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
    """Speed in Hz in the frames that show a shaft, NaN in others, its standard deviation, and how likely they do."""

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
        if stop_s < after + half:  # the record ends before another frame would
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

    The step of the grid is half a bin of the highest order. Orders that no frame tells apart are one line, which counts
    once. With `moving`, lines of constant frequency are left out.
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
    steps = int(min(np.ceil((high - low) / spacing), _MOST_VOTES)) + 1
    speeds = low + spacing * np.arange(steps, dtype=np.float64)
    if speeds.size * evidence.times_s.size > _MOST_VOTES:
        raise ValueError(
            f"{speeds.size} speeds or more from {low:g} to {high:g} Hz in {evidence.times_s.size} frames are too many "
            "to search; give a narrower speed_range_hz, lower orders, or a shorter part of the record."
        )
    weights = 1 / np.count_nonzero(np.abs(orders[:, None] - orders) * high * frame_s < 0.5, axis=1)  # noqa: PLR2004
    votes = np.zeros((speeds.size, evidence.times_s.size))
    add_votes(evidence.log_votes(), evidence.bins_per_hz, orders, weights, speeds, DC_BINS, votes)
    # mixture: a frame may contain no line of a rotating shaft
    votes = np.ascontiguousarray(np.logaddexp(votes + np.log1p(-_MISSED), np.log(_MISSED)).T)
    reach = int(np.ceil(acceleration * (evidence.times_s[1] - evidence.times_s[0]) / spacing))
    most_work = 10**9  # frames x speeds x steps of acceleration: some seconds
    if reach * votes.size > most_work:
        raise ValueError(
            f"max_acceleration_hz_s={acceleration:g} lets the speed change by {reach} of {speeds.size} steps between "
            f"two of {evidence.times_s.size} frames, too many to search; give a smaller one, or a narrower "
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
    """Yield the most likely course and its rivals, nothing where no shaft shows against noise.

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
        # with the variance of the uniform distribution within a step of the grid
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

    `likelihood` (frames, speeds) is relative to that of an absent shaft. From one frame to the next the shaft appears
    or disappears, once a record on average; while present, its speed has the transition probabilities `kernel`, and
    probability beyond the range is lost.

    Returns the posterior of each speed in each frame (frames, speeds), that of an absent shaft (frames,), and the
    logarithm of the evidence relative to a shaft that is always absent.
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
    """Return the flags with only the longest run of true left."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    kept = np.zeros(flags.size, dtype=np.bool_)
    if edges.size:
        first = 2 * int(np.argmax(np.diff(edges)[::2]))
        kept[edges[first] : edges[first + 1]] = True
    return kept
