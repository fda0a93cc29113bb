"""Fourier transforms of records and the memory of their tables; window functions; the median of a spectrum."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from signals._validation import Samples, brief

_KEPT = 16  # lengths of a kind and precision that transforms remember


def forget_plans(samples: int) -> None:
    """Evict the cached tables of a long transform, as large as the record, by filling the caches with short ones."""
    long = 2**20  # samples; evicting takes half a millisecond
    if samples < long:
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
    """Return the Fourier transform of a signal without its mean, (n // 2 + 1,) lines, or the one given, if it fits."""
    if known is not None:
        if np.shape(known) != (signal.size // 2 + 1,):
            raise ValueError(
                f"transform has shape {np.shape(known)}; that of {signal.size} samples has ({signal.size // 2 + 1},) "
                "lines: give scipy.fft.rfft of this record without its mean, or leave it out."
            )
        return np.asarray(known)
    lines = np.asarray(fft.rfft(without_mean(signal)))
    forget_plans(signal.size)
    return lines


def without_mean(signal: Samples) -> Samples:
    """Return the signal without its mean, subtracted twice to remove the rounding error of a large mean."""
    centred = signal - signal.mean(dtype=np.float64).astype(signal.dtype)
    centred -= centred.mean(dtype=np.float64).astype(signal.dtype)
    return np.asarray(centred)


Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Window:
    """A window's weights (n,) and its figures of merit (Harris 1978)."""

    name: str
    weights: Array

    @property
    def noise_bandwidth_bins(self) -> float:
        """Equivalent noise bandwidth in bins, ``n sum(w^2) / sum(w)^2``."""
        return float(self.weights.size * np.sum(self.weights**2) / self.weights.sum() ** 2)

    @property
    def width_bins(self) -> float:
        """Full -3 dB width of the main lobe in bins."""
        return _width(self.name)

    @property
    def spread(self) -> float:
        """Second moment of the squared window about its middle, over its length squared (dimensionless)."""
        count = self.weights.size
        position = (np.arange(count) - (count - 1) / 2) / count
        return float(np.sum(position**2 * self.weights**2) / np.sum(self.weights**2))

    def overlap_correlation(self, hop: int) -> Array:
        """Return the normalised autocorrelation of the window at 1, 2, ... hops, while segments overlap."""
        weights = self.weights
        shifts = range(hop, weights.size, hop)
        return np.array([weights[shift:] @ weights[:-shift] for shift in shifts]) / (weights @ weights)


def window_of(name: str, count: int) -> Window:
    """Return a periodic window of `scipy.signal`, which raises ValueError for an unknown name."""
    if name == "hann":  # the default, without importing scipy.signal
        return Window(name=name, weights=0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, count + 1)[:-1]))
    from scipy.signal import get_window  # noqa: PLC0415

    try:
        weights = np.asarray(get_window(name, count), dtype=np.float64)
    except ValueError:
        raise ValueError(
            f"window={brief(name)} is unknown; give one of scipy.signal without parameters, such as hann or flattop."
        ) from None
    return Window(name=name, weights=weights)


@lru_cache(maxsize=16)
def _width(name: str) -> float:
    """Full -3 dB width of a window's main lobe in bins, from its zero-padded transform."""
    length, fine = 512, 64
    lobe = np.abs(np.fft.rfft(window_of(name, length).weights, length * fine))
    half_power = lobe[0] / np.sqrt(2)
    below = int(np.argmax(lobe < half_power))
    part = (lobe[below - 1] - half_power) / (lobe[below - 1] - lobe[below])
    return float(2 * (below - 1 + part) / fine)


def median(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the median of finite values along the last axis, as `numpy.median` does in eight times the time."""
    half = values.shape[-1] // 2
    parted = np.partition(values, half, axis=-1)
    above = parted[..., half]
    return np.asarray(above if values.shape[-1] % 2 else (parted[..., :half].max(axis=-1) + above) / 2)
