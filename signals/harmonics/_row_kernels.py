"""Rows of matrices and of vectors, as doubles or as sums of two, for the sweeps of filter and smoother."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_inside
from signals._lanes import LANES, load, multiply_add, plus, spread, store
from signals.harmonics._twofold import add, add_product

Floats = NDArray[np.float64]


@compiled_inside
def add_row(
    pairs: bool, target: Floats, at: int, high: float, low: float, source: Floats, start: int, count: int
) -> None:
    """Add a number times `count` numbers of one (2, ...) array, high parts and low, to those of another.

    `at` and `start` are the flat indices where they begin.
    """
    factor = spread(high)
    if pairs:
        rest = spread(low)
        t, s = target.size // 2, source.size // 2
        for c in range(0, count, LANES):
            value = add_product(
                load(target, at + c), load(target, t + at + c),
                load(source, start + c), load(source, s + start + c), factor, rest,
            )  # fmt: skip
            store(target, at + c, value[0])
            store(target, t + at + c, value[1])
    else:
        for c in range(0, count, LANES):
            store(target, at + c, multiply_add(factor, load(source, start + c), load(target, at + c)))


@compiled_inside
def shear(pairs: bool, matrix: Floats, target: int, source: int, width: int) -> None:
    """Add block `source` to block `target` of rows and columns: `E M E^T`.

    Every number and its mirror image take the same operations, so that the matrix stays symmetric to the last bit:
    nothing else stops an antisymmetric error from growing.
    """
    n = matrix.shape[1]
    down, across, low = (source - target) * width * n, (source - target) * width, n * n
    for a in range(width):
        start = a * n + target * width * (n + 1)
        for k in range(start, start + width, LANES):
            # (tt + ss) + (ts + st), which the mirror image shares.
            last = k + down + across
            if pairs:
                value = add(load(matrix, k), load(matrix, low + k), load(matrix, last), load(matrix, low + last))
                cross = add(
                    load(matrix, k + across), load(matrix, low + k + across),
                    load(matrix, k + down), load(matrix, low + k + down),
                )  # fmt: skip
                value = add(value[0], value[1], cross[0], cross[1])
                store(matrix, k, value[0])
                store(matrix, low + k, value[1])
            else:
                own = plus(load(matrix, k), load(matrix, last))
                store(matrix, k, plus(own, plus(load(matrix, k + across), load(matrix, k + down))))
    for a in range(width):
        for other in range(n // width):
            if other != target:
                k = a * n + (target * n + other) * width
                add_row(pairs, matrix, k, 1.0, 0.0, matrix, k + down, width)
                k = a * n + (other * n + target) * width
                add_row(pairs, matrix, k, 1.0, 0.0, matrix, k + across, width)
