"""
A slipping bearing
==================

The line is one per cent below its kinematic order and varies. `track_slipping_order` estimates the slip jointly with
the amplitude.
"""

import matplotlib.pyplot as plt
import numpy as np

from signals.harmonics import track_slipping_order

per_rev, revolutions, nominal = 64, 200, 9.46
turns = np.arange(per_rev * revolutions) / per_rev
slip = -0.01 + 0.004 * np.sin(2 * np.pi * turns / 150)
angle = 2 * np.pi * turns
line = nominal * 2 * np.pi * np.cumsum(1 + slip) / per_rev
x = np.cos(line) + np.random.default_rng(1).normal(0, 1.0, turns.size)
found = track_slipping_order(
    x,
    phase_rad=angle,
    order=nominal,
    largest_slip=0.02,
    slip_change_per_rev=3e-4,
    bandwidth_orders=0.02,
    samples_per_rev=per_rev,
)
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
at = turns[found.sample_index]
top.plot(at, 100 * found.slip, label="estimated")
top.plot(turns, 100 * slip, "k--", linewidth=0.8, label="true")
top.set(ylabel="slip, %")
top.legend()
bottom.plot(at, np.abs(found.complex_amplitude).T)
bottom.axhline(1, color="k", linestyle="--", linewidth=0.8)
bottom.set(xlabel="revolutions", ylabel="amplitude", ylim=(0, None))
plt.show()
