"""
A ratio of teeth that nearly cancel
===================================

In a Wolfrom set the ring that turns has nearly the ratio of the ring that is fixed; the small difference makes a large
reduction, which floating point would blur and fractions do not.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism

gearbox = hums.load_gearbox("wolfrom")
kinematics = hums.solve_kinematics(gearbox)
ratio = 1 / kinematics.rates({"sun": 1})["output ring"]
print(f"sun over output ring: {ratio} = {float(ratio):.1f}")

figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
draw_mechanism(gearbox, ax=ax)
plt.show()
