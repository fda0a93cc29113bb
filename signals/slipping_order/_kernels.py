"""Loops over samples and blocks of the extended Kalman filter and smoother of a slipping order; see `slip`.

A state is the real parts of A over the harmonics, their imaginary parts, and the slip. The samples of a block,
linearised at a state, are condensed to the information matrix and the score of a least-squares problem; a Kalman filter
runs forward through the blocks and a Rauch-Tung-Striebel smoother backward.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


class SlipChain(NamedTuple):
    """A record in blocks, divided by the standard deviation of its noise."""

    x: Floats  # (sample,), the record over the standard deviation of its noise
    phase: Floats  # (sample,), angle of the shaft in rad
    order: float  # of the fundamental, cycles per revolution
    edges: Whole  # (block + 1,), first samples of the blocks and one past the last
    centres: Whole  # (block,), their middle samples
    turning: Floats  # (block,), `SlipRecord.turning` there
    outputs: Whole  # (output,), the blocks that have an output
    turns: Floats  # (block - 1,), order times the change of the phase from middle to middle
    process: Floats  # (block - 1,), process-noise variances of a quadrature from block to block
    slip_process: Floats  # (block - 1,), those of the slip
    prior_mean: Floats  # (state,)
    prior_std: Floats  # (state,)


@compiled
def condense(chain: SlipChain, first: int, last: int, states: Floats, informations: Floats, scores: Floats) -> float:
    """Linearise blocks at their states: fill H^T H and H^T residual of each; return the sum of squared residuals."""
    harmonics, squares = states.shape[1] // 2, 0.0
    row = np.empty(states.shape[1])
    for m in range(first, last):
        state, information, score = states[m], informations[m], scores[m]
        information[:], score[:] = 0.0, 0.0
        for n in range(chain.edges[m], chain.edges[m + 1]):
            if np.isnan(chain.x[n]):
                continue
            lead = chain.order * (chain.phase[n] - chain.phase[chain.centres[m]])
            angle = chain.order * chain.phase[n] + state[-1] * lead
            cosine, sine = np.cos(angle), np.sin(angle)
            c, s = 1.0, 0.0
            residual = chain.x[n]
            row[-1] = 0.0
            for k in range(harmonics):
                c, s = c * cosine - s * sine, s * cosine + c * sine
                real, imaginary = state[k], state[harmonics + k]
                row[k] = c
                row[harmonics + k] = -s
                residual -= real * c - imaginary * s
                row[-1] -= (k + 1) * lead * (real * s + imaginary * c)
            squares += residual * residual
            for a in range(row.size):
                score[a] += row[a] * residual
                for b in range(row.size):
                    information[a, b] += row[a] * row[b]
    return squares


@compiled
def _update(
    information: Floats, score: Floats, at: Floats, mean: Floats, P: Floats, full: Floats, row: Floats, gain: Floats
) -> tuple[float, int]:
    """Update mean and P by a block linearised at the state `at`; its information and score are overwritten.

    Each pivot of the information is a scalar measurement with unit noise: `row (state - at) + noise = datum`.
    Returns the sum of squared innovations over their variances, and their number. The last three are scratch, (state,).
    """
    total, count = 0.0, 0
    for a in range(mean.size):
        full[a] = information[a, a]
    for _ in range(mean.size):
        # The rank is at most the number of samples: largest relative pivot first, down to rounding errors.
        pivot, largest = -1, 1e-12
        for a in range(mean.size):
            if information[a, a] > largest * full[a]:
                pivot, largest = a, information[a, a] / full[a]
        if pivot < 0:
            break
        root = np.sqrt(information[pivot, pivot])
        datum = score[pivot] / root
        for a in range(mean.size):
            row[a] = information[pivot, a] / root
        innovation, variance = datum, 1.0
        for a in range(mean.size):
            score[a] -= row[a] * datum
            for b in range(mean.size):
                information[a, b] -= row[a] * row[b]
            gain[a] = 0.0
            for b in range(mean.size):
                gain[a] += P[a, b] * row[b]
            innovation -= row[a] * (mean[a] - at[a])
            variance += row[a] * gain[a]
        for a in range(mean.size):
            information[pivot, a] = information[a, pivot] = 0.0
            mean[a] += gain[a] * (innovation / variance)
            for b in range(mean.size):
                P[a, b] -= gain[a] * gain[b] / variance
        total += innovation * innovation / variance
        count += 1
    return total, count


@compiled
def _times(F: Floats, P: Floats, product: Floats) -> None:
    """Fill `product` with F P^T."""
    for a in range(len(F)):
        for b in range(len(F)):
            product[a, b] = 0.0
            for c in range(len(F)):
                product[a, b] += F[a, c] * P[b, c]


@compiled
def _predict(
    step: tuple[float, float, float], at: Floats, ahead: float, mean: Floats, P: Floats, F: Floats, FP: Floats,
    mean_ahead: Floats, P_ahead: Floats,
) -> None:  # fmt: skip
    """Predict mean and P of the next block by F, linearised where the state is `at` and the next slip `ahead`.

    The step is its `turns`, `process` and `slip_process` of the chain. Fills F, F P, and both predictions.
    """
    turn, process, slip_process = step
    size, harmonics, middle = mean.size, mean.size // 2, 0.5 * (at[-1] + ahead)
    off = mean[-1] - middle
    F[:] = 0.0
    F[-1, -1] = 1.0
    for k in range(harmonics):
        rate = (k + 1) * turn
        c, s = np.cos(rate * middle), np.sin(rate * middle)
        F[k, k] = F[harmonics + k, harmonics + k] = c
        F[k, harmonics + k] = -s
        F[harmonics + k, k] = s
        F[k, -1] = -rate * (s * at[k] + c * at[harmonics + k])
        F[harmonics + k, -1] = rate * (c * at[k] - s * at[harmonics + k])
        mean_ahead[k] = c * mean[k] - s * mean[harmonics + k] + F[k, -1] * off
        mean_ahead[harmonics + k] = s * mean[k] + c * mean[harmonics + k] + F[harmonics + k, -1] * off
    mean_ahead[-1] = mean[-1]
    _times(F, P, FP)
    _times(F, FP, P_ahead)
    for a in range(size):
        P_ahead[a, a] += process if a < size - 1 else 0.0
        for b in range(a + 1):
            # The slip within the step is the mean of both blocks', so its change turns the line by half as much.
            share = (0.5 if a < size - 1 else 1.0) * (0.5 if b < size - 1 else 1.0)
            P_ahead[a, b] += slip_process * share * F[a, -1] * F[b, -1]
            P_ahead[b, a] = P_ahead[a, b]


@compiled
def forward(
    chain: SlipChain, extended: bool, states: Floats, informations: Floats, scores: Floats, means: Floats,
    covariances: Floats,
) -> tuple[float, int]:  # fmt: skip
    """Filter all blocks, linearised at `states` or, as the extended Kalman filter, at each prediction.

    The informations, (block, state, state), and scores, (block, state), condensed at the states, (block, state), are
    overwritten; the extended filter returns its filtered means in `states`. Means and covariances, of the prior in the
    first block, are filled with those after each block. Returns the sum of squared innovations over their variances,
    and their number.
    """
    blocks, size = means.shape
    F, FP = np.empty((size, size)), np.empty((size, size))
    full, row, gain = np.empty(size), np.empty(size), np.empty(size)
    total, count = 0.0, 0
    for m in range(blocks):
        state, mean, P = states[m], means[m], covariances[m]
        if extended:
            state[:] = mean
            condense(chain, m, m + 1, states, informations, scores)
        added, more = _update(informations[m], scores[m], state, mean, P, full, row, gain)
        total += added
        count += more
        if extended:
            state[:] = mean
        if m + 1 < blocks:
            step = chain.turns[m], chain.process[m], chain.slip_process[m]
            ahead = states[m if extended else m + 1, -1]
            _predict(step, state, ahead, mean, P, F, FP, means[m + 1], covariances[m + 1])
    return total, count


@compiled
def backward(chain: SlipChain, extended: bool, states: Floats, means: Floats, covariances: Floats) -> bool:
    """Smooth what `forward` returned, in place (Rauch, Tung, Striebel); return whether every covariance allows it."""
    blocks, size = means.shape
    F, gain, factor = np.empty((size, size)), np.empty((size, size)), np.empty((size, size))
    P, spread, mean = np.empty((size, size)), np.empty((size, size)), np.empty(size)
    for m in range(blocks - 2, -1, -1):
        step = chain.turns[m], chain.process[m], chain.slip_process[m]
        ahead = states[m if extended else m + 1, -1]
        _predict(step, states[m], ahead, means[m], covariances[m], F, gain, mean, P)
        # The gain, transposed: P^-1 F P_m, by elimination, which needs no pivots where P is positive definite.
        factor[:] = P
        for a in range(size):
            if not factor[a, a] > 0.0:
                return False
            for b in range(a + 1, size):
                share = factor[b, a] / factor[a, a]
                for c in range(a, size):
                    factor[b, c] -= share * factor[a, c]
                for c in range(size):
                    gain[b, c] -= share * gain[a, c]
        for a in range(size - 1, -1, -1):
            for c in range(size):
                for b in range(a + 1, size):
                    gain[a, c] -= factor[a, b] * gain[b, c]
                gain[a, c] /= factor[a, a]
        for a in range(size):
            for b in range(size):
                means[m, a] += gain[b, a] * (means[m + 1, b] - mean[b])
                factor[b, a] = gain[a, b]
        _times(factor, covariances[m + 1] - P, spread)
        _times(spread, factor, P)
        covariances[m] += P
    return True
