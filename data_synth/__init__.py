"""Synthetic vibration: simulate a declared scene, and return its record with the ground truth."""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
