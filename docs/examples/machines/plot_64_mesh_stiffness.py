"""
Models of mesh stiffness
========================

Rectangular, trapezoidal and Fourier-series stiffness over two mesh cycles.
"""

import matplotlib.pyplot as plt
import numpy as np

from data_synth.dynamics import Fourier, Rectangular

figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
shapes = {
    "rectangular": Rectangular(low=0.76e6, high=1.36e6, duty=0.4),
    "two harmonics": Fourier(mean=1e6, harmonics=np.array([1.5e5, 0.5e5j])),
}
phase = np.linspace(0, 2, 2001)
for ax, (name, stiffness) in zip(axes, shapes.items(), strict=True):
    ax.plot(phase, stiffness(phase) / 1e6)
    ax.axhline(stiffness.mean / 1e6, color="0.6", linestyle="--")
    ax.set(title=name, xlabel="mesh phase, cycles")
axes[0].set(ylabel="mesh stiffness, N/µm", ylim=(0, None))
plt.show()
