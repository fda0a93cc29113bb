"""What is known of a random walk's state at one knot, carried from knot to knot and met by what the other side knows.

Knowledge of a state is a matrix and a vector, and grows by adding: see `_information`.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import WIDE, load_wide, multiply_add, spread_wide, store

Floats = NDArray[np.float64]


@compiled
def _measure(gram: Floats, data: Floats, shapes: Floats, matrix: Floats, vector: Floats) -> None:
    """Add what a knot's measurement says of the state."""
    width, poles = gram.shape[1], len(shapes)
    for i in range(poles):
        for m in range(poles):
            if shapes[i, m] != 0.0:
                for a in range(width):
                    for lane in range(vector.shape[1]):
                        vector[i * width + a, lane] += shapes[i, m] * data[m, a, lane]
        for k in range(poles):
            for m in range(2 * poles - 1):
                both = 0.0
                for n in range(max(0, m - poles + 1), min(m + 1, poles)):
                    both += shapes[i, n] * shapes[k, m - n]
                if both != 0.0:
                    for a in range(width):
                        for b in range(width):
                            matrix[i * width + a, k * width + b] += both * gram[m, a, b]


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
            vector[a, lane] *= left
    for a in range(size):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return log_determinant


@compiled
def forward(
    gram: Floats,
    data: Floats,
    shapes: Floats,
    walk_variance: Floats,
    matrix: Floats,
    vector: Floats,
    matrices: Floats,
    vectors: Floats,
) -> float:
    """Gather, from the first knot of a stretch to its last, what data up to each knot say of its state.

    Parameters
    ----------
    gram : (knot, moment, width, width) array, moments of the information on the levels; (1, ...) when all are alike.
    data : (knot, pole, width, lane) array, moments of information times data.
    shapes : (pole, pole) array, what each block of the state adds to levels, as coefficients of powers of the place.
    walk_variance : (knot or 1, width) array, of the increments that follow each knot.
    matrix, vector : (state, state) and (state, lane) arrays: before the first knot's data on entry, before those of
        the knot after the last on return.
    matrices, vectors : (knot, state, state) and (knot, state, lane) arrays, filled, or of no knots.

    Returns
    -------
    sum over the increments of the log of `1 + variance information`.
    """
    width = gram.shape[2]
    poles = vector.shape[0] // width
    column = np.empty(vector.shape[0])
    log_determinant = 0.0
    for knot in range(len(data)):
        _measure(gram[min(knot, len(gram) - 1)], data[knot], shapes, matrix, vector)
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
        inverse = 1.0 / root[a, a]
        for lane in range(vector.shape[1]):
            solved[a, lane] *= inverse
    for a in range(width - 1, -1, -1):
        row = differences + a
        for b in range(a + 1, width):
            for lane in range(vector.shape[1]):
                solved[row, lane] -= root[differences + b, row] * levels[b, lane]
        inverse = 1.0 / root[row, row]
        for lane in range(vector.shape[1]):
            levels[a, lane] = inverse * solved[row, lane]
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
    shapes: Floats,
    walk_variance: Floats,
    matrix: Floats,
    vector: Floats,
    matrices: Floats,
    vectors: Floats,
    levels: Floats,
    variances: Floats,
) -> bool:
    """Gather, from the last knot of a stretch to its first, what later data say, and meet what `forward` left, if any.

    Parameters
    ----------
    gram, data, shapes, matrices, vectors : as for `forward`.
    walk_variance : (knot or 1, width) array, of the increments that precede each knot.
    matrix, vector : from the data after the stretch, of its last knot, on entry; from the stretch on too, of the knot
        before its first, on return.
    levels : (knot, width, lane) array, filled where `forward` left something.
    variances : (knot, width) array, filled likewise.

    Returns
    -------
    False where rounding has eaten up what is known.
    """
    size, width = matrix.shape[0], gram.shape[2]
    poles = size // width
    column = np.empty(size)
    both, root = np.zeros((size, size)), np.zeros((size, size))
    solved = np.empty((size, max(vector.shape[1], 1)))
    for knot in range(len(data) - 1, -1, -1):
        if len(matrices):
            past = matrices[knot], vectors[knot]
            if not _meet(matrix, vector, *past, both, root, solved, column, levels[knot], variances[knot]):
                return False
        _measure(gram[min(knot, len(gram) - 1)], data[knot], shapes, matrix, vector)
        for block in range(poles - 1):
            _add_block(matrix, vector, width, block + 1, block, 1.0)
        _forget(walk_variance[min(knot, len(walk_variance) - 1)], matrix, vector, column)
    return True
