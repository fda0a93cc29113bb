"""Compiled kernel of the order-domain projection: transforms of windows, interpolated to the orders of lines."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled

Complexes = NDArray[np.complex128]


@compiled
def interpolate(spectra: Complexes, first: NDArray[np.int64], weights: Complexes, values: Complexes) -> None:
    """Set values (row, k) to ``sum_j weights[k, j] spectra[row, first[k] + j]``.

    `spectra` (row, cell) are transforms of real numbers: at -n lies the conjugate of what lies at n.
    """
    for row in range(spectra.shape[0]):
        for k in range(first.size):
            total = 0j
            for j in range(weights.shape[1]):
                number = first[k] + j
                cell = spectra[row, number] if number >= 0 else spectra[row, -number].conjugate()
                total += weights[k, j] * cell
            values[row, k] = total
