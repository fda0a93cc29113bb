"""What is taken over revolutions: synchronous averages, residual signals, averages of planets."""
