"""Figures: functions that draw on given matplotlib Axes, and functions that write a figure as SVG text or a file."""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
