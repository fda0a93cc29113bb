"""Gears by themselves: geometry, stiffness, transmission error and friction of the mesh."""
