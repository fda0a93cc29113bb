"""Signal processing on arrays: shaft phase, angular resampling, spectra, envelopes, order trackers.

Functions take NumPy arrays and return frozen dataclasses of NumPy arrays. Nothing here knows gearboxes, files or plots.
"""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
