"""
Speed without a tachometer
==========================

The orders of the gearbox are known, the speed is not: it is estimated jointly from all orders.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 1000
t = np.arange(20 * rate_hz) / rate_hz
speed_hz = 20 + 2 * np.sin(2 * np.pi * 0.05 * t)
turns = np.cumsum(speed_hz) / rate_hz
x = np.sin(2 * np.pi * 3 * turns) + np.sin(2 * np.pi * 7 * turns) + np.random.default_rng(1).standard_normal(t.size)
found = signals.estimate_speed(x, rate_hz=rate_hz, orders=[3, 7], speed_range_hz=(10, 30), max_acceleration_hz_s=2)
print(found.status)

figure, ax = plt.subplots(layout="constrained")
ax.plot(found.times_s, found.speed_hz, ".", label="estimated")
ax.plot(t, speed_hz, label="true")
ax.set(xlabel="time, s", ylabel="speed, rev/s")
ax.legend()
plt.show()
