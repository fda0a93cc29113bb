"""A gearbox as equations of motion, with their modes and their stability."""
