"""Time integrators: problem, method, output, tolerance and result."""
