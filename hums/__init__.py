"""Gearboxes, accelerometer records and findings: labelled data above the arrays of `signals`."""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
