"""Steps of a covariance filter in coordinates in which nothing moves but the walk: those of the state at the start.

After k steps the state is `F^k x`, with F an upper triangle of ones, so a measurement h of the levels measures
`h, k h, k (k + 1) / 2 h, ...` of x, and an increment of the highest differences adds it times `..., k (k - 1) / 2, -k,
1`. Then every step is a rank-one change of the covariance, whatever the number of poles. The start is moved on often
enough (`carry`): within a part of the memory these powers stay small beside what is known of the differences.

What is measured stands in places: rows and gains in (2, place, stride) arrays, high parts before low ones, one over the
innovation's standard deviation in (2, place) arrays, and innovations over it in (2, place, channel) arrays. Gains are
over it, too: each measurement takes `g g^T` off the covariance. Rows are filled up to a stride (`filled`).
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import WIDE, load_wide, multiply_add, plus, repeat_wide, spread_wide, store, times, total
from signals.harmonics._row_kernels import add_row
from signals.harmonics._twofold import add_product, inverse_root, multiply

Floats = NDArray[np.float64]


@compiled_inside
def filled(columns: int) -> int:
    """Return the stride of so many columns, a multiple of WIDE but not of a part of a page.

    Rows at such distances would fight for the same lines of the cache.
    """
    stride = columns + -columns % WIDE
    return stride if stride % (WIDE * WIDE) else stride + WIDE


@compiled_inside
def binomial(steps: int, difference: int) -> float:
    """Return what a level gains in so many steps from that difference: of negative ones, too."""
    value = 1.0
    for i in range(difference):
        value = value * (steps + i) / (i + 1)
    return value


@compiled
def carry(pairs: bool, steps: int, width: int, mean: Floats, covariance: Floats) -> None:
    """Turn the coordinates of the state before some steps into those of that after: `F^k m`, `F^k P F^kT`."""
    n, stride = covariance.shape[1:]
    if steps == 0 or n == width:
        return
    for block in range(n // width):
        for other in range(block + 1, n // width):
            weight, across = binomial(steps, other - block), (other - block) * width
            for a in range(block * width * stride, (block + 1) * width * stride, stride):
                add_row(pairs, covariance, a, weight, 0.0, covariance, a + across * stride, stride)
            for at in range(block * width, mean.shape[1] * stride, stride):
                add_row(pairs, mean, at, weight, 0.0, mean, at + across, width)
    for block in range(n // width):
        for other in range(block + 1, n // width):
            weight, across = binomial(steps, other - block), (other - block) * width
            for at in range(block * width, n * stride, stride):
                add_row(pairs, covariance, at, weight, 0.0, covariance, at + across, width)
    balance(covariance)


@compiled_inside
def balance(matrix: Floats) -> None:
    """Make a matrix symmetric that is so but for rounding: nothing else stops an antisymmetric error from growing."""
    for part in range(2):
        for a in range(matrix.shape[1]):
            for b in range(a):
                middle = 0.5 * (matrix[part, a, b] + matrix[part, b, a])
                matrix[part, a, b] = matrix[part, b, a] = middle


@compiled_inside
def add_walk(pairs: bool, powers: Floats, walk: Floats, step: int, covariance: Floats) -> None:
    """Add the variances of a step's increments, each seen in all blocks."""
    width = walk.shape[1]
    for i in range(powers.size):
        for j in range(powers.size):
            high, low = multiply(powers[i], 0.0, powers[j], 0.0)
            for c in range(width):
                a, b = i * width + c, j * width + c
                if pairs:
                    covariance[0, a, b], covariance[1, a, b] = add_product(
                        covariance[0, a, b], covariance[1, a, b], high, low, walk[step, c], 0.0
                    )
                else:
                    covariance[0, a, b] += high * walk[step, c]


@compiled_inside
def lay(pairs: bool, passed: int, rows: Floats, step: int, i: int, own: Floats, place: int, poles: int) -> None:
    """Write down a row in the coordinates of the segment."""
    width = rows.shape[2]
    for block in range(poles):
        weight = binomial(passed, block)
        for c in range(width):
            a, value = block * width + c, rows[step, i, c]
            if pairs:
                own[0, place, a], own[1, place, a] = multiply(value, 0.0, weight, 0.0)
            else:
                own[0, place, a] = value * weight


@compiled_inside
def take(
    data: Floats, step: int, i: int, mean: Floats, covariance: Floats, own: Floats, gains: Floats, roots: Floats,
    errors: Floats, before: int, place: int,
) -> None:  # fmt: skip
    """Take a measurement in, in doubles, but for its share in the covariance: that of the one before is due now."""
    n, stride = covariance.shape[1:]
    channels = mean.shape[1]
    row, last, gain = place * stride, max(before, 0) * stride, place * stride
    due = -1.0 if before >= 0 else 0.0
    spreads = spread_wide(1.0 / WIDE)
    for c in range(0, stride, WIDE):
        old, even, odd = times(load_wide(gains, last + c), spread_wide(due)), spread_wide(0.0), spread_wide(0.0)
        for a in range(0, n, 2):
            k = a * stride + c
            one = multiply_add(repeat_wide(gains, last + a), old, load_wide(covariance, k))
            store(covariance, k, one)
            even = multiply_add(repeat_wide(own, row + a), one, even)
            k += stride
            one = multiply_add(repeat_wide(gains, last + a + 1), old, load_wide(covariance, k))
            store(covariance, k, one)
            odd = multiply_add(repeat_wide(own, row + a + 1), one, odd)
        even = plus(even, odd)
        spreads = multiply_add(load_wide(own, row + c), even, spreads)
        # The gain before is still needed: this one has its own place.
        store(gains, gain + c, even)
    root = 1.0 / np.sqrt(total(spreads))
    roots[0, place] = root
    scale = spread_wide(root)
    for c in range(0, stride, WIDE):
        store(gains, gain + c, times(load_wide(gains, gain + c), scale))
    for k in range(channels):
        lanes = spread_wide(0.0)
        for c in range(0, stride, WIDE):
            lanes = multiply_add(load_wide(own, row + c), load_wide(mean, k * stride + c), lanes)
        error = (data[step, i, k] - total(lanes)) * root
        errors[0, place, k] = error
        lanes = spread_wide(error)
        for c in range(0, stride, WIDE):
            at = k * stride + c
            store(mean, at, multiply_add(load_wide(gains, gain + c), lanes, load_wide(mean, at)))


@compiled_inside
def take_pairs(
    data: Floats, step: int, i: int, mean: Floats, covariance: Floats, own: Floats, gains: Floats, roots: Floats,
    errors: Floats, before: int, place: int,
) -> None:  # fmt: skip
    """Take a measurement in as `take` does."""
    n, stride = covariance.shape[1:]
    gain = place * stride
    if before >= 0:
        subtract(True, covariance, gains, before)
    gains[0, place] = 0.0
    gains[1, place] = 0.0
    variance = (1.0, 0.0)
    for a in range(n):
        add_row(True, gains, gain, own[0, place, a], own[1, place, a], covariance, a * stride, stride)
    for a in range(n):
        variance = add_product(
            variance[0], variance[1], own[0, place, a], own[1, place, a], gains[0, place, a], gains[1, place, a]
        )
    root = inverse_root(variance[0], variance[1])
    roots[0, place], roots[1, place] = root
    for a in range(n):
        gains[0, place, a], gains[1, place, a] = multiply(gains[0, place, a], gains[1, place, a], root[0], root[1])
    for k in range(mean.shape[1]):
        error = (data[step, i, k], 0.0)
        for a in range(n):
            error = add_product(error[0], error[1], mean[0, k, a], mean[1, k, a], -own[0, place, a], -own[1, place, a])
        error = multiply(error[0], error[1], root[0], root[1])
        errors[0, place, k], errors[1, place, k] = error
        add_row(True, mean, k * stride, error[0], error[1], gains, gain, stride)


@compiled_inside
def subtract(pairs: bool, covariance: Floats, gains: Floats, place: int) -> None:
    """Subtract a measurement's share from the covariance."""
    n, stride = covariance.shape[1:]
    for a in range(n):
        add_row(pairs, covariance, a * stride, -gains[0, place, a], -gains[1, place, a], gains, place * stride, stride)
