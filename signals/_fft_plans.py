"""Memory of Fourier transforms: scipy caches the tables of the last sixteen lengths, each as large as its record."""

from functools import lru_cache

import numpy as np
from scipy import fft

_KEPT = 16  # lengths of a kind and precision that scipy's transforms remember
_LONG = 2**20  # samples from which the memory of the tables is worth the half millisecond


def forget_plans(samples: int) -> None:
    """Evict the tables of a long transform from scipy's cache, by short transforms of as many lengths as it keeps."""
    if samples < _LONG:
        return
    for length in range(1, _KEPT + 1):
        for values in _short(length):
            fft.fft(values) if np.iscomplexobj(values) else fft.rfft(values)


@lru_cache(maxsize=_KEPT)
def _short(length: int) -> tuple[np.ndarray, ...]:
    """Return zeros of a length in each precision, real and complex."""
    return tuple(np.zeros(length, dtype=dtype) for dtype in "fdFD")
