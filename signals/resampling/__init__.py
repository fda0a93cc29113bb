"""Angular resampling: from time to the angle of a shaft and back, whole or in blocks."""
