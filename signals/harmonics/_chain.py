"""A random walk measured step by step: its filter and its smoother, stretch by stretch.

A covariance filter goes forward, an information filter backward, and they meet at the outputs. Only the state
at the start of each stretch is kept, and the filter runs through a stretch again when the backward one gets
there: memory beyond the outputs grows with the square root of the number of steps.

The usual backward recursions, of Rauch, Tung and Striebel [1]_ and of Bryson and Frazier [2]_, subtract what the
future adds from what the past left open. Where the first turn of a slow shaft leaves orders open for thousands of
samples, that difference has no correct digit left; two kinds of knowledge only ever add up [3]_.

References
----------
.. [1] H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems",
   AIAA J. 3, 1965.
.. [2] A. E. Bryson, M. Frazier, "Smoothing for linear and nonlinear dynamic systems", TDR-63-119, 1963.
.. [3] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, isqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums
from signals.harmonics import _kernels
from signals.harmonics._lanes import LANES

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Steps in a stretch at least, and numbers in the matrices of a stretch at most.
SHORTEST_STRETCH = 256
STRETCH_NUMBERS = 1 << 20
LAGS = 20
# Factors whose product is taken before its logarithm.
_FACTORS = 8
# Steps correlated at a time: they stay in the nearest cache.
_PIECE = 1024


class Knowledge(NamedTuple):
    """Of one state or of several: mean and covariance, or information times mean and information.

    Both are sums of a high and a low part, (..., 2, channel, state) and (..., 2, state, state) arrays.
    """

    vector: Floats
    matrix: Floats


class State(NamedTuple):
    """Where a filter stands: its prediction, and whether the low parts count."""

    vector: Floats
    matrix: Floats
    status: Integers

    @classmethod
    def prior(cls, variance: Floats, *, channels: int) -> "State":
        """Return the state before the first step, given the (pole, width) array of variances."""
        covariance = np.zeros((2, variance.size, variance.size))
        np.fill_diagonal(covariance[0], variance.ravel())
        # Nothing is settled yet, and the first look is due.
        return cls(np.zeros((2, channels, variance.size)), covariance, np.array([1, 0], dtype=np.int64))

    def copy(self) -> "State":
        vector, matrix, status = self
        return State(vector.copy(), matrix.copy(), status.copy())


def padded(values: Floats) -> Floats:
    """Return the array with its last dimension filled up with zeros to a multiple of LANES."""
    missing = -values.shape[-1] % LANES
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, missing)]) if missing else values


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A random walk and its measurements, step by step.

    Attributes
    ----------
    measurements : from a range of steps to their rows (step, row, column), which may be filled up as by `padded`,
        and data (step, row, channel), NaN, in all channels, where missing.
    walk_variance : (column,) array, or a function from a range of steps to a (step or 1, column) array.
    prior_variance : (pole, column) array, before the first step.
    wanted : (step,) array, the steps that give an output.
    channels : how many channels the data have.
    memory : steps in which the filter forgets.
    reach : largest square of a number in the rows.
    """

    measurements: Callable[[slice], tuple[Floats, Floats]]
    walk_variance: Floats | Callable[[slice], Floats]
    prior_variance: Floats
    wanted: Flags
    channels: int = 1
    memory: float = 1e4
    reach: float = 1.0

    @property
    def columns(self) -> int:
        """Columns before filling up."""
        return int(self.prior_variance.shape[1])

    @property
    def interval(self) -> int:
        """Return the steps between looks at the covariance, a part of the memory."""
        return look_interval(self.memory)

    def stretches(self) -> list[slice]:
        """Ranges of about the square root of all steps: as much to keep in each as there are of them."""
        size = padded(self.prior_variance).size
        length = min(max(SHORTEST_STRETCH, isqrt(self.wanted.size)), ceil(STRETCH_NUMBERS / size**2))
        return [slice(start, start + length) for start in range(0, self.wanted.size, length)]

    def prior(self) -> State:
        """State before the first step."""
        return State.prior(padded(self.prior_variance), channels=self.channels)

    def walk(self, span: slice) -> Floats:
        """(step or 1, width) array."""
        walk = self.walk_variance(span) if callable(self.walk_variance) else self.walk_variance
        return np.ascontiguousarray(padded(np.atleast_2d(walk)))

    def steps(self, span: slice) -> tuple[Floats, Floats]:
        """Rows (step, row, width) and data (step, row, channel)."""
        rows, data = self.measurements(span)
        width = padded(self.prior_variance).shape[1]
        filled = rows if rows.shape[-1] == width else padded(rows)
        return np.ascontiguousarray(filled), np.ascontiguousarray(data)


def look_interval(memory: float) -> int:
    """Return the steps between looks at a plain covariance: in a quarter of its memory it cannot open far."""
    return int(np.clip(memory / 4, 16, _kernels.LOOK_PLAIN))


@dataclass
class Tally:
    """Sums over the innovations that count.

    Attributes
    ----------
    square : (channel,) array, of their squares over their variances.
    log_variance : of the logarithms of their variances.
    count : how many.
    products : (channel, lag) array, of the products of two that lie 1, 2, ... steps apart.
    pairs : (lag,) array, how many of these.
    recent, recent_seen : (LAGS, row, channel) and (LAGS, row) arrays, the last innovations and 1.0 where there is one.
    kept : all of them, (step, row, channel) arrays in order, where asked for.
    """

    square: Floats
    products: Floats
    pairs: Floats
    recent: Floats
    recent_seen: Floats
    log_variance: float = 0.0
    count: int = 0
    kept: list[Floats] | None = None

    @classmethod
    def empty(cls, *, channels: int, keep: bool = False) -> "Tally":
        """Return a tally of nothing."""
        return cls(
            square=np.zeros(channels),
            products=np.zeros((channels, LAGS)),
            pairs=np.zeros(LAGS),
            recent=np.zeros((LAGS, 1, channels)),
            recent_seen=np.zeros((LAGS, 1)),
            kept=[] if keep else None,
        )

    @property
    def mean_square(self) -> Floats:
        """(channel,) array."""
        return self.square / max(self.count, 1)

    @property
    def autocorrelation(self) -> Floats:
        """(channel, lag) array; 0 where there is none."""
        mean = self.mean_square[:, None]
        scale = np.maximum(self.pairs, 1.0) * np.where(mean > 0.0, mean, 1.0)
        return np.asarray(self.products / scale)

    def add(self, innovations: Floats, roots: Floats, *, skip: int) -> None:
        """Count a stretch but for its first `skip` steps, as `forward` left it."""
        if self.kept is not None:
            self.kept.append(innovations.copy())
        innovations, roots = innovations[max(skip, 0) :], roots[max(skip, 0) :]
        if len(innovations) == 0:
            return
        if self.count == 0:
            self.recent = np.zeros((LAGS, *innovations.shape[1:]))
            self.recent_seen = np.zeros((LAGS, innovations.shape[1]))
        joined = np.concatenate([self.recent, innovations])
        seen = np.concatenate([self.recent_seen, (roots != 0.0).astype(np.float64)])
        logarithm, count = _count(innovations, roots, self.square)
        self.log_variance += logarithm
        self.count += count
        _correlate(
            np.ascontiguousarray(joined.transpose(2, 1, 0)), np.ascontiguousarray(seen.T), self.products, self.pairs
        )
        self.recent, self.recent_seen = joined[-LAGS:].copy(), seen[-LAGS:].copy()


@compiled_sums
def _count(innovations: Floats, roots: Floats, square: Floats) -> tuple[float, int]:
    """Add the squares to `square`; return the sum of log variances and the number of innovations."""
    logarithm, missing = 0.0, 0
    flat = roots.reshape(roots.size)
    values = innovations.reshape(roots.size, square.size)
    for start in range(0, flat.size, _FACTORS):
        product = 1.0
        for i in range(start, min(start + _FACTORS, flat.size)):
            if flat[i] == 0.0:
                missing += 1
            else:
                product *= flat[i]
        logarithm -= 2.0 * np.log(product)
    for k in range(square.size):
        total = 0.0
        for i in range(flat.size):
            total += values[i, k] * values[i, k]
        square[k] += total
    return logarithm, flat.size - missing


@compiled_sums
def _correlate(innovations: Floats, seen: Floats, products: Floats, pairs: Floats) -> None:
    """Add products at each lag of (channel, row, step) innovations, the first LAGS steps being counted."""
    channels, rows, steps = innovations.shape
    for row in range(rows):
        missing = 0.0
        for i in range(steps):
            missing += 1.0 - seen[row, i]
        for lag in range(1, LAGS + 1):
            number = float(steps - LAGS)
            if missing > 0.0:
                number = 0.0
                for i in range(LAGS, steps):
                    number += seen[row, i] * seen[row, i - lag]
            pairs[lag - 1] += number
        for k in range(channels):
            values = innovations[k, row]
            for first in range(LAGS, steps, _PIECE):
                last = min(first + _PIECE, steps)
                late = values[first:last]
                for lag in range(1, LAGS + 1):
                    early, total = values[first - lag : last - lag], 0.0
                    for i in range(late.size):
                        total += late[i] * early[i]
                    products[k, lag - 1] += total


class Filtered(NamedTuple):
    """What `forward` leaves: at the outputs its arrays of these names, of all steps the innovations."""

    means: Floats
    variances: Floats
    covariances: Floats
    twofold: Flags
    innovations: Floats
    roots: Floats


def filter_chain(chain: Chain, startup: int, *, keep: bool = False) -> tuple[Floats, Floats, Tally]:
    """Filter all steps.

    Returns
    -------
    levels : (channel, output, column) array.
    variances : (output, column) array.
    tally : of the innovations from step `startup` on.
    """
    state, tally, parts = chain.prior(), Tally.empty(channels=chain.channels, keep=keep), []
    for stretch in chain.stretches():
        filtered = _forward(chain, stretch, chain.steps(stretch), state, chain.wanted[stretch], full=False)
        tally.add(filtered.innovations, filtered.roots, skip=startup - stretch.start)
        parts.append((filtered.means[:, 0], filtered.variances))
    return *_joined(parts, chain.columns), tally


def smooth_chain(chain: Chain, startup: int, *, keep: bool = False) -> tuple[Floats, Floats, Tally]:
    """Smooth all steps: as `filter_chain`, with levels and variances from all data.

    The filter runs once for its state at the start of each stretch, then again stretch by stretch from the
    last, where what it knows meets what later data say.
    """
    state = chain.prior()
    tally = Tally.empty(channels=chain.channels, keep=keep)
    levels, variances = smooth_on(chain, state, nothing_known(state), tally, startup)
    return levels, variances, tally


def smooth_on(chain: Chain, state: State, later: Knowledge, tally: Tally, startup: int) -> tuple[Floats, Floats]:
    """Smooth all steps, given the state before them and what is known from data after them.

    The state is carried to the step after the last, the other knowledge to before the first, and the innovations
    from step `startup` on are counted.

    Returns
    -------
    levels : (channel, output, column) array.
    variances : (output, column) array.
    """
    starts, parts = [], []
    for stretch in chain.stretches():
        starts.append((stretch, state.copy()))
        filtered = _forward(chain, stretch, chain.steps(stretch), state, _none(chain, stretch), full=False)
        tally.add(filtered.innovations, filtered.roots, skip=startup - stretch.start)
    for stretch, start in reversed(starts):
        parts.append(_smooth_stretch(chain, stretch, start, later))
    return _joined(parts[::-1], chain.columns)


def look_back(chain: Chain, state: State) -> Knowledge:
    """Return what all steps say of the state before them, and carry that state to the step after the last."""
    later, opened = nothing_known(state), []
    for stretch in chain.stretches():
        before = bool(state.status[_kernels.TWOFOLD])
        _forward(chain, stretch, chain.steps(stretch), state, _none(chain, stretch), full=False)
        opened.append((stretch, before or bool(state.status[_kernels.TWOFOLD])))
    for stretch, open_ in reversed(opened):
        _gather(chain, stretch, open_, later, _none(chain, stretch))
    return later


def advance(chain: Chain, state: State) -> None:
    """Carry a state from before all steps to the step after the last."""
    for stretch in chain.stretches():
        _forward(chain, stretch, chain.steps(stretch), state, _none(chain, stretch), full=False)


def _none(chain: Chain, stretch: slice) -> Flags:
    return np.zeros_like(chain.wanted[stretch])


def _gather(chain: Chain, stretch: slice, open_: bool, later: Knowledge, wanted: Flags) -> Knowledge:
    """Carry later knowledge to before a stretch; return it where wanted. `open_`: as for the kernel."""
    outputs = int(np.count_nonzero(wanted))
    ahead = Knowledge(*(np.empty((outputs, *part.shape)) for part in later))
    _kernels.backward(*chain.steps(stretch), chain.walk(stretch), open_, *later, wanted, *ahead)
    return ahead


def nothing_known(state: State) -> Knowledge:
    """Return what is known of a state from no data at all, as an information."""
    return Knowledge(np.zeros_like(state.vector), np.zeros_like(state.matrix))


def _smooth_stretch(chain: Chain, stretch: slice, start: State, later: Knowledge) -> tuple[Floats, Floats]:
    """Levels (output, channel, width) and variances (output, width) of a stretch.

    The state at its start is carried to its end, what is known from later data to its start.
    """
    wanted = chain.wanted[stretch]
    open_ = bool(start.status[_kernels.TWOFOLD])
    filtered = _forward(chain, stretch, chain.steps(stretch), start, wanted, full=True)
    open_ |= bool(filtered.twofold.any()) or bool(start.status[_kernels.TWOFOLD])
    ahead = _gather(chain, stretch, open_, later, wanted)
    outputs, width = filtered.variances.shape
    levels, variances = np.empty((outputs, chain.channels, width)), np.empty((outputs, width))
    _kernels.meet(filtered.means, filtered.covariances, filtered.twofold, *ahead, levels, variances)
    return levels, variances


def _forward(
    chain: Chain, stretch: slice, steps: tuple[Floats, Floats], state: State, wanted: Flags, *, full: bool
) -> Filtered:
    """Filter a stretch, carrying `state` to the step after; `full` keeps whole states at the outputs."""
    rows, data = steps
    outputs, size = int(np.count_nonzero(wanted)), state.vector.shape[2]
    width = rows.shape[2]
    filtered = Filtered(
        means=np.empty((outputs, 2 if full else 1, chain.channels, size if full else width)),
        variances=np.empty((outputs, width)),
        covariances=np.empty((outputs if full else 0, 2, size, size)),
        twofold=np.empty(outputs, dtype=np.bool_),
        innovations=np.empty(data.shape),
        roots=np.empty(data.shape[:2]),
    )
    _kernels.forward(
        rows, data, chain.walk(stretch), chain.reach, chain.interval, state.status, state.vector, state.matrix,
        filtered.innovations, filtered.roots, wanted, filtered.means, filtered.variances, filtered.covariances,
        filtered.twofold,
    )  # fmt: skip
    return filtered


def _joined(parts: list[tuple[Floats, Floats]], columns: int) -> tuple[Floats, Floats]:
    levels, variances = (np.concatenate(part) for part in zip(*parts, strict=True))
    return levels[..., :columns].transpose(1, 0, 2), variances[:, :columns]
