"""Envelopes, the band to take them in, and deterministic parts apart from random ones."""
