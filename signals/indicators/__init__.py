"""Condition indicators, each a function of the signal for which it is defined, with its source.

The raw signal is an array; averages and the signals derived from them have their own types, so that an indicator
refuses a signal for which it is not defined. `INDICATORS` lists all indicators. NA4 and NB4 are normalised by the mean
variance of previous records, a `VarianceHistory`, which is immutable: an update returns a new one.

Examples
--------
The examples of all indicators use these signals, over one revolution of a gear with 20 teeth:

>>> import numpy as np
>>> from signals import SynchronousAverage, difference_signal, mesh_band, regular_signal, residual_signal
>>> angle = 2 * np.pi * np.arange(360) / 360
>>> def average_of(x):
...     return SynchronousAverage(values=x, standard_error=0 * x, revolutions=1)
>>> average = average_of(np.cos(20 * angle) + 0.1 * np.cos(7 * angle))  # the mesh, and a tone between its harmonics
>>> residual = residual_signal(average, teeth=20, harmonics=1, shaft_orders=[1, 2])
>>> difference = difference_signal(average, teeth=20, harmonics=1, shaft_orders=[1, 2])
>>> modulated = average_of((1 + 0.2 * np.cos(angle)) * np.cos(20 * angle))
>>> band = mesh_band(modulated, mesh_order=20, sidebands=8)
>>> phase_modulated = average_of(np.cos(20 * angle + 0.1 * np.sin(angle)))
>>> phase_modulated_band = mesh_band(phase_modulated, mesh_order=20, sidebands=8)
"""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)
