"""
Cyclic frequencies without band selection
=========================================

The enhanced envelope spectrum, the spectral coherence averaged over all carrier frequencies, requires no band selection
(Antoni, Xin and Hamzaoui 2017).
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 2000
t = np.arange(40_000) / rate_hz
x = (1 + np.cos(2 * np.pi * 20 * t)) * np.random.default_rng(1).standard_normal(t.size)
correlation = signals.spectral_correlation(x, rate_hz=rate_hz, max_cyclic_hz=100)
spectrum = signals.enhanced_envelope_spectrum(correlation)

figure, ax = plt.subplots(layout="constrained")
ax.plot(spectrum.cyclic_hz[5:], spectrum.value[5:])
ax.set(xlabel="cyclic frequency, Hz", ylabel="mean coherence")
plt.show()
