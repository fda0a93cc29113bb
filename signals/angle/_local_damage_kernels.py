"""Compiled loop of the permutation test of local damage."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums

Array = NDArray[np.float64]
Single = NDArray[np.float32]


@compiled_sums
def _median(values: Single) -> float:
    """Return the median of `values`, which are reordered (Hoare 1961, Communications of the ACM 4, 321-322).

    numpy's median takes two seconds to compile.
    """
    middle, left, right = values.size // 2, 0, values.size - 1
    while left < right:
        pivot, low, high = values[middle], left, right
        while low <= high:
            while values[low] < pivot:
                low += 1
            while pivot < values[high]:
                high -= 1
            if low <= high:
                values[low], values[high] = values[high], values[low]
                low += 1
                high -= 1
        left, right = low if high < middle else left, high if middle < low else right
    if values.size % 2:
        return float(values[middle])
    below = values[0]
    for n in range(middle):
        below = max(below, values[n])
    return float(0.5 * (below + values[middle]))


@compiled_sums
def rotated_maxima(rows: Single, shifts: NDArray[np.int64], maxima: Array) -> None:
    """Raise each of `maxima` to the largest statistic of one band whose blocks are rotated.

    The statistic of a cell is the ratio of the mean over blocks to its standard error, or to the median error of all
    cells if that is larger. The median is computed only if the largest ratio of a mean to its own error, an upper bound
    of the statistic, exceeds the maximum so far. Sums are in single precision, where twice as many cells fit a vector
    register: the relative error of a statistic t over n blocks is about 1e-7 (1 + t^2 / n).

    Parameters
    ----------
    rows : (block, 2 cell) array, each block twice in a row, so that every rotation of it is one slice.
    shifts : (rotation, block) array, first cell of each block.
    maxima : (rotation,) array, raised in place.
    """
    blocks, cells = rows.shape[0], rows.shape[1] // 2
    sums = np.empty(cells, dtype=np.float32)
    squares, errors = np.empty_like(sums), np.empty_like(sums)
    count = np.float32(blocks)
    for rotation in range(maxima.size):
        for cell in range(cells):
            sums[cell] = squares[cell] = np.float32(0.0)
        shift = shifts[rotation]
        # four blocks at a time load and store the sums a quarter as often
        for block in range(0, blocks - 3, 4):
            a = rows[block, shift[block] : shift[block] + cells]
            b = rows[block + 1, shift[block + 1] : shift[block + 1] + cells]
            c = rows[block + 2, shift[block + 2] : shift[block + 2] + cells]
            d = rows[block + 3, shift[block + 3] : shift[block + 3] + cells]
            for cell in range(cells):
                sums[cell] += a[cell] + b[cell] + c[cell] + d[cell]
                squares[cell] += a[cell] * a[cell] + b[cell] * b[cell] + c[cell] * c[cell] + d[cell] * d[cell]
        for block in range(blocks - blocks % 4, blocks):
            row = rows[block, shift[block] : shift[block] + cells]
            for cell in range(cells):
                sums[cell] += row[cell]
                squares[cell] += row[cell] * row[cell]
        # mean > maximum * error, squared and without divisions
        scale = np.float32(maxima[rotation] ** 2 / (blocks - 1.0))
        above = 0
        for cell in range(cells):
            square = sums[cell] * sums[cell]
            squares[cell] = count * squares[cell] - square
            above += (sums[cell] > 0) & (square > scale * squares[cell])
        if not above:
            continue
        # the statistic cannot exceed the maximum if the largest mean exceeds the errors of fewer than half the cells
        largest = np.float32(0.0)
        for cell in range(cells):
            if sums[cell] > largest and sums[cell] * sums[cell] > scale * squares[cell]:
                largest = sums[cell]
        below = 0
        for cell in range(cells):
            below += largest * largest > scale * squares[cell]
        if 2 * below < cells:
            continue
        for cell in range(cells):
            sums[cell] /= blocks
            squares[cell] = np.sqrt(max(squares[cell], 0.0) / (blocks - 1.0)) / blocks
            errors[cell] = squares[cell]
        least = _median(errors) + 1e-300
        for cell in range(cells):
            maxima[rotation] = max(maxima[rotation], sums[cell] / max(squares[cell], least))
