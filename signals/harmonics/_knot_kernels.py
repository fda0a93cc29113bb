"""What is known of a random walk's state at one knot, carried from knot to knot and met by what the other side knows.

Knowledge of a state is a matrix and a vector, and grows by adding: see `_information`.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import WIDE, load_wide, multiply_add, spread_wide, store

Floats = NDArray[np.float64]


@compiled
def _measure(gram: Floats, data: Floats, offset: float, matrix: Floats, vector: Floats, weights: Floats) -> None:
    """Add what a knot's measurement says of the state."""
    width = gram.shape[0]
    poles = matrix.shape[0] // width
    weights[0] = 1.0
    for k in range(1, poles):
        weights[k] = weights[k - 1] * (offset + k - 1) / k
    for i in range(poles):
        for a in range(width):
            for k in range(poles):
                both = weights[i] * weights[k]
                if both != 0.0:
                    for b in range(width):
                        matrix[i * width + a, k * width + b] += both * gram[a, b]
            if weights[i] != 0.0:
                for lane in range(vector.shape[1]):
                    vector[i * width + a, lane] += weights[i] * data[a, lane]


@compiled
def _add_block(matrix: Floats, vector: Floats, width: int, target: int, source: int, factor: float) -> None:
    """Add `factor` times block `source` to block `target`, of rows and then of columns, and of the vector."""
    for a in range(target * width, (target + 1) * width):
        b = a + (source - target) * width
        for c in range(matrix.shape[0]):
            matrix[a, c] += factor * matrix[b, c]
        for lane in range(vector.shape[1]):
            vector[a, lane] += factor * vector[b, lane]
    for c in range(matrix.shape[0]):
        for a in range(target * width, (target + 1) * width):
            matrix[c, a] += factor * matrix[c, a + (source - target) * width]


@compiled
def _take_square(matrix: Floats, column: Floats, factor: float, first: int) -> None:
    """Take `factor column column^T` off the lower triangle from row and column `first` on.

    What lies beside this triangle, within a few columns, is left undefined.
    """
    size = len(matrix)
    whole = size - size % WIDE
    start = first - first % WIDE
    for b in range(first, size):
        part = factor * column[b]
        if part != 0.0:
            row, parts = b * size, spread_wide(-part)
            for c in range(start, min(b + 1, whole), WIDE):
                store(matrix, row + c, multiply_add(parts, load_wide(column, c), load_wide(matrix, row + c)))
            for c in range(max(start, whole), b + 1):
                matrix[b, c] -= part * column[c]


@compiled
def _forget(walk_variance: Floats, matrix: Floats, vector: Floats, column: Floats) -> float:
    """Integrate an unknown increment out of the highest differences; return the log of what it takes off the volume.

    `column`, (state,), is to work in.
    """
    width = walk_variance.size
    size = matrix.shape[0]
    log_determinant = 0.0
    for a in range(size - width, size):
        variance = walk_variance[a - size + width]
        loss = 1.0 + variance * matrix[a, a]
        log_determinant += np.log(loss)
        share = variance / loss
        for b in range(a + 1):
            column[b] = matrix[a, b]
        for b in range(a + 1, size):
            column[b] = matrix[b, a]
        _take_square(matrix, column, share, 0)
        for b in range(size):
            part = share * column[b]
            if b != a and part != 0.0:
                for lane in range(vector.shape[1]):
                    vector[b, lane] -= part * vector[a, lane]
        # Its own row is divided, not reduced by nearly all of it.
        left = 1.0 / loss
        for b in range(a + 1):
            matrix[a, b] = left * column[b]
        for b in range(a + 1, size):
            matrix[b, a] = left * column[b]
        for lane in range(vector.shape[1]):
            vector[a, lane] /= loss
    for a in range(size):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return log_determinant


@compiled
def forward(
    gram: Floats,
    data: Floats,
    offset: Floats,
    walk_variance: Floats,
    matrix: Floats,
    vector: Floats,
    matrices: Floats,
    vectors: Floats,
) -> float:
    """Gather, from the first knot of a stretch to its last, what data up to each knot say of its state.

    Parameters
    ----------
    gram : (knot, width, width) array, information on the levels; (1, width, width) when all are alike.
    data : (knot, width, lane) array, information times data.
    offset : (knot,) array, where the data lie from the knot, in spacings.
    walk_variance : (knot or 1, width) array, of the increments that follow each knot.
    matrix, vector : (state, state) and (state, lane) arrays: before the first knot's data on entry, before those of
        the knot after the last on return.
    matrices, vectors : (knot, state, state) and (knot, state, lane) arrays, filled, or of no knots.

    Returns
    -------
    sum over the increments of the log of `1 + variance information`.
    """
    width = gram.shape[1]
    poles = vector.shape[0] // width
    weights, column = np.empty(poles), np.empty(vector.shape[0])
    log_determinant = 0.0
    for knot in range(len(data)):
        _measure(gram[min(knot, len(gram) - 1)], data[knot], offset[knot], matrix, vector, weights)
        if len(matrices):
            matrices[knot] = matrix
            vectors[knot] = vector
        log_determinant += _forget(walk_variance[min(knot, len(walk_variance) - 1)], matrix, vector, column)
        for block in range(poles - 2, -1, -1):
            _add_block(matrix, vector, width, block + 1, block, -1.0)
    return log_determinant


@compiled
def _factor(both: Floats, root: Floats, column: Floats) -> bool:
    """Fill the lower triangle of `root` with the Cholesky factor of a matrix, which is used up; say whether it has one.

    `column`, (state,), is to work in.
    """
    size = len(both)
    for a in range(size):
        if not both[a, a] > 0.0:
            return False
        inverse = 1.0 / np.sqrt(both[a, a])
        for b in range(a, size):
            column[b] = root[b, a] = both[b, a] * inverse
        for b in range(a - a % WIDE, a):
            column[b] = 0.0
        _take_square(both, column, 1.0, a + 1)
    return True


@compiled
def _meet(
    matrix: Floats,
    vector: Floats,
    past_matrix: Floats,
    past_vector: Floats,
    both: Floats,
    root: Floats,
    solved: Floats,
    column: Floats,
    levels: Floats,
    variances: Floats,
) -> bool:
    """Fill the levels and their variances from both sides' knowledge; say whether there was enough of it.

    The sum is factored with the levels last, whose block of the triangle then is the root of their own information.
    """
    size, width = matrix.shape[0], variances.size
    differences = size - width
    for a in range(size):
        p = a + width if a < differences else a - differences
        for b in range(a + 1):
            r = b + width if b < differences else b - differences
            both[a, b] = matrix[p, r] + past_matrix[p, r]
    if not _factor(both, root, column):
        return False
    for a in range(size):
        p = a + width if a < differences else a - differences
        for lane in range(vector.shape[1]):
            solved[a, lane] = vector[p, lane] + past_vector[p, lane]
        for b in range(a):
            for lane in range(vector.shape[1]):
                solved[a, lane] -= root[a, b] * solved[b, lane]
        for lane in range(vector.shape[1]):
            solved[a, lane] /= root[a, a]
    for a in range(width - 1, -1, -1):
        row = differences + a
        for b in range(a + 1, width):
            for lane in range(vector.shape[1]):
                solved[row, lane] -= root[differences + b, row] * levels[b, lane]
        for lane in range(vector.shape[1]):
            levels[a, lane] = solved[row, lane] / root[row, row]
    # Columns of the triangle's inverse, in place: their squared lengths are the variances.
    for a in range(width):
        column = differences + a
        inverse = 1.0 / root[column, column]
        variances[a] = inverse * inverse
        solved[column, 0] = inverse
        for b in range(a + 1, width):
            row = differences + b
            total = 0.0
            for c in range(a, b):
                total -= root[row, differences + c] * solved[differences + c, 0]
            solved[row, 0] = total / root[row, row]
            variances[a] += solved[row, 0] * solved[row, 0]
    return True


@compiled
def backward(
    gram: Floats,
    data: Floats,
    offset: Floats,
    walk_variance: Floats,
    matrix: Floats,
    vector: Floats,
    matrices: Floats,
    vectors: Floats,
    levels: Floats,
    variances: Floats,
) -> bool:
    """Gather, from the last knot of a stretch to its first, what later data say, and meet what `forward` left.

    Parameters
    ----------
    gram, data, offset, matrices, vectors : as for `forward`.
    walk_variance : (knot or 1, width) array, of the increments that precede each knot.
    matrix, vector : from the data after the stretch, of its last knot, on entry; from the stretch on too, of the knot
        before its first, on return.
    levels : (knot, width, lane) array, filled.
    variances : (knot, width) array, filled.

    Returns
    -------
    False where rounding has eaten up what is known.
    """
    size, width = matrix.shape[0], gram.shape[1]
    poles = size // width
    weights, column = np.empty(poles), np.empty(size)
    both, root = np.zeros((size, size)), np.zeros((size, size))
    solved = np.empty((size, max(vector.shape[1], 1)))
    for knot in range(len(data) - 1, -1, -1):
        past = matrices[knot], vectors[knot]
        if not _meet(matrix, vector, *past, both, root, solved, column, levels[knot], variances[knot]):
            return False
        _measure(gram[min(knot, len(gram) - 1)], data[knot], offset[knot], matrix, vector, weights)
        for block in range(poles - 1):
            _add_block(matrix, vector, width, block + 1, block, 1.0)
        _forget(walk_variance[min(knot, len(walk_variance) - 1)], matrix, vector, column)
    return True
