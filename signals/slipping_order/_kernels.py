"""Loops over samples and blocks of the extended Kalman filter and smoother of a slipping order; see `slip`.

A state is the real parts of A over the harmonics, their imaginary parts, the mean of the record, and the slip. The
covariance filter of `signals.harmonics` runs through the samples, linearised at one state a block, and predicts from
block to block; a Rauch-Tung-Striebel smoother runs backward.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums_in_place
from signals.harmonics._block_kernels import fill_phasors
from signals.harmonics._filter_kernels import dot, project, update_covariance, update_mean

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


@compiled_sums_in_place
def _linearise(chain: SlipChain, m: int, state: Floats, H: Floats, samples: Floats) -> int:
    """Linearise block m at a state: fill H and the first of `samples`, `x - h(state) + H state`; return its length."""
    first, harmonics = chain.edges[m], state.size // 2 - 1
    count = int(chain.edges[m + 1] - first)
    linear, lead, whole, cosine, sine = samples[0], samples[1], samples[2], samples[3], samples[4]
    for n in range(count):
        lead[n] = chain.order * (chain.phase[first + n] - chain.phase[chain.centres[m]])
        whole[n] = chain.order * chain.phase[first + n] + state[-1] * lead[n]
    fill_phasors(1.0, whole[:count], cosine, sine)
    for n in range(count):
        c, s = 1.0, 0.0
        H[n, -2], H[n, -1] = 1.0, 0.0
        for k in range(harmonics):
            c, s = c * cosine[n] - s * sine[n], s * cosine[n] + c * sine[n]
            real, imaginary = state[k], state[harmonics + k]
            H[n, k] = c
            H[n, harmonics + k] = -s
            H[n, -1] -= (k + 1) * lead[n] * (real * s + imaginary * c)
        linear[n] = chain.x[first + n] + H[n, -1] * state[-1]  # in the amplitudes h is linear
    return count


@compiled_sums_in_place
def squares(chain: SlipChain, states: Floats, H: Floats, samples: Floats) -> float:
    """Return the sum of the squared residuals of all blocks at their states; arguments as for `forward`."""
    total = 0.0
    for m in range(len(states)):
        for n in range(_linearise(chain, m, states[m], H, samples)):
            residual = samples[0, n] - dot(H[n], states[m])
            if not np.isnan(residual):
                total += residual * residual
    return total


@compiled_sums_in_place
def _times(F: Floats, P: Floats, product: Floats) -> None:
    """Fill `product` with F P^T."""
    for a in range(len(F)):
        for b in range(len(F)):
            product[a, b] = 0.0
            for c in range(len(F)):
                product[a, b] += F[a, c] * P[b, c]


@compiled_sums_in_place
def _predict(
    step: tuple[float, float, float], at: Floats, ahead: float, mean: Floats, P: Floats, F: Floats, FP: Floats,
    mean_ahead: Floats, P_ahead: Floats,
) -> None:  # fmt: skip
    """Predict mean and P of the next block by F, linearised where the state is `at` and the next slip `ahead`.

    The step is its `turns`, `process` and `slip_process` of the chain. Fills F, F P, and both predictions.
    """
    turn, process, slip_process = step
    size, harmonics, middle = mean.size, mean.size // 2 - 1, 0.5 * (at[-1] + ahead)
    off = mean[-1] - middle
    F[:] = 0.0
    F[-2, -2] = F[-1, -1] = 1.0
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
    mean_ahead[-2], mean_ahead[-1] = mean[-2], mean[-1]
    _times(F, P, FP)
    _times(F, FP, P_ahead)
    for a in range(size):
        if a < size - 1:
            P_ahead[a, a] += process if a < 2 * harmonics else 0.5 * process  # the mean has one quadrature
        for b in range(a + 1):
            # The slip within the step is the mean of both blocks', so its change turns the line by half as much.
            share = (0.5 if a < size - 1 else 1.0) * (0.5 if b < size - 1 else 1.0)
            P_ahead[a, b] += slip_process * share * F[a, -1] * F[b, -1]
            P_ahead[b, a] = P_ahead[a, b]


@compiled_sums_in_place
def forward(
    chain: SlipChain, extended: bool, states: Floats, means: Floats, covariances: Floats, H: Floats, samples: Floats,
    F: Floats, FP: Floats, ph: Floats,
) -> tuple[float, int]:  # fmt: skip
    """Filter all blocks, linearised at `states` or, as the extended Kalman filter, at each prediction.

    States and means, (block, state), are one array of the extended filter. Means and covariances, of the prior in the
    first block, are filled with those after each block. Scratch are H, (sample, state), and (5, sample) for the
    longest block, F and F P, (state, state), and P h, (state,). Returns the sum of squared innovations over their
    variances, and their number.
    """
    blocks, total, count = len(means), 0.0, 0
    for m in range(blocks):
        state, mean, P = states[m], means[m], covariances[m]
        for n in range(_linearise(chain, m, state, H, samples)):
            if not np.isnan(samples[0, n]):
                h = H[n]
                precision = 1.0 / project(P, h, ph)
                update_covariance(P, ph, precision)
                innovation = update_mean(mean, h, samples[0, n], ph, precision)
                total += innovation * innovation * precision
                count += 1
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
