"""Envelopes and the choice of their bands; separation of deterministic and random parts."""
