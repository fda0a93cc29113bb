"""
Glinsky: a parallel pair
========================

Two gears on parallel axes, after Glinsky, Kinematics of Rotational Systems; the tooth numbers are ours. The speeds are
inversely proportional to the tooth numbers, and the directions are opposite.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism, velocity_diagram

gearbox = hums.load_gearbox("glinsky-parallel-pair")
kinematics = hums.solve_kinematics(gearbox)
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
draw_mechanism(gearbox, ax=left)
velocity_diagram(kinematics, {"gear 1": 100}, ax=right)

# %%
# Every speed is an exact fraction of the given ones:
for link, rate in kinematics.rates({"gear 1": 100}).items():
    print(f"{link:10} {rate}")
