"""Spectra over frequency and order: lines, maps, cyclic spectra, integration."""
