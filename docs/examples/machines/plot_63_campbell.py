"""
A Campbell diagram
==================

The equations of motion follow from the drawing; undeclared parameters are first estimates for steel. Mesh orders cross
the natural frequencies at the critical speeds.
"""

import matplotlib.pyplot as plt
import numpy as np

import hums
from data_synth.dynamics import assemble, campbell
from hums.plots import plot_campbell

gearbox = hums.load_gearbox("wijianto-pair")
diagram = campbell(
    lambda speed: assemble(gearbox, motions="plane", speed_rad_s=speed).system, speeds_rad_s=np.linspace(0, 600, 13)
)
figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
plot_campbell(diagram, ax=ax)
plt.show()
