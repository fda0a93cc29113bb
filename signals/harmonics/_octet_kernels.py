"""A covariance filter of levels alone that takes eight samples at once, as exactly as one by one.

Within eight samples the state x is carried by its walk only. Of the eight measurements `y_j = h_j . x_j + v_j` and
the state at or after each of them, given what was known before (mean m, covariance P, walked variances Q_j),

    cov(x, y_j) = c_j = (P + Q_j) h_j,     cov(y_i, y_j) = h_j . c_i + (1 where i = j),     i <= j.

A Cholesky factor of that 8 x 8 matrix makes the innovations e, white and of unit variance, and the gains
`g_j = cov(x, e_j)`. Up to sample t,

    mean = m + sum_{j <= t} g_j e_j,     covariance = P + Q_t - sum_{j <= t} g_j g_j^T,

which is what the filter finds sample by sample. P is read and written once for the eight, and all the long loops
have eight samples or eight columns side by side. A sample that is missing measures nothing: its h is zero.

All lives in one flat array, the *room*: P, of which the lower triangle counts, as (column, stride), the stride a
multiple of eight, then sections of eight strides each. A section is (column, sample) or (sample, column).
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
    negative,
    plus,
    repeat_wide,
    spread_wide,
    store,
    times,
)
from signals._tiles import transposed, whiten

Floats = NDArray[np.float64]

# Sections, (column, sample): h; the c_j; the gains; the variances walked from the first sample to each.
H, CROSS, GAINS, WALKED = 0, 1, 2, 3
# (sample, column): gains; filtered variances; variances walked from each sample to the next.
ACROSS, VARIANCES, STEPS = 4, 5, 6
# (sample, sample): covariance of the measurements; what makes them white.
JOINT, WHITE = 7, 8
# (column,): variances before the first sample; walked in all eight.
BEFORE, AHEAD = 9, 10
SECTIONS = 11

_SELF = np.eye(WIDE).ravel()


@compiled
def aligned(size: int) -> Floats:
    """Return zeros that begin where a line of the cache does."""
    room = np.zeros(size + WIDE)
    start = -(room.ctypes.data // room.itemsize) % WIDE
    return room[start : start + size]


@compiled
def section(number: int, stride: int) -> int:
    """Return where a section starts."""
    return stride * (stride + WIDE * number)


@compiled
def weigh(room: Floats, columns: int, stride: int) -> None:
    """Find the c_j."""
    h, cross, walked = section(H, stride), section(CROSS, stride), section(WALKED, stride)
    for a in range(0, columns, LANES):
        k, q, to = h + WIDE * a, walked + WIDE * a, cross + WIDE * a
        s0, s1, s2, s3 = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
        p0 = a * stride
        p1, p2, p3 = p0 + stride, p0 + 2 * stride, p0 + 3 * stride
        t0 = times(load_wide(room, q), load_wide(room, k))
        t1 = times(load_wide(room, q + WIDE), load_wide(room, k + WIDE))
        t2 = times(load_wide(room, q + 2 * WIDE), load_wide(room, k + 2 * WIDE))
        t3 = times(load_wide(room, q + 3 * WIDE), load_wide(room, k + 3 * WIDE))
        for b in range(0, a, 2):
            row = load_wide(room, h + WIDE * b)
            s0 = multiply_add(repeat_wide(room, p0 + b), row, s0)
            s1 = multiply_add(repeat_wide(room, p1 + b), row, s1)
            s2 = multiply_add(repeat_wide(room, p2 + b), row, s2)
            s3 = multiply_add(repeat_wide(room, p3 + b), row, s3)
            row = load_wide(room, h + WIDE * b + WIDE)
            t0 = multiply_add(repeat_wide(room, p0 + b + 1), row, t0)
            t1 = multiply_add(repeat_wide(room, p1 + b + 1), row, t1)
            t2 = multiply_add(repeat_wide(room, p2 + b + 1), row, t2)
            t3 = multiply_add(repeat_wide(room, p3 + b + 1), row, t3)
        for b in range(a, columns, 2):
            row, p = load_wide(room, h + WIDE * b), b * stride + a
            s0 = multiply_add(repeat_wide(room, p), row, s0)
            s1 = multiply_add(repeat_wide(room, p + 1), row, s1)
            s2 = multiply_add(repeat_wide(room, p + 2), row, s2)
            s3 = multiply_add(repeat_wide(room, p + 3), row, s3)
            row, p = load_wide(room, h + WIDE * b + WIDE), p + stride
            t0 = multiply_add(repeat_wide(room, p), row, t0)
            t1 = multiply_add(repeat_wide(room, p + 1), row, t1)
            t2 = multiply_add(repeat_wide(room, p + 2), row, t2)
            t3 = multiply_add(repeat_wide(room, p + 3), row, t3)
        store(room, to, plus(s0, t0))
        store(room, to + WIDE, plus(s1, t1))
        store(room, to + 2 * WIDE, plus(s2, t2))
        store(room, to + 3 * WIDE, plus(s3, t3))


@compiled
def correlate(room: Floats, columns: int, stride: int) -> None:
    """Find the covariance of the measurements, from its diagonal on."""
    h, cross, joint = section(H, stride), section(CROSS, stride), section(JOINT, stride)
    s0, s1, s2, s3 = load_wide(_SELF, 0), load_wide(_SELF, 8), load_wide(_SELF, 16), load_wide(_SELF, 24)
    s4, s5, s6, s7 = load_wide(_SELF, 32), load_wide(_SELF, 40), load_wide(_SELF, 48), load_wide(_SELF, 56)
    for a in range(0, WIDE * columns, WIDE):
        row, k = load_wide(room, h + a), cross + a
        s0 = multiply_add(repeat_wide(room, k), row, s0)
        s1 = multiply_add(repeat_wide(room, k + 1), row, s1)
        s2 = multiply_add(repeat_wide(room, k + 2), row, s2)
        s3 = multiply_add(repeat_wide(room, k + 3), row, s3)
        s4 = multiply_add(repeat_wide(room, k + 4), row, s4)
        s5 = multiply_add(repeat_wide(room, k + 5), row, s5)
        s6 = multiply_add(repeat_wide(room, k + 6), row, s6)
        s7 = multiply_add(repeat_wide(room, k + 7), row, s7)
    store(room, joint, s0)
    store(room, joint + 8, s1)
    store(room, joint + 16, s2)
    store(room, joint + 24, s3)
    store(room, joint + 32, s4)
    store(room, joint + 40, s5)
    store(room, joint + 48, s6)
    store(room, joint + 56, s7)


@compiled
def open_octet(room: Floats, columns: int, stride: int, roots: Floats, at: int) -> None:
    """Find what makes eight innovations white; put one over their standard deviations in `roots` from `at` on.

    H, WALKED and P are read.
    """
    weigh(room, columns, stride)
    correlate(room, columns, stride)
    store(roots, at, whiten(room, section(JOINT, stride), room, section(WHITE, stride)))


@compiled
def innovate(room: Floats, columns: int, stride: int, mean: Floats, data: Floats, found: Floats) -> None:
    """Fill in what is new in eight samples.

    Parameters
    ----------
    room, columns, stride : H and WHITE are read.
    mean : (channel, stride) array, predicted for the first sample.
    data : (channel, sample) array; 0 where missing.
    found : (channel, sample) array, filled with the innovations over their standard deviation.
    """
    h, white = section(H, stride), section(WHITE, stride)
    for at in range(0, data.size, WIDE):
        first = at // WIDE * stride
        even, odd = spread_wide(0.0), spread_wide(0.0)
        for a in range(0, columns, 2):
            even = multiply_add(repeat_wide(mean, first + a), load_wide(room, h + WIDE * a), even)
            odd = multiply_add(repeat_wide(mean, first + a + 1), load_wide(room, h + WIDE * a + WIDE), odd)
        store(found, at, minus(load_wide(data, at), plus(even, odd)))
        even, odd = spread_wide(0.0), spread_wide(0.0)
        for j in range(0, WIDE, 2):
            even = multiply_add(repeat_wide(found, at + j), load_wide(room, white + WIDE * j), even)
            odd = multiply_add(repeat_wide(found, at + j + 1), load_wide(room, white + WIDE * j + WIDE), odd)
        store(found, at, plus(even, odd))


@compiled
def combine(room: Floats, columns: int, stride: int) -> None:
    """Find the gains."""
    cross, white, gains = section(CROSS, stride), section(WHITE, stride), section(GAINS, stride)
    w0, w1, w2 = load_wide(room, white), load_wide(room, white + 8), load_wide(room, white + 16)
    w3, w4, w5 = load_wide(room, white + 24), load_wide(room, white + 32), load_wide(room, white + 40)
    w6, w7 = load_wide(room, white + 48), load_wide(room, white + 56)
    for a in range(0, WIDE * columns, WIDE):
        k = cross + a
        even = times(repeat_wide(room, k), w0)
        odd = times(repeat_wide(room, k + 1), w1)
        even = multiply_add(repeat_wide(room, k + 2), w2, even)
        odd = multiply_add(repeat_wide(room, k + 3), w3, odd)
        even = multiply_add(repeat_wide(room, k + 4), w4, even)
        odd = multiply_add(repeat_wide(room, k + 5), w5, odd)
        even = multiply_add(repeat_wide(room, k + 6), w6, even)
        odd = multiply_add(repeat_wide(room, k + 7), w7, odd)
        store(room, gains + a, plus(even, odd))


@compiled
def subtract(room: Floats, columns: int, stride: int) -> None:
    """Subtract `sum g_j g_j^T` from P, and fill in ACROSS."""
    gains, across = section(GAINS, stride), section(ACROSS, stride)
    for b in range(0, stride, WIDE):
        g0, g1, g2, g3, g4, g5, g6, g7 = transposed(room, gains + WIDE * b, WIDE)
        to = across + b
        store(room, to, g0)
        store(room, to + stride, g1)
        store(room, to + 2 * stride, g2)
        store(room, to + 3 * stride, g3)
        store(room, to + 4 * stride, g4)
        store(room, to + 5 * stride, g5)
        store(room, to + 6 * stride, g6)
        store(room, to + 7 * stride, g7)
        g0, g1, g2, g3 = negative(g0), negative(g1), negative(g2), negative(g3)
        g4, g5, g6, g7 = negative(g4), negative(g5), negative(g6), negative(g7)
        for a in range(b, columns):
            k, p = gains + WIDE * a, a * stride + b
            value = load_wide(room, p)
            value = multiply_add(repeat_wide(room, k), g0, value)
            value = multiply_add(repeat_wide(room, k + 1), g1, value)
            value = multiply_add(repeat_wide(room, k + 2), g2, value)
            value = multiply_add(repeat_wide(room, k + 3), g3, value)
            value = multiply_add(repeat_wide(room, k + 4), g4, value)
            value = multiply_add(repeat_wide(room, k + 5), g5, value)
            value = multiply_add(repeat_wide(room, k + 6), g6, value)
            value = multiply_add(repeat_wide(room, k + 7), g7, value)
            store(room, p, value)


@compiled
def close_octet(room: Floats, columns: int, stride: int) -> None:
    """Take eight samples into P, and let it walk on to the next eight.

    CROSS, WHITE and AHEAD are read, ACROSS and BEFORE filled.
    """
    before, ahead = section(BEFORE, stride), section(AHEAD, stride)
    for a in range(columns):
        room[before + a] = room[a * (stride + 1)]
    combine(room, columns, stride)
    subtract(room, columns, stride)
    for a in range(columns):
        room[a * (stride + 1)] += room[ahead + a]


@compiled
def follow(room: Floats, stride: int, mean: Floats, found: Floats, levels: Floats) -> None:
    """Take eight samples into the means.

    Parameters
    ----------
    room, stride : ACROSS is read.
    mean : (channel, stride) array, predicted for the first sample on entry, filtered at the last on return.
    found : as `innovate` left them.
    levels : (channel, sample, stride) array, filled with the filtered means.
    """
    across = section(ACROSS, stride)
    for channel in range(found.size // WIDE):
        for b in range(0, stride, WIDE):
            level = load_wide(mean, channel * stride + b)
            for i in range(WIDE):
                at = i * stride + b
                new = repeat_wide(found, channel * WIDE + i)
                level = multiply_add(new, load_wide(room, across + at), level)
                store(levels, channel * WIDE * stride + at, level)
            store(mean, channel * stride + b, level)


@compiled
def spread_variances(room: Floats, stride: int) -> None:
    """Fill in VARIANCES from BEFORE, STEPS and ACROSS."""
    across, steps = section(ACROSS, stride), section(STEPS, stride)
    before, variances = section(BEFORE, stride), section(VARIANCES, stride)
    for b in range(0, stride, WIDE):
        value = load_wide(room, before + b)
        for i in range(WIDE):
            gain = load_wide(room, across + i * stride + b)
            value = multiply_add(gain, negative(gain), value)
            store(room, variances + i * stride + b, value)
            value = plus(value, load_wide(room, steps + i * stride + b))
