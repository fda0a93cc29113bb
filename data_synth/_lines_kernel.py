"""The sum of lines whose amplitudes are linear in time, compiled."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled

Array = NDArray[np.float64]

_BLOCK = 256  # samples whose sums stay in the nearest cache


@compiled
def add_series(
    signal: Array, real: Array, imaginary: Array, turns: Array, position: Array, edges: NDArray[np.int64]
) -> None:
    """Add ``Re sum_k Z_k exp(2 pi j k turns)``, k from 1, Z linear from one instant to the next.

    Parameters
    ----------
    signal, turns, position : (n,) array
        `turns` of the first line; `position` of the samples counted in instants.
    real, imaginary : (instant, k) array
        Z at the instants.
    edges : (m + 1,) int array
        Samples from `edges[i]` on, before `edges[i + 1]`, follow instant i.
    """
    cosine, sine, place = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    over, up = np.empty(_BLOCK), np.empty(_BLOCK)
    for instant in range(edges.size - 1):
        for start in range(edges[instant], edges[instant + 1], _BLOCK):
            count = min(_BLOCK, edges[instant + 1] - start)
            for i in range(count):
                # of the angle from the nearest quarter, which then swaps and flips the two
                quarters = np.floor(4.0 * turns[start + i] + 0.5)
                angle = 2.0 * np.pi * (turns[start + i] - 0.25 * quarters)
                c, s = _cosine(angle), _sine(angle)
                halves = np.floor(0.5 * quarters)
                odd = quarters - 2.0 * halves > 0.0
                sign = 1.0 - 2.0 * (halves - 2.0 * np.floor(0.5 * halves))
                cosine[i] = sign * (-s if odd else c)
                sine[i] = sign * (c if odd else s)
                place[i] = position[start + i] - instant
                over[i] = 0.0
                up[i] = 0.0
            for line in range(real.shape[1] - 1, -1, -1):  # Horner's rule
                here, there = real[instant, line], imaginary[instant, line]
                rise, lift = real[instant + 1, line] - here, imaginary[instant + 1, line] - there
                for i in range(count):
                    a = over[i] + (here + rise * place[i])
                    b = up[i] + (there + lift * place[i])
                    over[i] = a * cosine[i] - b * sine[i]
                    up[i] = a * sine[i] + b * cosine[i]
            for i in range(count):
                signal[start + i] += over[i]


@compiled
def _cosine(x: float) -> float:
    """Taylor's series to rounding for angles up to an eighth of a turn; straight code, so it runs in vectors."""
    y = x * x
    tail = 1 / 479001600 + y * (-1 / 87178291200 + y * (1 / 20922789888000))
    return 1.0 + y * (-1 / 2 + y * (1 / 24 + y * (-1 / 720 + y * (1 / 40320 + y * (-1 / 3628800 + y * tail)))))


@compiled
def _sine(x: float) -> float:
    y = x * x
    tail = -1 / 39916800 + y * (1 / 6227020800 + y * (-1 / 1307674368000))
    return x * (1.0 + y * (-1 / 6 + y * (1 / 120 + y * (-1 / 5040 + y * (1 / 362880 + y * tail)))))
