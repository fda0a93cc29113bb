"""
A Wolfrom set: near-cancelling tooth ratios
===========================================

The two rings of a Wolfrom set have similar ratios to their planets; the small difference gives a large reduction, which
fractions keep exact, while floating-point numbers would lose digits.
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
