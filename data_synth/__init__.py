"""Synthetic vibration: a declared scene becomes a record with its truth."""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
