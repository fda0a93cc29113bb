"""Which motions are simulated, what takes the place of the rest, and how that is chosen."""
