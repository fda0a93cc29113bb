"""A record and its gearbox become an analysis."""
