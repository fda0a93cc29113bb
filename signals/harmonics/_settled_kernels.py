"""The filter whose gains no longer change, eight samples at once.

Each amplitude takes a fixed share of what all of them leave of a sample. Seen from the start of eight samples, where
the levels and their differences are predicted, the innovations e solve

    e_i + sum_{j < i} e_j sum_k h_k(i - j) cos(theta_k[i] - theta_k[j]) = x_i - what the prediction tells of it,

h_k being what a share of an innovation adds to the level of order k so many samples later. That triangle, of ones on
the diagonal, knows the angles only. Inverted, it gives eight innovations in one product; running sums of them take the
amplitudes through the eight samples. Where a shaft turns evenly, one inverse serves as many samples as are held at a
time, and the phasors of eight come from those of the eight before by one product.

Arrays are flat where eight samples stand side by side: (eight, order, sample).
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside, compiled_sums
from signals._lanes import (
    WIDE,
    Lanes,
    interleave,
    load_wide,
    minus,
    multiply_add,
    negative,
    plus,
    repeat_wide,
    running_sums,
    spread_wide,
    store,
    times,
)
from signals.harmonics._octet_kernels import aligned
from signals.harmonics._phasors import Recipe, fill_phasors, fill_rows

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Phasors = tuple[Floats, Floats, Floats, Floats]

PIECE = 256  # samples whose phasors are held at a time: they stay in the nearest cache
EIGHTS = PIECE // WIDE
SQUARE = WIDE * WIDE
# An angle of an order that its rounding does not tell from an even one is off by so much, rad and a part of itself.
EVEN_RAD, EVEN_PART = 1e-9, 2.0**-51

_SELF = np.eye(WIDE).ravel()


@compiled
def filter_on(
    x: Floats,
    phase: Floats,
    orders: Floats,
    shaft: Indices,
    recipe: Recipe,
    row: Indices,
    gains: Floats,
    response: Floats,
    rises: Floats,
    real: Floats,
    imaginary: Floats,
    innovations: Floats,
    skip: int,
    every: int,
    output: int,
    amplitude: Floats,
) -> None:
    """Filter on over some samples.

    Parameters
    ----------
    x : (channel, sample) array.
    phase : (shaft, sample) array in rad.
    orders, shaft : (order,) arrays, their number filled up to an even one with orders that gain nothing.
    recipe, row : of the `PhasorPlan` of the orders; the filling has no rows.
    gains : (pole, order) array, shares of the innovation that levels and differences take.
    response : (order, 2 WIDE) array, h at -WIDE, ... WIDE - 1 samples, 0 up to 0.
    rises : (pole, WIDE) array, what levels and differences at the first of eight samples add to each level.
    real, imaginary : (channel, pole, order, WIDE) arrays, in their last places the predictions for the first sample on
        entry, and for the one after the last on return if the samples are a multiple of eight.
    innovations : (channel, sample) array, filled.
    skip, every : samples before the first output, and from one output to the next.
    output : number of the first output.
    amplitude : (channel, order, 2 output) array, filled in from there: real and imaginary parts in turn.
    """
    channels, samples = x.shape
    count, width = orders.size, WIDE * orders.size
    cosine, sine = aligned(count * PIECE), aligned(count * PIECE)
    # What lies beyond the last sample of all must be numbers, whichever.
    rows, other_rows = np.zeros((recipe[0].size, PIECE)), np.zeros((recipe[0].size, PIECE))
    angles, turns, other_turns = aligned(width + count), aligned(width + count), aligned(width + count)
    triangle, inverses, data = aligned(SQUARE), aligned(SQUARE * EIGHTS), aligned(PIECE)
    levels, other_levels = aligned(count * WIDE), aligned(count * WIDE)
    for first in range(0, samples, PIECE):
        size = min(PIECE, samples - first)
        even = _even(orders, shaft, phase, first, size)
        if even:
            _begin_even(orders, shaft, phase, first, size, angles, turns, other_turns)
            _invert(response, turns, other_turns, 0, triangle, inverses)
        else:
            fill_rows(recipe, phase, first, first + size, rows, other_rows)
            _by_eights(row, rows, other_rows, count, size, cosine, sine)
            for eight in range(-(-size // WIDE)):
                _invert(response, cosine, sine, eight, triangle, inverses)
        ahead = skip - first if skip >= first else -(first - skip) % every
        for channel in range(channels):
            for n in range(size):
                data[n] = x[channel, first + n]
            data[size:] = 0.0
            if even:
                cosine[:width], sine[:width] = turns[:width], other_turns[:width]
            _follow(
                data, size, even, (cosine, sine, turns[width:], other_turns[width:]), inverses, gains, rises,
                real[channel].reshape(-1), imaginary[channel].reshape(-1), levels, other_levels, ahead, every, output,
                amplitude[channel],
            )  # fmt: skip
            for n in range(size):
                innovations[channel, first + n] = data[n]
        output += max(0, (size - ahead + every - 1) // every)


@compiled_sums
def _unevenness(phase: Floats, step: float) -> float:
    """Return the mean square of what the angles differ from even steps."""
    squares = 0.0
    for n in range(phase.size):
        off = phase[n] - (phase[0] + step * n)
        squares += off * off
    return squares / phase.size


@compiled_inside
def _even(orders: Floats, shaft: Indices, phase: Floats, first: int, size: int) -> bool:
    """Tell whether all shafts turn by even steps."""
    for number in range(len(phase)):
        own = phase[number][first : first + size]
        highest = 0.0
        for k in range(orders.size):
            if shaft[k] == number:
                highest = max(highest, orders[k])
        off = highest * np.sqrt(_unevenness(own, (own[-1] - own[0]) / max(size - 1, 1)))
        if not off <= EVEN_RAD + EVEN_PART * highest * abs(own[0]):
            return False
    return True


@compiled_inside
def _begin_even(
    orders: Floats, shaft: Indices, phase: Floats, first: int, size: int, angles: Floats, turns: Floats,
    other_turns: Floats,
) -> None:  # fmt: skip
    """Fill the conjugate phasors of the first eight of even steps, and those of the turns by eight steps, by sines."""
    width = WIDE * orders.size
    for k in range(orders.size):
        own = phase[shaft[k]]
        step = (own[first + size - 1] - own[first]) / max(size - 1, 1)
        for i in range(WIDE):
            angles[WIDE * k + i] = -orders[k] * (own[first] + step * i)
        angles[width + k] = -orders[k] * step * WIDE
    fill_phasors(1.0, angles, turns, other_turns)


@compiled_inside
def _by_eights(
    row: Indices, rows: Floats, other_rows: Floats, count: int, size: int, cosine: Floats, sine: Floats
) -> None:
    """Put phasors, conjugated, where the filter wants them."""
    for k in range(row.size):
        own, other = rows[row[k]], other_rows[row[k]]
        for n in range(0, size, WIDE):
            store(cosine, n * count + WIDE * k, load_wide(own, n))
            store(sine, n * count + WIDE * k, negative(load_wide(other, n)))


@compiled_inside
def _invert(response: Floats, cosine: Floats, sine: Floats, eight: int, triangle: Floats, inverses: Floats) -> None:
    """Fill the inverse of the triangle of eight samples, column by column."""
    count = len(response)
    told = response.reshape(-1)
    t0, t1, t2, t3 = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
    t4, t5, t6 = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
    for k in range(count):
        at, h = (eight * count + k) * WIDE, (2 * k + 1) * WIDE
        c, s = load_wide(cosine, at), load_wide(sine, at)
        t0 = multiply_add(load_wide(told, h), _turned(c, s, cosine, sine, at), t0)
        t1 = multiply_add(load_wide(told, h - 1), _turned(c, s, cosine, sine, at + 1), t1)
        t2 = multiply_add(load_wide(told, h - 2), _turned(c, s, cosine, sine, at + 2), t2)
        t3 = multiply_add(load_wide(told, h - 3), _turned(c, s, cosine, sine, at + 3), t3)
        t4 = multiply_add(load_wide(told, h - 4), _turned(c, s, cosine, sine, at + 4), t4)
        t5 = multiply_add(load_wide(told, h - 5), _turned(c, s, cosine, sine, at + 5), t5)
        t6 = multiply_add(load_wide(told, h - 6), _turned(c, s, cosine, sine, at + 6), t6)
    store(triangle, 0, t0)
    store(triangle, WIDE, t1)
    store(triangle, 2 * WIDE, t2)
    store(triangle, 3 * WIDE, t3)
    store(triangle, 4 * WIDE, t4)
    store(triangle, 5 * WIDE, t5)
    store(triangle, 6 * WIDE, t6)
    for j in range(WIDE - 1, -1, -1):
        column, to = load_wide(_SELF, WIDE * j), SQUARE * eight
        for i in range(j + 1, WIDE):
            told_of = spread_wide(-triangle[WIDE * j + i])
            column = multiply_add(load_wide(inverses, to + WIDE * i), told_of, column)
        store(inverses, to + WIDE * j, column)


@compiled_inside
def _turned(c: Lanes, s: Lanes, cosine: Floats, sine: Floats, at: int) -> Lanes:
    """Return the cosines of angles counted from one of them."""
    return multiply_add(c, repeat_wide(cosine, at), times(s, repeat_wide(sine, at)))


@compiled_inside
def _follow(
    data: Floats, size: int, even: bool, phasors: Phasors, inverses: Floats, gains: Floats, rises: Floats,
    real: Floats, imaginary: Floats, levels: Floats, other_levels: Floats, ahead: int, every: int, output: int,
    amplitude: Floats,
) -> None:  # fmt: skip
    """Take samples into the amplitudes and put wanted ones in their places; leave innovations for the data.

    Where steps are even, phasors are given for the first eight and, from there, turned on eight by eight.
    """
    cosine, sine, turn, other_turn = phasors
    poles, count = gains.shape
    orders, length = amplitude.shape
    share, rise, flat = gains.reshape(-1), rises.reshape(-1), amplitude.reshape(-1)
    width = WIDE * count
    for first in range(0, size, WIDE):
        start, square = (0, 0) if even else (first * count, first * WIDE)
        rest = load_wide(data, first)
        for p in range(poles):
            s0, s1, s2, s3 = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
            for k in range(0, width, 2 * WIDE):
                at, end = start + k, p * width + k + WIDE - 1
                s0 = multiply_add(repeat_wide(real, end), load_wide(cosine, at), s0)
                s1 = multiply_add(repeat_wide(imaginary, end), load_wide(sine, at), s1)
                s2 = multiply_add(repeat_wide(real, end + WIDE), load_wide(cosine, at + WIDE), s2)
                s3 = multiply_add(repeat_wide(imaginary, end + WIDE), load_wide(sine, at + WIDE), s3)
            rest = minus(rest, times(load_wide(rise, WIDE * p), plus(plus(s0, s1), plus(s2, s3))))
        store(data, first, rest)
        s0, s1 = spread_wide(0.0), spread_wide(0.0)
        for j in range(0, WIDE, 2):
            s0 = multiply_add(repeat_wide(data, first + j), load_wide(inverses, square + WIDE * j), s0)
            s1 = multiply_add(repeat_wide(data, first + j + 1), load_wide(inverses, square + WIDE * j + WIDE), s1)
        found = plus(s0, s1)
        store(data, first, found)
        all_eight = every == 1 and first + WIDE <= size
        if all_eight and poles == 1:
            for k in range(orders):
                at, end = WIDE * k, WIDE * k + WIDE - 1
                own = times(repeat_wide(share, k), found)
                a = plus(running_sums(times(own, load_wide(cosine, start + at))), repeat_wide(real, end))
                b = plus(running_sums(times(own, load_wide(sine, start + at))), repeat_wide(imaginary, end))
                store(real, at, a)
                store(imaginary, at, b)
                interleave(a, b, flat, k * length + 2 * output)
        else:
            for k in range(orders):
                c, s = load_wide(cosine, start + WIDE * k), load_wide(sine, start + WIDE * k)
                a, b = spread_wide(0.0), spread_wide(0.0)
                slope, other_slope = a, b
                for p in range(poles - 1, -1, -1):
                    own, at = times(repeat_wide(share, p * count + k), found), p * width + WIDE * k
                    slope, other_slope = a, b
                    a = plus(running_sums(multiply_add(own, c, a)), repeat_wide(real, at + WIDE - 1))
                    b = plus(running_sums(multiply_add(own, s, b)), repeat_wide(imaginary, at + WIDE - 1))
                    store(real, at, a)
                    store(imaginary, at, b)
                if poles > 1:
                    a, b = minus(a, slope), minus(b, other_slope)
                if all_eight:
                    interleave(a, b, flat, k * length + 2 * output)
                else:
                    store(levels, WIDE * k, a)
                    store(other_levels, WIDE * k, b)
        if all_eight:
            ahead, output = ahead + WIDE, output + WIDE
        else:
            while ahead < min(first + WIDE, size):
                for k in range(orders):
                    place, at = k * length + 2 * output, WIDE * k + ahead - first
                    flat[place], flat[place + 1] = levels[at], other_levels[at]
                ahead, output = ahead + every, output + 1
        if even:
            for k in range(count):
                at = WIDE * k
                c, s = load_wide(cosine, at), load_wide(sine, at)
                a, b = repeat_wide(turn, k), repeat_wide(other_turn, k)
                store(cosine, at, minus(times(c, a), times(s, b)))
                store(sine, at, multiply_add(c, b, times(s, a)))
