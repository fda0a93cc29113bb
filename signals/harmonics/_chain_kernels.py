"""Loops over the nodes of a chain: the filter in information form, forward, and the smoother, backward.

The states, their transitions and the notation are those of `node_chain`.
"""

from math import frexp

import numpy as np

from signals._compile import compiled_in_place, compiled_sums_in_place
from signals.harmonics.state_space import Floats


@compiled_in_place
def _add_increment(
    J: Floats, j: Floats, a: int, q: float, renewed: bool, gain: Floats, offset: Floats, squares: Floats
) -> tuple[float, float]:
    """Add an increment w of variance q to part a of the state, s = x + e_a w; return var(w | s) and 1 + q J_aa.

    Given s, w is `gain . s - offset`, with `gain = q J_a / (1 + q J_aa)` and `offset = q j_a / (1 + q J_aa)`, and
    `J -= gain J_a^T`, `j -= gain j_a`. Where the increment replaces this part, s_a = w, the old one is integrated out:
    `J -= J_a J_a^T / J_aa`, then J_aa = 1 / q. Only the lower triangle of J is used.
    """
    size = len(J)
    loss = q * J[a, a] + (0.0 if renewed else 1.0)
    kept, variance = 0.0 if renewed else 1.0 / loss, q / loss
    for lane in range(j.shape[1]):
        squares[lane] += variance * j[a, lane] * j[a, lane]
        offset[lane] = variance * j[a, lane]
    for b in range(size):
        gain[b] = J[max(a, b), min(a, b)]
    for b in range(size):
        part = variance * gain[b]
        for c in range(b + 1):
            J[b, c] -= part * gain[c]
        if b != a:
            for lane in range(j.shape[1]):
                j[b, lane] -= part * j[a, lane]
    # Its own row is divided, not reduced by a difference of nearly equal numbers.
    for b in range(size):
        J[max(a, b), min(a, b)] = gain[b] * kept
    J[a, a] = gain[a] / loss
    for lane in range(j.shape[1]):
        j[a, lane] *= kept
    for b in range(size):
        gain[b] *= variance
    return variance, loss


@compiled_in_place
def _predict(J: Floats, j: Floats, width: int) -> None:
    """Predict by F: J becomes F^-T J F^-1, j F^-T j."""
    size = len(J)
    for b in range(size):
        for c in range(b):
            J[c, b] = J[b, c]
    for start in range(0, size - width, width):
        for a in range(start, start + width):
            for b in range(size):
                J[a, b] -= J[a + width, b]
            for lane in range(j.shape[1]):
                j[a, lane] -= j[a + width, lane]
        for b in range(size):
            for a in range(start, start + width):
                J[b, a] -= J[b, a + width]


@compiled_in_place
def filter_forward(
    information: Floats, score: Floats, process: Floats, renewed: bool, J: Floats, j: Floats, gains: Floats,
    variances: Floats, offsets: Floats, squares: Floats,
) -> float:  # fmt: skip
    """Filter some nodes; return the sum over the increments of `log det(I + Q J)`, NaN where J is not positive.

    The data of the nodes are (node, state state) information H^T H and (node, state lane) score H^T y. `process`,
    (node or 1, width), holds the variances of the increments that follow each node. The (state, state) matrix J and the
    (state, lane) vector j are those at the first node before its data, and become those at the node after the last.
    Filled are, with what `_add_increment` finds, gains (node or 1, width, state), variances (node or 1, width) and
    offsets (node or 1, width, lane): those of the last node where there is room for one. `squares`, (lane,), grows by
    the terms in j^2 of the completed squares.
    """
    matrix, vector = J.reshape(-1), j.reshape(-1)
    exponent, mantissa = 0, 1.0  # of the product of the losses, which has one logarithm
    for node in range(len(score)):
        for i in range(matrix.size):  # update: J + H^T H, j + H^T y
            matrix[i] += information[node, i]
        for i in range(vector.size):
            vector[i] += score[node, i]
        q, at = process[min(node, len(process) - 1)], min(node, len(gains) - 1)
        for a in range(q.size):
            variances[at, a], loss = _add_increment(J, j, a, q[a], renewed, gains[at, a], offsets[at, a], squares)
            if not loss > 0.0:
                return np.nan
            mantissa, power = frexp(mantissa * loss)
            exponent += power
        _predict(J, j, q.size)
    return float(np.log(mantissa) + exponent * np.log(2.0))


@compiled_sums_in_place
def smooth_backward(
    information: Floats, gains: Floats, shares: Floats, P: Floats, x: Floats, row: Floats, levels: Floats,
    variances: Floats, explained: Floats,
) -> None:  # fmt: skip
    """Smooth some nodes by what `filter_forward` filled: gains, variances, here `shares`, and offsets, in `levels`.

    The (state, lane) mean x and the (state, state) covariance P, given all data, are those at the node after the last,
    and become those of the first node. `row`, (state,), is scratch. What is filled has the shapes of `SmoothedChain`.
    """
    nodes, width, size = gains.shape
    first, lanes = size - width, x.shape[1]
    for node in range(nodes - 1, -1, -1):
        # s = F^-1 x, P likewise
        for start in range(size - 2 * width, -1, -width):
            for a in range(start + width, start + 2 * width):
                for b in range(size):
                    P[a, b] -= P[a - width, b]
                for lane in range(lanes):
                    x[a, lane] -= x[a - width, lane]
            for b in range(size):
                for a in range(start + width, start + 2 * width):
                    P[b, a] -= P[b, a - width]
        # x = s - e_a w, w = gain . s - offset: P becomes (I - e_a gain^T) P (I - e_a gain^T)^T + variance e_a e_a^T
        for a in range(width - 1, -1, -1):
            gain, offset = gains[node, a], levels[node, a]
            for lane in range(lanes):
                offset[lane] = -offset[lane]
            row[:] = 0.0
            for b in range(size):
                for lane in range(lanes):
                    offset[lane] += gain[b] * x[b, lane]
                for c in range(size):
                    row[c] += gain[b] * P[b, c]
            for lane in range(lanes):
                x[a, lane] -= offset[lane]
            whole = 0.0
            for b in range(size):
                row[b] = P[a, b] - row[b]
                whole += gain[b] * row[b]
            for b in range(size):
                P[a, b] = P[b, a] = row[b]
            P[a, a] = row[a] - whole + shares[node, a]
        explained[node] = 0.0
        for a in range(size):
            for b in range(size):
                explained[node] += information[node, a * size + b] * P[a, b]
        for a in range(width):
            variances[node, a] = P[first + a, first + a]
            for lane in range(lanes):
                levels[node, a, lane] = x[first + a, lane]
