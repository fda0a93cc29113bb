"""
Nelson's bevel planet
=====================

Sun, ring and carrier on one axis, with a bevel planet at 60 degrees: example 1 of Penaud and Alazard (2010), after
Nelson and Cipra (2005). The carrier rotates at 0.625 of the ring speed, the planet at 15/16 relative to the carrier.
"""

from fractions import Fraction

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism, velocity_diagram

gearbox = hums.load_gearbox("nelson-bevel-planet")
kinematics = hums.solve_kinematics(gearbox)
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
draw_mechanism(gearbox, ax=left)
velocity_diagram(kinematics, {"ring": 1}, ax=right)

# %%
# As published by Nelson and Cipra, the ring rotates 1.6 times as fast as the carrier.
print("carrier over ring:", kinematics.rates({"ring": Fraction(1)})["carrier"])
print("planet relative to carrier:", kinematics.relative_speed("planet", seen_from="carrier"))
