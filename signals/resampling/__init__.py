"""Angular resampling: from time to shaft angle and back, of whole records or in blocks."""
