"""Compiled loop of the permutation test of local damage."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums

Array = NDArray[np.float64]


@compiled_sums
def _median(values: Array) -> float:
    """Return the median of some values, which are moved (Hoare 1961, Communications of the ACM 4, 321-322).

    numpy's is right as well, but takes two seconds to compile.
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
def rotated_maxima(rows: Array, shifts: NDArray[np.int64], maxima: Array) -> None:
    """Raise each of `maxima` to the largest statistic of one band whose blocks are rotated.

    The statistic of a cell is the mean over blocks over its standard error, which is at least the median one of all
    cells. The median is looked for only where the largest mean over its own error, a bound of the statistic, exceeds
    the maximum so far.

    Parameters
    ----------
    rows : (block, 2 cell) array, each block twice in a row, so that every rotation of it is one slice.
    shifts : (rotation, block) array, first cell of each block.
    maxima : (rotation,) array, raised in place.
    """
    blocks, cells = rows.shape[0], rows.shape[1] // 2
    sums, squares, errors = np.empty(cells), np.empty(cells), np.empty(cells)
    for rotation in range(maxima.size):
        for cell in range(cells):
            sums[cell] = squares[cell] = 0.0
        shift = shifts[rotation]
        # four blocks at a time, so that the sums are loaded and stored a quarter as often
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
        scale = maxima[rotation] ** 2 / (blocks - 1.0)
        above = 0
        for cell in range(cells):
            square = sums[cell] * sums[cell]
            above += (sums[cell] > 0) & (square - scale * (blocks * squares[cell] - square) > 0)
        if not above:
            continue
        for cell in range(cells):
            sums[cell] /= blocks
            squares[cell] = np.sqrt(max(squares[cell] / blocks - sums[cell] * sums[cell], 0.0) / (blocks - 1.0))
            errors[cell] = squares[cell]
        least = _median(errors) + 1e-300
        for cell in range(cells):
            maxima[rotation] = max(maxima[rotation], sums[cell] / max(squares[cell], least))
