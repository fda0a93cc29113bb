"""What knots say of many columns at once, in as few rows as it takes."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

# Part of a column's information that may be left out: less than any prior tells.
LEFT_OUT = 1e-10


@compiled
def condense(gram: Floats, data: Floats, shapes: Floats, rows: Floats, values: Floats, ranks: Indices) -> None:
    """Find rows H and values y that say what a knot says: `H^T H` is its information, `H^T y` its data.

    Columns of the information's pivoted Cholesky factor [1]_, of which only those are made that it takes.

    Parameters
    ----------
    gram, data, shapes : as for `forward` in `_knot_kernels`.
    rows : (knot, row, state) array, filled from the first row on, with zeros where there are fewer.
    values : (knot, row, lane) array, filled likewise.
    ranks : (knot,) array, filled with how many rows it takes; one more than there is room for where that is too little.

    References
    ----------
    .. [1] H. Harbrecht, M. Peters, R. Schneider, "On the low-rank approximation by the pivoted Cholesky
       decomposition", Applied Numerical Mathematics 62, 2012.
    """
    width, poles, most = gram.shape[2], len(shapes), rows.shape[1]
    size, lanes = poles * width, data.shape[3]
    both = np.zeros((poles, poles, 2 * poles - 1))
    for i in range(poles):
        for k in range(poles):
            for m in range(poles):
                for n in range(poles):
                    both[i, k, m + n] += shapes[i, m] * shapes[k, n]
    left, told = np.empty(size), np.empty((size, lanes))
    for knot in range(len(data)):
        at = min(knot, len(gram) - 1)
        told[:] = 0.0
        for i in range(poles):
            for a in range(width):
                left[i * width + a] = 0.0
                for m in range(2 * poles - 1):
                    left[i * width + a] += both[i, i, m] * gram[at, m, a, a]
                for m in range(poles):
                    for lane in range(lanes):
                        told[i * width + a, lane] += shapes[i, m] * data[knot, m, a, lane]
        enough = LEFT_OUT * left.max()
        rows[knot] = 0.0
        values[knot] = 0.0
        rank = 0
        while True:
            pivot = 0
            for a in range(1, size):
                if left[a] > left[pivot]:
                    pivot = a
            if not left[pivot] > enough:
                break
            if rank == most:
                rank += 1
                break
            block, column = pivot // width, pivot % width
            row = rows[knot, rank]
            for i in range(poles):
                for m in range(2 * poles - 1):
                    share = both[i, block, m]
                    if share != 0.0:
                        for a in range(width):
                            row[i * width + a] += share * gram[at, m, column, a]
            for before in range(rank):
                part = rows[knot, before, pivot]
                for a in range(size):
                    row[a] -= part * rows[knot, before, a]
            root = 1.0 / np.sqrt(left[pivot])
            for lane in range(lanes):
                rest = told[pivot, lane]
                for before in range(rank):
                    rest -= rows[knot, before, pivot] * values[knot, before, lane]
                values[knot, rank, lane] = root * rest
            for a in range(size):
                row[a] *= root
                left[a] -= row[a] * row[a]
            left[pivot] = 0.0
            rank += 1
        ranks[knot] = rank
