"""Versioned benchmarks: families of gearboxes, transfer paths and drives, drawn by a seed, and the records of them."""
