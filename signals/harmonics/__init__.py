"""Amplitude and phase of shaft harmonics, sample by sample, each with its uncertainty."""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
