"""
Models of mesh stiffness
========================

Rectangular, trapezoidal and Fourier-series stiffness over two mesh cycles.
"""

import matplotlib.pyplot as plt
import numpy as np

from data_synth.dynamics import Fourier, Rectangular
from hums.plots import plot_mesh_stiffness

figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
shapes = {
    "rectangular": Rectangular(low=0.76e6, high=1.36e6, duty=0.4),
    "two harmonics": Fourier(mean=1e6, harmonics=np.array([1.5e5, 0.5e5j])),
}
for ax, (name, stiffness) in zip(axes, shapes.items(), strict=True):
    plot_mesh_stiffness(stiffness, ax=ax, cycles=(0, 2))
    ax.set_title(name)
plt.show()
