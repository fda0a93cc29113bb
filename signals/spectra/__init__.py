"""Spectra over frequency and order, the lines in them, maps, cyclic spectra, integration."""
