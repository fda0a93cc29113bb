"""
Separate gear tones from bearing impulses
=========================================

Gear tones can be predicted from past samples, bearing impulses cannot. The random part retains them.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

t = np.arange(8000) / 8000
x = np.sin(2 * np.pi * 230 * t) + 0.6 * np.sin(2 * np.pi * 460 * t)
x[500::1000] += 1.5  # impulses
x += np.random.default_rng(1).normal(0, 0.05, t.size)
parts = signals.linear_prediction(x, order=60)

figure, axes = plt.subplots(3, 1, figsize=(8, 6), sharex=True, layout="constrained")
for ax, values, name in zip(
    axes, (x, parts.deterministic, parts.random), ("record", "predicted", "random"), strict=True
):
    ax.plot(t, values, linewidth=0.6)
    ax.set(ylabel=name)
axes[-1].set(xlabel="time, s")
plt.show()
