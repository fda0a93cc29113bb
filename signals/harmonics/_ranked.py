"""Random walks of many columns seen at knots that tell little at a time: their smoother, quadratic in the columns.

Lines that lie close together look much alike within a block: so few combinations of them are measured at a knot that a
covariance filter, which takes these in, has far less to do than one that adds up knowledge and must integrate the walk
of every column out of it. On the way back walks cost nothing: see `_moments`.

What past and future leave together is a difference here, which has digits only where the past knows something of every
direction. So the first knots are smoothed the other way round: from what the future knows of the last of them, in
reversed time, to the first, where the prior takes the place of later data.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._information import KnotChain
from signals.harmonics._moments import Later, Moments, Step, even, is_open, measure, met, multiply, unmeasure
from signals.harmonics._rank_kernels import condense

Floats = NDArray[np.float64]

# Fewer columns than that are smoothed sooner by adding up knowledge.
FEWEST_COLUMNS = 32
# Numbers of a state for each that a knot measures, at the least.
NUMBERS_A_ROW = 4
# What a prior tells at the least.
LEAST_KNOWN = 1e-8
# Knots from one that a covariance is kept of, and variances made, to the next.
SPACING = 4
# Knots whose information is made at a time.
AT_ONCE = 8
# Numbers kept of a stretch of knots for the way back.
STRETCH_NUMBERS = 1 << 25


class Unfit(Exception):  # noqa: N818  (no error: another way does better)
    """Of a chain that had better be smoothed by adding up knowledge."""


class Stretch:
    """Knots, as many as fit into memory, filtered one after the other.

    Attributes
    ----------
    knots : those that fit.
    last : what the filter knows of the last of them.
    log_variance : sum of the log variances of the innovations of one lane, of those that count.
    """

    def __init__(self, chain: KnotChain, knots: range, state: Moments, *, first: int) -> None:
        """Filter, and carry `state`, what is predicted for the first of the knots, on to the one after the last."""
        self._chain, self._width, self._onward = chain, chain.data.shape[2], knots.step > 0
        self._steps: list[Step] = []
        self._kept: dict[int, Moments] = {}
        self.log_variance, room = 0.0, STRETCH_NUMBERS
        for number, (rows, values) in enumerate(told(chain, knots)):
            if is_open(state, rows):
                raise Unfit
            step, log_variance = measure(state, rows, values)
            self._steps.append(step)
            room -= sum(part.size for part in step)
            if knots[number] >= first:
                self.log_variance += log_variance
            last = room < 0 or knots[number] == knots[-1]
            if last or number % SPACING == 0:
                even(state.covariance)
                self._kept[number] = state.copy()
                room -= state.covariance.size
            walk(chain, state, knots[number], onward=self._onward)
            if last:
                break
        self.knots, self.last = knots[: len(self._steps)], self._kept[len(self._steps) - 1]

    def back(self, later: Later, levels: Floats, variances: Floats) -> None:
        """Go back through the stretch.

        Parameters
        ----------
        later : of the last knot from data after it on entry, of the knot before the first on return.
        levels : (knot, width, lane) array of all knots, filled here.
        variances : (knot, width) array of all knots, filled at those that a covariance is kept of.
        """
        width, onward = self._width, self._onward
        pushes = np.empty((len(self._steps), width, later.vector.shape[1]))
        means: dict[int, Floats] = {}
        for number in range(len(self._steps) - 1, -1, -1):
            if number in self._kept:
                even(later.matrix)
                means[number], variances[self.knots[number]] = met(self._kept[number], later, width)
            after = later.vector[-width:].copy()
            unmeasure(later, self._steps[number])
            pushes[number] = after if onward else later.vector[-width:]
            for part in (later.vector, later.matrix, later.matrix.T):
                multiply(part, width, onward=onward, turned=True)
        # In between the mean goes on by what later data say of each increment.
        mean = means[0]
        for number, knot in enumerate(self.knots):
            if number in means:
                mean = means[number]
            elif onward:
                mean[-width:] += increments(self._chain, knot - 1)[:, None] * pushes[number - 1]
                multiply(mean, width, onward=True, turned=False)
            else:
                multiply(mean, width, onward=False, turned=False)
                mean[-width:] += increments(self._chain, knot)[:, None] * pushes[number]
            levels[knot] = mean[:width]


def increments(chain: KnotChain, knot: int) -> Floats:
    """(width,) variances of the increments from a knot to the next."""
    return np.asarray(chain.walk_variance[min(knot, len(chain.walk_variance) - 1)])


def walk(chain: KnotChain, state: Moments, knot: int, *, onward: bool) -> None:
    """Go from a knot to the next, or to the one before, in place."""
    width = chain.data.shape[2]
    highest = np.arange(-width, 0)
    if onward:
        state.covariance[highest, highest] += increments(chain, knot)
    for part in (state.mean, state.covariance, state.covariance.T):
        multiply(part, width, onward=onward, turned=False)
    if not onward:
        state.covariance[highest, highest] += increments(chain, max(knot - 1, 0))


def told(chain: KnotChain, knots: range) -> Iterator[tuple[Floats, Floats]]:
    """Yield what knots say: (row, state) rows and (row, lane) values."""
    _, poles, width, lanes = chain.data.shape
    most = poles * width // NUMBERS_A_ROW
    for begin in range(0, len(knots), AT_ONCE):
        some = knots[begin : begin + AT_ONCE]
        rows, values = np.empty((len(some), most, poles * width)), np.empty((len(some), most, lanes))
        ranks = np.empty(len(some), dtype=np.int64)
        lowest = min(some)
        condense(*chain.stretch(slice(lowest, max(some) + 1)), rows, values, ranks)
        if ranks.max() > most:
            raise Unfit
        for knot in some:
            place = knot - lowest
            yield rows[place, : ranks[place]], values[place, : ranks[place]]


def smooth_ranked(chain: KnotChain, *, first: int) -> tuple[Floats, Floats, float] | None:
    """Smooth a chain as `smooth_knots` does, where that is worth while; else return None.

    Parameters, returns and errors are those of `smooth_knots`. Variances are made at every fourth knot; between these
    they are cubics.
    """
    few = chain.data.shape[2] < FEWEST_COLUMNS
    if few or chain.after.matrix.any() or np.diag(chain.before.matrix).min() < LEAST_KNOWN:
        return None
    try:
        return _smooth(chain, first)
    except (Unfit, np.linalg.LinAlgError):  # knowledge that only adds up has digits longer
        return None


def _smooth(chain: KnotChain, first: int) -> tuple[Floats, Floats, float]:
    knots, _, width, lanes = chain.data.shape
    state = Moments.of(chain.before)
    opened, last, log_variance = _open(chain, state, first)
    starts = [(opened, state.copy())]
    while True:
        stretch = Stretch(chain, range(starts[-1][0], knots), state, first=first)
        log_variance += stretch.log_variance
        if stretch.knots[-1] == knots - 1:
            break
        starts.append((stretch.knots[-1] + 1, state.copy()))
    levels, variances = np.empty((knots, width, lanes)), np.full((knots, width), np.nan)
    later, stop = Later(np.zeros_like(state.mean), np.zeros_like(state.covariance)), knots
    for start, begun in reversed(starts):
        if stop < knots:
            stretch = Stretch(chain, range(start, stop), begun, first=first)
        stretch.back(later, levels, variances)
        stop = start
    future = Moments.of(later.known(last))
    stretch = Stretch(chain, range(opened - 1, -1, -1), future, first=first)
    if stretch.knots[-1] > 0:
        raise Unfit
    stretch.back(Later.of(chain.before, stretch.last), levels, variances)
    if not np.nanmin(variances) > 0:
        raise Unfit
    return levels, _between(variances), log_variance


def _open(chain: KnotChain, state: Moments, first: int) -> tuple[int, Moments, float]:
    """Filter, in place, until the past knows something of every direction.

    Returns
    -------
    how many knots it takes, what it knows of the last one of them, and the log variance of innovations that count.
    """
    last, log_variance = state, 0.0
    for knot, (rows, values) in enumerate(told(chain, range(len(chain.data) // 2))):
        if knot and rows.any(axis=0).all() and not is_open(state, rows):
            return knot, last, log_variance
        _, added = measure(state, rows, values)
        log_variance += added if knot >= first else 0.0
        even(state.covariance)
        last = state.copy()
        walk(chain, state, knot, onward=True)
    raise Unfit


def _between(variances: Floats) -> Floats:
    """Return (knot, width) variances, those that are missing from cubics through the logarithms of the others."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415  (for many columns only)

    there = np.flatnonzero(np.isfinite(variances[:, 0]))
    return np.asarray(np.exp(CubicSpline(there, np.log(variances[there]))(np.arange(len(variances)))))
