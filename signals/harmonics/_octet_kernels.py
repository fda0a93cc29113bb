"""A covariance filter of levels alone that takes eight samples at once, as exactly as one by one.

Within eight samples the state x is carried by its walk only. Of the eight measurements `y_j = h_j . x_j + v_j` and
the state at or after each of them, given what was known before (mean m, covariance P, walked variances Q_j),

    cov(x, y_j) = c_j = (P + Q_j) h_j,     cov(y_i, y_j) = h_j . c_i + (1 where i = j),     i <= j.

A Cholesky factor of that 8 x 8 matrix makes the innovations e, white and of unit variance, and the gains
`g_j = cov(x, e_j)`. Up to sample t,

    mean = m + sum_{j <= t} g_j e_j,     covariance = P + Q_t - sum_{j <= t} g_j g_j^T,

which is what the filter finds sample by sample. P is read and written once for the eight, and all the long loops
have eight samples or eight columns side by side. A sample that is missing measures nothing: its h is zero.

All lives in one flat array, the *room*, eight numbers after eight. Columns come in tiles of eight, their number filled
up to the *stride*. Of P the lower triangle counts, by panels of a tile: (tile, row, column). Sections of eight strides
each follow: (column, sample), or (tile, sample, column).
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import (
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
from signals._tiles import (
    add_inner,
    add_outer,
    load_tile,
    negative_tile,
    store_tile,
    times_tile,
    transposed,
    upper_product,
    whiten,
)

Floats = NDArray[np.float64]

# Sections, (column, sample): h; the c_j; the variances walked from the first sample to each.
H, CROSS, WALKED = 0, 1, 2
# (tile, sample, column): the c_j; the gains; filtered variances; variances walked from each sample to the next.
TURNED, GAINS, VARIANCES, STEPS = 3, 4, 5, 6
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


@compiled_inside
def section(number: int, stride: int) -> int:
    """Return where a section starts."""
    return stride * (stride + WIDE * number)


@compiled_inside
def entry(row: int, column: int, stride: int) -> int:
    """Return where an entry of P is, its column in no tile after its row's."""
    return (column - column % WIDE) * stride + WIDE * row + column % WIDE


@compiled_inside
def place(column: int) -> int:
    """Return where a column begins in a section (tile, sample, column)."""
    return WIDE * (column - column % WIDE) + column % WIDE


@compiled_inside
def weigh(room: Floats, columns: int, stride: int) -> None:
    """Find the c_j."""
    whole = columns - columns % WIDE
    for a in range(0, whole, WIDE):
        _weigh_eight(room, columns, stride, a)
    if whole < columns:
        _weigh_four(room, columns, stride, whole)


@compiled_inside
def _weigh_eight(room: Floats, columns: int, stride: int, a: int) -> None:
    """Find those of a tile of columns."""
    h, own = section(H, stride), WIDE * a
    sums = times_tile(load_tile(room, section(WALKED, stride) + own), load_tile(room, h + own))
    for b in range(a):
        sums = add_outer(room, entry(a, b, stride), WIDE, load_wide(room, h + WIDE * b), sums)
    for b in range(a, columns):
        sums = add_outer(room, a * stride + WIDE * b, 1, load_wide(room, h + WIDE * b), sums)
    store_tile(room, section(CROSS, stride) + own, sums)


@compiled_inside
def _weigh_four(room: Floats, columns: int, stride: int, a: int) -> None:
    """Find those of the last four columns: even terms and odd, so that no sum waits for itself."""
    h, to = section(H, stride), section(CROSS, stride) + WIDE * a
    k, q = h + WIDE * a, section(WALKED, stride) + WIDE * a
    s0, s1, s2, s3 = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
    t0 = times(load_wide(room, q), load_wide(room, k))
    t1 = times(load_wide(room, q + 8), load_wide(room, k + 8))
    t2 = times(load_wide(room, q + 16), load_wide(room, k + 16))
    t3 = times(load_wide(room, q + 24), load_wide(room, k + 24))
    # The tile on the diagonal is whole.
    for b in range(0, columns, 2):
        row, p = load_wide(room, h + WIDE * b), entry(a, b, stride)
        s0 = multiply_add(repeat_wide(room, p), row, s0)
        s1 = multiply_add(repeat_wide(room, p + 8), row, s1)
        s2 = multiply_add(repeat_wide(room, p + 16), row, s2)
        s3 = multiply_add(repeat_wide(room, p + 24), row, s3)
        row = load_wide(room, h + WIDE * b + WIDE)
        t0 = multiply_add(repeat_wide(room, p + 1), row, t0)
        t1 = multiply_add(repeat_wide(room, p + 9), row, t1)
        t2 = multiply_add(repeat_wide(room, p + 17), row, t2)
        t3 = multiply_add(repeat_wide(room, p + 25), row, t3)
    store(room, to, plus(s0, t0))
    store(room, to + 8, plus(s1, t1))
    store(room, to + 16, plus(s2, t2))
    store(room, to + 24, plus(s3, t3))


@compiled_inside
def correlate(room: Floats, columns: int, stride: int) -> None:
    """Find the covariance of the measurements, from its diagonal on."""
    h, cross, joint = section(H, stride), section(CROSS, stride), section(JOINT, stride)
    sums = load_tile(_SELF, 0)
    for a in range(0, WIDE * columns, WIDE):
        sums = add_outer(room, cross + a, 1, load_wide(room, h + a), sums)
    store_tile(room, joint, sums)


@compiled_inside
def open_octet(room: Floats, columns: int, stride: int, roots: Floats) -> None:
    """Find what makes eight innovations white; put one over their standard deviations in `roots`.

    H, WALKED and P are read.
    """
    weigh(room, columns, stride)
    correlate(room, columns, stride)
    turn(room, stride)
    store(roots, 0, whiten(room, section(JOINT, stride), room, section(WHITE, stride)))


@compiled_inside
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


@compiled_inside
def turn(room: Floats, stride: int) -> None:
    """Fill in TURNED."""
    cross, turned = section(CROSS, stride), section(TURNED, stride)
    for at in range(0, WIDE * stride, WIDE * WIDE):
        store_tile(room, turned + at, transposed(room, cross + at, WIDE))


@compiled_inside
def combine(room: Floats, stride: int) -> None:
    """Find the gains."""
    turned, white, gains = section(TURNED, stride), section(WHITE, stride), section(GAINS, stride)
    for at in range(0, WIDE * stride, WIDE * WIDE):
        store_tile(room, gains + at, upper_product(room, white, load_tile(room, turned + at)))


@compiled_inside
def subtract(room: Floats, columns: int, stride: int) -> None:
    """Subtract `sum g_j g_j^T` from P, and let it walk on to the next eight; fill in BEFORE."""
    gains, before, ahead = section(GAINS, stride), section(BEFORE, stride), section(AHEAD, stride)
    for b in range(0, stride, WIDE):
        panel, taken = b * stride, negative_tile(load_tile(room, gains + WIDE * b))
        diagonal, walked = spread_wide(0.0), load_wide(room, ahead + b)
        for a in range(b, b + WIDE):
            row, own = load_wide(room, panel + WIDE * a), load_wide(_SELF, WIDE * (a - b))
            diagonal = multiply_add(own, row, diagonal)
            row = multiply_add(own, walked, add_inner(room, gains + place(a), WIDE, taken, row))
            store(room, panel + WIDE * a, row)
        store(room, before + b, diagonal)
        for a in range(b + WIDE, columns):
            row = load_wide(room, panel + WIDE * a)
            store(room, panel + WIDE * a, add_inner(room, gains + place(a), WIDE, taken, row))


@compiled_inside
def close_octet(room: Floats, columns: int, stride: int) -> None:
    """Take eight samples into P, and let it walk on to the next eight.

    TURNED, WHITE and AHEAD are read, GAINS and BEFORE filled.
    """
    combine(room, stride)
    subtract(room, columns, stride)


@compiled_inside
def follow(room: Floats, stride: int, mean: Floats, found: Floats, levels: Floats) -> None:
    """Take eight samples into the means.

    Parameters
    ----------
    room, stride : GAINS is read.
    mean : (channel, stride) array, predicted for the first sample on entry, filtered at the last on return.
    found : as `innovate` left them.
    levels : (channel, tile, sample, column) array, filled with the filtered means.
    """
    gains = section(GAINS, stride)
    for channel in range(found.size // WIDE):
        for b in range(0, stride, WIDE):
            level = load_wide(mean, channel * stride + b)
            for i in range(WIDE):
                at = WIDE * (b + i)
                new = repeat_wide(found, channel * WIDE + i)
                level = multiply_add(new, load_wide(room, gains + at), level)
                store(levels, channel * WIDE * stride + at, level)
            store(mean, channel * stride + b, level)


@compiled_inside
def spread_variances(room: Floats, stride: int) -> None:
    """Fill in VARIANCES from BEFORE, STEPS and GAINS."""
    gains, steps = section(GAINS, stride), section(STEPS, stride)
    before, variances = section(BEFORE, stride), section(VARIANCES, stride)
    for b in range(0, stride, WIDE):
        value = load_wide(room, before + b)
        for i in range(WIDE):
            at = WIDE * (b + i)
            gain = load_wide(room, gains + at)
            value = multiply_add(gain, negative(gain), value)
            store(room, variances + at, value)
            value = plus(value, load_wide(room, steps + at))
