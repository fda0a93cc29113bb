"""
Tracking two close orders
=========================

Orders 10 and 10.3 beat. Joint estimation gives the amplitude of each, with its 95 % confidence interval.
"""

import matplotlib.pyplot as plt
import numpy as np

from signals.harmonics import track_orders

rate_hz = 4000
t = np.arange(6 * rate_hz) / rate_hz
phase_rad = 2 * np.pi * (15 * t + t**2)
truth = 1 + 0.3 * np.sin(2 * np.pi * 0.3 * t)
x = truth * np.cos(10 * phase_rad) + 0.7 * np.cos(10.3 * phase_rad + 1)
x += np.random.default_rng(1).normal(0, 0.5, t.size)
tracks = track_orders(x, phase_rad=phase_rad, orders=[10, 10.3], bandwidth_hz=1.5, rate_hz=rate_hz, output_every=40)

figure, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
at = t[tracks.sample_index]
for order, amplitude, half in zip(
    tracks.orders, np.abs(tracks.complex_amplitude), tracks.half_width(0.95), strict=True
):
    (line,) = ax.plot(at, amplitude, label=f"order {order:g}")
    ax.fill_between(at, amplitude - half, amplitude + half, alpha=0.2, color=line.get_color())
ax.plot(t, truth, "k--", linewidth=0.8, label="true")
ax.axhline(0.7, color="k", linestyle="--", linewidth=0.8)
ax.set(xlabel="time, s", ylabel="amplitude, with 95 % confidence intervals")
ax.legend()
plt.show()
