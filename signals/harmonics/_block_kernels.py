"""From samples to moments of blocks, and from amplitudes at the knots between blocks back to samples.

Block `i` holds the samples from `i length` up to `(i + 1) length`; knots lie at its first sample and at that of the
next. Within a block, u runs from 0 to 1, and a moment is a sum of something times a power of it.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums
from signals._lanes import WIDE, load_wide, minus, multiply_add, plus, repeat_wide, spread_wide, store, times, total
from signals.harmonics._steady_phasors import PIECE, ROWS, STRIDE, begin_piece, fill_steady, workspace

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled_sums
def project(x: Floats, phase: Floats, orders: Floats, shaft: Indices, length: int, sums: Floats) -> None:
    """Fill the moments of the record against each order, block by block.

    Parameters
    ----------
    x : (channel, sample) array, 0 where missing; the first sample starts a block.
    phase : (shaft, sample) array in rad.
    orders, shaft : (order,) arrays, cycles per revolution and the shaft they count.
    length : samples in a block.
    sums : (order, block, pair channel, 4) array, filled: of x cos, u x cos, -x sin, -u x sin of every channel; of u^2
        times these; and so on for as many pairs of moments as there is room for.
    """
    work = workspace(len(phase), ROWS)
    cosine, sine = np.zeros((ROWS, PIECE)), np.zeros((ROWS, PIECE))
    plain, late = np.empty((sums.shape[2], PIECE)), np.empty((sums.shape[2], PIECE))
    sums[:] = 0.0
    for block in range(sums.shape[1]):
        stop = min((block + 1) * length, x.shape[1])
        for first in range(block * length, stop, PIECE):
            last = min(first + PIECE, stop)
            _fill_weighted(x, first, last, block, length, plain, late)
            begin_piece(work, phase, first, last)
            for k in range(0, orders.size, ROWS):
                fill_steady(work, orders[k : k + ROWS], shaft[k : k + ROWS], phase, first, last, cosine, sine)
                _add_moments(plain, late, cosine, sine, last - first, block, sums[k : k + ROWS])


@compiled
def _fill_weighted(x: Floats, first: int, last: int, block: int, length: int, plain: Floats, late: Floats) -> None:
    """Copy samples, and copy them weighted by their places in a block, with zeros behind to a whole stride.

    Where there is room for more than the channels, these follow: times the squares of places, and so on.
    """
    place, step, size = (first - block * length) / length, 1.0 / length, last - first
    for channel in range(len(x)):
        for n in range(size):
            plain[channel, n] = x[channel, first + n]
            late[channel, n] = (place + step * n) * x[channel, first + n]
        for n in range(size, -(-size // STRIDE) * STRIDE):
            plain[channel, n] = late[channel, n] = 0.0
    for row in range(len(x), len(plain)):
        for n in range(-(-size // STRIDE) * STRIDE):
            plain[row, n] = (place + step * n) * late[row - len(x), n]
            late[row, n] = (place + step * n) * plain[row, n]


@compiled
def _add_moments(
    plain: Floats, late: Floats, cosine: Floats, sine: Floats, size: int, block: int, sums: Floats
) -> None:
    """Add the moments of samples, plain and late, against some rows of phasors to those of a block."""
    for k in range(len(sums)):
        row = k * PIECE
        for channel in range(len(plain)):
            at = channel * PIECE
            r0 = r1 = l0 = l1 = i0 = i1 = m0 = m1 = spread_wide(0.0)
            for n in range(0, size, STRIDE):
                x, u = load_wide(plain, at + n), load_wide(late, at + n)
                c, s = load_wide(cosine, row + n), load_wide(sine, row + n)
                r0, l0 = multiply_add(x, c, r0), multiply_add(u, c, l0)
                i0, m0 = multiply_add(x, s, i0), multiply_add(u, s, m0)
                x, u = load_wide(plain, at + n + WIDE), load_wide(late, at + n + WIDE)
                c, s = load_wide(cosine, row + n + WIDE), load_wide(sine, row + n + WIDE)
                r1, l1 = multiply_add(x, c, r1), multiply_add(u, c, l1)
                i1, m1 = multiply_add(x, s, i1), multiply_add(u, s, m1)
            sums[k, block, channel, 0] += total(plus(r0, r1))
            sums[k, block, channel, 1] += total(plus(l0, l1))
            sums[k, block, channel, 2] -= total(plus(i0, i1))
            sums[k, block, channel, 3] -= total(plus(m0, m1))


@compiled_sums
def correlate(seen: Floats, phase: Floats, orders: Floats, shaft: Indices, length: int, sums: Floats) -> None:
    """Fill the moments of the products of every two columns of the model, block by block.

    Parameters
    ----------
    seen : (1, sample) array, 0 where missing, else 1.
    phase, orders, shaft, length : as for `project`.
    sums : (block, moment, 2 order, 2 order) array, filled: of the products of cos and -sin of all orders (all cos
        first), of u times these, of u^2 times these, and so on.
    """
    width, moments = 2 * orders.size, sums.shape[1]
    work = workspace(len(phase), orders.size)
    columns = np.zeros((moments // 2 + 1, width, PIECE))  # times powers of u
    sums[:] = 0.0
    for block in range(len(sums)):
        stop = min((block + 1) * length, seen.shape[1])
        for first in range(block * length, stop, PIECE):
            last = min(first + PIECE, stop)
            plain = columns[0]
            begin_piece(work, phase, first, last)
            fill_steady(work, orders, shaft, phase, first, last, plain[: orders.size], plain[orders.size :])
            _fill_powers(seen[0][first:last], (first - block * length) / length, 1.0 / length, columns)
            size = -(-(last - first) // STRIDE) * STRIDE
            for half in range((moments - 1) // 2):
                if 2 * half + 3 < moments:
                    _add_products(columns[half], columns[half + 1], size, sums[block, 2 * half :])
                else:
                    _add_squares(columns[half], columns[half + 1], size, sums[block, 2 * half :])
            if moments % 2 == 0:
                _add_products(columns[moments // 2 - 1], columns[moments // 2], size, sums[block, moments - 2 :])
        for a in range(width):
            for b in range(a):
                sums[block, :, b, a] = sums[block, :, a, b]


@compiled
def _fill_powers(seen: Floats, place: float, step: float, columns: Floats) -> None:
    """Weight cosines and sines, (power, column, sample), and turn the latter round; fill in their further powers."""
    width = columns.shape[1]
    for a in range(width):
        row = columns[0, a]
        sign = 1.0 if 2 * a < width else -1.0
        for n in range(seen.size):
            row[n] *= sign * seen[n]
        for n in range(seen.size, row.size):
            row[n] = 0.0
        for power in range(1, len(columns)):
            lower, higher = columns[power - 1, a], columns[power, a]
            for n in range(row.size):
                higher[n] = (place + step * n) * lower[n]


@compiled
def _add_products(columns: Floats, late: Floats, size: int, sums: Floats) -> None:
    """Add the sums of products of every two columns, and of one late with the other, to two moments of a block."""
    for a in range(0, len(columns), 2):
        for b in range(0, a + 1, 2):
            # Two columns with two: what is read serves eight sums.
            one, other = a * PIECE, b * PIECE
            p00 = p01 = p10 = p11 = q00 = q01 = q10 = q11 = spread_wide(0.0)
            for n in range(0, size, WIDE):
                b0, b1 = load_wide(columns, other + n), load_wide(columns, other + PIECE + n)
                a0, late0 = load_wide(columns, one + n), load_wide(late, one + n)
                p00, p01 = multiply_add(a0, b0, p00), multiply_add(a0, b1, p01)
                q00, q01 = multiply_add(late0, b0, q00), multiply_add(late0, b1, q01)
                a1, late1 = load_wide(columns, one + PIECE + n), load_wide(late, one + PIECE + n)
                p10, p11 = multiply_add(a1, b0, p10), multiply_add(a1, b1, p11)
                q10, q11 = multiply_add(late1, b0, q10), multiply_add(late1, b1, q11)
            _add_tile(sums[0], a, b, total(p00), total(p01), total(p10), total(p11))
            _add_tile(sums[1], a, b, total(q00), total(q01), total(q10), total(q11))


@compiled
def _add_squares(columns: Floats, late: Floats, size: int, sums: Floats) -> None:
    """Add these, and the sums of products of every two late columns, to three moments of a block."""
    for a in range(0, len(columns), 2):
        for b in range(0, a + 1, 2):
            one, other = a * PIECE, b * PIECE
            p00 = p01 = p10 = p11 = q00 = q01 = q10 = q11 = r00 = r01 = r10 = r11 = spread_wide(0.0)
            for n in range(0, size, WIDE):
                b0, b1 = load_wide(columns, other + n), load_wide(columns, other + PIECE + n)
                a0, late0 = load_wide(columns, one + n), load_wide(late, one + n)
                p00, p01 = multiply_add(a0, b0, p00), multiply_add(a0, b1, p01)
                q00, q01 = multiply_add(late0, b0, q00), multiply_add(late0, b1, q01)
                a1, late1 = load_wide(columns, one + PIECE + n), load_wide(late, one + PIECE + n)
                p10, p11 = multiply_add(a1, b0, p10), multiply_add(a1, b1, p11)
                q10, q11 = multiply_add(late1, b0, q10), multiply_add(late1, b1, q11)
                b0, b1 = load_wide(late, other + n), load_wide(late, other + PIECE + n)
                r00, r01 = multiply_add(late0, b0, r00), multiply_add(late0, b1, r01)
                r10, r11 = multiply_add(late1, b0, r10), multiply_add(late1, b1, r11)
            _add_tile(sums[0], a, b, total(p00), total(p01), total(p10), total(p11))
            _add_tile(sums[1], a, b, total(q00), total(q01), total(q10), total(q11))
            _add_tile(sums[2], a, b, total(r00), total(r01), total(r10), total(r11))


@compiled
def _add_tile(sums: Floats, a: int, b: int, s00: float, s01: float, s10: float, s11: float) -> None:
    """Add to two rows and two columns of a matrix."""
    sums[a, b] += s00
    sums[a, b + 1] += s01
    sums[a + 1, b] += s10
    sums[a + 1, b + 1] += s11


@compiled
def _outputs_of(block: int, blocks: int, length: int, every: int, outputs: int) -> tuple[int, int]:
    """Return the first output that lies in a block and the one after its last; the last block takes all that follow."""
    first = -((-block * length) // every)
    return first, (outputs if block == blocks - 1 else min(-((-(block + 1) * length) // every), outputs))


@compiled
def evaluate(pieces: Floats, length: int, every: int, values: Floats) -> None:
    """Fill the values of piecewise cubics at every so-manieth sample.

    Parameters
    ----------
    pieces : (line, block, 4) array, coefficients of 1, u, u^2, u^3 in each block.
    length : samples in a block.
    every : samples between values.
    values : (line, output) array, filled.
    """
    lines, blocks, _ = pieces.shape
    for line in range(lines):
        for block in range(blocks):
            first, last = _outputs_of(block, blocks, length, every, values.shape[1])
            start, step = first * every / length - block, every / length
            p0, p1, p2, p3 = pieces[line, block]
            row = values[line][first:last]
            for n in range(row.size):
                u = start + step * n
                row[n] = p0 + u * (p1 + u * (p2 + u * p3))


@compiled
def evaluate_complex(pieces: Floats, length: int, every: int, values: Floats) -> None:
    """Fill the values of complex piecewise cubics at every so-manieth sample.

    Parameters
    ----------
    pieces : (line, block, 2, 4) array, as for `evaluate`: of the real and the imaginary parts.
    length, every : as there.
    values : (line, 2 output) array, filled: real and imaginary parts in turn.
    """
    lines, blocks, _, _ = pieces.shape
    for line in range(lines):
        for block in range(blocks):
            first, last = _outputs_of(block, blocks, length, every, values.shape[1] // 2)
            start, step = first * every / length - block, every / length
            a0, a1, a2, a3 = pieces[line, block, 0]
            b0, b1, b2, b3 = pieces[line, block, 1]
            row = values[line][2 * first : 2 * last]
            for n in range(row.size // 2):
                u = start + step * n
                row[2 * n] = a0 + u * (a1 + u * (a2 + u * a3))
                row[2 * n + 1] = b0 + u * (b1 + u * (b2 + u * b3))


@compiled
def remodulate(
    pieces: Floats, length: int, phase: Floats, orders: Floats, shaft: Indices, start: int, wave: Floats
) -> None:
    """Add the waveform of amplitudes given as piecewise cubics.

    Parameters
    ----------
    pieces : (order, block, 2, 4) array, as for `evaluate`: of the real and the imaginary parts.
    length : samples in a block.
    phase, orders, shaft : as for `project`, from sample `start` on.
    start : place of the first sample.
    wave : (sample,) array, added to.
    """
    work = workspace(len(phase), ROWS)
    cosine, sine = np.zeros((ROWS, PIECE)), np.zeros((ROWS, PIECE))
    u, sums = np.empty(PIECE), np.empty(PIECE)
    first = 0
    while first < wave.size:
        block = min((start + first) // length, pieces.shape[1] - 1)
        last = min(first + PIECE, wave.size)
        if block < pieces.shape[1] - 1:
            last = min(last, (block + 1) * length - start)
        place, step = (start + first - block * length) / length, 1.0 / length
        for n in range(PIECE):
            u[n] = place + step * n
        sums[:] = 0.0
        begin_piece(work, phase, first, last)
        for k in range(0, orders.size, ROWS):
            fill_steady(work, orders[k : k + ROWS], shaft[k : k + ROWS], phase, first, last, cosine, sine)
            _add_waves(pieces[k : k + ROWS], block, u, cosine, sine, last - first, sums)
        for n in range(last - first):
            wave[first + n] += sums[n]
        first = last


@compiled
def _add_waves(pieces: Floats, block: int, u: Floats, cosine: Floats, sine: Floats, size: int, sums: Floats) -> None:
    """Add the waveforms of some orders in one block, with the place in it of each sample and their phasors."""
    for k in range(len(pieces)):
        row, at = k * PIECE, (k * pieces.shape[1] + block) * 8
        a0, a1, a2, a3 = (
            repeat_wide(pieces, at),
            repeat_wide(pieces, at + 1),
            repeat_wide(pieces, at + 2),
            repeat_wide(pieces, at + 3),
        )
        b0, b1, b2, b3 = (
            repeat_wide(pieces, at + 4),
            repeat_wide(pieces, at + 5),
            repeat_wide(pieces, at + 6),
            repeat_wide(pieces, at + 7),
        )
        for n in range(0, size, WIDE):
            v = load_wide(u, n)
            real = multiply_add(v, multiply_add(v, multiply_add(v, a3, a2), a1), a0)
            imaginary = multiply_add(v, multiply_add(v, multiply_add(v, b3, b2), b1), b0)
            wave = multiply_add(real, load_wide(cosine, row + n), load_wide(sums, n))
            store(sums, n, minus(wave, times(imaginary, load_wide(sine, row + n))))
