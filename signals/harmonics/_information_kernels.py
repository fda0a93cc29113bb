"""Loops of the information smoother: its filter, forward or backward, and the sum of both.

The states and their transitions are those of `_information_smoother`.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_in_place, compiled_sums_in_place

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

# Within these, a product of losses neither over- nor underflows.
SMALL_PRODUCT, LARGE_PRODUCT = 1e-150, 1e150
# The steps of a filter at a node, in the order of each direction.
_UPDATE, _STORE, _MARGINALISE, _PROPAGATE = range(4)
FORWARD = np.array([_UPDATE, _STORE, _MARGINALISE, _PROPAGATE])
BACKWARD = np.array([_STORE, _UPDATE, _PROPAGATE, _MARGINALISE])


@compiled_in_place
def marginalise(
    process: Floats, at: int, renewed: bool, matrix: Floats, vector: Floats, column: Floats, squares: Floats
) -> float:
    """Marginalise over the increments of the highest differences; return `log det(I + Q J)`, NaN if not positive.

    One increment after the other: `J -= q / (1 + q J_aa) J_a J_a^T`, j likewise. Where increments replace the
    differences instead of adding to them, the old ones are integrated out: `J -= J_a J_a^T / J_aa`, and `J_aa = 1 / q`;
    so a whole state with q = 1, which leaves `log det J`. `column`, (state,), is scratch; `squares`, (lane,), grows by
    the terms in j^2 of the completed squares: of a whole state by `j^T J^-1 j`.
    """
    size = len(matrix)
    log_determinant, product = 0.0, 1.0  # of few losses there is one logarithm
    for a in range(process.shape[1]):
        loss = process[at, a] * matrix[a, a] + (0.0 if renewed else 1.0)
        if not loss > 0.0:
            return np.nan
        kept = 0.0 if renewed else 1.0 / loss
        if not SMALL_PRODUCT < product * loss < LARGE_PRODUCT:
            log_determinant, product = log_determinant + np.log(product), 1.0
        product *= loss
        share = process[at, a] / loss
        for lane in range(vector.shape[1]):
            squares[lane] += share * vector[a, lane] * vector[a, lane]
        for b in range(size):
            column[b] = matrix[max(a, b), min(a, b)]
        for b in range(size):
            part = share * column[b]
            for c in range(b + 1):
                matrix[b, c] -= part * column[c]
            if b != a:
                for lane in range(vector.shape[1]):
                    vector[b, lane] -= part * vector[a, lane]
        # Its own row is divided, not reduced by a difference of nearly equal numbers.
        for b in range(size):
            matrix[max(a, b), min(a, b)] = column[b] * kept
        matrix[a, a] = column[a] / loss
        for lane in range(vector.shape[1]):
            vector[a, lane] *= kept
    for b in range(size):
        for c in range(b):
            matrix[c, b] = matrix[b, c]
    return log_determinant + float(np.log(product))


@compiled_in_place
def filter_information(
    information: Floats, score: Floats, process: Floats, renewed: bool, steps: Indices, matrix: Floats, vector: Floats,
    column: Floats, matrices: Floats, vectors: Floats, squares: Floats,
) -> float:  # fmt: skip
    """Run the information filter over some nodes; return the sum over the increments of `log det(I + Q J)`.

    The data of the nodes are (node or 1, state state) information H^T H and (node, state lane) score H^T y. `process`,
    (node or 1, width), holds the variances of the increments that follow each node, or backward precede it. The
    (state, state) matrix J and the (state, lane) vector j are those at the node entered first before its data, and
    become those at the node after the one left last. `steps` are `FORWARD` or `BACKWARD`; `renewed`, `column` and
    `squares` are those of `marginalise`. Matrices, (node, state state), and vectors, (node, state lane), unless of no
    nodes, are filled with J and j at every node, forward with its data, backward without.
    """
    forward = steps[0] == _UPDATE
    size, width = len(matrix), process.shape[1]
    flat, row, log_determinant = matrix.reshape(-1), vector.reshape(-1), 0.0
    for place in range(len(score)):
        node = place if forward else len(score) - 1 - place
        for step in steps:
            if step == _UPDATE:
                at = min(node, len(information) - 1)
                for i in range(flat.size):
                    flat[i] += information[at, i]
                for i in range(row.size):
                    row[i] += score[node, i]
            elif step == _STORE:
                if len(matrices):
                    for i in range(flat.size):
                        matrices[node, i] = flat[i]
                    for i in range(row.size):
                        vectors[node, i] = row[i]
            elif step == _MARGINALISE:
                log_determinant += marginalise(
                    process, min(node, len(process) - 1), renewed, matrix, vector, column, squares
                )
            else:  # J becomes F^-T J F^-1, backward F^T J F
                sign = -1.0 if forward else 1.0
                for block in range(0, size - width, width):
                    start = block if forward else size - 2 * width - block
                    for a in range(start, start + width):
                        for b in range(size):
                            matrix[a, b] += sign * matrix[a + width, b]
                        for lane in range(vector.shape[1]):
                            vector[a, lane] += sign * vector[a + width, lane]
                    for b in range(size):
                        for a in range(start, start + width):
                            matrix[b, a] += sign * matrix[b, a + width]
    return log_determinant


@compiled_sums_in_place
def combine(
    information: Floats, past: Floats, past_vectors: Floats, future: Floats, future_vectors: Floats, root: Floats,
    solved: Floats, inverse: Floats, levels: Floats, variances: Floats, explained: Floats,
) -> bool:  # fmt: skip
    """Fill levels and variances of some nodes from the sum of past and future information; False if one is singular.

    The sum is factored, J = U^T U, with the levels last: the last block of U is the root of the information on them.
    Rows of U are subtracted from those below as soon as they are known, so that all loops run along rows.

    Given are the information of the nodes' own data, and the past and the future as `filter_information` fills its
    matrices and vectors; `root`, `solved` and `inverse` are scratch of (state, state), (state, lane) and
    (width, width). What is filled has the shapes that `SmoothedChain` has.
    """
    nodes, width, lanes = levels.shape
    size = past_vectors.shape[1] // lanes
    differences = size - width
    flat, row = root.reshape(-1), solved.reshape(-1)
    last = root[differences:, differences:]
    for node in range(nodes):
        # J = J_past + J_future, j likewise
        for i in range(flat.size):
            flat[i] = past[node, i] + future[node, i]
        for i in range(row.size):
            row[i] = past_vectors[node, i] + future_vectors[node, i]
        for a in range(size):  # row by row of U, and of s in U^T s = j
            if not root[a, a] > 0.0:
                return False
            scale = 1.0 / np.sqrt(root[a, a])
            for b in range(a, size):
                root[a, b] *= scale
            for lane in range(lanes):
                solved[a, lane] *= scale
            for b in range(a + 1, size):
                factor, own, below = root[a, b], root[a, b:], root[b, b:]
                for c in range(own.size):
                    below[c] -= factor * own[c]
                for lane in range(lanes):
                    solved[b, lane] -= factor * solved[a, lane]
        at = min(node, len(information) - 1)
        explained[node] = 0.0
        for a in range(width - 1, -1, -1):
            for lane in range(lanes):  # the last block of U state = s: the levels
                level = solved[differences + a, lane]
                for b in range(a + 1, width):
                    level -= last[a, b] * levels[node, b, lane]
                levels[node, a, lane] = level / last[a, a]
            # Columns of the inverse of the block, transposed: the covariance of the levels is made of their products.
            for b in range(a, width):
                inverse[a, b] = 1.0 if b == a else 0.0
            for b in range(a, width):
                inverse[a, b] /= last[b, b]
                own, below = last[b, b + 1 :], inverse[a, b + 1 :]
                for c in range(own.size):
                    below[c] -= inverse[a, b] * own[c]
            for b in range(a, width):
                one, other, covariance = inverse[a, b:], inverse[b, b:], 0.0
                for c in range(one.size):
                    covariance += one[c] * other[c]
                if a == b:
                    variances[node, a] = covariance
                own_information = information[at, (differences + a) * size + differences + b]
                explained[node] += (1.0 if a == b else 2.0) * own_information * covariance
    return True
