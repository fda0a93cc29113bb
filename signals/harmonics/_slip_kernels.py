"""The loops over samples and blocks of the tracker of a slipping order.

A state is the real parts of A over the harmonics, their imaginary parts, and the slip: see `slip`. Samples are
condensed block by block, linearised at a state, to the information and the score of a least-squares problem; a
filter goes forward through the blocks and a Rauch-Tung-Striebel sweep back.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Whole = NDArray[np.int64]


@compiled
def demodulate(x: Floats, phase: Floats, order: float, edges: Whole, sums: Complexes, counts: Floats) -> None:
    """Sum `x exp(-j k order phase)` over the observed samples between the edges: sums (harmonic, block)."""
    for block in range(edges.size - 1):
        for n in range(edges[block], edges[block + 1]):
            if not np.isnan(x[n]):
                turn = complex(np.cos(order * phase[n]), -np.sin(order * phase[n]))
                power = turn
                counts[block] += 1.0
                for k in range(len(sums)):
                    sums[k, block] += x[n] * power
                    power *= turn


@compiled
def _condense(
    x: Floats,
    phase: Floats,
    order: float,
    scale: float,
    first: int,
    last: int,
    centre: int,
    state: Floats,
    row: Floats,
    information: Floats,
    score: Floats,
) -> float:
    """Linearise a block at `state`: fill row^T row and row^T residual, summed; return the residuals' squares."""
    harmonics = state.size // 2
    information[:] = 0.0
    score[:] = 0.0
    squares = 0.0
    for n in range(first, last):
        if np.isnan(x[n]):
            continue
        lead = order * (phase[n] - phase[centre])
        angle = order * phase[n] + state[-1] * lead
        cosine, sine = np.cos(angle), np.sin(angle)
        c, s = 1.0, 0.0
        residual = scale * x[n]
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
            for b in range(a + 1):
                information[a, b] += row[a] * row[b]
    for a in range(row.size):
        for b in range(a):
            information[b, a] = information[a, b]
    return squares


@compiled
def condense_all(
    x: Floats,
    phase: Floats,
    order: float,
    scale: float,
    edges: Whole,
    centres: Whole,
    states: Floats,
    informations: Floats,
    scores: Floats,
) -> float:
    """Linearise every block at its state; return the sum of squared residuals of the record."""
    row = np.empty(states.shape[1])
    squares = 0.0
    for m in range(centres.size):
        squares += _condense(
            x, phase, order, scale, edges[m], edges[m + 1], centres[m], states[m], row, informations[m], scores[m]
        )
    return squares


@compiled
def _update(row: Floats, datum: float, at: Floats, mean: Floats, covariance: Floats, gain: Floats) -> float:
    """Take in `datum = row (state - at)` with unit noise; return the squared innovation over its variance."""
    innovation, variance = datum, 1.0
    for a in range(mean.size):
        gain[a] = 0.0
        for b in range(mean.size):
            gain[a] += covariance[a, b] * row[b]
    for a in range(mean.size):
        innovation -= row[a] * (mean[a] - at[a])
        variance += row[a] * gain[a]
    for a in range(mean.size):
        mean[a] += gain[a] * (innovation / variance)
        for b in range(mean.size):
            covariance[a, b] -= gain[a] * gain[b] / variance
    return innovation * innovation / variance


@compiled
def _take(
    information: Floats, score: Floats, at: Floats, mean: Floats, covariance: Floats, row: Floats, gain: Floats
) -> tuple[float, int]:
    """Take a block in, as one scalar measurement of unit noise for each pivot of its information.

    Returns the sum of the squared innovations over their variances, and how many there were.
    """
    total, count = 0.0, 0
    full = np.diag(information).copy()
    for _ in range(mean.size):
        # A block sees no more directions than it has samples: the clearest first, else rounding passes for others.
        i, clearest = -1, 1e-12
        for a in range(mean.size):
            if information[a, a] > clearest * full[a]:
                i, clearest = a, information[a, a] / full[a]
        if i < 0:
            break
        root = np.sqrt(information[i, i])
        datum = score[i] / root
        for a in range(mean.size):
            row[a] = information[a, i] / root
        for a in range(mean.size):
            score[a] -= row[a] * datum
            for b in range(mean.size):
                information[a, b] -= row[a] * row[b]
        # Done with, and nothing is left of it but rounding.
        information[i, :] = 0.0
        information[:, i] = 0.0
        total += _update(row, datum, at, mean, covariance, gain)
        count += 1
    return total, count


@compiled
def _turn(at: Floats, ahead: float, turn: float, mean: Floats, F: Floats) -> None:
    """Fill F, the transition linearised where the state is `at` and the next slip `ahead`; move the mean by it."""
    harmonics = mean.size // 2
    middle = 0.5 * (at[-1] + ahead)
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
        real, imaginary = mean[k], mean[harmonics + k]
        mean[k] = c * real - s * imaginary + F[k, -1] * off
        mean[harmonics + k] = s * real + c * imaginary + F[harmonics + k, -1] * off


@compiled
def _move(F: Floats, walk: float, slip_walk: float, covariance: Floats, moved: Floats) -> None:
    """Turn P into `F P F^T + Q`; leave F P in `moved`."""
    # F couples the two parts of an amplitude to each other and to the slip, and nothing else.
    size, last = len(F), len(F) - 1
    harmonics = size // 2
    for b in range(size):
        for k in range(harmonics):
            real, imaginary = covariance[k, b], covariance[harmonics + k, b]
            moved[k, b] = F[k, k] * real + F[k, harmonics + k] * imaginary + F[k, last] * covariance[last, b]
            moved[harmonics + k, b] = F[harmonics + k, k] * real + F[harmonics + k, harmonics + k] * imaginary
            moved[harmonics + k, b] += F[harmonics + k, last] * covariance[last, b]
        moved[last, b] = covariance[last, b]
    for a in range(size):
        for k in range(harmonics):
            real, imaginary, slip = moved[a, k], moved[a, harmonics + k], moved[a, last]
            covariance[a, k] = F[k, k] * real + F[k, harmonics + k] * imaginary + F[k, last] * slip
            covariance[a, harmonics + k] = F[harmonics + k, k] * real + F[harmonics + k, harmonics + k] * imaginary
            covariance[a, harmonics + k] += F[harmonics + k, last] * slip
        covariance[a, last] = moved[a, last]
    for a in range(size):
        for b in range(a + 1):
            # The change of the slip turns the line by half of what the slip before it does.
            change = slip_walk * F[a, last] * F[b, last]
            change *= (0.5 if a < last else 1.0) * (0.5 if b < last else 1.0)
            covariance[a, b] += change + (walk if a == b and a < last else 0.0)
            covariance[b, a] = covariance[a, b]


@compiled
def forward(
    x: Floats,
    phase: Floats,
    order: float,
    scale: float,
    edges: Whole,
    centres: Whole,
    turns: Floats,
    walks: Floats,
    slip_walks: Floats,
    follow: bool,
    states: Floats,
    informations: Floats,
    scores: Floats,
    means: Floats,
    covariances: Floats,
) -> tuple[float, int]:
    """Filter all blocks: linearised at `states`, or (`follow`) at each prediction, which is then put there.

    Parameters
    ----------
    x, phase, order, scale : the record (times scale), the shaft's angle in rad, the order.
    edges : (block + 1,) array, first samples of the blocks and one past the last.
    centres : (block,) array, their middle samples.
    turns : (block - 1,) array, order times the step of the phase from middle to middle.
    walks, slip_walks : (block - 1,) arrays, variances of the changes of a quadrature and of the slip.
    follow : whether to linearise, and condense, at the prediction: the extended Kalman filter.
    states : (block, state) array; in `follow`, the filtered states on return.
    informations, scores : (block, state, state) and (block, state) arrays; used up.
    means, covariances : (block, state) and (block, state, state) arrays: the first of each holds what is known
        before any sample on entry; filled with what the filter knows.

    Returns
    -------
    Sum of squared innovations over their variances, and their number.
    """
    size = means.shape[1]
    mean, covariance = means[0].copy(), covariances[0].copy()
    row, gain = np.empty(size), np.empty(size)
    F, moved = np.empty((size, size)), np.empty((size, size))
    total, count = 0.0, 0
    for m in range(centres.size):
        if follow:
            states[m] = mean
            _condense(x, phase, order, scale, edges[m], edges[m + 1], centres[m], mean, row, informations[m], scores[m])
        added, more = _take(informations[m], scores[m], states[m], mean, covariance, row, gain)
        total += added
        count += more
        means[m] = mean
        covariances[m] = covariance
        if follow:
            states[m] = mean
        if m + 1 < centres.size:
            ahead = states[m, -1] if follow else states[m + 1, -1]
            _turn(states[m], ahead, turns[m], mean, F)
            _move(F, walks[m], slip_walks[m], covariance, moved)
    return total, count


@compiled
def _gain(moved: Floats, factor: Floats, G: Floats) -> None:
    """Fill G with `(F P)^T S^-1`, S = factor factor^T, row by row: forth and back through the triangle."""
    size = len(G)
    for row in range(size):
        for a in range(size):
            value = moved[a, row]
            for b in range(a):
                value -= factor[a, b] * G[row, b]
            G[row, a] = value / factor[a, a]
        for a in range(size - 1, -1, -1):
            value = G[row, a]
            for b in range(a + 1, size):
                value -= factor[b, a] * G[row, b]
            G[row, a] = value / factor[a, a]


@compiled
def backward(
    turns: Floats, walks: Floats, slip_walks: Floats, follow: bool, states: Floats, means: Floats, covariances: Floats
) -> None:
    """Turn what the filter knows into what all blocks say (Rauch, Tung, Striebel); arguments as in `forward`."""
    size = means.shape[1]
    F, moved, factor = np.empty((size, size)), np.empty((size, size)), np.empty((size, size))
    G, spread = np.empty((size, size)), np.empty((size, size))
    for m in range(len(means) - 2, -1, -1):
        mean = means[m].copy()
        covariance = covariances[m].copy()
        ahead = states[m, -1] if follow else states[m + 1, -1]
        _turn(states[m], ahead, turns[m], mean, F)
        _move(F, walks[m], slip_walks[m], covariance, moved)
        factor[:] = np.linalg.cholesky(covariance)
        _gain(moved, factor, G)
        for a in range(size):
            for b in range(size):
                means[m, a] += G[a, b] * (means[m + 1, b] - mean[b])
                spread[a, b] = 0.0
                for i in range(size):
                    spread[a, b] += G[a, i] * (covariances[m + 1, i, b] - covariance[i, b])
        for a in range(size):
            for b in range(a + 1):
                for i in range(size):
                    covariances[m, a, b] += spread[a, i] * G[b, i]
                covariances[m, b, a] = covariances[m, a, b]
