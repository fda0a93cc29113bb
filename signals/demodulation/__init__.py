"""Envelopes and their bands, and the separation of deterministic from random parts."""
