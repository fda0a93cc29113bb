"""Declared scenes: one validated model for each table."""
