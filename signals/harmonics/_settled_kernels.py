"""The filter whose gains no longer change: each amplitude takes a fixed share of what all of them leave of a sample."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums
from signals.harmonics._phasors import Recipe, fill_rows

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECE = 128  # samples whose phasors and amplitudes are held at a time: they stay in the nearest cache


@compiled_sums
def filter_on(
    x: Floats,
    phase: Floats,
    recipe: Recipe,
    row: Indices,
    gains: Floats,
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
    x : (sample,) array.
    phase : (shaft, sample) array in rad.
    recipe, row : of the `PhasorPlan` of the orders.
    gains : (pole, width) array, shares of the innovation that levels and differences take, 0 beyond the orders.
    real, imaginary : (pole, width) arrays, predictions for the first sample on entry, for the one after the last on
        return.
    innovations : (sample,) array, filled.
    skip, every : samples before the first output, and from one output to the next.
    output : number of the first output.
    amplitude : (order, 2 output) array, filled in from there: real and imaginary parts in turn.
    """
    poles, width = gains.shape
    cosine, sine = np.empty((recipe[0].size, PIECE)), np.empty((recipe[0].size, PIECE))
    turned_cosine, turned_sine = np.zeros((PIECE, width)), np.zeros((PIECE, width))
    real_levels, imaginary_levels = np.empty((PIECE, width)), np.empty((PIECE, width))
    for first in range(0, x.size, PIECE):
        last = min(first + PIECE, x.size)
        fill_rows(recipe, phase, first, last, cosine, sine)
        for k in range(row.size):
            r = row[k]
            for n in range(last - first):
                turned_cosine[n, k] = cosine[r, n]
                turned_sine[n, k] = -sine[r, n]
        for n in range(last - first):
            told = 0.0
            for k in range(width):
                told += real[0, k] * turned_cosine[n, k] + imaginary[0, k] * turned_sine[n, k]
            rest = x[first + n] - told
            innovations[first + n] = rest
            for k in range(width):
                real[0, k] += rest * gains[0, k] * turned_cosine[n, k]
                imaginary[0, k] += rest * gains[0, k] * turned_sine[n, k]
                real_levels[n, k] = real[0, k]
                imaginary_levels[n, k] = imaginary[0, k]
            for pole in range(1, poles):
                for k in range(width):
                    real[pole, k] += rest * gains[pole, k] * turned_cosine[n, k]
                    imaginary[pole, k] += rest * gains[pole, k] * turned_sine[n, k]
            for pole in range(poles - 2, -1, -1):
                for k in range(width):
                    real[pole, k] += real[pole + 1, k]
                    imaginary[pole, k] += imaginary[pole + 1, k]
        begin = skip if skip >= first else skip + (first - skip + every - 1) // every * every
        count = 0 if begin >= last else (last - 1 - begin) // every + 1
        for k in range(row.size):
            values = amplitude[k][2 * output : 2 * (output + count)]
            for i in range(count):
                n = begin - first + every * i
                values[2 * i] = real_levels[n, k]
                values[2 * i + 1] = imaginary_levels[n, k]
        output += count
