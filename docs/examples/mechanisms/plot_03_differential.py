"""
The car differential, in a corner
=================================

Two degrees of freedom: the speeds of both wheels are given, those of cage, drive shaft and planets follow. Example 2 of
Penaud and Alazard (2010): a right corner, 26 and 30 rad/s.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import velocity_diagram

kinematics = hums.solve_kinematics(hums.load_gearbox("car-differential"))
corner = {"left wheel": 26, "right wheel": 30}
for link, seen_from in [("cage", "car"), ("drive shaft", "car"), ("planet a", "cage")]:
    speed = kinematics.relative_speed(link, seen_from=seen_from, speeds=corner)
    print(f"{link} relative to {seen_from}: {speed} rad/s")

# %%
figure, ax = plt.subplots(figsize=(6, 5), layout="constrained")
velocity_diagram(kinematics, corner, ax=ax)
plt.show()

# %%
# Orders require both speeds, too, and are cycles per revolution of the cage.
orders = hums.defect_orders(kinematics, speeds=corner)
print(orders[["component", "kind", "order"]].head(8).to_string(index=False))
