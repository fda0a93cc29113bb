"""
The kurtogram and the selected band
===================================

Impulses excite a resonance; the selected band is the one in which the signal is most impulsive (Antoni 2007).
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 20_000
t = np.arange(4 * rate_hz) / rate_hz
ring = np.exp(-1500 * (t % 0.02)) * np.sin(2 * np.pi * 3000 * (t % 0.02))  # 50 impulses per second
x = ring + 0.1 * np.random.default_rng(1).standard_normal(t.size)

gram = signals.fast_kurtogram(x, rate_hz=rate_hz, levels=5)
band = signals.choose_band(x, rate_hz=rate_hz)
print(f"{band.low_hz:.0f} to {band.high_hz:.0f} Hz: {band.why}")

figure, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
scale = plt.cm.ScalarMappable(plt.Normalize(0, gram.kurtosis.max()), "viridis")
widths_hz = gram.high_hz - gram.low_hz
levels, row = np.unique(gram.level, return_inverse=True)
ax.barh(row, widths_hz, left=gram.low_hz, height=1, color=scale.to_rgba(gram.kurtosis), edgecolor="white")
ax.axvspan(band.low_hz, band.high_hz, fill=False, edgecolor="tab:red", lw=2, label="selected band")
ax.set(xlabel="frequency, Hz", ylabel="bandwidth, Hz", xlim=(0, rate_hz / 2), ylim=(levels.size - 0.5, -0.5))
ax.set_yticks(range(levels.size), [f"{rate_hz / 2 / 2**level:,.0f}" for level in levels])
ax.legend(loc="lower right")
figure.colorbar(scale, ax=ax, label="kurtosis of the complex envelope")
plt.show()
