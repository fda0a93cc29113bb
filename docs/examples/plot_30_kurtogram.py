"""
The kurtogram, and the band it gives
====================================

Impulses ring in a resonance; their band is the one in which the signal is most impulsive (Antoni 2007).
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 20_000
t = np.arange(4 * rate_hz) / rate_hz
ring = np.exp(-1500 * (t % 0.02)) * np.sin(2 * np.pi * 3000 * (t % 0.02))  # 50 impulses a second
x = ring + 0.1 * np.random.default_rng(1).standard_normal(t.size)

gram = signals.fast_kurtogram(x, rate_hz=rate_hz, levels=5)
band = signals.choose_band(x, rate_hz=rate_hz)
print(f"{band.low_hz:.0f} to {band.high_hz:.0f} Hz: {band.why}")

figure, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
colours = plt.get_cmap("viridis")(gram.kurtosis / gram.kurtosis.max())
levels = np.unique(gram.level)
row = np.searchsorted(levels, gram.level)
ax.barh(row, gram.high_hz - gram.low_hz, left=gram.low_hz, height=1, color=colours, edgecolor="white")
ax.set(xlabel="frequency, Hz", ylabel="level")
ax.set_yticks(range(levels.size), [f"{level:.1f}" for level in levels])
plt.show()
