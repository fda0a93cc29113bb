"""Time integrators: a problem, a method, what to read and how exactly, and what came of it."""
