"""
From acceleration to velocity
=============================

Integration over a band, with the RMS velocity used by vibration standards.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 5000
t = np.arange(20_000) / rate_hz
x = np.cos(2 * np.pi * 50 * t) + 0.1 * np.random.default_rng(1).standard_normal(t.size)
found = signals.velocity(x, rate_hz=rate_hz, units="m s-2")
print(f"{found.rms:.2f} mm/s RMS; the tone alone: {1e3 / (2 * np.pi * 50) / np.sqrt(2):.2f}")

figure, (top, bottom) = plt.subplots(2, 1, sharex=True, layout="constrained")
top.plot(t[5000:5500], x[5000:5500])
top.set(ylabel="acceleration, m/s²")
bottom.plot(t[5000:5500], found.values[5000:5500])
bottom.set(xlabel="time, s", ylabel="velocity, mm/s")
plt.show()
