"""A segment of steps: what later data say of the state after it, and what they and its own say of the state before.

A filter that knows the state before to be zero goes forward (`depart`): its covariance P is what the walk adds. Where
the segment ends, what later data say of the state becomes what they say of that filter's error: r and L, for j and
J. Then the adjoint of its closed loop goes back (`come_back`) [1]_: with a row h, its gain g and its innovation e, over
their standard deviation 1 / c,

    r <- c h e + (I - c h g^T) r,    L <- c^2 h h^T + (I - c h g^T) L (I - c g h^T).

The walk does not appear in it, so that a step costs a few times the square of the number of columns, not the cube.
Back where the state is known, r and L are what all these data say of it: j and J again, whatever the true filter knows.

All is in the coordinates of the state before (`_still_kernels`).

References
----------
.. [1] A. E. Bryson, M. Frazier, "Smoothing for linear and nonlinear dynamic systems", TDR-63-119, 1963.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import WIDE, load_wide, multiply_add, negative, plus, repeat_wide, spread_wide, store, times, total
from signals.harmonics._row_kernels import add_row
from signals.harmonics._still_kernels import add_walk, balance, binomial, lay, subtract, take, take_pairs
from signals.harmonics._twofold import add_product, multiply

Floats = NDArray[np.float64]
# The step before a segment, the one whose measurement ends it, and how many steps there are.
Span = tuple[int, int, int]
# What is kept of each measurement: rows, gains, numbers c, 0 where missing, and innovations (see `_still_kernels`).
Kept = tuple[Floats, Floats, Floats, Floats]


@compiled
def rebase(pairs: bool, steps: int, width: int, vector: Floats, information: Floats) -> None:
    """Turn what is known of the state after some steps into the coordinates of that before: `F^kT J F^k`."""
    n, stride = information.shape[1:]
    for block in range(n // width - 1, 0, -1):
        for other in range(block):
            weight, across = binomial(steps, block - other), (block - other) * width
            for a in range(block * width * stride, (block + 1) * width * stride, stride):
                add_row(pairs, information, a, weight, 0.0, information, a - across * stride, stride)
            for at in range(block * width, vector.shape[1] * stride, stride):
                add_row(pairs, vector, at, weight, 0.0, vector, at - across, width)
    for block in range(n // width - 1, 0, -1):
        for other in range(block):
            weight, across = binomial(steps, block - other), (block - other) * width
            for at in range(block * width, n * stride, stride):
                add_row(pairs, information, at, weight, 0.0, information, at - across, width)


@compiled_inside
def mirror(matrix: Floats) -> None:
    """Make a matrix symmetric whose upper triangle counts."""
    for part in range(2):
        for a in range(matrix.shape[1]):
            for b in range(a):
                matrix[part, a, b] = matrix[part, b, a]


@compiled
def depart(
    pairs: bool, span: Span, rows: Floats, data: Floats, walk: Floats, mean: Floats, covariance: Floats, kept: Kept
) -> None:
    """Filter a segment from a state that is known to be zero, and keep what `come_back` needs.

    The segment has the transition after the first step of the span, and all up to and with the last one's measurement.

    Parameters
    ----------
    pairs : whether low parts count.
    rows, data, walk : as for `forward`.
    mean : (2, channel, stride) array, filled.
    covariance : (2, state, stride) array, filled.
    kept : filled.
    """
    (first, after, steps), start = span, max(span[0], 0)
    measurements, width = rows.shape[1:]
    own, gains, roots, errors = kept
    powers = np.empty(covariance.shape[1] // width)
    mean[:] = 0.0
    covariance[:] = 0.0
    place, before = 0, -1
    for step in range(first, after):
        if step >= 0:
            for block in range(powers.size):
                powers[block] = binomial(start - step, powers.size - 1 - block)
            add_walk(pairs, powers, walk, step if len(walk) > 1 else 0, covariance)
        if step + 1 == steps:
            break
        for i in range(measurements):
            roots[0, place] = 0.0
            if not np.isnan(data[step + 1, i, 0]):
                lay(pairs, step + 1 - start, rows, step + 1, i, own, place, powers.size)
                if pairs:
                    take_pairs(data, step + 1, i, mean, covariance, own, gains, roots, errors, before, place)
                else:
                    take(data, step + 1, i, mean, covariance, own, gains, roots, errors, before, place)
                before = place
            place += 1
    if before >= 0:
        subtract(pairs, covariance, gains, before)


@compiled
def come_back(pairs: bool, kept: Kept, count: int, vector: Floats, information: Floats) -> None:
    """Go back over measurements.

    Parameters
    ----------
    pairs : whether low parts count.
    kept, count : what `depart` kept, and of how many measurements.
    vector : (2, channel, stride) array, r, updated.
    information : (2, state, stride) array, L, updated.
    """
    own, gains, roots, errors = kept
    stride = information.shape[2]
    # L g, and half of what a measurement adds to L: `h d^T + d h^T`.
    product, change = np.zeros((2, stride)), np.zeros((2, stride))
    last = -1
    for place in range(count - 1, -1, -1):
        if roots[0, place] == 0.0:
            continue
        if pairs:
            _turn_back_pairs(own, gains, roots, errors, vector, information, product, change, place)
        else:
            _turn_back(own, gains, roots, errors, vector, information, product, change, last, place)
        last = place
    if last >= 0 and not pairs:
        _add(pairs, own, last, change, information)
    balance(information)


@compiled_inside
def _turn_back(
    own: Floats, gains: Floats, roots: Floats, errors: Floats, vector: Floats, information: Floats, product: Floats,
    change: Floats, last: int, place: int,
) -> None:  # fmt: skip
    """Go back over a measurement, in doubles, but for its share in L: that of the last one is due now."""
    n, stride = information.shape[1:]
    channels = vector.shape[1]
    row, gain, old, root = place * stride, place * stride, max(last, 0) * stride, roots[0, place]
    inner = spread_wide(0.0)
    for c in range(0, stride, WIDE):
        own_old, own_change = load_wide(own, old + c), load_wide(change, c)
        even, odd = spread_wide(0.0), spread_wide(0.0)
        for a in range(0, n, 2):
            k = a * stride + c
            one = multiply_add(repeat_wide(change, a), own_old, load_wide(information, k))
            one = multiply_add(repeat_wide(own, old + a), own_change, one)
            store(information, k, one)
            even = multiply_add(repeat_wide(gains, gain + a), one, even)
            k += stride
            one = multiply_add(repeat_wide(change, a + 1), own_old, load_wide(information, k))
            one = multiply_add(repeat_wide(own, old + a + 1), own_change, one)
            store(information, k, one)
            odd = multiply_add(repeat_wide(gains, gain + a + 1), one, odd)
        even = plus(even, odd)
        inner = multiply_add(load_wide(gains, gain + c), even, inner)
        store(product, c, even)
    half, lanes = spread_wide(0.5 * root * root * (1.0 + total(inner))), spread_wide(root)
    for c in range(0, stride, WIDE):
        value = times(half, load_wide(own, row + c))
        store(change, c, multiply_add(lanes, negative(load_wide(product, c)), value))
    for k in range(channels):
        inner = spread_wide(0.0)
        for c in range(0, stride, WIDE):
            inner = multiply_add(load_wide(gains, gain + c), load_wide(vector, k * stride + c), inner)
        lanes = spread_wide((errors[0, place, k] - total(inner)) * root)
        for c in range(0, stride, WIDE):
            at = k * stride + c
            store(vector, at, multiply_add(lanes, load_wide(own, row + c), load_wide(vector, at)))


@compiled_inside
def _turn_back_pairs(
    own: Floats, gains: Floats, roots: Floats, errors: Floats, vector: Floats, information: Floats, product: Floats,
    change: Floats, place: int,
) -> None:  # fmt: skip
    """Go back over a measurement, as `_turn_back` and then `_add`."""
    n, stride = information.shape[1:]
    high, low = roots[0, place], roots[1, place]
    product[:] = 0.0
    for a in range(n):
        add_row(True, product, 0, gains[0, place, a], gains[1, place, a], information, a * stride, stride)
    inner = (1.0, 0.0)
    for a in range(n):
        inner = add_product(inner[0], inner[1], gains[0, place, a], gains[1, place, a], product[0, a], product[1, a])
    inner = multiply(inner[0], inner[1], *multiply(high, low, 0.5 * high, 0.5 * low))
    for a in range(n):
        value = multiply(product[0, a], product[1, a], -high, -low)
        change[0, a], change[1, a] = add_product(
            value[0], value[1], inner[0], inner[1], own[0, place, a], own[1, place, a]
        )
    for k in range(vector.shape[1]):
        error = (errors[0, place, k], errors[1, place, k])
        for a in range(n):
            error = add_product(
                error[0], error[1], -gains[0, place, a], -gains[1, place, a], vector[0, k, a], vector[1, k, a]
            )
        error = multiply(error[0], error[1], high, low)
        add_row(True, vector, k * stride, error[0], error[1], own, place * stride, stride)
    _add(True, own, place, change, information)


@compiled_inside
def _add(pairs: bool, own: Floats, place: int, change: Floats, information: Floats) -> None:
    """Add `h d^T + d h^T`."""
    n, stride = information.shape[1:]
    for a in range(n):
        add_row(pairs, information, a * stride, own[0, place, a], own[1, place, a], change, 0, stride)
        add_row(pairs, information, a * stride, change[0, a], change[1, a], own, place * stride, stride)
