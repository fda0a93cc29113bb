"""
From tachometer pulses to shaft angle
=====================================

Pulses of an accelerating shaft with jitter, some of them missing. Missing pulses are detected and bridged. The error is
largest at the ends, where there are pulses on one side only.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rng = np.random.default_rng(1)
revolutions = np.arange(200.0)
times_s = (-10 + np.sqrt(100 + 2 * revolutions)) / 1.0  # 10 rev/s, accelerating at 1 rev/s per second
pulses = np.delete(times_s, [50, 120, 121]) + rng.normal(0, 2e-6, revolutions.size - 3)
phase = signals.shaft_phase(pulses, pulses_per_rev=1)
print("missing pulses:", phase.repairs.missing)

t = np.linspace(pulses[0], pulses[-1], 500)
figure, (top, bottom) = plt.subplots(2, 1, sharex=True, layout="constrained")
top.plot(t, phase.speed_hz(t), label="from pulses")
top.plot(t, 10 + t, "--", label="true")
top.set(ylabel="speed, rev/s")
top.legend()
bottom.plot(t, 100 * (phase.speed_hz(t) / (10 + t) - 1))
for gap in times_s[[50, 120, 121]]:
    bottom.axvline(gap, color="tab:red", ls=":", lw=1)
bottom.set(xlabel="time, s; dotted: missing pulses", ylabel="speed error, %")
plt.show()
