"""Moments of blocks from samples, and samples from amplitudes between blocks.

Block `i` holds the samples from `i length` up to `(i + 1) length`; nodes lie at its first sample and at that of the
next. Within a block the place u runs from 0 to 1, and a moment is a sum over its samples times a power of u. Phasors
are computed for about `PIECE` samples at a time, which stay in the first-level cache, in a loop without branches that
compilers vectorise: the nearest multiple of pi is subtracted from an angle in three parts [1]_, and sine and cosine of
the rest are Taylor polynomials with errors below 1e-17. Multiples up to 2^19 pi are exact in the first two parts, so
angles of up to a million radians have full precision; beyond, the error grows as that of the angle itself does.

.. [1] W. J. Cody, W. Waite, "Software manual for the elementary functions", Prentice-Hall, 1980.
"""

from math import factorial, pi

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_in_place, compiled_sums_in_place

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Complexes = NDArray[np.complex128]

PIECE = 256


# Pi to 33 bits, its next 33 bits, and the rest.
_PI_HIGH, _PI_MIDDLE, _PI_LOW = 3.1415926534682512, 1.2154201012607932e-10, 4.044532497591901e-21
_PER_PI = 1 / pi

# Taylor coefficients of the sine from the third power on and of the cosine from the second
_SINE = tuple((-1) ** (n // 2) / factorial(n) for n in range(3, 21, 2))
_COSINE = tuple((-1) ** (n // 2) / factorial(n) for n in range(2, 22, 2))


@compiled_in_place
def fill_phasors(order: float, phase: Floats, cosine: Floats, sine: Floats) -> None:
    """Fill `cosine` and `sine`, (sample or more,) arrays, with those of `order * phase`, (sample,) in rad."""
    for n in range(phase.size):
        angle = order * phase[n]
        multiple = np.rint(angle * _PER_PI)
        rest = angle - multiple * _PI_HIGH
        rest = rest - multiple * _PI_MIDDLE
        rest = rest - multiple * _PI_LOW
        # Both functions change their sign where half the multiple is not a whole number.
        off = 0.5 * multiple - np.rint(0.5 * multiple)
        sign = 1.0 - 8.0 * off * off
        s = rest * rest
        odd = _SINE[6] + s * (_SINE[7] + s * _SINE[8])
        odd = _SINE[0] + s * (_SINE[1] + s * (_SINE[2] + s * (_SINE[3] + s * (_SINE[4] + s * (_SINE[5] + s * odd)))))
        even = _COSINE[6] + s * (_COSINE[7] + s * (_COSINE[8] + s * _COSINE[9]))
        even = _COSINE[2] + s * (_COSINE[3] + s * (_COSINE[4] + s * (_COSINE[5] + s * even)))
        even = 1.0 + s * (_COSINE[0] + s * (_COSINE[1] + s * even))
        cosine[n] = sign * even
        sine[n] = sign * (rest + rest * s * odd)


def phasors(angle: Floats) -> Complexes:
    """Return exp(-j angle) of an array of any shape, in rad."""
    cosine, sine = np.empty(angle.size), np.empty(angle.size)
    fill_phasors(-1.0, angle.ravel(), cosine, sine)
    return (cosine + 1j * sine).reshape(angle.shape)


@compiled_sums_in_place
def _add_moment(weights: Floats, cosine: Floats, sine: Floats, sums: Floats) -> None:
    """Add the sums of the weights, u^moment x, times cos and -sin to a moment, (2,)."""
    real, imaginary = 0.0, 0.0
    for n in range(weights.size):
        real += weights[n] * cosine[n]
        imaginary -= weights[n] * sine[n]
    sums[0] += real
    sums[1] += imaginary


@compiled_sums_in_place
def project(x: Floats, phase: Floats, orders: Floats, shaft: Indices, length: int, work: Floats, sums: Floats) -> None:
    """Fill the moments of a record against each order, block by block of `length` samples.

    Given are the (channel, sample) record, 0 where missing, whose first sample starts a block; (shaft, sample) angles;
    (order,) orders and the shaft each counts; scratch of (2 + channel moment, 2 PIECE). Sums, (block, moment, order,
    channel, 2) zeros, are filled with those of u^moment x cos and of -u^moment x sin.
    """
    blocks, moments, _, channels, _ = sums.shape
    cosine, sine, weights, size = work[0], work[1], work[2:], work.shape[1]
    together = max(1, PIECE // length)
    for begin in range(0, blocks, together):
        end = min(begin + together, blocks)
        stop = min(end * length, x.shape[1])
        for first in range(begin * length, stop, size):
            last = min(first + size, stop)
            for channel in range(channels):
                row = channel * moments
                for n in range(last - first):
                    weights[row, n] = x[channel, first + n]
                for block in range(begin, end):
                    start = max(block * length, first)
                    for n in range(start - first, min((block + 1) * length, last) - first):
                        u = (first + n - block * length) / length
                        for moment in range(1, moments):
                            weights[row + moment, n] = u * weights[row + moment - 1, n]
            for k in range(orders.size):
                fill_phasors(orders[k], phase[shaft[k], first:last], cosine, sine)
                for block in range(begin, end):
                    part = slice(max(block * length, first) - first, min((block + 1) * length, last) - first)
                    for channel in range(channels):
                        for moment in range(moments):
                            row = channel * moments + moment
                            _add_moment(weights[row, part], cosine[part], sine[part], sums[block, moment, k, channel])


@compiled_sums_in_place
def _three_sums(own: Floats, other: Floats, weights: Floats) -> tuple[float, float, float]:
    """Return the sums of the products of two rows times each of three rows of weights."""
    first, second, third = weights[0], weights[1], weights[2]
    low, middle, high = 0.0, 0.0, 0.0
    for n in range(own.size):
        product = own[n] * other[n]
        low += product * first[n]
        middle += product * second[n]
        high += product * third[n]
    return low, middle, high


@compiled_sums_in_place
def correlate(columns: Floats, seen: Flags, length: int, powers: Floats, sums: Floats) -> None:
    """Add up the moments of the products of every two of the (column, sample) regressors, block by block.

    Sums, (block, moment, column, column) zeros, are filled with those of u^moment times the products over the samples
    `seen`, three moments in a pass. Powers, (moments rounded up to a multiple of 3, PIECE), are scratch.
    """
    _, moments, width, _ = sums.shape
    for block in range(len(sums)):
        start, stop = block * length, min((block + 1) * length, seen.size)
        for first in range(start, stop, PIECE):
            part = slice(first, min(first + PIECE, stop))
            for n in range(part.stop - first):
                powers[0, n] = 1.0 if seen[first + n] else 0.0
                for moment in range(1, len(powers)):
                    powers[moment, n] = powers[moment - 1, n] * (first + n - start) / length
            for a in range(width):
                for b in range(a + 1):
                    for low in range(0, moments, 3):
                        totals = _three_sums(columns[a, part], columns[b, part], powers[low:])
                        for moment in range(low, min(low + 3, moments)):
                            sums[block, moment, a, b] += totals[moment - low]
        for a in range(width):
            for b in range(a):
                for moment in range(moments):
                    sums[block, moment, b, a] = sums[block, moment, a, b]


@compiled_in_place
def evaluate(pieces: Floats, length: int, every: int, values: Floats) -> None:
    """Fill the values of pairs of piecewise cubics, the real and imaginary parts, at samples evenly apart.

    Pieces, (line, block, 2, 4), are coefficients of 1, u, u^2, u^3 in blocks of `length` samples; values
    are `every` samples apart. Values, (line, 2 output), are filled with both parts in turn; the last block takes all
    outputs that follow it.
    """
    lines, blocks, _, _ = pieces.shape
    outputs = values.shape[1] // 2
    for line in range(lines):
        for block in range(blocks):
            first = -(-block * length // every)
            last = outputs if block == blocks - 1 else min(-(-(block + 1) * length // every), outputs)
            start, step = first * every / length - block, every / length
            a0, a1, a2, a3 = pieces[line, block, 0]
            b0, b1, b2, b3 = pieces[line, block, 1]
            row = values[line, 2 * first : 2 * last]
            for n in range(last - first):
                u = start + step * n
                row[2 * n] = a0 + u * (a1 + u * (a2 + u * a3))
                row[2 * n + 1] = b0 + u * (b1 + u * (b2 + u * b3))


@compiled_in_place
def remodulate(
    pieces: Floats, length: int, phase: Floats, orders: Floats, shaft: Indices, start: int, work: Floats, wave: Floats
) -> None:
    """Add to a (sample,) wave, from sample `start` on, that of amplitudes given as pieces, as `evaluate` has them.

    Angles, of the samples of the wave, orders and their shafts are given as to `project`; scratch is (2, PIECE).
    """
    cosine, sine, final = work[0], work[1], pieces.shape[1] - 1
    for first in range(0, wave.size, PIECE):
        last = min(first + PIECE, wave.size)
        for k in range(orders.size):
            fill_phasors(orders[k], phase[shaft[k], first:last], cosine, sine)
            for block in range(min((start + first) // length, final), min((start + last - 1) // length, final) + 1):
                begin = max(block * length - start, first)
                end = last if block == final else min((block + 1) * length - start, last)
                place, step = (start + begin - block * length) / length, 1.0 / length
                a0, a1, a2, a3 = pieces[k, block, 0]
                b0, b1, b2, b3 = pieces[k, block, 1]
                part, own = slice(begin - first, end - first), wave[begin:end]
                c, s = cosine[part], sine[part]
                for n in range(end - begin):
                    u = place + step * n
                    real = a0 + u * (a1 + u * (a2 + u * a3))
                    imaginary = b0 + u * (b1 + u * (b2 + u * b3))
                    own[n] += real * c[n] - imaginary * s[n]


@compiled_sums_in_place
def step_changes(phase: Floats, length: int, largest: Floats) -> None:
    """Fill, (block,), a bound on how far one step of the angle differs from the next in each block of so many samples.

    The fourth root of a sum of fourth powers: at most the fourth root of `length` above the largest.
    """
    for block in range(largest.size):
        first, last = max(block * length, 1), min((block + 1) * length, phase.size - 1)
        before, here, after = phase[first - 1 : last - 1], phase[first:last], phase[first + 1 : last + 1]
        fourth = 0.0
        for n in range(here.size):
            square = (after[n] - 2.0 * here[n] + before[n]) ** 2
            fourth += square * square
        largest[block] = np.sqrt(np.sqrt(fourth))


@compiled_sums_in_place
def on_line(phase: Floats, step: float, most: float) -> bool:
    """Return whether no angle is further than `most` from one that grows steadily from the first."""
    for i in range(phase.size):  # noqa: SIM110 - numba compiles no generators
        if not abs(phase[i] - (phase[0] + step * i)) <= most:
            return False
    return True
