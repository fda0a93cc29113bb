"""Compiled kernels of the order-domain projection: samples spread on a grid, and transforms interpolated to orders."""

import math

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled

Array = NDArray[np.float64]


@compiled
def spread(values: Array, at: Array, width: int, table: Array, grid: Array) -> None:
    """Add values (channel, n) at places (n,), in cells, to a grid (channel, cell).

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
