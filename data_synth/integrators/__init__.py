"""Time integration of the equations of motion: problem, method, output, tolerance and result."""
