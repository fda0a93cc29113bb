"""Extended Kalman filter and iterated smoother of a record with a slipping order, in blocks; see `slip_tracking`."""

from math import pi
from typing import Literal

import numpy as np

from signals.harmonics.state_space import Floats
from signals.slipping_order._kernels import SlipChain, filter_blocks, smooth_blocks
from signals.slipping_order.slip_detection import SlipRecord

Status = Literal[
    "converged", "slip at its bound", "slip faster than declared", "not converged", "single pass", "no line"
]

# In standard deviations: after a step so short the next ones, each a part of the last, change nothing of use.
_CONVERGED = 1e-3


def chain_of(record: SlipRecord, *, noise_variance: float) -> SlipChain:
    """Return the chain of a record's blocks.

    Filter and smoother raise `numpy.linalg.LinAlgError` where information is not positive definite in double precision.
    """
    (edges, centres, _), model = record.blocks, record.model
    q = np.broadcast_to(model.process_noise()[:, 0], record.x.size)
    # Zero where the bandwidth is, or the shaft rests; but it is a divisor.
    process = np.maximum(np.diff(np.cumsum(q)[centres]), 1e-12 * q.max())
    # The number of turns in a long gap is unknown: the phase after it must not determine the slip within.
    observed = np.flatnonzero(np.add.reduceat(~np.isnan(record.x), edges[:-1]))
    before, after = observed[:-1], observed[1:]
    turned = record.turning[edges[after]] - record.turning[edges[before + 1] - 1]
    cut = (after - before > 1) & (turned > 2 * pi * record.steady_rev)
    process[(before[cut] + after[cut]) // 2] = model.prior_std**2
    # Not less than the rounding of a slip.
    slip = np.maximum(record.slip_change**2 * np.diff(record.turning[centres]) / (2 * pi), 1e-24)
    size, blocks = 2 * model.orders.size + 2, centres.size
    prior_std = np.append(np.full(size - 1, model.prior_std), record.largest_slip)
    return SlipChain(
        x=record.x / np.sqrt(noise_variance), angle=model.orders[0] * model.phases[0], edges=edges, centres=centres,
        process=np.column_stack([*[process] * (size - 2), 0.5 * process, slip]),  # the mean has one quadrature
        states=np.zeros((blocks, size)), slip_phase=np.zeros(blocks), J=np.diag(prior_std**-2), j=np.zeros((size, 1)),
        gains=np.empty((blocks, size, size)), shares=np.empty((blocks, size)), offsets=np.empty((blocks, size, 1)),
    )  # fmt: skip


def extended_filter(chain: SlipChain, *, slip: float, slip_std: float) -> SlipChain:
    """Run the extended Kalman filter from a first slip."""
    J = chain.J.copy()
    J[-1, -1] = slip_std**-2
    run = chain._replace(states=chain.states + np.append(np.zeros(len(J) - 1), slip), J=J)
    _checked(filter_blocks(run, True))
    return run


def _checked(total: float) -> float:
    if not np.isfinite(total):
        raise np.linalg.LinAlgError("information matrix is not positive definite")
    return total


def _linearised(chain: SlipChain, states: Floats, slip_phase: Floats) -> tuple[SlipChain, float]:
    """Filter about states, whose amplitudes are relative to a slipped phase; return half their sum of squares, too.

    In the result they are relative to the phase that their own slips add up to.
    """
    harmonics, slip = states.shape[1] // 2 - 1, states[:, -1]
    steps = 0.5 * (slip[1:] + slip[:-1]) * np.diff(chain.angle[chain.centres])
    own_phase = np.append(0.0, np.cumsum(steps))
    turn = np.exp(1j * np.outer(slip_phase - own_phase, np.arange(1, harmonics + 1)))
    amplitude = (states[:, :harmonics] + 1j * states[:, harmonics:-2]) * turn
    states = np.concatenate([amplitude.real, amplitude.imag, states[:, -2:]], axis=1)
    before = chain.J @ states[0]
    filled = {name: np.empty_like(getattr(chain, name)) for name in ("gains", "shares", "offsets")}
    run = chain._replace(states=states, slip_phase=own_phase, J=chain.J.copy(), j=-before[:, None], **filled)
    total = filter_blocks(run, False) + np.sum(np.diff(states, axis=0) ** 2 / chain.process) + states[0] @ before
    return run, _checked(0.5 * float(total))


def _smoothed(chain: SlipChain) -> tuple[Floats, float]:
    """Smooth; return the Gauss-Newton step of the states, and the largest of its parts over their std."""
    smooth_blocks(chain)
    step = chain.offsets[:, :, 0]
    return step, float(np.max(np.abs(step) / np.sqrt(np.diagonal(chain.gains, axis1=1, axis2=2))))


def along(chain: SlipChain, slip: Floats) -> SlipChain:
    """Return the path with the best amplitudes for a slip in each block."""
    states = chain.states.copy()
    states[:, -1] = slip
    run, _ = _linearised(chain, states, np.zeros(slip.size))
    step, _ = _smoothed(run)
    step[:, -1] = 0.0  # at zero amplitude the record does not depend on the slip
    return run._replace(states=run.states + step)


def smooth(chain: SlipChain, start: SlipChain, *, limit: int) -> tuple[SlipChain, Status, Floats]:
    """Take Gauss-Newton steps from a path, each halved until the objective falls.

    Returns the path, and the objective at the start and after each step.
    """
    run, cost = _linearised(chain, start.states, start.slip_phase)
    (step, size), costs, share = _smoothed(run), [cost], 1.0
    while True:
        trial, cost = _linearised(chain, run.states + share * step, run.slip_phase)
        if better := cost < costs[-1]:
            costs.append(cost)
        if share * size < _CONVERGED or len(costs) > limit:
            break
        if better:
            run, share = trial, 1.0
            step, size = _smoothed(run)
        else:
            share /= 2
    return trial._replace(gains=run.gains), "converged" if size < _CONVERGED else "not converged", np.array(costs)
