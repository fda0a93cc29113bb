"""From a tachometer's waveform, or from vibration alone, to the angle of a shaft."""
