"""Compiled sum of harmonics whose amplitudes are linear in time, with strict rounding."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_exactly

Array = NDArray[np.float64]

_BLOCK = 256  # samples whose sums stay in the first-level cache


@compiled_exactly
def add_series(
    signal: Array, real: Array, imaginary: Array, turns: Array, position: Array, edges: NDArray[np.int64]
) -> None:
    """Add ``Re sum_k Z_k exp(2 pi j k turns)``, k from 1, Z linear from one instant to the next.

    Parameters
    ----------
    signal, turns, position : (n,) array
        `turns` of the first harmonic; `position` of the samples in units of the instants' spacing.
    real, imaginary : (instant, k) array
        Z at the instants.
    edges : (m + 1,) int array
        Samples from `edges[i]` up to, but not including, `edges[i + 1]` are between instants i and i + 1.
    """
    cosine, sine, fraction = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    sum_real, sum_imaginary = np.empty(_BLOCK), np.empty(_BLOCK)
    for instant in range(edges.size - 1):
        for start in range(edges[instant], edges[instant + 1], _BLOCK):
            count = min(_BLOCK, edges[instant + 1] - start)
            for i in range(count):
                # evaluated from the nearest quarter cycle, which then swaps and negates cosine and sine
                quarters = np.floor(4.0 * turns[start + i] + 0.5)
                angle = 2.0 * np.pi * (turns[start + i] - 0.25 * quarters)
                c, s = _cosine(angle), _sine(angle)
                halves = np.floor(0.5 * quarters)
                odd = quarters - 2.0 * halves > 0.0
                sign = 1.0 - 2.0 * (halves - 2.0 * np.floor(0.5 * halves))
                cosine[i] = sign * (-s if odd else c)
                sine[i] = sign * (c if odd else s)
                fraction[i] = position[start + i] - instant
                sum_real[i] = 0.0
                sum_imaginary[i] = 0.0
            for line in range(real.shape[1] - 1, -1, -1):  # Horner's rule
                value_real, value_imaginary = real[instant, line], imaginary[instant, line]
                slope_real, slope_imaginary = (
                    real[instant + 1, line] - value_real,
                    imaginary[instant + 1, line] - value_imaginary,
                )
                for i in range(count):
                    a = sum_real[i] + (value_real + slope_real * fraction[i])
                    b = sum_imaginary[i] + (value_imaginary + slope_imaginary * fraction[i])
                    sum_real[i] = a * cosine[i] - b * sine[i]
                    sum_imaginary[i] = a * sine[i] + b * cosine[i]
            for i in range(count):
                signal[start + i] += sum_real[i]


@compiled_exactly
def _cosine(x: float) -> float:
    """Return the cosine by its Taylor series, to rounding up to an eighth of a cycle, without branches."""
    y = x * x
    tail = 1 / 479001600 + y * (-1 / 87178291200 + y * (1 / 20922789888000))
    return 1.0 + y * (-1 / 2 + y * (1 / 24 + y * (-1 / 720 + y * (1 / 40320 + y * (-1 / 3628800 + y * tail)))))


@compiled_exactly
def _sine(x: float) -> float:
    """Return the sine by its Taylor series, likewise."""
    y = x * x
    tail = -1 / 39916800 + y * (1 / 6227020800 + y * (-1 / 1307674368000))
    return x * (1.0 + y * (-1 / 6 + y * (1 / 120 + y * (-1 / 5040 + y * (1 / 362880 + y * tail)))))
