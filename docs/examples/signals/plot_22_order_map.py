"""
Order map of a run-up
=====================

Gearbox lines are vertical in the order map; a resonance is a hyperbola.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lfilter

import signals

rate_hz = 8000
t = np.arange(8 * rate_hz) / rate_hz
turns = 10 * t + 1.25 * t**2  # 10 to 30 rev/s
x = np.cos(2 * np.pi * 23 * turns) + 0.3 * np.cos(2 * np.pi * 8 * turns)
pole = 0.99 * np.exp(2j * np.pi * 600 / rate_hz)  # a mode at 600 Hz, excited by noise
noise = np.random.default_rng(1).normal(0, 0.05, t.size)
x += lfilter([1.0], [1, -2 * pole.real, abs(pole) ** 2], noise)
phase = signals.ShaftPhase(times_s=t[::80], revolutions=turns[::80])
angular = signals.angular_resample(x, rate_hz=rate_hz, phase=phase, samples_per_rev=128)
found = signals.map_orders(angular, revolutions=4, max_order=50, phase=phase)

figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
image = ax.pcolormesh(found.order, found.speed_hz, 20 * np.log10(found.value + 1e-4), vmin=-50, shading="nearest")
ax.set(xlabel="order", ylabel="speed, rev/s")
figure.colorbar(image, label="amplitude, dB")
plt.show()
