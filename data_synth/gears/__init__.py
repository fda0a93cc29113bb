"""Gear pairs: geometry, mesh stiffness, transmission error and friction."""
