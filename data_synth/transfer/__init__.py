"""Transfer from source to sensor, and acquisition from sensor to samples."""
