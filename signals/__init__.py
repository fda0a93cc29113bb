"""Signal processing on arrays: shaft phase, angular resampling, spectra, envelopes, order trackers.

NumPy in, frozen dataclasses of NumPy out. Nothing here knows of gearboxes, files or plots.
"""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
