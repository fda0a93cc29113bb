"""A record with a slipping line as a chain of blocks: its objective, its filter and its smoother.

The model is that of `slip`. The filter linearises at its own prediction; the smoother takes Gauss-Newton steps, each
a filter and a sweep back on the model linearised at the trajectory so far, halved until the sum of squares falls.
"""

from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _slip_kernels
from signals.harmonics._slip_record import Line, SlipRecord
from signals.harmonics._slip_search import Ridge
from signals.harmonics.bandwidth import process_variance
from signals.harmonics.model import PRIOR_STD

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Status = Literal["converged", "not converged", "single pass", "no line"]

# Of 1 / bandwidth, and of the stretch over which the walk of the slip turns the line by a radian: in shorter blocks
# what is held constant differs from the continuous walks by a few 1e-4 of the uncertainty.
_BLOCK = 1 / 200
_SLIP_BLOCK = 1 / 50
# A change this small, in standard deviations, is no change.
_SETTLED = 1e-7
# Where rounding keeps the objective from falling any further the step is far below this, in the same unit.
_FLAT = 1e-3
_HALVINGS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipPath:
    """States of all blocks, what the filter or smoother makes of them, and the fit of its innovations."""

    means: Floats
    covariances: Floats
    innovation_mean_square: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipChain:
    """The record in blocks, in units of the noise; attributes as in `_slip_kernels.forward`.

    Attributes
    ----------
    turning : (block,) array, `SlipRecord.turning` in their middles.
    outputs : (output,) array, the blocks that are put out.
    prior_mean : (state,) array, before the first sample.
    prior_std : (state,) array.
    """

    x: Floats
    phase: Floats
    order: float
    scale: float
    edges: Whole
    centres: Whole
    turning: Floats
    outputs: Whole
    turns: Floats
    walks: Floats
    slip_walks: Floats
    prior_mean: Floats
    prior_std: Floats

    @property
    def size(self) -> int:
        """Numbers in a state."""
        return self.prior_mean.size

    def condense(self, states: Floats) -> tuple[float, Floats, Floats]:
        """Objective at these states, and the information and score of every block."""
        informations = np.empty((len(states), self.size, self.size))
        scores = np.empty_like(states)
        squares = _slip_kernels.condense_all(
            self.x, self.phase, self.order, self.scale, self.edges, self.centres, states, informations, scores
        )
        return 0.5 * (squares + self._changes(states)), informations, scores

    def _changes(self, states: Floats) -> float:
        """Squared changes over their variances, the first state's from its prior included."""
        harmonics = self.size // 2
        amplitude = states[:, :harmonics] + 1j * states[:, harmonics:-1]
        number = np.arange(1, harmonics + 1)
        slip = states[:, -1]
        moved = np.exp(1j * np.outer(0.5 * (slip[1:] + slip[:-1]) * self.turns, number)) * amplitude[:-1]
        start = (states[0] - self.prior_mean) / self.prior_std
        return float(
            start @ start
            + np.sum(np.abs(amplitude[1:] - moved) ** 2 / self.walks[:, None])
            + np.sum(np.diff(slip) ** 2 / self.slip_walks)
        )

    def run(
        self,
        states: Floats,
        *,
        condensed: tuple[Floats, Floats] | None = None,
        prior: tuple[Floats, Floats] | None = None,
        smooth: bool = True,
    ) -> SlipPath:
        """Filter, and smooth, linearised at the states; without condensed blocks, at each prediction."""
        follow = condensed is None
        mean, std = prior or (self.prior_mean, self.prior_std)
        informations, scores = condensed or (np.empty((len(states), self.size, self.size)), np.empty_like(states))
        means, covariances = np.empty_like(states), np.empty((len(states), self.size, self.size))
        means[0], covariances[0] = mean, np.diag(std**2)
        total, count = _slip_kernels.forward(
            self.x,
            self.phase,
            self.order,
            self.scale,
            self.edges,
            self.centres,
            self.turns,
            self.walks,
            self.slip_walks,
            follow,
            states,
            informations,
            scores,
            means,
            covariances,
        )
        if smooth:
            try:
                _slip_kernels.backward(self.turns, self.walks, self.slip_walks, follow, states, means, covariances)
            except np.linalg.LinAlgError as error:
                raise self._lost() from error
        if not np.all(np.diagonal(covariances, axis1=1, axis2=2) > 0):
            raise self._lost()
        return SlipPath(means=means, covariances=covariances, innovation_mean_square=total / max(count, 1))

    def _lost(self) -> FloatingPointError:
        loudest = float(np.nanmax(np.abs(self.x))) * self.scale
        return FloatingPointError(
            f"the covariance of {len(self.centres)} blocks is not positive definite in double precision, with x of up "
            f"to {loudest:.2g} times the noise; take a larger slip_change_per_rev, a wider bandwidth "
            "or, where that is more than the record is good for, a larger noise_variance."
        )


def in_blocks(record: SlipRecord, line: Line, *, width: Floats, noise_variance: float, every: int | None) -> SlipChain:
    """Cut the record into blocks; `width` is the bandwidth in cycles a sample, one number or one a sample."""
    edges, outputs = _cut(record, line, width=width, every=every)
    centres = (edges[:-1] + edges[1:] - 1) // 2
    turning = record.turning[centres]
    walk = process_variance(orders=[line.order], bandwidth=width, rate=1.0, poles=1, noise_variance=1.0)
    walks = np.diff(np.cumsum(walk)[centres]) if walk.size > 1 else walk[0] * np.diff(centres)
    # Where the bandwidth is nothing, or the shaft rests, the variance is; but it has to be divided by.
    walks = np.maximum(walks, 1e-12 * walk.max())
    walks[_breaks(record, edges, line)] = PRIOR_STD**2
    prior_std = np.full(2 * line.harmonics + 1, PRIOR_STD)
    prior_std[-1] = line.largest_slip
    return SlipChain(
        x=record.x,
        phase=record.phase,
        order=line.order,
        scale=float(1 / np.sqrt(noise_variance)),
        edges=edges,
        centres=centres,
        turning=turning,
        outputs=outputs,
        turns=line.order * np.diff(record.phase[centres]),
        walks=walks,
        slip_walks=line.slip_change**2 * np.maximum(np.diff(turning) / (2 * pi), 1e-9),
        prior_mean=np.zeros(prior_std.size),
        prior_std=prior_std,
    )


def _cut(record: SlipRecord, line: Line, *, width: Floats, every: int | None) -> tuple[Whole, Whole]:
    """First samples of the blocks and one past the last; the blocks that are put out."""
    n = record.x.size
    longest = max(1, int(min(_BLOCK / float(width.max()), _SLIP_BLOCK * line.steady_rev * record.per_rev)))
    longest -= (longest + 1) % 2 if longest > 1 else 0  # an odd number of samples has a middle one
    every = every or longest
    groups = np.append(np.arange(0, max(1, n - every // 2), every), n)
    # As many blocks to an output as make none too long.
    shares = -(-np.diff(groups) // longest) if every > longest else np.ones(groups.size - 1, dtype=np.int64)
    first = np.append(0, np.cumsum(shares))
    edges = np.interp(np.arange(first[-1] + 1), first, groups).round().astype(np.int64)
    return edges, first[:-1] + shares // 2


def _breaks(record: SlipRecord, edges: Whole, line: Line) -> Whole:
    """Transitions amid gaps so long that the phase cannot be carried across.

    How many turns the line made there is unknown, so its phase afterwards must not pin down its slip within.
    """
    observed = np.add.reduceat(~np.isnan(record.x), edges[:-1]) > 0
    seen = np.flatnonzero(observed)
    gaps = np.diff(seen)
    before, after = seen[:-1][gaps > 1], seen[1:][gaps > 1]
    turned = (record.turning[edges[after]] - record.turning[edges[before + 1] - 1]) / (2 * pi)
    long = turned > line.steady_rev
    return np.asarray((before[long] + after[long]) // 2, dtype=np.int64)


def extended_filter(chain: SlipChain, ridge: Ridge, *, smooth: bool = False) -> SlipPath:
    """Filter, linearised at each prediction, from the slip with which the ridge begins."""
    mean, std = chain.prior_mean.copy(), chain.prior_std.copy()
    mean[-1] = ridge.slip[0]
    std[-1] = min(std[-1], ridge.slip_width / 2)
    return chain.run(np.empty((chain.centres.size, chain.size)), prior=(mean, std), smooth=smooth)


def starts(chain: SlipChain, ridge: Ridge) -> list[Floats]:
    """Trajectories to start from: the amplitudes that go best with the ridge's slips; the filter's, smoothed."""
    states = np.zeros((chain.centres.size, chain.size))
    states[:, -1] = np.interp(chain.turning, ridge.turning, ridge.slip)
    _, informations, scores = chain.condense(states)
    given = chain.run(states, condensed=(informations, scores)).means
    # At zero amplitude nothing depends on the slip, which the sweep therefore returned to its prior.
    given[:, -1] = states[:, -1]
    return [given, extended_filter(chain, ridge, smooth=True).means]


def iterate(chain: SlipChain, states: Floats, *, limit: int) -> tuple[SlipPath, Status, Floats]:
    """Gauss-Newton steps from a start, each halved until the objective falls."""
    cost, *condensed = chain.condense(states)
    costs = [cost]
    for _ in range(limit):
        path = chain.run(states, condensed=(condensed[0].copy(), condensed[1].copy()))
        step = path.means - states
        size = float(np.max(np.abs(step) / np.sqrt(np.diagonal(path.covariances, axis1=1, axis2=2))))
        if size < _SETTLED:
            return path, "converged", np.array(costs)
        for halving in range(_HALVINGS):
            trial = states + step / 2**halving
            cost, *fresh = chain.condense(trial)
            if cost < costs[-1]:
                break
        else:
            return path, "converged" if size < _FLAT else "not converged", np.array(costs)
        states, condensed = trial, fresh
        costs.append(cost)
    path = chain.run(states, condensed=(condensed[0], condensed[1]))
    return path, "not converged", np.array(costs)
