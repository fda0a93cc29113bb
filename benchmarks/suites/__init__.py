"""Suites for asv: how long the doors of the packages take, from one commit to the next."""
