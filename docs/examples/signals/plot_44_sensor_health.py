"""
A clipping sensor
=================

Sensor health is checked before any diagnosis; the trackers treat clipped samples as censored data.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

t = np.arange(20000) / 2000
x = np.clip(np.sin(2 * np.pi * 37 * t + 0.1), -0.8, 0.8)
health = signals.sensor_health(x, rate_hz=2000, units="g")
print(health.status, [fault.kind for fault in health.faults])

figure, ax = plt.subplots(layout="constrained")
ax.plot(t[:200], x[:200])
ax.plot(t[:200][health.clipped[:200]], x[:200][health.clipped[:200]], ".", color="tab:red", label="clipped")
ax.set(xlabel="time, s", ylabel="acceleration, g")
ax.legend()
plt.show()
