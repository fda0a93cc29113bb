"""
The maximum-likelihood bandwidth
================================

How narrow may a tracker be? The maximum-likelihood bandwidth depends on how fast the amplitude changes.
"""

import matplotlib.pyplot as plt
import numpy as np

from signals.harmonics import likely_bandwidth, track_orders

rate_hz = 2000
t = np.arange(5 * rate_hz) / rate_hz
phase_rad = 2 * np.pi * 25 * t
x = (2 + np.sin(2 * np.pi * 0.5 * t)) * np.cos(3 * phase_rad) + np.random.default_rng(1).normal(0, 1, t.size)
likely = likely_bandwidth(x, phase_rad=phase_rad, orders=[3], rate_hz=rate_hz, largest_bandwidth_hz=50)
print("maximum likelihood:", likely.round(2), "Hz")

figure, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
for bandwidth in (0.1, float(likely[0]), 30.0):
    tracks = track_orders(x, phase_rad=phase_rad, orders=[3], bandwidth_hz=bandwidth, rate_hz=rate_hz, output_every=20)
    ax.plot(t[tracks.sample_index], np.abs(tracks.complex_amplitude[0]), label=f"{bandwidth:.2g} Hz")
ax.plot(t, 2 + np.sin(2 * np.pi * 0.5 * t), "k--", label="true")
ax.set(xlabel="time, s", ylabel="amplitude")
ax.legend()
plt.show()
