"""A record with a slipping line as a chain of blocks: its objective, its filter and its smoother, of `slip`."""

from math import pi
from typing import Literal, NamedTuple

import numpy as np

from signals.harmonics._slip_kernels import SlipChain, backward, condense, forward
from signals.harmonics._slip_search import Line, Ridge, SlipRecord
from signals.harmonics.bandwidth import process_variance
from signals.harmonics.model import PRIOR_STD, Floats

Status = Literal["converged", "not converged", "single pass", "no line"]

# Of 1 / bandwidth, and of the stretch over which the walk of the slip turns the line by a radian: in shorter blocks
# what is held constant differs from the continuous walks by a few 1e-4 of the uncertainty.
_BLOCK = 1 / 200
_SLIP_BLOCK = 1 / 50
_SETTLED = 1e-7  # of a standard deviation: no change
_FLAT = 1e-3  # the same: where rounding keeps the objective from falling, the step is far below


class SlipPath(NamedTuple):
    """States of all blocks, their covariances, and the mean of the squared innovations over their variances."""

    means: Floats
    covariances: Floats
    innovation_mean_square: float


def in_blocks(record: SlipRecord, line: Line, *, width: Floats, noise_variance: float, every: int | None) -> SlipChain:
    """Cut the record into blocks; `width` is the bandwidth in cycles a sample, one number or one a sample."""
    n = record.x.size
    longest = max(1, int(min(_BLOCK / float(width.max()), _SLIP_BLOCK * line.steady_rev * record.per_rev)))
    longest -= (longest + 1) % 2 if longest > 1 else 0  # an odd number of samples has a middle one
    every = every or longest
    groups = np.append(np.arange(0, max(1, n - every // 2), every), n)
    # As many blocks to an output as make none too long.
    shares = -(-np.diff(groups) // longest) if every > longest else np.ones(groups.size - 1, dtype=np.int64)
    first = np.append(0, np.cumsum(shares))
    edges = np.interp(np.arange(first[-1] + 1), first, groups).round().astype(np.int64)
    centres = (edges[:-1] + edges[1:] - 1) // 2

    walk = process_variance(orders=[line.order], bandwidth=width, rate=1.0, poles=1, noise_variance=1.0)
    walks = np.diff(np.cumsum(walk)[centres]) if walk.size > 1 else walk[0] * np.diff(centres)
    # Where the bandwidth is nothing, or the shaft rests, the variance is; but it has to be divided by.
    walks = np.maximum(walks, 1e-12 * walk.max())
    # How many turns the line made in a long gap is unknown: its phase afterwards must not pin down its slip within.
    observed = np.flatnonzero(np.add.reduceat(~np.isnan(record.x), edges[:-1]))
    before, after = observed[:-1], observed[1:]
    turned = record.turning[edges[after]] - record.turning[edges[before + 1] - 1]
    cut = (after - before > 1) & (turned > 2 * pi * line.steady_rev)
    walks[(before[cut] + after[cut]) // 2] = PRIOR_STD**2

    prior_std = np.append(np.full(2 * line.harmonics, PRIOR_STD), line.largest_slip)
    turning = record.turning[centres]
    return SlipChain(
        x=record.x / np.sqrt(noise_variance),
        phase=record.phase,
        order=line.order,
        edges=edges,
        centres=centres,
        turning=turning,
        outputs=first[:-1] + shares // 2,
        turns=line.order * np.diff(record.phase[centres]),
        walks=walks,
        slip_walks=line.slip_change**2 * np.maximum(np.diff(turning) / (2 * pi), 1e-9),
        prior_mean=np.zeros(prior_std.size),
        prior_std=prior_std,
    )


def _linearise(chain: SlipChain, states: Floats) -> tuple[float, tuple[Floats, Floats]]:
    """Return the objective at these states, and the informations and scores of the blocks."""
    size = chain.prior_mean.size
    informations, scores = np.empty((len(states), size, size)), np.empty_like(states)
    squares = condense(chain, 0, len(states), states, informations, scores)
    harmonics, slip = size // 2, states[:, -1]
    amplitude = states[:, :harmonics] + 1j * states[:, harmonics:-1]
    turn = np.outer(0.5 * (slip[1:] + slip[:-1]) * chain.turns, np.arange(1, harmonics + 1))
    changes = np.abs(amplitude[1:] - np.exp(1j * turn) * amplitude[:-1]) ** 2 / chain.walks[:, None]
    squares += float(np.sum(changes) + np.sum(np.diff(slip) ** 2 / chain.slip_walks))
    squares += float(np.sum(((states[0] - chain.prior_mean) / chain.prior_std) ** 2))
    return 0.5 * squares, (informations, scores)


def _run(
    chain: SlipChain, states: Floats, condensed: tuple[Floats, Floats] | None = None, *, smooth: bool = True
) -> SlipPath:
    """Filter, and smooth, linearised at the states; without condensed blocks, which are used up, at each prediction."""
    follow, size = condensed is None, chain.prior_mean.size
    informations, scores = condensed or (np.empty((len(states), size, size)), np.empty_like(states))
    means, covariances, total, count = forward(chain, follow, states, informations, scores)
    try:
        if smooth:
            backward(chain, follow, states, means, covariances)
        lost = not np.all(np.diagonal(covariances, axis1=1, axis2=2) > 0)
    except np.linalg.LinAlgError:
        lost = True
    if lost:
        raise FloatingPointError(
            f"the covariance of {len(states)} blocks is not positive definite in double precision, with x of up to "
            f"{np.nanmax(np.abs(chain.x)):.2g} times the noise; take a larger slip_change_per_rev, a wider bandwidth "
            "or, where that is more than the record is good for, a larger noise_variance."
        )
    return SlipPath(means, covariances, total / max(count, 1))


def extended_filter(chain: SlipChain, ridge: Ridge, *, smooth: bool = False) -> SlipPath:
    """Filter, linearised at each prediction, from the slip with which the ridge begins."""
    mean = np.append(chain.prior_mean[:-1], ridge.slip[0])
    std = np.append(chain.prior_std[:-1], min(chain.prior_std[-1], ridge.slip_width / 2))
    at_start = chain._replace(prior_mean=mean, prior_std=std)
    return _run(at_start, np.empty((chain.centres.size, mean.size)), smooth=smooth)


def starts(chain: SlipChain, ridge: Ridge) -> list[Floats]:
    """Trajectories to start from: the amplitudes that go best with the ridge's slips; the filter's, smoothed."""
    states = np.zeros((chain.centres.size, chain.prior_mean.size))
    states[:, -1] = np.interp(chain.turning, ridge.turning, ridge.slip)
    given = _run(chain, states, _linearise(chain, states)[1]).means
    # At zero amplitude nothing depends on the slip, which the smoother therefore returned to its prior.
    given[:, -1] = states[:, -1]
    return [given, extended_filter(chain, ridge, smooth=True).means]


def iterate(chain: SlipChain, states: Floats, *, limit: int) -> tuple[SlipPath, Status, Floats]:
    """Take Gauss-Newton steps from a start, each halved until the objective falls."""
    cost, condensed = _linearise(chain, states)
    costs = [cost]
    while True:
        path = _run(chain, states, condensed)
        if len(costs) > limit:
            return path, "not converged", np.array(costs)
        step = path.means - states
        size = first = float(np.max(np.abs(step) / np.sqrt(np.diagonal(path.covariances, axis1=1, axis2=2))))
        while size >= _SETTLED:
            trial = states + step
            cost, condensed = _linearise(chain, trial)
            if cost < costs[-1]:
                break
            step, size = step / 2, size / 2
        else:
            return path, "converged" if first < _FLAT else "not converged", np.array(costs)
        states = trial
        costs.append(cost)
