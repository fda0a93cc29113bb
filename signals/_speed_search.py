"""The search over speeds: votes of all orders in every frame, paths through them, and what rivals a path."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array
from signals._speed_evidence import DC_BINS, Evidence, log_line_ratio, lowest_band, order_scores, short_time_evidence

CERTAIN = np.log(1000.0)
_MISSED = 0.1  # prior probability that a frame shows nothing of a shaft that turns
_SURROUNDINGS_BINS = 40
_RIVALS = 4
_DOUBT = 20.0  # how much likelier the found speed must be
_SLACK = 0.5  # of the score: records hold lines of other machines, which the model takes for independent noise
_SAME_PLACE = 2.0  # bins
_SUPPORT = 0.1  # of the strongest order's score, from all others together
SHOWS = 3.0  # score from which an order is said to show
_SAME_SPEED = 0.01
_NEVER = -50.0


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another path, and how likely it is beside the first."""

    speed: Array
    odds: float


@dataclass(frozen=True, kw_only=True)
class Search:
    """What the search over speeds works on."""

    evidence: Evidence
    orders: Array
    speeds: Array
    votes: Array
    kernel: Array
    frame_s: float

    def score(self, speed: Array, frames: NDArray[np.bool_]) -> Array:
        """Log evidence for each order along a path."""
        bins, _ = self.evidence.ratios.shape
        column = np.flatnonzero(frames)
        place = np.outer(speed[column], self.orders) * self.evidence.bins_per_hz
        known = (place >= DC_BINS) & (place < bins - 1)
        low = np.where(known, place, 0).astype(np.int64)
        part = np.where(known, place, 0) - low
        ratios = self.evidence.ratios
        power = ratios[low, column[:, None]] * (1 - part) + ratios[low + 1, column[:, None]] * part
        return order_scores(np.where(known, log_line_ratio(power, foreign=self.evidence.foreign), 0.0))

    @property
    def spacing(self) -> float:
        """Step of the grid of speeds in Hz."""
        return float(self.speeds[1] - self.speeds[0])

    def width(self, path: Array, scores: Array) -> Array:
        """Half the width of what counts as the same speed: 1 %, or the main lobe of the mean order that shows."""
        weights = np.maximum(scores, 1e-3)
        return np.maximum(_SAME_SPEED * path, 2 / (self.frame_s * np.average(self.orders, weights=weights)))


def search_speeds(
    signal: Array, rate: float, orders: Array, low: float, high: float, acceleration: float, frame_s: float
) -> Search:
    """Let every order vote for every speed of a grid, half a bin of the highest order apart, in every frame."""
    from signals._speed_kernels import add_votes  # noqa: PLC0415

    top = min(float(orders[-1]) * high + _SURROUNDINGS_BINS / frame_s, rate / 2)
    band, band_rate = lowest_band(signal, rate_hz=rate, top_hz=top)
    evidence = short_time_evidence(band, rate_hz=band_rate, frame_s=frame_s)
    highest = min(float(orders[-1]), band_rate / 2 / low)
    spacing = 0.5 / (frame_s * highest)
    speeds = low + spacing * np.arange(int(np.ceil((high - low) / spacing)) + 1, dtype=np.float64)
    votes = np.zeros((speeds.size, evidence.times_s.size))
    add_votes(evidence.log_votes(), evidence.bins_per_hz, orders, speeds, DC_BINS, votes)
    # a frame may show nothing of a shaft that turns on
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
    """Keep the longest run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    kept = np.zeros(flags.size, dtype=np.bool_)
    if edges.size:
        first = 2 * int(np.argmax(np.diff(edges)[::2]))
        kept[edges[first] : edges[first + 1]] = True
    return kept


def stands_alone(search: Search, speed_hz: float, shown: Array) -> bool:
    """Whether one line gives nearly all the evidence where several orders are listed: it might be any of them.

    Orders that a frame cannot tell from the strongest see the same line.
    """
    strongest = int(np.argmax(shown))
    apart = np.abs(search.orders - search.orders[strongest]) * speed_hz * search.frame_s > _SAME_PLACE
    supporting = float(shown[apart & (shown > SHOWS)].sum())
    return shown.size > 1 and supporting < max(CERTAIN, _SUPPORT * float(shown.max()))


def rivals(search: Search, speed: Array, seen: NDArray[np.bool_], shown: Array) -> list[Rival]:
    """Search again without the speeds found so far; return what is not much less likely."""
    from signals._speed_kernels import likeliest_path  # noqa: PLC0415

    votes = search.votes[seen].copy()
    found: list[Rival] = []
    last, scores = speed[seen], shown
    for _ in range(_RIVALS):
        votes[np.abs(search.speeds - last[:, None]) <= search.width(last, scores)[:, None]] = _NEVER
        last = search.speeds[likeliest_path(votes, np.log(search.kernel))]
        path = np.full(speed.size, np.nan)
        path[seen] = last
        scores = search.score(path, seen)
        if scores.sum() < _SLACK * shown.sum():
            break
        odds = _odds(search, (speed[seen], shown), (last, scores))
        if odds > 1 / _DOUBT:
            found.append(Rival(speed=path, odds=odds))
    return found


def _odds(search: Search, first: tuple[Array, Array], second: tuple[Array, Array]) -> float:
    """How likely the second path is beside the first, by the lines that only one of them explains.

    Half the speed explains all that the speed does with even multiples of its orders: what tells them apart are the
    lines they do not share. Frames are less independent than the model has them where a record holds lines of other
    machines, so the log odds are scaled: a rival with half the evidence of the first is given odds of 1 to 20.
    """
    places = [np.outer(path, search.orders) * search.evidence.bins_per_hz for path, _ in (first, second)]
    apart = np.median(np.abs(places[0][:, :, None] - places[1][:, None, :]), axis=0) > _SAME_PLACE
    mine = float(first[1][apart.all(axis=1)].sum())
    other = float(second[1][apart.all(axis=0)].sum())
    temper = max(1.0, _SLACK * max(mine, other) / np.log(_DOUBT))
    return float(np.exp(min((other - mine) / temper, 300.0)))
