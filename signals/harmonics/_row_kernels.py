"""Rows of matrices and of vectors, as doubles or as sums of two, for the sweeps of filter and smoother."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_inside
from signals._lanes import (
    LANES,
    WIDE,
    load,
    load_wide,
    multiply_add,
    plus,
    repeat,
    repeat_wide,
    spread,
    spread_wide,
    store,
)
from signals.harmonics._twofold import add_product

Floats = NDArray[np.float64]


@compiled_inside
def add_row(
    pairs: bool, target: Floats, at: int, high: float, low: float, source: Floats, start: int, count: int
) -> None:
    """Add a number times `count` numbers of one (2, ...) array, high parts and low, to those of another.

    `at` and `start` are the flat indices where they begin.
    """
    wide, t, s = count - count % WIDE, target.size // 2, source.size // 2
    for c in range(0, wide, WIDE):
        one, other = load_wide(source, start + c), load_wide(target, at + c)
        if pairs:
            value = add_product(
                other, load_wide(target, t + at + c), one, load_wide(source, s + start + c), spread_wide(high),
                spread_wide(low),
            )  # fmt: skip
            store(target, at + c, value[0])
            store(target, t + at + c, value[1])
        else:
            store(target, at + c, multiply_add(spread_wide(high), one, other))
    for c in range(wide, count, LANES):
        first, second = load(source, start + c), load(target, at + c)
        if pairs:
            last = add_product(
                second, load(target, t + at + c), first, load(source, s + start + c), spread(high), spread(low)
            )
            store(target, at + c, last[0])
            store(target, t + at + c, last[1])
        else:
            store(target, at + c, multiply_add(spread(high), first, second))


@compiled_inside
def add_rows(
    pairs: bool, target: Floats, at: int, sign: float, factors: Floats, first: int, apart: int, source: Floats,
    start: int, stride: int, rows: int, count: int,
) -> None:  # fmt: skip
    """Add `rows` rows as `add_row` does one, each times a number that lies `apart` from the one before, and a sign.

    `first` is the flat index of the first of these numbers; the rows, of `count` numbers, lie a stride apart.
    """
    if pairs:
        half = factors.size // 2
        for b in range(rows):
            number, k = first + b * apart, start + b * stride
            high, low = sign * factors.flat[number], sign * factors.flat[half + number]
            add_row(pairs, target, at, high, low, source, k, count)
        return
    wide, whole = count - count % WIDE, rows - rows % 4
    # Four short sums instead of a long one, in which each product would wait for the one before.
    for c in range(0, wide, WIDE):
        one, two, three, four = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
        for b in range(0, whole, 4):
            number, k = first + b * apart, start + b * stride + c
            one = multiply_add(repeat_wide(factors, number), load_wide(source, k), one)
            two = multiply_add(repeat_wide(factors, number + apart), load_wide(source, k + stride), two)
            three = multiply_add(repeat_wide(factors, number + 2 * apart), load_wide(source, k + 2 * stride), three)
            four = multiply_add(repeat_wide(factors, number + 3 * apart), load_wide(source, k + 3 * stride), four)
        for b in range(whole, rows):
            one = multiply_add(repeat_wide(factors, first + b * apart), load_wide(source, start + b * stride + c), one)
        change = plus(plus(one, two), plus(three, four))
        store(target, at + c, multiply_add(spread_wide(sign), change, load_wide(target, at + c)))
    for c in range(wide, count, LANES):
        even, odd = spread(0.0), spread(0.0)
        for b in range(0, whole, 2):
            number, k = first + b * apart, start + b * stride + c
            even = multiply_add(repeat(factors, number), load(source, k), even)
            odd = multiply_add(repeat(factors, number + apart), load(source, k + stride), odd)
        for b in range(whole, rows):
            even = multiply_add(repeat(factors, first + b * apart), load(source, start + b * stride + c), even)
        store(target, at + c, multiply_add(spread(sign), plus(even, odd), load(target, at + c)))
