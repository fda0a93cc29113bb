"""Attacks on the packages: odd calls, damaged files, killed writers."""
