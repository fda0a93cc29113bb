"""
A Campbell diagram
==================

The drawing becomes equations of motion; what is not declared is a first guess in steel. Orders of the mesh cross the
natural frequencies at the critical speeds.
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
