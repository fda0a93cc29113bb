"""The compiled inner loop of angular resampling."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Array = NDArray[np.float64]


@compiled
def convolve_at(x: Array, positions: Array, cutoffs: Array, table: Array, half_width: int, per_unit: int) -> Array:
    """Windowed-sinc interpolation of `x` at fractional `positions`, each with its own cut-off.

    ``y[m] = sum_n x[n] a g(a (p_m - n))`` with `a` the cut-off over half the sampling rate and `g` the
    windowed sinc in `table`, `per_unit` entries a zero crossing, read by linear interpolation. Beyond its
    ends the record is mirrored.
    """
    out = np.empty(positions.size)
    last = x.size - 1
    for m in range(positions.size):
        scale = cutoffs[m]
        reach = half_width / scale
        start = int(np.ceil(positions[m] - reach))
        stop = int(np.floor(positions[m] + reach))
        total = 0.0
        weights = 0.0
        for n in range(start, stop + 1):
            u = abs(positions[m] - n) * scale * per_unit
            cell = int(u)
            part = u - cell
            weight = table[cell] + part * (table[cell + 1] - table[cell])
            i = n
            if i < 0 or i > last:
                i = abs(i) % (2 * last)
                i = min(i, 2 * last - i)
            total += weight * x[i]
            weights += weight
        out[m] = total / weights
    return out
