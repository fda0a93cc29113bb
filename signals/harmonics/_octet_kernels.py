"""A covariance filter of levels alone that takes eight samples at once, as exactly as one by one.

Within eight samples the state x is carried by its walk only. Of the eight measurements `y_j = h_j . x_j + v_j` and
the state at or after each of them, given what was known before (mean m, covariance P, walked variances Q_j),

    cov(x, y_j) = c_j = (P + Q_j) h_j,     cov(y_i, y_j) = h_j . c_i + (1 where i = j),     i <= j.

A Cholesky factor of that 8 x 8 matrix makes the innovations e, white and of unit variance, and the gains
`g_j = cov(x, e_j)`. Up to sample t,

    mean = m + sum_{j <= t} g_j e_j,     covariance = P + Q_t - sum_{j <= t} g_j g_j^T,

which is what the filter finds sample by sample. P is read and written once for the eight, and all the long loops
have eight samples side by side. A sample that is missing measures nothing: its h is zero.

Arrays are flat; those over (column, sample) have eight numbers a column.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import (
    LANES,
    WIDE,
    load_wide,
    minus,
    multiply_add,
    plus,
    repeat_wide,
    running_sums,
    spread_wide,
    store,
    times,
    transpose,
)

Floats = NDArray[np.float64]

_SELF = np.eye(WIDE).ravel()
_LATER = np.triu(np.ones((WIDE, WIDE)), 1).ravel()


@compiled
def _weigh(h: Floats, covariance: Floats, stride: int, walked: Floats, cross: Floats, columns: int) -> None:
    """Fill `cross`, (column, sample), with `c_j = (P + Q_j) h_j`; of P, the lower triangle is read."""
    for a in range(0, columns, LANES):
        k = WIDE * a
        s0, s1, s2, s3 = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
        p0 = a * stride
        p1, p2, p3 = p0 + stride, p0 + 2 * stride, p0 + 3 * stride
        t0 = times(load_wide(walked, k), load_wide(h, k))
        t1 = times(load_wide(walked, k + WIDE), load_wide(h, k + WIDE))
        t2 = times(load_wide(walked, k + 2 * WIDE), load_wide(h, k + 2 * WIDE))
        t3 = times(load_wide(walked, k + 3 * WIDE), load_wide(h, k + 3 * WIDE))
        for b in range(0, a, 2):
            row = load_wide(h, WIDE * b)
            s0 = multiply_add(repeat_wide(covariance, p0 + b), row, s0)
            s1 = multiply_add(repeat_wide(covariance, p1 + b), row, s1)
            s2 = multiply_add(repeat_wide(covariance, p2 + b), row, s2)
            s3 = multiply_add(repeat_wide(covariance, p3 + b), row, s3)
            row = load_wide(h, WIDE * b + WIDE)
            t0 = multiply_add(repeat_wide(covariance, p0 + b + 1), row, t0)
            t1 = multiply_add(repeat_wide(covariance, p1 + b + 1), row, t1)
            t2 = multiply_add(repeat_wide(covariance, p2 + b + 1), row, t2)
            t3 = multiply_add(repeat_wide(covariance, p3 + b + 1), row, t3)
        for b in range(a, columns, 2):
            row, p = load_wide(h, WIDE * b), b * stride + a
            s0 = multiply_add(repeat_wide(covariance, p), row, s0)
            s1 = multiply_add(repeat_wide(covariance, p + 1), row, s1)
            s2 = multiply_add(repeat_wide(covariance, p + 2), row, s2)
            s3 = multiply_add(repeat_wide(covariance, p + 3), row, s3)
            row, p = load_wide(h, WIDE * b + WIDE), p + stride
            t0 = multiply_add(repeat_wide(covariance, p), row, t0)
            t1 = multiply_add(repeat_wide(covariance, p + 1), row, t1)
            t2 = multiply_add(repeat_wide(covariance, p + 2), row, t2)
            t3 = multiply_add(repeat_wide(covariance, p + 3), row, t3)
        store(cross, k, plus(s0, t0))
        store(cross, k + WIDE, plus(s1, t1))
        store(cross, k + 2 * WIDE, plus(s2, t2))
        store(cross, k + 3 * WIDE, plus(s3, t3))


@compiled
def _correlate(h: Floats, cross: Floats, joint: Floats, columns: int) -> None:
    """Fill `joint`, (sample, sample), from its diagonal on with the covariances of the measurements."""
    s0, s1, s2, s3 = load_wide(_SELF, 0), load_wide(_SELF, 8), load_wide(_SELF, 16), load_wide(_SELF, 24)
    s4, s5, s6, s7 = load_wide(_SELF, 32), load_wide(_SELF, 40), load_wide(_SELF, 48), load_wide(_SELF, 56)
    for k in range(0, WIDE * columns, WIDE):
        row = load_wide(h, k)
        s0 = multiply_add(repeat_wide(cross, k), row, s0)
        s1 = multiply_add(repeat_wide(cross, k + 1), row, s1)
        s2 = multiply_add(repeat_wide(cross, k + 2), row, s2)
        s3 = multiply_add(repeat_wide(cross, k + 3), row, s3)
        s4 = multiply_add(repeat_wide(cross, k + 4), row, s4)
        s5 = multiply_add(repeat_wide(cross, k + 5), row, s5)
        s6 = multiply_add(repeat_wide(cross, k + 6), row, s6)
        s7 = multiply_add(repeat_wide(cross, k + 7), row, s7)
    store(joint, 0, s0)
    store(joint, 8, s1)
    store(joint, 16, s2)
    store(joint, 24, s3)
    store(joint, 32, s4)
    store(joint, 40, s5)
    store(joint, 48, s6)
    store(joint, 56, s7)


@compiled
def _whiten(joint: Floats, white: Floats, roots: Floats) -> None:
    """Fill `white`, upper triangular, so that `white^T joint white = 1`; roots: its diagonal. `joint` is used up."""
    for i in range(WIDE):
        store(white, WIDE * i, load_wide(_SELF, WIDE * i))
    scale = spread_wide(0.0)
    for i in range(WIDE):
        pivot = joint[WIDE * i + i]
        inverse = 1.0 / pivot
        scale = multiply_add(spread_wide(np.sqrt(inverse)), load_wide(_SELF, WIDE * i), scale)
        negated = spread_wide(-inverse)
        row = times(load_wide(joint, WIDE * i), load_wide(_LATER, WIDE * i))
        for j in range(i + 1, WIDE):
            # The product does not wait for the division.
            product = times(repeat_wide(joint, WIDE * i + j), row)
            store(joint, WIDE * j, multiply_add(product, negated, load_wide(joint, WIDE * j)))
        row = times(row, negated)
        for j in range(i + 1):
            store(white, WIDE * j, multiply_add(repeat_wide(white, WIDE * j + i), row, load_wide(white, WIDE * j)))
    store(roots, 0, scale)
    for i in range(WIDE):
        store(white, WIDE * i, times(load_wide(white, WIDE * i), scale))


@compiled
def _combine(cross: Floats, white: Floats, gains: Floats, columns: int) -> None:
    """Fill `gains`, (column, sample), with `cross white`."""
    w0, w1, w2, w3 = load_wide(white, 0), load_wide(white, 8), load_wide(white, 16), load_wide(white, 24)
    w4, w5, w6, w7 = load_wide(white, 32), load_wide(white, 40), load_wide(white, 48), load_wide(white, 56)
    for k in range(0, WIDE * columns, WIDE):
        even = times(repeat_wide(cross, k), w0)
        odd = times(repeat_wide(cross, k + 1), w1)
        even = multiply_add(repeat_wide(cross, k + 2), w2, even)
        odd = multiply_add(repeat_wide(cross, k + 3), w3, odd)
        even = multiply_add(repeat_wide(cross, k + 4), w4, even)
        odd = multiply_add(repeat_wide(cross, k + 5), w5, odd)
        even = multiply_add(repeat_wide(cross, k + 6), w6, even)
        odd = multiply_add(repeat_wide(cross, k + 7), w7, odd)
        store(gains, k, plus(even, odd))


@compiled
def _subtract(gains: Floats, across: Floats, covariance: Floats, stride: int, columns: int) -> None:
    """Subtract `sum g_j g_j^T` from the covariance; `across`, (sample, stride), is filled with the gains."""
    for a in range(0, columns, LANES):
        transpose(gains, WIDE * a, WIDE, across, a, stride)
        transpose(gains, WIDE * a + LANES, WIDE, across, LANES * stride + a, stride)
    for b in range(0, stride, WIDE):
        minus_one = spread_wide(-1.0)
        g0, g1 = times(load_wide(across, b), minus_one), times(load_wide(across, stride + b), minus_one)
        g2 = times(load_wide(across, 2 * stride + b), minus_one)
        g3 = times(load_wide(across, 3 * stride + b), minus_one)
        g4 = times(load_wide(across, 4 * stride + b), minus_one)
        g5 = times(load_wide(across, 5 * stride + b), minus_one)
        g6 = times(load_wide(across, 6 * stride + b), minus_one)
        g7 = times(load_wide(across, 7 * stride + b), minus_one)
        for a in range(b, columns):
            k, p = WIDE * a, a * stride + b
            value = load_wide(covariance, p)
            value = multiply_add(repeat_wide(gains, k), g0, value)
            value = multiply_add(repeat_wide(gains, k + 1), g1, value)
            value = multiply_add(repeat_wide(gains, k + 2), g2, value)
            value = multiply_add(repeat_wide(gains, k + 3), g3, value)
            value = multiply_add(repeat_wide(gains, k + 4), g4, value)
            value = multiply_add(repeat_wide(gains, k + 5), g5, value)
            value = multiply_add(repeat_wide(gains, k + 6), g6, value)
            value = multiply_add(repeat_wide(gains, k + 7), g7, value)
            store(covariance, p, value)


@compiled
def open_octet(
    h: Floats, walked: Floats, covariance: Floats, cross: Floats, joint: Floats, white: Floats, roots: Floats
) -> None:
    """Find what makes eight innovations white.

    Parameters
    ----------
    h : (column, sample) array, what multiplies the levels; zero where a sample is missing.
    walked : (column, sample) array, the diagonals of Q_j: variance walked from the first sample to each.
    covariance : (column, stride) array, P; its lower triangle is read. The stride is a multiple of WIDE.
    cross : (column, sample) array, filled with c_j.
    joint : (sample, sample) array to work in.
    white : (sample, sample) array, filled: `sum_i white_ij c_i` are the gains.
    roots : (sample,) array, filled with one over the innovations' standard deviation, 1 where missing.
    """
    columns = h.size // WIDE
    _weigh(h, covariance, covariance.size // columns, walked, cross, columns)
    _correlate(h, cross, joint, columns)
    _whiten(joint, white, roots)


@compiled
def innovate(h: Floats, data: Floats, mean: Floats, white: Floats, innovations: Floats) -> None:
    """Fill in what is new in eight samples.

    Parameters
    ----------
    h, white : as `open_octet` took and left them.
    data : (channel, sample) array; 0 where missing.
    mean : (channel, column) array, predicted for the first sample.
    innovations : (channel, sample) array, filled: over their standard deviation.
    """
    columns = h.size // WIDE
    for channel in range(data.size // WIDE):
        first, at = channel * columns, channel * WIDE
        even, odd = spread_wide(0.0), spread_wide(0.0)
        for a in range(0, columns, 2):
            even = multiply_add(repeat_wide(mean, first + a), load_wide(h, WIDE * a), even)
            odd = multiply_add(repeat_wide(mean, first + a + 1), load_wide(h, WIDE * a + WIDE), odd)
        store(innovations, at, minus(load_wide(data, at), plus(even, odd)))
        even, odd = spread_wide(0.0), spread_wide(0.0)
        for j in range(0, WIDE, 2):
            even = multiply_add(repeat_wide(innovations, at + j), load_wide(white, WIDE * j), even)
            odd = multiply_add(repeat_wide(innovations, at + j + 1), load_wide(white, WIDE * j + WIDE), odd)
        store(innovations, at, plus(even, odd))


@compiled
def close_octet(cross: Floats, white: Floats, covariance: Floats, gains: Floats, across: Floats) -> None:
    """Take eight samples into the covariance; of the walk, only what goes on between them.

    Parameters
    ----------
    cross, white : as `open_octet` left them.
    covariance : (column, stride) array, P on entry, `P - sum g_j g_j^T` on return, in the lower triangle.
    gains : (column, sample) array, filled with g_j.
    across : (sample, stride) array to work in.
    """
    columns = cross.size // WIDE
    _combine(cross, white, gains, columns)
    _subtract(gains, across, covariance, covariance.size // columns, columns)


@compiled
def follow(gains: Floats, innovations: Floats, mean: Floats, levels: Floats) -> None:
    """Take eight samples into the means.

    Parameters
    ----------
    gains, innovations : as `close_octet` and `innovate` left them.
    mean : (channel, column) array, predicted for the first sample on entry, filtered at the last on return.
    levels : (channel, column, sample) array, filled with the filtered means.
    """
    columns = gains.size // WIDE
    for channel in range(innovations.size // WIDE):
        found = load_wide(innovations, WIDE * channel)
        for a in range(columns):
            place = channel * columns + a
            moved = running_sums(times(load_wide(gains, WIDE * a), found))
            store(levels, WIDE * place, plus(moved, repeat_wide(mean, place)))
            mean[place] = levels[WIDE * place + WIDE - 1]
