"""Extended Kalman filter and iterated smoother of a record with a slipping order, in blocks; the model is in `slip`."""

from math import pi
from typing import Literal, NamedTuple

import numpy as np

from signals.harmonics.bandwidth import process_variance
from signals.harmonics.state_space import PRIOR_STD, Floats
from signals.slipping_order._kernels import SlipChain, backward, forward, squares
from signals.slipping_order.slip_detection import Line, Ridge, SlipRecord

Status = Literal[
    "converged", "slip at its bound", "slip faster than declared", "not converged", "single pass", "no line"
]

# Length of a block times the bandwidth, and over the segment in which the random walk of the slip turns the line by a
# radian: holding amplitude and slip constant in a block changes the estimates by a few 1e-4 of their std.
_BLOCK = 1 / 200
_SLIP_BLOCK = 1 / 50
_SMALLEST_STEP = 1e-7  # in standard deviations: shorter steps are no longer tried
_CONVERGED = 1e-3  # the same: after a step so short the next ones, each a part of the last, change nothing of use


class SlipPath(NamedTuple):
    """Means and covariances of the states of all blocks, and the mean square of the normalised innovations."""

    means: Floats
    covariances: Floats
    innovation_mean_square: float


def in_blocks(record: SlipRecord, line: Line, *, width: Floats, noise_variance: float, every: int | None) -> SlipChain:
    """Cut the record into blocks; `width` is the bandwidth in cycles per sample, (1,) or (sample,)."""
    n = record.x.size
    longest = max(1, int(min(_BLOCK / float(width.max()), _SLIP_BLOCK * line.steady_rev * record.per_rev)))
    longest -= (longest + 1) % 2 if longest > 1 else 0  # an odd number of samples has a middle one
    every = every or longest
    groups = np.append(np.arange(0, max(1, n - every // 2), every), n)
    # The fewest blocks per output of which none is too long.
    shares = -(-np.diff(groups) // longest) if every > longest else np.ones(groups.size - 1, dtype=np.int64)
    first = np.append(0, np.cumsum(shares))
    edges = np.interp(np.arange(first[-1] + 1), first, groups).round().astype(np.int64)
    centres = (edges[:-1] + edges[1:] - 1) // 2

    q = process_variance(orders=[line.order], bandwidth=width, rate=1.0, poles=1, noise_variance=1.0)
    process = np.diff(np.cumsum(q)[centres]) if q.size > 1 else q[0] * np.diff(centres)
    # Zero where the bandwidth is, or the shaft rests; but it is a divisor.
    process = np.maximum(process, 1e-12 * q.max())
    # The number of turns in a long gap is unknown: the phase after it must not determine the slip within.
    observed = np.flatnonzero(np.add.reduceat(~np.isnan(record.x), edges[:-1]))
    before, after = observed[:-1], observed[1:]
    turned = record.turning[edges[after]] - record.turning[edges[before + 1] - 1]
    cut = (after - before > 1) & (turned > 2 * pi * line.steady_rev)
    process[(before[cut] + after[cut]) // 2] = PRIOR_STD**2

    prior_std = np.append(np.full(2 * line.harmonics + 1, PRIOR_STD), line.largest_slip)
    turning = record.turning[centres]
    return SlipChain(
        x=record.x / np.sqrt(noise_variance), phase=record.phase, order=line.order, edges=edges, centres=centres,
        turning=turning, outputs=first[:-1] + shares // 2, turns=line.order * np.diff(record.phase[centres]),
        process=process, slip_process=line.slip_change**2 * np.maximum(np.diff(turning) / (2 * pi), 1e-9),
        prior_mean=np.zeros(prior_std.size), prior_std=prior_std,
    )  # fmt: skip


def _scratch(chain: SlipChain) -> tuple[Floats, Floats]:
    longest = int(np.diff(chain.edges).max())
    return np.empty((longest, chain.prior_mean.size)), np.empty((5, longest))


def _objective(chain: SlipChain, states: Floats) -> float:
    """Return half the sum of squares at these states: samples, changes from block to block, and the first state."""
    harmonics, mean, slip = states.shape[1] // 2 - 1, states[:, -2], states[:, -1]
    amplitude = states[:, :harmonics] + 1j * states[:, harmonics:-2]
    turn = np.outer(0.5 * (slip[1:] + slip[:-1]) * chain.turns, np.arange(1, harmonics + 1))
    changes = np.abs(amplitude[1:] - np.exp(1j * turn) * amplitude[:-1]) ** 2 / chain.process[:, None]
    total = squares(chain, states, *_scratch(chain)) + float(
        np.sum(changes)
        + np.sum(np.diff(mean) ** 2 / (0.5 * chain.process))
        + np.sum(np.diff(slip) ** 2 / chain.slip_process)
    )
    total += float(np.sum(((states[0] - chain.prior_mean) / chain.prior_std) ** 2))
    return 0.5 * total


def _run(chain: SlipChain, states: Floats | None = None, *, smooth: bool = True) -> SlipPath:
    """Filter and smooth, linearised at `states`, (block, state), or, without them, at each prediction."""
    extended, size = states is None, chain.prior_mean.size
    means, covariances = np.empty((chain.centres.size, size)), np.empty((chain.centres.size, size, size))
    states = means if states is None else states
    means[0], covariances[0] = chain.prior_mean, np.diag(chain.prior_std**2)
    F, FP = np.empty((2, size, size))
    total, count = forward(chain, extended, states, means, covariances, *_scratch(chain), F, FP, np.empty(size))
    sound = not smooth or backward(chain, extended, states, means, covariances)
    if not sound or not np.all(np.diagonal(covariances, axis1=1, axis2=2) > 0):
        raise FloatingPointError(
            f"the covariance of {len(states)} blocks is not positive definite in double precision, with x of up to "
            f"{np.nanmax(np.abs(chain.x)):.2g} times the noise; take a larger slip_change_per_rev, a wider bandwidth "
            "or, where that is more than the record is good for, a larger noise_variance."
        )
    return SlipPath(means, covariances, total / max(count, 1))


def extended_filter(chain: SlipChain, ridge: Ridge, *, smooth: bool = False) -> SlipPath:
    """Run the extended Kalman filter from the first slip of the ridge."""
    mean = np.append(chain.prior_mean[:-1], ridge.slip[0])
    std = np.append(chain.prior_std[:-1], min(chain.prior_std[-1], ridge.slip_width / 2))
    at_start = chain._replace(prior_mean=mean, prior_std=std)
    return _run(at_start, smooth=smooth)


def starts(chain: SlipChain, ridge: Ridge) -> list[Floats]:
    """Return initial trajectories: the best amplitudes for the ridge's slips, and the smoothed extended filter."""
    states = np.zeros((chain.centres.size, chain.prior_mean.size))
    states[:, -1] = np.interp(chain.turning, ridge.turning, ridge.slip)
    given = _run(chain, states).means
    # At zero amplitude the record does not depend on the slip, of which the smoother returned the prior.
    given[:, -1] = states[:, -1]
    return [given, extended_filter(chain, ridge, smooth=True).means]


def iterate(chain: SlipChain, states: Floats, *, limit: int) -> tuple[SlipPath, Status, Floats]:
    """Take Gauss-Newton steps from initial states, each halved until the objective falls."""
    costs = [_objective(chain, states)]
    while True:
        path = _run(chain, states)
        if len(costs) > limit:
            return path, "not converged", np.array(costs)
        step = path.means - states
        size = float(np.max(np.abs(step) / np.sqrt(np.diagonal(path.covariances, axis1=1, axis2=2))))
        if size < _CONVERGED:
            return path, "converged", np.array(costs)
        while size >= _SMALLEST_STEP:
            trial = states + step
            cost = _objective(chain, trial)
            if cost < costs[-1]:
                break
            step, size = step / 2, size / 2
        else:
            return path, "not converged", np.array(costs)
        states = trial
        costs.append(cost)
