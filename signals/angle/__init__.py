"""Synchronous averages, residual and difference signals, averages of planets."""
