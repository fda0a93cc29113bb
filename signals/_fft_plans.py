"""Fourier transform of a record, and its memory: scipy and numpy cache tables of sixteen lengths."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from signals._validation import Samples

_KEPT = 16  # lengths of a kind and precision that transforms remember
_LONG = 2**20  # samples from which the memory of the tables is worth the half millisecond


def forget_plans(samples: int) -> None:
    """Evict the tables of a long transform, as large as its record, by short ones of as many lengths as are kept."""
    if samples < _LONG:
        return
    for length in range(1, _KEPT + 1):
        for values in _short(length):
            fft.fft(values) if np.iscomplexobj(values) else fft.rfft(values)
            np.fft.fft(values) if np.iscomplexobj(values) else np.fft.rfft(values)


@lru_cache(maxsize=_KEPT)
def _short(length: int) -> tuple[np.ndarray, ...]:
    """Return zeros of a length in each precision, real and complex."""
    return tuple(np.zeros(length, dtype=dtype) for dtype in "fdFD")


def transform_of(signal: Samples, known: NDArray[np.complexfloating] | None = None) -> NDArray[np.complexfloating]:
    """Return the Fourier transform of a signal without its mean, (n // 2 + 1,) lines, or the known one.

    Raises
    ------
    ValueError
        If the known one has another length.
    """
    if known is not None:
        if np.shape(known) != (signal.size // 2 + 1,):
            raise ValueError(
                f"transform has shape {np.shape(known)}; that of {signal.size} samples has ({signal.size // 2 + 1},) "
                "lines: give scipy.fft.rfft of this very record without its mean, or leave it out."
            )
        return np.asarray(known)
    lines = np.asarray(fft.rfft(without_mean(signal)))
    forget_plans(signal.size)
    return lines


def without_mean(signal: Samples) -> Samples:
    """Return the signal without its mean, subtracted twice to remove the rounding of a large one."""
    centred = signal - signal.mean(dtype=np.float64).astype(signal.dtype)
    centred -= centred.mean(dtype=np.float64).astype(signal.dtype)
    return np.asarray(centred)
