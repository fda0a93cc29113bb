"""Cosine and sine of many angles at once, without a branch and so in vector registers.

An angle is brought to within a quarter turn of zero by the nearest multiple of pi, which is taken off in three
parts (Cody and Waite [1]_), and both functions are their Taylor polynomials there: the first terms left out are
below 1e-17. Multiples up to 2^19 pi are exact in the first two parts, so an angle of up to a million radians keeps
all its digits; beyond, the error grows as that of the angle itself does.

References
----------
.. [1] W. J. Cody, W. Waite, "Software manual for the elementary functions", Prentice-Hall, 1980.
"""

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import factorial, frexp, ldexp, pi

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside, compiled_sums
from signals._lanes import WIDE, load_wide, minus, multiply_add, plus, spread_wide, store, times

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Recipe = tuple[Floats, Indices, Indices, Indices, Floats]

# Adding and subtracting this rounds to whole numbers.
_ROUND = 1.5 * 2.0**52


def _leading_bits(value: Fraction, bits: int) -> float:
    exponent = frexp(float(value))[1]
    return ldexp(int(value * Fraction(2) ** (bits - exponent)), exponent - bits)


# pi to 40 digits.
_PI = Fraction(31415926535897932384626433832795028841971, 10**40)
_PI_HIGH = _leading_bits(_PI, 33)
_PI_MIDDLE = _leading_bits(_PI - Fraction(_PI_HIGH), 33)
_PI_LOW = float(_PI - Fraction(_PI_HIGH) - Fraction(_PI_MIDDLE))
_PER_PI = 1 / pi

_S3, _S5, _S7, _S9, _S11, _S13, _S15, _S17, _S19 = ((-1) ** (n // 2) / factorial(n) for n in range(3, 21, 2))
_C2, _C4, _C6, _C8, _C10, _C12, _C14, _C16, _C18, _C20 = ((-1) ** (n // 2) / factorial(n) for n in range(2, 22, 2))


@compiled
def fill_phasors(order: float, phase: Floats, cosine: Floats, sine: Floats) -> None:
    """Fill `cosine` and `sine`, (sample,) arrays, with those of `order * phase`, phase in rad."""
    size = phase.size
    if size >= WIDE:
        for n in range(0, size, WIDE):
            # The last eight may have had some of theirs already.
            _fill_eight(order, phase, min(n, size - WIDE), cosine, sine)
    else:
        angle, c, s = np.zeros(WIDE), np.empty(WIDE), np.empty(WIDE)
        angle[:size] = phase
        _fill_eight(order, angle, 0, c, s)
        cosine[:size], sine[:size] = c[:size], s[:size]


@compiled_inside
def _fill_eight(order: float, phase: Floats, n: int, cosine: Floats, sine: Floats) -> None:
    one, away = spread_wide(1.0), spread_wide(_ROUND)
    angle = times(spread_wide(order), load_wide(phase, n))
    multiple = minus(multiply_add(angle, spread_wide(_PER_PI), away), away)
    rest = multiply_add(multiple, spread_wide(-_PI_HIGH), angle)
    rest = multiply_add(multiple, spread_wide(-_PI_MIDDLE), rest)
    rest = multiply_add(multiple, spread_wide(-_PI_LOW), rest)
    half = times(spread_wide(0.5), multiple)
    # Half a multiple is a whole number, or half away from one: where both functions change their sign.
    off = minus(half, minus(plus(half, away), away))
    sign = multiply_add(times(spread_wide(-8.0), off), off, one)
    square = times(rest, rest)
    odd = multiply_add(square, spread_wide(_S19), spread_wide(_S17))
    odd = multiply_add(square, odd, spread_wide(_S15))
    odd = multiply_add(square, odd, spread_wide(_S13))
    odd = multiply_add(square, odd, spread_wide(_S11))
    odd = multiply_add(square, odd, spread_wide(_S9))
    odd = multiply_add(square, odd, spread_wide(_S7))
    odd = multiply_add(square, odd, spread_wide(_S5))
    odd = multiply_add(square, odd, spread_wide(_S3))
    odd = multiply_add(square, odd, one)
    even = multiply_add(square, spread_wide(_C20), spread_wide(_C18))
    even = multiply_add(square, even, spread_wide(_C16))
    even = multiply_add(square, even, spread_wide(_C14))
    even = multiply_add(square, even, spread_wide(_C12))
    even = multiply_add(square, even, spread_wide(_C10))
    even = multiply_add(square, even, spread_wide(_C8))
    even = multiply_add(square, even, spread_wide(_C6))
    even = multiply_add(square, even, spread_wide(_C4))
    even = multiply_add(square, even, spread_wide(_C2))
    even = multiply_add(square, even, one)
    store(cosine, n, times(sign, even))
    store(sine, n, times(times(sign, rest), odd))


@dataclass(frozen=True, kw_only=True, eq=False)
class PhasorPlan:
    """How to come by the phasors of many orders with few sines: as products of others, wherever orders add up.

    Attributes
    ----------
    recipe : (row,) arrays, rows in the order in which they are made: the order and the shaft it turns with; the two
        rows whose product it is, -1 where it is made from the angle; -1.0 where the second of these is conjugated.
    row : (order,) array, the row of each order asked for.
    places : (3, order) array: that row, the column of the order's real part and that of its imaginary part, -1 where
        there is none, as `HarmonicModel` orders them.
    """

    recipe: Recipe
    row: Indices
    places: Indices

    @classmethod
    def of(cls, orders: Floats, shaft: Indices) -> "PhasorPlan":
        """Plan for orders, each of a numbered shaft."""
        # Trackers ask again for every block of a stream.
        return cls._of(tuple(orders.tolist()), tuple(shaft.tolist()))

    @classmethod
    @lru_cache(maxsize=64)
    def _of(cls, orders: tuple[float, ...], shaft: tuple[int, ...]) -> "PhasorPlan":
        rows: list[tuple[float, int, int, int, float]] = []
        place: dict[tuple[float, int], int] = {}
        sums: dict[tuple[float, int], tuple[int, int, float]] = {}

        def add(order: float, number: int, parents: tuple[int, int, float]) -> None:
            here = len(rows)
            place[order, number] = here
            rows.append((order, number, *parents))
            for other, (theirs, their_shaft, *_) in enumerate(rows):
                if their_shaft == number:
                    sums.setdefault((order + theirs, number), (here, other, 1.0))
                    sums.setdefault((abs(order - theirs), number), (*_larger_first(here, other, rows), -1.0))

        for order, number in sorted(set(zip(orders, shaft, strict=True))):
            add(order, number, sums.get((order, number), (-1, -1, 1.0)))
        turns, shafts, first, second, sign = zip(*rows, strict=True)
        row = [place[pair] for pair in zip(orders, shaft, strict=True)]
        real = range(len(orders))
        turning = np.cumsum(np.array(orders) != 0.0)
        imaginary = np.where(np.array(orders) != 0.0, len(orders) - 1 + turning, -1)
        return cls(
            recipe=(np.array(turns), np.array(shafts), np.array(first), np.array(second), np.array(sign)),
            row=np.array(row),
            places=np.array([row, real, imaginary]),
        )


def _larger_first(a: int, b: int, rows: list[tuple[float, int, int, int, float]]) -> tuple[int, int]:
    return (a, b) if rows[a][0] >= rows[b][0] else (b, a)


@compiled
def fill_rows(recipe: Recipe, phase: Floats, first: int, last: int, cosine: Floats, sine: Floats) -> None:
    """Fill the phasors of a `PhasorPlan` for samples `first` up to `last`.

    Parameters
    ----------
    recipe : that of the plan.
    phase : (shaft, sample) array in rad.
    cosine, sine : (row, sample) arrays, filled from their first column on.
    """
    order, shaft, one, other, sign = recipe
    size = last - first
    for row in range(order.size):
        c, s = cosine[row][:size], sine[row][:size]
        if one[row] < 0:
            fill_phasors(order[row], phase[shaft[row]][first:last], c, s)
        else:
            a, b = cosine[one[row]][:size], sine[one[row]][:size]
            _multiply(a, b, cosine[other[row]][:size], sine[other[row]][:size], sign[row], c, s)


@compiled
def _multiply(a: Floats, b: Floats, c: Floats, d: Floats, sign: float, real: Floats, imaginary: Floats) -> None:
    """Fill `(a + j b) (c + sign j d)`."""
    for n in range(real.size):
        turned = sign * d[n]
        real[n] = a[n] * c[n] - b[n] * turned
        imaginary[n] = b[n] * c[n] + a[n] * turned


@compiled_sums
def kinks(phase: Floats, length: int, largest: Floats) -> None:
    """Fill, (block,), a bound on how far one step differs from the next in each block of so many samples.

    The fourth root of a sum of fourth powers: at most the fourth root of `length` above the largest.
    """
    for block in range(largest.size):
        fourth = 0.0
        for n in range(max(block * length, 1), min((block + 1) * length, phase.size - 1)):
            square = (phase[n + 1] - 2.0 * phase[n] + phase[n - 1]) ** 2
            fourth += square * square
        largest[block] = np.sqrt(np.sqrt(fourth))
