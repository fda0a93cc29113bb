"""Compiled kernels of lines: spreading on a grid, interpolation to orders, Cholesky by bands, responses to forces."""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled

Array = NDArray[np.float64]
T = TypeVar("T", np.float64, np.complex128)


@compiled
def spread(values: NDArray[T], at: Array, width: int, table: Array, grid: NDArray[T]) -> None:
    """Add values (channel, n), real or complex, at places (n,), in cells, to a grid (channel, cell).

    `table` has the kernel from its middle to its edge; it is `width` cells wide.
    """
    last = table.size - 1
    for n in range(at.size):
        first = round(at[n]) - width // 2
        for cell in range(first, first + width):
            place = min(abs(at[n] - cell) / (width / 2), 1.0) * last
            point = min(int(place), last - 1)
            share = table[point] + (place - point) * (table[point + 1] - table[point])
            for channel in range(values.shape[0]):
                grid[channel, cell] += share * values[channel, n]


@compiled
def gather(grid: Array, at: Array, weights: Array, width: int, table: Array, values: Array) -> None:
    """Add a grid (channel, cell), interpolated at places (n,) in cells, times weights (n,), to values (channel, n).

    Cells are counted round the grid, so places may be below zero. `table` is that of `spread`.
    """
    last, cells = table.size - 1, grid.shape[1]
    for n in range(at.size):
        first = round(at[n]) - width // 2
        for cell in range(first, first + width):
            place = min(abs(at[n] - cell) / (width / 2), 1.0) * last
            point = min(int(place), last - 1)
            share = weights[n] * (table[point] + (place - point) * (table[point + 1] - table[point]))
            for channel in range(values.shape[0]):
                values[channel, n] += share * grid[channel, cell % cells]


@compiled
def interpolate(
    spectra: NDArray[np.complex64],
    at: Array,
    turns: float,
    width: int,
    table: Array,
    values: NDArray[np.complex128],
) -> None:
    """Set values (row, degree, k) to the spectra between their lines at places (k,), times ``exp(2 pi j turns at)``.

    The kernel of degree d is row d of `table`, from its middle to its edge: odd for odd degrees, `width` lines wide.
    `spectra` (row, line) are transforms of real numbers: at -n lies the conjugate of what lies at n.
    """
    degrees, last = values.shape[1], table.shape[1] - 1
    step = complex(math.cos(2 * math.pi * turns), math.sin(2 * math.pi * turns))
    for k in range(at.size):
        first = round(at[k]) - width // 2
        for row in range(values.shape[0]):
            for degree in range(degrees):
                values[row, degree, k] = 0
        turn = complex(math.cos(2 * math.pi * turns * first), math.sin(2 * math.pi * turns * first))
        for number in range(first, first + width):
            place = min(abs(at[k] - number) / (width / 2), 1.0) * last
            point = min(int(place), last - 1)
            beyond = place - point
            for row in range(values.shape[0]):
                line = spectra[row, number] if number >= 0 else spectra[row, -number].conjugate()
                turned = line * turn
                for degree in range(degrees):
                    share = table[degree, point] + beyond * (table[degree, point + 1] - table[degree, point])
                    if degree % 2 and at[k] < number:
                        share = -share
                    values[row, degree, k] += share * turned
            turn *= step


@compiled
def factorise(lower: NDArray[np.complex128]) -> None:
    """Replace the lower diagonals (width, n) of a positive definite matrix by those of its Cholesky factor.

    LAPACK's `zpbtrf` makes a rank-one update for each column, which OpenBLAS hands to all its threads: waiting for
    them took forty times as long as the sums. A matrix that is not positive definite has a factor that is not finite.
    """
    width, size = lower.shape
    for column in range(size):
        lower[0, column] = math.sqrt(lower[0, column].real)
        below = min(width, size - column)
        for i in range(1, below):
            lower[i, column] /= lower[0, column].real
        for j in range(1, below):
            share = lower[j, column].conjugate()
            for i in range(j, below):
                lower[i - j, column + j] -= lower[i, column] * share


@compiled
def add_responses(
    transfer: NDArray[np.complex64], at: Array, forces: NDArray[np.complex64], total: NDArray[np.complex128]
) -> None:
    """Add the response to forces (line, instant) to (channel, line, instant).

    `transfer` (channel, f) is linear between frequencies, and `at` (line, instant) are places among them.
    """
    last = transfer.shape[1] - 2
    for channel in range(total.shape[0]):
        for line in range(at.shape[0]):
            for n in range(at.shape[1]):
                number = min(int(at[line, n]), last)
                share = np.float32(min(at[line, n] - number, 1.0))
                low = transfer[channel, number]
                total[channel, line, n] += (low + share * (transfer[channel, number + 1] - low)) * forces[line, n]
