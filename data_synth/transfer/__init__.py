"""From source to sensor, and from sensor to samples."""
