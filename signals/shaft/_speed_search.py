"""Search for the speed of a shaft: log likelihoods of all orders in every frame, and paths through them.

In each short frame, each listed order gives a likelihood of each speed (`signals.shaft._line_likelihood`). A path is a
speed in every frame; rival paths are found by the same search without the speeds found before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from signals.shaft._line_likelihood import (
    DC_BINS,
    Evidence,
    log_line_ratio,
    lowest_band,
    order_scores,
    short_time_evidence,
    without_steady_lines,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals._validation import Array

CERTAIN = np.log(1000.0)
_MOST_VOTES = 10**7  # frames x speeds, of which several arrays of 80 MB are made
_MOST_WORK = 10**9  # frames x speeds x steps of acceleration: some seconds
MISSED = 0.1  # prior probability that a frame contains no line of a rotating shaft
_SURROUNDINGS_BINS = 40
_RIVALS = 4
_LEAST_ODDS = 20.0  # of the found speed against another, to be unambiguous
# ratio of scores that has these odds: lines of other machines are not independent noise. Of low whole orders alone,
# which a louder machine or the mains may make, a third is enough to doubt
_TEMPERING, _TEMPERING_FAMILY = 0.5, 0.7
SAME_LINE = 2.0  # bins
_ONE_LINE = 0.5  # bins at top speed, within which two orders have the same power in every frame
_SUPPORT = 0.1  # least sum of all other scores over that of the strongest order
SHOWS = 3.0  # least score of a significant order
SAME_SPEED = 0.01
_LOW_ORDERS, _FAMILY = 10, 3  # whole orders below which this many lines in a row may be harmonics of anything
_NEVER = -50.0
AS_MUCH = 0.92  # of the evidence for a line: half a bin costs 7 %, and a search favours bins
MAINS_HZ, MAINS_HARMONICS = (50.0, 60.0), 7  # hum above the seventh is seldom louder than the machine (our choice)


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another path, and its odds against the first."""

    speed: Array
    odds: float


@dataclass(frozen=True, kw_only=True)
class Search:
    """Grid of speeds, log likelihoods of all orders (`votes`, frames x speeds) and transition kernel.

    Orders that no frame tells apart are one line, which counts once: their `weights` are one over their number.
    """

    evidence: Evidence
    orders: Array
    weights: Array
    speeds: Array
    votes: Array
    kernel: Array
    frame_s: float

    def score(self, speed: Array, frames: NDArray[np.bool_]) -> Array:
        """Return the log evidence for each order along a path, in the frames flagged."""
        return self.weights * order_scores(self.levels(speed, frames))

    def levels(self, speed: Array, frames: NDArray[np.bool_]) -> Array:
        """Return the log likelihood ratio of a line of each order along a path, (frames flagged, orders)."""
        bins, _ = self.evidence.ratios.shape
        column = np.flatnonzero(frames)
        position = np.outer(speed[column], self.orders) * self.evidence.bins_per_hz
        known = (position >= DC_BINS) & (position < bins - 1)
        low = np.where(known, position, 0).astype(np.int64)
        part = np.where(known, position, 0) - low
        ratios = self.evidence.ratios
        power = ratios[low, column[:, None]] * (1 - part) + ratios[low + 1, column[:, None]] * part
        return np.where(known, log_line_ratio(power, foreign=self.evidence.foreign), 0.0)

    def line_level(self, speed_hz: float) -> Array:
        """Return the largest power over the noise at each order of a constant speed, over all frames."""
        bins = np.rint(self.orders * speed_hz * self.evidence.bins_per_hz).astype(np.int64)
        return np.asarray(self.evidence.ratios[np.minimum(bins, len(self.evidence.ratios) - 1)].max(axis=1))

    @property
    def spacing(self) -> float:
        """Step of the grid of speeds in Hz."""
        return float(self.speeds[1] - self.speeds[0])

    def width(self, path: Array, scores: Array) -> Array:
        """Return half the width of one speed: 1 %, or the half main lobe of the mean significant order."""
        weights = np.maximum(scores, 1e-3)
        return np.maximum(SAME_SPEED * path, 2 / (self.frame_s * np.average(self.orders, weights=weights)))


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

    The step of the grid is half a bin of the highest order. With `moving`, lines of constant frequency are left out.
    """
    from signals.shaft._line_likelihood_kernels import add_votes  # noqa: PLC0415

    top = min(float(orders[-1]) * high + _SURROUNDINGS_BINS / frame_s, rate / 2)
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
    weights = 1 / np.count_nonzero(np.abs(orders[:, None] - orders) * high * frame_s < _ONE_LINE, axis=1)
    votes = np.zeros((speeds.size, evidence.times_s.size))
    add_votes(evidence.log_votes(), evidence.bins_per_hz, orders, weights, speeds, DC_BINS, votes)
    # mixture: a frame may contain no line of a rotating shaft
    votes = np.ascontiguousarray(np.logaddexp(votes + np.log1p(-MISSED), np.log(MISSED)).T)
    reach = int(np.ceil(acceleration * (evidence.times_s[1] - evidence.times_s[0]) / spacing))
    if reach * votes.size > _MOST_WORK:
        raise ValueError(
            f"max_acceleration_hz_s={acceleration:g} lets the speed change by {reach} of {speeds.size} steps between "
            f"two of {evidence.times_s.size} frames, too many to search; give a smaller one, or a narrower "
            "speed_range_hz."
        )
    kernel = 1 - (np.arange(-reach, reach + 1) / (reach + 1)) ** 2
    return Search(
        evidence=evidence,
        orders=orders,
        weights=weights,
        speeds=speeds,
        votes=votes,
        kernel=kernel / kernel.sum(),
        frame_s=frame_s,
    )


def longest_run(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the flags with only the longest run of true left."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    kept = np.zeros(flags.size, dtype=np.bool_)
    if edges.size:
        first = 2 * int(np.argmax(np.diff(edges)[::2]))
        kept[edges[first] : edges[first + 1]] = True
    return kept


def single_line(search: Search, speed_hz: float, shown: Array) -> bool:
    """Return whether nearly all evidence is of one line where several orders are listed: it might be any of them.

    Orders within the resolution of a frame from the strongest are the same line.
    """
    strongest = int(np.argmax(shown))
    apart = np.abs(search.orders - search.orders[strongest]) * speed_hz * search.frame_s > SAME_LINE
    supporting = float(shown[apart & (shown > SHOWS)].sum())
    return shown.size > 1 and supporting < max(CERTAIN, _SUPPORT * float(shown.max()))


def low_family(search: Search, shown: Array) -> bool:
    """Return whether all lines are of whole orders below ten, and at most three: harmonics of any machine.

    Four lines in a row are taken for the shaft. Orders that differ from whole ones by less than the tolerance of a
    speed are the same.
    """
    lines = np.unique(np.round(search.orders[shown > SHOWS], 1))
    return bool(lines.size <= _FAMILY and is_low(search.orders[shown > SHOWS]).all())


def leakage_bins(search: Search, speed_hz: float) -> Array:
    """Return how far from the line of each order at a speed its leakage is below the noise, in bins of a frame.

    At d > 1 bins a Hann window leaks at most the power of the line over (pi d (d^2 - 1))^2 (Harris, "On the use of
    windows for harmonic analysis with the discrete Fourier transform", 1978), so less than that over (pi (d - 1)^3)^2.
    """
    return np.asarray(np.maximum(SAME_LINE, 1 + np.cbrt(np.sqrt(search.line_level(speed_hz)) / np.pi)))


def is_low(orders: Array) -> NDArray[np.bool_]:
    """Return whether each order is a whole one below ten, as the harmonics of a shaft."""
    return np.asarray((orders < _LOW_ORDERS) & (np.abs(orders - np.rint(orders)) < SAME_SPEED))


def beyond_harmonics(search: Search, shown: Array) -> Array:
    """Return the scores that a speed has to stand on: where a mesh shows, not the first harmonics of the shaft.

    They may be another machine's, and then the mesh must not be alone.
    """
    low = is_low(search.orders)
    return np.where(low, 0.0, shown) if (shown[~low] > SHOWS).any() else shown


def no_mesh_shows(search: Search, shown: Array) -> bool:
    """Return whether only the first harmonics of a shaft show, although other orders, as of meshes, are listed."""
    return low_family(search, shown) and not is_low(search.orders).all()


def slower_shaft(search: Search, speed_hz: float, shown: Array) -> float | None:
    """Return half the speed, or a third, where it is in range and the lines cannot rule it out; else None.

    The first harmonics of a fast shaft are even or third harmonics of a slower one, whose others may be weak.
    """
    if not low_family(search, shown):
        return None
    return next((speed_hz / part for part in (2, 3) if speed_hz / part >= search.speeds[0]), None)


def of_mains(search: Search, speed: Array, seen: NDArray[np.bool_], shown: Array) -> NDArray[np.bool_]:
    """Return which orders show no more along a path than at a harmonic of the mains beside it, as hum does."""
    fixed = replace(search, orders=np.ones(1), weights=np.ones(1))
    found = np.zeros(shown.size, dtype=np.bool_)
    for harmonic_hz in {number * mains for mains in MAINS_HZ for number in range(1, MAINS_HARMONICS + 1)}:
        off = np.median(np.abs(np.outer(speed[seen], search.orders) - harmonic_hz), axis=0)
        near = (off * search.evidence.bins_per_hz <= SAME_LINE) & (shown > SHOWS)
        if near.any():
            found |= near & (AS_MUCH * shown <= fixed.score(np.full(speed.size, harmonic_hz), seen)[0])
    return found


def rivals(search: Search, speed: Array, seen: NDArray[np.bool_], shown: Array) -> list[Rival]:
    """Search again without the speeds found so far; return the paths that are not much less likely."""
    from signals.shaft._line_likelihood_kernels import most_likely_path  # noqa: PLC0415

    temper = _TEMPERING_FAMILY if low_family(search, shown) else _TEMPERING
    votes = search.votes[seen].copy()
    found: list[Rival] = []
    last, scores = speed[seen], shown
    own = np.where(of_mains(search, speed, seen, shown), 0.0, shown)
    for _ in range(_RIVALS):
        votes[np.abs(search.speeds - last[:, None]) <= search.width(last, scores)[:, None]] = _NEVER
        last = search.speeds[most_likely_path(votes, np.log(search.kernel))]
        path = np.full(speed.size, np.nan)
        path[seen] = last
        scores = search.score(path, seen)
        its = np.where(of_mains(search, path, seen, scores), 0.0, scores)
        if its.sum() < (1 - temper) * own.sum():
            break
        odds = _odds(search, (speed[seen], own), (last, its), tempering=temper)
        if odds > 1 / _LEAST_ODDS:
            found.append(Rival(speed=path, odds=odds))
    return found


def _odds(search: Search, first: tuple[Array, Array], second: tuple[Array, Array], *, tempering: float) -> float:
    """Return the odds of the second path against the first, from the lines that only one of them explains.

    Half the speed explains the same lines with even multiples of its orders, so only lines that are not shared can
    decide. Lines of other machines make frames less independent than the model assumes, so the log odds are tempered: a
    rival with the share 1 - `tempering` of the evidence of the first gets odds of 1 to 20.
    """
    positions = [np.outer(path, search.orders) * search.evidence.bins_per_hz for path, _ in (first, second)]
    apart = np.median(np.abs(positions[0][:, :, None] - positions[1][:, None, :]), axis=0) > SAME_LINE
    one = float(first[1][apart.all(axis=1)].sum())
    other = float(second[1][apart.all(axis=0)].sum())
    temper = max(1.0, tempering * max(one, other) / np.log(_LEAST_ODDS))
    return float(np.exp(min((other - one) / temper, 300.0)))
