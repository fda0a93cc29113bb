"""A random walk measured step by step: its filter and its smoother, stretch by stretch.

A filter goes forward, what later data say is gathered backward, and the two meet at the outputs. Only the state at the
start of each stretch is kept, and the filter runs through a stretch again when the backward sweep gets there: memory
beyond the outputs grows with the square root of the number of steps.

The usual backward recursions, of Rauch, Tung and Striebel [1]_ and of Bryson and Frazier [2]_, subtract what the
future adds from what the past left open. Where the first turn of a slow shaft leaves orders open for thousands of
samples, that difference has no correct digit left; two kinds of knowledge only ever add up [3]_. So the recursion of
Bryson and Frazier, whose step costs no more than the filter's, goes from output to output only, and beside a filter of
its own that begins with nothing open (`_segment_kernels`).

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

from signals._lanes import LANES
from signals.harmonics import _filter_kernels, _settling_kernels, _smoother_kernels
from signals.harmonics._tally import Tally as Tally  # noqa: PLC0414  (chains are read with their tallies)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Steps in a stretch at least, if outputs allow it, and numbers in the matrices at its outputs at most.
SHORTEST_STRETCH = 4096
STRETCH_NUMBERS = 1 << 20


class Knowledge(NamedTuple):
    """Of one state or of several: mean and covariance, or information times mean and information.

    Both are sums of a high and a low part, (..., 2, channel, state) and (..., 2, state, state) arrays.
    """

    vector: Floats
    matrix: Floats


class State(NamedTuple):
    """Where a filter stands: its prediction, and what the low parts are, if anything (see `_settling_kernels`)."""

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
        """Ranges of as many steps as there are ranges, for long chains: fewer where there are many outputs."""
        most = ceil(STRETCH_NUMBERS / padded(self.prior_variance).size ** 2)
        length, outputs = max(SHORTEST_STRETCH, isqrt(self.wanted.size)), np.flatnonzero(self.wanted)
        ranges, start = [], 0
        while start < self.wanted.size:
            following = outputs[np.searchsorted(outputs, start) + most :][:1]
            stop = min(start + length, self.wanted.size, *following.tolist())
            ranges.append(slice(start, stop))
            start = stop
        return ranges

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
    return int(np.clip(memory / 4, 16, _settling_kernels.LOOK_PLAIN))


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
    starts = survey(chain, state, tally, startup)
    levels, variances = smooth_back(chain, starts, nothing_known(state))
    return levels, variances, tally


def survey(chain: Chain, state: State, tally: Tally, startup: int) -> list[tuple[slice, State]]:
    """Carry a state from before all steps to the step after the last; return the stretches and the state before each.

    The innovations from step `startup` on are counted.
    """
    starts = []
    for stretch in chain.stretches():
        starts.append((stretch, state.copy()))
        filtered = _forward(chain, stretch, chain.steps(stretch), state, _none(chain, stretch), full=False)
        tally.add(filtered.innovations, filtered.roots, skip=startup - stretch.start)
    return starts


def smooth_back(chain: Chain, starts: list[tuple[slice, State]], later: Knowledge) -> tuple[Floats, Floats]:
    """Smooth all steps, given the states that `survey` found and what is known from data after them.

    That knowledge is carried to before the first step, the states to the ends of their stretches.

    Returns
    -------
    levels : (channel, output, column) array.
    variances : (output, column) array.
    """
    parts = [_smooth_stretch(chain, stretch, start, later) for stretch, start in reversed(starts)]
    return _joined(parts[::-1], chain.columns)


def look_back(chain: Chain, state: State) -> Knowledge:
    """Return what all steps say of the state before them, where a filter knows this state."""
    later = nothing_known(state)
    for stretch in reversed(chain.stretches()):
        _gather(chain, stretch, chain.steps(stretch), _open(state), later, _none(chain, stretch))
    return later


def _none(chain: Chain, stretch: slice) -> Flags:
    return np.zeros_like(chain.wanted[stretch])


def _open(state: State) -> bool:
    return bool(state.status[_settling_kernels.TWOFOLD])


def _gather(
    chain: Chain, stretch: slice, steps: tuple[Floats, Floats], open_: bool, later: Knowledge, wanted: Flags
) -> Knowledge:
    """Carry later knowledge to before a stretch; return it where wanted. `open_`: as for the kernel."""
    outputs = int(np.count_nonzero(wanted))
    ahead = Knowledge(*(np.empty((outputs, *part.shape)) for part in later))
    _smoother_kernels.backward(*steps, chain.walk(stretch), chain.interval, open_, *later, wanted, *ahead)
    return ahead


def nothing_known(state: State) -> Knowledge:
    """Return what is known of a state from no data at all, as an information."""
    return Knowledge(np.zeros_like(state.vector), np.zeros_like(state.matrix))


def _smooth_stretch(chain: Chain, stretch: slice, start: State, later: Knowledge) -> tuple[Floats, Floats]:
    """Levels (output, channel, width) and variances (output, width) of a stretch.

    The state at its start is carried to its end, what is known from later data to its start.
    """
    wanted, steps, open_ = chain.wanted[stretch], chain.steps(stretch), _open(start)
    filtered = _forward(chain, stretch, steps, start, wanted, full=True)
    ahead = _gather(chain, stretch, steps, open_ or bool(filtered.twofold.any()) or _open(start), later, wanted)
    outputs, width = filtered.variances.shape
    levels, variances = np.empty((outputs, chain.channels, width)), np.empty((outputs, width))
    _smoother_kernels.meet(filtered.means, filtered.covariances, filtered.twofold, *ahead, levels, variances)
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
    _filter_kernels.forward(
        rows, data, chain.walk(stretch), chain.reach, chain.interval, state.status, state.vector, state.matrix,
        filtered.innovations, filtered.roots, wanted, filtered.means, filtered.variances, filtered.covariances,
        filtered.twofold,
    )  # fmt: skip
    return filtered


def _joined(parts: list[tuple[Floats, Floats]], columns: int) -> tuple[Floats, Floats]:
    levels, variances = (np.concatenate(part) for part in zip(*parts, strict=True))
    return levels[..., :columns].transpose(1, 0, 2), variances[:, :columns]
