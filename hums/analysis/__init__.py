"""Analyses: lines, indicators, tracks and verdicts of a record."""
