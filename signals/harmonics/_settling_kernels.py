"""When doubles do for a filter.

A covariance filter subtracts: what a measurement takes off is as large as what was there, and of a prior of 1e12 times
the noise, 1e-4 of rounding error stays. So as long as a state is open in any direction, matrices are kept as
unevaluated sums of two doubles, high and low, which have digits for priors up to 1e24 times the noise; once it has
settled, the high parts do.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Entries of a filter's status.
TWOFOLD, COUNTDOWN = 0, 1
# What the first of them says of the low parts: that there are none; that they are; that a factor is in the place of
# the covariance's (see `_open_kernels`).
PLAIN, PAIRS, FACTORED = 0, 1, 2
# Plain covariances may be open to this variance, and their correlations singular to this pivot: products of
# the two with 1e-16 and the root of the number of steps in the filter's memory are lost.
MOST_OPEN = 1e4
LEAST_PIVOT = 1e-7
# Steps between looks at a twofold state, and at most between those at a plain one.
LOOK_TWOFOLD, LOOK_PLAIN = 64, 1024


@compiled_sums
def least_pivot(matrix: Floats, work: Floats) -> float:
    """Return the least pivot of the correlation matrix's Cholesky factor; rows without variance do not count."""
    n = len(matrix)
    scale = np.zeros(n)
    for a in range(n):
        if matrix[a, a] > 0.0:
            scale[a] = 1.0 / np.sqrt(matrix[a, a])
    least = 1.0
    for a in range(n):
        own, pivot = work[a], 1.0
        if scale[a] == 0.0:
            own[: a + 1] = 0.0
            continue
        for b in range(a):
            other = work[b]
            inner = matrix[a, b] * scale[a] * scale[b]
            for c in range(b):
                inner -= own[c] * other[c]
            # On the diagonal stands what the column is to be multiplied by.
            own[b] = inner * other[b]
            pivot -= own[b] * own[b]
        least = min(least, pivot)
        own[a] = 1.0 / np.sqrt(max(pivot, 1e-30))
    return least


@compiled
def settled(covariance: Floats, width: int, reach: float, work: Floats) -> bool:
    """Tell whether doubles do for this covariance, given the largest square of a row's numbers."""
    for a in range(width):
        if not covariance[a, a] * reach <= MOST_OPEN:
            return False
    return least_pivot(covariance, work) >= LEAST_PIVOT


@compiled
def look(
    status: Integers, interval: int, covariance: Floats, mean: Floats, width: int, reach: float, work: Floats
) -> bool:
    """Choose between doubles and pairs for the steps to come; tell whether the choice changed."""
    before = status[TWOFOLD]
    plain = settled(covariance[0], width, reach, work)
    if plain:
        covariance[1] = 0.0
        mean[1] = 0.0
    status[TWOFOLD] = PLAIN if plain else PAIRS
    status[COUNTDOWN] = interval if plain else min(LOOK_TWOFOLD, interval)
    return bool(before != status[TWOFOLD])
