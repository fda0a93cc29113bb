"""The search over speeds: log likelihoods of all orders in every frame, paths through them, and rival paths."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array
from signals._speed_evidence import DC_BINS, Evidence, log_line_ratio, lowest_band, order_scores, short_time_evidence

CERTAIN = np.log(1000.0)
_MISSED = 0.1  # prior probability that a frame contains no line of a rotating shaft
_SURROUNDINGS_BINS = 40
_RIVALS = 4
_LEAST_ODDS = 20.0  # of the found speed against another, to be unambiguous
_TEMPERING = 0.5  # ratio of scores that has these odds: lines of other machines are not independent noise
_SAME_LINE = 2.0  # bins
_SUPPORT = 0.1  # least sum of all other scores over that of the strongest order
SHOWS = 3.0  # least score of a significant order
_SAME_SPEED = 0.01
_NEVER = -50.0


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another path, and its odds against the first."""

    speed: Array
    odds: float


@dataclass(frozen=True, kw_only=True)
class Search:
    """Grid of speeds, log likelihoods of all orders (`votes`, frames x speeds) and transition kernel."""

    evidence: Evidence
    orders: Array
    speeds: Array
    votes: Array
    kernel: Array
    frame_s: float

    def score(self, speed: Array, frames: NDArray[np.bool_]) -> Array:
        """Return the log evidence for each order along a path, in the frames flagged."""
        bins, _ = self.evidence.ratios.shape
        column = np.flatnonzero(frames)
        position = np.outer(speed[column], self.orders) * self.evidence.bins_per_hz
        known = (position >= DC_BINS) & (position < bins - 1)
        low = np.where(known, position, 0).astype(np.int64)
        part = np.where(known, position, 0) - low
        ratios = self.evidence.ratios
        power = ratios[low, column[:, None]] * (1 - part) + ratios[low + 1, column[:, None]] * part
        return order_scores(np.where(known, log_line_ratio(power, foreign=self.evidence.foreign), 0.0))

    @property
    def spacing(self) -> float:
        """Step of the grid of speeds in Hz."""
        return float(self.speeds[1] - self.speeds[0])

    def width(self, path: Array, scores: Array) -> Array:
        """Return half the width of one speed: 1 %, or the half main lobe of the mean significant order."""
        weights = np.maximum(scores, 1e-3)
        return np.maximum(_SAME_SPEED * path, 2 / (self.frame_s * np.average(self.orders, weights=weights)))


def search_speeds(
    signal: Array, rate: float, orders: Array, low: float, high: float, acceleration: float, frame_s: float
) -> Search:
    """Sum the log likelihood ratios of all orders, for every frame and every speed of a grid.

    The step of the grid is half a bin of the highest order.
    """
    from signals._speed_kernels import add_votes  # noqa: PLC0415

    top = min(float(orders[-1]) * high + _SURROUNDINGS_BINS / frame_s, rate / 2)
    band, band_rate = lowest_band(signal, rate_hz=rate, top_hz=top)
    evidence = short_time_evidence(band, rate_hz=band_rate, frame_s=frame_s)
    highest = min(float(orders[-1]), band_rate / 2 / low)
    spacing = 0.5 / (frame_s * highest)
    speeds = low + spacing * np.arange(int(np.ceil((high - low) / spacing)) + 1, dtype=np.float64)
    votes = np.zeros((speeds.size, evidence.times_s.size))
    add_votes(evidence.log_votes(), evidence.bins_per_hz, orders, speeds, DC_BINS, votes)
    # mixture: a frame may contain no line of a rotating shaft
    votes = np.ascontiguousarray(np.logaddexp(votes + np.log1p(-_MISSED), np.log(_MISSED)).T)
    reach = int(np.ceil(acceleration * (evidence.times_s[1] - evidence.times_s[0]) / spacing))
    kernel = 1 - (np.arange(-reach, reach + 1) / (reach + 1)) ** 2
    return Search(
        evidence=evidence,
        orders=orders,
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
    apart = np.abs(search.orders - search.orders[strongest]) * speed_hz * search.frame_s > _SAME_LINE
    supporting = float(shown[apart & (shown > SHOWS)].sum())
    return shown.size > 1 and supporting < max(CERTAIN, _SUPPORT * float(shown.max()))


def rivals(search: Search, speed: Array, seen: NDArray[np.bool_], shown: Array) -> list[Rival]:
    """Search again without the speeds found so far; return the paths that are not much less likely."""
    from signals._speed_kernels import most_likely_path  # noqa: PLC0415

    votes = search.votes[seen].copy()
    found: list[Rival] = []
    last, scores = speed[seen], shown
    for _ in range(_RIVALS):
        votes[np.abs(search.speeds - last[:, None]) <= search.width(last, scores)[:, None]] = _NEVER
        last = search.speeds[most_likely_path(votes, np.log(search.kernel))]
        path = np.full(speed.size, np.nan)
        path[seen] = last
        scores = search.score(path, seen)
        if scores.sum() < _TEMPERING * shown.sum():
            break
        odds = _odds(search, (speed[seen], shown), (last, scores))
        if odds > 1 / _LEAST_ODDS:
            found.append(Rival(speed=path, odds=odds))
    return found


def _odds(search: Search, first: tuple[Array, Array], second: tuple[Array, Array]) -> float:
    """Return the odds of the second path against the first, from the lines that only one of them explains.

    Half the speed explains the same lines with even multiples of its orders, so only lines that are not shared can
    decide. Lines of other machines make frames less independent than the model assumes, so the log odds are tempered: a
    rival with half the evidence of the first gets odds of 1 to 20.
    """
    positions = [np.outer(path, search.orders) * search.evidence.bins_per_hz for path, _ in (first, second)]
    apart = np.median(np.abs(positions[0][:, :, None] - positions[1][:, None, :]), axis=0) > _SAME_LINE
    one = float(first[1][apart.all(axis=1)].sum())
    other = float(second[1][apart.all(axis=0)].sum())
    temper = max(1.0, _TEMPERING * max(one, other) / np.log(_LEAST_ODDS))
    return float(np.exp(min((other - one) / temper, 300.0)))
