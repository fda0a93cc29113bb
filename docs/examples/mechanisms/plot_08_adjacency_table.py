"""
A gearbox from an adjacency table
=================================

The notation of Penaud, Alazard and Amiez: teeth of each pair in a square matrix, with the angle of bevel gears as
the phase of a complex number, and a table of levels.
"""

import matplotlib.pyplot as plt
import numpy as np

import hums
from hums.plots import mechanism_graph

teeth = np.array([[0, 0, 0], [0, 0, 20], [0, 40, 0]])
levels = [[0, 1, 2], [1, 0, 0], [2, 0, 0]]
gearbox = hums.from_adjacency_table(teeth, levels, frame=0, names=["frame", "pinion", "wheel"])
kinematics = hums.solve_kinematics(gearbox)
print(kinematics.rates({"pinion": 1})["wheel"])

figure, ax = plt.subplots(layout="constrained")
mechanism_graph(kinematics, ax=ax)
plt.show()
