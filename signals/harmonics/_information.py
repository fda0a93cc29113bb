"""Random walks seen at the knots of a grid: what the past and the future say of each knot, added up.

What is known of a state x is a matrix J and a vector j: its likelihood is `exp(j . x - x . J x / 2)` up to a factor.
Measurements only ever add to both, from the first knot forward and from the last backward, and at each knot the two
sums meet [1]_: nothing large is subtracted from anything large, however little is known at first. The matrix is
shared by all *lanes*, that is by all data with the same measurements and walks (two quadratures, several orders,
several channels).

A state holds `poles` blocks of `width` numbers: the levels, their first backward differences, and so on. From one
knot to the next it becomes `F (state + increment)`: F an upper triangle of ones, the increment in the highest
differences alone. A measurement may lie off its knot, by a part `offset` of the spacing, and then sees the level
there by Newton's backward formula, `sum_k C(offset + k - 1, k) difference_k`.

References
----------
.. [1] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
"""

from dataclasses import dataclass
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]

# Numbers in the matrices and vectors of the stretch of knots that is smoothed at once.
STRETCH_NUMBERS = 1 << 22


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
def _forget(walk_variance: Floats, matrix: Floats, vector: Floats) -> float:
    """Integrate an unknown increment out of the highest differences; return the log of what it takes off the volume."""
    width = walk_variance.size
    size = matrix.shape[0]
    log_determinant = 0.0
    for a in range(size - width, size):
        variance = walk_variance[a - size + width]
        loss = 1.0 + variance * matrix[a, a]
        log_determinant += np.log(loss)
        share = variance / loss
        for b in range(size):
            part = share * matrix[b, a]
            if b != a and part != 0.0:
                for c in range(size):
                    matrix[b, c] -= part * matrix[a, c]
                for lane in range(vector.shape[1]):
                    vector[b, lane] -= part * vector[a, lane]
        # Its own row is divided, not reduced by nearly all of it.
        for b in range(size):
            matrix[a, b] /= loss
            matrix[b, a] = matrix[a, b]
        for lane in range(vector.shape[1]):
            vector[a, lane] /= loss
    # To the last bit: nothing else stops an antisymmetric error from growing.
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
    weights = np.empty(poles)
    log_determinant = 0.0
    for knot in range(len(data)):
        _measure(gram[min(knot, len(gram) - 1)], data[knot], offset[knot], matrix, vector, weights)
        if len(matrices):
            matrices[knot] = matrix
            vectors[knot] = vector
        log_determinant += _forget(walk_variance[min(knot, len(walk_variance) - 1)], matrix, vector)
        for block in range(poles - 2, -1, -1):
            _add_block(matrix, vector, width, block + 1, block, -1.0)
    return log_determinant


@compiled
def _meet(  # noqa: C901, PLR0912  (a triangle's loops, each a line of algebra)
    matrix: Floats,
    vector: Floats,
    past_matrix: Floats,
    past_vector: Floats,
    root: Floats,
    solved: Floats,
    levels: Floats,
    variances: Floats,
) -> bool:
    """Fill the levels and their variances from both sides' knowledge; say whether there was enough of it.

    The sum is factored with the levels last, whose block of the triangle then is the root of their own information.
    """
    size, width = matrix.shape[0], variances.size
    differences = size - width
    for a in range(size):
        p = (a + width) % size if a < differences else a - differences
        for b in range(a + 1):
            r = (b + width) % size if b < differences else b - differences
            total = matrix[p, r] + past_matrix[p, r]
            for c in range(b):
                total -= root[a, c] * root[b, c]
            if a == b:
                if not total > 0.0:
                    return False
                root[a, a] = np.sqrt(total)
            else:
                root[a, b] = total / root[b, b]
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
    weights = np.empty(poles)
    root = np.zeros((size, size))
    solved = np.empty((size, max(vector.shape[1], 1)))
    for knot in range(len(data) - 1, -1, -1):
        if not _meet(matrix, vector, matrices[knot], vectors[knot], root, solved, levels[knot], variances[knot]):
            return False
        _measure(gram[min(knot, len(gram) - 1)], data[knot], offset[knot], matrix, vector, weights)
        for block in range(poles - 1):
            _add_block(matrix, vector, width, block + 1, block, 1.0)
        _forget(walk_variance[min(knot, len(walk_variance) - 1)], matrix, vector)
    return True


@dataclass(frozen=True, kw_only=True, eq=False)
class KnotChain:
    """A random walk over knots and what is measured of its levels there; each array as `forward` explains it.

    Attributes
    ----------
    gram : (knot or 1, width, width) array.
    data : (knot, width, lane) array.
    offset : (knot,) array.
    walk_variance : (knot or 1, width) array.
    prior_variance : (pole, width) array, of the levels and differences before the first knot.
    """

    gram: Floats
    data: Floats
    offset: Floats
    walk_variance: Floats
    prior_variance: Floats

    def stretch(self, knots: slice) -> tuple[Floats, Floats, Floats]:
        """Gram, data and offsets of a range of knots."""
        return (self.gram if len(self.gram) == 1 else self.gram[knots]), self.data[knots], self.offset[knots]

    def walk(self, knots: slice, *, shift: int) -> Floats:
        """Walk variances of a range of knots; with a shift of -1, of the knots before them."""
        if len(self.walk_variance) == 1:
            return self.walk_variance
        place = np.arange(knots.start, knots.stop) + shift
        return np.ascontiguousarray(self.walk_variance[place.clip(0, len(self.walk_variance) - 1)])


def smooth_knots(chain: KnotChain, *, first: int) -> tuple[Floats, Floats, float]:
    """Smooth a chain, stretch by stretch where what the past knows would not fit into memory.

    Parameters
    ----------
    chain : what is measured.
    first : the knot whose innovations count first.

    Returns
    -------
    levels : (knot, width, lane) array.
    variances : (knot, width) array.
    log_variance : sum, from knot `first` on, of the log variances of the innovations of one lane.

    Raises
    ------
    numpy.linalg.LinAlgError
        Rounding has eaten up what is known.
    """
    knots, width, lanes = chain.data.shape
    size = chain.prior_variance.size
    matrix, vector = np.diag(1.0 / chain.prior_variance.ravel()), np.zeros((size, lanes))
    none = np.empty((0, size, size)), np.empty((0, size, lanes))
    length = max(isqrt(knots), STRETCH_NUMBERS // (size * (size + lanes)))
    starts, log_variance = [], 0.0
    for begin in range(0, knots, length):
        stretch = slice(begin, min(begin + length, knots))
        starts.append((stretch, matrix.copy(), vector.copy()))
        for part in (slice(begin, min(max(first, begin), stretch.stop)), slice(max(first, begin), stretch.stop)):
            if part.start == first and part.stop > first:
                log_variance = -float(np.linalg.slogdet(matrix)[1])
            if part.stop > part.start:
                losses = forward(*chain.stretch(part), chain.walk(part, shift=0), matrix, vector, *none)
                log_variance += losses
    log_variance += float(np.linalg.slogdet(matrix)[1])
    levels, variances = np.empty((knots, width, lanes)), np.empty((knots, width))
    matrix, vector = np.zeros((size, size)), np.zeros((size, lanes))
    for stretch, start_matrix, start_vector in reversed(starts):
        count = stretch.stop - stretch.start
        past = np.empty((count, size, size)), np.empty((count, size, lanes))
        data = chain.stretch(stretch)
        forward(*data, chain.walk(stretch, shift=0), start_matrix, start_vector, *past)
        found = levels[stretch], variances[stretch]
        if not backward(*data, chain.walk(stretch, shift=-1), matrix, vector, *past, *found):
            raise np.linalg.LinAlgError("information matrix is not positive definite")
    return levels, variances, log_variance
