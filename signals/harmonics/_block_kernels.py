"""From samples to sums over blocks, and from amplitudes at the knots between blocks back to samples.

Block `i` holds the samples from `i length` up to `(i + 1) length`; knots lie at its first sample and at that of the
next. Within a block, u runs from 0 to 1. A sample weighs `1 - u` at the knot before it and `u` at the one after:
hats over two blocks each, which add up to one.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums
from signals.harmonics._phasors import Recipe, fill_rows

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECE = 256  # samples whose phasors are held at a time: they stay in the nearest cache


@compiled_sums
def _add_moments(x: Floats, cosine: Floats, sine: Floats, u: Floats, sums: Floats) -> None:
    """Add the sums of x cos, u x cos, -x sin and -u x sin to `sums`."""
    real, real_late, imaginary, imaginary_late = 0.0, 0.0, 0.0, 0.0
    for n in range(x.size):
        real_part, imaginary_part = x[n] * cosine[n], x[n] * sine[n]
        real += real_part
        real_late += u[n] * real_part
        imaginary += imaginary_part
        imaginary_late += u[n] * imaginary_part
    sums[0] += real
    sums[1] += real_late
    sums[2] -= imaginary
    sums[3] -= imaginary_late


@compiled_sums
def _product_moments(a: Floats, b: Floats, late_b: Floats) -> tuple[float, float]:
    """Return the sums of `a b` and `a late_b`."""
    plain, late = 0.0, 0.0
    for n in range(a.size):
        plain += a[n] * b[n]
        late += a[n] * late_b[n]
    return plain, late


@compiled
def _fill_places(first: int, block: int, length: int, u: Floats) -> None:
    """Fill in the place within the block of each sample from `first` on."""
    start, step = (first - block * length) / length, 1.0 / length
    for n in range(u.size):
        u[n] = start + step * n


@compiled_sums
def project(x: Floats, phase: Floats, recipe: Recipe, row: Indices, length: int, sums: Floats) -> None:
    """Fill the moments of the record against each order, block by block.

    Parameters
    ----------
    x : (channel, sample) array, 0 where missing; the first sample starts a block.
    phase : (shaft, sample) array in rad.
    recipe, row : of the `PhasorPlan` of the orders.
    length : samples in a block.
    sums : (order, block, channel, 4) array, filled: of x cos, u x cos, -x sin, -u x sin.
    """
    cosine, sine = np.empty((recipe[0].size, PIECE)), np.empty((recipe[0].size, PIECE))
    u = np.empty(PIECE)
    sums[:] = 0.0
    for block in range(sums.shape[1]):
        stop = min((block + 1) * length, x.shape[1])
        for first in range(block * length, stop, PIECE):
            size = min(first + PIECE, stop) - first
            fill_rows(recipe, phase, first, first + size, cosine, sine)
            _fill_places(first, block, length, u)
            for k in range(row.size):
                r = row[k]
                for channel in range(x.shape[0]):
                    real, real_late, imaginary, imaginary_late = 0.0, 0.0, 0.0, 0.0
                    for n in range(size):
                        real_part = x[channel, first + n] * cosine[r, n]
                        imaginary_part = x[channel, first + n] * sine[r, n]
                        real += real_part
                        real_late += u[n] * real_part
                        imaginary += imaginary_part
                        imaginary_late += u[n] * imaginary_part
                    sums[k, block, channel, 0] += real
                    sums[k, block, channel, 1] += real_late
                    sums[k, block, channel, 2] -= imaginary
                    sums[k, block, channel, 3] -= imaginary_late


@compiled_sums
def correlate(seen: Floats, phase: Floats, recipe: Recipe, row: Indices, length: int, sums: Floats) -> None:
    """Fill the moments of every two columns of the model, block by block.

    Parameters
    ----------
    seen : (sample,) array, 0 where missing, else 1.
    phase, recipe, row, length : as for `project`.
    sums : (block, 2, 2 order, 2 order) array, filled: of the products of cos and -sin of all orders (all cos first),
        and of u times these.
    """
    cosine, sine = np.empty((recipe[0].size, PIECE)), np.empty((recipe[0].size, PIECE))
    columns, late_columns = np.empty((2 * row.size, PIECE)), np.empty((2 * row.size, PIECE))
    u = np.empty(PIECE)
    sums[:] = 0.0
    for block in range(sums.shape[0]):
        stop = min((block + 1) * length, seen.size)
        for first in range(block * length, stop, PIECE):
            size = min(first + PIECE, stop) - first
            fill_rows(recipe, phase, first, first + size, cosine, sine)
            _fill_places(first, block, length, u)
            for k in range(row.size):
                r = row[k]
                for n in range(size):
                    columns[k, n] = seen[first + n] * cosine[r, n]
                    columns[row.size + k, n] = -seen[first + n] * sine[r, n]
            for a in range(2 * row.size):
                for n in range(size):
                    late_columns[a, n] = u[n] * columns[a, n]
            # Two columns at a time: what is read serves four sums.
            for b in range(0, 2 * row.size, 2):
                for a in range(b, 2 * row.size):
                    one, one_late, other, other_late = 0.0, 0.0, 0.0, 0.0
                    for n in range(size):
                        one += columns[a, n] * columns[b, n]
                        one_late += late_columns[a, n] * columns[b, n]
                        other += columns[a, n] * columns[b + 1, n]
                        other_late += late_columns[a, n] * columns[b + 1, n]
                    sums[block, 0, a, b] += one
                    sums[block, 1, a, b] += one_late
                    sums[block, 0, a, b + 1] += other
                    sums[block, 1, a, b + 1] += other_late
        for a in range(2 * row.size):
            for b in range(a):
                sums[block, :, b, a] = sums[block, :, a, b]


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
    pieces: Floats, length: int, phase: Floats, recipe: Recipe, row: Indices, start: int, wave: Floats
) -> None:
    """Add the waveform of amplitudes given as piecewise cubics.

    Parameters
    ----------
    pieces : (order, block, 2, 4) array, as for `evaluate`: of the real and the imaginary parts.
    length : samples in a block.
    phase, recipe, row : as for `project`, from sample `start` on.
    start : place of the first sample.
    wave : (sample,) array, added to.
    """
    cosine, sine = np.empty((recipe[0].size, PIECE)), np.empty((recipe[0].size, PIECE))
    step = 1.0 / length
    first = 0
    while first < wave.size:
        block = min((start + first) // length, pieces.shape[1] - 1)
        last = min(first + PIECE, wave.size)
        if block < pieces.shape[1] - 1:
            last = min(last, (block + 1) * length - start)
        place = (start + first - block * length) * step
        fill_rows(recipe, phase, first, last, cosine, sine)
        sums = wave[first:last]
        for k in range(row.size):
            c, s = cosine[row[k]], sine[row[k]]
            a0, a1, a2, a3 = pieces[k, block, 0]
            b0, b1, b2, b3 = pieces[k, block, 1]
            for n in range(sums.size):
                u = place + step * n
                real = a0 + u * (a1 + u * (a2 + u * a3))
                imaginary = b0 + u * (b1 + u * (b2 + u * b3))
                sums[n] += real * c[n] - imaginary * s[n]
        first = last
