"""Matrix exponentials and products of stacks of small matrices, vectorised over the stack."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_TERMS = 14  # of a series for matrices of norm 1/2: 0.5^15 / 15! is below rounding


def exponentials(matrices: Array) -> Array:
    """Return the exponentials of a stack of matrices (n, m, m): Taylor series with scaling and squaring."""
    halvings = max(0, math.ceil(math.log2(2 * float(np.abs(matrices).sum(axis=2).max()) or 1.0)))
    small = matrices / 2**halvings
    total = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for order in range(_TERMS, 0, -1):
        total = np.eye(matrices.shape[1]) + small @ total / order
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)


def chained(steps: Array) -> Array:
    """Return the product of a stack of matrices, the last one leftmost, pair by pair."""
    while len(steps) > 1:
        paired = steps[1::2] @ steps[: len(steps) // 2 * 2 : 2]
        steps = np.concatenate([paired, steps[-1:]]) if len(steps) % 2 else paired
    return np.asarray(steps[0])
