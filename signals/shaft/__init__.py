"""Shaft angle and speed: from a tachometer's waveform, or from vibration alone."""
