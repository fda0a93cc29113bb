"""Angular resampling: from time to shaft angle and back."""
