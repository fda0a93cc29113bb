"""
Glinsky: an idler
=================

The gear between two others changes the direction of the last one, not its speed.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism, velocity_diagram

gearbox = hums.load_gearbox("glinsky-idler")
kinematics = hums.solve_kinematics(gearbox)
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
draw_mechanism(gearbox, ax=left)
velocity_diagram(kinematics, {"gear 1": 100}, ax=right)

# %%
# Every speed is an exact fraction of the given ones:
for link, rate in kinematics.rates({"gear 1": 100}).items():
    print(f"{link:10} {rate}")
